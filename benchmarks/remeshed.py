# SPDX-License-Identifier: GPL-3.0-or-later
"""How well sharp parts are restored after Blender's voxel remesh, against other methods.

Three parts of the demo, remeshed askew to the voxels' grid. Needs bpy. Normals are compared with
those of the nearest place on the part as it was designed; points on its creases, with the result.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import numpy.typing as npt
from mathutils.bvhtree import BVHTree
from report import Page, table
from shock_filter import core

sys.path.append(str(Path(__file__).resolve().parent.parent / "demo"))
import shapes

TURNS = {"tuned": (0.3, 0.5, 0.2), "apart": (0.9, 0.15, 1.1)}
"""What is remeshed in the first way was looked at while defaults were chosen, the rest was not."""

VOXELS = 60, 120
PARTS: dict[str, Callable[[], bpy.types.Object]] = {
    "gear": lambda: shapes.gear(spacing=0.05),
    "nut": shapes.nut,
    "box": shapes.cut_box,
}
CREASE = np.cos(np.radians(30.0))
TURNED = np.cos(np.radians(100.0))
"""Beyond a right angle: beside an edge the nearest place may be on its other side."""

SLIVER = 0.1
"""Shape below which a face is one; an equilateral triangle has 1."""

Floats = npt.NDArray[np.float64]


def arrays(mesh: bpy.types.Mesh) -> tuple[Floats, npt.NDArray[np.int32]]:
    """Return positions and triangles."""
    mesh.calc_loop_triangles()
    return shapes.read_positions(mesh).astype(np.float64), shapes.read_triangles(mesh)


def crease_points(vertices: Floats, faces: npt.NDArray[np.int32]) -> Floats:
    """Points on the edges at which the surface turns by more than 30 degrees."""
    mesh = core.TriangleMesh(vertices, faces)
    sides: dict[tuple[int, int], list[int]] = {}
    for face, (a, b, c) in enumerate(mesh.faces.tolist()):
        for edge in ((a, b), (b, c), (c, a)):
            sides.setdefault((min(edge), max(edge)), []).append(face)
    sharp = [
        edge
        for edge, pair in sides.items()
        if len(pair) == 2 and mesh.normals[pair[0]] @ mesh.normals[pair[1]] < CREASE
    ]
    begin, end = vertices[np.array(sharp).T]
    shares = np.linspace(0.05, 0.95, 10)[:, None, None]
    return (begin + shares * (end - begin)).reshape(-1, 3)


def errors(
    designed: tuple[Floats, npt.NDArray[np.int32]],
    creases: Floats,
    found: tuple[Floats, npt.NDArray[np.int32]],
) -> tuple[float, float, int, int]:
    """Mean degrees to the design's normals, RMS edges from creases, turned faces, slivers."""
    vertices, faces = found
    mesh = core.TriangleMesh(vertices, faces)
    normals = mesh.normals * np.where(mesh.flipped, -1.0, 1.0)[:, None]
    true = BVHTree.FromPolygons(designed[0].tolist(), designed[1].tolist())
    tree = BVHTree.FromPolygons(vertices.tolist(), faces.tolist())
    wanted = np.array([true.find_nearest(c)[1][:] for c in vertices[faces].mean(axis=1).tolist()])
    cosines = np.clip((normals * wanted).sum(axis=1), -1.0, 1.0)
    off = np.degrees(np.arccos(cosines))
    far = np.array([tree.find_nearest(p)[3] for p in creases.tolist()]) / mesh.mean_edge_length
    return (
        float(np.average(off, weights=mesh.areas)),
        float(np.sqrt((far**2).mean())),
        int((cosines < TURNED).sum()),
        int((shapes_of(mesh) < SLIVER).sum()),
    )


def shapes_of(mesh: core.TriangleMesh) -> Floats:
    """Area over the mean squared edge of each face, relative to an equilateral triangle."""
    corners = mesh.scaled_vertices[mesh.faces]
    edges = corners - np.roll(corners, 1, axis=1)
    return 4.0 * np.sqrt(3.0) * mesh.areas / np.maximum((edges**2).sum(axis=(1, 2)), 1e-30)


def blender_sharp(part: bpy.types.Object, depth: int) -> tuple[Floats, npt.NDArray[np.int32]]:
    """Remesh the designed part with Blender's modifier in sharp mode."""
    modifier = part.modifiers.new("Remesh", "REMESH")
    modifier.mode, modifier.octree_depth, modifier.use_remove_disconnected = "SHARP", depth, False
    part.modifiers.new("Triangulate", "TRIANGULATE")
    shapes.apply(part)
    return arrays(part.data)


def main() -> None:
    """Print the table, or write it into a page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", type=Path, help="Markdown page to write the table into")
    options = parser.parse_args()
    bpy.ops.wm.read_homefile(use_empty=True)
    rows = []
    for which, turn in TURNS.items():
        for name, make in PARTS.items():
            designed = arrays(make().data)
            creases = crease_points(*designed)
            for voxels in VOXELS:
                part = make()
                shapes.remesh(part, voxels, turn)
                vertices, faces = arrays(part.data)
                mesh = core.TriangleMesh(vertices, faces)
                paper = core.sharpen_geometry(mesh, core.GeometrySettings.of_paper())
                depth = int(np.ceil(np.log2(voxels)))
                results = [
                    errors(designed, creases, found)
                    for found in (
                        (vertices, faces),
                        (paper, faces),
                        (core.sharpen_geometry(mesh), faces),
                        blender_sharp(make(), depth),
                    )
                ]
                row = [f"{name}, {voxels} voxels, {which}", f"{len(vertices):,}"]
                row += [f"{result[0]:.2f}" for result in results]
                row += [f"{result[1]:.2f}" for result in results]
                row += [f"{results[0][k]} to {results[2][k]}" for k in (2, 3)]
                rows.append(row)
                print("; ".join(rows[-1]), flush=True)
    names = ["remeshed", "paper's", "ours", "sharp mode"]
    head = ["", "vertices", *(f"{n}: degrees" for n in names), *(f"{n}: creases" for n in names)]
    Page(options.write).write("remeshed", table([*head, "turned faces", "slivers"], rows))


if __name__ == "__main__":
    main()
