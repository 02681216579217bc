# SPDX-License-Identifier: GPL-3.0-or-later
"""The main button keeps its place in all modes."""

import pytest

pytestmark = pytest.mark.slow


@pytest.fixture
def report(play):
    return play("rows")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert "Traceback" not in report["output"]


def test_own_panels_open_by_a_click(report):
    assert report["generate"] >= 2  # Generate and Preview
    assert report["flow"] >= 1


def test_the_main_button_has_one_place_in_all_modes(report):
    places = list(report["tops"].values())
    assert len(places) > 5
    for bottom, top in places:
        assert abs(bottom - places[0][0]) <= 1
        assert abs(top - places[0][1]) <= 1
