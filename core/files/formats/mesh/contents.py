# SPDX-License-Identifier: GPL-3.0-or-later
"""Contents of a mesh file besides triangles, to name what a conversion leaves behind."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ...side_files import find
from . import gltf_tree, obj
from .gltf_tree import chunk_name, glb_chunks, read_tree
from .obj import material_files

COLORS, UVS, MATERIALS, NAMES, NORMALS = "colors", "UVs", "materials", "object names", "normals"
TEXTURES, EDGES = "textures of more than color", "lines and points"
COMMENTS, HEADER = "comments", "the header's text"
REPLACED = {COMMENTS, HEADER, NAMES}
"""Names that trimesh itself writes."""

_OBJ_WORDS = {
    **{b"vt": UVS, b"vn": NORMALS, b"usemtl": MATERIALS, b"o": NAMES, b"g": "groups"},
    **dict.fromkeys((b"l", b"p"), EDGES),
    **dict.fromkeys((b"vp", b"curv", b"curv2", b"surf"), "curves and surfaces"),
}
_PLY_KNOWN = {
    **dict.fromkeys(("x", "y", "z", "vertex_indices", "vertex_index"), ""),
    **dict.fromkeys(("nx", "ny", "nz"), NORMALS),
    **dict.fromkeys(("red", "green", "blue", "alpha"), COLORS),
    **dict.fromkeys(("s", "t", "u", "v", "texture_u", "texture_v", "texcoord"), UVS),
}
_STL_HEADER, _STL_FACET = 84, 50


def contents(path: Path) -> set[str]:
    """Words for the contents of a file, some with names in brackets."""
    if path.suffix.lower() in (".glb", ".gltf"):
        return set(_of_gltf(path))
    data = path.read_bytes()
    readers = {".obj": _of_obj, ".ply": _of_ply, ".stl": _of_stl, ".off": _of_off}
    return set(readers[path.suffix.lower()](path, data))


def side_files(path: Path) -> list[Path]:
    """The files beside a mesh file that it names: materials, images, buffers.

    Of files that cannot be read, and of other formats, there are none.
    """
    readers = {".obj": obj.side_files, ".glb": gltf_tree.side_files, ".gltf": gltf_tree.side_files}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        return []
    try:
        return sorted(set(reader(path)))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return []  # whoever reads it says what is wrong


def polygon_count(path: Path) -> int | None:
    """Number of polygons that a file states, in formats that have them."""
    ending, data = path.suffix.lower(), path.read_bytes()
    if ending == ".obj":
        return len(re.findall(rb"^[ \t]*f[ \t]", data, re.MULTILINE))
    if ending == ".off":
        return len(off_rows(data)[1])
    stated = ending == ".ply" and re.search(rb"^element face (\d+)", data, re.MULTILINE)
    return int(stated[1]) if stated else None


def _of_obj(path: Path, data: bytes) -> Iterator[str]:
    words = set(re.findall(rb"^[ \t]*(\w+)[ \t]", data, re.MULTILINE))
    yield from (_OBJ_WORDS[word] for word in words & set(_OBJ_WORDS))
    if re.search(rb"^[ \t]*v(?:[ \t]+[^\s#]+){6}", data, re.MULTILINE):
        yield COLORS
    if re.search(rb"^[ \t]*s[ \t]+(?!off|0\s)", data, re.MULTILINE):
        yield "smoothing groups"
    if b"#" in data:
        yield COMMENTS
    for library in material_files(path.parent, data.splitlines()):
        found = find(path.parent, library)
        if found and re.search(rb"^\s*(map_(?!Kd\b)|bump|disp|norm)", found.read_bytes(), re.M):
            yield TEXTURES


def _of_ply(path: Path, data: bytes) -> Iterator[str]:
    header = data[: data.index(b"end_header")].decode("latin-1")
    properties: dict[str, list[str]] = {"": []}
    for words in map(str.split, header.splitlines()):
        if words[:1] == ["element"] and len(words) > 1:
            properties[words[1]] = []
        elif words[:1] == ["property"]:
            properties[list(properties)[-1]].append(words[-1])
        elif words[:1] in (["comment"], ["obj_info"]):
            yield COMMENTS
    for element, names in properties.items():
        if element in ("vertex", "face"):
            yield from filter(None, map(_PLY_KNOWN.get, names))
            others = [name for name in names if name not in _PLY_KNOWN]
            if others:
                yield f"{element} properties ({', '.join(others)})"
        elif element:
            yield f"elements of other kinds ({element})"


def _of_stl(path: Path, data: bytes) -> Iterator[str]:
    count = int.from_bytes(data[_STL_HEADER - 4 : _STL_HEADER], "little")
    if len(data) != _STL_HEADER + _STL_FACET * count:
        if re.search(rb"^\s*solid[ \t]+\S", data, re.MULTILINE):
            yield NAMES
        return
    if data[: _STL_HEADER - 4].strip(b"\0 "):
        yield HEADER
    facets = np.frombuffer(data, np.uint8, offset=_STL_HEADER).reshape(-1, _STL_FACET)
    if facets[:, -2:].any():
        yield "facet attributes or colors"


def off_rows(text: bytes) -> tuple[list[list[bytes]], list[list[bytes]]]:
    """The words of each line of vertices, and of each line of faces, of an OFF file."""
    lines = [line.partition(b"#")[0] for line in text.splitlines()]
    words = re.split(rb"C?OFF", b"\n".join(lines), maxsplit=1)[-1].splitlines()
    rows = [line.split() for line in words if line.strip()]
    if not rows or len(rows[0]) < 2 or len(rows) <= sum(map(int, rows[0][:2])):
        raise ValueError("an OFF file that ends too early")
    count, face_count = int(rows[0][0]), int(rows[0][1])
    return rows[1 : 1 + count], rows[1 + count : 1 + count + face_count]


def _of_off(path: Path, data: bytes) -> Iterator[str]:
    kind = re.sub(rb"#[^\n]*", b"", data).split(b"OFF", 1)[0]
    for letters, what in ((b"ST", UVS), (b"C", COLORS), (b"N", NORMALS)):
        if letters in kind:
            yield what
    if any(len(row) > int(row[0]) + 1 for row in off_rows(data)[1]):
        yield "face colors"
    if b"#" in data:
        yield COMMENTS


def _of_gltf(path: Path) -> Iterator[str]:
    tree, _ = read_tree(path)
    for key, what in (
        ("animations", "animations"), ("skins", "skins"), ("cameras", "cameras"),
        ("materials", MATERIALS), ("extras", "extras"),
    ):  # fmt: skip
        if tree.get(key):
            yield what
    if tree.get("asset", {}).get("copyright"):
        yield "copyright"
    if any(each.get("name") for kind in ("nodes", "meshes") for each in tree.get(kind, [])):
        yield NAMES
    if any(set(each) & {"normalTexture", "occlusionTexture", "emissiveTexture"}
           or "metallicRoughnessTexture" in each.get("pbrMetallicRoughness", {})
           for each in tree.get("materials", [])):  # fmt: skip
        yield TEXTURES
    if "KHR_lights_punctual" in tree.get("extensions", {}):
        yield "lights"
    others = set(tree.get("extensionsUsed", [])) - {"KHR_lights_punctual"}
    if others:
        yield f"extensions ({', '.join(sorted(others))})"
    for mesh in tree.get("meshes", []):
        for primitive in mesh["primitives"]:
            yield from _of_primitive(primitive)
    for kind, _ in glb_chunks(path.read_bytes())[2:]:
        yield f"parts of its own ({chunk_name(kind)})"


def _of_primitive(primitive: dict[str, Any]) -> Iterator[str]:
    if primitive.get("mode", 4) < 4:
        yield EDGES
    if primitive.get("targets"):
        yield "morph targets"
    known = {"TEXCOORD_0": UVS, "COLOR_0": COLORS, "NORMAL": NORMALS}
    for name in set(primitive["attributes"]) - {"POSITION", "TANGENT"}:
        yield known.get(name, f"attributes ({name})")
