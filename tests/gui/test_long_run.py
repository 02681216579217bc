# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh of a million vertices. Times are shares of the run's own: other work slows both alike."""

import pytest

LONGEST_GAP = 0.3
"""Of the run, in which the window may answer nothing; on two quiet cores 0.03."""

LONGEST_CANCEL = 0.5
"""Of the run, until one that was to take 30 times as long has ended; on two quiet cores 0.05."""


@pytest.fixture
def report(play):
    return play("long_run")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert "Traceback" not in report["output"]


def test_window_stays_alive(report, capsys):
    with capsys.disabled():
        print(
            f"\n1,000,000 vertices: start {report['start_seconds']:.2f} s,"
            f" run {report['seconds']:.1f} s, longest gap {report['gaps'][-1]:.2f} s,"
            f" writing {report['end_seconds']:.2f} s"
        )
    assert report["vertices"] == 1_000_000
    assert report["started"] == ["RUNNING_MODAL"]
    assert report["ticks"] > 10
    assert report["gaps"][-1] < LONGEST_GAP * report["seconds"]


def test_run_changes_the_mesh_and_undo_restores_it_exactly(report):
    assert report["done"] != report["start"]
    assert report["undone"] == report["start"]


@pytest.mark.parametrize("number", range(4))
def test_cancelled_run_changes_nothing(report, number, capsys):
    seen = report["cancelled"][number]
    with capsys.disabled():
        print(
            f"\n{seen['how']} after {seen['after']} s: cancelled in {seen['seconds']:.2f} s,"
            f" thread ended in {seen['thread_seconds']:.2f} s"
        )
    assert seen["was_running"]
    assert seen["positions"] == report["start"]
    assert seen["seconds"] < LONGEST_CANCEL * report["seconds"]
    assert seen["thread_seconds"] < LONGEST_CANCEL * report["seconds"]
