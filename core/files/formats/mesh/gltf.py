# SPDX-License-Identifier: GPL-3.0-or-later
"""GLB and glTF files, rewritten in their buffers."""

from __future__ import annotations

import base64
from collections.abc import Collection, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import numpy as np
import numpy.typing as npt

from ....errors import InvalidMesh, ShockError
from ...document import (
    NEW_NORMALS,
    Bools,
    Floats,
    Ints,
    Names,
    from_unit,
    is_invertible,
    joined,
    renewed_vertex_normals,
    stored,
    to_unit,
    transformed,
    unit,
)
from ...side_files import are_beside, copy_beside, find, is_absolute, located
from ...staging import within
from .gltf_maps import (
    is_beside,
    material_images,
    moved_color,
    refused_images,
    replace_image,
    use_png,
    write_beside,
)
from .gltf_tree import (
    DRACO,
    INSIDE,
    chunk_name,
    description,
    glb,
    glb_chunks,
    is_stored,
    read_tree,
    store,
    triangles_of,
    values_of,
)
from .maps import MapGroup, TexturedDocument, grouped

_ROUNDING = 1e-6  # differences of normals and colors that another order of summation causes
_MORPHS = "morph targets were left as they were: only the shape without them changed"


class GltfFile(TexturedDocument):
    """A GLB or glTF file; only positions, normals and colors in its buffers are rewritten.

    All meshes are transformed to the space of the scene, so that they are sharpened as they look
    there and join where they touch. A mesh that occurs several times in the scene counts once.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._in_place, self._is_beside = False, True
        self._fresh: list[str] = []  # images that were made anew beside the file
        self._tree, self._buffers = read_tree(path)
        self._chunks = glb_chunks(path.read_bytes())[2:]
        to_world = _gltf_matrices(self._tree)
        self._loose: dict[int, npt.NDArray[Any]] = {}  # accessors that are not stored contiguously
        self._rows: dict[int, tuple[slice, Floats]] = {}  # vertices of each POSITION accessor
        self._renewed: set[int] = set()  # accessors of normals or colors that hold new values
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
            for _, primitive in triangles_of(mesh):
                yield number, primitive

    def _triangles(self) -> Iterator[tuple[dict[str, Any], slice, Ints]]:
        """Each primitive with its vertices, and its triangles as indices of these."""
        first = 0
        for (_, primitive), count in zip(self._primitives(), self._counts, strict=True):
            rows = self._rows[primitive["attributes"]["POSITION"]][0]
            yield primitive, rows, self.faces[first : first + count] - rows.start
            first += count

    def _array(self, number: int) -> npt.NDArray[Any]:
        """The values of an accessor; changes to them are written."""
        if is_stored(self._tree["accessors"][number]):
            return values_of(self._tree, self._buffers, number)
        if number not in self._loose:
            self._loose[number] = values_of(self._tree, self._buffers, number)
        return self._loose[number]

    def _store_loose(self) -> None:
        """Give accessors that are not stored contiguously a buffer if their values changed."""
        for number, values in self._loose.items():
            try:
                found = values_of(self._tree, self._buffers, number)
            except IndexError:  # another accessor's change broke the indices of a sparse one
                found = None
            if found is None or not np.array_equal(values, found, equal_nan=True):
                store(self._tree, self._buffers, number, values)

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
            notes += [_MORPHS] * self._has_targets("POSITION", "NORMAL")
        return notes + self._write(path)

    def _has_targets(self, *names: str) -> bool:
        targets = (primitive.get("targets", ()) for _, primitive in self._primitives())
        return any(not {*names}.isdisjoint(each) for group in targets for each in group)

    def _drop_compressed(self) -> list[str]:
        """Drop the compressed copies of primitives, which would be stale."""
        dropped = [
            primitive["extensions"].pop(DRACO)
            for _, primitive in self._primitives()
            if DRACO in primitive.get("extensions", {})
        ]
        for key in ("extensionsUsed", "extensionsRequired") if dropped else ():
            names = [name for name in self._tree.pop(key, []) if name != DRACO]
            if names:
                self._tree[key] = names
        return ["its compressed copy (Draco) was left behind"] if dropped else []

    def own_files(self, target: Path) -> Collection[str]:
        # When written in place, buffers keep their names.
        self._is_beside = are_beside(self._path, target)
        is_same = target.exists() and target.samefile(self._path)
        self._in_place = is_same and self._is_beside
        names = self._side_files("buffers") if self._in_place else []
        return [str(located(self._path.parent, name)) for name in names]

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

    def moved_colors(self) -> Mapping[str, str]:
        materials = self._tree.get("materials", [])
        reasons = [(material.get("name", ""), moved_color(material)) for material in materials]
        return {name: reason for name, reason in reasons if reason}

    def read_maps(self) -> tuple[list[MapGroup], list[str]]:
        count = len(self.faces)
        shown: dict[int, Bools] = {}
        first = 0
        for primitive, _, faces in self._triangles():
            if "material" in primitive and "TEXCOORD_0" in primitive["attributes"]:
                mask = shown.setdefault(primitive["material"], np.zeros(count, dtype=np.bool_))
                mask[first : first + len(faces)] = True
            first += len(faces)
        uses, notes = [], []
        refused = refused_images(self._tree)
        for number, mask in shown.items():
            images, left = material_images(self._path, self._tree, self._buffers, number, refused)
            uses.append((mask, images))
            notes += left
        return grouped(uses), notes

    def save_maps(
        self, path: Path, positions: Floats, moved: Bools, images: Mapping[Any, bytes]
    ) -> list[str]:
        for number, data in images.items():
            if is_beside(self._tree, self._tree["images"][number]):
                self._fresh.append(write_beside(self._tree, number, data, path))
            else:
                replace_image(self._tree, self._buffers, number, data)
        use_png(self._tree, images)
        return self.save(path, positions, moved)

    def _renew(self, name: str, place: int, number: int, values: npt.NDArray[Any]) -> None:
        """Replace an attribute of the vertices of a POSITION accessor.

        Others may share the accessor `number`; it gets one of its own if their values differ.
        """
        accessors = self._tree["accessors"]
        values = values.astype(self._array(number).dtype)
        is_alone = self._uses.get(number, {name}) == {name}
        if is_alone and number not in self._renewed:
            self._renewed.add(number)
            self._array(number)[:] = values
        elif not is_alone or not np.allclose(values, self._array(number), 0.0, _ROUNDING):
            own = len(accessors)
            accessors.append(dict(accessors[number]))
            store(self._tree, self._buffers, own, values)
            for _, primitive in self._primitives():
                attributes = primitive["attributes"]
                if (attributes["POSITION"], attributes.get(name)) == (place, number):
                    attributes[name] = own
            number = own
        for bound in ("min", "max"):  # optional for all but positions, and now stale
            accessors[number].pop(bound, None)

    @cached_property
    def _uses(self) -> dict[int, set[str]]:
        """The attributes that each accessor of the file holds; those of morph targets say so."""
        found: dict[int, set[str]] = {}
        for mesh in self._tree.get("meshes", []):
            for primitive in mesh["primitives"]:
                for name, number in primitive["attributes"].items():
                    found.setdefault(number, set()).add(name)
                for target in primitive.get("targets", []):
                    for name, number in target.items():
                        found.setdefault(number, set()).add(f"target {name}")
        return found

    def _colors(self) -> list[tuple[int, int]]:
        """The POSITION accessors of vertices with colors, and the accessors of the colors."""
        found: dict[int, int] = {}
        for _, primitive in self._primitives():
            place, color = (primitive["attributes"].get(k) for k in ("POSITION", "COLOR_0"))
            if color is not None and found.setdefault(place, color) != color:
                raise ShockError(f"{self._path} colors the same vertices twice; export it anew.")
        return list(found.items())

    def read_colors(self) -> Floats:
        colors = np.full_like(self.vertices, np.nan)
        for place, accessor in self._colors():
            values = self._array(accessor)[:, :3]
            colors[self._rows[place][0]] = to_unit(values, values.dtype)
        return colors

    def save_colors(self, path: Path, colors: Floats) -> tuple[int, list[str]]:
        changed = 0
        fresh = []
        for place, accessor in self._colors():
            old = self._array(accessor)
            new = from_unit(colors[self._rows[place][0]], old.dtype)
            changed += int((new != old[:, :3]).any(axis=1).sum())
            fresh.append((place, accessor, np.hstack([new, old[:, 3:]])))  # opacity is kept
        for each in fresh:
            self._renew("COLOR_0", *each)
        if changed:
            notes = self._drop_compressed() + [_MORPHS] * self._has_targets("COLOR_0")
            return changed, notes + self._write(path)
        names = self._side_files("buffers", "images")
        if not self._is_beside and any(map(is_absolute, names)):
            return 0, self._write(path)
        path.write_bytes(self._path.read_bytes())
        return 0, copy_beside(self._path, names, path)[1]

    def _renew_normals(self, positions: Floats) -> bool:
        """Recompute all normals; returns whether there are any. Readers recompute tangents."""
        # Primitives that share positions may have different normals.
        starts: dict[tuple[int, int], int] = {}  # start of each accessor pair in the lists below
        vertices, old, triangles, total = [], [], [], 0
        for primitive, rows, faces in self._triangles():
            attributes = primitive["attributes"]
            for each in (attributes, *primitive.get("targets", [])):  # morph targets too
                each.pop("TANGENT", None)
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
            rows, matrix = self._rows[place]
            local = new[start : start + rows.stop - rows.start] @ matrix[:3, :3]
            self._renew("NORMAL", place, normal, unit(local))
        return True

    def _write(self, path: Path) -> list[str]:
        self._store_loose()
        binary, is_glb = b"", path.suffix.lower() == ".glb"
        written: set[Path] = set()
        for number, (buffer, data) in enumerate(
            zip(self._tree.get("buffers", []), self._buffers, strict=True)
        ):
            uri = buffer.get("uri", "")
            if uri.startswith(INSIDE):
                buffer["uri"] = uri.partition(",")[0] + "," + base64.b64encode(data).decode()
            elif is_glb and number == 0:
                buffer.pop("uri", None)
                binary = bytes(data)
            elif self._in_place and uri:
                place = located(self._path.parent, unquote(uri))
                if place is not None and is_absolute(unquote(uri)):  # not the one beside the copy
                    buffer["uri"] = quote(str(place))
                if place is not None and path.parent / place not in written:  # models may share it
                    file = within(path.parent, place)
                    file.write_bytes(data + self._rest(buffer, data))
                    written.add(file)
            else:  # a name that no buffer of another file has
                buffer["uri"] = quote(f"{path.name}.{number}.bin")
                within(path.parent, f"{path.name}.{number}.bin").write_bytes(data)
        if not self._is_beside:
            self._name_images_relatively()
        text = description(self._tree)
        path.write_bytes(glb(text, binary, self._chunks) if is_glb else text)
        notes = []
        if self._chunks and not is_glb:
            kinds = ", ".join(chunk_name(kind) for kind, _ in self._chunks)
            notes.append(f".gltf cannot hold parts of its own ({kinds}): left behind")
        names = [name for name in self._side_files("images") if name not in self._fresh]
        return notes + copy_beside(self._path, names, path)[1]

    def _name_images_relatively(self) -> None:
        for image in self._tree.get("images", []):
            name = unquote(image.get("uri", INSIDE))
            place = located(self._path.parent, name) if is_absolute(name) else None
            if place is not None:
                image["uri"] = quote(str(place))

    def _rest(self, buffer: dict[str, Any], data: bytearray) -> bytes:
        """Data behind a buffer in its file, which may belong to another model."""
        found = find(self._path.parent, unquote(buffer["uri"])) if self._in_place else None
        return found.read_bytes()[len(data) :] if found else b""

    def _side_files(self, *kinds: str) -> list[str]:
        entries = [entry for kind in kinds for entry in self._tree.get(kind, [])]
        uris = [entry.get("uri", INSIDE) for entry in entries]
        return [unquote(uri) for uri in uris if not uri.startswith(INSIDE)]


def _gltf_matrices(tree: dict[str, Any]) -> dict[int, Floats]:
    """Each mesh's transformation to the space of the scene, at its first occurrence."""
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
        if "mesh" in nodes[number] and is_invertible(matrix):
            matrices.setdefault(nodes[number]["mesh"], matrix)
        open_nodes += [(child, matrix) for child in reversed(nodes[number].get("children", []))]
    return matrices


def _gltf_matrix(node: dict[str, Any]) -> Floats:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    x, y, z, w = map(float, node.get("rotation", (0, 0, 0, 1)))
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    with np.errstate(over="ignore", invalid="ignore"):
        matrix[:3, :3] *= np.array(node.get("scale", (1, 1, 1)), dtype=np.float64)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix
