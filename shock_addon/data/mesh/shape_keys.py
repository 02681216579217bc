# SPDX-License-Identifier: GPL-3.0-or-later
"""Shape keys: which shape is sharpened, and where the result goes.

Output "Mesh" sharpens the active key. Keys that are relative to it move along, so that what
they add stays the same; so if the Basis is active, the whole object looks sharpened, as when
the Basis is edited in Edit Mode. Output "New Shape Key" sharpens the shape that is seen, and the
new key holds the change from it: at value 1 the sharpened shape is seen. That is all keys mixed,
or the active key alone if it is pinned, and in Edit Mode, which shows only that one.
"""

from __future__ import annotations

import bpy
import numpy as np
import numpy.typing as npt

from .. import arrays
from ..skipped import Skipped
from .vertex_groups import group_weights

Positions = npt.NDArray[np.float32]


def read(key: bpy.types.ShapeKey) -> Positions:
    """Read a key's positions: (n, 3)."""
    return arrays.read(key.points, "co", 3)


def write(key: bpy.types.ShapeKey, positions: Positions) -> None:
    """Write a key's positions."""
    arrays.write(key.points, "co", positions)


def active_key(obj: bpy.types.Object) -> bpy.types.ShapeKey:
    """Return the key that editing the object changes.

    Raises
    ------
    Skipped
        If the key is locked.
    """
    key = _active(obj)
    if key.lock_shape:
        raise Skipped(
            "its shape key {name!r} is locked; unlock it or choose New Shape Key", name=key.name
        )
    return key


def _active(obj: bpy.types.Object) -> bpy.types.ShapeKey:
    return obj.active_shape_key or obj.data.shape_keys.reference_key


def visible_shape(obj: bpy.types.Object, mode: str) -> Positions:
    """Return the shape that Blender shows in a mode, as in ``bpy.context.mode``: (n, 3).

    Raises
    ------
    Skipped
        If the keys are absolute: a new key has no slider there.
    """
    keys = obj.data.shape_keys
    if not keys.use_relative:
        raise Skipped("its shape keys are absolute; turn on Relative, or choose the output Mesh")
    alone = _shown_alone(obj, mode)
    if alone is None:
        return _mix(obj)
    shape = read(alone)
    if mode != "EDIT_MESH" and alone.vertex_group in obj.vertex_groups:
        basis = read(keys.reference_key)
        shape = basis + _weights(obj, alone) * (shape - basis)
    return shape


def _shown_alone(obj: bpy.types.Object, mode: str) -> bpy.types.ShapeKey | None:
    """Return the key that is shown instead of the mix, if one is."""
    keys, active = obj.data.shape_keys, _active(obj)
    if mode == "EDIT_MESH" and not obj.use_shape_key_edit_mode:
        return active
    if obj.show_only_shape_key:
        return keys.reference_key if active.mute else active
    return None


def are_weighted(obj: bpy.types.Object) -> bool:
    """Whether a shape key has a vertex group that limits it."""
    keys = obj.data.shape_keys
    return keys is not None and any(
        key.vertex_group in obj.vertex_groups for key in keys.key_blocks
    )


def _mix(obj: bpy.types.Object) -> Positions:
    keys = obj.data.shape_keys
    shape = read(keys.reference_key)
    for key in keys.key_blocks:
        if key == keys.reference_key or key.mute or key.value == 0.0:
            continue
        change = key.value * (read(key) - read(key.relative_key))
        if key.vertex_group in obj.vertex_groups:
            change *= _weights(obj, key)
        shape += change
    return shape


def _weights(obj: bpy.types.Object, key: bpy.types.ShapeKey) -> Positions:
    return group_weights(obj, key.vertex_group)[:, None].astype(np.float32)


def write_active(obj: bpy.types.Object, positions: Positions) -> None:
    """Write the active key, and move the keys that are relative to it along."""
    keys = obj.data.shape_keys
    active = active_key(obj)
    change = positions - read(active)
    if keys.use_relative:
        for key in _dependents(keys, active):
            write(key, read(key) + change)
    write(active, positions)
    keys.update_tag()


def add(obj: bpy.types.Object, name: str, old: Positions, new: Positions, mode: str) -> None:
    """Add a key with value 1 that turns the shape that is seen, `old`, into `new`.

    It is relative to the Basis, or to the key that is shown alone, which it replaces.
    """
    if obj.data.shape_keys is None:
        obj.shape_key_add(name="Basis", from_mix=False)
    keys = obj.data.shape_keys
    alone = _shown_alone(obj, mode)
    base = keys.reference_key if alone is None or alone.vertex_group else alone
    key = obj.shape_key_add(name=name, from_mix=False)
    write(key, read(base) + (new - old) if alone is None else new)
    key.relative_key = base
    key.value = 1.0
    obj.active_shape_key_index = keys.key_blocks.find(key.name)
    keys.update_tag()


def _dependents(keys: bpy.types.Key, active: bpy.types.ShapeKey) -> list[bpy.types.ShapeKey]:
    found = [active]
    for base in found:
        for key in keys.key_blocks:
            if key.relative_key == base and key not in [keys.reference_key, *found]:
                found.append(key)
    return found[1:]
