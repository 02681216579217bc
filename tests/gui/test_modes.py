# SPDX-License-Identifier: GPL-3.0-or-later
"""Each mode does the same by operator and by a click, and undo takes it back exactly."""

import pytest

pytestmark = pytest.mark.slow

MESH_MODES = ["denoise", "geometry", "colors"]
IMAGE_MODES = [
    "texture",
    "image-editor-denoise_image",
    "image-editor-image",
    "image-editor-texture",
]


@pytest.fixture
def report(play):
    return play("modes")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert "Traceback" not in report["output"]


@pytest.mark.parametrize("mode", MESH_MODES)
def test_mesh_mode_by_operator(report, mode):
    seen = report[mode]
    assert seen["started"] == ["RUNNING_MODAL"]
    changed = "colors" if mode == "colors" else "positions"
    assert seen["by_operator"][changed] != seen["start"][changed]
    assert "1 mesh" in seen["summary"]


@pytest.mark.parametrize("mode", MESH_MODES)
def test_mesh_mode_is_undone_and_redone_exactly(report, mode):
    seen = report[mode]
    assert seen["undone"] == seen["start"]
    assert seen["redone"] == seen["by_operator"]
    assert seen["undone_again"] == seen["start"]


@pytest.mark.parametrize("mode", MESH_MODES)
def test_mesh_mode_by_click_does_the_same(report, mode):
    assert report[mode]["by_click"] == report[mode]["by_operator"]


@pytest.mark.parametrize("mode", IMAGE_MODES)
def test_image_mode_makes_the_same_image_by_operator_and_by_click(report, mode):
    seen = report[mode]
    assert seen["started"] == ["RUNNING_MODAL"]
    (new,) = seen["by_operator"]
    assert new != seen["source"]
    assert seen["by_click"] == [new]
    assert seen["originals"] == seen["start"]


def test_a_pattern_grows_by_a_click(report):
    assert len(report["generated"]) == 1
