# SPDX-License-Identifier: GPL-3.0-or-later
"""The gain of a texture's detail is dragged by the mouse, and painted on the model."""

import pytest

pytestmark = pytest.mark.slow

SIDES = "1024", "2048"


@pytest.fixture
def report(play):
    return play("detail")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report.get("traceback")
    assert "Traceback" not in report["output"]


@pytest.mark.parametrize("side", SIDES)
def test_the_model_follows_the_mouse(report, side, capsys):
    seen = report[side]
    with capsys.disabled():
        print(f"\ngain at {side}: " + ", ".join(f"{each:.2f} s" for each in seen["seconds"]))
    assert sorted(set(seen["gains"])) == seen["gains"]
    assert seen["kept"]


def test_the_model_shows_what_is_painted(report):
    seen = report["painted"]
    assert (seen["began"], seen["mode"]) == (["FINISHED"], "PAINT_TEXTURE")
    assert seen["map"] == "Coat gain"
    assert seen["starts_as_it_is"]
    assert seen["map_painted"]
    assert seen["changed"] > 200
    assert seen["turned"] > 200


def test_the_model_shows_each_stroke_after_its_end(report, capsys):
    seconds = report["painted"]["seconds"]
    assert seconds
    with capsys.disabled():
        print("\nstrokes at 1024: " + ", ".join(f"{each:.2f} s" for each in seconds))


def test_undo_takes_the_stroke_back_and_painting_goes_on(report):
    assert report["painted"]["undone"]
    assert report["painted"]["is_running"]


def test_a_run_ends_it_and_leaves_nothing_behind(report):
    seen = report["painted"]
    assert seen["ended"]
    assert seen["shown"] == "Coat filtered"
    assert seen["kept"]
    assert seen["used"] == []
    assert seen["left"] == 0


def test_workbench_shows_the_result_over_the_object(report):
    seen = report["solid"]
    assert (seen["began"], seen["shading"]) == (["FINISHED"], ["SOLID", "TEXTURE"])
    assert seen["gray"] > 30.0  # the colors of the texture, not those of the map
    assert seen["changed"] > 200
    assert seen["ended"]
