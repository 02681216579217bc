# SPDX-License-Identifier: GPL-3.0-or-later
"""After runs the panel shows what happened, and painting goes on with the new image."""

import pytest


@pytest.fixture
def report(play):
    return play("after_runs")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert "Traceback" not in report["output"]


def test_after_a_click_the_words_look_as_they_stay(report):
    assert report["words"]["shown"] > 200
    assert report["words"]["left"] < 50


def test_the_flow_can_be_hidden_in_another_mode_with_nothing_selected(report):
    assert report["flow"] == {"shown": "Monkey", "hidden": None}


def test_the_panel_says_that_a_run_was_cancelled(report):
    assert report["cancelled"]["before"].startswith("Computed the flow of Monkey")
    assert report["cancelled"]["after"] == "Cancelled; nothing was changed."


def test_texture_paint_mode_paints_on_the_new_image_from_then_on(report):
    painted = [old for old, _, _ in report["paint"]]
    assert painted == ["Coat", *(new for _, new, _ in report["paint"][:-1])]
    for old, new, words in report["paint"]:
        assert f"Sharpened the texture {old} on 1 object into {new}: " in words
