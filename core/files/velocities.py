# SPDX-License-Identifier: GPL-3.0-or-later
"""Velocities on disk: flow maps, arrays, NetCDF and Zarr, and vectors of meshes.

They are converted to the conventions of the core: rows from top to bottom, components to the right
and up, key frames as the first axis, NaN where undefined.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..advection.flow_maps import flow_map_velocity, turned
from ..errors import ShockError
from ..mesh.triangle_mesh import TriangleMesh
from .formats.array.grids import GRIDS, read_grid
from .formats.mesh.ply import PlyVertices
from .image_formats import read_pixels
from .reading import check_claim, check_ending, check_source, reading
from .textures import read_textured_mesh

Velocities = npt.NDArray[Any]

MAPS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr", ".bmp", ".webp")
_NUMPY = (".npy", ".npz")
MESHES = (".ply",)
_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0}
_OF_ARCHIVES = "velocity"
_NORMALS = "n"


@dataclass(frozen=True)
class How:
    """How a file is interpreted.

    Attributes
    ----------
    y_axis : str
        ``"up"`` or ``"down"``: the direction of the second component of flow maps and arrays.
    variables : (str, str), optional
        Names of both components in NetCDF, Zarr and .npz files.
    select : mapping
        Index to take along a dimension of NetCDF and Zarr files, by its name, from 0.
    attribute : str, optional
        Name of the vectors in a mesh file.
    material : str, optional
        Only the faces of this material.
    any_size : bool
        As in `Options`.
    """

    y_axis: str = "up"
    variables: Sequence[str] | None = None
    select: Mapping[str, int] = field(default_factory=dict)
    attribute: str | None = None
    material: str | None = None
    any_size: bool = False


@dataclass(frozen=True)
class PlaneFlow:
    """A velocity in the plane.

    Attributes
    ----------
    velocity : (h, w, 2) or (k, h, w, 2) array
    notes : tuple of str
        What a person should know.
    """

    velocity: Velocities
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class SurfaceFlow:
    """Vectors at the vertices of a mesh with texture coordinates."""

    mesh: TriangleMesh
    uv: npt.NDArray[np.float64]
    vectors: npt.NDArray[np.float64]
    notes: tuple[str, ...] = ()


def read_velocity(path: str | Path, how: How | None = None) -> PlaneFlow | SurfaceFlow:
    """Read a velocity field.

    Parameters
    ----------
    path : path
        A flow map (an image: red to the right, green up, the middle is 0); an array (.npy) of
        shape (h, w, 2) or (k, h, w, 2); an archive (.npz) of one, or of both components; a NetCDF
        or Zarr file; or a PLY file with texture coordinates and vectors at its vertices.
    how : How, optional

    Raises
    ------
    ShockError
        If the file cannot be read, or does not hold a velocity.
    """
    path, how = Path(path), how or How()
    ending = path.suffix.lower()
    check_ending(path, (*MAPS, *_NUMPY, *GRIDS, *MESHES), "velocities are not read from such files")
    if ending in GRIDS:
        return PlaneFlow(*read_grid(path, how.variables, how.select, how.any_size))
    check_source(path, (ending,))
    if ending in MESHES:
        return _of_mesh(path, how)
    if ending in MAPS:
        return _of_map(path, how)
    velocity = _of_array(path, how) if ending == ".npy" else _of_archive(path, how)
    if velocity.ndim not in (3, 4) or velocity.shape[-1] != 2 or not velocity.size:
        raise ShockError(
            f"{path} has the shape {velocity.shape}; save (rows, columns, 2), or (moments, rows,"
            " columns, 2)."
        )
    return PlaneFlow(turned(velocity, how.y_axis))


def _of_map(path: Path, how: How) -> PlaneFlow:
    pixels = read_pixels(path, how.any_size)
    if pixels.ndim == 2 or (pixels.shape[2] == 2 and path.suffix.lower() not in (".tif", ".tiff")):
        raise ShockError(f"{path} is gray; a flow map has its velocity in red and green.")
    velocity = flow_map_velocity(pixels, y_axis=how.y_axis)
    return PlaneFlow(velocity, () if np.nan_to_num(velocity).any() else ("the flow is 0",))


def _of_array(path: Path, how: How) -> Velocities:
    with reading(path, how.any_size):
        found = np.load(path, mmap_mode="c")
    if not isinstance(found, np.ndarray):
        found.close()
        raise ShockError(f"{path} is an archive of arrays; rename it to .npz.")
    return _real(path, found)


def _of_archive(path: Path, how: How) -> Velocities:
    with reading(path, how.any_size):
        sizes = _claimed_sizes(path)
    names = list(sizes)
    pair = tuple(how.variables or ("u", "v"))
    if set(pair) <= set(names):
        first, second = _members(path, how, pair, sizes)
        if first.shape != second.shape:
            raise ShockError(
                f"{path}: {pair[0]} has the shape {first.shape}, {pair[1]} {second.shape}; save"
                " both with one."
            )
        return np.stack([first, second], axis=-1)
    if how.variables is None and (_OF_ARCHIVES in names or len(names) == 1):
        name = _OF_ARCHIVES if _OF_ARCHIVES in names else names[0]
        (velocity,) = _members(path, how, (name,), sizes)
        return velocity
    raise ShockError(
        f"{path} has no {' and '.join(pair)}; it has: {', '.join(names) or 'nothing'}. Name both"
        " with --variables."
    )


def _claimed_sizes(path: Path) -> dict[str, int]:
    """Return the bytes that each array of an archive claims, by its name."""
    if not zipfile.is_zipfile(path):
        raise ShockError(f"{path} is no archive of arrays; rename it to .npy if it is one array.")
    sizes = {}
    with zipfile.ZipFile(path) as archive:
        for member in archive.infolist():
            with archive.open(member) as stream:
                version = np.lib.format.read_magic(stream)
                read = _HEADERS.get(version, np.lib.format.read_array_header_2_0)
                shape, _, kind = read(stream)
            claimed = math.prod(shape) * kind.itemsize
            sizes[member.filename.removesuffix(".npy")] = max(claimed, member.file_size)
    return sizes


def _members(
    path: Path, how: How, names: Sequence[str], sizes: Mapping[str, int]
) -> list[Velocities]:
    with reading(path, how.any_size):
        check_claim(path, 2.0 * sum(sizes[name] for name in names))  # both are stacked
        with np.load(path) as archive:
            return [_real(path, archive[name]) for name in names]


def _real(path: Path, values: Velocities) -> Velocities:
    if values.dtype.kind not in "fiu":
        raise ShockError(f"{path} holds values of type {values.dtype}; save real numbers.")
    return values


def _of_mesh(path: Path, how: How) -> SurfaceFlow:
    surface = read_textured_mesh(path, how.material, how.any_size)
    with reading(path, how.any_size):
        table = PlyVertices(path)
    found = _triples(table.names)
    name = how.attribute
    if name is None and len(found) == 1:
        name = next(iter(found))
    if name not in found:
        having = ", ".join(found) or "none"
        what = f"vectors named {name!r}" if name else "vectors to be chosen at once"
        raise ShockError(
            f"{path} has no {what}; it has: {having}. Name one with --attribute; properties such as"
            " flow_x, flow_y, flow_z make one."
        )
    with reading(path):
        vectors = table.columns(*found[name])
    return SurfaceFlow(surface.mesh, surface.uv, vectors, surface.notes)


def _triples(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Find properties that are components of vectors, by the common part of their names."""
    found = {}
    for first in names:
        stem = first[:-1]
        triple = tuple(stem + axis for axis in "xyz")
        if first.endswith("x") and stem not in ("", _NORMALS) and set(triple) <= set(names):
            found[stem.rstrip("_")] = triple
    return found
