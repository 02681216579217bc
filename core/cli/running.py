# SPDX-License-Identifier: GPL-3.0-or-later
"""Filtering file by file: messages, the progress bar, Ctrl-C and exit codes."""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple, TextIO

from ..base.findings import gathering
from ..errors import ShockError
from ..files.output import Unfinished, guarded, make_folder
from . import records
from .commands import Backend
from .inputs import check_target, outputs_of

DONE, FAILED, INTERRUPTED = 0, 1, 130


class Job(NamedTuple):
    """The work to do with each file."""

    backend: Backend
    settings: Any
    options: argparse.Namespace

    def outputs(self, source: str, target: Path) -> list[Path]:
        """All files that are made from an input."""
        return outputs_of(source, target, self.options)

    def is_done(self, source: str, target: Path) -> bool:
        """Whether an earlier run has made all outputs."""
        if not self.options.resume:
            return False
        return self._is_made(source, target)

    def _is_made(self, source: str, target: Path) -> bool:
        try:
            made = records.fingerprint(source, self.options)
            return all(records.is_done(each, made) for each in self.outputs(source, target))
        except OSError:  # reading it will report this
            return False

    def is_done_meanwhile(self, source: str, target: Path) -> bool:
        """Whether another run has made all outputs since this one began with the file."""
        return not self.options.overwrite and self.is_recorded and self._is_made(source, target)

    @property
    def is_recorded(self) -> bool:
        """Whether records of outputs are kept."""
        return self.options.resume or self.options.cluster is not None

    def may_replace(self, output: Path) -> bool:
        """Whether an existing output may be replaced."""
        return self.options.overwrite or (self.options.resume and records.is_ours(output))


class Result(NamedTuple):
    """The result of a file: whether it was written, and a message."""

    is_done: bool
    text: str

    def tell(self, quiet: bool) -> None:
        """Print the message."""
        if not self.is_done:
            say(self.text, sys.stderr)
        elif not quiet:
            say(self.text, sys.stdout)


def run_all(job: Job, pairs: list[tuple[str, Path]]) -> int:
    """Filter each input into its output; returns the exit code."""
    failed = False
    skipped = 0
    quiet = job.options.quiet
    with Interrupt() as interrupt:
        for source, target in pairs:
            if interrupt.asked:  # too late for the previous file
                say(_interrupted(job.outputs(source, target)), sys.stderr)
                return INTERRUPTED
            if job.is_done(source, target):
                skipped += 1
                continue
            bar = Bar(source, interrupt, quiet)
            result = filter_file(job, source, target, bar, lambda: interrupt.asked)
            bar.clear()
            result.tell(quiet)
            if interrupt.asked and not result.is_done:
                return INTERRUPTED
            failed |= not result.is_done
    tell_skipped(skipped, quiet)
    return FAILED if failed else DONE


def tell_skipped(count: int, quiet: bool) -> None:
    """Report how many files were done before."""
    if count and not quiet:
        say(f"Skipped, as they are done already: {count}", sys.stdout)


def filter_file(
    job: Job,
    source: str,
    target: Path,
    progress: Callable[[float, str], bool],
    is_stopped: Callable[[], bool],
) -> Result:
    """Filter one file; the result says what was done, or why not."""
    backend, settings, options = job
    start = time.perf_counter()
    outputs = job.outputs(source, target)
    try:
        for each in outputs:
            if not options.command.kind.makes_frames:
                check_target(each, job.may_replace(each))
            make_folder(each.parent)
        overwrite = any(map(job.may_replace, outputs))
        options = argparse.Namespace(**{**vars(options), "overwrite": overwrite})
        with gathering() as findings, _recording(job, source, outputs):
            outcome = backend.filter(options.command, source, target, settings, options, progress)
    except (ShockError, OSError, KeyboardInterrupt) as error:
        if isinstance(error, Unfinished):
            return Result(False, str(error))
        if is_stopped():
            return Result(False, _interrupted(outputs))
        if job.is_done_meanwhile(source, target):
            return Result(True, f"{source} -> {outputs[0]}: made by another run meanwhile")
        return failure(source, error)
    except MemoryError as error:
        reason = f" ({error})" if str(error) else ""
        text = f"{source} needs more memory than there is{reason}; free some."
        return failure(source, ShockError(text))
    except Exception as error:  # unforeseen; the other files are processed all the same
        trace = "".join(traceback.format_exception(error))
        return Result(False, f"{trace}\nFailed: {source}: {type(error).__name__}: {error}")
    seconds = time.perf_counter() - start
    done = f"{source} -> {outputs[0]}: {outcome} in {seconds:.1f} s"
    notes = (f"  {note}" for note in (*map(str, findings), *outcome.notes))
    return Result(True, "\n".join([done, *notes]))


@contextlib.contextmanager
def _recording(job: Job, source: str, outputs: list[Path]) -> Iterator[None]:
    """Note how outputs are made, if requested."""
    if not job.is_recorded:
        yield
        return
    for each in outputs:
        records.check_folder(each)
    record = records.Record(outputs, records.fingerprint(source, job.options))
    with guarded(record.guard):
        yield
    record.complete()


def _interrupted(outputs: list[Path]) -> str:
    return f"Interrupted; {outputs[0]} was not written."


def failure(source: str, error: BaseException) -> Result:
    """Say why a file was not filtered."""
    text = str(error)
    return Result(False, "Failed: " + (text if source in text else f"{source}: {text}"))


def say(text: str, stream: TextIO | None, end: str = "\n") -> None:
    """Print, and never stop a run: not without a reader, on a full disk, or for a character."""
    if stream is None:  # programs without a console
        return
    encoding = stream.encoding or "utf-8"
    try:
        known = text.encode(encoding, "backslashreplace").decode(encoding)
        print(known, file=stream, end=end, flush=True)
    except OSError:
        # Text left in the buffer would raise again at the end of the program.
        with contextlib.suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)


class Interrupt:
    """Ctrl-C asks for an end through the progress callback; a second one forces it."""

    asked = False

    def __enter__(self) -> Interrupt:
        self._is_main = threading.current_thread() is threading.main_thread()
        if self._is_main:
            self._before = signal.signal(signal.SIGINT, self._ask)
        return self

    def __exit__(self, *_: object) -> None:
        if self._is_main:
            # None: the handler was set from C, as Blender does.
            signal.signal(signal.SIGINT, self._before or signal.SIG_DFL)

    def _ask(self, _number: int, _frame: FrameType | None) -> None:
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True
        say("\nStopping; press Ctrl-C again if this takes too long.", sys.stderr)


class Bar:
    """A progress callback that draws a bar, on terminals only."""

    def __init__(self, name: str, interrupt: Interrupt, quiet: bool) -> None:
        self._name = os.path.basename(name)
        self._interrupt = interrupt
        self._shown = sys.stderr is not None and sys.stderr.isatty() and not quiet

    def __call__(self, fraction: float, message: str) -> bool:
        if self._shown:
            filled = round(20 * fraction)
            bar = "#" * filled + "." * (20 - filled)
            self._draw(f"{self._name} [{bar}] {fraction:4.0%} {message}")
        return not self._interrupt.asked

    def clear(self) -> None:
        """Remove the bar."""
        if self._shown:
            self._draw("")

    def _draw(self, text: str) -> None:
        say(f"\r\x1b[K{text}", sys.stderr, end="")
