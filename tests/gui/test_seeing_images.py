# SPDX-License-Identifier: GPL-3.0-or-later
"""Preview of images and textures draws over the image, and leaves nothing behind."""

import pytest

pytestmark = pytest.mark.slow

MODES = ["image", "denoise_image", "texture"]


@pytest.fixture
def report(play):
    return play("seeing_images")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert "Traceback" not in report["output"]
    assert "ERROR" not in report["output"]


@pytest.mark.parametrize("mode", MODES)
def test_preview_is_seen_while_the_image_stays_and_escape_ends_it(report, mode):
    seen = report[mode]
    assert seen["shown"] > 300
    assert seen["dragged"] == seen["start"]
    assert seen["left"] < 20
    assert seen["dropped"] == seen["start"]


@pytest.mark.parametrize("mode", MODES)
def test_preview_is_applied_as_one_run_of_the_operator(report, mode):
    seen = report[mode]
    assert seen["started"] == ["RUNNING_MODAL"]
    assert seen["last"].startswith("SHOCK_FILTER_OT_")
    assert seen["changed"]
    assert seen["applied"]["pixels"] == seen["start"]["pixels"]
    assert seen["applied"]["images"] == seen["start"]["images"] + 1
    assert seen["time"] > (1.0 if mode == "denoise_image" else 64.0)
    assert seen["undone"] == []


def test_what_is_drawn_looks_as_blender_draws_the_image(report):
    assert len(report["kinds"]) == 10
    assert {kind: number for kind, number in report["kinds"].items() if number > 60} == {}


def test_of_a_large_image_a_patch_is_seen(report):
    seen = report["patch"]
    side = 675 * seen["zoom"]
    assert 0.8 * side < seen["width"] <= side + 4
    assert 0.8 * side < seen["height"] <= side + 4
    assert seen["changed"] > 1000


@pytest.mark.parametrize(
    "ending", ["undo", "other_image", "other_workspace", "extension_disabled", "new_file"]
)
def test_its_words_are_gone_however_it_ends(report, ending):
    seen = report["endings"][ending]
    assert min(seen["said"]) > 100
    assert max(seen["left"]) < 20
