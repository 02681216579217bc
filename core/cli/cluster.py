# SPDX-License-Identifier: GPL-3.0-or-later
"""Many files on a Dask cluster: each is a task, whose worker reads, filters and writes it.

Dask hands the task of a worker that is lost to another one. All else that goes wrong with a file is
an answer like others, and so is not tried again.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import logging
import math
import pickle
import signal
import sys
import threading
import time
import uuid
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from ... import __version__
from ..errors import ShockError
from .commands import COMMANDS
from .inputs import check_target, whole
from .running import (
    DONE,
    FAILED,
    INTERRUPTED,
    Bar,
    Interrupt,
    Job,
    Result,
    failure,
    filter_file,
    say,
    tell_skipped,
)

_LOCAL = "local"
_PATIENCE = 3.5  # seconds for a scheduler to answer
_GLANCE = 0.2  # seconds between looks at what has been pressed
_PAUSE = 1.0  # seconds between looks at which workers there are
_AHEAD = 2  # files for each thread of the workers, so that none waits for its next one

File = tuple[str, Path]


def run_on_cluster(job: Job, files: Iterable[File]) -> int:
    """Have the workers of a cluster filter each input into its output; returns the exit code."""
    # Workers have folders of their own.
    named = [(str(Path(source).absolute()), target.absolute()) for source, target in files]
    with Interrupt() as interrupt:
        try:
            with _connected(job.options.cluster) as client:
                _check_workers(client)
                return _Run(client, job, len(named), interrupt).run(named)
        except ShockError as error:
            say(f"Failed: {error}", sys.stderr)
            return FAILED
        except KeyboardInterrupt:
            return INTERRUPTED


# ------------------------------------------------------------------------------------ the scheduler


@contextlib.contextmanager
def _connected(address: str) -> Iterator[Any]:
    """Connect to the scheduler at an address, or start one here with its workers."""
    try:
        distributed = importlib.import_module("distributed")
    except ImportError as error:
        raise ShockError(
            "--cluster needs Dask; run: pip install 'shock-filter[cluster]'."
        ) from error
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters is said here
    with contextlib.ExitStack() as stack:
        place: Any = address
        if address == _LOCAL:
            from ..base.parallel import thread_count

            with _deaf_to_ctrl_c():  # workers are told when to stop
                local = distributed.LocalCluster(
                    n_workers=thread_count(),
                    threads_per_worker=1,
                    memory_limit=None,  # a large file may take what small ones leave
                    dashboard_address=None,
                    silence_logs=logging.CRITICAL,
                )
            place = stack.enter_context(local)
        yield stack.enter_context(_client(distributed, place))


@contextlib.contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
    """Keep Ctrl-C, which a terminal sends to all, from threads and processes that start here."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # or its start would let Ctrl-C in again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _client(distributed: Any, place: Any) -> Any:
    """Connect in time: where something else answers, Dask would wait for ever."""
    answers: list[Any] = []

    def connect() -> None:
        try:
            answers.append(distributed.Client(place, timeout=_PATIENCE - 0.5))
        except Exception as error:
            answers.append(error)

    thread = threading.Thread(target=connect, daemon=True)
    thread.start()
    thread.join(_PATIENCE)
    answer = answers[0] if answers else "something else answers"
    if isinstance(answer, str | Exception):
        raise ShockError(
            f"There is no Dask scheduler at {place} ({answer}); start one with dask scheduler, or"
            " use --cluster local."
        )
    return answer


def _check_workers(client: Any) -> None:
    """Refuse workers that would make other results, or none."""
    answers = client.run(pickle.loads, _call(_check_version, __version__), on_error="return")
    for worker, answer in answers.items():
        if isinstance(answer, ImportError | ShockError):  # and not if it has just been lost
            raise ShockError(f"The worker {worker} cannot be used: {_reason(answer)}")


def _reason(error: Exception) -> str:
    if isinstance(error, ImportError):
        return f"it cannot load Shock Filter ({error}); install it there."
    return str(error)


# ---------------------------------------------------------------------------------------- the files


class _Run:
    """All files of a run, and what became of them."""

    def __init__(self, client: Any, job: Job, count: int, interrupt: Interrupt) -> None:
        options = job.options
        self._client, self._job, self._count, self._interrupt = client, job, count, interrupt
        self._name = uuid.uuid4().hex
        # Whether an output may be replaced is asked here, as a worker may be lost after writing.
        self._flags = {**whole(options), "command": options.command.command, "overwrite": True}
        self._bar = Bar(options.cluster, interrupt, options.quiet)
        self._failures: list[Result] = []
        self._written = self._skipped = 0
        self._threads, self._asked = 1, -math.inf
        self._is_stopped = False

    def run(self, files: Iterable[File]) -> int:
        """Filter all; returns the exit code."""
        from distributed import CancelledError

        quiet = self._job.options.quiet
        try:
            for suspect in self._filter(self._to_do(files)):
                # Alone, as it may have been another file that ended the worker of both.
                for source, _ in self._filter(iter([suspect])):
                    reason = "each worker that had it was lost; has it enough memory for this?"
                    self._note(failure(source, ShockError(f"{source}: {reason}")))
        except (CancelledError, OSError) as error:
            raise ShockError(
                f"The scheduler at {self._job.options.cluster} is gone; {self._progress()}. Start"
                " it again, and add --resume to go on."
            ) from error
        finally:
            self._bar.clear()
            for result in sorted(self._failures):
                result.tell(quiet)
        tell_skipped(self._skipped, quiet)
        if self._ended < self._count:
            say(f"Interrupted; {self._progress()}. Add --resume to go on.", sys.stderr)
            return INTERRUPTED
        return FAILED if self._failures else DONE

    @property
    def _ended(self) -> int:
        return self._written + self._skipped + len(self._failures)

    def _progress(self) -> str:
        return f"{self._written} of {self._count} files were written"

    def _filter(self, waiting: Iterator[File]) -> list[File]:
        """Filter files; returns those whose workers were lost again and again."""
        from distributed import KilledWorker

        under_way: dict[Any, File] = {}
        suspects: list[File] = []
        while True:
            if self._interrupt.asked:
                self._stop()
            else:
                for file in islice(waiting, max(self._room() - len(under_way), 0)):
                    under_way[self._submit(*file)] = file
            if not under_way:
                return suspects
            for future in _finished(under_way):
                file = under_way.pop(future)
                try:
                    self._note(future.result())
                except KilledWorker:
                    suspects.append(file)
                except (ImportError, ShockError) as error:  # it would fail all that are left
                    raise ShockError(
                        f"A new worker cannot be used: {_reason(error)} {self._progress()}; add"
                        " --resume to go on."
                    ) from error
            self._bar(self._ended / self._count, f"{self._ended} of {self._count} files")

    def _to_do(self, files: Iterable[File]) -> Iterator[File]:
        """Pass on what is for workers to do."""
        for source, target in files:
            if self._job.is_done(source, target):
                self._skipped += 1
                continue
            try:
                _check_target(self._job, target)
            except (ShockError, OSError) as error:
                self._note(failure(source, error))
            else:
                yield source, target

    def _submit(self, source: str, target: Path) -> Any:
        backend, settings, _ = self._job
        call = _call(
            _filter_here, __version__, self._name, backend, settings, self._flags, source, target
        )
        return self._client.submit(pickle.loads, call, key=f"shock-filter-{uuid.uuid4().hex}")

    def _room(self) -> int:
        """How many files may be under way; asks now and then, as workers come and go."""
        now = time.monotonic()
        if now - self._asked > _PAUSE:
            self._asked = now
            threads = sum(self._client.nthreads().values())
            if not threads and self._threads:
                say("The cluster has no worker; waiting for one.", sys.stderr)
            self._threads = threads
        return max(_AHEAD * self._threads, 1)

    def _note(self, result: Result) -> None:
        if result.is_done:
            self._written += 1
            self._bar.clear()
            result.tell(self._job.options.quiet)
        elif not self._interrupt.asked:
            self._failures.append(result)

    def _stop(self) -> None:
        """Have workers leave the files that they are at."""
        if not self._is_stopped:
            self._is_stopped = True
            self._client.run(pickle.loads, _call(_stop_here, self._name), on_error="ignore")


def _finished(futures: Iterable[Any]) -> Iterable[Any]:
    """Wait a moment for some tasks to finish."""
    from distributed import wait

    try:
        return wait(list(futures), timeout=_GLANCE, return_when="FIRST_COMPLETED").done
    except TimeoutError:
        return ()


def _check_target(job: Job, target: Path) -> None:
    """Refuse to replace an output, unless that is asked for."""
    may_replace = job.may_replace(target)
    if job.options.command.kind.makes_frames and job.options.kind != "lines":
        from ..files.frames import check_frames_target

        check_frames_target(target, may_replace)
    else:
        check_target(target, may_replace)


# --------------------------------------------------------------------------------------- at workers


class _Call:
    """Something that becomes the result of a call where it is unpickled.

    Dask itself is told of nothing but `pickle.loads`. So the scheduler needs no Shock Filter, and
    a worker that has none can answer so: it would come to an end over a function of ours.
    """

    def __init__(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        self._made_of = function, arguments

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return self._made_of


def _call(function: Callable[..., Any], *arguments: Any) -> bytes:
    return pickle.dumps(_Call(function, arguments))


_stopped: set[str] = set()
"""Names of the runs that are to end."""


def _stop_here(run: str) -> None:
    _stopped.add(run)


def _check_version(wanted: str) -> None:
    if wanted != __version__:
        raise ShockError(
            f"it has version {__version__} of Shock Filter, and {wanted} asks; install the same."
        )


def _filter_here(
    version: str,
    run: str,
    backend: Any,
    settings: Any,
    flags: dict[str, Any],
    source: str,
    target: Path,
) -> Result:
    """Filter one file in a worker, which has as many threads of its own as it is to use."""
    _check_version(version)
    from ..base import parallel

    parallel.most_threads = 1
    (command,) = (row for row in COMMANDS if row.command == flags["command"])
    job = Job(backend, settings, argparse.Namespace(**{**flags, "command": command}))
    return filter_file(job, source, target, lambda *_: run not in _stopped, lambda: run in _stopped)
