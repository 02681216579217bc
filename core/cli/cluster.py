# SPDX-License-Identifier: GPL-3.0-or-later
"""Many files on a Dask cluster: each file is a task, whose worker reads, filters and writes it.

Pictures that may not fit into memory are filtered one at a time, with their chunks as tasks.

If a worker is lost, Dask gives its task to another one. All other failures of a file are ordinary
results, and so are not retried.
"""

from __future__ import annotations

import argparse
import math
import pickle
import sys
import time
import uuid
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from ... import __version__
from ..errors import ShockError
from ..registry import IMAGE
from . import worker
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
from .scheduler import connected

_GLANCE = 0.2  # seconds between checks for Ctrl-C
_PAUSE = 1.0  # seconds between checks of the workers
_AHEAD = 2  # files per thread of the workers, so that none waits for its next file

File = tuple[str, Path]


def run_on_cluster(job: Job, files: Iterable[File]) -> int:
    """Let the workers of a cluster filter each input into its output; returns the exit code."""
    # Workers run in other folders.
    named = [(str(Path(source).absolute()), target.absolute()) for source, target in files]
    with Interrupt() as interrupt:
        try:
            with connected(job.options.cluster) as client:
                _check_workers(client)
                return _Run(client, job, len(named), interrupt).run(named)
        except ShockError as error:
            say(f"Failed: {error}", sys.stderr)
            return FAILED
        except KeyboardInterrupt:
            return INTERRUPTED


class _Run:
    """All files of a run, and their results."""

    def __init__(self, client: Any, job: Job, count: int, interrupt: Interrupt) -> None:
        options = job.options
        self._client, self._job, self._count, self._interrupt = client, job, count, interrupt
        self._name = uuid.uuid4().hex
        # Overwriting is checked here, as a worker may be lost after it has written.
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
        whole_ones: list[File] = []
        divided: list[File] = []
        for file in files:
            (divided if _is_divided(self._job, *file) else whole_ones).append(file)
        try:
            for suspect in self._filter(self._to_do(whole_ones)):
                # Alone, as another file may have killed the worker of both.
                for source, _ in self._filter(iter([suspect])):
                    reason = "each worker that had it was lost; has it enough memory for this?"
                    self._note(failure(source, ShockError(f"{source}: {reason}")))
            for source, target in self._to_do(divided):
                self._note(self._divide(source, target))
                if self._interrupt.asked:
                    break
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
        """Filter files; returns those whose workers were lost repeatedly."""
        from distributed import CancelledError, KilledWorker

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
                except (CancelledError, OSError):
                    raise
                except Exception as error:  # would affect all remaining files
                    raise ShockError(
                        f"A new worker cannot be used: {_reason(error)} {self._progress()}; add"
                        " --resume to go on."
                    ) from error
            self._bar(self._ended / self._count, f"{self._ended} of {self._count} files")

    def _to_do(self, files: Iterable[File]) -> Iterator[File]:
        """Yield the files that workers must process."""
        for source, target in files:
            if self._job.is_done(source, target):
                self._skipped += 1
                continue
            try:
                _check_targets(self._job, source, target)
            except (ShockError, OSError) as error:
                self._note(failure(source, error))
            else:
                yield source, target

    def _submit(self, source: str, target: Path) -> Any:
        backend, settings, _ = self._job
        call = worker.call(
            worker.filter_here,
            __version__,
            self._name,
            backend,
            settings,
            self._flags,
            source,
            target,
        )
        return self._client.submit(pickle.loads, call, key=f"shock-filter-{uuid.uuid4().hex}")

    def _divide(self, source: str, target: Path) -> Result:
        """Filter one picture here, with its chunks computed by the workers."""
        # Workers open the files that flags name, from other folders.
        options = argparse.Namespace(**whole(self._job.options))

        def tell(fraction: float, message: str) -> bool:
            return self._bar((self._ended + fraction) / self._count, message)

        job = self._job._replace(options=options)
        return filter_file(job, source, target, tell, lambda: self._interrupt.asked)

    def _room(self) -> int:
        """How many files may be in progress; queried now and then, as workers come and go."""
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
        """Let workers stop the files that they work on."""
        if not self._is_stopped:
            self._is_stopped = True
            self._client.run(pickle.loads, worker.call(worker.stop, self._name), on_error="ignore")


def _finished(futures: Iterable[Any]) -> Iterable[Any]:
    """Wait a moment for some tasks to finish."""
    from distributed import wait

    try:
        return wait(list(futures), timeout=_GLANCE, return_when="FIRST_COMPLETED").done
    except TimeoutError:
        return ()


def _is_divided(job: Job, source: str, target: Path) -> bool:
    """Tell whether a file is a picture that is filtered chunk by chunk."""
    if job.options.command.kind is not IMAGE:
        return False
    from ..files.images import is_big

    try:
        return is_big(Path(source), target)
    except (ShockError, OSError):  # a worker will report it
        return False


def _check_targets(job: Job, source: str, target: Path) -> None:
    """Refuse to replace outputs unless requested."""
    if job.options.command.kind.makes_frames and job.options.kind != "lines":
        from ..files.frames import check_frames_target

        check_frames_target(target, job.may_replace(target))
    else:
        for each in job.outputs(source, target):
            check_target(each, job.may_replace(each))


def _check_workers(client: Any) -> None:
    """Refuse workers that would produce other results, or none."""
    answers = client.run(pickle.loads, worker.call(worker.prepare, __version__), on_error="return")
    for address, answer in answers.items():
        is_lost = isinstance(answer, OSError)  # only now; others will do
        if isinstance(answer, Exception) and not is_lost:
            raise ShockError(f"The worker {address} cannot be used: {_reason(answer)}")


def _reason(error: Exception) -> str:
    if isinstance(error, ImportError):
        return f"it cannot load Shock Filter ({error}); install it there."
    return str(error)
