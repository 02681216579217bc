# SPDX-License-Identifier: GPL-3.0-or-later
"""The evaluated mesh of an object, with modifiers and shape keys applied, as a new object."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any

import bpy

from ....core.base.memo import equal
from .. import arrays
from .targets import MeshTarget, find
from .vertex_groups import carry

_NAME = "shock_filter"

_WRITTEN = ("position", "sharp_edge", "custom_normal")
"""Attributes that a run may change, besides colors."""

_DEFORMING = {"ARMATURE", "CURVE", "LATTICE"}
"""Kinds of parents that bend their children, as modifiers do."""

_TRANSFORM = (
    *("rotation_mode", "location", "rotation_euler", "rotation_quaternion", "rotation_axis_angle"),
    *("scale", "delta_location", "delta_rotation_euler", "delta_rotation_quaternion"),
    *("delta_scale", "parent", "parent_type", "parent_bone", "parent_vertices"),
    "matrix_parent_inverse",
)
"""Properties that place an object, besides its animation and constraints."""


@contextmanager
def copied(obj: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """Yield a temporary object, in no scene, whose mesh is the visible shape of another one.

    Parameters
    ----------
    obj : bpy.types.Object
        In Object Mode.
    """
    copy = _copy(obj)
    try:
        yield copy
    finally:
        _remove(copy)


@contextmanager
def shown(obj: bpy.types.Object) -> Iterator[Any]:
    """Yield an object that reads like that of `copied`, but faster.

    Blender redraws all windows when an object is added or removed, while the run starts. So an
    object is added only for those with vertex groups or shape keys.

    Parameters
    ----------
    obj : bpy.types.Object
        In Object Mode.
    """
    if obj.vertex_groups or obj.data.shape_keys is not None:
        with copied(obj) as copy:
            yield copy
        return
    with evaluated(obj) as (seen, graph):
        mesh = seen.to_mesh(depsgraph=graph)
        try:
            yield _Shown(obj, mesh)
        finally:
            seen.to_mesh_clear()


class _Shown:
    """An object with another mesh and without modifiers, to read."""

    modifiers = ()

    def __init__(self, obj: bpy.types.Object, mesh: bpy.types.Mesh) -> None:
        self._obj, self.data = obj, mesh

    def __getattr__(self, name: str) -> Any:
        return getattr(self._obj, name)

    def __contains__(self, key: str) -> bool:
        return key in self._obj


def write_new(
    target: MeshTarget,
    result: Any,
    write: Callable[[MeshTarget, Any], bpy.types.Object],
    suffix: str,
    *,
    only_changed: bool = False,
) -> bpy.types.Object:
    """Write a result into a new object in the place of the one that was read, which is hidden.

    Parameters
    ----------
    target, result
        As `write` takes them; what was read is a copy as `copied` gives it.
    write : callable
    suffix : str
        What follows the object's name in that of the new one.
    only_changed : bool
        Whether no object is added if the result changes nothing.

    Returns
    -------
    bpy.types.Object
        The new one, or that which was read if none was added.

    Raises
    ------
    Skipped
        As `write` does, and no object is added then.
    """
    obj = find(target)
    new = _copy(obj)
    try:
        mesh = new.data
        before = _contents(mesh)
        write(replace(target, object_uid=new.session_uid, mesh_uid=mesh.session_uid), result)
        after = _contents(mesh)
    except BaseException:
        _remove(new)
        raise
    alike = before.keys() == after.keys()
    if only_changed and alike and equal(tuple(before.values()), tuple(after.values())):
        _remove(new)
        return obj
    new.name = mesh.name = f"{obj.name} {suffix}"
    place(new, obj)
    return new


def write_into(
    target: MeshTarget,
    source: bpy.types.Object,
    result: Any,
    write: Callable[[MeshTarget, Any], bpy.types.Object],
    takes: Callable[[bpy.types.Object], bool],
) -> list[bpy.types.Object]:
    """Write a result of what is seen of another object into the one that was read.

    Its name, materials, modifiers and vertex groups of its own stay.

    Parameters
    ----------
    target, result
        As `write` takes them; what was read is a copy of `source` as `copied` gives it.
    source : bpy.types.Object
    write : callable
    takes : callable
        ``takes(other)`` says whether another object that shares the mesh of the one that was read
        gets the new one, too.

    Returns
    -------
    list of bpy.types.Object
        All that have the new mesh, first the one that was read.

    Raises
    ------
    Skipped
        As `write` does, and nothing has changed then.
    """
    obj = find(target)
    new, old = _copy(source), obj.data
    others = [each for each in bpy.data.objects if each.data == old and each != obj]
    users = [obj, *filter(takes, others)]
    carry(old, new)
    mesh = new.data
    try:
        write(replace(target, object_uid=new.session_uid, mesh_uid=mesh.session_uid), result)
        mesh.materials.clear()
        for material in old.materials:
            mesh.materials.append(material)
        name = old.name
        for user in users:
            user.data = mesh
    except BaseException:
        _remove(new)
        raise
    bpy.data.objects.remove(new)
    if not old.users:
        bpy.data.meshes.remove(old)
        mesh.name = name
    return users


def _contents(mesh: bpy.types.Mesh) -> dict[str, Any]:
    found = [mesh.attributes.get(name) for name in _WRITTEN] + list(mesh.color_attributes)
    known = [each for each in found if each is not None and arrays.is_readable(each)]
    return {each.name: arrays.read_attribute(each) for each in known}


def _copy(obj: bpy.types.Object) -> bpy.types.Object:
    with evaluated(obj) as (seen, graph):
        # Blender evaluates the modifiers once more to preserve weights, which it may have left out.
        mesh = bpy.data.meshes.new_from_object(
            seen, preserve_all_data_layers=bool(obj.vertex_groups), depsgraph=graph
        )
    return with_mesh(obj, mesh)


def with_mesh(obj: bpy.types.Object, mesh: bpy.types.Mesh) -> bpy.types.Object:
    """Add an object in no scene that is like another one, with another mesh and no modifiers."""
    new = obj.copy()
    new.modifiers.clear()
    new.data = mesh
    _hold_shape(new)
    return new


def with_curves(obj: bpy.types.Object, curves: bpy.types.Curve, name: str) -> bpy.types.Object:
    """Add an object where another one is, which moves like it: parent, constraints, animation."""
    new = bpy.data.objects.new(name, curves)
    for each in _TRANSFORM:
        setattr(new, each, getattr(obj, each))
    _hold_shape(new)
    for constraint in obj.constraints:
        new.constraints.copy(constraint)
    link(new, obj)
    if obj.animation_data is not None:
        to_new = {"object": obj, "active_object": obj, "selected_editable_objects": [new]}
        with bpy.context.temp_override(**to_new):
            bpy.ops.object.make_links_data(type="ANIMATION")
    return new


def _hold_shape(new: bpy.types.Object) -> None:
    # Follow the parent as a whole.
    if new.parent_type in _DEFORMING:
        new.parent_type = "OBJECT"


@contextmanager
def evaluated(
    obj: bpy.types.Object,
) -> Iterator[tuple[bpy.types.Object, bpy.types.Depsgraph]]:
    """Yield the evaluated object, in a temporary scene if Blender does not do it itself."""
    if is_evaluated(obj, bpy.context.view_layer):
        graph = bpy.context.evaluated_depsgraph_get()
        yield obj.evaluated_get(graph), graph
        return
    with ExitStack() as stack:
        other = obj.copy()
        stack.callback(bpy.data.objects.remove, other)
        other.hide_viewport = False
        scene = bpy.data.scenes.new(_NAME)
        stack.callback(bpy.data.scenes.remove, scene)
        scene.frame_set(bpy.context.scene.frame_current)
        scene.collection.objects.link(other)
        layer = scene.view_layers[0]
        layer.update()
        yield other.evaluated_get(layer.depsgraph), layer.depsgraph


def is_evaluated(obj: bpy.types.Object, layer: bpy.types.ViewLayer) -> bool:
    """Whether Blender evaluates an object: hidden ones, but not disabled ones."""
    if obj.hide_viewport or obj.name not in layer.objects:
        return False
    collections = [layer.layer_collection]
    for each in collections:
        collections += each.children
    return any(each.is_visible and obj.name in each.collection.objects for each in collections)


def _remove(new: bpy.types.Object) -> None:
    mesh = new.data
    bpy.data.objects.remove(new)
    bpy.data.meshes.remove(mesh)


def place(new: bpy.types.Object, old: bpy.types.Object) -> None:
    """Add an object that is seen, selected and rendered where the old one was."""
    link(new, old)
    bpy.context.view_layer.update()  # it lists new objects then
    show(new, old)


def link(new: bpy.types.Object, old: bpy.types.Object) -> None:
    """Add an object to the collections of another one, but for linked and overridden ones."""
    scene = bpy.context.scene.collection
    found = [each for each in old.users_collection if _takes_objects(each)]
    found = found or [each for each in (bpy.context.collection, scene) if _takes_objects(each)][:1]
    for collection in found:
        collection.objects.link(new)


def _takes_objects(collection: bpy.types.Collection) -> bool:
    return collection.library is None and collection.override_library is None


def show(obj: bpy.types.Object, other: bpy.types.Object) -> None:
    """Show and select an object in place of another one, which is hidden."""
    layer = bpy.context.view_layer
    space = bpy.context.space_data
    if space is not None and space.type == "VIEW_3D" and space.local_view is not None:
        obj.local_view_set(space, True)
    obj.hide_render = False
    if obj.name in layer.objects:
        obj.hide_set(False)
        obj.select_set(True)
        if layer.objects.active in (None, other):
            layer.objects.active = obj
    if other.name in layer.objects:
        other.select_set(False)
        other.hide_set(True)
    other.hide_render = True
    for each in (each for scene in obj.users_scene for each in scene.view_layers):
        if each != layer and other.name in each.objects:
            if other.hide_get(view_layer=each):
                each.update()  # it lists new objects then
                if obj.name in each.objects:
                    obj.hide_set(True, view_layer=each)
            else:
                other.hide_set(True, view_layer=each)
                if obj.name in each.objects:
                    obj.hide_set(False, view_layer=each)
