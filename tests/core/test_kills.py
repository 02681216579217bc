# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs that are killed at any point can be resumed, and lose nothing."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no forks, no locks")


def script(folder, scenario):
    path = Path(__file__).with_name("killed_runs.py")
    words = [sys.executable, str(path), str(folder), scenario]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1]), done.stderr


SLOW = ["again", "frames", "zarr", "in place", "zarr in place"]


@pytest.mark.parametrize(
    "scenario",
    ["new", *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)],
)
def test_after_a_kill_at_any_point_all_is_as_if_there_was_none(tmp_path, scenario):
    found, said = script(tmp_path, scenario)
    assert found["faults"] == [], said
    assert found["code"] == 0
    assert found["kills"] > 25


def test_several_runs_may_resume_one_folder_at_once(tmp_path):
    found, _ = script(tmp_path, "at once")
    assert found["said"] == ""
    assert not any(found["codes"])
    names = [".shock-filter", *["a.png", "b.png", "model.gltf"]]
    assert found["left"] == sorted([*names, "model.gltf.0.bin", "model.gltf.1.bin", "textures"])
