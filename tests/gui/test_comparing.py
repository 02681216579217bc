# SPDX-License-Identifier: GPL-3.0-or-later
"""Before and after in all modes: a key in previews, a button after runs."""

import pytest

pytestmark = pytest.mark.slow

MODES = {"SCULPT": "positions", "VERTEX_PAINT": "colors", "EDIT": "positions"}

in_each_mode = pytest.mark.parametrize(("mode", "changed"), MODES.items())


@pytest.fixture
def report(play):
    return play("comparing")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert "Traceback" not in report["output"]


@in_each_mode
def test_a_preview_is_seen_and_escape_brings_all_back(report, mode, changed):
    seen = report[mode]
    assert seen["dragged"][changed] != seen["start"][changed]
    assert seen["shown"] > 2000
    assert seen["dropped"] == seen["start"]
    assert seen["start"]["mode"] == mode
    assert seen["left"] < 1000  # the brush, and words


@in_each_mode
def test_the_key_shows_what_was_there_before_and_the_result_again(report, mode, changed):
    seen = report[mode]
    assert seen["before"][changed] == seen["start"][changed]
    assert seen["after"] == seen["dragged"]
    assert seen["said_before"] == "Before"
    assert "move mouse" in seen["said_after"]


@in_each_mode
def test_enter_applies_and_keeps_the_mode(report, mode, changed):
    seen = report[mode]
    assert seen["applied"][changed] != seen["start"][changed]
    assert (seen["applied"]["mode"], seen["applied"]["selected"]) == (
        mode,
        seen["start"]["selected"],
    )


@in_each_mode
def test_the_button_swaps_and_each_swap_is_one_step_of_undo(report, mode, changed):
    seen = report[mode]
    start, applied = seen["start"], seen["applied"]
    assert seen["clicked"] == [["before", start], ["after", applied]]
    assert seen["undone"] == [start, applied, start]


def test_undo_and_saving_end_a_preview_in_edit_mode(report):
    seen = report["ended_meanwhile"]
    assert seen["after"] == 2 * [[seen["start"], 0]]
