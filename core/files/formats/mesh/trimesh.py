# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that trimesh reads, and that are written in another format."""

from __future__ import annotations

import io
import itertools
import os
import re
from codecs import BOM_UTF8
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from ....errors import ShockError
from ....mesh.weld import weld
from ...document import Bools, Document, Floats, Ints, is_invertible, joined, stored, transformed
from ...reading import needed, writing
from ...side_files import Resolver
from ...staging import within
from .contents import REPLACED, contents, off_rows, polygon_count
from .gltf_tree import densified, read_tree
from .obj import look_through, material_files, with_concave_cut
from .ply_lists import with_even_lists
from .polygons import fans, without_flips

ENDINGS = (".glb", ".gltf", ".obj", ".ply", ".off", ".stl")

_DOUBLE = (".obj", ".off")  # other formats hold 32 bits
_INDICES = ("vertex_indices", "vertex_index")
_LONGEST = 100  # letters of a material's name in the name of an image


def load_scene(path: Path, fix_texture: bool = False) -> tuple[Any, list[str]]:
    """Read a file; also returns notes on other files that it names.

    `fix_texture` splits the vertices of PLY files that have several coordinates.
    """
    trimesh = needed("trimesh", path)
    options: dict[str, Any] = {}
    if path.suffix.lower() == ".ply":  # keeps the order of the vertices
        options = {"fix_texture": fix_texture, "skip_materials": True}
    known: dict[str, bytes] = {}
    data = _readable(path)
    file: Any = path if data is None else io.BytesIO(data)
    ending = path.suffix[1:].lower()
    if path.suffix.lower() in (".glb", ".gltf"):
        tree, buffers = read_tree(path)
        uris = [buffer.get("uri") for buffer in tree.get("buffers", [])]
        known = {uri: bytes(data) for uri, data in zip(uris, buffers, strict=True) if uri}
        dense = densified(tree, buffers)
        if dense is not None:
            ending, file = "gltf", io.BytesIO(dense)
    resolver = Resolver(path, known)
    if ending == "obj":
        known |= _libraries(path, resolver)
    if ending in ("obj", "off"):
        text = path.read_bytes() if data is None else data
        cut = _as_triangles(text) if ending == "off" else with_concave_cut(text)
        file = file if cut is text else io.BytesIO(cut)
    options |= {"resolver": resolver, "file_type": ending}
    scene = trimesh.load_scene(file, process=False, **options)
    for mesh in scene.geometry.values():
        uv = getattr(getattr(mesh, "visual", None), "uv", None)
        if uv is not None and np.shape(uv)[1] < 2:
            raise ValueError("texture coordinates of one number")
        if ending == "ply" and hasattr(mesh, "faces"):
            _cut_concave(mesh)
    return scene, resolver.notes()


def _cut_concave(mesh: Any) -> None:
    """Cut the concave polygons of a PLY file anew, which trimesh cut into fans.

    Its order is triangles, first halves of quads, second halves, fans of other polygons.
    """
    data = mesh.metadata["_ply_raw"]["face"]["data"]
    names = data.dtype.names if isinstance(data, np.ndarray) else tuple(data)
    name = next((name for name in _INDICES if name in names), None)
    if name is None:
        return
    lists = data[name]["f1"] if isinstance(data, np.ndarray) else data[name]
    sizes = np.array([len(each) for each in lists])
    quads, more = np.arange(np.count_nonzero(sizes == 4)), sizes[sizes > 4] - 2
    first = np.count_nonzero(sizes == 3)
    others = np.repeat(np.arange(len(more)), more) + first + len(quads)
    owner = np.concatenate([np.arange(first), quads + first, quads + first, others])
    if len(owner) != len(mesh.faces):
        return
    old = np.array(mesh.faces)
    second = slice(first + len(quads), first + 2 * len(quads))
    old[second] = np.roll(old[second], 1, axis=1)
    new = without_flips(np.asarray(mesh.vertices, dtype=np.float64), old, owner)
    changed = (new != old).any(axis=1)
    if changed.any():
        mesh.faces = np.where(changed[:, None], new, mesh.faces)


def _as_triangles(text: bytes) -> bytes:
    """An OFF file whose polygons are triangles, as trimesh reads none of more than four corners."""
    vertices, rows = off_rows(text)
    count, faces = len(vertices), [row[1 : int(row[0]) + 1] for row in rows]
    if all(len(face) == 3 for face in faces):
        return text
    points = np.array([row[:3] for row in vertices], dtype=np.float64)
    corners = np.array([word for face in faces for word in face], dtype=np.int64)
    cut, owners = fans(np.array([len(face) for face in faces]))
    triangles = without_flips(points, corners[cut], owners)
    header = f"OFF\n{count} {len(triangles)} 0\n".encode()
    table = [b" ".join(row[:3]) for row in vertices]
    table += [b"3 %d %d %d" % tuple(triangle) for triangle in triangles]
    return header + b"\n".join(table) + b"\n"


def _libraries(path: Path, resolver: Resolver) -> dict[str, bytes]:
    """All material files of an OBJ file, in one, by the name that trimesh asks for."""
    lines = re.sub(rb"\\\r?\n", b"", path.read_bytes()).splitlines()
    names = material_files(path.parent, lines)
    asked = re.search(rb"mtllib(.*)", b"\n".join(lines))
    if len(names) < 2 or asked is None:
        return {}
    found = [resolver.get(name) for name in names if resolver.has(name)]
    return {asked[1].strip().decode("utf-8", "replace"): b"\n".join(found)}


def _readable(path: Path) -> bytes | None:
    """A file's contents as trimesh expects them, in UTF-8; None if they are so already."""
    ending, data = path.suffix.lower(), path.read_bytes()
    if ending == ".ply":  # comments of the header may hold letters
        even = with_even_lists(data)
        text = data if even is None else even
        end = text.find(b"end_header") + 1
        return even if text[:end].isascii() else _to_ascii(text[:end]) + text[end:]
    if ending == ".stl":
        count = int.from_bytes(data[80:84], "little")
        if len(data) == 84 + 50 * count:
            return None  # binary
        if b"facet" not in data.lower():
            raise ValueError("neither text nor as long as its header says")
    elif ending not in (".obj", ".off"):
        return None
    try:
        data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1").encode()
    return data.removeprefix(BOM_UTF8) if data.startswith(BOM_UTF8) else None


def _to_ascii(data: bytes) -> bytes:
    return data.decode("latin-1").encode("ascii", "replace")


class SceneFile(Document):
    """Any file that trimesh reads, written in another format; triangles only."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._scene, self._notes = load_scene(path)
        self._meshes: list[tuple[Any, Floats, slice]] = []
        blocks: list[Floats] = []
        faces: list[Ints] = []
        first = 0
        for name, mesh in list(self._scene.geometry.items()):
            if not len(getattr(mesh, "vertices", ())):
                self._scene.delete_geometry(name)  # some formats would write an empty line
            if not len(getattr(mesh, "faces", ())):
                continue
            if path.suffix.lower() == ".stl":  # repeats a vertex in each of its triangles
                representatives, index = weld(np.asarray(mesh.vertices))
                mesh.faces, mesh.vertices = index[mesh.faces], mesh.vertices[representatives]
            matrix = self._matrix(name)
            blocks.append(transformed(np.asarray(mesh.vertices), matrix))
            faces.append(mesh.faces + first)
            self._meshes.append((mesh, matrix, slice(first, first + len(blocks[-1]))))
            first += len(blocks[-1])
        self.vertices, self.faces, self.parts = joined(blocks, faces, list(range(len(faces))))

    def _matrix(self, name: str) -> Floats:
        """A mesh's transformation to the space of the scene, at its first visible occurrence."""
        nodes = self._scene.graph.geometry_nodes[name]
        matrices = [self._scene.graph[node][0] for node in nodes] or [np.eye(4)]
        found = next(filter(is_invertible, matrices), None)
        if found is None:
            raise ShockError(
                f"{self._path}: {name} is scaled to 0, so that nothing of it is seen; set its"
                " scale, or remove it."
            )
        return found

    def read_back(self, path: Path) -> None:
        if path.suffix.lower() == ".obj":
            count, vertices = look_through(path)
        else:
            written = SceneFile(path)
            count, vertices = len(written.faces), written.vertices
        if count < len(self.faces) or not np.isfinite(vertices).all():
            raise ValueError("fewer faces")

    def save(self, path: Path, positions: Floats, moved: Bools) -> list[str]:
        if path.suffix.lower() not in _DOUBLE:
            stored(positions, np.dtype(np.float32))
        for mesh, matrix, rows in self._meshes:
            vertices = np.array(mesh.vertices)
            back = transformed(positions[rows][moved[rows]], np.linalg.inv(matrix))
            vertices[moved[rows]] = back
            mesh.vertices = vertices  # makes trimesh drop stale normals
        with writing(path):
            _export(self._scene, path)
            return self._losses(path)

    def _losses(self, written: Path) -> list[str]:
        notes = list(self._notes)
        polygons = polygon_count(self._path)
        if polygons is not None and polygons < len(self.faces):
            notes.append("polygons were cut into triangles")
        elif polygons is not None and polygons > len(self.faces):
            notes.append(f"of {polygons} polygons, {len(self.faces)} could be read")
        lost = sorted(contents(self._path) - (contents(written) - REPLACED))
        if lost:
            notes.append(f"{written.suffix} files written here lack {', '.join(lost)}")
        return notes


def _export(scene: Any, path: Path) -> None:
    ending = path.suffix.lower()
    if ending in (".glb", ".gltf"):
        _use_pbr(scene)
        scene.export(path, **({"embed_buffers": True} if ending == ".gltf" else {}))
    elif ending == ".obj":
        _export_obj(scene, path)
    elif ending == ".off":
        scene.to_mesh().export(path, digits=17)
    else:
        scene.to_mesh().export(path)


def _use_pbr(scene: Any) -> None:
    """Turn materials of OBJ files into those of glTF, with what trimesh leaves out: names, opacity.

    Materials that are equal but for their name stay apart.
    """
    known: dict[int, Any] = {}
    for mesh in scene.geometry.values():
        material: Any = getattr(getattr(mesh, "visual", None), "material", None)
        if not hasattr(material, "kwargs"):  # not one of an OBJ file
            continue
        if id(material) not in known:
            known[id(material)] = pbr = material.to_pbr()
            pbr.name = material.name
            opacity = _opacity(material.kwargs.get("d"))
            if opacity < 1.0:
                pbr.baseColorFactor = [*pbr.baseColorFactor[:3], round(255 * opacity)]
                pbr.alphaMode = "BLEND"
        mesh.visual.material = known[id(material)]


def _opacity(words: Any) -> float:
    """The number of a line `d`, which options may precede; 1 if there is none."""
    try:
        return min(max(float(words[-1]), 0.0), 1.0)
    except (IndexError, TypeError, ValueError):
        return 1.0


def _export_obj(scene: Any, path: Path) -> None:
    """Write an OBJ file, and its materials and images, all named after it to avoid clashes.

    Names of images and materials come from the source file.
    """
    library = f"{path.name}.mtl"
    options = {"digits": 12, "mtl_name": library, "return_texture": True}
    text, files = scene.export(file_type="obj", **options)
    path.write_bytes(text.encode())
    names: dict[str, str] = {}
    for name in files:
        names[name] = library if name == library else _own_name(path, name, names.values())
    for name, data in files.items():
        if name == library:
            data = _with_names(data, names)
        within(path.parent, names[name]).write_bytes(data)


def _own_name(path: Path, name: str, taken: Collection[str]) -> str:
    """A short name for an image that does not lead to other folders."""
    stem, ending = os.path.splitext(re.sub(r"[^\w.\- ]", "_", name).strip())
    tries = (f"{path.name}.{stem[-_LONGEST:]}{n or ''}{ending}" for n in itertools.count())
    return next(own for own in tries if own not in taken)


def _with_names(data: bytes, names: dict[str, str]) -> bytes:
    lines = data.decode("utf-8").split("\n")
    for number, line in enumerate(lines):
        word, _, name = line.partition(" ")
        if word == "map_Kd" and name in names:
            lines[number] = f"{word} {names[name]}"
    return "\n".join(lines).encode()
