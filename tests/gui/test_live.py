# SPDX-License-Identifier: GPL-3.0-or-later
"""Live results in a window."""

import pytest


@pytest.fixture(scope="module")
def report(play):
    return play("live")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert "Traceback" not in report["output"]


def test_a_copy_is_made(report):
    seen = report["made"]
    assert seen["state"] == "fresh"
    assert seen["modifiers"] == ["Shock Filter"]
    assert seen["vertices"] > 40_000


def test_the_copy_follows_its_source(report, capsys):
    seen = report["followed"]
    with capsys.disabled():
        print(f"\nby hand: {seen['by_hand']:.1f} s; by itself: {min(seen['seconds']):.1f} s")
    assert seen["noticed"] == "moved"
    assert seen["after"]["positions"] != seen["before"]["positions"]


def test_undo_and_redo_bring_back_each_state(report):
    seen = report["undone"]
    assert all(seen["undo"]) and all(seen["redo"])
    assert seen["groups"] == 1


def test_painting_shows_the_result(report):
    assert report["painted"]["mode"] == "PAINT_WEIGHT"
    assert report["painted"]["same"]
