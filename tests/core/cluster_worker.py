# SPDX-License-Identifier: GPL-3.0-or-later
"""What workers of tests load before all else: names of files say what befalls their worker.

All that are begun are written down in ``begun.txt`` beside them.
"""

import os
import signal
import time
from functools import wraps
from pathlib import Path

from shock_filter.core.base import parallel
from shock_filter.core.cli import FileBackend
from shock_filter.core.errors import Cancelled

_filter = getattr(FileBackend.filter, "__wrapped__", FileBackend.filter)  # Dask loads this twice


@wraps(_filter)
def _watched(self, command, source, target, settings, options, progress):
    source = Path(source)
    first = not source.with_suffix(".met").exists()
    with open(source.parent / "begun.txt", "a") as file:
        file.write(f"{source.stem} {os.getpid()} {parallel.thread_count()}\n")
    if "deadly" in source.stem or ("unlucky" in source.stem and first):
        source.with_suffix(".met").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    while "endless" in source.stem:
        if not progress(0.5, "Waiting"):
            raise Cancelled("Cancelled.")
        time.sleep(0.01)
    outcome = _filter(self, command, str(source), target, settings, options, progress)
    if "late" in source.stem and first:
        source.with_suffix(".met").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return outcome


FileBackend.filter = _watched
