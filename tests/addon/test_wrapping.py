# SPDX-License-Identifier: GPL-3.0-or-later
# ruff: noqa: RUF001
"""Sentences in panels are broken into lines, in each language."""

import textwrap
from types import SimpleNamespace

import pytest
from shock_filter.shock_addon.operators.wrapping import fit, wrap

ENGLISH = "The mesh has no colors; paint some in Vertex Paint Mode."
JAPANESE = "メッシュにカラーがありません。頂点ペイントモードでペイントしてください。"
CHINESE = "请在编辑模式下展开网格（UV > 展开）：它没有 UV 贴图。"


@pytest.mark.parametrize("letters", [16, 25, 34, 80])
def test_words_are_wrapped_as_everywhere(letters):
    assert wrap(ENGLISH, letters) == textwrap.wrap(ENGLISH, letters)


@pytest.mark.parametrize("text", [JAPANESE, CHINESE])
@pytest.mark.parametrize("letters", [16, 21, 34])
def test_wide_letters_fill_lines_and_none_gets_lost(text, letters):
    lines = wrap(text, letters)
    assert "".join(lines).replace(" ", "") == text.replace(" ", "")
    assert all(len(line) <= letters for line in lines)
    wide = [sum(1.6 if ord(letter) > 0x2E80 else 1 for letter in line) for line in lines]
    assert all(width <= letters + 2 for width in wide)  # a closing mark may hang out
    assert all(width >= letters - 8 for width in wide[:-1])
    assert not any(line.startswith(tuple("、。：）")) for line in lines)


def test_a_word_that_is_longer_than_the_line_has_a_line_of_its_own():
    assert wrap("The file unusually_long_name.png is gone.", 16) == [
        "The file", "unusually_long_name.png", "is gone.",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("choices", "fits"),
    [
        (["Denoise", "Geometry", "Colors", "Texture"], False),
        (["Sharpen", "Detail", "Stitch", "Dilate"], True),
        (["Entrauschen", "Geometrie", "Farben", "Textur"], False),
        (["Geometrie", "Farben", "Beides"], True),
        (["Geometrie", "Farben", "Textur", "Bild"], False),
        (["Entrauschen", "Bild", "Textur"], True),
        (["デノイズ", "ジオメトリ", "色", "テクスチャ"], False),
    ],
)
def test_choices_that_blender_would_cut_at_the_default_width_do_not_fit(choices, fits):
    system = SimpleNamespace(ui_scale=1.0)
    context = SimpleNamespace(
        preferences=SimpleNamespace(system=system), region=SimpleNamespace(width=280)
    )
    assert fit(context, choices) == fits
    system.ui_scale = 2.0
    context.region.width = 560
    assert fit(context, choices) == fits


def test_nothing_is_nothing():
    assert wrap("", 16) == [""]


@pytest.mark.parametrize("text", ["It took about 0.4 s.", "12 s, and 30 s more", "約 0.4 s。"])
def test_seconds_stay_beside_their_number(text):
    for letters in range(8, len(text) + 1):
        lines = wrap(text, letters)
        assert "".join(lines).replace(" ", "") == text.replace(" ", "")
        assert not any(line.startswith("s") for line in lines)
