# SPDX-License-Identifier: GPL-3.0-or-later
"""The repository's root and the zip, for all tests of the packaged extension.

The Python that runs pytest has bpy and numpy only: `nox -s test_blender` provides it, and the zip.
"""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def root() -> Path:
    """Return the repository's root."""
    return Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def start() -> Callable[..., subprocess.Popen]:
    """Return a function that starts a Python with nothing but bpy and numpy."""

    def begin(*command: str | Path) -> subprocess.Popen:
        environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
        return subprocess.Popen(
            [sys.executable, *map(str, command)],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    return begin


@pytest.fixture(scope="session")
def finish() -> Callable[[subprocess.Popen], str]:
    """Return a function that waits for such a process and returns what it printed."""

    def end(process: subprocess.Popen) -> str:
        try:
            output, _ = process.communicate(timeout=1500)  # beside other tests
        except subprocess.TimeoutExpired:
            process.kill()
            output, _ = process.communicate()
        assert process.returncode == 0, f"exit status {process.returncode}:\n{output[-5000:]}"
        return output

    return end


@pytest.fixture(scope="session")
def run(start, finish) -> Callable[..., str]:
    """Return a function that does both."""
    return lambda *command: finish(start(*command))


@pytest.fixture(scope="session")
def extension_zip(root: Path) -> Path:
    """Return the zip that `nox -s build` has made."""
    found = list((root / "dist").glob("*-linux_x64.zip"))
    assert len(found) == 1, "run `nox -s build -- --platform linux-x64` first"
    return found[0]
