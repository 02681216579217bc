# SPDX-License-Identifier: GPL-3.0-or-later
"""OBJ files, rewritten line by line."""

from __future__ import annotations

import itertools
import re
from codecs import BOM_UTF8
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ....errors import InvalidMesh
from ...document import (
    NEW_NORMALS,
    Bools,
    Floats,
    Ints,
    Names,
    decimal,
    renewed_normals,
)
from ...side_files import are_beside, copy_beside, find, is_absolute, located
from ...staging import within
from .maps import COLOR, NORMALS, OPACITY, MapGroup, MapImage, TexturedDocument, grouped
from .polygons import fans, without_flips

_LARGEST_LIBRARY = 1 << 26  # bytes of a material file, which holds no images
_LIBRARIES = re.compile(rb"\s*mtllib\s+(\S.*)", re.IGNORECASE)
_LIBRARY_LINES = re.compile(rb"^[ \t]*mtllib[ \t][^\r\n]*", re.IGNORECASE | re.MULTILINE)
_IMAGES = re.compile(rb"\s*(?:map_\w+|bump|disp|decal|refl|norm)\s+(\S.*)", re.IGNORECASE)
_PARTS = {
    b"map_kd": COLOR,
    b"norm": NORMALS,
    b"map_kn": NORMALS,
    b"map_bump": "bump",
    b"bump": "bump",
    b"map_pr": "roughness",
    b"map_pm": "metal",
    b"map_ke": "emission",
    b"map_ks": "gloss",
    b"map_d": OPACITY,
}
_AFTER_VERTEX = re.compile(rb"/\S*")
_POLYGON = re.compile(rb"^f(?:[ \t]+[^\s#]+){4}", re.MULTILINE)
_NEUTRAL = {b"-s": 1.0, b"-o": 0.0, b"-t": 0.0}


class ObjFile(TexturedDocument):
    """An OBJ file as lines; only normals and the `v` lines of changed vertices are rewritten."""

    def __init__(self, path: Path) -> None:
        data = path.read_bytes()
        self._mark = BOM_UTF8 if data.startswith(BOM_UTF8) else b""
        text = re.sub(rb"\\\r?\n", b" ", data.removeprefix(BOM_UTF8))
        self.path = path
        self._is_beside = True
        self._has_library = False  # written already
        self.lines = text.splitlines(keepends=True)
        self._vertex_lines: list[int] = []
        self._normal_lines: list[int] = []
        self._face_lines: list[int] = []
        corners: list[tuple[int, int]] = []  # vertex and normal of each corner, -1 if none
        sizes, parts, part = [], [], 0
        for number, line in enumerate(self.lines):
            word, rest = [*line.split(None, 1), b"", b""][:2]
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
        self._triangles, self._owners = self._cut(np.array(sizes, dtype=np.int64))
        self.faces = self._corners[self._triangles, 0]
        self.parts = np.array(parts, dtype=np.int64)[self._owners]
        normals = self._corners[:, 1]
        if normals.min(initial=-1) < -1 or normals.max(initial=-1) >= len(self._normal_values):
            raise InvalidMesh(f"{path}: a face names a normal that is not there; repair the file.")

    def _corner(self, token: bytes) -> tuple[int, int]:
        fields = token.split(b"/")
        vertex = int(fields[0])
        vertex += len(self._vertex_lines) if vertex < 0 else -1
        normal = int(fields[2]) if len(fields) == 3 and fields[2] else 0
        normal += len(self._normal_lines) if normal < 0 else -1
        return vertex, normal

    def _cut(self, sizes: Ints) -> tuple[Ints, Ints]:
        """The polygons' triangles, as numbers of corners, and the polygon of each."""
        triangles, owners = fans(sizes)
        vertices = self._corners[:, 0]
        if vertices.min(initial=0) < 0 or vertices.max(initial=-1) >= len(self.vertices):
            return triangles, owners  # refused by whoever reads them
        return without_flips(self.vertices[vertices], triangles, owners), owners

    def _numbers(self, lines: list[int]) -> Floats:
        rows = [[float(word) for word in self.lines[n].split()[1:4]] for n in lines]
        return np.array(rows, dtype=np.float64).reshape(-1, 3)

    def own_files(self, target: Path) -> Collection[str]:
        self._is_beside = are_beside(self.path, target)
        return ()

    def save(self, path: Path, positions: Floats, moved: Bools) -> list[str]:
        lines = self._with_words(slice(1, 4), positions, np.flatnonzero(moved))
        fresh = bool(moved.any() and (self._corners[:, 1] >= 0).any())
        if fresh:
            self._renew_normals(lines, positions)
        return [*self._write(path, lines), *[NEW_NORMALS] * fresh]

    def _write(self, path: Path, lines: list[bytes]) -> list[str]:
        if self._has_library:
            path.write_bytes(self._mark + b"".join(lines))
            return []
        if not self._is_beside:
            lines = _with_relative_names(self.path.parent, lines, _LIBRARIES)
        path.write_bytes(self._mark + b"".join(lines))
        return _copy_materials(self.path, self.lines, path, self._is_beside)

    def read_back(self, path: Path) -> Floats:
        count, vertices = look_through(path)
        if count != len(self._face_lines):
            raise ValueError("fewer faces")
        return vertices

    def _with_words(self, place: slice, values: Floats, vertices: Ints) -> list[bytes]:
        """Replace some words of the lines of these vertices by values."""
        lines = list(self.lines)
        for vertex in vertices:
            number = self._vertex_lines[vertex]
            words, end = lines[number].split(), lines[number][len(lines[number].rstrip(b"\r\n")) :]
            words[place] = [decimal(values[vertex])]
            lines[number] = b" ".join(words) + end
        return lines

    def read_colors(self) -> Floats:
        """The numbers after the positions, of vertices with at least three of them."""
        colors = np.full_like(self.vertices, np.nan)
        for vertex, line in enumerate(self._vertex_lines):
            words = self.lines[line].partition(b"#")[0].split()[4:7]
            if len(words) == 3:
                colors[vertex] = [float(word) for word in words]
        return colors

    def save_colors(self, path: Path, colors: Floats) -> tuple[int, list[str]]:
        old = self.read_colors()
        changed = np.flatnonzero(((colors != old) & np.isfinite(old)).any(axis=1))
        lines = self._with_words(slice(4, 7), colors, changed)
        return len(changed), self._write(path, lines)

    def read_uvs(self) -> tuple[Floats, Names]:
        values = [[np.nan, np.nan]]  # for corners without coordinates
        corners: list[int] = []
        materials, material = [], ""
        for line in self.lines:
            words = line.partition(b"#")[0].split()
            if words[:1] == [b"vt"]:
                values.append([float(word) for word in [*words[1:3], b"0"][:2]])
            elif words[:1] == [b"usemtl"]:
                material = b" ".join(words[1:]).decode("utf-8", "replace")
            elif words[:1] == [b"f"]:
                fields = [word.split(b"/") for word in words[1:]]
                numbers = [int(field[1]) if len(field) > 1 and field[1] else 0 for field in fields]
                corners += [n + len(values) if n < 0 else n for n in numbers]
                materials.append(material)
        if min(corners) < 0 or max(corners) >= len(values):
            raise InvalidMesh(
                f"{self.path}: a face names a texture coordinate that is not there; repair the"
                " file."
            )
        uv = np.array(values)[np.array(corners)[self._triangles]]
        return uv, np.array(materials)[self._owners]

    def moved_colors(self) -> Mapping[str, str]:
        moved: dict[str, str] = {}
        for line, material in self._material_lines():
            _, start = self._image_in(line)
            is_color = start and _PARTS.get(line.split(None, 1)[0].lower()) == COLOR
            if is_color and _is_moved(line[:start]):
                moved[material] = "its texture coordinates are transformed"
        return moved

    def read_maps(self) -> tuple[list[MapGroup], list[str]]:
        uv, materials = self.read_uvs()
        known = ~np.isnan(uv).any(axis=(1, 2))
        of_material: dict[str, dict[str, MapImage]] = {}
        folder = self.path.parent
        notes = [
            f"the material file {name} is not beside the model"
            for name in material_files(folder, self.lines)
            if find(folder, name) is None
        ]
        cut_out: set[str] = set()
        moved: set[str] = set()
        for line, material in self._material_lines():
            name, start = self._image_in(line)
            part = _PARTS.get(line.split(None, 1)[0].lower()) if name else None
            if part is None:
                continue
            found = find(folder, name)
            if found is None:
                notes.append(f"{part} of {material}: the file {name} is not beside the model")
                continue
            if part == OPACITY:
                cut_out.add(name)
            if _is_moved(line[:start]):
                moved.add(name)
                notes.append(
                    f"{part} of {material}: its texture coordinates are transformed; apply that"
                    " first"
                )
            image = MapImage(name, name, part, found.suffix.lower(), found.read_bytes())
            of_material.setdefault(material, {}).setdefault(name, image)
        uses = [
            (
                known & (materials == material),
                [
                    image._replace(is_cut_out=name in cut_out)
                    for name, image in images.items()
                    if name not in moved
                ],
            )
            for material, images in of_material.items()
        ]
        return grouped([(faces, images) for faces, images in uses if faces.any()]), notes

    def _material_lines(self) -> list[tuple[bytes, str]]:
        """The lines of all material files, and the material that each is of."""
        result, material = [], ""
        for library in material_files(self.path.parent, self.lines):
            path = _library(self.path.parent, library)
            for line in path.read_bytes().splitlines(keepends=True) if path else ():
                words = line.split(None, 1)
                if words and words[0].lower() == b"newmtl":
                    material = b" ".join(line.split()[1:]).decode("utf-8", "replace")
                result.append((line, material))
        return result

    def save_maps(
        self, path: Path, positions: Floats, moved: Bools, images: Mapping[Any, bytes]
    ) -> list[str]:
        if not images:
            return self.save(path, positions, moved)
        lines = [(line, self._image_in(line)) for line, _ in self._material_lines()]
        others = list(dict.fromkeys(name for _, (name, _) in lines if name and name not in images))
        taken = {str(located(self.path.parent, name)).lower() for name in others}
        tries = (f"{path.name}.{number}.png" for number in itertools.count())
        names = dict(zip(images, (own for own in tries if own.lower() not in taken), strict=False))
        for name, data in images.items():
            within(path.parent, names[name]).write_bytes(data)
        library = b""
        for line, (name, start) in lines:
            if name in names:
                line = line[:start] + names[name].encode()
            library += line.rstrip(b"\r\n") + b"\n"
        within(path.parent, f"{path.name}.mtl").write_bytes(library)
        others += self._name_library(f"{path.name}.mtl")
        self._has_library = True
        notes = self.save(path, positions, moved)
        return [*notes, *copy_beside(self.path, others, path)[1]]

    def _image_in(self, line: bytes) -> tuple[str, int]:
        """The name of the image in a line of a material file, empty if none; where it begins."""
        named = _names(self.path.parent, line, _IMAGES)
        return (named[0][0].decode("utf-8", "replace"), named[0][1]) if named else ("", 0)

    def _name_library(self, name: str) -> list[str]:
        """Name one material file instead of all that were read; returns the names of the others."""
        kept: list[str] = []
        own = b"mtllib " + name.encode() + b"\n"
        for number, line in enumerate(self.lines):
            if not _LIBRARIES.match(line):
                continue
            words = [word for word, _ in _names(self.path.parent, line, _LIBRARIES)]
            left = [
                w for w in words if not _library(self.path.parent, w.decode("utf-8", "replace"))
            ]
            kept += [word.decode("utf-8", "replace") for word in left]
            if left != words:
                line = b"mtllib " + b" ".join(left) + b"\n" if left else b""
            self.lines[number] = own + line
            own = b""
        return kept

    def _renew_normals(self, lines: list[bytes], positions: Floats) -> None:
        # Corners that shared a vertex and a normal keep sharing it: hard edges stay hard.
        pairs, keys = np.unique(self._corners, axis=0, return_inverse=True)
        keys = keys.reshape(-1)
        old = np.where(pairs[:, 1:] >= 0, self._normal_values[pairs[:, 1]], 0.0)
        values = renewed_normals(positions, self.faces, keys[self._triangles], old)
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
        block = b"".join(b"vn " + decimal(value) + b"\n" for value in values[given])
        lines[first] = block + lines[first]


def look_through(path: Path) -> tuple[int, Floats]:
    """Count faces and read positions only: reading the faces takes longer than the rest."""
    data = path.read_bytes().removeprefix(BOM_UTF8)
    lines = [line.lstrip() for line in data.splitlines()]
    vertices = [line for line in lines if line[:2] in (b"v ", b"v\t")]
    count = sum(line[:2] in (b"f ", b"f\t") for line in lines)
    return count, np.loadtxt(vertices, usecols=(1, 2, 3), ndmin=2)


def with_concave_cut(text: bytes) -> bytes:
    """The text of an OBJ file whose concave polygons are triangles, for readers that make fans.

    Polygons that stay fans (see `without_flips`), and what else is in the file, stay as they are.
    """
    whole = re.sub(rb"\\\r?\n", b"", text)
    if not _POLYGON.search(whole):
        return text
    lines = whole.splitlines(keepends=True)
    rows: list[bytes] = []
    polygons: list[int] = []  # numbers of their lines
    known: list[int] = []  # how many vertices there are before each
    for number, line in enumerate(lines):
        if line[:2] in (b"v ", b"v\t"):
            rows.append(line)
        elif line[:2] in (b"f ", b"f\t") and _POLYGON.match(line):
            polygons.append(number)
            known.append(len(rows))
    if not rows:
        return text  # refused by whoever reads them
    points = np.loadtxt(rows, usecols=(1, 2, 3), ndmin=2)
    words = [lines[number].partition(b"#")[0].split()[1:] for number in polygons]
    sizes = np.array([len(each) for each in words])
    every = b" ".join([word for each in words for word in each])
    corners = np.array(_AFTER_VERTEX.sub(b"", every).split(), dtype=np.int64)
    vertices = np.where(corners < 0, corners + np.repeat(known, sizes), corners - 1)
    if vertices.min() < 0 or vertices.max() >= len(points):
        return text  # as well
    plain, owners = fans(sizes)
    cut = without_flips(points[vertices], plain, owners)
    changed = np.unique(owners[(cut != plain).any(axis=1)])
    begin = np.concatenate([[0], np.cumsum(sizes)])
    starts, stops = (np.searchsorted(owners, changed, side) for side in ("left", "right"))
    for owner, start, stop in zip(changed, starts, stops, strict=True):
        triangles = cut[start:stop] - begin[owner]
        rewritten = [b"f %b %b %b\n" % tuple(words[owner][k] for k in each) for each in triangles]
        lines[polygons[owner]] = b"".join(rewritten)
    return b"".join(lines) if len(changed) else text


def material_files(folder: Path, lines: list[bytes]) -> list[str]:
    """Names of the material files in the lines of an OBJ file."""
    return _named_files(folder, lines, _LIBRARIES)


def side_files(path: Path) -> list[Path]:
    """The material files of an OBJ file, and the images that these name, where they are there."""
    text = re.sub(rb"\\\r?\n", b"", path.read_bytes())
    libraries = material_files(path.parent, [match[0] for match in _LIBRARY_LINES.finditer(text)])
    found = [each for name in libraries if (each := _library(path.parent, name)) is not None]
    images = [
        find(path.parent, name)
        for library in found
        for name in _named_files(path.parent, library.read_bytes().splitlines(), _IMAGES)
    ]
    return [*found, *(image for image in images if image is not None)]


def _library(folder: Path, name: str) -> Path | None:
    """A material file that can be read; None if there is none."""
    path = find(folder, name)
    return path if path is not None and path.stat().st_size < _LARGEST_LIBRARY else None


def _copy_materials(source: Path, lines: list[bytes], stage: Path, is_beside: bool) -> list[str]:
    """Copy the material files of an OBJ file, and their textures, beside its copy.

    If the copy is in another folder, absolute names become relative.
    """
    libraries = material_files(source.parent, lines)
    images: list[str] = []
    for library in libraries:
        path = _library(source.parent, library)
        if path is not None:
            words = path.read_bytes().splitlines()
            images += _named_files(source.parent, words, _IMAGES)
    copies, notes = copy_beside(source, libraries + images, stage)
    for library in libraries if not is_beside else ():
        copy = stage.parent / (located(source.parent, library) or "")
        if copy in copies and copy.stat().st_size < _LARGEST_LIBRARY:
            old = copy.read_bytes().splitlines(keepends=True)
            copy.write_bytes(b"".join(_with_relative_names(source.parent, old, _IMAGES)))
    return notes


def _named_files(folder: Path, lines: list[bytes], keyword: re.Pattern[bytes]) -> list[str]:
    named = (name for line in lines for name, _ in _names(folder, line, keyword))
    return sorted({name.decode("utf-8", "replace") for name in named})


def _names(folder: Path, line: bytes, keyword: re.Pattern[bytes]) -> list[tuple[bytes, int]]:
    """The names of files in a line, and where they begin.

    Names may contain spaces: it is the whole rest of the line if such a file exists. Otherwise each
    word names a library. An image is the longest end of the line that is a file, behind options; if
    none is, the last word behind options, and else the whole rest.
    """
    match = keyword.match(line)
    if match is None:
        return []
    name, start = match[1].rstrip(), match.start(1)
    if find(folder, name.decode("utf-8", "replace")) is not None:
        return [(name, start)]
    if keyword is _IMAGES:
        begins = [word.start() for word in re.finditer(rb"\S+", name)]
        files = (n for n in begins if find(folder, name[n:].decode("utf-8", "replace")) is not None)
        begin = next(files, begins[-1] if name.startswith(b"-") else 0)
        return [(name[begin:], start + begin)]
    words = re.finditer(rb"\S+", name.partition(b"#")[0])
    return [(word[0], start + word.start()) for word in words]


def _is_moved(line: bytes) -> bool:
    """Whether the options of a map, the words before its name, move it."""
    neutral = None
    for word in line.lower().split():
        try:
            value = float(word)
        except ValueError:  # an option
            neutral = _NEUTRAL.get(word)
            continue
        if neutral is not None and value != neutral:
            return True
    return False


def _with_relative_names(
    folder: Path, lines: list[bytes], keyword: re.Pattern[bytes]
) -> list[bytes]:
    """Lines in which names of files below a folder are relative to it."""
    result = []
    for line in lines:
        for name, start in reversed(_names(folder, line, keyword)):
            text = name.decode("utf-8", "replace")
            place = located(folder, text) if is_absolute(text) else None
            if place is not None:
                line = line[:start] + str(place).encode() + line[start + len(name) :]
        result.append(line)
    return result
