# SPDX-License-Identifier: GPL-3.0-or-later
"""Flows move on the model and in the Image Editor; Esc leaves nothing, and undo takes them back."""

import pytest

pytestmark = pytest.mark.slow

COUNT = 8


@pytest.fixture
def report(play):
    return play("flowing")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report.get("traceback")
    assert "Traceback" not in report["output"]


def test_the_flow_of_creases_moves_on_the_model(report):
    seen = report["model"]
    assert seen["said"].startswith("Showed the flow in Monkey Flow: 8 frames of 512 x 512 pixels")
    assert seen["files"] == [f"frame_{number:04}.png" for number in range(1, COUNT + 1)]
    assert seen["images"]["Monkey Flow"] == "SEQUENCE"
    assert min(seen["moved"]) > 1000


def test_undo_takes_the_image_back_and_keeps_the_files(report):
    assert "Monkey Flow" not in report["model"]["undone"]
    assert report["model"]["kept"] == COUNT


def test_esc_leaves_nothing(report):
    assert report["stopped"] == {"running": True, "left": [], "same": True}


def test_a_flow_map_moves_in_the_image_editor(report):
    seen = report["map"]
    assert seen["shown"] == ["River Flow", "SEQUENCE"]
    assert seen["said"].endswith("Press Space to play it.")
    assert min(seen["moved"]) > 1000


def test_the_button_works_on_the_map_again_while_its_flow_is_shown(report):
    assert "4 frames of 128 x 128 pixels" in report["map"]["said_again"]
