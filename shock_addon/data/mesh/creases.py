# SPDX-License-Identifier: GPL-3.0-or-later
"""Between a mesh object's creases and its data: marks of edges, attributes, curves."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np
import numpy.typing as npt

from ....core.host.inputs import MirroredSurface
from .. import arrays
from ..arrays import check_same
from ..skipped import Skipped
from . import meshes, visible
from .masks import color_mask
from .targets import MeshTarget, find

if TYPE_CHECKING:
    from ....core.host.creases import FoundCreases

ANGLE = "crease_angle"
LINE = "crease_line"

_MARKS = {
    "SHARP": ("sharp_edge", "BOOLEAN", True),
    "SEAM": ("uv_seam", "BOOLEAN", True),
    "CREASE": ("crease_edge", "FLOAT", 1.0),
    "BEVEL": ("bevel_weight_edge", "FLOAT", 1.0),
}
"""Attributes of edges that Blender knows, and what they hold at marked ones."""


def read_creases(
    obj: bpy.types.Object, mode: str, parameters: Any, angle: float
) -> tuple[None, MirroredSurface]:
    """Read the mesh whose creases are looked for.

    Parameters
    ----------
    obj, mode, parameters
        As in `color_mask`.
    angle : float
        Of the weakest creases, in radians.
    """
    mesh = obj.data
    positions, triangles = meshes.read_positions(mesh), meshes.read_triangles(mesh)
    return None, MirroredSurface(
        positions=positions,
        triangles=triangles,
        mask=color_mask(obj, mode, "POINT", parameters)[0],
        to_world=meshes.lengths_of_shape(obj, positions, triangles),
        mirror=(False, False, False),
        planes=(),
        sharp_angle=math.degrees(angle),
        edges=meshes.read_edges(mesh),
    )


def check_normals(obj: bpy.types.Object, custom_normals: str) -> None:
    """Raise `Skipped` if sharp edges would turn custom normals that are kept."""
    if custom_normals == "KEEP" and obj.data.has_custom_normals:
        raise Skipped(
            "sharp edges would turn its custom normals; set Custom Normals to Recompute or Clear,"
            " or choose other marks"
        )


def find_same(target: MeshTarget) -> bpy.types.Object:
    """Return the object that was read.

    Raises
    ------
    Skipped
        If it was removed or its shape has changed since.
    """
    obj = find(target)
    check_same(meshes.read_positions(obj.data), target.surface.positions)
    return obj


def crisp(found: FoundCreases) -> npt.NDArray[np.bool_]:
    """Tell which lines close or are sharp already: (lines,)."""
    return np.array([line.state in ("closes", "sharp") for line in found.lines], dtype=bool)


def mark(
    mesh: bpy.types.Mesh,
    found: FoundCreases,
    chosen: npt.NDArray[np.bool_],
    mask: npt.NDArray[np.float64] | None,
    marks: Collection[str],
) -> int:
    """Mark the edges of some lines, in Object Mode; returns how many. Marks that are there stay.

    Parameters
    ----------
    mesh : bpy.types.Mesh
    found : FoundCreases
    chosen : (lines,) bool
    mask : (n,) float64 or None
        Edges stay as they are where it is 0 at one of their ends.
    marks : collection of str
        Of "SHARP", "SEAM", "CREASE" and "BEVEL".
    """
    edges = _lines_of_edges(mesh, found, chosen, mask) >= 0
    for kind in marks:
        name, data_type, value = _MARKS[kind]
        attribute = arrays.find_or_add_attribute(mesh, name, data_type, "EDGE")
        values = arrays.read_attribute(attribute)
        values[edges] = value
        arrays.write_attribute(attribute, values)
    mesh.update()
    return int(edges.sum())


def write_attributes(
    mesh: bpy.types.Mesh,
    found: FoundCreases,
    chosen: npt.NDArray[np.bool_],
    mask: npt.NDArray[np.float64] | None,
) -> int:
    """Write angle and number of each edge's line; returns how many edges have one.

    Angles are in radians, negative in grooves, and 0 off the lines; numbers begin at 1.
    """
    line = _lines_of_edges(mesh, found, chosen, mask)
    angles = np.array([each.strength if each.is_convex else -each.strength for each in found.lines])
    values = np.append(np.radians(angles), 0.0)[line].astype(np.float32)
    arrays.write_attribute(arrays.find_or_add_attribute(mesh, ANGLE, "FLOAT", "EDGE"), values)
    numbers = arrays.find_or_add_attribute(mesh, LINE, "INT", "EDGE")
    arrays.write_attribute(numbers, line.astype(np.int32) + 1)
    mesh.update()
    return int((line >= 0).sum())


def add_curves(
    obj: bpy.types.Object, found: FoundCreases, chosen: npt.NDArray[np.bool_], name: str
) -> bpy.types.Object:
    """Add a curve object that moves with the object, with a spline for each of some lines."""
    curves = bpy.data.curves.new(name, "CURVE")
    curves.dimensions = "3D"
    positions = meshes.read_positions(obj.data)
    for line, wanted in zip(found.lines, chosen, strict=True):
        if not wanted:
            continue
        spline = curves.splines.new("POLY")
        spline.points.add(len(line.vertices) - 1)
        points = np.ones((len(line.vertices), 4), dtype=np.float32)
        points[:, :3] = positions[line.vertices]
        spline.points.foreach_set("co", points.reshape(-1))
        spline.use_cyclic_u = line.is_loop
    return visible.with_curves(obj, curves, name)


def _lines_of_edges(
    mesh: bpy.types.Mesh,
    found: FoundCreases,
    chosen: npt.NDArray[np.bool_],
    mask: npt.NDArray[np.float64] | None,
) -> npt.NDArray[np.intp]:
    # The line of each edge, -1 for none.
    ends = arrays.read_attribute(mesh.attributes[".edge_verts"])
    owners = found.edges.owners_among(ends, found.owners)
    owners[(owners >= 0) & ~np.append(chosen, False)[owners]] = -1
    if mask is not None:
        owners[~(mask > 0.0)[ends].all(axis=1)] = -1
    return owners
