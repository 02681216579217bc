# SPDX-License-Identifier: GPL-3.0-or-later
"""What can be done with a filter is declared in its row and its settings, and nowhere else.

A program must not decide by a settings class, by whether settings have a field of some name, or by
words that are for people: a new filter would have to be added there.
"""

import ast
from pathlib import Path

import pytest
from shock_filter import core
from shock_filter.core import registry
from shock_filter.core.settings import describe

ROOT = Path(core.__file__).resolve().parents[1]
PROGRAMS = ("core/cli", "core/files", "core/host", "core/preview", "core/rehearsal", "shock_addon")
"""What works with any filter; the filters themselves know their settings."""

WORDS = {"advice", "description", "done", "label", "title", "tooltip", "unit"}
"""Attributes that hold words for people."""

SETTINGS = {"kernel", "settings", "sharpening"}
"""Names of variables that hold settings."""

LOOK_UPS = {"endswith", "get", "index", "startswith"}


def name_of(node):
    return getattr(node, "id", getattr(node, "attr", ""))


def classes_in(node):
    """List the names of settings classes in an expression; all derive from `_Settings`."""
    names = {name_of(part) for part in ast.walk(node)}
    return {name for name in names if name.endswith("Settings")} - {"_Settings"}


def has_words(node):
    return isinstance(node, ast.Attribute) and node.attr in WORDS


def is_text(node):
    return isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value != ""


def complaints_of_call(node, of_program):
    name, words = name_of(node.func), node.args
    if name in ("isinstance", "issubclass") and classes_in(words[1]):
        yield "the class of settings"
    # With two words `getattr` wants the field to be there.
    asks = (name == "hasattr") or (name == "getattr" and len(words) == 3)
    if of_program and asks and name_of(words[0]) in SETTINGS and is_text(words[1]):
        yield "whether settings have a field"
    if name in LOOK_UPS and any(map(has_words, (*words, getattr(node.func, "value", None)))):
        yield "words for people"


def complaints_of_comparison(node, of_program):
    sides = [node.left, *node.comparators]
    if any(map(has_words, sides)) and any(is_text(s) or isinstance(s, ast.Name) for s in sides):
        yield "words for people"
    is_same = isinstance(node.ops[0], ast.Is | ast.IsNot | ast.Eq | ast.NotEq)
    if is_same and any(classes_in(s) and not isinstance(s, ast.Call) for s in sides):
        yield "the class of settings"
    described = [name_of(s.func) == "describe" for s in sides if isinstance(s, ast.Call)]
    if of_program and is_text(node.left) and any(described):
        yield "whether settings have a field"


def complaints(code, of_program):
    """List what a source decides by, with the lines where it does."""
    found = []
    for node in ast.walk(ast.parse(code)):
        said = []
        if isinstance(node, ast.Call):
            said = complaints_of_call(node, of_program)
        elif isinstance(node, ast.Compare):
            said = complaints_of_comparison(node, of_program)
        elif isinstance(node, ast.Subscript) and has_words(node.slice):
            said = ["words for people"]
        found += [(node.lineno, each) for each in said]
    return found


SOURCES = sorted([*ROOT.glob("core/**/*.py"), *ROOT.glob("shock_addon/**/*.py")])


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_nothing_decides_by_classes_names_or_words(path):
    name = path.relative_to(ROOT).as_posix()
    found = complaints(path.read_text(encoding="utf-8"), name.startswith(PROGRAMS))
    assert not found, "declare it: a field of `Setting` (core/settings.py) or of the filter's row"


@pytest.mark.parametrize(
    "code",
    [
        "isinstance(settings, GeometrySettings)",
        "isinstance(kernel, settings.FilterSettings | settings.StitchSettings)",
        "issubclass(row.settings, (A, DilateSettings))",
        "row.settings is ShockSettings",
        "type(settings) == core.ImageSettings",
        "hasattr(settings, 'steps')",
        "getattr(kernel, 'alpha', 'auto')",
        "'steps' in describe(settings)",
        "about.unit == 'mean texel sizes on the surface'",
        "about.unit == _TEXELS",
        "'texel' in about.description",
        "{'Denoised': 1}.get(mode.done)",
        "words[mode.label]",
        "mode.title.startswith('Denoise')",
    ],
)
def test_a_source_that_decides_so_is_found(code):
    assert complaints(code, True)


@pytest.mark.parametrize(
    "settings", sorted({row.settings for row in registry.FILTERS}, key=lambda each: each.__name__)
)
def test_units_say_in_what_lengths_are_declared_to_count(settings):
    words = {"edges": "edge length", "faces": "edge length", "texels": "texel", "pixels": "pixel"}
    for name, (_, _, about) in describe(settings).items():
        assert about.counts_in in ("", *words), name
        assert not about.counts_in or about.length_power, name
        if about.counts_in:
            assert words[about.counts_in] in about.unit, name
        if about.length_power and not about.counts_in:
            assert about.unit == "units of the mesh", name
        for value in (*about.rehearsed, about.brief):
            if value is not None:
                settings(**{name: value})


def test_a_role_is_given_once():
    for row in registry.FILTERS:
        roles = [about.role for _, _, about in describe(row.settings).values() if about.role]
        assert len(roles) == len(set(roles)), row.name
        assert not row.takes_gain or "gain" in roles
