# SPDX-License-Identifier: GPL-3.0-or-later
"""The code that runs in the workers of a cluster, and how it gets there."""

from __future__ import annotations

import argparse
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ... import __version__
from ..errors import ShockError
from .file_backend import FileBackend
from .running import Job, Result, filter_file


class _Call:
    """An object that becomes the result of a call when it is unpickled.

    Dask itself is given nothing but `pickle.loads`. So the scheduler needs no Shock Filter, and a
    worker without it can say so: a function of ours would make it crash.
    """

    def __init__(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        self._made_of = function, arguments

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return self._made_of


def call(function: Callable[..., Any], *arguments: Any) -> bytes:
    """Pack a call for `pickle.loads` in a worker."""
    return pickle.dumps(_Call(function, arguments))


_stopped: set[str] = set()
"""Names of the runs that must stop."""


def stop(run: str) -> None:
    """Stop working on the files of a run."""
    _stopped.add(run)


def prepare(wanted: str) -> None:
    """Refuse to work for another version; use one thread for each thread of the worker."""
    from ..base import parallel

    parallel.most_threads = 1
    if wanted != __version__:
        raise ShockError(
            f"it has version {__version__} of Shock Filter, and {wanted} asks; install the same."
        )


def filter_here(
    version: str,
    run: str,
    backend: Any,
    settings: Any,
    flags: dict[str, Any],
    source: str,
    target: Path,
) -> Result:
    """Filter one file in a worker."""
    prepare(version)
    (command,) = (row for row in FileBackend.offered if row.command == flags["command"])
    job = Job(backend, settings, argparse.Namespace(**{**flags, "command": command}))
    return filter_file(job, source, target, lambda *_: run not in _stopped, lambda: run in _stopped)
