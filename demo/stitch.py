# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the pictures of docs/stitch.md: a model whose texture has steps, and without them.

``python demo/stitch.py FOLDER`` writes them to docs/images/stitch. Needs what demo/run.py needs,
and a folder with spot_triangulated.obj and spot_texture.png (Keenan Crane, CC0).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import photo
import shock_filter
from guide import shrink
from picture import View, render
from PIL import Image
from run import run
from shock_filter import core
from shock_filter.core.host.inputs import TexturedFaces
from shock_filter.core.host.textures import analyse
from shock_filter.core.mesh import calculus
from shock_filter.shock_addon.data.image import textures

OUT = Path(__file__).resolve().parent.parent / "docs" / "images" / "stitch"
TEXELS, PIXELS, COLORS = 1024, 420, 224
SPOT = View(rotation=(90, 0, 215), centre=(-0.1, 0.08), size=1.8, light=(-0.3, -1.0, 0.6))

STEP = 0.15
"""By how much at most the color of a chart is off."""

SIDES = {
    "Left": ((1.0, -0.3, 0.3), (0.15, 0.08, -0.05)),
    "Right": ((-1.0, -0.3, 0.3), (-0.15, -0.12, -0.08)),
    "Behind": ((0.0, 1.0, 0.3), (0.0, 0.05, 0.15)),
    "Below": ((0.0, 0.0, -1.0), (-0.1, -0.1, -0.1)),
}
"""Where photos are taken from, and how their color is off."""

SEEN = 0.15, 0.35
"""Cosines from which a photo knows the surface a little, and fully."""


def main() -> None:
    """Make both pictures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="folder of spot_triangulated.obj")
    folder = parser.parse_args().folder
    OUT.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.read_homefile(use_empty=True)
    shock_filter.register()
    try:
        bpy.ops.wm.obj_import(filepath=str(folder / "spot_triangulated.obj"))
        obj = bpy.context.object
        obj.data.shade_smooth()
        painted = Image.open(folder / "spot_texture.png").convert("RGB")
        painted = painted.resize((TEXELS, TEXELS), Image.Resampling.LANCZOS)
        colors = 0.2 + 0.6 * np.asarray(painted, np.float32) / 255
        show_charts(obj, colors)
        show_photos(obj, colors)
    finally:
        shock_filter.unregister()  # Blender may hang or crash at exit otherwise


def show_charts(obj: bpy.types.Object, colors: photo.Pixels) -> None:
    """Show a texture whose charts differ by constants, and stitched."""
    _, atlas = surface_of(obj)
    chart = atlas.masks().chart[::-1]
    steps = np.random.default_rng(3).uniform(-STEP, STEP, size=(chart.max() + 2, 3))
    steps[0] = 0.0  # for what lies in no chart
    image = photo.to_blender("Spot", (colors + steps[chart + 1]).astype(np.float32))
    columns, images = [("Charts that differ", obj.data)], [image]
    for label, settings in (("Stitched", {}), ("Even Out Charts", {"radius": 1000.0})):
        settings["even_out"] = "difference"
        columns.append((label, obj.data.copy()))
        images.append(stitched(image, **settings))
    draw("charts", columns, images)


def show_photos(obj: bpy.types.Object, colors: photo.Pixels) -> None:
    """Show photos from three sides, one above the other, and stitched."""
    faces, atlas = surface_of(obj)
    mesh = core.TriangleMesh(faces.positions, faces.triangles)
    normals = calculus.average_to_vertices(mesh, mesh.normals)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    above = np.zeros((TEXELS, TEXELS, 3))
    photos = []
    for name, (direction, off) in SIDES.items():
        towards = np.array(direction) / np.linalg.norm(direction)
        cosines = atlas.bake((normals @ towards)[faces.triangles])[::-1]
        known = np.interp(cosines, SEEN, (0.0, 1.0))[..., None]
        pixels = np.concatenate([colors + np.array(off), known], axis=2).astype(np.float32)
        photos.append(photo.to_blender(name, pixels))
        above = np.where(known > 0, pixels[..., :3], above)
    pasted = photo.to_blender("Pasted", above.astype(np.float32))
    run("dilate_texture", {"image": pasted.name, "output": "REPLACE", "seams": "extend"})
    others = {f"image_{k}": image.name for k, image in enumerate(photos[1:], 2)}
    result = stitched(photos[0], **others)
    columns = [("Photos, pasted", obj.data), ("Stitched", obj.data.copy())]
    draw("photos", columns, [pasted, result])


def surface_of(obj: bpy.types.Object) -> tuple[TexturedFaces, Any]:
    """Return the faces of an object, and the atlas of their texels."""
    faces, _, _ = textures.read_faces(bpy.context, [obj], None, None)
    return faces, analyse(faces, (TEXELS, TEXELS))


def stitched(image: bpy.types.Image, **settings: Any) -> bpy.types.Image:
    """Stitch a texture into a new image."""
    known = set(bpy.data.images)
    run("stitch_textures", {"image": image.name, "assign": False, **settings})
    (result,) = set(bpy.data.images) - known
    return result


def draw(
    name: str, columns: list[tuple[str, bpy.types.Mesh]], images: list[bpy.types.Image]
) -> None:
    """Render a picture."""
    path = OUT / f"{name}.png"
    render(path, SPOT, columns, PIXELS, images, lit=True)
    shrink(path, COLORS)


if __name__ == "__main__":
    sys.exit(main())
