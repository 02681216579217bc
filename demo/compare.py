# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's own filters beside ours on the same shapes: pictures, and how far normals are off.

``python demo/compare.py`` writes docs/images/compare and the table of docs/comparison.md. It needs
what demo/run.py needs. Sculpt Mode's filters are not among them: run by a script, they end Blender.
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np
import shapes
import shock_filter
from guide import TURNED, filtered, shrink
from mathutils.bvhtree import BVHTree
from measure import normals_and_areas
from picture import render
from run import copied
from showcase import GEAR, add_noise

ROOT = Path(__file__).resolve().parent.parent
OUT, PAGE = ROOT / "docs" / "images" / "compare", ROOT / "docs" / "comparison.md"
PIXELS, COLORS = 300, 96

MODIFIERS: dict[str, dict[str, object]] = {
    "Smooth": {"type": "SMOOTH", "factor": 0.5, "iterations": 10},
    "Laplacian Smooth": {"type": "LAPLACIANSMOOTH", "lambda_factor": 1.0, "iterations": 3},
    "Corrective Smooth": {"type": "CORRECTIVE_SMOOTH", "factor": 0.5, "iterations": 10},
    "Remesh, Sharp": {"type": "REMESH", "mode": "SHARP", "octree_depth": 7},
}


def main() -> None:
    """Make pictures and table."""
    OUT.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.read_homefile(use_empty=True)
    shock_filter.register()
    rows = {}
    try:
        for name, voxels, operator, settings in (
            ("remeshed", 80, "sharpen_geometry", {}),
            ("scan", 140, "denoise", {"then_sharpen": True}),
        ):
            part = shapes.gear(spacing=0.05)
            designed = part.data.copy()
            shapes.remesh(part, voxels, TURNED)
            if name == "scan":
                add_noise(part)
            part.data.shade_smooth()
            columns = {"Input": part.data, "Shock Filter": filtered(part, operator, **settings)}
            columns |= {label: modified(part, dict(how)) for label, how in MODIFIERS.items()}
            rows[name] = {label: degrees_off(mesh, designed) for label, mesh in columns.items()}
            draw(name, columns)
    finally:
        shock_filter.unregister()  # Blender may hang or crash at exit otherwise
    write(rows)


def modified(obj: bpy.types.Object, settings: dict[str, object]) -> bpy.types.Mesh:
    """What a modifier makes of the object."""
    copy = copied(obj)
    modifier = copy.modifiers.new("Filter", settings.pop("type"))
    for name, value in settings.items():
        setattr(modifier, name, value)
    shapes.apply(copy)
    copy.data.shade_smooth()
    return copy.data


def degrees_off(mesh: bpy.types.Mesh, designed: bpy.types.Mesh) -> float:
    """Mean angle to the normals of the nearest places on the design, by area."""
    truth = BVHTree.FromPolygons(
        shapes.read_positions(designed).tolist(), shapes.read_triangles(designed).tolist()
    )
    positions, triangles = shapes.read_positions(mesh), shapes.read_triangles(mesh)
    normals, areas = normals_and_areas(positions, triangles)
    middles = positions[triangles].mean(axis=1)
    wanted = np.array([truth.find_nearest(point)[1][:] for point in middles.tolist()])
    cosines = np.clip((normals * wanted).sum(axis=1), -1.0, 1.0)
    return float(np.average(np.degrees(np.arccos(cosines)), weights=areas))


def draw(name: str, columns: dict[str, bpy.types.Mesh]) -> None:
    """Render three columns in a picture."""
    items = list(columns.items())
    for row in range(0, len(items), 3):
        path = OUT / f"{name}-{row // 3 + 1}.png"
        render(path, GEAR, items[row : row + 3], PIXELS, lit=True)
        shrink(path, COLORS)


def write(rows: dict[str, dict[str, float]]) -> None:
    """Put the table between its marks in the page."""
    names = list(next(iter(rows.values())))
    lines = ["| degrees | " + " | ".join(names) + " |", "| --- |" + " ---: |" * len(names)]
    for row, found in rows.items():
        lines.append(f"| {row} | " + " | ".join(f"{found[name]:.2f}" for name in names) + " |")
    text = PAGE.read_text(encoding="utf-8")
    head, _, rest = text.partition("<!-- begin compare -->\n")
    _, _, tail = rest.partition("<!-- end compare -->")
    table = "\n".join(lines)
    page = f"{head}<!-- begin compare -->\n\n{table}\n\n<!-- end compare -->{tail}"
    PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
