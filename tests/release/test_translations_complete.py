# SPDX-License-Identifier: GPL-3.0-or-later
"""Each text of the interface is there in each language: asked for before a release only.

Between releases, sentences that change are shown in English.
"""

import ast
import functools
import json
import re
from pathlib import Path

import bpy
import numpy as np
import pytest
import shock_filter
from shock_filter import core
from shock_filter.shock_addon.modes import DEFAULTS, JOBS, MODES

ROOT = Path(shock_filter.__file__).parent
FILES = sorted((ROOT / "shock_addon" / "ui" / "locale").glob("*.json"))

SHOWN_ARGUMENTS = {
    "iface_": (0,),
    "pgettext_rpt": (0,),
    "Refused": (0,),
    "Skipped": (0,),
    "describe": (1, 2),
    "counted": (1, 2),
    "report": (1,),
    "tell": (1,),
    "draw_text": (2,),
    "progress": (1,),
    "part": (2,),
}
"""Functions that look words up or hand them on to Blender, and in which arguments these are."""

SENTENCES = {"operator.py", "comparing.py", "jobs.py", "poll.py", "base.py", "painting.py"}
"""Files whose sentences are all shown."""

WORDS = {"panels.py", "drawing.py"}
"""Files whose words are all shown."""

REASON = "(its?|no|nothing|there is|There is|Nothing,) [^;]*[;,] "
"""Beginning of a reason to skip something, with what to do, or of a remark, in all files."""


SHOWN_IN_CODE = ("job", "noisy", "_auto", "start_from", "streak_frames")
"""Ends of names of hidden properties, which panels show another way than Blender would."""


def texts_of(rna):
    """List names and descriptions in a struct and in those that it points to."""
    for about in rna.properties:
        is_left_out = about.is_hidden and not about.identifier.endswith(SHOWN_IN_CODE)
        if is_left_out or about.identifier in bpy.types.PropertyGroup.bl_rna.properties:
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
            yield from strings(keyword.value)


@functools.cache
def code():
    """Parse all files but those that talk to a terminal."""
    paths = [path for folder in ("core", "shock_addon") for path in (ROOT / folder).rglob("*.py")]
    return [
        (path, ast.parse(path.read_text(encoding="utf-8")))
        for path in paths
        if not {"cli", "commands", "batch.py"} & set(path.parts)
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
        if "shock_addon" in path.parts:
            yield from (text for text in strings(tree) if re.match(REASON, text))
        if path.name in WORDS:
            yield from (text for text in strings(tree) if re.match("[A-Z][a-z]", text))


def texts_of_errors():
    """List what the core's errors say, if they carry values, which is for the add-on alone."""
    for path, tree in code():
        if "core" in path.relative_to(ROOT).parts:
            for node in ast.walk(tree):
                if isinstance(node, ast.Raise) and getattr(node.exc, "keywords", []):
                    yield from strings(node.exc.args[0])


UNITS = "pixels", "texels", "edge lengths"
"""What stands for the one field of composed findings."""


def texts_of_findings():
    """List what the core reports of its runs, in files that tell or make them: whole sentences."""
    for path, tree in code():
        parts = path.relative_to(ROOT).parts
        imports = (node for node in tree.body if isinstance(node, ast.ImportFrom))
        names = {each.name for node in imports for each in node.names}
        if "core" in parts and names & {"tell", "Finding"}:
            raised = [node for node in ast.walk(tree) if isinstance(node, ast.Raise)]
            errors = {id(part) for node in raised for part in ast.walk(node)}
            for node in ast.walk(tree):
                if id(node) not in errors:
                    yield from (text for text in told(node) if re.match("[A-Z{].* .*[.]$", text))


def told(node):
    """List the texts that a composed one may be; a plain one comes from `strings`."""
    if isinstance(node, ast.JoinedStr):
        for unit in UNITS:
            parts = (p.value if isinstance(p, ast.Constant) else unit for p in node.values)
            yield "".join(parts)
    elif isinstance(node, ast.Call | ast.Dict | ast.IfExp):
        for part in ast.iter_child_nodes(node):
            if isinstance(part, ast.Constant):
                yield from strings(part)


def texts_of_modes():
    for job in (job for jobs in JOBS.values() for job in jobs):
        yield from (job.label, job.about, job.does)
    for mode in MODES:
        yield mode.part
        yield from (target.advice for target in mode.targets)
        yield from (mode.title, mode.done, mode.advice, mode.nothing, mode.changes, mode.announced)
        if mode.follows is not None:
            yield from (f"{mode.title}, then Sharpen", f"{mode.done} and sharpened")
        for preset in (DEFAULTS, *mode.presets):
            yield preset.name
            yield preset.reason


@pytest.fixture(scope="module")
def texts():
    """Return all that is shown."""
    bpy.ops.wm.read_homefile(use_empty=True)
    # In one run with the tests of the add-on it is there already, and they need it to the end.
    is_there = hasattr(bpy.types.Scene, "shock_filter")
    if not is_there:
        shock_filter.register()
    found = [*texts_of_types(), *texts_of_code(), *texts_of_errors(), *texts_of_modes()]
    found += texts_of_findings()
    if not is_there:
        shock_filter.unregister()
    return {text for text in found if re.search("[a-z]{2}", text)}


def read(path):
    return json.loads(path.read_text(encoding="utf-8"))


def each_language(test):
    return pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)(test)


@each_language
def test_no_text_is_missing(path, texts):
    missing = sorted(texts - set(read(path)))
    assert not missing, "\n".join(missing)


TRIANGLE, FACES = np.eye(3), [[0, 1, 2]]
FLAT = np.zeros((1, 3, 2))


def atlas(uv):
    return core.TextureAtlas(core.TriangleMesh(TRIANGLE, FACES), uv, size=(8, 8))


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
