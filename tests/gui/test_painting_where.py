# SPDX-License-Identifier: GPL-3.0-or-later
"""Paint Where of a live texture, in a window."""

import pytest

pytestmark = pytest.mark.slow


@pytest.fixture
def report(play):
    return play("painting_where")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert "Traceback" not in report["output"]


def test_the_result_is_seen_under_the_brush(report):
    seen = report["painted"]
    assert seen["began"] == ["FINISHED"]
    assert (seen["mode"], seen["shading"]) == ("PAINT_TEXTURE", "MATERIAL")
    assert seen["canvas"] == "Coat mask"
    assert seen["black"] == 0.0 < seen["white"] < 0.9
    assert seen["changed"] > 0 and seen["kept"]


def test_the_stroke_and_the_press_are_a_step_of_undo_each(report):
    stroke, before, pressed, painted = report["undone"]
    assert stroke == pressed == ["PAINT_TEXTURE", True, 0.0]
    assert before == ["OBJECT", False, 0.0]
    assert painted[:2] == ["PAINT_TEXTURE", True] and painted[2] > 0.0
