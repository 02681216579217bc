# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs that are killed at any point can be resumed, and lose nothing."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no forks, no locks")


@pytest.mark.parametrize(
    "scenario", ["new", "again", "frames", "zarr", "in place", "zarr in place"]
)
def test_after_a_kill_at_any_point_all_is_as_if_there_was_none(tmp_path, scenario):
    script = Path(__file__).with_name("killed_runs.py")
    words = [sys.executable, str(script), str(tmp_path), scenario]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["faults"] == [], done.stderr
    assert found["code"] == 0
    assert found["kills"] > 25
