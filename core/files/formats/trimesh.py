# SPDX-License-Identifier: GPL-3.0-or-later
"""Files read by trimesh, to be written in another format."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from ...mesh.weld import weld
from ..document import Bools, Floats, Ints, joined, transformed
from ..reading import needed

# What each format can hold besides triangles, as far as trimesh writes it.
KEEPS: dict[str, set[str]] = {
    ".glb": {"colors", "UVs", "materials", "object names"},
    ".gltf": {"colors", "UVs", "materials", "object names"},
    ".obj": {"colors", "UVs", "materials"},
    ".ply": {"colors", "UVs"},
    ".off": set(),
    ".stl": set(),
}


def load_scene(path: Path, fix_texture: bool = False) -> Any:
    """Read a file; `fix_texture` has PLY files split vertices that have several coordinates."""
    trimesh = needed("trimesh", path)
    options: dict[str, Any] = {}
    if path.suffix.lower() == ".ply":  # keep the vertices in the order of the file
        options = {"fix_texture": fix_texture, "skip_materials": True}
    scene = trimesh.load_scene(path, process=False, **options)
    for mesh in scene.geometry.values():
        uv = getattr(getattr(mesh, "visual", None), "uv", None)
        if uv is not None and np.shape(uv)[1] < 2:
            raise ValueError("texture coordinates of one number")
    return scene


class SceneFile:
    """Any file that trimesh reads, to be written in another format; triangles only."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._scene = load_scene(path)
        self._meshes: list[tuple[Any, Floats, slice]] = []
        blocks: list[Floats] = []
        faces: list[Ints] = []
        first = 0
        for name, mesh in self._scene.geometry.items():
            if not len(getattr(mesh, "faces", ())):
                continue
            if path.suffix.lower() == ".stl":  # it repeats a vertex in each of its triangles
                representatives, index = weld(np.asarray(mesh.vertices))
                mesh.faces, mesh.vertices = index[mesh.faces], mesh.vertices[representatives]
            nodes = self._scene.graph.geometry_nodes[name]
            matrix = self._scene.graph[nodes[0]][0] if nodes else np.eye(4)
            blocks.append(transformed(np.asarray(mesh.vertices), matrix))
            faces.append(mesh.faces + first)
            self._meshes.append((mesh, matrix, slice(first, first + len(blocks[-1]))))
            first += len(blocks[-1])
        self.vertices, self.faces, self.parts = joined(blocks, faces, list(range(len(faces))))

    def save(self, path: Path, positions: Floats, moved: Bools) -> list[str]:
        for mesh, matrix, rows in self._meshes:
            vertices = np.array(mesh.vertices)
            back = transformed(positions[rows][moved[rows]], np.linalg.inv(matrix))
            vertices[moved[rows]] = back
            mesh.vertices = vertices  # trimesh forgets stale normals by this
        _export(self._scene, path)
        return self._losses(path.suffix.lower())

    def _losses(self, ending: str) -> list[str]:
        notes = []
        polygons = _polygon_count(self._path)
        if polygons is not None and polygons < len(self.faces):
            notes.append("polygons were cut into triangles")
        lost = sorted(_contents([mesh for mesh, _, _ in self._meshes]) - KEEPS[ending])
        if lost:
            notes.append(f"{ending} cannot hold {', '.join(lost)}: left behind")
        return notes


def _contents(meshes: list[Any]) -> set[str]:
    kinds = {mesh.visual.kind for mesh in meshes}
    contents = {"object names"} if len(meshes) > 1 else set()
    if kinds & {"vertex", "face"}:
        contents.add("colors")
    if "texture" in kinds:
        contents |= {"UVs", "materials"}
    return contents


def _polygon_count(path: Path) -> int | None:
    """Number of polygons that a file states, for formats that have them."""
    ending, data = path.suffix.lower(), path.read_bytes()
    if ending == ".obj":
        return len(re.findall(rb"^[ \t]*f[ \t]", data, re.MULTILINE))
    if ending == ".ply":
        stated = re.search(rb"^element face (\d+)", data, re.MULTILINE)
    elif ending == ".off":
        stated = re.search(rb"^\s*\d+\s+(\d+)\s+\d+\s*$", data, re.MULTILINE)
    else:
        return None
    return int(stated[1]) if stated else None


def _export(scene: Any, path: Path) -> None:
    ending = path.suffix.lower()
    if ending in (".glb", ".gltf"):
        scene.export(path, **({"embed_buffers": True} if ending == ".gltf" else {}))
    elif ending == ".obj":
        scene.export(path, digits=12, mtl_name=f"{path.stem}.mtl")
    elif ending == ".off":
        scene.to_mesh().export(path, digits=17)
    else:
        scene.to_mesh().export(path)
