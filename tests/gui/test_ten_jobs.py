# SPDX-License-Identifier: GPL-3.0-or-later
"""Ten jobs need at most three clicks each, from the object selected to the result."""

import pytest

pytestmark = pytest.mark.slow

IMAGES = {
    "noisy_texture": "Coat denoised",
    "blurred_texture": "Coat sharpened",
    "edges": "Coated Distance",
    "uneven_charts": "Coat stitched",
    "logo": "Logo sharpened",
}


@pytest.fixture
def report(play):
    return play("ten_jobs")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert "Traceback" not in report["output"]


@pytest.mark.parametrize(
    ("job", "most"),
    [("voxel_part", 1), ("boolean_stack", 1), ("scan", 2), ("noisy_texture", 3), ("painted", 2),
     ("blurred_texture", 2), ("edges", 3), ("uneven_charts", 3), ("logo", 1),
     ("small_drawing", 3)],
)  # fmt: skip
def test_few_clicks_are_enough(report, job, most):
    assert 0 < report[job]["clicks"] <= most


@pytest.mark.parametrize("job", ["voxel_part", "scan", "painted"])
def test_mesh_is_changed(report, job):
    assert report[job]["changed"], report[job]["summaries"]


def test_a_stack_of_modifiers_becomes_a_new_object(report):
    seen = report["boolean_stack"]
    assert len(seen["new_objects"]) == 1, seen["summaries"]
    assert seen["original_is_kept"]
    assert seen["modifiers"] == [0]


@pytest.mark.parametrize("job", IMAGES)
def test_an_image_is_made(report, job):
    assert list(report[job]["made"]) == [IMAGES[job]], report[job]["summaries"]


def test_a_small_drawing_becomes_three_times_as_large(report):
    assert list(report["small_drawing"]["made"].values()) == [[288, 288]]


def test_a_mask_rises_from_the_marked_edges(report):
    assert "marked as sharp" in report["edges"]["summaries"]["generate"]
