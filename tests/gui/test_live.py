# SPDX-License-Identifier: GPL-3.0-or-later
"""Live results in a window."""

import statistics

import pytest

pytestmark = pytest.mark.slow


@pytest.fixture
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
        print(f"\nby hand: {seen['by_hand']:.2f} s")
        for part, name in ((slice(4), "by itself"), (slice(4, None), "out of sight")):
            seconds = ", ".join(f"{each:.2f}" for each in seen["seconds"][part])
            shown = ", ".join(f"{each:.2f}" for each in seen["shown"][part])
            print(f"{name}: {seconds} s, drawn: {shown} s")
    assert seen["noticed"] == "moved"
    assert set(seen["states"]) == {"fresh"}
    assert seen["after"]["positions"] != seen["before"]["positions"]


def test_keep_takes_what_the_field_shows_after_an_auto_update(report):
    shown, kept = report["followed"]["kept"]
    assert kept == pytest.approx(shown) and shown > 0.0


def test_keys_work_during_an_update_whose_result_waits_for_a_drag(report):
    seen = report["keys"]
    assert seen["dragged"] and seen["during"]
    assert seen["waited"] and seen["ended"]
    assert seen["followed"] and seen["state"] == "fresh"


def test_undo_and_redo_bring_back_each_state(report):
    seen = report["undone"]
    assert len(seen["undo"]) == len(seen["redo"]) == 20
    assert all(seen["undo"]) and all(seen["redo"])
    assert seen["groups"] == 1


def test_files_show_the_same_with_the_extension_and_without(report):
    seen = report["reopened"]
    assert seen["before"] == seen["enabled"] == seen["disabled"]
    assert not seen["is_known"]


def test_painting_shows_the_result(report, capsys):
    frames = {
        name: 1e3 * statistics.median(all_) for name, all_ in report["painted"]["frames"].items()
    }
    with capsys.disabled():
        print(f"\nms of a frame: {frames}")
    assert report["painted"]["moved"]["moved"] == 0 < report["painted"]["moved"]["out"]
    assert report["painted"]["moved"]["shown"]
    assert report["painted"]["mode"] == "PAINT_WEIGHT"
    assert report["painted"]["same"]
