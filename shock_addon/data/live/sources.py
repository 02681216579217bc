# SPDX-License-Identifier: GPL-3.0-or-later
"""Digests of the visible shape of a live copy's source, to notice changes."""

from __future__ import annotations

from hashlib import blake2b

import bpy

from .. import arrays
from ..mesh import visible
from . import marks

_SUBDIVISION = ("levels", "subdivision_type", "quality", "boundary_smooth", "uv_smooth")
"""Settings that count beside the mesh, which Blender may subdivide only where it is drawn."""


def digest(source: bpy.types.Object, graph: bpy.types.Depsgraph) -> str:
    """Return a digest of the transform, the mesh and its attributes.

    Empty where the graph does not evaluate the object as a filter would read it. Vertex groups do
    not count.
    """
    if source.mode != "OBJECT" or not visible.is_evaluated(source, graph.view_layer):
        return ""
    seen = source.evaluated_get(graph)
    if not seen.data.polygons:
        return ""
    found = blake2b(str([[*row] for row in seen.matrix_world]).encode(), digest_size=16)
    for modifier in seen.modifiers:
        if modifier.type == "SUBSURF":
            found.update(str([getattr(modifier, name) for name in _SUBDIVISION]).encode())
    connected = marks.connectivity(seen.data)
    for part in (connected.ends, connected.corners, connected.starts):
        found.update(part)
    for attribute in seen.data.attributes:
        if not attribute.name.startswith(".") and arrays.is_readable(attribute):
            found.update(f"{attribute.name} {attribute.domain}".encode())
            found.update(arrays.read_attribute(attribute))
    return found.hexdigest()
