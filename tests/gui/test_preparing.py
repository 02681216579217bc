# SPDX-License-Identifier: GPL-3.0-or-later
"""After installing, kernels are compiled by themselves, and first presses are quick.

Times are for machines with many things to do at once.
"""

import pytest

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
]


@pytest.fixture(scope="module")
def interrupted(preparing):
    return preparing["preparing_interrupted"]


@pytest.fixture(scope="module")
def report(preparing):
    return preparing["preparing"]


@pytest.mark.parametrize("name", ["preparing_interrupted", "preparing"])
def test_scenario_ran_to_its_end(preparing, name):
    report = preparing[name]
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert "Traceback" not in report["output"]


def test_it_begins_by_itself_and_ends_with_the_extension(interrupted):
    assert interrupted["began_by_itself"]
    assert interrupted["ended_by_disabling"]
    assert interrupted["began_again"]


def test_a_press_meanwhile_works(interrupted):
    assert interrupted["pressed"] == ["FINISHED"]


def test_it_goes_on_in_the_next_session_and_says_how_far_it_is(report, capsys):
    with capsys.disabled():
        print(f"\nprepared in {report['seconds']:.0f} s")
    assert report["began"]
    assert report["fractions"] == sorted(report["fractions"])


@pytest.mark.parametrize("operator", OPERATORS)
def test_the_first_press_compiles_nothing(report, operator, capsys):
    seen = report[operator]
    with capsys.disabled():
        print(f"\nfirst {operator}: {seen['seconds']:.2f} s")
    assert seen["result"] == ["FINISHED"]
    assert seen["compiled"] == []


def test_once_prepared_it_is_so_in_the_next_session(play, capsys):
    report = play("prepared")
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert report["fraction"] is None
    for operator in OPERATORS:
        with capsys.disabled():
            print(f"\n{operator} in the next session: {report[operator]['seconds']:.2f} s")
        assert report[operator]["compiled"] == []
