# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw a potential and its flow over an object: colors, arrows and a legend."""

from __future__ import annotations

import math

import blf
import bpy
import gpu
from bpy.app.translations import pgettext_iface as iface_
from gpu_extras.batch import batch_for_shader
from mathutils import Vector

from ...core.preview.arrows import DARK, LIGHT, arrows, bar, potential_colors
from .. import data
from ..data import views
from .overlay import Overlay, is_seen

_DISTANCE = 22.0
"""Pixels between arrows."""

_STEPS = 3
"""Number of steps of the distance between arrows per doubling."""

_KEPT = 8
"""Number of distances for which arrows are cached."""

_MOST_ACROSS = 100.0
"""Number of arrows across an object that fills the view, at any zoom."""


def draw_surface(overlay: Overlay) -> None:
    """Draw the potential and the arrows, where the view shows the object."""
    context, obj = bpy.context, overlay.object()
    if not is_seen(obj, context.space_data):
        return
    if overlay.surface is None:
        overlay.surface = _surface(obj.data, overlay.found)
    distance = _distance(obj, context.region, context.region_data)
    if distance not in overlay.arrows:
        if len(overlay.arrows) == _KEPT:
            overlay.arrows.clear()
        overlay.arrows[distance] = _arrows(obj.data, overlay.found, distance)
    smooth = gpu.shader.from_builtin("SMOOTH_COLOR")
    plain = gpu.shader.from_builtin("UNIFORM_COLOR")
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_test_set("LESS_EQUAL")
    with gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
        gpu.matrix.multiply_matrix(obj.matrix_world)
        projection = gpu.matrix.get_projection_matrix()
        gpu.matrix.load_projection_matrix(views.lifted(projection, context.region_data))
        overlay.surface.draw(smooth)
        for number, (batch, color) in enumerate(overlay.arrows[distance]):
            lift = views.LIFT * (2 + number)
            gpu.matrix.load_projection_matrix(views.lifted(projection, context.region_data, lift))
            plain.uniform_float("color", color)
            batch.draw(plain)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")


def _distance(
    obj: bpy.types.Object, region: bpy.types.Region, view: bpy.types.RegionView3D
) -> float:
    """Return the distance between arrows in object space, in steps, so that few values occur."""
    corners = [Vector(corner) for corner in obj.bound_box]
    size = max((corner - corners[0]).length for corner in corners)
    # Of the object's middle, seen from the eye; 1 without perspective.
    depth = (view.perspective_matrix @ obj.matrix_world @ (sum(corners, Vector()) / 8).to_4d()).w
    scale = max(abs(obj.matrix_world.determinant()), 1e-30) ** (1 / 3)
    pixel = 2.0 * depth / (view.window_matrix[0][0] * region.width * scale)
    wanted = _DISTANCE * bpy.context.preferences.system.ui_scale * pixel
    wanted = max(wanted, size / _MOST_ACROSS, 1e-30)
    return 2.0 ** (round(_STEPS * math.log2(wanted)) / _STEPS)


def _surface(mesh: bpy.types.Mesh, found: data.mesh.flow.FlowOfMesh) -> gpu.types.GPUBatch:
    colored = {
        "pos": data.mesh.meshes.read_positions(mesh),
        "color": potential_colors(found.potential),
    }
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    return batch_for_shader(shader, "TRIS", colored, indices=data.mesh.meshes.read_triangles(mesh))


def _arrows(mesh: bpy.types.Mesh, found: data.mesh.flow.FlowOfMesh, distance: float) -> list[tuple]:
    """Make the batches of arrows, their rims first, with their colors."""
    rims, shapes = arrows(*data.mesh.flow.read_faces(mesh), found.flow, distance)
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    return [
        (batch_for_shader(shader, "TRIS", {"pos": corners}), color)
        for corners, color in ((rims, DARK), (shapes, LIGHT))
    ]


def draw_legend(overlay: Overlay) -> None:
    """Draw what the colors mean, at the right, since Adjust Last Operation stands at the left."""
    context = bpy.context
    if not is_seen(overlay.object(), context.space_data):
        return
    weak = iface_("{name}: potential weak").format(name=overlay.name)
    strong = iface_("strong; arrows point to where values flow")
    scale, font = context.preferences.system.ui_scale, 0
    blf.size(font, 12 * scale)
    blf.color(font, *context.preferences.themes[0].view_3d.space.text_hi, 1.0)
    words = [blf.dimensions(font, text)[0] for text in (weak, strong)]
    x = context.region.width - _covered(context.area, "UI") - 136 * scale - sum(words)
    y = 24 * scale + _covered(context.area, "ASSET_SHELF", "ASSET_SHELF_HEADER")
    _write(font, x, y, weak)
    x += words[0] + 8 * scale
    corners, colors = bar(x, y, 100 * scale, 10 * scale)
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    batch_for_shader(shader, "TRI_STRIP", {"pos": corners, "color": colors}).draw(shader)
    _write(font, x + 108 * scale, y, strong)


def _covered(area: bpy.types.Area, *kinds: str) -> int:
    """Return how many pixels of a side regions of these kinds take, which may be hidden."""
    regions = [region for region in area.regions if region.type in kinds]
    return sum(region.width if region.type == "UI" else region.height for region in regions)


def _write(font: int, x: float, y: float, text: str) -> None:
    blf.position(font, x, y, 0.0)
    blf.draw(font, text)
