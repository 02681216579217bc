# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel of the last operator, the other modes of the 3D view, menus and search."""

import pytest


@pytest.fixture
def report(play):
    return play("editing")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert "Traceback" not in report["output"]


def test_dragging_a_number_after_the_run_filters_again(report):
    seen = report["redo_panel"]
    assert 1 <= seen["numbers"] < 8  # the others are folded
    assert seen["first"]["colors"] != report["start"]["colors"]
    assert 0.0 < seen["amount"] < 1.0
    assert seen["dragged"]["colors"] not in {
        seen["first"]["colors"],
        report["start"]["colors"],
    }
    assert seen["undone"] == report["start"]


def test_a_run_after_painting_is_repeated_and_undone_as_others_are(report):
    seen = report["painted"]
    assert seen["start"]["mode"] == "VERTEX_PAINT"
    assert seen["start"]["colors"] != report["start"]["colors"]
    assert len({seen[step]["colors"] for step in ("start", "first", "dragged")}) == 3
    assert seen["undone"] == seen["start"]
    step, painting = seen["undone_further"]
    assert step == seen["start"]
    assert painting == {**report["start"], "mode": "VERTEX_PAINT"}


def test_a_folded_section_opens_and_its_numbers_work(report):
    seen = report["section"]
    folded, unfolded = seen["numbers"]
    assert (folded, unfolded) == (1, 11)
    assert seen["radius"] != 5.0
    assert seen["dragged"]["positions"] not in {
        seen["first"]["positions"],
        report["start"]["positions"],
    }
    assert seen["undone"] == report["start"]


def test_operator_is_found_by_search(report):
    seen = report["search"]
    assert seen["last"] == "SHOCK_FILTER_OT_sharpen_geometry"
    assert seen["done"]["positions"] != report["start"]["positions"]
    assert seen["undone"] == report["start"]


@pytest.mark.parametrize(
    ("mode", "changed"),
    [("EDIT", "positions"), ("SCULPT", "positions"), ("VERTEX_PAINT", "colors")],
)
def test_mode_is_kept_and_undo_restores_exactly(report, mode, changed):
    seen = report[mode]
    assert seen["started"] == ["RUNNING_MODAL"]
    assert seen["start"]["mode"] == seen["done"]["mode"] == seen["undone"]["mode"]
    assert seen["done"][changed] != seen["start"][changed]
    assert seen["undone"] == seen["start"]
    assert seen["redone"] == seen["done"]


def test_menu_runs_the_operator(report):
    seen = report["menu"]
    assert seen["last"].startswith("SHOCK_FILTER_OT_")
    assert seen["done"]["colors"] != seen["start"]["colors"]


def test_preset_is_chosen_from_the_list(report):
    seen = report["preset"]
    assert seen["chosen"] != seen["start"]


def test_repeating_starts_from_the_replaced_pixels(report):
    seen = report["repeated"]
    assert seen["repeated"] == seen["twice"] != seen["once"]
