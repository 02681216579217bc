# SPDX-License-Identifier: GPL-3.0-or-later
"""Run compiled kernels over index ranges on all cores, with progress and cancelling.

Kernels are serial numba functions ``kernel(start, stop, *arrays)`` that release the GIL; the
chunks of the range run on a thread pool. (numba's own ``parallel=True`` aborts the process when
two Python threads enter it, and its cache and thread counts clash.)
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import cache
from typing import Any

from numba import njit

from .kernel_cache import keep_on_disk
from .progress import ask

LARGEST_CHUNK = 1 << 15
"""Most indices that a kernel gets at once: few enough that cancelling acts within milliseconds."""


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a kernel: releases the GIL, keeps compiled code on disk, divides like numpy."""
    return keep_on_disk(njit(nogil=True, error_model="numpy")(function))


def sum_kernel(function: Callable[..., Any]) -> Any:
    """Compile a kernel that adds up long arrays: the order of the additions is left open."""
    compiled = njit(nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
    return keep_on_disk(compiled(function))


most_threads: int | None = None
"""Threads of one run, where a host program has work for the other cores; None is one a core."""


def thread_count() -> int:
    """Threads that a run may use."""
    return most_threads or _core_count()


@cache
def _core_count() -> int:
    """Cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # macOS and Windows
        return os.cpu_count() or 1


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max(thread_count() - 1, 1), thread_name_prefix="shock-filter")


def chunk_size(count: int) -> int:
    """Cut a range into 16 chunks to balance the cores, but neither tiny nor huge ones.

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
    """Do what `run` does chunk by chunk, for kernels that build on what came before."""
    chunk = chunk or chunk_size(count)
    for start in range(0, count, chunk):
        stop = min(start + chunk, count)
        function(start, stop, *arguments)
        ask(stop / count)


def blocks(count: int, size: int) -> Iterator[slice]:
    """Cut ``range(count)`` into slices, for numpy; asks whether to go on before each."""
    for start in range(0, count, size):
        ask(start / count)
        yield slice(start, min(start + size, count))


if hasattr(os, "register_at_fork"):  # a forked process has no threads of its parent's
    os.register_at_fork(after_in_child=_pool.cache_clear)


def begin(function: Callable[..., Any], *arguments: Any) -> Future[Any]:
    """Call a function on another core, while this one goes on; it reports no progress."""
    return _pool().submit(function, *arguments)


def run(
    function: Callable[..., Any],
    count: int,
    *arguments: Any,
    chunk: int | None = None,
) -> None:
    """Call ``function(start, stop, *arguments)`` for all chunks of ``range(count)``.

    The calling thread works too, and asks between its chunks whether to go on (see `progress`). A
    chunk is `chunk_size` indices, unless `chunk` says otherwise.

    Raises
    ------
    Cancelled
        When the progress callback asks for it. Whatever is raised, chunks under way are finished
        first: nobody writes to the arrays any more.
    """
    chunk = chunk or chunk_size(count)
    chunks = -(-count // chunk)
    helpers = min(thread_count(), chunks) - 1
    numbers = itertools.count()
    stopped = False

    def work() -> None:
        nonlocal stopped
        try:
            while not stopped and (number := next(numbers)) < chunks:
                start = number * chunk
                function(start, min(start + chunk, count), *arguments)
                ask((number + 1) / chunks)  # answers in the calling thread only
        except BaseException:
            stopped = True
            raise

    futures = [_pool().submit(work) for _ in range(helpers)]
    try:
        work()
    finally:
        # Helpers that have not begun would find nothing to do, once another run lets them.
        futures = [future for future in futures if not future.cancel()]
        wait(futures)
    for future in futures:
        future.result()
    ask(1.0)  # the last chunks may have been those of other threads
