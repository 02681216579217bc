# SPDX-License-Identifier: GPL-3.0-or-later
"""Image Editors show results, and what they were made from while these are undone."""

import pytest

pytestmark = pytest.mark.slow

OPERATORS = {
    "sharpen_image": ("Photo", "Photo sharpened"),
    "denoise_image": ("Photo", "Photo denoised"),
    "sharpen_texture": ("Coat", "Coat sharpened"),
    "dilate_texture": ("Coat", "Coat dilated"),
}


@pytest.fixture
def report(play):
    return play("showing")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert "Traceback" not in report["output"]


@pytest.mark.parametrize("operator", OPERATORS)
def test_editors_show_the_result_and_while_it_is_undone_its_source(report, operator):
    source, result = OPERATORS[operator]
    assert report[operator] == {
        "run": [result, source],
        "adjusted": [result, source],
        "both adjusted": [result, result],
        "both undone": [source, source],
        "both redone": [result, result],
        "undone": [source, "Other"],
        "redone": [result, "Other"],
        "left alone": ["Other", "Other"],
    }


def test_old_and_new_images_are_there_when_the_file_is_opened_again(report):
    made = report["saved"]["made"]
    assert len(set(made)) == 4
    assert set(made) <= set(report["saved"]["there"])


def test_so_they_do_step_by_step_after_several_runs(report):
    first, second = "Photo sharpened", "Photo sharpened denoised"
    assert report["twice"] == {
        "run": [second, "Photo"],
        "undone": [first, "Photo"],
        "undone twice": ["Photo", "Photo"],
        "redone": [first, "Photo"],
        "redone twice": [second, "Photo"],
    }
