# SPDX-License-Identifier: GPL-3.0-or-later
"""Show Flow and Preview show something, and leave nothing behind."""

import pytest

pytestmark = pytest.mark.slow


@pytest.fixture
def report(play):
    return play("seeing")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert "Traceback" not in report["output"]


@pytest.mark.parametrize("mode", ["geometry", "colors"])
def test_flow_is_drawn_and_hidden_again(report, mode):
    seen = report[f"flow_{mode}"]
    assert seen["buttons"] == (5 if mode == "geometry" else 2)
    assert seen["attributes"] == []
    assert seen["shown"] == ["Monkey", None, "Monkey"]
    shown, hidden, shown_again = seen["pixels"]
    assert shown > 5000
    assert hidden < 500
    assert shown_again == pytest.approx(shown, rel=0.1)


@pytest.mark.parametrize(
    ("mode", "changed"), [("geometry", "positions"), ("colors", "colors"), ("denoise", "positions")]
)
def test_preview_changes_what_is_seen_and_escape_restores_it_exactly(report, mode, changed):
    seen = report[f"preview_{mode}"]
    assert seen["dragged"][changed] != report["start"][changed]
    assert seen["dropped"] == report["start"]


@pytest.mark.parametrize("mode", ["geometry", "colors", "denoise"])
def test_the_way_from_the_button_to_the_model_changes_no_value(report, mode):
    seen = report[f"preview_{mode}"]
    assert seen["values_at_the_model"] == seen["start_values"]
    assert seen["values_dragged"][0] > 1.2 * seen["start_values"][0]
    assert ("in the middle of the view" in seen["said"]) == (mode == "denoise")


def test_what_a_script_changes_meanwhile_ends_it_and_stays(report):
    seen = report["script"]
    assert seen["values"] == [65536.0, 1.0]
    assert seen["running"] == 0
    assert seen["kept"] == [0.0, 0.0, 3.0]
    assert seen["back"]


@pytest.mark.parametrize(
    ("mode", "changed"), [("geometry", "positions"), ("colors", "colors"), ("denoise", "positions")]
)
def test_preview_is_applied_as_one_run_of_the_operator(report, mode, changed):
    seen = report[f"preview_{mode}"]
    assert seen["started"] == ["RUNNING_MODAL"]
    before, after = seen["dial"]
    assert after > before
    assert seen["last"].startswith("SHOCK_FILTER_OT_")
    assert seen["applied"][changed] != report["start"][changed]
    assert seen["undone"] == report["start"]


def test_new_file_ends_both(report):
    assert report["new_file"]["shown"] is None
    assert "Monkey" not in report["new_file"]["objects"]
