# SPDX-License-Identifier: GPL-3.0-or-later
"""The JSON description in a GLB or glTF file, its buffers, and checks of both.

Everything in a description that is used is checked here, so that its readers need not.
"""

from __future__ import annotations

import base64
import json
import math
import struct
from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath
from typing import Any, NoReturn
from urllib.parse import unquote

import numpy as np
import numpy.typing as npt

from ....errors import ShockError
from ...reading import check_claim
from ...side_files import find, located, read

Tree = dict[str, Any]

INSIDE = "data:"
_INLINE = f"{INSIDE}application/octet-stream;base64"
_TRIANGLES = 4
DRACO = "KHR_draco_mesh_compression"
_MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_LARGEST_ENTRY = 64  # bytes of a matrix
_ALIGNED = 4  # bytes of which those of each vertex have to be a multiple
_JSON, _BINARY = 0x4E4F534A, 0x004E4942

_LISTS = (
    "accessors", "animations", "buffers", "bufferViews", "cameras", "images", "materials",
    "meshes", "nodes", "samplers", "scenes", "skins", "textures",
)  # fmt: skip
_PLACES = {"matrix": 16, "rotation": 4, "scale": 3, "translation": 3}
_SHAPES = {"POSITION": (3,), "NORMAL": (3,), "TEXCOORD_0": (2,), "COLOR_0": (3, 4)}
"""Numbers per vertex of the attributes that are used."""


def read_tree(path: Path) -> tuple[Tree, list[bytearray]]:
    """Read the description in a file, and its buffers; buffers in one file share one object.

    Raises
    ------
    ShockError
        If a part of the description is impossible; names the part.
    """
    data = path.read_bytes()
    is_glb = data.startswith(b"glTF")
    chunks = dict(reversed(glb_chunks(data))) if is_glb else {_JSON: data}
    check = _Check(path)
    if _JSON not in chunks:
        raise ValueError("its description (JSON) is missing")
    try:
        tree = json.loads(chunks[_JSON])
    except RecursionError:
        check.fail("its description is nested too deeply")
    check.tree(tree)
    buffers = _read_buffers(path, tree, chunks.get(_BINARY, b""), check)
    accessors = tree.get("accessors", [])
    unstored = (each for each in accessors if "bufferView" not in each or "sparse" in each)
    check_claim(path, sum(_LARGEST_ENTRY * each["count"] for each in unstored))
    check.meshes(tree, buffers)
    return tree, buffers


def side_files(path: Path) -> list[Path]:
    """The buffers and images beside a file that it names, as far as they are there."""
    data = path.read_bytes()
    chunks = dict(reversed(glb_chunks(data))) if data.startswith(b"glTF") else {_JSON: data}
    tree = json.loads(chunks[_JSON])
    entries = [*tree.get("buffers", []), *tree.get("images", [])]
    uris = [uri for entry in entries if not (uri := entry.get("uri", INSIDE)).startswith(INSIDE)]
    places = [find(path.parent, unquote(uri)) for uri in uris]
    return [place for place in places if place is not None]


def _read_buffers(path: Path, tree: Tree, binary: bytes, check: _Check) -> list[bytearray]:
    entries = tree.get("buffers", [])
    sizes: dict[PurePosixPath | str, int] = {}
    names = [_file_of(path, entry) for entry in entries]
    for name, entry in zip(names, entries, strict=True):
        if name is not None:
            sizes[name] = max(entry["byteLength"], sizes.get(name, 0))
    files = {name: bytearray(read(path.parent, str(name), size)) for name, size in sizes.items()}
    buffers = []
    for number, (name, entry) in enumerate(zip(names, entries, strict=True)):
        uri = entry.get("uri")
        if name is not None:
            data = files[name]
        elif uri is None:
            data = bytearray(binary)
        else:
            try:
                data = bytearray(base64.b64decode(uri.partition(",")[2]))
            except ValueError as error:
                check.fail(f"buffers[{number}].uri cannot be decoded ({error})")
        if len(data) < entry["byteLength"]:
            check.fail(f"buffers[{number}] holds {len(data)} of {entry['byteLength']} bytes")
        buffers.append(data)
    return buffers


def _file_of(path: Path, buffer: Tree) -> PurePosixPath | str | None:
    """The file that holds a buffer, under one name for all spellings; None if it is embedded."""
    uri = buffer.get("uri", INSIDE)
    if uri.startswith(INSIDE):
        return None
    name = unquote(uri)
    return located(path.parent, name) or name


# ------------------------------------------------------------------------------------------ values


def values_of(tree: Tree, buffers: list[bytearray], number: int) -> npt.NDArray[Any]:
    """The values of an accessor: a view into its buffer, or a new array if that is impossible.

    Accessors without a view are 0, and sparse ones list the entries that differ.
    """
    accessor = tree["accessors"][number]
    kind, width = np.dtype(_TYPES[accessor["componentType"]]), _WIDTHS[accessor["type"]]
    count = accessor["count"]
    if "bufferView" in accessor:
        values = _view(tree, buffers, accessor, count, kind, width)
    else:
        values = np.zeros((count, width), kind)
    if "sparse" not in accessor:
        return values
    sparse, values = accessor["sparse"], values.copy()
    index, new = sparse["indices"], sparse["values"]
    index_kind = np.dtype(_TYPES[index["componentType"]])
    places = _view(tree, buffers, index, sparse["count"], index_kind, 1)[:, 0]
    values[places] = _view(tree, buffers, new, sparse["count"], kind, width)
    return values


def is_stored(accessor: Tree) -> bool:
    """Whether all values of an accessor are in a buffer."""
    return "bufferView" in accessor and "sparse" not in accessor


def store(tree: Tree, buffers: list[bytearray], number: int, values: npt.NDArray[Any]) -> None:
    """Give an accessor its own buffer."""
    accessor, size = tree["accessors"][number], values.itemsize * values.shape[1]
    for key in ("sparse", "byteOffset"):
        accessor.pop(key, None)
    accessor["bufferView"] = len(tree.setdefault("bufferViews", []))
    view = {"buffer": len(buffers)}
    if values.shape[1] > 1 and size % _ALIGNED:  # of vertices, as indices are single numbers
        view["byteStride"] = size + -size % _ALIGNED
    rows = np.zeros((len(values), view.get("byteStride", size)), np.uint8)
    rows[:, :size] = np.ascontiguousarray(values).view(np.uint8)
    data = bytearray(rows.tobytes())
    view["byteLength"] = len(data)
    buffer = {"uri": f"{_INLINE},", "byteLength": len(data)}
    tree["bufferViews"].append(view)
    tree.setdefault("buffers", []).append(buffer)
    buffers.append(data)


def densified(tree: Tree, buffers: list[bytearray]) -> bytes | None:
    """A description with all meshes stored densely and embedded; None if they are already."""
    used: set[int] = set()
    for _, primitive in _all_triangles(tree):
        attributes = primitive["attributes"]
        used |= {attributes[name] for name in _SHAPES if name in attributes}
        used |= {primitive["indices"]} if "indices" in primitive else set()
    loose = [number for number in used if not is_stored(tree["accessors"][number])]
    if not loose:
        return None
    for number in loose:
        store(tree, buffers, number, values_of(tree, buffers, number))
    for buffer, data in zip(tree["buffers"], buffers, strict=True):
        buffer["uri"] = f"{_INLINE},{base64.b64encode(data).decode()}"
    return description(tree)


def _view(
    tree: Tree, buffers: list[bytearray], entry: Tree, count: int, kind: np.dtype, width: int
) -> npt.NDArray[Any]:
    view = tree["bufferViews"][entry["bufferView"]]
    return np.ndarray(
        (count, width),
        kind,
        buffers[view["buffer"]],
        view.get("byteOffset", 0) + entry.get("byteOffset", 0),
        (view.get("byteStride", width * kind.itemsize), kind.itemsize),
    )


# ------------------------------------------------------------------------------------------- checks


class _Check:
    """Refuses impossible descriptions."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def fail(self, what: str) -> NoReturn:
        raise ShockError(f"{self._path}: {what}; repair the file, or export it again.")

    def tree(self, tree: Any) -> None:
        """Check types and numbers of everything that is used."""
        self._is(tree, dict, "its description")
        for key in _LISTS:
            for number, entry in enumerate(self._list(tree, key, "")):
                self._is(entry, dict, f"{key}[{number}]")
        for key in ("asset", "extensions"):
            self._optional(tree, key, dict, "")
        for key in ("extensionsUsed", "extensionsRequired"):
            for name in self._list(tree, key, ""):
                self._is(name, str, key)
        checks: dict[str, Callable[[Tree, Tree, str], None]] = {
            "buffers": self._buffer,
            "bufferViews": self._view,
            "accessors": self._accessor,
            "nodes": self._node,
            "meshes": self._mesh,
            "materials": self._material,
            "images": self._image,
        }
        for key, check in checks.items():
            for number, entry in enumerate(tree.get(key, [])):
                check(tree, entry, f"{key}[{number}]")
                self._optional(entry, "name", str, f"{key}[{number}]")

    def _buffer(self, _tree: Tree, buffer: Tree, where: str) -> None:
        self._optional(buffer, "uri", str, where)
        self._count(buffer, "byteLength", where)

    def _view(self, tree: Tree, view: Tree, where: str) -> None:
        self._index(tree, view, "buffer", "buffers", where)
        for key in ("byteOffset", "byteLength", "byteStride"):
            self._count(view, key, where, 0)
        self._optional(view, "extensions", dict, where)
        if any(name in view.get("extensions", {}) for name in _MESHOPT):
            self._compressed()

    def _accessor(self, tree: Tree, accessor: Tree, where: str) -> None:
        self._one_of(accessor, "componentType", _TYPES, where)
        self._one_of(accessor, "type", _WIDTHS, where)
        self._count(accessor, "count", where)
        self._in_view(tree, accessor, where, is_needed=False)
        self._optional(accessor, "sparse", dict, where)
        if "sparse" not in accessor:
            return
        sparse, where = accessor["sparse"], f"{where}.sparse"
        self._count(sparse, "count", where)
        for key in ("indices", "values"):
            self._is(sparse.get(key), dict, f"{where}.{key}")
            self._in_view(tree, sparse[key], f"{where}.{key}", is_needed=True)
        self._one_of(sparse["indices"], "componentType", (5121, 5123, 5125), f"{where}.indices")

    def _in_view(self, tree: Tree, entry: Tree, where: str, is_needed: bool) -> None:
        if is_needed or "bufferView" in entry:
            self._index(tree, entry, "bufferView", "bufferViews", where)
        self._count(entry, "byteOffset", where, 0)

    def _node(self, tree: Tree, node: Tree, where: str) -> None:
        for child in self._list(node, "children", where):
            self._index(tree, {"children": child}, "children", "nodes", where)
        if "mesh" in node:
            self._index(tree, node, "mesh", "meshes", where)
        for key, count in _PLACES.items():
            values = self._list(node, key, where)
            if key in node and not (len(values) == count and all(map(_is_number, values))):
                self.fail(f"{where}.{key} is not {count} numbers")

    def _mesh(self, tree: Tree, mesh: Tree, where: str) -> None:
        self._is(mesh.get("primitives"), list, f"{where}.primitives")
        for number, primitive in enumerate(mesh["primitives"]):
            part = f"{where}.primitives[{number}]"
            self._is(primitive, dict, part)
            self._attributes(tree, primitive.get("attributes"), f"{part}.attributes")
            for key, target in (("indices", "accessors"), ("material", "materials")):
                if key in primitive:
                    self._index(tree, primitive, key, target, part)
            self._count(primitive, "mode", part, _TRIANGLES)
            self._optional(primitive, "extensions", dict, part)
            for k, targets in enumerate(self._list(primitive, "targets", part)):
                self._attributes(tree, targets, f"{part}.targets[{k}]")
            used = [*primitive["attributes"].values(), primitive.get("indices")]
            if DRACO in primitive.get("extensions", {}) and any(
                not is_stored(tree["accessors"][k]) for k in used if k is not None
            ):
                self._compressed()

    def _attributes(self, tree: Tree, attributes: Any, where: str) -> None:
        self._is(attributes, dict, where)
        for name in attributes:
            self._index(tree, attributes, name, "accessors", where)

    def _material(self, _tree: Tree, material: Tree, where: str) -> None:
        self._optional(material, "pbrMetallicRoughness", dict, where)

    def _image(self, _tree: Tree, image: Tree, where: str) -> None:
        self._optional(image, "uri", str, where)

    def meshes(self, tree: Tree, buffers: list[bytearray]) -> None:
        """Check that the buffers hold the data of the triangles."""
        for where, primitive in _all_triangles(tree):
            attributes = primitive["attributes"]
            count = tree["accessors"][attributes["POSITION"]]["count"]
            for name, widths in _SHAPES.items():
                if name in attributes:
                    part = f"accessors[{attributes[name]}], the {name} of {where},"
                    accessor = tree["accessors"][attributes[name]]
                    if _WIDTHS[accessor["type"]] not in widths:
                        self.fail(f"{part} is a {accessor['type']}")
                    if accessor["count"] != count:
                        self.fail(f"{part} has {accessor['count']} entries for {count} vertices")
                    self._stored(tree, buffers, attributes[name])
            if "indices" in primitive:
                accessor = tree["accessors"][primitive["indices"]]
                if accessor["type"] != "SCALAR" or accessor["componentType"] == 5126:
                    self.fail(f"accessors[{primitive['indices']}], the indices of {where}, is none")
                self._stored(tree, buffers, primitive["indices"])

    def _stored(self, tree: Tree, buffers: list[bytearray], number: int) -> None:
        accessor, where = tree["accessors"][number], f"accessors[{number}]"
        size = np.dtype(_TYPES[accessor["componentType"]]).itemsize * _WIDTHS[accessor["type"]]
        if "bufferView" in accessor:
            self._fits(tree, buffers, accessor, accessor["count"], size, where)
        if "sparse" not in accessor:
            return
        sparse, where = accessor["sparse"], f"{where}.sparse"
        if sparse["count"] > accessor["count"]:
            self.fail(f"{where}.count is {sparse['count']}, of {accessor['count']} entries")
        index = sparse["indices"]
        kind = np.dtype(_TYPES[index["componentType"]])
        self._fits(tree, buffers, index, sparse["count"], kind.itemsize, f"{where}.indices")
        self._fits(tree, buffers, sparse["values"], sparse["count"], size, f"{where}.values")
        places = _view(tree, buffers, index, sparse["count"], kind, 1)
        if places.max(initial=0) >= max(accessor["count"], 1):
            self.fail(f"{where}.indices name entries that are not there")

    def _fits(
        self, tree: Tree, buffers: list[bytearray], entry: Tree, count: int, size: int, where: str
    ) -> None:
        view = tree["bufferViews"][entry["bufferView"]]
        start = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
        stride = view.get("byteStride", size)
        if stride < size:
            self.fail(f"bufferViews[{entry['bufferView']}].byteStride is less than {where} needs")
        end = start + (stride * (count - 1) + size if count else 0)
        if end > len(buffers[view["buffer"]]):
            self.fail(
                f"{where} reaches beyond buffers[{view['buffer']}], by way of"
                f" bufferViews[{entry['bufferView']}]"
            )

    def _compressed(self) -> NoReturn:
        raise ShockError(f"{self._path} is compressed; export it without compression.")

    def _is(self, value: Any, kind: type, where: str) -> None:
        words: dict[type, str] = {dict: "an object", list: "a list", str: "a text"}
        if not isinstance(value, kind):
            self.fail(f"{where} is not {words[kind]}")

    def _optional(self, entry: Tree, key: str, kind: type, where: str) -> None:
        if key in entry:
            self._is(entry[key], kind, f"{where}.{key}".lstrip("."))

    def _list(self, entry: Tree, key: str, where: str) -> list[Any]:
        self._optional(entry, key, list, where)
        return entry.get(key, [])

    def _count(self, entry: Tree, key: str, where: str, default: int | None = None) -> None:
        value = entry.get(key, default)
        if type(value) is not int or value < 0:
            self.fail(f"{where}.{key} is not a whole number from 0 on")

    def _one_of(self, entry: Tree, key: str, known: Any, where: str) -> None:
        value = entry.get(key)
        if not isinstance(value, int | str) or value not in known:
            self.fail(f"{where}.{key} is {value!r:.40}, which glTF does not know")

    def _index(self, tree: Tree, entry: Tree, key: str, target: str, where: str) -> None:
        self._count(entry, key, where)
        if entry[key] >= len(tree.get(target, [])):
            self.fail(f"{where}.{key} names {target}[{entry[key]}], which is not there")


def _is_number(value: Any) -> bool:
    try:
        return type(value) in (int, float) and math.isfinite(value)
    except OverflowError:
        return False


def triangles_of(mesh: Tree) -> Iterator[tuple[int, Tree]]:
    """Each primitive of triangles that has positions, after its number in a mesh."""
    for number, primitive in enumerate(mesh["primitives"]):
        if (
            primitive.get("mode", _TRIANGLES) == _TRIANGLES
            and "POSITION" in primitive["attributes"]
        ):
            yield number, primitive


def _all_triangles(tree: Tree) -> Iterator[tuple[str, Tree]]:
    for number, mesh in enumerate(tree.get("meshes", [])):
        for k, primitive in triangles_of(mesh):
            yield f"meshes[{number}].primitives[{k}]", primitive


# -------------------------------------------------------------------------------------- GLB parts


def glb_chunks(data: bytes) -> list[tuple[int, bytes]]:
    """The chunks of a GLB file, each with its type: description, buffer, and extensions."""
    chunks, place = [], 12
    while data.startswith(b"glTF") and place + 8 <= len(data):
        length, kind = struct.unpack_from("<II", data, place)
        chunks.append((kind, data[place + 8 : place + 8 + length]))
        place += 8 + length
    return chunks


def chunk_name(kind: int) -> str:
    """The four letters of a chunk type."""
    return kind.to_bytes(4, "little").decode("latin-1")


def glb(text: bytes, binary: bytes, others: list[tuple[int, bytes]]) -> bytes:
    """A GLB file of these chunks."""
    chunks = [(_JSON, text + b" " * (-len(text) % 4))]
    if binary or others:
        chunks.append((_BINARY, binary + bytes(-len(binary) % 4)))
    chunks += others
    body = b"".join(struct.pack("<II", len(data), kind) + data for kind, data in chunks)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def description(tree: Tree) -> bytes:
    """The JSON text of a description."""
    try:
        return json.dumps(tree, separators=(",", ":"), ensure_ascii=False).encode()
    except UnicodeEncodeError:  # lone surrogates in names: written as numbers
        return json.dumps(tree, separators=(",", ":")).encode()
