# SPDX-License-Identifier: GPL-3.0-or-later
"""The rooms of both packages stay small, and say what lives in them."""

import ast
from pathlib import Path

import pytest
from draw_house import PLACES

ROOT = Path(__file__).resolve().parents[2]
ROOMS = sorted(
    path.parent.relative_to(ROOT).as_posix()
    for top in ("core", "shock_addon")
    for path in (ROOT / top).rglob("__init__.py")
)
MOST = 16
"""Modules of a room."""


def test_rooms_are_found():
    assert {"core/shape", "core/files/formats/image", "shock_addon/data/mesh"} <= set(ROOMS)


def test_the_picture_shows_each_room():
    there = {room.replace("/", ".") for room in ROOMS if room.count("/") == 1}
    assert PLACES.keys() == there | {"shock_addon.modes", "shock_addon.kinds", "core.registry"}


@pytest.mark.parametrize("room", ROOMS)
def test_no_room_is_overfull(room):
    modules = [path for path in (ROOT / room).glob("*.py") if path.name != "__init__.py"]
    assert len(modules) <= MOST


@pytest.mark.parametrize("room", [room for room in ROOMS if room.count("/") > 0])
def test_each_room_says_what_it_holds_and_what_it_may_use(room):
    tree = ast.parse((ROOT / room / "__init__.py").read_text(encoding="utf-8"))
    words = ast.get_docstring(tree)
    assert "May use" in words
