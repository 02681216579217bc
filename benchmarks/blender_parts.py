# SPDX-License-Identifier: GPL-3.0-or-later
"""Random parts and letters out of Blender's voxel remesh, and the edges of a notch.

Needs bpy. Errors are mean degrees between faces' normals and those of the nearest place of the
part as it was designed, or of another one within 0.05 edges of that; by area. None of these parts
is used for training, which makes solids and voxels by its own code.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
import numpy.typing as npt
from mathutils import Euler
from mathutils.bvhtree import BVHTree
from report import Page, table
from shock_filter import core

Floats = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.int32]

FIRST_SEED = 900_000
PRESERVED = ", volume preserved"
"""Kinds with this ending are remeshed by the operator with *Preserve Volume*, its default; others
by the modifier, which does not have it."""

COUNTS = {"part": 40, "fillets": 24, "figure on a part": 10, "round": 10,
          f"part{PRESERVED}": 40, f"fillets{PRESERVED}": 24, "letters": 24,
          f"letters{PRESERVED}": 24, f"letters, round edges{PRESERVED}": 24}  # fmt: skip
VOXELS = 0.022, 0.085
FACES = 2000, 120_000
"""Parts are about two wide; remeshes of fewer or more faces are left out."""

WORDS = "Shock", "Filter", "Rag 85", "&@S?", "Mix", "gyre"
LETTER_VOXELS = 0.01, 0.03
"""Letters are about 0.7 high."""

NOTCH = {"concave": (0.5, 0.2), "convex": (0.5, 0.5)}
"""Edges along y, by x and z: a box, (2, 1.4, 1) wide, from which a corner is cut."""

NOTCH_VOXELS = 0.1, 0.07, 0.05, 0.035, 0.025
WAYS = np.r_[np.zeros((1, 3)), np.eye(3), -np.eye(3)]


@dataclass
class Part:
    """A remesh, and what was designed."""

    vertices: Floats
    faces: Triangles
    design: tuple[Floats, Triangles]

    def errors(self, vertices: Floats) -> tuple[Floats, Floats]:
        """Return angle errors in degrees and areas of the faces, for new vertex positions."""
        tree = BVHTree.FromPolygons(*(x.tolist() for x in self.design))
        wanted = core.TriangleMesh(*self.design).normals
        mesh = core.TriangleMesh(vertices, self.faces)
        step = 0.05 * mesh.mean_edge_length
        centers = vertices[self.faces].mean(axis=1)
        near = np.array([tree.find_nearest(p)[0] for p in centers.tolist()])
        best = np.full(mesh.face_count, -1.0)
        for way in WAYS:
            found = [tree.find_nearest(p)[2] for p in (near + step * way).tolist()]
            best = np.maximum(best, (wanted[found] * mesh.normals).sum(axis=1))
        return np.degrees(np.arccos(np.clip(best, -1.0, 1.0))), mesh.areas

    def folds(self, vertices: Floats) -> int:
        """Edges that close beyond 150 degrees."""
        mesh = core.TriangleMesh(vertices, self.faces)
        face, side = np.nonzero(mesh.twins >= 0)
        cosines = (mesh.normals[face] * mesh.normals[mesh.twins[face, side] // 3]).sum(axis=1)
        return int((cosines < np.cos(np.radians(150.0))).sum()) // 2


def remeshed(obj: bpy.types.Object, turn: Euler, voxel: float, preserved: bool = False) -> Part:
    """Rotate the evaluated object, and remesh it with voxels of the given size."""
    apply(obj)
    obj.data.transform(turn.to_matrix().to_4x4())
    design = arrays(obj.data)
    if preserved:
        bpy.context.view_layer.objects.active = obj
        obj.data.remesh_voxel_size, obj.data.use_remesh_preserve_volume = voxel, True
        bpy.ops.object.voxel_remesh()
        return Part(*arrays(obj.data), design)
    modifier = obj.modifiers.new("Remesh", "REMESH")
    modifier.mode, modifier.voxel_size, modifier.adaptivity = "VOXEL", voxel, 0.0
    apply(obj)
    return Part(*arrays(obj.data), design)


def apply(obj: bpy.types.Object) -> None:
    """Apply the modifiers of an object."""
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = bpy.data.meshes.new_from_object(evaluated)
    obj.modifiers.clear()
    obj.data = mesh


def arrays(mesh: bpy.types.Mesh) -> tuple[Floats, Triangles]:
    """Return places and triangles."""
    mesh.calc_loop_triangles()
    places = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", places)
    faces = np.empty(3 * len(mesh.loop_triangles), dtype=np.int32)
    mesh.loop_triangles.foreach_get("vertices", faces)
    return places.reshape(-1, 3).astype(np.float64), faces.reshape(-1, 3)


def random_part(kind: str, seed: int) -> Part:
    """Make a part of a kind of `COUNTS` from a seed."""
    rng = np.random.default_rng(seed)
    bpy.ops.wm.read_homefile(use_empty=True)
    preserved = kind.endswith(PRESERVED)
    kind = kind.removesuffix(PRESERVED)
    with_letters = kind.startswith("letters")
    voxel = float(np.exp(rng.uniform(*np.log(LETTER_VOXELS if with_letters else VOXELS))))
    if with_letters:
        obj = _letters(rng, voxel if kind.endswith("round edges") else 0.0)
    elif kind == "round":
        obj = _round(rng)
    else:
        obj = simple(rng, rng.uniform(1.3, 1.9))
        if kind == "fillets":
            bevel = obj.modifiers.new("Bevel", "BEVEL")
            bevel.width, bevel.segments = voxel * float(np.exp(rng.uniform(0, np.log(7)))), 8
        for _ in range(rng.integers(1, 5)):
            other = simple(rng, rng.uniform(0.4, 1.1))
            other.location = rng.uniform(-0.6, 0.6, 3)
            combine(obj, other, "UNION" if rng.random() < 0.5 else "DIFFERENCE")
        if kind == "figure on a part":
            figure = _figure(3)
            figure.location = 0, 0, 0.6
            combine(obj, figure, "UNION")
    turn = Euler(rng.uniform(0, 2 * np.pi, 3) if rng.random() < 0.6 else (0, 0, 0))
    return remeshed(obj, turn, voxel, preserved)


def _letters(rng: np.random.Generator, voxel: float) -> bpy.types.Object:
    # Extruded text; with a voxel size, with roundings of 1 to 6 voxels along its edges.
    bpy.ops.object.text_add()
    text = bpy.context.object.data
    text.body, text.extrude = str(rng.choice(WORDS)), float(rng.uniform(0.05, 0.2))
    text.bevel_depth = voxel * float(np.exp(rng.uniform(0, np.log(6)))) if voxel else 0.0
    bpy.ops.object.convert(target="MESH")
    return bpy.context.object


def combine(obj, other, operation: str) -> None:
    """Add a boolean modifier."""
    modifier = obj.modifiers.new(operation, "BOOLEAN")
    modifier.solver, modifier.operation, modifier.object = "EXACT", operation, other


def simple(rng: np.random.Generator, size: float) -> bpy.types.Object:
    """Add a random primitive."""
    a, b, c = rng.uniform(0.25, 0.7, 3) * size
    kind = rng.integers(0, 6)
    scale = a, a, b
    if kind <= 2:
        bpy.ops.mesh.primitive_cube_add(size=2)
        scale = a, b, c
    elif kind == 3:
        bpy.ops.mesh.primitive_cone_add(
            vertices=64, radius1=1, radius2=rng.choice([0, 0.4, 0.7]), depth=2
        )
    else:
        corners = rng.choice([3, 4, 5, 6, 8, 48, 96])
        bpy.ops.mesh.primitive_cylinder_add(vertices=int(corners), radius=1, depth=2)
    obj = bpy.context.object
    obj.scale = scale
    bpy.ops.object.transform_apply(scale=True)
    if rng.random() < 0.3:
        obj.rotation_euler = rng.uniform(0, 2 * np.pi, 3)
    elif rng.random() < 0.4:
        obj.rotation_euler = rng.integers(0, 4, 3) * np.pi / 2
    return obj


def _figure(levels: int) -> bpy.types.Object:
    bpy.ops.mesh.primitive_monkey_add()
    bpy.context.object.modifiers.new("Subdivision", "SUBSURF").levels = levels
    return bpy.context.object


def _ball() -> bpy.types.Object:
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=7)
    return bpy.context.object


def _round(rng: np.random.Generator) -> bpy.types.Object:
    kind = rng.integers(0, 3)
    if kind == 0:
        bpy.ops.mesh.primitive_torus_add(
            major_segments=96, minor_segments=48, major_radius=0.8, minor_radius=0.3
        )
        return bpy.context.object
    obj = _figure(4) if kind == 1 else _ball()
    obj.scale = rng.uniform(0.4, 1.0, 3)
    bpy.ops.object.transform_apply(scale=True)
    return obj


def notched(turn: Euler, voxel: float) -> Part:
    """Make the box of `NOTCH`."""
    bpy.ops.wm.read_homefile(use_empty=True)
    boxes = []
    for place, size in (((0, 0, 0), (2, 1.4, 1)), ((1, 0, 0.5), (1, 4, 0.6))):
        bpy.ops.mesh.primitive_cube_add(size=1, location=place, scale=size)
        bpy.ops.object.transform_apply()
        boxes.append(bpy.context.object)
    combine(*boxes, "DIFFERENCE")
    return remeshed(boxes[0], turn, voxel)


def parts(share: float) -> Iterator[tuple[str, Part]]:
    for number, (kind, count) in enumerate(COUNTS.items()):
        for seed in range(max(int(share * count), 1)):
            part = random_part(kind, FIRST_SEED + 1000 * number + seed)
            if FACES[0] <= len(part.faces) <= FACES[1]:
                yield kind, part


def by_kind(share: float, say: Callable[[str], None]) -> list[list[str]]:
    found: dict[str, list[tuple[float, float, int]]] = {}
    for kind, part in parts(share):
        result = core.sharpen_geometry(core.TriangleMesh(part.vertices, part.faces))
        before, after = (
            float(np.average(degrees, weights=areas))
            for degrees, areas in map(part.errors, (part.vertices, result))
        )
        new = max(part.folds(result) - part.folds(part.vertices), 0)
        found.setdefault(kind, []).append((before, after, new))
        say(f"{kind}: {len(part.faces)} faces, {before:.2f} to {after:.2f}, {new} folds")
    rows = []
    for kind, results in found.items():
        before, after, new = np.array(results).T
        left = after / np.maximum(before, 0.05)
        rows.append([kind, f"{len(left)}", f"{before.mean():.2f}", f"{after.mean():.2f}",
                     f"{left.mean():.2f}", f"{left.max():.2f}", f"{(left > 1.03).mean():.0%}",
                     f"{new.sum():.0f}"])  # fmt: skip
    return rows


def of_notch() -> list[list[str]]:
    rows = []
    for name, turn in (("upright", (0, 0, 0)), ("turned", (0.3, 0.5, 0.2)), ("", (2.1, 0.9, 4.0))):
        for voxel in NOTCH_VOXELS:
            part = notched(Euler(turn), voxel)
            result = core.sharpen_geometry(core.TriangleMesh(part.vertices, part.faces))
            back = np.array(Euler(turn).to_matrix())
            middle = part.vertices[part.faces].mean(axis=1) @ back
            row = [f"{name or 'otherwise'}, {voxel}", f"{len(part.faces):,}"]
            for x, z in NOTCH.values():
                near = np.hypot(middle[:, 0] - x, middle[:, 2] - z) < 2 * voxel
                near &= abs(middle[:, 1]) < 0.7 - 3 * voxel
                for vertices in (part.vertices, result):
                    degrees, areas = part.errors(vertices)
                    row.append(f"{np.average(degrees[near], weights=areas[near]):.2f}")
            rows.append(row)
    return rows


def main() -> None:
    """Print the tables, or write them into a page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", type=Path, help="Markdown page to write the tables into")
    parser.add_argument("--share", type=float, default=1.0, help="of the parts, to try out")
    options = parser.parse_args()
    page = Page(options.write)
    head = ["", "faces", *(f"{name}: {when}" for name in NOTCH for when in ("input", "ours"))]
    page.write("notch", table(head, of_notch()))
    head = ["", "parts", "input", "ours", "share", "worst", "worse by 3 %", "folds"]
    page.write("blender-parts", table(head, by_kind(options.share, print)))


if __name__ == "__main__":
    main()
