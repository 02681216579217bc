# SPDX-License-Identifier: GPL-3.0-or-later
"""Crisp Low Poly against Blender's planar dissolve and decimation, at equal face counts.

``python benchmarks/low_poly.py --write docs/creases.md`` puts the table into the page.

Five parts of the tests, remeshed askew by surface nets. Needs bpy. Errors are
mean angles, by area, to the normals of the design; creases are the part of its creases that lies
within half an edge length of an edge that is sharper than 25 degrees.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import bpy
import numpy as np
import numpy.typing as npt
from report import Page, table
from scipy.spatial import cKDTree
from shock_filter import core

# Before this folder, which has another `remeshed`.
sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "core"))
import parts

Floats = npt.NDArray[np.float64]

COUNT = 60
SHARP = np.cos(np.radians(25.0))
PARTS = {
    "cube": lambda: parts.box((0.8, 0.8, 0.8)),
    "slab": lambda: parts.box((1.1, 0.6, 0.25)),
    "bracket": parts.bracket,
    "cog of five": lambda: parts.cog(5),
    "wide fillets": lambda: parts.filleted(0.4),
}


def error(mesh: core.TriangleMesh, distance, count: int = 40000) -> float:
    """Mean degrees to the normals of the design."""
    rng = np.random.default_rng(0)
    face = rng.choice(mesh.face_count, count, p=mesh.areas / mesh.areas.sum())
    shares = rng.dirichlet((1.0, 1.0, 1.0), count)[..., None]
    points = (shares * mesh.vertices[mesh.faces[face]]).sum(axis=1)
    steps = 1e-4 * np.eye(3)
    wanted = np.stack([distance(points + s) - distance(points - s) for s in steps], axis=1)
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True) + 1e-12
    cosines = np.clip((wanted * mesh.normals[face]).sum(axis=1), -1, 1)
    return float(np.degrees(np.arccos(cosines)).mean())


def creases_kept(mesh: core.TriangleMesh, creases: Floats, reach: float) -> float:
    """Part of the design's creases that lies near a sharp edge."""
    face, side = np.nonzero(mesh.twins >= 0)
    other = mesh.twins[face, side] // 3
    sharp = (mesh.normals[face] * mesh.normals[other]).sum(axis=1) < SHARP
    face, side = face[sharp], side[sharp]
    if len(face) == 0:
        return 0.0
    ends = mesh.vertices[mesh.faces[face, side]], mesh.vertices[mesh.faces[face, (side + 1) % 3]]
    points = [ends[0] + s * (ends[1] - ends[0]) for s in np.linspace(0, 1, 200)]
    return float((cKDTree(np.concatenate(points)).query(creases)[0] < reach).mean())


def decimated(vertices: Floats, faces: npt.NDArray, kind: str, wanted: int) -> core.TriangleMesh:
    """Decimate to about so many triangles with Blender's modifier."""
    mesh = bpy.data.meshes.new("part")
    mesh.from_pydata(vertices.tolist(), [], faces.tolist())
    obj = bpy.data.objects.new("part", mesh)
    bpy.context.collection.objects.link(obj)
    modifier = obj.modifiers.new("Decimate", "DECIMATE")
    modifier.decimate_type = kind

    def result() -> core.TriangleMesh:
        graph = bpy.context.evaluated_depsgraph_get()
        made = obj.evaluated_get(graph).to_mesh()
        made.calc_loop_triangles()
        points = np.empty(3 * len(made.vertices))
        made.vertices.foreach_get("co", points)
        triangles = np.empty(3 * len(made.loop_triangles), dtype=np.int32)
        made.loop_triangles.foreach_get("vertices", triangles)
        return core.TriangleMesh(points.reshape(-1, 3), triangles.reshape(-1, 3))

    if kind == "COLLAPSE":
        modifier.ratio = wanted / len(faces)
        return result()
    low, high = 0.0, np.pi / 2
    for _ in range(6):  # a wider angle leaves fewer faces
        modifier.angle_limit = 0.5 * (low + high)
        if result().face_count > wanted:
            low = modifier.angle_limit
        else:
            high = modifier.angle_limit
    modifier.angle_limit = high
    return result()


def main() -> None:
    """Print the table, or write it into the page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", type=Path, metavar="PAGE", help="put the table into this page")
    page = Page(parser.parse_args().write)
    bpy.ops.wm.read_homefile(use_empty=True)
    rows = []
    for name, make in PARTS.items():
        distance, creases = make()
        mesh = parts.remeshed(distance, COUNT)
        sharp = mesh.moved_to(core.sharpen_geometry(mesh))
        low = core.crisp_low_poly(mesh)
        ours = core.TriangleMesh(low.vertices, low.faces)
        results = [ours]
        for start, kind in ((sharp, "COLLAPSE"), (sharp, "DISSOLVE"), (mesh, "COLLAPSE")):
            results.append(decimated(start.vertices, start.faces, kind, ours.face_count))
        reach = 0.5 * mesh.mean_edge_length
        row = [name, f"{mesh.face_count:,}", str(ours.face_count), f"{error(sharp, distance):.2f}"]
        row += [
            f"{error(each, distance):.2f}, {100 * creases_kept(each, creases, reach):.0f} %"
            for each in results
        ]
        rows.append(row)
        print("; ".join(row), flush=True)
    names = "sharpened, then Collapse", "sharpened, then Planar", "Collapse alone"
    head = ["", "faces", "left", "sharpened", "Crisp Low Poly", *names]
    page.write("low-poly", table(head, rows))


if __name__ == "__main__":
    main()
