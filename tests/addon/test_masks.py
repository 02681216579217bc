# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertex group, selection and sculpt mask."""

import bpy
import numpy as np
import pytest
from shock_filter.core.settings import OF_PAPER
from shock_filter.shock_addon.data.mesh.meshes import read_positions, write_positions

sharpen = bpy.ops.shock_filter.sharpen_geometry


@pytest.fixture
def half(rounded_box):
    """Return a box, and which of its vertices have a positive x."""
    box = rounded_box()
    return box, read_positions(box.data)[:, 0] > 0.01


def set_group(box, weights):
    group = box.vertex_groups.new(name="Mask")
    for number, weight in enumerate(weights):
        if weight > 0:
            group.add([number], float(weight), "REPLACE")


def set_edit_flags(box, attribute, flags):
    box.data.polygons.foreach_set(attribute, np.zeros(len(box.data.polygons), dtype=bool))
    box.data.edges.foreach_set(attribute, np.zeros(len(box.data.edges), dtype=bool))
    box.data.vertices.foreach_set(attribute, np.ascontiguousarray(flags))


@pytest.mark.parametrize("invert", [False, True])
def test_weight_zero_is_exactly_unmoved(half, invert):
    box, right = half
    set_group(box, right)
    before = read_positions(box.data)
    sharpen(vertex_group="Mask", invert_mask=invert)
    moved = (read_positions(box.data) != before).any(axis=1)
    assert moved.any()
    assert not moved[right if invert else ~right].any()


def test_lower_weights_move_less(half):
    box, right = half
    start = read_positions(box.data)
    moves = []
    for weight in (0.25, 1.0):
        box.vertex_groups.clear()
        write_positions(box.data, start)
        set_group(box, weight * right)
        sharpen(vertex_group="Mask")
        moves.append(np.linalg.norm(read_positions(box.data) - start, axis=1).mean())
    assert 0 < moves[0] < 0.7 * moves[1]


def test_a_missing_group_is_named(rounded_box):
    rounded_box()
    with pytest.raises(RuntimeError, match="no vertex group named 'Nowhere'"):
        sharpen(vertex_group="Nowhere")


def test_an_empty_group_is_named(rounded_box):
    rounded_box().vertex_groups.new(name="Mask")
    with pytest.raises(RuntimeError, match="leaves nothing to change"):
        sharpen(vertex_group="Mask")


def test_edit_mode_moves_the_selection_and_stays_in_edit_mode(half):
    box, right = half
    before = read_positions(box.data)
    set_edit_flags(box, "select", right)
    bpy.ops.object.mode_set(mode="EDIT")
    assert sharpen() == {"FINISHED"}
    assert box.mode == "EDIT"
    bpy.ops.object.mode_set(mode="OBJECT")
    moved = (read_positions(box.data) != before).any(axis=1)
    assert moved.any()
    assert not moved[~right].any()


def test_edit_mode_can_move_all_that_is_not_hidden(half):
    box, right = half
    before = read_positions(box.data)
    set_edit_flags(box, "select", np.zeros_like(right))
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="leaves nothing to change"):
        sharpen()
    sharpen(selected_only=False)
    bpy.ops.object.mode_set(mode="OBJECT")
    moved = (read_positions(box.data) != before).any(axis=1)
    assert moved[right].any()
    assert moved[~right].any()

    write_positions(box.data, before)
    box.data.update()
    set_edit_flags(box, "hide", right)
    bpy.ops.object.mode_set(mode="EDIT")
    sharpen(selected_only=False)
    bpy.ops.object.mode_set(mode="OBJECT")
    moved = (read_positions(box.data) != before).any(axis=1)
    assert moved.any()
    assert not moved[right].any()


def test_object_mode_ignores_the_selection(half):
    box, right = half
    before = read_positions(box.data)
    set_edit_flags(box, "select", right)
    sharpen()
    moved = (read_positions(box.data) != before).any(axis=1)
    assert moved[~right].any()


def test_edit_mode_on_two_objects(rounded_box, select):
    boxes = [rounded_box(), rounded_box(location=(5, 0, 0))]
    before = [read_positions(box.data) for box in boxes]
    select(*boxes)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    assert sharpen() == {"FINISHED"}
    assert {box.mode for box in boxes} == {"EDIT"}
    bpy.ops.object.mode_set(mode="OBJECT")
    for box, old in zip(boxes, before, strict=True):
        assert (read_positions(box.data) != old).any()


def test_the_sculpt_mask_protects_in_sculpt_mode_only(half):
    box, right = half
    before = read_positions(box.data)
    mask = box.data.attributes.new(".sculpt_mask", "FLOAT", "POINT")
    mask.data.foreach_set("value", right.astype(np.float32))
    bpy.ops.object.mode_set(mode="SCULPT")
    assert sharpen() == {"FINISHED"}
    assert box.mode == "SCULPT"
    bpy.ops.object.mode_set(mode="OBJECT")
    moved = (read_positions(box.data) != before).any(axis=1)
    assert moved.any()
    assert not moved[right].any()
    sharpen(**OF_PAPER)  # by default a box whose other half is sharp already may stay
    moved = (read_positions(box.data) != before).any(axis=1)
    assert moved[right].any()


@pytest.mark.parametrize(("kind", "domain"), [("FLOAT", "FACE"), ("FLOAT_COLOR", "POINT")])
def test_a_sculpt_mask_that_blender_does_not_know_does_not_count(half, kind, domain):
    box, _ = half
    before = read_positions(box.data)
    box.data.attributes.new(".sculpt_mask", kind, domain)
    bpy.ops.object.mode_set(mode="SCULPT")
    assert sharpen() == {"FINISHED"}
    bpy.ops.object.mode_set(mode="OBJECT")
    assert (read_positions(box.data) != before).any()


def test_of_welded_vertices_the_most_protected_counts(rounded_box):
    box = rounded_box()
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.edge_split()
    bpy.ops.object.mode_set(mode="OBJECT")
    before = read_positions(box.data)
    weights = np.ones(len(before))
    _, first, place = np.unique(before, axis=0, return_index=True, return_inverse=True)
    weights[first[::2]] = 0.0
    protected = np.isin(place.reshape(-1), np.arange(len(first))[::2])
    assert (weights[protected] > 0).any()
    set_group(box, weights)
    sharpen(vertex_group="Mask", feature_threshold=0.0)
    moved = (read_positions(box.data) != before).any(axis=1)
    assert moved[~protected].any()
    assert not moved[protected].any()


@pytest.mark.parametrize("mode", ["WEIGHT_PAINT", "VERTEX_PAINT"])
def test_paint_modes_go_through(rounded_box, mode):
    box = rounded_box()
    before = read_positions(box.data)
    bpy.ops.object.mode_set(mode=mode)
    assert sharpen() == {"FINISHED"}
    assert box.mode == mode
    bpy.ops.object.mode_set(mode="OBJECT")
    assert (read_positions(box.data) != before).any()
