# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender finds the extension's texts in each language, and only while it is enabled."""

import pytest


@pytest.fixture(scope="module")
def report(play):
    return play("words")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report.get("traceback")
    assert "Traceback" not in report["output"]


def test_blender_knows_all_languages(report):
    assert report["unknown"] == []


def test_no_text_stays_english(report):
    assert len(report["english"]) >= 3
    assert {language: texts for language, texts in report["english"].items() if texts} == {}


def test_disabling_takes_the_texts_back(report):
    assert report["switched"] == ["Geometrie schärfen", "Sharpen Geometry"] * 2
