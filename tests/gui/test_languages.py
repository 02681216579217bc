# SPDX-License-Identifier: GPL-3.0-or-later
"""The tab speaks the language that Blender is set to."""

import pytest


@pytest.fixture(scope="module")
def report(play):
    return play("languages")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report.get("traceback")
    assert "Traceback" not in report["output"]


@pytest.mark.parametrize("language", ["de", "ja", "zh_HANS"])
def test_tab_is_translated(report, language):
    assert report[language]["label"] != "Sharpen Geometry"
    assert report[language]["changed_pixels"] > 300


def test_english_comes_back(report):
    assert report["left_pixels"] == 0
