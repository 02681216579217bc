# SPDX-License-Identifier: GPL-3.0-or-later
"""GLB and glTF files, rewritten in their buffers."""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import numpy as np
import numpy.typing as npt

from ...errors import InvalidMesh, ShockError
from ..document import (
    NEW_NORMALS,
    Bools,
    Floats,
    InPlaceDocument,
    Ints,
    Names,
    from_unit,
    joined,
    renewed_vertex_normals,
    stored,
    to_unit,
    transformed,
    unit,
)
from ..reading import check_claim
from ..side_files import copy_beside, find, read, relative

_GLTF_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_GLTF_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_LARGEST_ENTRY = 64  # bytes, of a matrix
_TRIANGLES = 4
_INSIDE = "data:"
_DRACO = "KHR_draco_mesh_compression"
_JSON, _BINARY = 0x4E4F534A, 0x004E4942


class GltfFile(InPlaceDocument):
    """A GLB or glTF file; only positions, normals and colors in its buffers are rewritten.

    All meshes are put into the space of the scene, so that they are sharpened as they look there
    and join where they touch. A mesh that stands there several times counts once.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._tree, self._buffers = read_tree(path)
        self._chunks = glb_chunks(path.read_bytes())[2:]
        to_world = _gltf_matrices(self._tree)
        self._rows: dict[int, tuple[slice, Floats]] = {}  # where each POSITION accessor stands
        blocks: list[Floats] = []
        faces: list[Ints] = []
        parts: list[int] = []
        first = 0
        for number, primitive in self._primitives():
            accessor = primitive["attributes"]["POSITION"]
            if accessor not in self._rows:
                matrix = to_world.get(number, np.eye(4))
                blocks.append(transformed(self._floats(accessor), matrix))
                self._rows[accessor] = slice(first, first + len(blocks[-1])), matrix
                first += len(blocks[-1])
            rows = self._rows[accessor][0]
            corners = np.arange(rows.stop - rows.start)
            if "indices" in primitive:
                corners = self._array(primitive["indices"])[:, 0].astype(np.int64)
            if len(corners) and corners.max() >= rows.stop - rows.start:
                raise InvalidMesh(f"{path}: a face names a vertex that is not there.")
            faces.append(corners[: len(corners) // 3 * 3].reshape(-1, 3) + rows.start)
            parts.append(number)
        self._counts = [len(block) for block in faces]  # triangles of each primitive
        self.vertices, self.faces, self.parts = joined(blocks, faces, parts)

    def _primitives(self) -> Iterator[tuple[int, dict[str, Any]]]:
        for number, mesh in enumerate(self._tree.get("meshes", [])):
            for primitive in mesh["primitives"]:
                if primitive.get("mode", _TRIANGLES) == _TRIANGLES:
                    yield number, primitive

    def _triangles(self) -> Iterator[tuple[dict[str, Any], slice, Ints]]:
        """Each primitive with its vertices, and its triangles as numbers of these."""
        first = 0
        for (_, primitive), count in zip(self._primitives(), self._counts, strict=True):
            rows = self._rows[primitive["attributes"]["POSITION"]][0]
            yield primitive, rows, self.faces[first : first + count] - rows.start
            first += count

    def _array(self, number: int) -> npt.NDArray[Any]:
        """The values of an accessor, as a view into its buffer."""
        accessor = self._tree["accessors"][number]
        view = self._tree["bufferViews"][accessor.get("bufferView", 0)]
        if "bufferView" not in accessor or "sparse" in accessor or "extensions" in view:
            raise ShockError(f"{self._path} is compressed; export it without compression.")
        dtype = np.dtype(_GLTF_TYPES[accessor["componentType"]])
        width = _GLTF_WIDTHS[accessor["type"]]
        return np.ndarray(
            (accessor["count"], width),
            dtype,
            self._buffers[view["buffer"]],
            view.get("byteOffset", 0) + accessor.get("byteOffset", 0),
            (view.get("byteStride", width * dtype.itemsize), dtype.itemsize),
        )

    def _floats(self, number: int) -> npt.NDArray[np.float32]:
        array = self._array(number)
        if array.dtype.kind != "f":
            raise ShockError(f"{self._path} is quantized; export it without quantization.")
        return array

    def save(self, path: Path, positions: Floats, moved: Bools) -> list[str]:
        fresh = bool(moved.any()) and self._renew_normals(positions)
        notes = [NEW_NORMALS] * fresh
        for number, (rows, matrix) in self._rows.items():
            values, chosen = self._floats(number), moved[rows]
            local = transformed(positions[rows][chosen], np.linalg.inv(matrix))
            values[chosen] = stored(local, values.dtype)
            accessor = self._tree["accessors"][number]
            if len(values):
                accessor["min"] = values.min(axis=0).tolist()
                accessor["max"] = values.max(axis=0).tolist()
        if moved.any():
            notes += self._drop_compressed()
        return notes + self._write(path)

    def _drop_compressed(self) -> list[str]:
        """Drop the compressed copies of primitives, which stand beside what was changed."""
        dropped = [
            primitive["extensions"].pop(_DRACO)
            for _, primitive in self._primitives()
            if _DRACO in primitive.get("extensions", {})
        ]
        for key in ("extensionsUsed", "extensionsRequired") if dropped else ():
            names = [name for name in self._tree.pop(key, []) if name != _DRACO]
            if names:
                self._tree[key] = names
        return ["its compressed copy (Draco) was left behind"] if dropped else []

    def own_files(self, target: Path) -> Collection[str]:
        # In place, buffers keep their names.
        self._in_place = target.exists() and target.samefile(self._path)
        names = self._side_files("buffers") if self._in_place else []
        return [relative(name).as_posix() for name in names]

    def read_back(self, path: Path) -> Floats:
        return GltfFile(path).vertices

    def read_uvs(self) -> tuple[Floats, Names]:
        blocks = [np.empty((0, 3, 2))]
        names: list[str] = []
        for primitive, rows, faces in self._triangles():
            accessor = primitive["attributes"].get("TEXCOORD_0")
            if accessor is None:
                values = np.full((rows.stop - rows.start, 2), np.nan)
            else:
                stored = self._array(accessor)
                values = to_unit(stored.astype(np.float64), stored.dtype) * (1, -1) + (0, 1)
            blocks.append(values[faces])
            name = ""
            if "material" in primitive:
                name = self._tree["materials"][primitive["material"]].get("name", "")
            names += [name] * len(faces)
        return np.concatenate(blocks), np.array(names)

    def _colors(self) -> list[tuple[slice, int]]:
        """Vertices that have colors, and the accessor that holds these."""
        found: dict[int, int] = {}
        for _, primitive in self._primitives():
            place, color = (primitive["attributes"].get(k) for k in ("POSITION", "COLOR_0"))
            if color is not None and found.setdefault(place, color) != color:
                raise ShockError(f"{self._path} colors the same vertices twice; export it anew.")
        return [(self._rows[place][0], color) for place, color in found.items()]

    def read_colors(self) -> Floats:
        colors = np.full_like(self.vertices, np.nan)
        for rows, accessor in self._colors():
            values = self._array(accessor)[:, :3]
            colors[rows] = to_unit(values, values.dtype)
        return colors

    def save_colors(self, path: Path, colors: Floats) -> tuple[int, list[str]]:
        changed = 0
        for rows, accessor in self._colors():
            values = self._array(accessor)[:, :3]  # opacity, if any, stays
            new = from_unit(colors[rows], values.dtype)
            changed += int((new != values).any(axis=1).sum())
            values[:] = new
            for bound in ("min", "max"):  # optional for colors, and stale now
                self._tree["accessors"][accessor].pop(bound, None)
        if changed:
            notes = self._drop_compressed()
            return changed, notes + self._write(path)
        path.write_bytes(self._path.read_bytes())
        return 0, copy_beside(self._path, self._side_files("buffers", "images"), path)

    def _renew_normals(self, positions: Floats) -> bool:
        """Compute all normals anew; whether there are some. Tangents go: readers make them."""
        # Primitives that share positions may have normals of their own.
        starts: dict[tuple[int, int], int] = {}  # of each pair of accessors, in the lists below
        vertices, old, triangles, total = [], [], [], 0
        for primitive, rows, faces in self._triangles():
            attributes = primitive["attributes"]
            attributes.pop("TANGENT", None)
            if "NORMAL" not in attributes:
                continue
            place, normal = attributes["POSITION"], attributes["NORMAL"]
            if (place, normal) not in starts:
                starts[place, normal] = total
                matrix = self._rows[place][1]
                old.append(unit(self._floats(normal) @ np.linalg.inv(matrix[:3, :3])))
                vertices.append(np.arange(rows.start, rows.stop))
                total += len(vertices[-1])
            triangles.append(faces + starts[place, normal])
        if not starts:
            return False
        used = np.concatenate(vertices)
        new = renewed_vertex_normals(
            self.vertices[used], positions[used], np.vstack(triangles), np.vstack(old)
        )
        for (place, normal), start in starts.items():
            values, matrix = self._floats(normal), self._rows[place][1]
            values[:] = unit(new[start : start + len(values)] @ matrix[:3, :3])
        return True

    def _write(self, path: Path) -> list[str]:
        binary, is_glb = b"", path.suffix.lower() == ".glb"
        for number, (buffer, data) in enumerate(
            zip(self._tree.get("buffers", []), self._buffers, strict=True)
        ):
            uri = buffer.get("uri", "")
            if uri.startswith(_INSIDE):
                buffer["uri"] = uri.partition(",")[0] + "," + base64.b64encode(data).decode()
            elif is_glb and number == 0:
                buffer.pop("uri", None)
                binary = bytes(data)
            else:
                if not self._in_place:  # a name that no other file's buffer gets
                    buffer["uri"] = quote(f"{path.name}.{number}.bin")
                name = path.parent / relative(unquote(buffer["uri"]))
                name.parent.mkdir(parents=True, exist_ok=True)
                name.write_bytes(data + self._rest(buffer, data))
        text = json.dumps(self._tree, separators=(",", ":"), ensure_ascii=False).encode()
        path.write_bytes(_glb(text, binary, self._chunks) if is_glb else text)
        notes = []
        if self._chunks and not is_glb:
            kinds = ", ".join(chunk_name(kind) for kind, _ in self._chunks)
            notes.append(f".gltf cannot hold parts of its own ({kinds}): left behind")
        return notes + copy_beside(self._path, self._side_files("images"), path)

    def _rest(self, buffer: dict[str, Any], data: bytearray) -> bytes:
        """What stands behind a buffer in its file, and may be another model's."""
        found = find(self._path.parent, unquote(buffer["uri"])) if self._in_place else None
        return found.read_bytes()[len(data) :] if found else b""

    def _side_files(self, *kinds: str) -> list[str]:
        entries = [entry for kind in kinds for entry in self._tree.get(kind, [])]
        uris = [entry.get("uri", _INSIDE) for entry in entries]
        return [unquote(uri) for uri in uris if not uri.startswith(_INSIDE)]


def read_tree(path: Path) -> tuple[dict[str, Any], list[bytearray]]:
    """Read the description in a file, and its buffers; those in one file are one."""
    data = path.read_bytes()
    chunks = dict(reversed(glb_chunks(data))) if data.startswith(b"glTF") else {_JSON: data}
    tree = json.loads(chunks.get(_JSON, b""))
    entries = tree.get("buffers", [])
    sizes: dict[str, int] = {}
    for entry in entries:
        uri = entry.get("uri", _INSIDE)
        if not uri.startswith(_INSIDE):
            sizes[uri] = max(entry["byteLength"], sizes.get(uri, 0))
    files = {uri: bytearray(read(path.parent, unquote(uri), size)) for uri, size in sizes.items()}
    buffers = []
    for entry in entries:
        uri = entry.get("uri")
        if uri is None:
            buffers.append(bytearray(chunks.get(_BINARY, b"")))
        elif uri.startswith(_INSIDE):
            buffers.append(bytearray(base64.b64decode(uri.partition(",")[2])))
        else:
            buffers.append(files[uri])
    unstored = (each for each in tree.get("accessors", []) if "bufferView" not in each)
    check_claim(path, sum(_LARGEST_ENTRY * each["count"] for each in unstored))
    return tree, buffers


def glb_chunks(data: bytes) -> list[tuple[int, bytes]]:
    """The parts of a GLB file, each with its kind: description, buffer, and what others added."""
    chunks, place = [], 12
    while data.startswith(b"glTF") and place + 8 <= len(data):
        length, kind = struct.unpack_from("<II", data, place)
        chunks.append((kind, data[place + 8 : place + 8 + length]))
        place += 8 + length
    return chunks


def chunk_name(kind: int) -> str:
    """The four letters of a kind of part."""
    return kind.to_bytes(4, "little").decode("latin-1")


def _glb(text: bytes, binary: bytes, others: list[tuple[int, bytes]]) -> bytes:
    chunks = [(_JSON, text + b" " * (-len(text) % 4))]
    if binary or others:
        chunks.append((_BINARY, binary + bytes(-len(binary) % 4)))
    chunks += others
    body = b"".join(struct.pack("<II", len(data), kind) + data for kind, data in chunks)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def _gltf_matrices(tree: dict[str, Any]) -> dict[int, Floats]:
    """From each mesh's own space to that of the scene, where the mesh stands first."""
    nodes = tree.get("nodes", [])
    children = {child for node in nodes for child in node.get("children", [])}
    open_nodes = [(n, np.eye(4)) for n in range(len(nodes) - 1, -1, -1) if n not in children]
    matrices: dict[int, Floats] = {}
    visits = 0
    while open_nodes:
        number, parent = open_nodes.pop()
        visits += 1
        if visits > len(nodes):
            raise InvalidMesh("The file's nodes contain each other; export it again.")
        matrix = parent @ _gltf_matrix(nodes[number])
        if "mesh" in nodes[number] and np.linalg.det(matrix):
            matrices.setdefault(nodes[number]["mesh"], matrix)
        open_nodes += [(child, matrix) for child in reversed(nodes[number].get("children", []))]
    return matrices


def _gltf_matrix(node: dict[str, Any]) -> Floats:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= node.get("scale", (1.0, 1.0, 1.0))
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix
