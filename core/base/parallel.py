# SPDX-License-Identifier: GPL-3.0-or-later
"""Run compiled kernels over index ranges on all cores, with progress and cancelling.

Kernels are serial functions ``kernel(start, stop, *arrays)``, compiled beforehand (see `compiled`)
or by numba, that release the GIL; the chunks of the range run on a thread pool. (numba's own
``parallel=True`` aborts the process when two Python threads enter it, and its cache and thread
counts clash.)
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from functools import cache
from threading import Event
from typing import Any

from ..errors import Cancelled
from .compiled import Kernel, library
from .progress import ask, reporting

LARGEST_CHUNK = 1 << 15
"""Most indices per kernel call: few enough that cancelling takes milliseconds."""


def kernel(function: Callable[..., Any]) -> Any:
    """Make a kernel of a function: releases the GIL, and divides like numpy."""
    if library() is not None:
        return Kernel(function)
    from .kernel_cache import compile_kernel

    return compile_kernel(function)


most_threads: int | None = None
"""Most threads of a run; a host program sets it to keep cores free. None: one thread per core."""


def thread_count() -> int:
    """Number of threads that a run may use."""
    return most_threads or _core_count()


@cache
def _core_count() -> int:
    """Number of cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # macOS and Windows
        return os.cpu_count() or 1


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max(thread_count() - 1, 1), thread_name_prefix="shock-filter")


def chunk_size(count: int) -> int:
    """Compute the size of chunks: 16 of a range to balance the cores, but neither tiny nor huge.

    The size does not depend on the number of cores, so that sums kept per chunk are the same on
    every machine.
    """
    return min(max(-(-count // 16), 1 << 10), LARGEST_CHUNK)


def run_in_order(
    function: Callable[..., Any],
    count: int,
    *arguments: Any,
    chunk: int | None = None,
) -> None:
    """Like `run`, but chunk by chunk in order, for kernels that build on earlier chunks."""
    chunk = chunk or chunk_size(count)
    call = _bound(function, arguments)
    for start in range(0, count, chunk):
        stop = min(start + chunk, count)
        call(start, stop)
        ask(stop / count)


def blocks(count: int, size: int) -> Iterator[slice]:
    """Cut ``range(count)`` into slices for numpy; calls `ask` before each."""
    for start in range(0, count, size):
        ask(start / count)
        yield slice(start, min(start + size, count))


if hasattr(os, "register_at_fork"):  # a forked process lacks its parent's threads
    os.register_at_fork(after_in_child=_pool.cache_clear)


@contextmanager
def beside() -> Iterator[Callable[..., Future[Any]]]:
    """Yield a function that calls others on other cores while the block continues.

    Leaving the block waits for them; if the run is cancelled, or the block fails, they end at
    their next `ask`. They report no progress.
    """
    ends = Event()
    futures: list[Future[Any]] = []

    def call(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        with reporting(lambda *_: not ends.is_set()):
            return function(*arguments)

    def begin(function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        futures.append(_pool().submit(call, function, arguments))
        return futures[-1]

    try:
        yield begin
        while wait(futures, _PATIENCE).not_done:
            ask()
    except BaseException:
        ends.set()
        raise
    finally:
        wait(futures)  # as they may write to the caller's arrays


_PATIENCE = 0.05
"""Seconds between two checks for cancelling while other threads work."""


def run(
    function: Callable[..., Any],
    count: int,
    *arguments: Any,
    chunk: int | None = None,
) -> None:
    """Call ``function(start, stop, *arguments)`` for all chunks of ``range(count)``.

    The calling thread works too, and calls `ask` between its chunks (see `progress`). A chunk has
    `chunk_size` indices unless `chunk` is given. A function whose chunks take long calls `ask`
    itself: in the calling thread it reports, and in all threads it ends a run that was cancelled.

    Raises
    ------
    Cancelled
        If the progress callback cancels. Before any exception leaves this function, running chunks
        finish, or end at their next `ask`, so that no thread writes to the arrays any more.
    """
    chunk = chunk or chunk_size(count)
    chunks = -(-count // chunk)
    helpers = min(thread_count(), chunks) - 1
    numbers = itertools.count()
    stopped = False
    call = _bound(function, arguments)

    def work() -> None:
        nonlocal stopped
        try:
            while not stopped and (number := next(numbers)) < chunks:
                start = number * chunk
                call(start, min(start + chunk, count))
                ask((number + 1) / chunks)
        except BaseException:
            stopped = True
            raise

    def help_out() -> None:
        with suppress(Cancelled), reporting(lambda *_: not stopped):
            work()

    futures = [_pool().submit(help_out) for _ in range(helpers)]
    try:
        work()
    finally:
        # Helpers that another run kept from starting would find no chunk left.
        futures = [future for future in futures if not future.cancel()]
        wait(futures)
    for future in futures:
        future.result()
    ask(1.0)  # other threads may have run the last chunks


def _bound(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Callable[[int, int], Any]:
    if isinstance(function, Kernel):
        return function.bind(*arguments)
    return lambda start, stop: function(start, stop, *arguments)
