# SPDX-License-Identifier: GPL-3.0-or-later
"""An operator that raises in a window leaves nothing behind, and can be used again."""

import pytest

WORDS = "ZeroDivisionError: raised on purpose"


@pytest.fixture
def report(play):
    return play("failing")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert report["output"].count("Traceback") == report["output"].count(WORDS) >= 2


def test_a_run_whose_operator_raises_is_forgotten(report):
    seen = report["run"]
    assert seen["raised"] == 1
    assert seen["freed"] == [True]
    assert seen["waits"] == 0
    assert seen["again"] == ["RUNNING_MODAL"]
    assert seen["shown"] == [None, "Monkey"]


def test_a_preview_whose_operator_raises_brings_the_old_shape_back(report):
    seen = report["preview"]
    assert seen["shown"] != report["start"]
    assert seen["kept"] == report["start"]
    assert seen["running"] == [False, 0]
    assert seen["freed"]
    assert seen["again"] == ["RUNNING_MODAL"]
    assert seen["running_again"]
    assert seen["ended"]
