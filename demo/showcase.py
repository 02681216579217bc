# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the pictures that the README opens with, as people look at their models: lit and smooth.

``python demo/showcase.py`` writes them to docs/images/showcase. Needs what demo/run.py needs;
``--model FOLDER`` also draws a textured model, spot_triangulated.obj and spot_texture.png (Keenan
Crane, CC0).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import bpy
import numpy as np
import photo
import scipy.ndimage
import shapes
import shock_filter
from guide import TURNED, filtered, shrink
from picture import View, render
from PIL import Image
from run import run
from shock_filter import core
from shock_filter.core.mesh import calculus

OUT = Path(__file__).resolve().parent.parent / "docs" / "images" / "showcase"
PIXELS, COLORS = 560, 160

VOXELS, SCANNED = 80, 140
NOISE, WIDTH = 0.35, 1
"""Standard deviation of a scan's noise in mean edge lengths, and passes that make it wider."""

GEAR = View(rotation=(50, 0, 25), centre=(0.0, 0.03), size=2.2, light=(-0.9, -0.4, 0.7))
SPOT = View(rotation=(90, 0, 215), centre=(-0.1, 0.08), size=1.8, light=(-0.3, -1.0, 0.6))
BLUR = 3.0
"""Standard deviation in texels."""


def main() -> None:
    """Make all pictures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--model", type=Path, help="folder of spot_triangulated.obj")
    options = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.read_homefile(use_empty=True)
    shock_filter.register()
    try:
        show_remeshed()
        show_scan()
        if options.model:
            show_model(options.model)
    finally:
        shock_filter.unregister()  # Blender may hang or crash at exit otherwise


def show_remeshed() -> None:
    """A gear out of Blender's voxel remesh, sharpened at the defaults."""
    part = shapes.gear(spacing=0.05)
    shapes.remesh(part, VOXELS, TURNED)
    part.data.shade_smooth()
    columns = [("Voxel remesh", part.data), ("Sharpened", filtered(part, "sharpen_geometry"))]
    draw("remeshed", GEAR, columns)


def show_scan() -> None:
    """A gear as a scanner may have seen it, denoised."""
    part = shapes.gear(spacing=0.05)
    shapes.remesh(part, SCANNED, TURNED)
    add_noise(part)
    part.data.shade_smooth()
    draw("scan", GEAR, [("Scan", part.data), ("Denoised", filtered(part, "denoise"))])


def add_noise(obj: bpy.types.Object) -> None:
    """Move vertices along their normals; neighbours move alike, as scans have it."""
    mesh = core.TriangleMesh(shapes.read_positions(obj.data), shapes.read_triangles(obj.data))
    noise = np.random.default_rng(0).normal(size=(mesh.vertex_count, 1))
    noise = calculus.smooth_vertices(mesh, noise, WIDTH)
    noise *= NOISE * mesh.mean_edge_length / noise.std()
    normals = calculus.average_to_vertices(mesh, mesh.normals)
    shapes.write_positions(obj.data, mesh.vertices + noise * normals)


def show_model(folder: Path) -> None:
    """A model whose texture is blurred, and sharpened on its surface."""
    bpy.ops.wm.obj_import(filepath=str(folder / "spot_triangulated.obj"))
    obj = bpy.context.object
    obj.data.shade_smooth()
    painted = np.asarray(Image.open(folder / "spot_texture.png").convert("RGB"), np.float32) / 255
    blurred = scipy.ndimage.gaussian_filter(painted, (BLUR, BLUR, 0))
    image = photo.to_blender("Spot", blurred)
    run("sharpen_texture", {"image": image.name})
    sharp = bpy.data.images[f"{image.name} sharpened"]
    columns = [("Blurred", obj.data), ("Sharpened", obj.data.copy())]
    draw("model", SPOT, columns, [image, sharp])


def draw(
    name: str,
    view: View,
    columns: list[tuple[str, bpy.types.Mesh]],
    textures: list[bpy.types.Image] | None = None,
) -> None:
    """Render a picture."""
    path = OUT / f"{name}.png"
    render(path, view, columns, PIXELS, textures, lit=True)
    shrink(path, COLORS)


if __name__ == "__main__":
    sys.exit(main())
