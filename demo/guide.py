# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the pictures of the user's guide that the demo does not show.

``python demo/guide.py`` writes them to docs/images/guide. Needs what demo/run.py needs.
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np
import photo
import shapes
import shock_filter
from picture import PAINT, View, render
from PIL import Image
from run import FACE, GEAR, copied, run
from shock_filter import core
from shock_filter.core.preview.arrows import potential_colors
from shock_filter.shock_addon.modes import find

OUT = Path(__file__).resolve().parent.parent / "docs" / "images" / "guide"

BALL = View(rotation=(25, 35, 45), centre=(0.0, 0.0), size=1.9, light=(-0.9, -0.6, 0.9))

PART = View(rotation=(50, 0, 25), centre=(0.0, 0.0), size=2.5, light=(-0.9, -0.3, 0.7))
VOXELS, TURNED = 90, (0.3, 0.5, 0.2)

PIXELS, LARGE = 300, 450
GRAYS, COLORS = 32, 128

VERTEX_NOISE = 0.3
"""Standard deviation in mean edge lengths."""

PHOTO_NOISE = 0.08

TEXELS = 512


def main() -> None:
    """Make all pictures."""
    OUT.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.read_homefile(use_empty=True)
    shock_filter.register()
    try:
        show_times()
        show_presets()
        show_remeshed()
        show_flow()
        show_mask()
        show_denoising()
        show_texture()
        show_photo()
    finally:
        shock_filter.unregister()  # Blender may hang or crash at exit otherwise


def show_times() -> None:
    """Suzanne, sharpened for a short and for a long time."""
    obj = shapes.suzanne(subdivisions=2)
    shapes.soften(obj, passes=2)
    columns = [("Softened", obj.data)]
    for time in (64.0, 1024.0, 16384.0):
        sharp = filtered(obj, "sharpen_geometry", where="everywhere", time=time)
        columns.append((f"Time {time:g}", sharp))
    draw("times", FACE, columns)


def show_presets() -> None:
    """Suzanne with each preset of geometry."""
    obj = shapes.suzanne(subdivisions=2)
    shapes.soften(obj, passes=2)
    columns = [("Softened", obj.data)]
    for preset in find("geometry").presets:
        columns.append((preset.name, filtered(obj, "sharpen_geometry", **preset.values)))
    draw("presets", FACE, columns)


def show_remeshed() -> None:
    """Parts out of Blender's voxel remesh, shaded smooth, and sharpened at the defaults."""
    columns = []
    for part in (shapes.gear(spacing=0.05), shapes.cut_box()):
        shapes.remesh(part, VOXELS, TURNED)
        part.data.shade_smooth()
        columns += [("Voxel remesh", part.data), ("Sharpened", filtered(part, "sharpen_geometry"))]
    draw("remeshed", PART, columns, colors=COLORS, pixels=LARGE)


def show_flow() -> None:
    """Where the filter will pull, before and after."""
    obj = shapes.suzanne(subdivisions=2)
    shapes.soften(obj, passes=2)
    shown = copied(obj)
    run("show_flow", {"mode": "geometry", "attributes": True})
    potential = np.empty(len(shown.data.vertices), dtype=np.float32)
    shown.data.attributes[".shock_potential"].data.foreach_get("value", potential)
    paint = shown.data.color_attributes.new(PAINT, "FLOAT_COLOR", "POINT")
    colors = potential_colors(potential)
    colors[:, :3] **= 2.2  # attributes are linear
    paint.data.foreach_set("color", colors.ravel())
    columns = [
        ("Softened", obj.data),
        ("Potential", shown.data),
        ("Sharpened", filtered(obj, "sharpen_geometry", where="everywhere")),
    ]
    draw("flow", FACE, columns, colors=COLORS)


def show_mask() -> None:
    """A gear whose right half only is in the vertex group."""
    obj = shapes.gear(spacing=0.02)
    shapes.soften(obj, passes=5)
    obj.vertex_groups.new(name="Right half")
    right = np.flatnonzero(shapes.read_positions(obj.data)[:, 0] > 0)
    obj.vertex_groups["Right half"].add(right.tolist(), 1.0, "REPLACE")
    settings = {"time": 1024.0, "vertex_group": "Right half"}
    columns = [
        ("Softened", obj.data),
        ("Everywhere", filtered(obj, "sharpen_geometry", time=1024.0)),
        ("In the right half", filtered(obj, "sharpen_geometry", **settings)),
    ]
    draw("mask", GEAR, columns)


def show_denoising() -> None:
    """A noisy gear, denoised, and sharpened after that."""
    obj = shapes.gear(spacing=0.02)
    positions = shapes.read_positions(obj.data)
    mesh = core.TriangleMesh(positions, shapes.read_triangles(obj.data))
    random = np.random.default_rng(0)
    noise = VERTEX_NOISE * mesh.mean_edge_length * random.normal(size=positions.shape)
    noisy = (positions + noise).astype(np.float32)
    obj.data.attributes["position"].data.foreach_set("vector", noisy.ravel())
    obj.data.update()
    columns = [
        ("Noisy", obj.data),
        ("Denoised", filtered(obj, "denoise")),
        ("Denoised, then sharpened", filtered(obj, "denoise", then_sharpen=True)),
    ]
    draw("denoise", GEAR, columns)


def show_texture() -> None:
    """A blurred texture, sharpened as a flat image and on the surface."""
    obj = shapes.ball(subdivisions=6)
    shapes.paint(obj, PAINT, passes=10)
    image = baked(obj)
    columns, images = [("Blurred", obj.data)], [image]
    for name, label in (("image", "Sharpened as an image"), ("texture", "On the surface")):
        run(f"sharpen_{name}", {"image": image.name, "time": 16384.0})
        images.append(bpy.data.images[f"{image.name} sharpened"])
        images[-1].name = label
        columns.append((label, obj.data.copy()))
    draw("texture", BALL, columns, images, colors=COLORS)


def baked(obj: bpy.types.Object) -> bpy.types.Image:
    """Draw the painted colors into an image, gutter and all."""
    mesh = core.TriangleMesh(shapes.read_positions(obj.data), shapes.read_triangles(obj.data))
    corners = np.empty(3 * mesh.face_count, dtype=np.int32)
    obj.data.loop_triangles.foreach_get("loops", corners)
    uv = np.empty((len(obj.data.loops), 2), dtype=np.float32)
    obj.data.uv_layers.active.data.foreach_get("uv", uv.reshape(-1))
    layout = uv[corners].reshape(-1, 3, 2).astype(np.float64)
    atlas = core.TextureAtlas(mesh, layout, size=(TEXELS, TEXELS))
    pixels = atlas.bake(shapes.read_colors(obj.data, PAINT)[mesh.faces])
    pixels = core.dilate_texture(mesh, layout, pixels, atlas=atlas)
    return photo.to_blender("Texture", pixels[::-1].astype(np.float32))


def show_photo() -> None:
    """A noisy photograph, denoised."""
    original, _ = photo.blurred_photo()
    noise = PHOTO_NOISE * np.random.default_rng(0).normal(size=original.shape)
    image = photo.to_blender("Noisy", np.clip(original + noise, 0, 1).astype(np.float32))
    noisy = photo.from_blender(image)
    run("denoise_image", {"image": image.name})
    denoised = photo.from_blender(bpy.data.images[f"{image.name} denoised"])
    path = photo.side_by_side(OUT / "denoise-photo.png", [noisy, denoised])
    shrink(path, COLORS)


def filtered(obj: bpy.types.Object, name: str, **settings: object) -> bpy.types.Mesh:
    """Run an operator on a copy of the object; returns the copy's mesh."""
    copy = copied(obj)
    run(name, settings)
    return copy.data


def draw(
    name: str,
    view: View,
    columns: list[tuple[str, bpy.types.Mesh]],
    textures: list[bpy.types.Image] | None = None,
    colors: int = GRAYS,
    pixels: int = PIXELS,
) -> None:
    """Render a picture."""
    path = OUT / f"{name}.png"
    render(path, view, columns, pixels, textures)
    shrink(path, colors)


def shrink(path: Path, colors: int) -> None:
    """Keep the picture in a palette."""
    picture = Image.open(path).convert("RGBA")
    white = Image.new("RGBA", picture.size, "white")
    Image.alpha_composite(white, picture).convert("RGB").quantize(colors).save(path, optimize=True)
    print(f"{path.stat().st_size // 1000} kB  {path.name}")


if __name__ == "__main__":
    sys.exit(main())
