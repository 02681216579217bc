# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes on disk, outside Blender.

OBJ, PLY, GLB and glTF files that keep their format are copied with new positions and normals, or
with new colors; everything else stays as it was (polygons, groups, materials, UVs, animations,
unknown properties, comments). All else goes through trimesh, which knows triangles only.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from ..base.progress import ProgressCallback, phase, reporting
from ..errors import InvalidMesh, InvalidSignal, ShockError
from ..mesh.triangle_mesh import TriangleMesh
from ..mesh.weld import weld
from .document import Bools, Document, Floats, Ints, TexturedDocument
from .formats.gltf import GltfFile
from .formats.obj import ObjFile
from .formats.ply import PlyFile, PlyVertices
from .formats.trimesh import KEEPS, SceneFile
from .output import Outcome, check_folder, staged
from .reading import check_ending, check_file, reading

AnyDocument = TypeVar("AnyDocument", bound=Document)
IN_PLACE: dict[str, Callable[[Path], TexturedDocument]] = {
    ".obj": ObjFile,
    ".ply": PlyFile,
    ".glb": GltfFile,
    ".gltf": GltfFile,
}

_ROUNDING = 1e-7  # differences of colors that come from summing in another order


def filter_mesh_file(
    function: Callable[..., Floats],
    source: str | Path,
    target: str | Path,
    *,
    mask: str | None = None,
    invert_mask: bool = False,
    overwrite: bool = False,
    progress: ProgressCallback | None = None,
) -> Outcome:
    """Move the vertices of a mesh file and write it to another.

    Vertices at exactly the same place move together, so that files whose vertices are split
    along UV seams do not crack open. Objects that share no vertex are filtered on their own.

    Parameters
    ----------
    function : callable
        ``function(mesh, mask=None)`` returns new positions; see `registry.Filter.function`.
    source, target : path
        PLY, OBJ, STL, OFF, GLB or glTF files. `target` appears when it is complete.
    mask : str, optional
        Vertex property of a PLY file: 0 leaves a vertex where it is, 1 moves it fully. Whole
        numbers count in parts of their type's largest value.
    invert_mask : bool
        Use one minus the mask.
    overwrite : bool
        Replace files that exist.
    progress : callable, optional
        Called with (fraction, message); returns False to cancel.

    Returns
    -------
    Outcome
        Counts, and notes on what did not survive.

    Raises
    ------
    ShockError
        If a file cannot be read or written, or as `function` does.
    """
    source, target = Path(source), Path(target)
    _check_paths(source, target)
    ending = target.suffix.lower()
    keeps_format = source.suffix.lower() == ending
    document = read_document(source, IN_PLACE.get(ending, SceneFile) if keeps_format else SceneFile)
    weights = _read_mask(source, mask, invert_mask) if mask else None
    with reporting(progress):
        positions = _moved(document, function, weights)
    moved = (positions != document.vertices).any(axis=1)
    with staged(target, overwrite) as path:
        notes = document.save(path, positions, moved)
    return Outcome(len(positions), int(moved.sum()), tuple(notes))


def filter_colors_file(
    function: Callable[..., Floats],
    source: str | Path,
    target: str | Path,
    *,
    mask: str | None = None,
    invert_mask: bool = False,
    overwrite: bool = False,
    progress: ProgressCallback | None = None,
) -> Outcome:
    """Change the vertex colors of a mesh file and write it to another of the same format.

    Vertices at exactly the same place with the same color count as one, so that UV seams do not
    show; where colors differ at a place, they jump, and nothing flows across. Opacity and all
    else stay as they are.

    Parameters
    ----------
    function : callable
        ``function(mesh, colors, mask=None)`` returns new colors; see `registry.Filter.function`.
    source, target : path
        PLY, OBJ, GLB or glTF files, both of the same format.
    mask, invert_mask, overwrite, progress
        As in `filter_mesh_file`.

    Returns
    -------
    Outcome
        Counts, and notes on what did not survive.

    Raises
    ------
    InvalidSignal
        If no vertex has a color.
    ShockError
        As in `filter_mesh_file`.
    """
    source, target = Path(source), Path(target)
    _check_paths(source, target)
    ending = target.suffix.lower()
    for path in (source, target):
        if path.suffix.lower() not in IN_PLACE:
            raise ShockError(
                f"{path}: {path.suffix} files cannot be given other vertex colors; use one of"
                f" {', '.join(IN_PLACE)}."
            )
    if source.suffix.lower() != ending:
        raise ShockError(
            f"{target}: colors are written in the format of the input only; end it in"
            f" {source.suffix}, or use Blender."
        )
    document = read_document(source, IN_PLACE[ending])
    with reading(source):
        colors = document.read_colors()
    if not np.isfinite(colors).any():
        raise InvalidSignal(
            f"{source} has no vertex colors; paint them, or bake a texture to them."
        )
    weights = _read_mask(source, mask, invert_mask) if mask else None
    with reporting(progress):
        result = _recolored(document, colors, function, weights)
    with staged(target, overwrite) as path:
        changed, notes = document.save_colors(path, result)
    done = "changed the color of {changed} of {total} vertices"
    return Outcome(len(colors), changed, tuple(notes), done)


def _check_paths(source: Path, target: Path) -> None:
    check_mesh_file(source)
    check_ending(target, KEEPS)
    check_folder(target)


def check_mesh_file(path: Path) -> None:
    """Refuse what cannot be a mesh file that is there."""
    check_file(path)
    check_ending(path, KEEPS)


def read_document(source: Path, reader: Callable[[Path], AnyDocument]) -> AnyDocument:
    """Read a file, or say what is wrong with it."""
    with reading(source):
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


# -------------------------------------------------------------------------------------- filtering


def _moved(document: Document, function: Callable[..., Floats], weights: Floats | None) -> Floats:
    """Positions after filtering; vertices that do not move keep theirs bit for bit."""
    first, index = weld(document.vertices)
    places = document.vertices[first]

    def move(mesh: TriangleMesh, _: Floats, mask: Floats | None) -> Floats:
        return function(mesh, mask=mask)

    result = _filtered(document, (first, index), None, move, places, weights)[index]
    return np.where(result == document.vertices, document.vertices, result)


def _recolored(
    document: Document, colors: Floats, function: Callable[..., Floats], weights: Floats | None
) -> Floats:
    """Colors after filtering; NaN, for none, stays."""
    colored = np.isfinite(colors).all(axis=1)
    places = weld(document.vertices)[1]
    kinds = weld(np.where(colored[:, None], colors, -1.0))[1]
    first, index = weld(np.column_stack([places, kinds, np.zeros(len(kinds))]))
    usable = colored[document.faces].all(axis=1)

    def recolor(mesh: TriangleMesh, values: Floats, mask: Floats | None) -> Floats:
        return function(mesh, values, mask=mask)

    result = _filtered(document, (first, index), usable, recolor, colors[first], weights)[index]
    return np.where(abs(result - colors) < _ROUNDING, colors, result)


def _filtered(
    document: Document,
    welded: tuple[Ints, Ints],
    usable: Bools | None,
    function: Callable[[TriangleMesh, Floats, Floats | None], Floats],
    values: Floats,
    weights: Floats | None,
) -> Floats:
    """Filter each group of joined objects as a mesh of its own.

    `welded` holds the first of the vertices that are one, and the number of each vertex among
    these; `values` and the result have a row for each of them.
    """
    first, index = welded
    points, faces = document.vertices[first], index[document.faces]
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    if usable is not None:
        whole &= usable
    faces = faces[whole]
    if weights is not None:
        weights = _lowest(weights, index, len(first))
    result = values.copy()
    groups = _groups(document.parts[whole], faces, len(points))
    for number, group in enumerate(groups):
        used, corners = np.unique(faces[group], return_inverse=True)
        try:
            mesh = TriangleMesh(points[used], corners.reshape(-1, 3))
        except InvalidMesh:
            if len(groups) == 1:
                raise
            continue  # one object without a surface does not keep the others from theirs
        with phase(number / len(groups), (number + 1) / len(groups), "Filtering"):
            mask = None if weights is None else weights[used]
            result[used] = function(mesh, values[used], mask)
    return result


def _lowest(weights: Floats, index: Ints, count: int) -> Floats:
    """The lowest weight of the vertices that are one."""
    lowest = np.ones(count)
    np.minimum.at(lowest, index, weights)
    return lowest


def _groups(parts: Ints, faces: Ints, vertex_count: int) -> list[Ints]:
    """Numbers of the faces whose objects hang together by shared vertices, group by group."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    parts = np.unique(parts, return_inverse=True)[1].reshape(-1)
    part_count = int(parts.max(initial=0)) + 1
    if part_count == 1:
        return [np.arange(len(faces))]
    rows, columns = np.repeat(parts, 3), part_count + faces.reshape(-1)
    size = part_count + vertex_count
    links = coo_matrix((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(size, size))
    group = connected_components(links, directed=False)[1][parts]
    order = np.argsort(group, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(group[order])) + 1)


def _read_mask(source: Path, name: str, invert: bool) -> Floats:
    if source.suffix.lower() != ".ply":
        raise ShockError(f"{source}: masks are read from PLY files only; give one, or use Blender.")
    with reading(source):
        table = PlyVertices(source)
    if name not in table.names:
        raise ShockError(
            f"{source} has no vertex property {name!r}; it has: {', '.join(table.names)}."
        )
    weights = table.weights(name)
    return 1.0 - weights if invert else weights
