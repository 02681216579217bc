# SPDX-License-Identifier: GPL-3.0-or-later
"""The original data of a mesh while a preview shows something else in it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np
import numpy.typing as npt

from ....core.host.inputs import ColoredSurface, MirroredSurface, PaintedSurface
from .. import DIFFERENCE, MOVE, arrays
from . import shading, shape_keys
from .colors import write_colors
from .geometry import write_geometry
from .painted import split
from .targets import MeshTarget, find

if TYPE_CHECKING:
    from ....core.host.geometry import Reshaped

_Part = tuple[str, str]
"""What a mesh holds: the kind and the name."""

_KEY, _COLORS = "key", "colors"
_POSITIONS: _Part = ("positions", "")
_LIVE: _Part = ("movement", "")


class Original:
    """What a preview changes in a mesh, to bring it back bit for bit.

    Positions, shape keys, colors, sharp edges, and custom normals as Blender 4.5 stores them.

    Parameters
    ----------
    mesh : bpy.types.Mesh
        In an object that is not in Edit Mode.
    attribute : str or None
        Name of the color attribute that will change.

    Attributes
    ----------
    keys : dict
        Positions by the names of the shape keys.
    """

    def __init__(self, mesh: bpy.types.Mesh, attribute: str | None) -> None:
        self._mesh = mesh.session_uid
        self._attribute = attribute
        self._shown = self._old = self._read(mesh)
        self._shown_marks = self._old_marks = shading.read_marks(mesh)
        self._has_marks = shading.MARKS in mesh.attributes
        self._shown_turns = self._old_turns = shading.read_turns(mesh)
        self.keys = {name: values for (kind, name), values in self._old.items() if kind == _KEY}

    def note_shown(self) -> None:
        """Store the current mesh data as those shown by the preview."""
        mesh = self._find()
        if mesh is not None:
            self._note(mesh)

    def _note(self, mesh: bpy.types.Mesh) -> None:
        self._shown, self._shown_marks = self._read(mesh), shading.read_marks(mesh)
        self._shown_turns = shading.read_turns(mesh)

    def check_shown(self) -> None:
        """Raise `Skipped` if something else has changed what is shown."""
        mesh = self._find()
        arrays.check_same_parts({} if mesh is None else self._read(mesh), self._shown)
        if mesh is not None:
            arrays.check_same(shading.read_marks(mesh), self._shown_marks)

    def restore(self) -> None:
        """Bring all of it back, as far as it still fits; what something else has changed stays."""
        mesh = self._find()
        if mesh is None or len(mesh.vertices) != len(self._old[_POSITIONS]):
            return
        for part, place in self._places(mesh).items():
            values = arrays.read(*place)
            old, shown = self._old.get(part), self._shown.get(part)
            if old is None or old.shape != values.shape:
                continue
            follows = part == _POSITIONS and mesh.shape_keys is not None  # Blender may set them
            stays = np.ascontiguousarray(values).view(np.int32) != shown.view(np.int32)
            arrays.write(*place[:2], old if follows else np.where(stays, values, old))
        if mesh.shape_keys is not None:
            mesh.shape_keys.update_tag()
        self._restore_marks(mesh)
        self._restore_turns(mesh)
        mesh.update()
        self._note(mesh)

    def _restore_marks(self, mesh: bpy.types.Mesh) -> None:
        marks = shading.read_marks(mesh)
        if marks.shape != self._old_marks.shape or (marks == self._old_marks).all():
            return
        stays = marks != self._shown_marks
        shading.set_marks(mesh, np.where(stays, marks, self._old_marks), self._has_marks)

    def _restore_turns(self, mesh: bpy.types.Mesh) -> None:
        now, old, shown = shading.read_turns(mesh), self._old_turns, self._shown_turns
        if now is None or old is None or shown is None or now.shape != old.shape:
            return
        shading.write_turns(mesh, np.where(now != shown, now, old))

    def _find(self) -> bpy.types.Mesh | None:
        return next((mesh for mesh in bpy.data.meshes if mesh.session_uid == self._mesh), None)

    def _read(self, mesh: bpy.types.Mesh) -> dict[_Part, npt.NDArray[np.float32]]:
        return {part: arrays.read(*place) for part, place in self._places(mesh).items()}

    def _places(self, mesh: bpy.types.Mesh) -> dict[_Part, tuple[Any, str, int]]:
        """Say where each part is stored: the collection, the property and its width."""
        attributes = {_POSITIONS: mesh.attributes["position"]}
        move = arrays.find_attribute(mesh, MOVE, "FLOAT_VECTOR", "POINT")
        if move is not None:
            attributes[_LIVE] = move
        colors = mesh.attributes.get(DIFFERENCE)
        if colors is not None and arrays.is_readable(colors):
            attributes[_LIVE, DIFFERENCE] = colors
        if self._attribute and self._attribute in mesh.color_attributes:
            attributes[_COLORS, self._attribute] = mesh.color_attributes[self._attribute]
        places = {part: arrays.stored(attribute)[:3] for part, attribute in attributes.items()}
        for key in mesh.shape_keys.key_blocks if mesh.shape_keys else []:
            places[_KEY, key.name] = key.points, "co", 3
        return places


def color_attribute(target: MeshTarget) -> str | None:
    """Name the color attribute that the target's results go to, if any."""
    if isinstance(target.surface, PaintedSurface):
        return target.place[1]
    return target.place if isinstance(target.surface, ColoredSurface) else None


def show(target: MeshTarget, original: Original, result: Any) -> None:
    """Show a result in the mesh; `Original.restore` undoes it.

    Raises
    ------
    Skipped
        If the object was removed, or something else has changed its mesh.
    """
    original.check_shown()
    original.restore()
    try:
        if not isinstance(target.surface, MirroredSurface):
            _put_away_live_colors(find(target).data)
        if isinstance(target.surface, PaintedSurface):
            shape, paint = split(target)
            _show_shape(shape, original, result.shape)
            write_colors(paint, result.paint)
        elif isinstance(target.surface, ColoredSurface):
            write_colors(target, result)
        else:
            _show_shape(target, original, result)
    finally:
        original.note_shown()


def _put_away_live_colors(mesh: bpy.types.Mesh) -> None:
    colors = mesh.attributes.get(DIFFERENCE)
    if colors is not None and arrays.is_readable(colors):  # they would come on top
        arrays.write_attribute(colors, np.zeros((len(colors.data), 3), dtype=np.float32))


def _show_shape(target: MeshTarget, original: Original, result: Reshaped) -> None:
    mesh = find(target).data
    keys = mesh.shape_keys
    move = arrays.find_attribute(mesh, MOVE, "FLOAT_VECTOR", "POINT")
    if move is not None:  # a live result would come on top
        arrays.write_attribute(move, np.zeros((len(mesh.vertices), 3), dtype=np.float32))
    if target.place.output in {"MESH", "AUTO"} or keys is None:
        normals = target.place.custom_normals
        if normals == "CLEAR":  # which looks the same, and can be taken back
            normals = "RECOMPUTE"
        if shading.read_turns(mesh) is None:
            normals = "KEEP"
        place = replace(target.place, output="MESH", custom_normals=normals)
        if target.place.output == "SHAPE_KEY":  # a new key marks nothing
            place = replace(place, sharp_angle=None)
        write_geometry(replace(target, place=place), result)
        return
    # All keys move along, so that their mix, which is seen, moves as a new key would move it.
    change = result.positions - target.surface.positions
    for name, positions in original.keys.items():
        shape_keys.write(keys.key_blocks[name], positions + change)
    keys.update_tag()
    find(target).data.update()
