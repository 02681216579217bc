# SPDX-License-Identifier: GPL-3.0-or-later
"""Between Blender's mesh objects and arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt
from bpy.app.translations import pgettext_iface, pgettext_rpt

from ....core.host.inputs import Surface
from ....core.mesh.evenness import even_lengths
from .. import arrays
from ..chosen import CONVERTIBLE, mesh_objects, mesh_refusal
from ..skipped import Refused, Skipped, as_reason, sentences, skip_if
from .targets import MeshTarget

_SINGULAR = 1e-6
_UNIFORM = 1e-5

_AT_ONCE = 1 << 15
"""Number of triangles whose corners are looked up at once, in memory that is reused."""


@contextmanager
def object_mode(context: bpy.types.Context) -> Iterator[None]:
    """Leave the current mode, since mesh data is complete in Object Mode only; then re-enter it."""
    left = leave_mode(context)
    try:
        yield
    finally:
        left.enter_again(context)


@dataclass(frozen=True)
class LeftMode:
    """A mode that was left for Object Mode.

    Attributes
    ----------
    mode : str
        As in ``obj.mode``.
    edited : set of int
        Uids of the objects that were in Edit Mode.
    """

    mode: str
    edited: set[int]

    def enter_again(self, context: bpy.types.Context) -> None:
        """Go back to it."""
        if self.mode == "OBJECT":
            return
        objects = context.view_layer.objects if self.mode == "EDIT" else []
        others = [obj for obj in objects if obj.select_get() != (obj.session_uid in self.edited)]
        for obj in others:  # Blender edits what is selected
            obj.select_set(obj.session_uid in self.edited)
        bpy.ops.object.mode_set(mode=self.mode)
        for obj in others:
            obj.select_set(obj.session_uid not in self.edited)


def check_leaving(context: bpy.types.Context) -> None:
    """Raise `Skipped` if leaving Sculpt Mode would turn dynamic topology off."""
    if context.mode == "SCULPT" and context.object.use_dynamic_topology_sculpting:
        raise Skipped("dynamic topology is on; turn Dyntopo off in the header first")


def leave_mode(context: bpy.types.Context) -> LeftMode:
    """Go to Object Mode."""
    mode = context.object.mode if context.object is not None else "OBJECT"
    if mode == "OBJECT":
        return LeftMode(mode, set())
    edited = {obj.session_uid for obj in context.view_layer.objects if obj.mode == "EDIT"}
    bpy.ops.object.mode_set(mode="OBJECT")
    return LeftMode(mode, edited)


def read_targets(
    context: bpy.types.Context,
    read: Callable[[bpy.types.Object, str, Any], tuple[Any, Surface]],
    parameters: Any,
    *,
    is_seen: Callable[[bpy.types.Object], bool] = lambda obj: False,
    source_of: Callable[[bpy.types.Object], bpy.types.Object | None] = lambda obj: None,
    writes: bool = True,
) -> tuple[list[MeshTarget], list[str]]:
    """Read all objects that the operator acts on, each mesh once.

    Parameters
    ----------
    context : bpy.types.Context
    read : callable
        ``read(obj, mode, parameters)`` gives the place and the surface of a `MeshTarget`; `mode` is
        the one that the person works in, while the object is in Object Mode.
    parameters : object
        The parameters for `read`.
    is_seen : callable
        ``is_seen(obj)`` says whether to read what is seen of an object, with modifiers and shape
        keys applied, and not its mesh; see `visible`.
    source_of : callable
        ``source_of(obj)`` gives the object of which that is read instead, if there is one.
    writes : bool
        Whether the meshes will be changed, so that linked ones are left alone.

    Returns
    -------
    targets : list of MeshTarget
    skipped : list of str
        A sentence for each object that was left alone.

    Raises
    ------
    Refused
        If visible shapes are requested outside Object Mode.
    """

    def read_target(obj: bpy.types.Object, mode: str) -> MeshTarget:
        if obj in seen:
            return read_visible(obj, mode)
        if writes:
            skip_if(mesh_refusal(obj.data))
        check_readable(obj)
        return target_of(obj, *read(obj, mode, parameters))

    def read_visible(obj: bpy.types.Object, mode: str) -> MeshTarget:
        from .visible import shown

        check_in_object_mode(obj)
        source = source_of(obj) or obj
        with shown(source) as found:
            if source.data.polygons and not found.data.polygons:
                raise Skipped(
                    "its modifiers leave no faces, as instances are not real; add a Realize"
                    " Instances node, or hide the modifier"
                )
            check_readable(found)
            return replace(target_of(obj, *read(found, mode, parameters)), is_seen=True)

    def target_of(obj: bpy.types.Object, place: Any, surface: Surface) -> MeshTarget:
        return MeshTarget(obj.name, obj.session_uid, obj.data.session_uid, place, surface)

    no_meshes = _no_meshes(context)
    seen = [obj for obj in mesh_objects(context) if is_seen(obj)]
    if seen and context.mode != "OBJECT":
        raise Refused("New objects are made in Object Mode; go there, or choose another output.")
    # Objects with the same mesh may look different.
    meshes = {obj.data: obj for obj in reversed(mesh_objects(context)) if obj not in seen}
    objects = [obj for obj in mesh_objects(context) if obj in seen or obj == meshes[obj.data]]
    try:
        targets, left = read_each(context, objects, read_target)
    except Skipped as reason:
        return [], sentences([(context.object.name, str(reason))])
    return targets, sentences(no_meshes + left)


def read_each(
    context: bpy.types.Context, objects: list[bpy.types.Object], read: Callable[..., Any]
) -> tuple[list[Any], list[tuple[str, str]]]:
    """Read objects by ``read(obj, mode)``, in Object Mode; `mode` is the one that was left.

    Returns
    -------
    found : list
        What was read.
    left : list of (str, str)
        Name of each object that was left alone, and the reason.

    Raises
    ------
    Skipped
        If leaving Sculpt Mode would turn dynamic topology off.
    """
    check_leaving(context)
    mode = context.mode
    found, left = [], []
    with object_mode(context):
        for obj in objects:
            try:
                found.append(read(obj, mode))
            except Skipped as reason:
                left.append((obj.name, str(reason)))
    return found, left


def read_active(
    context: bpy.types.Context, read: Callable[..., tuple], parameters: Any, *, writes: bool = True
) -> tuple[list[MeshTarget], list[str]]:
    """Read the active object alone, whatever else is selected; see `read_targets`."""
    only = [context.object]
    with context.temp_override(selected_objects=only, objects_in_mode=only):
        return read_targets(bpy.context, read, parameters, writes=writes)


def _no_meshes(context: bpy.types.Context) -> list[tuple[str, str]]:
    """List selected objects with a surface that are not meshes, and how to convert them."""
    found = []
    for obj in context.selected_objects if context.mode == "OBJECT" else []:
        if obj.type in CONVERTIBLE:
            reason = Skipped("it is no mesh; convert it first (Object > Convert > Mesh)")
        elif obj.instance_type == "COLLECTION" and obj.instance_collection is not None:
            reason = Skipped(
                "it shows instances of a collection; make them real (Object > Apply > Make"
                " Instances Real), or select the objects in the collection"
            )
        else:
            continue
        found.append((obj.name, str(reason)))
    return found


def read_positions(mesh: bpy.types.Mesh) -> npt.NDArray[np.float32]:
    """Read vertex positions: (n, 3)."""
    return arrays.read_attribute(mesh.attributes["position"])


def write_positions(mesh: bpy.types.Mesh, positions: npt.NDArray[np.float32]) -> None:
    """Write vertex positions; call ``mesh.update()`` afterwards."""
    arrays.write_attribute(mesh.attributes["position"], positions)


def read_corner_vertices(mesh: bpy.types.Mesh) -> npt.NDArray[np.int32]:
    """Read the vertex of each face corner: (number of corners,)."""
    return arrays.read_attribute(mesh.attributes[".corner_vert"])


def read_triangle_corners(mesh: bpy.types.Mesh) -> npt.NDArray[np.int32]:
    """Read the triangles that Blender cuts the faces into, as face corners: (m, 3)."""
    if len(mesh.loops) == 3 * len(mesh.polygons):  # triangles already: 100 times faster
        return np.arange(len(mesh.loops), dtype=np.int32).reshape(-1, 3)
    return _view_triangle_corners(mesh).copy()


def read_triangles(mesh: bpy.types.Mesh) -> npt.NDArray[np.int32]:
    """Read the triangles as vertices: (m, 3)."""
    if len(mesh.loops) == 3 * len(mesh.polygons):
        return read_corner_vertices(mesh).reshape(-1, 3)
    corners, vertices = _view_triangle_corners(mesh), read_corner_vertices(mesh)
    triangles = np.empty(corners.shape, np.int32)
    for first in range(0, len(corners), _AT_ONCE):
        triangles[first : first + _AT_ONCE] = vertices[corners[first : first + _AT_ONCE]]
    return triangles


def _view_triangle_corners(mesh: bpy.types.Mesh) -> npt.NDArray[np.int32]:
    # See `arrays.view_triples`.
    mesh.calc_loop_triangles()
    return arrays.view_triples(mesh.loop_triangles, "loops")


def read_edges(mesh: bpy.types.Mesh) -> npt.NDArray[np.int32] | None:
    """Read the vertices of the edges: (k, 2); None if all faces are triangles."""
    if len(mesh.loops) == 3 * len(mesh.polygons):
        return None
    return arrays.read_attribute(mesh.attributes[".edge_verts"])


def lengths_in_world(obj: bpy.types.Object) -> npt.NDArray[np.float64]:
    """Return the object's scale and shear, after which lengths are measured: (3, 3).

    Raises
    ------
    Skipped
        If the scale is zero along an axis, or anything is no number.
    """
    # Rotation and uniform scale change nothing, so they are left out: no rounding.
    matrix = matrix_in_world(obj)[:3, :3]
    stretches = np.linalg.svd(matrix, compute_uv=False)
    if stretches[0] <= (1.0 + _UNIFORM) * stretches[-1]:
        return np.identity(3)
    return matrix / stretches[0]


def lengths_of_shape(
    obj: bpy.types.Object,
    positions: npt.NDArray[np.float32],
    triangles: npt.NDArray[np.int32],
) -> npt.NDArray[np.float64]:
    """Return that after which lengths of a shape are measured, as in `even_lengths`: (3, 3).

    Raises
    ------
    Skipped
        As `lengths_in_world` does.
    """
    return even_lengths(positions, triangles, lengths_in_world(obj))


def scale_in_world(obj: bpy.types.Object) -> float:
    """Return what lengths after `lengths_in_world` or `lengths_of_shape` are multiplied with."""
    matrix = np.array(obj.matrix_world, dtype=np.float64)[:3, :3]
    return float(np.linalg.svd(matrix, compute_uv=False)[0])


def matrix_in_world(obj: bpy.types.Object) -> npt.NDArray[np.float64]:
    """Return the matrix that brings the object's points into the world: (4, 4).

    Raises
    ------
    Skipped
        If the scale is zero along an axis, or anything is no number.
    """
    matrix = np.array(obj.matrix_world, dtype=np.float64)
    if not np.isfinite(matrix).all():
        raise Skipped(
            "its transform holds NaN or infinity; set location, rotation and scale anew, and look"
            " at its drivers and constraints"
        )
    stretches = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    if not stretches[-1] > _SINGULAR * stretches[0]:
        raise Skipped("its scale is zero along an axis; set a scale that is not zero")
    return matrix


def check_readable(obj: bpy.types.Object) -> None:
    """Raise `Skipped` for an object whose faces cannot be read."""
    check_in_object_mode(obj)
    if not obj.data.polygons:
        raise Skipped("it has no faces; add some, or select another object")


def check_finite(positions: npt.NDArray) -> None:
    """Raise `Skipped` if a vertex is at NaN or infinity.

    The core says so, too, but does not know the objects that are joined for it.
    """
    is_finite = np.isfinite(positions).all(axis=1)
    if not is_finite.all():
        text = "Vertex {number} has no valid position (NaN or infinity); delete or move it."
        raise Skipped(as_reason(pgettext_rpt(text).format(number=int(np.argmin(is_finite)))))


def check_in_object_mode(obj: bpy.types.Object) -> None:
    """Raise `Skipped` for an object in another mode."""
    if obj.mode != "OBJECT":
        mode = pgettext_iface(f"{obj.mode.replace('_', ' ').title()} Mode")  # as on screen
        raise Skipped("it is in {mode}; switch it to Object Mode first", mode=mode)
    if obj.data.is_editmode:
        raise Skipped("another object with its mesh is in Edit Mode; switch that to Object Mode")
