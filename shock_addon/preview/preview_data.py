# SPDX-License-Identifier: GPL-3.0-or-later
"""What a preview shows in a mesh, and what was there before."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy
import numpy as np

from ..data import shape_keys
from ..data.color_data import write_colors
from ..data.geometry_data import write_geometry
from ..data.mesh_data import Target, find, read_positions, write_positions
from ..filters.coloring import ColoredSurface
from ..filters.denoising import Both, PaintedSurface
from ..filters.recolored import Recolored
from ..filters.sharpening import Sharpened


class Original:
    """The positions, shape keys and colors of a mesh, to bring them back bit for bit.

    Parameters
    ----------
    mesh : bpy.types.Mesh
        In an object that is in Object Mode.
    attribute : str or None
        Name of the color attribute that will change.
    """

    def __init__(self, mesh: bpy.types.Mesh, attribute: str | None) -> None:
        self._mesh = mesh.session_uid
        self._positions = read_positions(mesh)
        keys = mesh.shape_keys.key_blocks if mesh.shape_keys else []
        self.keys = {key.name: shape_keys.read(key) for key in keys}
        self._attribute = attribute
        self._colors = None
        if attribute is not None:
            colors = mesh.color_attributes[attribute].data
            self._colors = np.empty(4 * len(colors), dtype=np.float32)
            colors.foreach_get(_stored(mesh.color_attributes[attribute]), self._colors)

    def restore(self) -> None:
        """Bring all of it back, as far as it still fits the mesh."""
        mesh = next((mesh for mesh in bpy.data.meshes if mesh.session_uid == self._mesh), None)
        if mesh is None or len(mesh.vertices) != len(self._positions):
            return
        write_positions(mesh, self._positions)
        for name, positions in self.keys.items():
            if mesh.shape_keys is not None and name in mesh.shape_keys.key_blocks:
                shape_keys.write(mesh.shape_keys.key_blocks[name], positions)
        if mesh.shape_keys is not None:
            mesh.shape_keys.update_tag()
        attribute = None if self._attribute is None else mesh.color_attributes.get(self._attribute)
        if attribute is not None and 4 * len(attribute.data) == len(self._colors):
            attribute.data.foreach_set(_stored(attribute), self._colors)
        mesh.update()


def color_attribute(target: Target) -> str | None:
    """Name the color attribute that the target's results go to, if any."""
    if isinstance(target.surface, PaintedSurface):
        return target.place[1]
    return target.place if isinstance(target.surface, ColoredSurface) else None


def show(target: Target, original: Original, result: Any) -> None:
    """Write a result so that it is seen; `Original.restore` undoes it.

    Raises
    ------
    Skipped
        If the object was removed, or something else has changed its mesh.
    """
    original.restore()
    if isinstance(result, Both):
        place, attribute = target.place
        shape = replace(target, place=place, surface=target.surface.shape)
        _show_shape(shape, original, result.shape)
        write_colors(replace(target, place=attribute, surface=target.surface.paint), result.paint)
    elif isinstance(result, Recolored):
        write_colors(target, result)
    else:
        _show_shape(target, original, result)


def _show_shape(target: Target, original: Original, result: Sharpened) -> None:
    keys = find(target).data.shape_keys
    if target.place.output == "MESH" or keys is None:
        place = replace(target.place, output="MESH", custom_normals="KEEP", sharp_angle=None)
        write_geometry(replace(target, place=place), result)
        return
    # All keys move along, so that their mix, which is seen, moves as a new key would move it.
    change = result.positions - target.surface.positions
    for name, positions in original.keys.items():
        shape_keys.write(keys.key_blocks[name], positions + change)
    keys.update_tag()
    find(target).data.update()


def _stored(attribute: bpy.types.Attribute) -> str:
    return "color_srgb" if attribute.data_type == "BYTE_COLOR" else "color"
