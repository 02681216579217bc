# SPDX-License-Identifier: GPL-3.0-or-later
"""The way from a button to its filter is the one that docs/developing.md draws."""

import ast
import re
import sys
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest
import shock_filter
from shock_filter.core import registry
from shock_filter.core.errors import Cancelled
from shock_filter.core.shape import sharpening
from shock_filter.shock_addon import kinds
from shock_filter.shock_addon.modes import find
from shock_filter.shock_addon.operators import base
from shock_filter.shock_addon.operators.filtering import operator_of
from shock_filter.shock_addon.operators.meshes import MeshOperator
from shock_filter.shock_addon.running import jobs

ROOT = Path(shock_filter.__file__).parent
MOST = 10
ROW = re.compile(r"^\| (\d+) \| `([\w/.]+)` \| `([\w.]+)`.*? \| (?:`([\w.]+)`)? ?\|$", re.MULTILINE)


def drawn():
    """Read the table: number, file, function, and the words that lead on."""
    page = (ROOT / "docs" / "developing.md").read_text(encoding="utf-8")
    table = page.partition("<!-- begin press -->")[2].partition("<!-- end press -->")[0]
    hops = ROW.findall(table)
    assert len(hops) == len(table.strip().splitlines()) - 2  # without the head
    return hops


HOPS = drawn()
PAIRS = list(pairwise(HOPS))


def source_of(file, name):
    """Return the syntax tree of a function or class."""
    found = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    for part in name.split("."):
        found = next(node for node in found.body if getattr(node, "name", "") == part)
    return found


def mentions(node, words):
    """Whether code says these words, as a name or an attribute."""
    shown = [
        ast.unparse(part) for part in ast.walk(node) if isinstance(part, ast.Attribute | ast.Name)
    ]
    imported = [part.name for part in ast.walk(node) if isinstance(part, ast.alias)]
    return words in [*shown, *imported]


def test_the_way_is_short():
    assert [int(number) for number, *_ in HOPS] == list(range(len(HOPS)))
    assert len(PAIRS) <= MOST
    assert HOPS[0][2] == "draw_filter" and HOPS[-1][2] == "sharpen_geometry"


@pytest.mark.parametrize("hop", HOPS, ids=lambda hop: f"{hop[0]}-{hop[2]}")
def test_each_function_is_there_and_says_what_leads_on(hop):
    _, file, name, words = hop
    node = source_of(file, name)
    assert not words or mentions(node, words), f"{name} in {file} does not say {words}"


IN_ROWS = {
    "self.kind.filter": lambda: kinds.DATA["geometry"].filter,
    "row.function": lambda: registry.Filter.function,
    "load": lambda: registry.find("sharpen_geometry").load,
    "task.run": lambda: base.Task.run,
}
"""What is an attribute of a row or of an object."""


@pytest.mark.parametrize("pair", PAIRS, ids=lambda pair: f"{pair[0][0]}-{pair[1][0]}")
def test_the_words_are_the_name_of_the_next_function(pair):
    (_, _, _, words), (_, file, name, _) = pair
    if words in IN_ROWS:
        function = IN_ROWS[words]()
        assert function.__qualname__ == name
        assert Path(function.__code__.co_filename) == ROOT / file
    else:
        assert words == name.partition(".")[0]


def test_the_class_that_is_made_is_called_as_drawn():
    cls = operator_of(find("geometry"))
    (invoke,) = [hop for hop in HOPS if hop[2].endswith(".invoke")]
    assert cls.invoke.__qualname__ == invoke[2]
    assert cls.__bases__[0].__qualname__ in [hop[2] for hop in HOPS]


class Pressed(MeshOperator):
    """The operator with the panel's settings; Blender alone can make the real one."""

    row = find("geometry")

    def __init__(self, settings):
        vars(self).update({name: getattr(settings, name) for name in self.row.names})
        self.works = []

    def run_job(self, context, work):
        self.works.append(work)
        return {"RUNNING_MODAL"}


@pytest.fixture
def pressed(rounded_box, monkeypatch):
    """Press the button; return what is then computed on a thread."""
    rounded_box()
    operator = Pressed(bpy.context.scene.shock_filter.geometry)
    in_window = SimpleNamespace(app=SimpleNamespace(background=False))
    monkeypatch.setattr(base, "bpy", in_window)
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        assert operator.invoke(bpy.context, None) == {"RUNNING_MODAL"}
    (work,) = operator.works
    return work


def test_a_press_goes_this_way_and_no_other(pressed, monkeypatch):
    seen = []

    def look(*_, **__):
        frame = sys._getframe(1)
        while frame is not None:
            seen.append((Path(frame.f_code.co_filename), frame.f_code.co_qualname))
            frame = frame.f_back
        raise Cancelled("Enough was seen.")

    monkeypatch.setattr(sharpening, "sharpen_geometry", look)
    with pytest.raises(Cancelled):
        jobs.Job(pressed).result()
    way = [
        (file.relative_to(ROOT).as_posix(), name)
        for file, name in reversed(seen)
        if file.is_relative_to(ROOT)
    ]
    # Functions that choose or import have returned by then.
    under_way = [(file, name) for _, file, name, _ in HOPS if name in ("Task.run", "filter_shape")]
    assert way == under_way
