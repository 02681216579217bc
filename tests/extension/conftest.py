# SPDX-License-Identifier: GPL-3.0-or-later
"""The repository's root and the zip, for all tests of the packaged extension.

The Python that runs pytest has bpy and numpy only: `nox -s test_blender` provides it. Where
``SHOCK_FILTER_ZIPS`` names a folder, its zips are tested; without it one is built.
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
def extension_zip(root: Path, run: Callable[..., str]) -> Path:
    """Return the zip for the Blender at hand, built from the present source."""
    version = run("-c", "import bpy; print(*bpy.app.version[:2], sep='.')").split()[-1]
    series = "4.2" if tuple(map(int, version.split("."))) < (5, 1) else "5.1"
    if folder := os.environ.get("SHOCK_FILTER_ZIPS"):
        (ready,) = Path(folder).glob(f"*-linux_x64-blender{series.replace('.', '')}.zip")
        return ready
    output = run(
        root / "tools" / "build_extension.py", "--platform", "linux-x64", "--series", series
    )
    return root / "dist" / output.split()[-1]
