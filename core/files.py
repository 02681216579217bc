# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes on disk, outside Blender.

OBJ and PLY files that keep their format are rewritten in place: positions change, normals are
computed anew, and everything else stays byte for byte (polygons, groups, materials, UVs, colors,
unknown properties, comments). All else goes through trimesh, which knows triangles only.
"""

from __future__ import annotations

import contextlib
import filecmp
import json
import os
import re
import shutil
import struct
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt

from . import shock
from .errors import InvalidMesh, InvalidSettings, ShockError
from .mesh import TriangleMesh, weld
from .settings import GeometrySettings

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Progress = Callable[[float, str], bool]

# What each format can hold besides triangles, as far as trimesh writes it.
KEEPS = {
    ".glb": {"colors", "UVs", "materials", "names"},
    ".gltf": {"colors", "UVs", "materials", "names"},
    ".obj": {"colors", "UVs", "materials"},
    ".ply": {"colors", "UVs"},
    ".off": set(),
    ".stl": set(),
}


@dataclass(frozen=True)
class Outcome:
    """What was done with a file.

    Attributes
    ----------
    vertices, moved : int
        Number of vertices, and of those that are elsewhere now.
    notes : tuple of str
        What a person should know: what did not survive, what was computed anew.
    """

    vertices: int
    moved: int
    notes: tuple[str, ...] = ()


def sharpen_file(
    source: str | Path,
    target: str | Path,
    settings: GeometrySettings | None = None,
    *,
    mask: str | None = None,
    invert_mask: bool = False,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Outcome:
    """Sharpen the geometry of a mesh file and write it to another.

    Vertices at exactly the same place move together, so that files whose vertices are split
    along UV seams do not crack open. Objects that share no vertex are sharpened on their own.

    Parameters
    ----------
    source, target : path
        PLY, OBJ, STL, OFF, GLB or glTF files. `target` appears when it is complete.
    settings : GeometrySettings, optional
        Strength and all else; the defaults if left out.
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
    """
    source, target = Path(source), Path(target)
    _check_paths(source, target)
    document = _read(source, target.suffix.lower())
    weights = _read_mask(source, mask, invert_mask, len(document.vertices)) if mask else None
    positions = _sharpen(document, settings or GeometrySettings(), weights, progress)
    moved = (positions != document.vertices).any(axis=1)
    with staged(target, overwrite) as path:
        notes = document.save(path, positions, moved)
    return Outcome(len(positions), int(moved.sum()), tuple(notes))


@contextlib.contextmanager
def staged(target: Path, overwrite: bool) -> Iterator[Path]:
    """Give a path to write to, and move what was written there to `target` at the end.

    Files written beside it (materials, textures) come along. If anything fails, nothing of it
    is left and `target` is as it was.
    """
    target = target.absolute()
    with tempfile.TemporaryDirectory(prefix=".shock-filter-", dir=target.parent) as folder:
        stage = Path(folder) / target.name
        yield stage
        written = sorted(path for path in Path(folder).rglob("*") if path.is_file())
        written.sort(key=stage.__eq__)  # the file itself comes last
        pairs = [(path, target.parent / path.relative_to(folder)) for path in written]
        pairs = [(new, old) for new, old in pairs if new == stage or not _same(new, old)]
        if not overwrite:
            for _, old in pairs:
                if old.exists():
                    raise ShockError(
                        f"{old} exists already; add --overwrite or choose another output."
                    )
        for new, old in pairs:
            old.parent.mkdir(exist_ok=True)
            os.replace(new, old)


def _same(new: Path, old: Path) -> bool:
    return old.is_file() and filecmp.cmp(new, old, shallow=False)


def _check_paths(source: Path, target: Path) -> None:
    known = ", ".join(KEEPS)
    if source.is_dir():
        raise ShockError(f"{source} is a folder; name the files in it.")
    if not source.exists():
        raise ShockError(f"There is no file {source}; check its name and folder.")
    for path in (source, target):
        if path.suffix.lower() not in KEEPS:
            raise ShockError(f"{path}: cannot handle this ending; use one of {known}.")
    if not target.absolute().parent.is_dir():
        raise ShockError(f"There is no folder {target.parent}; make it first.")


def _read(source: Path, ending: str) -> _Obj | _Ply | _Scene:
    in_place = {".obj": _Obj, ".ply": _Ply} if source.suffix.lower() == ending else {}
    try:
        document = in_place.get(ending, _Scene)(source)
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, struct.error) as error:
        if isinstance(error, ShockError):
            raise
        raise ShockError(f"{source} cannot be read; is it damaged? ({error})") from error
    if not len(document.faces):
        raise InvalidMesh(
            f"{source} holds no faces that can be read (point clouds, lines and triangle strips"
            " cannot); save it as a mesh of triangles or polygons."
        )
    if not np.isfinite(document.vertices).all():
        raise InvalidMesh(f"{source} holds NaN or infinite positions; repair or remove them.")
    return document


# ------------------------------------------------------------------------------------- sharpening


def _sharpen(
    document: _Obj | _Ply | _Scene,
    settings: GeometrySettings,
    weights: Floats | None,
    progress: Progress | None,
) -> Floats:
    """Positions after sharpening; vertices that do not move keep theirs bit for bit."""
    representatives, index = weld(document.vertices)
    welded = document.vertices[representatives]
    faces = index[document.faces]
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    faces = faces[whole]
    if weights is not None:
        split = weights
        weights = np.ones(len(welded))
        np.minimum.at(weights, index, split)
    result = welded.copy()
    groups = _groups(document.parts[whole], faces, len(welded))
    for done, group in enumerate(groups):
        used = np.zeros(len(welded), dtype=bool)
        used[faces[group]] = True
        number = np.cumsum(used) - 1
        mesh = TriangleMesh(welded[used], number[faces[group]])
        result[used] = shock.sharpen_geometry(
            mesh,
            settings,
            mask=None if weights is None else weights[used],
            progress=progress and _share(progress, done, len(groups)),
        )
    positions = result[index]
    return np.where(positions == document.vertices, document.vertices, positions)


def _share(progress: Progress, done: int, count: int) -> Progress:
    return lambda fraction, message: progress((done + fraction) / count, message)


def _groups(parts: Ints, faces: Ints, vertex_count: int) -> list[npt.NDArray[np.bool_]]:
    """Faces of the parts that share vertices, one mask a group; flat groups are left out."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    part_count = int(parts.max(initial=0)) + 1
    if part_count == 1:
        return [np.ones(len(faces), dtype=bool)]
    rows, columns = np.repeat(parts, 3), part_count + faces.reshape(-1)
    size = part_count + vertex_count
    links = coo_matrix((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(size, size))
    label = connected_components(links, directed=False)[1][parts]
    return [label == group for group in np.unique(label)]


def _normals(positions: Floats, triangles: Ints, keys: Ints, old: Floats) -> Floats:
    """Mean normal, weighted by area, of the triangle corners that share a key.

    `triangles` and `keys` are (t, 3); a key without area keeps its row of `old`.
    """
    a, b, c = (positions[triangles[:, corner]] for corner in range(3))
    crosses = np.cross(b - a, c - a)
    sums = np.zeros_like(old)
    for corner in range(3):
        for axis in range(3):
            sums[:, axis] += np.bincount(keys[:, corner], crosses[:, axis], minlength=len(old))
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.where(lengths > 0, sums / np.where(lengths > 0, lengths, 1.0), old)


def _vertex_normals(before: Floats, after: Floats, triangles: Ints, old: Floats) -> Floats:
    """New vertex normals: split vertices that shared place and normal share it again."""
    kept, key = np.unique(np.hstack([before, old]), axis=0, return_inverse=True)
    key = key.reshape(-1)
    return _normals(after, triangles, key[triangles], kept[:, 3:])[key]


_NEW_NORMALS = "normals were computed anew from the sharpened surface"


def _decimal(values: Floats) -> bytes:
    return b" ".join(b"%.12g" % value for value in values)


# -------------------------------------------------------------------------------------------- OBJ


class _Obj:
    """An OBJ file as lines; only the `v` lines of moved vertices and the normals are rewritten."""

    def __init__(self, path: Path) -> None:
        text = re.sub(rb"\\\r?\n", b" ", path.read_bytes())
        self.path = path
        self.lines = text.splitlines(keepends=True)
        self._vertex_lines: list[int] = []
        self._normal_lines: list[int] = []
        self._face_lines: list[int] = []
        corners: list[tuple[int, int]] = []  # vertex and normal of each corner, -1 for none
        sizes, parts, part = [], [], 0
        for number, line in enumerate(self.lines):
            word, _, rest = line.strip().partition(b" ")
            if b"\t" in word:
                word, _, rest = line.strip().partition(b"\t")
            if word == b"v":
                self._vertex_lines.append(number)
            elif word == b"vn":
                self._normal_lines.append(number)
            elif word == b"o":
                part += 1
            elif word == b"f":
                tokens = rest.partition(b"#")[0].split()
                self._face_lines.append(number)
                corners += map(self._corner, tokens)
                sizes.append(len(tokens))
                parts.append(part)
        self.vertices = self._numbers(self._vertex_lines)
        self._normal_values = self._numbers(self._normal_lines)
        self._corners = np.array(corners, dtype=np.int64).reshape(-1, 2)
        self._triangles, owner = _fans(np.array(sizes, dtype=np.int64))
        self.faces = self._corners[self._triangles, 0]
        self.parts = np.array(parts, dtype=np.int64)[owner]
        if len(corners) and not (
            0 <= self._corners[:, 0].min()
            and self._corners[:, 0].max() < len(self.vertices)
            and self._corners[:, 1].max() < len(self._normal_values)
        ):
            raise InvalidMesh(f"{path}: a face names a vertex or normal that is not there.")

    def _corner(self, token: bytes) -> tuple[int, int]:
        fields = token.split(b"/")
        vertex = int(fields[0])
        vertex += len(self._vertex_lines) if vertex < 0 else -1
        normal = int(fields[2]) if len(fields) == 3 and fields[2] else 0
        normal += len(self._normal_lines) if normal < 0 else -1
        return vertex, normal

    def _numbers(self, lines: list[int]) -> Floats:
        rows = [[float(word) for word in self.lines[n].split()[1:4]] for n in lines]
        return np.array(rows, dtype=np.float64).reshape(-1, 3)

    def save(self, path: Path, positions: Floats, moved: npt.NDArray[np.bool_]) -> list[str]:
        lines = list(self.lines)
        for vertex in np.flatnonzero(moved):
            number = self._vertex_lines[vertex]
            end = lines[number][len(lines[number].rstrip(b"\r\n")) :]
            extra = lines[number].split()[4:]
            lines[number] = b" ".join([b"v", _decimal(positions[vertex]), *extra]) + end
        fresh = bool(moved.any() and (self._corners[:, 1] >= 0).any())
        if fresh:
            self._renew_normals(lines, positions)
        path.write_bytes(b"".join(lines))
        return [*_copy_materials(self.path, self.lines, path.parent), *[_NEW_NORMALS] * fresh]

    def _renew_normals(self, lines: list[bytes], positions: Floats) -> None:
        # Corners that shared a vertex and a normal share it again: hard edges stay hard.
        pairs, keys = np.unique(self._corners, axis=0, return_inverse=True)
        keys = keys.reshape(-1)
        old = np.where(pairs[:, 1:] >= 0, self._normal_values[pairs[:, 1]], 0.0)
        values = _normals(positions, self.faces, keys[self._triangles], old)
        given = pairs[:, 1] >= 0
        number = np.cumsum(given)
        for line in self._normal_lines:
            lines[line] = b""
        key = iter(keys)
        for line in self._face_lines:
            body, mark, comment = lines[line].partition(b"#")
            tokens = body.split()[1:]
            end = b" " + mark + comment if mark else body[len(body.rstrip()) :]
            for k, token in enumerate(tokens):
                corner = next(key)
                if given[corner]:
                    tokens[k] = b"%b/%d" % (token.rpartition(b"/")[0], number[corner])
            lines[line] = b" ".join([b"f", *tokens]) + end
        first = self._face_lines[0]
        block = b"".join(b"vn " + _decimal(value) + b"\n" for value in values[given])
        lines[first] = block + lines[first]


def _fans(sizes: Ints) -> tuple[Ints, Ints]:
    """Cut polygons into fans: corner numbers (t, 3), and the polygon of each triangle."""
    counts = np.maximum(sizes - 2, 0)
    owner = np.repeat(np.arange(len(sizes)), counts)
    step = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    first = (np.cumsum(sizes) - sizes)[owner]
    return np.column_stack([first, first + step + 1, first + step + 2]), owner


def _copy_materials(source: Path, lines: list[bytes], folder: Path) -> list[str]:
    """Copy the material files that an OBJ names, and their textures, beside its copy."""
    missing = []
    for library in _named_files(source.parent, lines, rb"mtllib"):
        if not _copy_beside(source.parent, library, folder):
            missing.append(library)
            continue
        words = (source.parent / library).read_bytes().splitlines()
        for image in _named_files(source.parent, words, rb"map_\w+|bump|disp|decal|refl|norm"):
            if not _copy_beside(source.parent, image, folder):
                missing.append(image)
    return [f"not found, so not copied: {', '.join(missing)}"] if missing else []


def _named_files(folder: Path, lines: list[bytes], keyword: bytes) -> list[str]:
    # A name may hold spaces, and options may stand before it: the whole rest if there is such a
    # file, else the last word.
    pattern = re.compile(rb"\s*(?:" + keyword + rb")\s+(.+)", re.IGNORECASE)
    found = {match[1].strip().decode("utf-8", "replace") for match in map(pattern.match, lines) if match}
    return sorted(name if (folder / name).is_file() else name.split()[-1] for name in found)


def _copy_beside(folder: Path, name: str, target: Path) -> bool:
    relative = PurePosixPath(name.replace("\\", "/"))
    if relative.is_absolute() or ".." in relative.parts or not (folder / relative).is_file():
        return False
    (target / relative).parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(folder / relative, target / relative)
    return True


# -------------------------------------------------------------------------------------------- PLY

_PLY_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}


class _Ply:
    """A PLY file as bytes; only the positions and normals of its vertices are rewritten."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._table = _PlyVertices(path)
        (mesh,) = _load_scene(path).geometry.values() or [None]
        self.faces = np.asarray(getattr(mesh, "faces", np.empty((0, 3))), dtype=np.int64)
        self.vertices = self._table.columns("x", "y", "z")
        self.parts = np.zeros(len(self.faces), dtype=np.int64)

    def save(self, path: Path, positions: Floats, moved: npt.NDArray[np.bool_]) -> list[str]:
        table = self._table
        changes = dict(zip("xyz", positions.T, strict=True))
        fresh = bool(moved.any() and {"nx", "ny", "nz"} <= set(table.names))
        if fresh:
            old = table.columns("nx", "ny", "nz")
            new = _vertex_normals(self.vertices, positions, self.faces, old)
            changes |= dict(zip(("nx", "ny", "nz"), new.T, strict=True))
        path.write_bytes(table.rewritten(changes))
        return [_NEW_NORMALS] * fresh


class _PlyVertices:
    """The vertex table of a PLY file, binary or text."""

    def __init__(self, path: Path) -> None:
        self._data = path.read_bytes()
        end = re.search(rb"^end_header[^\n]*\n", self._data, re.MULTILINE)
        if not self._data.startswith(b"ply") or not end:
            raise ShockError(f"{path} is not a PLY file, whatever its ending says.")
        self._start = end.end()
        header = [line.split() for line in self._data[: self._start].decode("latin-1").splitlines()]
        encoding = next(words[1] for words in header if words[:1] == ["format"])
        self._order = {"binary_little_endian": "<", "binary_big_endian": ">"}.get(encoding, "")
        rows = 0
        for name, count, properties in _ply_elements(header):
            self._type = np.dtype([(n, (self._order or "<") + t) for n, t in properties])
            self._count = count
            if name == "vertex":
                break
            rows += count
            self._start += count * self._type.itemsize if self._order else 0
        else:
            raise ShockError(f"{path} has no vertices; save it as a mesh.")
        self.names = self._type.names or ()
        self._first_row = rows
        if self._type.hasobject or None in [self._type.fields]:
            raise ShockError(f"{path} has no vertex properties.")

    def columns(self, *names: str) -> Floats:
        """The named properties as columns."""
        table = self._binary() if self._order else self._text()
        return np.column_stack([np.asarray(table[name], dtype=np.float64) for name in names])
