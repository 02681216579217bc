# SPDX-License-Identifier: GPL-3.0-or-later
"""What is there in other languages says the same numbers and fits; the rest is shown in English.

Blender as a Python module is built without languages: that the texts are shown is tested in a real
Blender, by ``tests/gui/test_languages.py``. That no text is missing is asked for before a release,
by ``tests/release``.
"""

import importlib
import json
import re
import unicodedata
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest
import shock_filter
from shock_filter.shock_addon.ui import translations

ROOT = Path(shock_filter.__file__).parent
FILES = sorted((ROOT / "shock_addon" / "ui" / "locale").glob("*.json"))
WIDEST_NAME = 14
WORDS_OF_BLENDER = {"Vertex Group", "Sampling", "Mark Sharp"}
"""Names that Blender shows in its own words, however wide these are."""


def groups():
    """List what panels keep their settings in."""
    for owner in (bpy.types.Scene, bpy.types.WindowManager):
        for about in owner.bl_rna.properties:
            if about.identifier.startswith("shock_filter"):
                yield about.fixed_type


def read(path):
    """Read a language, or fail if it has an entry twice."""
    pairs = json.loads(path.read_text(encoding="utf-8"), object_pairs_hook=list)
    names = [name for name, _ in pairs]
    assert len(set(names)) == len(names), {name for name in names if names.count(name) > 1}
    return dict(pairs)


def each_language(test):
    return pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)(test)


def test_languages_are_those_that_blender_knows():
    module = "bl_i18n_utils" if bpy.app.version < (5, 0) else "_bl_i18n_utils"
    known = {code for _, _, code in importlib.import_module(f"{module}.settings").LANGUAGES}
    assert {path.stem for path in FILES} <= known
    assert {path.stem for path in FILES} >= {"de_DE", "ja_JP", "zh_HANS"}


@each_language
def test_placeholders_and_numbers_agree(path):
    for english, text in read(path).items():
        place = r"\{[^}]*\}|%[sdr]"
        assert sorted(re.findall(place, text)) == sorted(re.findall(place, english)), text
        number = r"\d+(?:[.,]\d+)?"
        numbers = {found.replace(",", ".") for found in re.findall(number, text)}
        assert {found.replace(",", ".") for found in re.findall(number, english)} <= numbers, text


@each_language
def test_sentences_end_as_in_english(path):
    """Blender adds the last period of tooltips."""
    for english, text in read(path).items():
        assert text.strip() == text != ""
        assert text.endswith((".", "。")) == english.endswith("."), text


SWITCHES = {"then_sharpen", "mark_sharp"}
"""Checkboxes before a value; the words of all others stand behind the box and have more room."""


def width(text):
    return sum(2 if unicodedata.east_asian_width(letter) in "WF" else 1 for letter in text)


@each_language
def test_names_of_properties_fit_into_the_sidebar(path):
    names = {
        about.name
        for group in groups()
        for mode in group.properties
        if mode.type == "POINTER"
        for about in mode.fixed_type.properties
        if about.type != "BOOLEAN" or about.identifier in SWITCHES
    } - WORDS_OF_BLENDER
    said = read(path)
    wide = [said[name] for name in names & set(said) if width(said[name]) > WIDEST_NAME]
    assert not wide, "\n".join(wide)


def test_texts_have_the_same_order_in_all_languages():
    assert len({tuple(read(path)) for path in FILES}) == 1


def test_blender_finds_words_on_buttons_and_all_others():
    for path in FILES:
        table = translations.table(path.stem)
        for english, text in read(path).items():
            assert table["*", english] == table["Operator", english] == text


def test_the_choice_of_creases_has_the_word_of_the_buttons_in_each_language():
    """Blender has a word of its own for Creases, such as Falte/Rille, which the context avoids."""
    where = bpy.context.scene.shock_filter.geometry.bl_rna.properties["where"]
    assert "Creases" in [item.name for item in where.enum_items]
    assert where.translation_context not in {"*", "Operator"}
    for path in FILES:
        word = translations.table(path.stem)[where.translation_context, "Creases"]
        assert word.lower() in read(path)["Show Creases"].lower()


def test_only_the_language_in_use_is_handed_over(monkeypatch):
    tables = {}
    fake = SimpleNamespace(
        locale="en_US",
        contexts=bpy.app.translations.contexts,
        register=lambda name, texts: tables.update({name: texts}),
        unregister=tables.pop,
    )
    app = SimpleNamespace(translations=fake, handlers=bpy.app.handlers)
    monkeypatch.setattr(translations, "bpy", SimpleNamespace(app=app))
    tables[translations.__package__] = {}
    bpy.ops.wm.read_homefile(use_empty=True)  # drops handlers that are not persistent
    handlers = bpy.app.handlers.translation_update_post
    (changed,) = [each for each in handlers if each.__module__ == translations.__name__]
    for language, some in (("de_DE", True), ("en_US", False), ("ja_JP", True)):
        fake.locale = language
        changed(None, None)
        ((handed,),) = [list(texts.items()) for texts in tables.values()]
        assert handed == (language, translations.table(language))
        assert bool(handed[1]) == some
