# SPDX-License-Identifier: GPL-3.0-or-later
"""Which colors may change: vertex group, selections, paint masks, sculpt mask, hidden parts."""

import bpy
import numpy as np
import pytest
from shock_filter.shock_addon.data.mesh.meshes import read_corner_vertices, read_positions
from shock_filter.shock_addon.operators import base as operators

sharpen = bpy.ops.shock_filter.sharpen_colors

DOMAINS = pytest.mark.parametrize("domain", ["POINT", "CORNER"])


class Sheet:
    """A painted sheet, and which of its colors, vertices and faces lie in the upper half."""

    def __init__(self, obj, domain):
        self.obj, self.mesh = obj, obj.data
        self.vertices = read_positions(self.mesh)[:, 1] > 0.01
        self.faces = np.array([polygon.center.y > 0 for polygon in self.mesh.polygons])
        corner_vertices = read_corner_vertices(self.mesh)
        sizes = [polygon.loop_total for polygon in self.mesh.polygons]
        # Each color's vertex, and whether its face, or one of its faces, is in the upper half.
        if domain == "CORNER":
            self.upper = self.vertices[corner_vertices]
            self.in_upper_faces = np.repeat(self.faces, sizes)
        else:
            self.upper = self.vertices
            self.in_upper_faces = np.zeros_like(self.vertices)
            self.in_upper_faces[corner_vertices[np.repeat(self.faces, sizes)]] = True
        self.before = self.colors()

    def colors(self):
        if self.obj.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        data = self.mesh.color_attributes["Paint"].data
        flat = np.empty(4 * len(data), dtype=np.float32)
        data.foreach_get("color_srgb", flat)
        return flat.reshape(-1, 4)

    def changed(self):
        return (self.colors() != self.before).any(axis=1)

    def flag(self, name, vertices=False, faces=False):
        mesh = self.mesh
        mesh.polygons.foreach_set(name, np.broadcast_to(faces, len(mesh.polygons)).copy())
        mesh.edges.foreach_set(name, np.zeros(len(mesh.edges), dtype=bool))
        mesh.vertices.foreach_set(name, np.broadcast_to(vertices, len(mesh.vertices)).copy())
        mesh.update()


@pytest.fixture
def sheet(painted_sheet):
    def add(domain):
        return Sheet(painted_sheet("BYTE_COLOR", domain), domain)

    return add


def only(changed, allowed):
    """Whether something changed, and nothing that must not."""
    return changed.any() and not changed[~allowed].any()


@DOMAINS
@pytest.mark.parametrize("invert", [False, True])
def test_weight_zero_is_exactly_unchanged(sheet, domain, invert):
    painted = sheet(domain)
    group = painted.obj.vertex_groups.new(name="Upper")
    group.add(np.flatnonzero(painted.vertices).tolist(), 1.0, "REPLACE")
    sharpen(time=256.0, vertex_group="Upper", invert_mask=invert)
    chosen = ~painted.upper if invert else painted.upper
    assert only(painted.changed(), chosen)
    assert f"{chosen.sum():,} colors, changed" in operators.summaries["colors"]


@DOMAINS
def test_edit_mode_changes_what_is_selected(sheet, domain):
    painted = sheet(domain)
    bpy.context.tool_settings.mesh_select_mode = (True, False, False)
    painted.flag("select", vertices=painted.vertices)
    bpy.ops.object.mode_set(mode="EDIT")
    assert sharpen(time=256.0) == {"FINISHED"}
    assert painted.obj.mode == "EDIT"
    assert only(painted.changed(), painted.upper)


@DOMAINS
def test_selected_faces_leave_the_corners_of_others_alone(sheet, domain):
    painted = sheet(domain)
    bpy.context.tool_settings.mesh_select_mode = (False, False, True)
    painted.flag("select", faces=painted.faces)
    bpy.ops.object.mode_set(mode="EDIT")
    sharpen(time=256.0)
    changed = painted.changed()
    assert only(changed, painted.in_upper_faces)
    assert changed[painted.in_upper_faces & ~painted.upper].any()


@DOMAINS
def test_edit_mode_can_change_all(sheet, domain):
    painted = sheet(domain)
    painted.flag("select")
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="leaves nothing to change"):
        sharpen(time=256.0)
    sharpen(time=256.0, selected_only=False)
    changed = painted.changed()
    assert changed[painted.upper].any()
    assert changed[~painted.upper].any()


@DOMAINS
def test_the_paint_mask_of_faces(sheet, domain):
    painted = sheet(domain)
    painted.flag("select", faces=painted.faces)
    painted.mesh.use_paint_mask = True
    bpy.ops.object.mode_set(mode="VERTEX_PAINT")
    assert sharpen(time=256.0) == {"FINISHED"}
    assert painted.obj.mode == "VERTEX_PAINT"
    changed = painted.changed()
    assert only(changed, painted.in_upper_faces)
    assert changed[painted.in_upper_faces & ~painted.upper].any()


@DOMAINS
def test_the_paint_mask_of_vertices(sheet, domain):
    painted = sheet(domain)
    painted.flag("select", vertices=painted.vertices)
    painted.mesh.use_paint_mask_vertex = True
    bpy.ops.object.mode_set(mode="VERTEX_PAINT")
    sharpen(time=256.0)
    assert only(painted.changed(), painted.upper)


@DOMAINS
def test_without_a_paint_mask_the_selection_does_not_count(sheet, domain):
    painted = sheet(domain)
    painted.flag("select")
    bpy.ops.object.mode_set(mode="VERTEX_PAINT")
    sharpen(time=256.0)
    assert painted.changed()[~painted.upper].any()


@DOMAINS
@pytest.mark.parametrize("mode", ["VERTEX_PAINT", "SCULPT", "EDIT"])
def test_hidden_parts_stay(sheet, domain, mode):
    painted = sheet(domain)
    painted.flag("hide", faces=~painted.faces, vertices=~painted.vertices)
    bpy.ops.object.mode_set(mode=mode)
    sharpen(time=256.0, selected_only=False)
    assert only(painted.changed(), painted.in_upper_faces)


@DOMAINS
def test_the_sculpt_mask_protects(sheet, domain):
    painted = sheet(domain)
    mask = painted.mesh.attributes.new(".sculpt_mask", "FLOAT", "POINT")
    mask.data.foreach_set("value", (~painted.vertices).astype(np.float32))
    bpy.ops.object.mode_set(mode="SCULPT")
    sharpen(time=256.0)
    assert only(painted.changed(), painted.upper)
