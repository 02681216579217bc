# SPDX-License-Identifier: GPL-3.0-or-later
"""Distance, streaks and patterns are previewed on the model, and made by a press."""

import pytest

pytestmark = pytest.mark.slow

TARGETS = ["distance", "streaks", "pattern", "curvature", "occlusion", "thickness", "wear"]


@pytest.fixture
def report(play):
    return play("generating")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report.get("traceback")
    assert "Traceback" not in report["output"]


@pytest.mark.parametrize("target", TARGETS)
def test_the_model_shows_what_is_tried_and_follows_the_mouse(report, target, capsys):
    seen = report[target]
    with capsys.disabled():
        print(f"\n{target}, dragged: {seen['seconds']:.2f} s")
    assert seen["drawn"] > 5000
    assert seen["dragged"] > 500


@pytest.mark.parametrize("target", TARGETS)
def test_esc_leaves_nothing(report, target):
    assert report[target]["made_meanwhile"] == []
    assert report[target]["left"] < 500


@pytest.mark.parametrize("target", TARGETS)
def test_the_first_press_makes_something(report, target):
    seen = report[target]
    assert seen["made"] == [f"Monkey {target.title()}"]
    assert seen["deviation"] > 0.05
    assert seen["said"].startswith(f"Generated Monkey {target.title()} on 1 object: 256 x 256")
    assert seen["material"] == ["Monkey"]
