# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes on disk, outside Blender.

OBJ, PLY, GLB and glTF files that keep their format are copied with new positions and normals, or
with new colors; everything else stays as it was (polygons, groups, materials, UVs, animations,
unknown properties, comments). Other files go through trimesh, which only has triangles.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from ..base.progress import phase, reporting
from ..errors import InvalidMesh, InvalidSignal, ShockError
from ..mesh.triangle_mesh import TriangleMesh
from ..mesh.weld import weld
from ..sparse.components import connected_components
from .document import Document, Floats, InPlaceDocument, Ints
from .formats.mesh.gltf import GltfFile
from .formats.mesh.obj import ObjFile
from .formats.mesh.ply import PlyFile, PlyVertices
from .formats.mesh.trimesh import ENDINGS, SceneFile
from .output import DEFAULTS, Options, Outcome, staged
from .reading import check_ending, check_source, check_target, reading, reading_back
from .staging import tidy

AnyDocument = TypeVar("AnyDocument", bound=Document)
IN_PLACE: dict[str, Callable[[Path], InPlaceDocument]] = {
    ".obj": ObjFile,
    ".ply": PlyFile,
    ".glb": GltfFile,
    ".gltf": GltfFile,
}

_LEAST_MASK = 0.01  # flags of 0 and 1 in whole numbers would protect nearly all
_ROUNDING = 1e-7  # differences of colors that another order of summation causes


def filter_mesh_file(
    function: Callable[..., Floats],
    source: str | Path,
    target: str | Path,
    options: Options = DEFAULTS,
) -> Outcome:
    """Move the vertices of a mesh file and write it to another.

    Vertices at exactly the same position move together, so that files whose vertices are split
    along UV seams do not crack open. Objects that share no vertex are filtered separately.

    Parameters
    ----------
    function : callable
        ``function(mesh, mask=None)`` returns new positions; see `registry.Filter.function`.
    source, target : path
        PLY, OBJ, STL, OFF, GLB or glTF files. `target` appears when it is complete.
    options : Options
        Masks, and whether to replace files.

    Returns
    -------
    Outcome
        Counts, and notes on what was lost.

    Raises
    ------
    ShockError
        If a file cannot be read or written, or as `function` does.
    """
    source, target = Path(source), Path(target)
    check_target(target, ENDINGS)
    readers = [IN_PLACE.get(path.suffix.lower()) for path in (source, target)]
    reader = readers[0] if readers[0] == readers[1] else None
    document = read_document(source, reader or SceneFile, options.any_size)
    weights = _read_mask(source, options)
    with reporting(options.progress):
        result = filtered(document, weld(document.vertices), function, weights)
    positions = np.where(result == document.vertices, document.vertices, result)  # 0.0 may be -0.0
    moved = (positions != document.vertices).any(axis=1)
    with staged(target, options.overwrite, document.own_files(target)) as path:
        notes = document.save(path, positions, moved)
        read_back(document, path, positions)
    return Outcome(len(positions), int(moved.sum()), tuple(notes))


def filter_colors_file(
    function: Callable[..., Floats],
    source: str | Path,
    target: str | Path,
    options: Options = DEFAULTS,
) -> Outcome:
    """Change the vertex colors of a mesh file and write it to another of the same format.

    Vertices at exactly the same position with the same color count as one, so that UV seams do not
    show; where colors differ at a position, they jump, and nothing flows across. Opacity and
    everything else stay as they are. Whole numbers of 16 or 32 bits in PLY files count from 0 to
    255 unless one is greater. Where none is any more, a comment in the header says that they count
    to the maximum of their type.

    Parameters
    ----------
    function : callable
        ``function(mesh, colors, mask=None)`` returns new colors; see `registry.Filter.function`.
    source, target : path
        PLY, OBJ, GLB or glTF files, both of the same format.
    options : Options
        As in `filter_mesh_file`.

    Returns
    -------
    Outcome
        Counts, and notes on what was lost.

    Raises
    ------
    InvalidSignal
        If no vertex has a color.
    ShockError
        As in `filter_mesh_file`.
    """
    source, target = Path(source), Path(target)
    check_target(target, ENDINGS)
    for path in (source, target):
        check_ending(path, IN_PLACE, "such files cannot be given other vertex colors")
    ending = target.suffix.lower()
    if source.suffix.lower() != ending:
        raise ShockError(
            f"{target}: colors are written in the format of the input only; end it in"
            f" {source.suffix}, or use Blender."
        )
    document = read_document(source, IN_PLACE[ending], options.any_size)
    with reading(source):
        colors = document.read_colors()
    if np.isinf(colors).any():
        raise InvalidSignal(f"{source} holds infinite vertex colors; repair or remove them.")
    if not np.isfinite(colors).any():
        raise InvalidSignal(
            f"{source} has no vertex colors; paint them, or bake a texture to them."
        )
    weights = _read_mask(source, options)
    with reporting(options.progress):
        result = filtered(document, _weld_colors(document, colors), function, weights, colors)
    result = np.where(abs(result - colors) < _ROUNDING, colors, result)
    with staged(target, options.overwrite, document.own_files(target)) as path:
        changed, notes = document.save_colors(path, result)
        read_back(document, path, document.vertices)
    done = "changed the color of {changed} of {total} vertices"
    return Outcome(len(colors), changed, tuple(notes), done)


def read_document(
    source: Path, reader: Callable[[Path], AnyDocument], any_size: bool = False
) -> AnyDocument:
    """Read a file; raises an error that says what is wrong with it."""
    tidy(source.parent)  # a killed run may have replaced half of a model
    check_source(source, ENDINGS)
    with reading(source, any_size):
        document = reader(source)
    if not len(document.faces):
        raise InvalidMesh(
            f"{source} holds no faces that can be read (point clouds, lines and triangle strips"
            " cannot); save it as a mesh of triangles or polygons."
        )
    if document.faces.min() < 0 or document.faces.max() >= len(document.vertices):
        raise InvalidMesh(f"{source}: a face names a vertex that is not there; repair the file.")
    if not np.isfinite(document.vertices).all():
        raise InvalidMesh(f"{source} holds NaN or infinite positions; repair or remove them.")
    return document


def read_back(document: Document, path: Path, positions: Floats) -> None:
    """Check that a file that was just written holds these positions."""
    with reading_back(path):
        found = document.read_back(path)
        rough = 1e-3 * abs(positions).max()  # for rounding in another space
        if found is not None and not (abs(found - positions) <= rough).all():
            raise ValueError("other positions")


# -------------------------------------------------------------------------------------- filtering


def _weld_colors(document: Document, colors: Floats) -> tuple[Ints, Ints]:
    """Find vertices with equal positions and equal colors, or both without one."""
    places = weld(document.vertices)[1]
    kinds = weld(np.where(np.isfinite(colors).all(axis=1, keepdims=True), colors, -1.0))[1]
    return weld(np.column_stack([places, kinds, np.zeros(len(kinds))]))


def filtered(
    document: Document,
    welded: tuple[Ints, Ints],
    function: Callable[..., Floats],
    weights: Floats | None,
    colors: Floats | None = None,
) -> Floats:
    """Filter each group of connected objects as a separate mesh.

    `welded` holds the first of each set of merged vertices, and the index of each vertex into
    these. If colors are given, they are filtered in place of the positions; faces at a vertex
    without a color, NaN, are left out.
    """
    first, index = welded
    points, faces = document.vertices[first], index[document.faces]
    values = points if colors is None else colors[first]
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    whole &= np.isfinite(values[faces]).all(axis=(1, 2))
    faces = faces[whole]
    lowest = np.full(len(first), np.inf)  # least weight of the merged vertices
    if weights is not None:
        np.minimum.at(lowest, index, weights)
    result = values.copy()
    groups = _groups(document.parts[whole], faces, len(points))
    for number, group in enumerate(groups):
        used, corners = np.unique(faces[group], return_inverse=True)
        try:
            mesh = TriangleMesh(points[used], corners.reshape(-1, 3))
        except InvalidMesh:
            if len(groups) == 1:
                raise
            continue  # an object without a surface does not stop the others
        signal = () if colors is None else (values[used],)
        mask = None if weights is None else lowest[used]
        with phase(number / len(groups), (number + 1) / len(groups), "Filtering"):
            result[used] = function(mesh, *signal, mask=mask)
    return result[index]


def _groups(parts: Ints, faces: Ints, vertex_count: int) -> list[Ints]:
    """Group the faces by objects that are connected through shared vertices."""
    parts = np.unique(parts, return_inverse=True)[1].reshape(-1)
    part_count = int(parts.max(initial=0)) + 1
    if part_count == 1:
        return [np.arange(len(faces))]
    used = part_count + faces.reshape(-1)
    _, labels = connected_components(part_count + vertex_count, np.repeat(parts, 3), used)
    group = labels[parts]
    order = np.argsort(group, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(group[order])) + 1)


def _read_mask(source: Path, options: Options) -> Floats | None:
    name = options.mask
    if name is None:
        return None
    if source.suffix.lower() != ".ply":
        raise ShockError(f"{source}: masks are read from PLY files only; give one, or use Blender.")
    with reading(source):
        table = PlyVertices(source)
    if name not in table.names:
        raise ShockError(
            f"{source} has no vertex property {name!r}; it has: {', '.join(table.names)}."
        )
    weights = table.weights(name)
    kind, most = table.kind(name), weights.max(initial=0.0)
    if kind.kind in "iu" and 0.0 < most < _LEAST_MASK:
        largest = np.iinfo(kind).max
        raise ShockError(
            f"{source}: the mask {name!r} reaches {most * largest:.0f}, of {largest} that count"
            " fully; save it as float, from 0 to 1."
        )
    return 1.0 - weights if options.invert_mask else weights
