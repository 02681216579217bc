# SPDX-License-Identifier: GPL-3.0-or-later
"""Each text of the interface is there in each language, once, and says the same numbers.

Blender as a Python module is built without languages: that the texts are shown is tested in a real
Blender, by ``tests/gui/test_languages.py``.
"""

import ast
import functools
import importlib
import json
import re
import unicodedata
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
import shock_filter
from shock_filter import core
from shock_filter.shock_addon.ui import translations
from shock_filter.shock_addon.ui.shipped_presets import DEFAULTS, SHIPPED

ROOT = Path(shock_filter.__file__).parent
FILES = sorted((ROOT / "shock_addon" / "ui" / "locale").glob("*.json"))
WIDEST_NAME = 14
WORDS_OF_BLENDER = {"Vertex Group", "Sampling", "Mark Sharp"}
"""Names that Blender shows in its own words, however wide these are."""

SHOWN_ARGUMENTS = {
    "iface_": (0,),
    "pgettext_rpt": (0,),
    "Skipped": (0,),
    "describe": (1, 2),
    "counted": (1, 2),
    "report": (1,),
    "tell": (1,),
    "draw_link": (1,),
    "draw_text": (2,),
    "progress": (1,),
    "part": (2,),
}
"""Functions that look words up or hand them on to Blender, and in which arguments these are."""

SENTENCES = {"flow_operator.py", "jobs.py", "obstacles.py", "operators.py", "preview_operator.py"}
"""Files whose sentences are all shown."""

WORDS = {"panels.py", "sections.py"}
"""Files whose words are all shown."""

REASONS = {"chosen.py"}
"""Files whose reasons to skip something are all shown."""


def texts_of(rna):
    """List names and descriptions in a struct and in those that it points to."""
    for about in rna.properties:
        if about.is_hidden or about.identifier in bpy.types.PropertyGroup.bl_rna.properties:
            continue
        if about.type == "POINTER":
            yield from texts_of(about.fixed_type)
            continue
        if about.name != about.identifier:  # else nobody has named it, and nothing shows it
            yield about.name
        yield about.description
        for item in getattr(about, "enum_items", []):
            yield item.name
            yield item.description


def operators():
    names = dir(bpy.ops.shock_filter)
    return {name: getattr(bpy.ops.shock_filter, name).get_rna_type() for name in names}


def groups():
    """List what panels keep their settings in."""
    for owner in (bpy.types.Scene, bpy.types.WindowManager):
        for about in owner.bl_rna.properties:
            if about.identifier.startswith("shock_filter"):
                yield about.fixed_type


def texts_of_types():
    """List what Blender keeps of panels, menus, operators and properties."""
    for name in dir(bpy.types):
        cls = getattr(bpy.types, name)
        if name.startswith("SHOCK_FILTER_") and issubclass(cls, (bpy.types.Panel, bpy.types.Menu)):
            yield cls.bl_label
    for name, rna in operators().items():
        yield rna.name
        yield rna.description
        if not name.endswith("_preset_add"):  # its properties are Blender's
            yield from texts_of(rna)
    for group in groups():
        yield from texts_of(group)


def strings(node):
    """List the texts in a piece of code, but neither documentation nor parts of composed texts."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    documents = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    if not documents and not isinstance(node, ast.JoinedStr):
        for part in ast.iter_child_nodes(node):
            yield from strings(part)


def shown(call, named):
    """List the texts that a call shows, given the module's named texts."""
    function = getattr(call.func, "attr", getattr(call.func, "id", ""))
    for place, argument in enumerate(call.args):
        text = named.get(argument.id) if isinstance(argument, ast.Name) else argument
        shows = place in SHOWN_ARGUMENTS.get(function, ())
        if shows and isinstance(text, ast.Constant | ast.IfExp):
            yield from strings(text)
    for keyword in call.keywords:
        if keyword.arg in {"text", "heading"} and isinstance(keyword.value, ast.Constant):
            yield keyword.value.value


@functools.cache
def code():
    """Parse all files but those that talk to a terminal."""
    paths = [path for folder in ("core", "shock_addon") for path in (ROOT / folder).rglob("*.py")]
    return [
        (path, ast.parse(path.read_text(encoding="utf-8")))
        for path in paths
        if path.name not in {"cli.py", "command_line.py", "batch.py"}
    ]


def texts_of_code():
    """List what the code shows by itself: in panels, on buttons that are grey, during runs."""
    for path, tree in code():
        assigned = [node for node in tree.body if isinstance(node, ast.Assign)]
        named = {getattr(node.targets[0], "id", None): node.value for node in assigned}
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                yield from shown(node, named)
            if isinstance(node, ast.FunctionDef) and node.name in SHOWN_ARGUMENTS:
                for default in node.args.defaults:
                    yield from strings(default)
        if path.name in SENTENCES:
            yield from (text for text in strings(tree) if re.match("[A-Z].* .*[.]$", text))
        if path.name in REASONS:
            yield from (text for text in strings(tree) if re.match("it .*; ", text))
        if path.name in WORDS:
            yield from (text for text in strings(tree) if re.match("[A-Z][a-z]", text))


def texts_of_errors():
    """List what the core's errors say, if they carry values, which is for the add-on alone."""
    for path, tree in code():
        if "core" in path.relative_to(ROOT).parts:
            for node in ast.walk(tree):
                if isinstance(node, ast.Raise) and getattr(node.exc, "keywords", []):
                    yield from strings(node.exc.args[0])


def texts_of_presets():
    for presets in ([DEFAULTS], *SHIPPED.values()):
        for preset in presets:
            yield preset.name
            yield preset.reason


@pytest.fixture(scope="module")
def texts(addon):
    """Return all that is shown."""
    found = [*texts_of_types(), *texts_of_code(), *texts_of_errors(), *texts_of_presets()]
    return {text for text in found if re.search("[a-z]{2}", text)}


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
def test_no_text_is_missing(path, texts):
    missing = sorted(texts - set(read(path)))
    assert not missing, "\n".join(missing)


TRIANGLE, FACES = np.eye(3), [[0, 1, 2]]
FLAT = np.zeros((1, 3, 2))


def atlas(uv):
    return core.TextureAtlas(core.TriangleMesh(TRIANGLE, FACES), uv, 8, 8)


@pytest.mark.parametrize(
    "fail",
    [
        lambda: core.TriangleMesh(TRIANGLE * 1e200, FACES),
        lambda: core.TriangleMesh(TRIANGLE * np.nan, FACES),
        lambda: core.TriangleMesh(TRIANGLE, [[0, 1, 1]]),
        lambda: atlas(FLAT),
        lambda: atlas(FLAT + np.nan),
        lambda: atlas(FLAT + 1e7),
        lambda: atlas(TRIANGLE[None, :, :2] * 1e5),
        lambda: core.sharpen_image(np.full((4, 4), np.nan)),
        lambda: core.sharpen_image(np.ones((4, 4)), progress=lambda *_: False),
        lambda: core.GeometrySettings(fidelity=1.0, screening_radius=2.0),
        lambda: core.ShockSettings(scheme="composed", time=1e9),
        lambda: core.BeltramiSettings(window=4),
    ],
)
def test_errors_of_the_core_are_translated(fail):
    with pytest.raises(core.ShockError) as caught:
        fail()
    sentence = caught.value.sentence
    assert [path.stem for path in FILES if sentence not in read(path)] == [], sentence


@each_language
def test_no_text_is_there_that_nothing_shows(path, texts):
    used = texts.union(*(strings(tree) for _, tree in code()))
    stale = sorted(set(read(path)) - used)
    assert not stale, "\n".join(stale)


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
