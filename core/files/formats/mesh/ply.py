# SPDX-License-Identifier: GPL-3.0-or-later
"""PLY files, rewritten in place: text and binary."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ....errors import ShockError
from ...document import (
    NEW_NORMALS,
    NO_FACES,
    Bools,
    Floats,
    InPlaceDocument,
    Names,
    decimal,
    from_unit,
    renewed_vertex_normals,
    stored,
    to_unit,
)
from .ply_lists import ORDERS, TYPES, elements_of, head_of
from .trimesh import load_scene

_COLORS = (
    ("red", "green", "blue"),
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
    ("r", "g", "b"),
)
_FULL_RANGE = b"comment shock_filter: white is the largest number of the types of the colors"
_UVS = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))


class PlyFile(InPlaceDocument):
    """A PLY file as bytes; only the vertices' positions and normals, or colors, are rewritten."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._table = PlyVertices(path)
        meshes = list(load_scene(path)[0].geometry.values())
        self.vertices = self._table.columns("x", "y", "z")
        self.faces = np.vstack([NO_FACES, *(getattr(mesh, "faces", NO_FACES) for mesh in meshes)])
        self.parts = np.zeros(len(self.faces), dtype=np.int64)

    def save(self, path: Path, positions: Floats, moved: Bools) -> list[str]:
        if any(self._table.kind(axis).kind != "f" for axis in "xyz"):
            raise ShockError(
                f"{self._path}: its coordinates are whole numbers, which cannot be moved; save"
                " them as float."
            )
        for axis, column in zip("xyz", positions.T, strict=True):
            stored(column, self._table.kind(axis))
        changes = {"x": positions[:, 0], "y": positions[:, 1], "z": positions[:, 2]}
        normals = ("nx", "ny", "nz")
        fresh = bool(moved.any() and set(normals) <= set(self._table.names))
        if fresh:
            kinds = [self._table.kind(name) for name in normals]
            old = self._table.columns(*normals)
            old = np.column_stack([to_unit(*each) for each in zip(old.T, kinds, strict=True)])
            new = renewed_vertex_normals(self.vertices, positions, self.faces, old)
            changes |= {
                name: from_unit(column, kind)
                for name, column, kind in zip(normals, new.T, kinds, strict=True)
            }
        path.write_bytes(self._table.rewritten(changes))
        return [NEW_NORMALS] * fresh

    def read_back(self, path: Path) -> Floats:
        table = PlyVertices(path)
        if table.rest() != self._table.rest():
            raise ValueError("other faces")
        return table.columns("x", "y", "z")

    def _color_names(self) -> tuple[str, ...]:
        named = (names for names in _COLORS if set(names) <= set(self._table.names))
        return next(named, ())

    def _color_kinds(self) -> list[np.dtype[Any]]:
        """The types whose maximum is white, of each color's channels.

        Wide whole numbers are of 8 bits if none is above 255, as other programs read and write
        them, unless the header says that they are not.
        """
        names = self._color_names()
        kinds = [self._table.kind(name) for name in names]
        look_small = _look_like_bytes(self._table.columns(*names), kinds)
        if look_small and not self._table.has_comment(_FULL_RANGE):
            return [np.dtype(np.uint8) if kind.itemsize > 1 else kind for kind in kinds]
        return kinds

    def read_colors(self) -> Floats:
        names = self._color_names()
        if not names:
            return np.full_like(self.vertices, np.nan)
        columns = self._table.columns(*names).T
        kinds = self._color_kinds()
        return np.column_stack([to_unit(*each) for each in zip(columns, kinds, strict=True)])

    def save_colors(self, path: Path, colors: Floats) -> tuple[int, list[str]]:
        names = self._color_names()
        old = self._table.columns(*names)
        kinds = self._color_kinds()
        new = [from_unit(*each) for each in zip(colors.T, kinds, strict=True)]
        is_dark = _look_like_bytes(np.column_stack(new), kinds)
        comment = _FULL_RANGE if is_dark and max(kind.itemsize for kind in kinds) > 1 else b""
        path.write_bytes(self._table.rewritten(dict(zip(names, new, strict=True)), comment))
        differs = (np.column_stack(new) != old) & np.isfinite(colors)
        return int(differs.any(axis=1).sum()), []

    def read_uvs(self) -> tuple[Floats, Names]:
        materials = np.full(len(self.faces), "")
        for names in _UVS:
            if set(names) <= set(self._table.names):
                return self._table.columns(*names)[self.faces], materials
        # Coordinates of faces: trimesh splits vertices for them, but keeps the order of faces.
        blocks = [np.empty((0, 3, 2))]
        for mesh in load_scene(self._path, fix_texture=True)[0].geometry.values():
            uv = getattr(mesh.visual, "uv", None)
            none = np.full((len(mesh.faces), 3, 2), np.nan)
            blocks.append(none if uv is None else np.asarray(uv)[mesh.faces])
        return np.concatenate(blocks), materials


def _look_like_bytes(colors: Floats, kinds: list[np.dtype[Any]]) -> bool:
    is_whole = all(kind.kind in "iu" for kind in kinds)
    return is_whole and bool(colors.max(initial=0.0) <= np.iinfo(np.uint8).max)


class PlyVertices:
    """The vertex table of a PLY file, binary or text."""

    def __init__(self, path: Path) -> None:
        self._data = path.read_bytes()
        head = head_of(self._data)
        if head is None:
            raise ShockError(f"{path} is not a PLY file; its header is missing or damaged.")
        encoding, elements = elements_of(head)
        if encoding not in ORDERS:
            raise ValueError(f"its format is {encoding}")
        self._is_text = encoding == "ascii"
        order = ORDERS[encoding]
        self._head = head
        self._start = len(head)  # first byte of the vertices
        self._row = 0  # first line of the vertices after the header
        self._least = sum(count for _, count, _ in elements)  # least number of lines of text
        for element, count, properties in elements:
            if not self._is_text and any(each.length for each in properties):
                raise ShockError(f"{path}: lists before or in the vertices are not handled.")
            fields = [(each.name, order + TYPES.get(each.kind, "V")) for each in properties]
            self._dtype, self._count = np.dtype(fields), count
            if element == "vertex":
                break
            self._row += count
            self._start += 0 if self._is_text else count * self._dtype.itemsize
        else:
            raise ShockError(f"{path} has no vertices; save it as a mesh.")
        self.names = self._dtype.names or ()
        self._values = self._read()

    def _read(self) -> Any:
        if not self._is_text:
            return np.frombuffer(self._data, self._dtype, self._count, self._start)
        self._lines = self._data[self._start :].splitlines(keepends=True)
        if len(self._lines) < self._least:
            raise ValueError("fewer lines than its header says")
        rows = [line.split() for line in self._lines[self._row : self._row + self._count]]
        return dict(zip(self.names, np.array(rows).T, strict=True))

    def rest(self) -> bytes:
        """Everything behind the vertices."""
        if not self._is_text:
            return self._data[self._start + self._values.nbytes :]
        return b"".join(self._lines[self._row + self._count :])

    def columns(self, *names: str) -> Floats:
        """The named properties as columns."""
        return np.column_stack([self._values[name].astype(np.float64) for name in names])

    def weights(self, name: str) -> Floats:
        """A property as numbers from 0 to 1; whole numbers are divided by their type's maximum."""
        return to_unit(self.columns(name)[:, 0], self.kind(name))

    def kind(self, name: str) -> np.dtype[Any]:
        """The type of a property."""
        return self._dtype[name]

    def has_comment(self, comment: bytes) -> bool:
        """Whether a line of the header is this one."""
        return comment in (line.strip() for line in self._head.splitlines())

    def _head_with(self, comment: bytes) -> bytes:
        """The header, and what precedes the vertices; with a comment unless it is empty."""
        before = self._data[len(self._head) : self._start]
        if not comment or self.has_comment(comment):
            return self._head + before
        place = self._head.rindex(b"end_header")
        end = self._head[: self._head.index(b"\n") + 1]
        end = end[len(end.rstrip()) :]
        return self._head[:place] + comment + end + self._head[place:] + before

    def rewritten(self, changes: dict[str, Floats], comment: bytes = b"") -> bytes:
        """The whole file with changed values in some columns; equal values keep their bytes.

        The header gets a line `comment` unless it is empty or there.
        """
        if not self._is_text:
            table = self._values.copy()
            for name, values in changes.items():
                table[name] = values
            return b"".join([self._head_with(comment), table.tobytes(), self.rest()])
        lines = list(self._lines)
        new = np.column_stack(list(changes.values()))
        places = [self.names.index(name) for name in changes]
        for row in np.flatnonzero((new != self.columns(*changes)).any(axis=1)):
            line = lines[self._row + row]
            words = line.split()
            for place, value in zip(places, new[row], strict=True):
                words[place] = decimal([value])
            lines[self._row + row] = b" ".join(words) + line[len(line.rstrip()) :]
        return self._head_with(comment) + b"".join(lines)
