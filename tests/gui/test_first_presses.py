# SPDX-License-Identifier: GPL-3.0-or-later
"""After installing, each button works at once: nothing is compiled."""

import pytest

pytestmark = pytest.mark.slow

OPERATORS = [
    "sharpen_geometry",
    "denoise",
    "sharpen_colors",
    "sharpen_texture",
    "filter_texture",
    "stitch_textures",
    "dilate_texture",
    "sharpen_image",
    "denoise_image",
    "denoise_texture",
    "generate_distance",
    "generate_streaks",
    "generate_pattern",
    "generate_curvature",
    "generate_occlusion",
    "generate_thickness",
    "generate_wear",
]


@pytest.fixture
def report(play):
    return play("first_presses")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert "Traceback" not in report["output"]


@pytest.mark.parametrize("operator", OPERATORS)
def test_the_first_press_works_as_the_second_does(report, operator, capsys):
    first, second = report[operator]
    with capsys.disabled():
        print(f"\n{operator}: {first['seconds']:.2f} s at first, then {second['seconds']:.2f} s")
    assert first["result"] == second["result"] == ["FINISHED"]


def test_nothing_that_compiles_is_loaded(report):
    assert not report["numba"]
