# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension speaks the language that Blender is set to, while it is enabled."""

import pytest


@pytest.fixture
def report(play):
    return play("languages")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert "Traceback" not in report["output"]


def test_blender_knows_all_languages(report):
    assert report["unknown"] == []


def test_no_text_stays_english(report):
    assert len(report["english"]) >= 3
    assert {language: texts for language, texts in report["english"].items() if texts} == {}


def test_blender_has_no_words_of_its_own_where_ours_are_wanted(report):
    assert report["foreign"] == []


@pytest.mark.parametrize("language", ["de_DE", "ja_JP", "zh_HANS"])
def test_tab_is_translated(report, language):
    assert report["changed_pixels"][language] > 300


def test_english_comes_back(report):
    assert report["left_pixels"] == 0


def test_disabling_takes_the_texts_back(report):
    assert report["switched"] == ["Geometrie schärfen", "Sharpen Geometry"] * 2
