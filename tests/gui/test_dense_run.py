# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh of 1.8 million vertices at the defaults. Times are printed: other work changes them."""

import pytest

pytestmark = pytest.mark.slow


@pytest.fixture
def report(play):
    return play("dense_run")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert "Traceback" not in report["output"]
    assert report["vertices"] > 1_800_000


@pytest.mark.parametrize("name", ["sharpen_geometry", "denoise"])
def test_the_window_answers_during_a_run(report, name, capsys):
    seen = report[name]
    with capsys.disabled():
        print(f"\n{name}: {seen['seconds']:.1f} s, of these {seen['start_seconds']:.2f} s for")
        print(f"the press and {seen['end_seconds']:.2f} s for writing; longest gaps:")
        for seconds, message in reversed(seen["gaps"]):
            print(f"  {seconds:.2f} s, {message}")
    assert seen["gaps"][-1][0] < 0.1 * seen["seconds"]
    assert seen["done"] != report["start"] == seen["undone"]


@pytest.mark.parametrize("name", ["sharpen_geometry", "denoise"])
def test_escape_ends_a_run(report, name, capsys):
    for seen in report[name]["cancelled"]:
        with capsys.disabled():
            print(f"\n{name}, Esc after {seen['after']} s: {seen['seconds']:.2f} s,"
                  f" thread {seen['thread_seconds']:.2f} s")  # fmt: skip
        assert seen["was_running"]
        assert seen["positions"] == report["start"]
        assert seen["seconds"] < 0.1 * report[name]["seconds"]
