# SPDX-License-Identifier: GPL-3.0-or-later
"""The attributes that tell for which mesh a live result was computed."""

from __future__ import annotations

from typing import NamedTuple

import bpy
import numpy as np

from ....core.host.live.movement import Connectivity, Marks
from .. import arrays
from ..mesh import meshes


class Names(NamedTuple):
    """Names of the attributes, in the order of the fields of `core.host.live.movement.Marks`."""

    vertices: str
    counts: str
    edges: str
    faces: str
    places: str


def _names(prefix: str) -> Names:
    return Names(*(prefix + each for each in ("vertex", "counts", "ends", "faces", "place")))


SHAPE, COLORS = _names(".shock_"), _names(".shock_color_")
"""Those of movements and of color differences, which may be computed for different meshes."""

_KINDS = (
    ("INT", "POINT"),
    ("FLOAT_VECTOR", "POINT"),
    ("INT", "EDGE"),
    ("FLOAT_VECTOR", "FACE"),
)


def write(mesh: bpy.types.Mesh, names: Names, marks: Marks, domain: str = "POINT") -> None:
    """Write marks; `domain` is the domain of the positions."""
    values = (marks.vertices, marks.counts, marks.edges, marks.faces, marks.places)
    for name, kind, each in zip(names, (*_KINDS, ("INT", domain)), values, strict=True):
        arrays.write_attribute(arrays.find_or_add_attribute(mesh, name, *kind), each)


def read(mesh: bpy.types.Mesh, names: Names, domain: str = "POINT") -> Marks | None:
    """Return marks; None if some are missing."""
    kinds = (*_KINDS, ("INT", domain))
    found = [arrays.find_attribute(mesh, *each) for each in _each(names, kinds)]
    if any(each is None for each in found):
        return None
    return Marks(*map(arrays.read_attribute, found))


def _each(names: Names, kinds: tuple[tuple[str, str], ...]) -> list[tuple[str, str, str]]:
    return [(name, *kind) for name, kind in zip(names, kinds, strict=True)]


def remove(mesh: bpy.types.Mesh, names: tuple[str, ...]) -> None:
    """Remove attributes that are there."""
    for name in names:
        if name in mesh.attributes:
            mesh.attributes.remove(mesh.attributes[name])
    mesh.update()


def connectivity(mesh: bpy.types.Mesh) -> Connectivity:
    """Read the connectivity of a mesh."""
    if len(mesh.loops) == 3 * len(mesh.polygons):
        starts = np.arange(0, len(mesh.loops), 3, dtype=np.int32)
    else:
        starts = arrays.read(mesh.polygons, "loop_start", dtype=np.int32)
    ends = arrays.read_attribute(mesh.attributes[".edge_verts"])
    return Connectivity(ends, meshes.read_corner_vertices(mesh), starts)
