# SPDX-License-Identifier: GPL-3.0-or-later
"""Redo with other settings reuses what is known about the surface, and changes no result."""

import threading

import bpy
import numpy as np
import pytest
from shock_filter.core.host import welding
from shock_filter.core.host.inputs import Surface
from shock_filter.shock_addon.data.mesh.meshes import read_positions, write_positions

sharpen = bpy.ops.shock_filter.sharpen_geometry


@pytest.fixture(autouse=True)
def forgotten():
    welding.forget()
    yield
    welding.forget()


@pytest.fixture
def preparations(monkeypatch):
    """Count how often a surface is prepared."""
    counts = []
    prepare = welding._welded

    def counted(*arguments):
        counts.append(1)
        return prepare(*arguments)

    monkeypatch.setattr(welding, "_welded", counted)
    return counts


def redone(obj, start, **settings):
    """Undo by hand and run again, as Adjust Last Operation does."""
    write_positions(obj.data, start)
    obj.data.update()
    assert sharpen(**settings) == {"FINISHED"}
    return read_positions(obj.data)


def test_a_redo_prepares_nothing_and_gives_what_a_fresh_run_gives(rounded_box, preparations):
    box = rounded_box()
    start = read_positions(box.data)
    sharpen()
    quick = [redone(box, start, time=time) for time in (16.0, 1000.0, 16.0)]
    assert len(preparations) == 1
    for time, result in zip((16.0, 1000.0, 16.0), quick, strict=True):
        welding.forget()
        assert redone(box, start, time=time).tobytes() == result.tobytes()
    assert len(preparations) == 4


def changed_position(box):
    box.data.vertices[7].co.x += 0.01


def changed_group(box):
    group = box.vertex_groups["Some"]
    group.add([3], 0.5, "REPLACE")


def changed_scale(box):
    box.scale = (1.0, 2.0, 1.0)
    bpy.context.view_layer.update()


def changed_triangles(box):
    bpy.ops.object.modifier_add(type="TRIANGULATE")
    box.modifiers[0].quad_method = "FIXED_ALTERNATE"
    bpy.ops.object.modifier_apply(modifier=box.modifiers[0].name)


@pytest.mark.parametrize(
    "change", [changed_position, changed_group, changed_scale, changed_triangles]
)
def test_whatever_changes_is_seen(rounded_box, preparations, change):
    box = rounded_box()
    box.vertex_groups.new(name="Some").add(range(100), 1.0, "REPLACE")
    start = read_positions(box.data)
    sharpen(vertex_group="Some")
    write_positions(box.data, start)
    change(box)
    start = read_positions(box.data)
    stale = redone(box, start, vertex_group="Some")
    assert len(preparations) == 2
    welding.forget()
    assert redone(box, start, vertex_group="Some").tobytes() == stale.tobytes()


def test_weld_and_colors_count(painted_sheet, preparations):
    painted_sheet()
    for settings, prepared in (({}, 1), ({"weld": False}, 2), ({}, 3)):
        bpy.ops.shock_filter.sharpen_colors(**settings)
        assert len(preparations) == prepared  # the colors have changed meanwhile


def test_only_the_last_surfaces_are_kept(rounded_box, preparations, monkeypatch):
    boxes = [rounded_box(location=(3 * x, 0, 0), cuts=5 + x) for x in range(3)]
    for box in boxes:
        bpy.context.view_layer.objects.active = box
        bpy.ops.object.select_all(action="DESELECT")
        box.select_set(True)
        sharpen(time=0.0)
    assert len(welding._recent) == 2
    sharpen(time=0.0)
    assert len(preparations) == 3
    monkeypatch.setattr(welding, "_MOST_VERTICES", 10)
    sharpen(time=0.0)
    assert welding._recent == []


def test_another_file_drops_what_is_kept(rounded_box):
    rounded_box()
    sharpen()
    assert welding._recent
    bpy.ops.wm.read_homefile(use_empty=True)
    assert welding._recent == []


def test_threads_may_ask_at_the_same_time(rounded_box):
    box = rounded_box()
    positions = read_positions(box.data)
    corners = np.array([p.vertices[:3] for p in box.data.polygons], dtype=np.int32)
    one = Surface(positions, corners, None, np.identity(3))
    found = []
    threads = [
        threading.Thread(target=lambda: found.append(welding.welded(one, True))) for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 8
    assert len({part.mesh.vertex_count for part in found}) == 1
    assert len(welding._recent) <= 2
