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
from pathlib import Path
from types import FrameType
from typing import Any, TextIO

from ..base.findings import gathering
from ..errors import ShockError
from ..files.output import Unfinished
from .commands import Backend
from .inputs import check_target

DONE, FAILED, INTERRUPTED = 0, 1, 130


def run_all(
    backend: Backend,
    pairs: list[tuple[str, Path]],
    settings: Any,
    options: argparse.Namespace,
) -> int:
    """Filter each input into its output; returns the exit code."""
    failed = False
    with _Interrupt() as interrupt:
        for source, target in pairs:
            if interrupt.asked:  # too late for the file before
                say(f"Interrupted; {target} was not written.", sys.stderr)
                return INTERRUPTED
            done = _run_one(backend, source, target, settings, options, interrupt)
            if interrupt.asked and not done:
                return INTERRUPTED
            failed |= not done
    return FAILED if failed else DONE


def _run_one(
    backend: Backend,
    source: str,
    target: Path,
    settings: Any,
    options: argparse.Namespace,
    interrupt: _Interrupt,
) -> bool:
    """Filter one file and say so, or why not."""
    bar = _Bar(source, interrupt, shown=sys.stderr.isatty() and not options.quiet)
    start = time.perf_counter()
    try:
        if not options.command.kind.makes_frames:
            check_target(target, options.overwrite)
        target.parent.mkdir(parents=True, exist_ok=True)
        with gathering() as findings:
            outcome = backend.filter(options.command, source, target, settings, options, bar)
    except (ShockError, OSError, KeyboardInterrupt) as error:
        bar.clear()
        if isinstance(error, Unfinished):
            say(str(error), sys.stderr)
        elif interrupt.asked:
            say(f"Interrupted; {target} was not written.", sys.stderr)
        else:
            say(f"Failed: {_sentence(source, error)}", sys.stderr)
        return False
    except Exception as error:  # unforeseen; the other files are done all the same
        bar.clear()
        say("".join(traceback.format_exception(error)), sys.stderr)
        say(f"Failed: {source}: {type(error).__name__}: {error}", sys.stderr)
        return False
    bar.clear()
    if not options.quiet:
        seconds = time.perf_counter() - start
        say(f"{source} -> {target}: {outcome} in {seconds:.1f} s", sys.stdout)
        for note in (*map(str, findings), *outcome.notes):
            say(f"  {note}", sys.stdout)
    return True


def say(text: str, stream: TextIO | None, end: str = "\n") -> None:
    """Print, and never stop a run: not where nobody reads, on a full disk, or for a letter."""
    if stream is None:  # programs without a console
        return
    encoding = stream.encoding or "utf-8"
    try:
        known = text.encode(encoding, "backslashreplace").decode(encoding)
        print(known, file=stream, end=end, flush=True)
    except OSError:
        # What is left in the buffer would raise again at the end of the program.
        with contextlib.suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)


def _sentence(source: str, error: BaseException) -> str:
    text = str(error)
    return text if source in text else f"{source}: {text}"


class _Interrupt:
    """Ctrl-C asks for an end through the progress callback; the second one forces it."""

    asked = False

    def __enter__(self) -> _Interrupt:
        self._is_main = threading.current_thread() is threading.main_thread()
        if self._is_main:
            self._before = signal.signal(signal.SIGINT, self._ask)
        return self

    def __exit__(self, *_: object) -> None:
        if self._is_main:
            # None: it was set from C, as Blender does.
            signal.signal(signal.SIGINT, self._before or signal.SIG_DFL)

    def _ask(self, _number: int, _frame: FrameType | None) -> None:
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True
        say("\nStopping; press Ctrl-C again if this takes too long.", sys.stderr)


class _Bar:
    """A progress callback that draws a bar on the terminal."""

    def __init__(self, name: str, interrupt: _Interrupt, shown: bool) -> None:
        self._name = os.path.basename(name)
        self._interrupt = interrupt
        self._shown = shown

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
