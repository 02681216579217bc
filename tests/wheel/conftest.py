# SPDX-License-Identifier: GPL-3.0-or-later
"""The installed command, for tests of what each extra brings."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture
def shock_filter(tmp_path: Path) -> Callable[..., None]:
    """Return a function that runs the command in an empty folder."""
    command = Path(sys.executable).with_name("shock-filter")

    def run(*words: str) -> None:
        done = subprocess.run([command, *words], cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr

    return run
