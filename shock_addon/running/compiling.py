# SPDX-License-Identifier: GPL-3.0-or-later
"""A separate Python process that compiles kernels."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress

from ...core.base import cache_folder

_SCRIPT = ("core", "rehearsal", "alone.py")
_LONGEST = 60.0
"""Seconds to wait for the end of a process."""


class Process:
    """A Python process without Blender that compiles the kernels for some kinds of data.

    Parameters
    ----------
    package : str
        The name under which the extension is imported.
    root : str
        Its folder.
    kinds : sequence of str
        Kinds of data, as in the core's registry.

    Attributes
    ----------
    fraction : float
        Fraction of the kernels that is compiled.

    Raises
    ------
    OSError
        If the process cannot be started.
    """

    def __init__(self, package: str, root: str, kinds: Sequence[str]) -> None:
        if not os.path.basename(sys.executable).lower().startswith("python"):
            raise FileNotFoundError(f"{sys.executable or 'nothing'} is named as Python")
        flags = 0
        if sys.platform == "win32":
            flags = subprocess.CREATE_NO_WINDOW | subprocess.BELOW_NORMAL_PRIORITY_CLASS
        self.fraction, self._said = 0.0, ""
        self._process = subprocess.Popen(
            [sys.executable, "-I", os.path.join(root, *_SCRIPT)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            creationflags=flags,
            text=True,
            encoding="utf-8",
            errors="replace",
        )
        task = {
            "package": package,
            "paths": sys.path,
            "folder": cache_folder.chosen,
            "kinds": kinds,
        }
        self._thread = threading.Thread(target=self._talk, args=(json.dumps(task),), daemon=True)
        self._thread.start()

    def _talk(self, task: str) -> None:
        with suppress(OSError):  # it has ended, and says why
            self._process.stdin.write(task + "\n")
            self._process.stdin.flush()  # and stays open: it ends when this is closed
        for line in self._process.stdout:
            try:
                self.fraction = max(self.fraction, float(line))
            except ValueError:
                self._said = line.strip() or self._said
        self._process.stdout.close()
        with suppress(OSError):
            self._process.stdin.close()

    @property
    def code(self) -> int | None:
        """The exit status; None while the process runs."""
        return self._process.poll()

    def last_words(self) -> str:
        """Wait for the end, and return the last line without a number, such as an error."""
        self._process.wait(_LONGEST)
        self._thread.join(_LONGEST)
        return self._said

    def stop(self) -> None:
        """End the process and wait for it, so that it has no files open."""
        self._process.kill()
        self.last_words()
