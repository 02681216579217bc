# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversion between Blender's collections and arrays.

Blender copies a whole array at once if its type is the stored one; any other type takes ten to a
hundred times as long.
"""

from __future__ import annotations

import ctypes
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

from .skipped import Skipped

_FEW = 1000
"""Elements that Blender is asked for one by one."""

_SAMPLED = 32

_STORED = {
    "BOOLEAN": ("value", 1, np.bool_),
    "INT": ("value", 1, np.int32),
    "INT16_2D": ("value", 2, np.int16),
    "INT32_2D": ("value", 2, np.int32),
    "FLOAT": ("value", 1, np.float32),
    "FLOAT_VECTOR": ("vector", 3, np.float32),
    "FLOAT_COLOR": ("color", 4, np.float32),
    "BYTE_COLOR": ("color_srgb", 4, np.float32),  # the values as they are stored
}
"""For each type of attribute: name of the property, its width, and its type."""


def check_same(
    now: npt.NDArray, then: npt.NDArray, reason: str = "it was changed meanwhile; run again"
) -> None:
    """Compare two arrays bit for bit, so that NaN equals itself.

    Raises
    ------
    Skipped
        With the reason, if they differ.
    """
    from ...core.base.memo import equal

    if not equal((now,), (then,)):
        raise Skipped(reason)


def check_same_parts(now: dict[Any, npt.NDArray], then: dict[Any, npt.NDArray]) -> None:
    """Compare the arrays of two dictionaries, as `check_same` does."""
    if now.keys() != then.keys():
        raise Skipped("it was changed meanwhile; run again")
    for part, values in now.items():
        check_same(values, then[part])


def read(
    collection: Any, name: str, width: int = 1, dtype: npt.DTypeLike = np.float32
) -> npt.NDArray:
    """Read a property of all elements: (n,), or (n, width) if the width is above 1."""
    flat = np.empty(width * len(collection), dtype=dtype)
    collection.foreach_get(name, flat)
    return flat if width == 1 else flat.reshape(-1, width)


def view_triples(collection: Any, name: str) -> npt.NDArray[np.int32]:
    """Return a property of three integers that each element consists of: (n, 3).

    Blender asks each element for it, which takes seconds for millions. They lie one after another
    in memory, and the result is a view of that, valid until Blender computes them anew; where a
    sample says otherwise, Blender is asked.
    """
    count = len(collection)
    if count < _FEW:
        return read(collection, name, 3, np.int32)
    first = collection[0].as_pointer()
    steps = [count // 2, count - 1]
    if [collection[i].as_pointer() - first for i in steps] != [12 * i for i in steps]:
        return read(collection, name, 3, np.int32)
    place = ctypes.cast(first, ctypes.POINTER(ctypes.c_int32))
    found = np.ctypeslib.as_array(place, (count, 3))
    sample = np.linspace(0, count - 1, _SAMPLED, dtype=np.intp)
    if any(tuple(getattr(collection[int(i)], name)) != tuple(found[i]) for i in sample):
        return read(collection, name, 3, np.int32)
    return found


def write(
    collection: Any, name: str, values: npt.NDArray, dtype: npt.DTypeLike = np.float32
) -> None:
    """Write a property of all elements."""
    collection.foreach_set(name, np.ascontiguousarray(values, dtype=dtype).reshape(-1))


def is_readable(attribute: bpy.types.Attribute) -> bool:
    """Whether this module can read the type of an attribute."""
    return attribute.data_type in _STORED


def stored(attribute: bpy.types.Attribute) -> tuple[Any, str, int, npt.DTypeLike]:
    """Return the arguments of `read` for an attribute."""
    return attribute.data, *_STORED[attribute.data_type]


def read_attribute(attribute: bpy.types.Attribute) -> npt.NDArray:
    """Read an attribute as it is stored: (n,) or (n, width)."""
    return read(*stored(attribute))


def write_attribute(attribute: bpy.types.Attribute, values: npt.NDArray) -> None:
    """Write an attribute; call ``mesh.update()`` afterwards."""
    data, name, _, dtype = stored(attribute)
    write(data, name, values, dtype)


def find_attribute(
    mesh: bpy.types.Mesh, name: str, data_type: str, domain: str
) -> bpy.types.Attribute | None:
    """Return a mesh's attribute of this name if it is of this type and on this domain."""
    attribute = mesh.attributes.get(name)
    if attribute is None or (attribute.data_type, attribute.domain) != (data_type, domain):
        return None
    return attribute


def find_or_add_attribute(
    mesh: bpy.types.Mesh, name: str, data_type: str, domain: str
) -> bpy.types.Attribute:
    """Return a mesh's attribute of this name, and replace it if it is of another kind."""
    attribute = find_attribute(mesh, name, data_type, domain)
    if attribute is not None:
        return attribute
    if name in mesh.attributes:
        mesh.attributes.remove(mesh.attributes[name])
    return mesh.attributes.new(name, data_type, domain)


def read_pixels(image: bpy.types.Image) -> npt.NDArray[np.float32]:
    """Read an image's pixels, from the bottom up: (h, w, channels)."""
    flat = np.empty(len(image.pixels), dtype=np.float32)
    image.pixels.foreach_get(flat)
    return flat.reshape(image.size[1], image.size[0], image.channels)


def write_pixels(image: bpy.types.Image, pixels: npt.NDArray[np.float32]) -> None:
    """Write an image's pixels; call ``image.update()`` afterwards."""
    image.pixels.foreach_set(np.ascontiguousarray(pixels, dtype=np.float32).reshape(-1))
