# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the pictures of docs/detail.md: a textured model with more and less detail.

``python demo/detail.py FOLDER`` writes them to docs/images/detail. Needs what demo/run.py needs,
and a folder with spot_triangulated.obj and spot_texture.png (Keenan Crane, CC0).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import bpy
import numpy as np
import numpy.typing as npt
import photo
import scipy.ndimage
import shock_filter
from guide import shrink
from picture import View, render
from PIL import Image
from run import run
from shock_filter import core
from shock_filter.core.host.inputs import TexturedFaces
from shock_filter.core.host.textures import analyse
from shock_filter.shock_addon.data.image import textures

OUT = Path(__file__).resolve().parent.parent / "docs" / "images" / "detail"
TEXELS, PIXELS, COLORS = 1024, 420, 224
SPOT = View(rotation=(90, 0, 215), centre=(-0.1, 0.08), size=1.8, light=(-0.3, -1.0, 0.6))

GRAIN = 0.16
"""Standard deviation of the grain, as a part of the color."""

COARSEST, OCTAVES = 20, 4
"""Grains of the coarsest kind in a unit of length; and how many kinds, each half as large."""

STRENGTH = 3.0
RADIUS = 30.0
LOW, HIGH = -0.25, 0.15
"""Height up to which the model is smoothed, and from which it is raised."""


HIDE = ((7.0, 0.25), (28.0, 0.1))
"""Lumps in a unit of length, and how steep they are: large ones and creases."""

HIDE_RADIUS = 6.0


def main() -> None:
    """Make all pictures."""
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
        places = places_of(obj)
        image = photo.to_blender("Spot", grained(folder / "spot_texture.png", places))
        show_gains(obj, image)
        show_painted(obj, image, places)
        show_normals(obj, places)
    finally:
        shock_filter.unregister()  # Blender may hang or crash at exit otherwise


def places_of(obj: bpy.types.Object) -> npt.NDArray[np.float64]:
    """Return where on the model each texel lies, row 0 at the top; zero around the charts."""
    faces, _, _ = textures.read_faces(bpy.context, [obj], None, None)
    bare = TexturedFaces(faces.positions, faces.triangles, faces.uv, None)
    atlas = analyse(bare, (TEXELS, TEXELS))
    return atlas.bake(faces.positions[faces.triangles])[::-1]


def grained(path: Path, places: npt.NDArray[np.float64]) -> photo.Pixels:
    """Give a texture the grain of short fur, which is the same on both sides of seams."""
    painted = Image.open(path).convert("RGB").resize((TEXELS, TEXELS), Image.Resampling.LANCZOS)
    grain = np.zeros(places.shape[:2])
    lattice = np.random.default_rng(0).normal(size=(32, 32, 32))
    for octave in range(OCTAVES):
        at = (COARSEST * 2.0**octave * places).reshape(-1, 3).T
        values = scipy.ndimage.map_coordinates(lattice, at, order=1, mode="grid-wrap")
        grain += 0.9**octave * values.reshape(grain.shape)
    grain *= GRAIN / grain.std()
    colors = np.asarray(painted, np.float32) / 255
    return np.clip(0.8 * colors * (1.0 + grain[..., None]), 0.0, 1.0).astype(np.float32)


def show_gains(obj: bpy.types.Object, image: bpy.types.Image) -> None:
    """Show it smoothed, as it is, and raised."""
    smooth, raised = (filtered(image, gain=gain) for gain in (0.0, 2.0))
    columns = [("Gain 0", obj.data), ("Texture", obj.data.copy()), ("Gain 2", obj.data.copy())]
    draw("gains", columns, [smooth, image, raised])


def show_painted(
    obj: bpy.types.Object, image: bpy.types.Image, places: npt.NDArray[np.float64]
) -> None:
    """Show a gain map from the legs to the head, and what it gives."""
    grays = np.interp(places[..., 2], [LOW, HIGH], [0.0, 1.0])
    gain_map = photo.to_blender("Map", np.repeat(grays[..., None], 3, axis=2).astype(np.float32))
    run("dilate_texture", {"image": gain_map.name, "output": "REPLACE"})
    result = filtered(image, gain=STRENGTH, gain_map=gain_map.name)
    columns = [("Gain map", obj.data), ("Filtered", obj.data.copy())]
    draw("painted", columns, [gain_map, result])


def show_normals(obj: bpy.types.Object, places: npt.NDArray[np.float64]) -> None:
    """Show a normal map smoothed, as it is, and raised."""
    image = photo.to_blender("Hide", hide(obj, places), is_data=True)
    settings = {"content": "normals", "radius": HIDE_RADIUS}
    smooth, raised = (filtered(image, gain=gain, **settings) for gain in (0.0, 2.0))
    columns = [("Gain 0", obj.data), ("Normal map", obj.data.copy()), ("Gain 2", obj.data.copy())]
    draw("normals", columns, [smooth, image, raised], normals=True)


def hide(obj: bpy.types.Object, places: npt.NDArray[np.float64]) -> photo.Pixels:
    """Return tangent-space normals of lumps and creases that go on across seams, as colors."""
    faces, _, _ = textures.read_faces(bpy.context, [obj], None, None, True)
    bare = TexturedFaces(faces.positions, faces.triangles, faces.uv, None)
    atlas = analyse(bare, (TEXELS, TEXELS))
    normals = atlas.bake(faces.normals)[::-1]
    lattice = np.random.default_rng(1).normal(size=(24, 24, 24))
    slopes = np.zeros_like(places)
    for pace, height in HIDE:
        for axis in range(3):
            sides = []
            for step in (-0.05, 0.05):
                at = pace * places + step * np.eye(3)[axis]
                noise = scipy.ndimage.map_coordinates(
                    lattice, at.reshape(-1, 3).T, order=3, mode="grid-wrap"
                )
                sides.append(-np.abs(noise).reshape(places.shape[:2]))
            slopes[..., axis] += height * (sides[1] - sides[0]) / 0.1
    slopes -= (slopes * normals).sum(axis=2, keepdims=True) * normals
    vectors = normals - slopes
    vectors /= np.maximum(np.linalg.norm(vectors, axis=2, keepdims=True), 1e-9)
    colors = np.ascontiguousarray(0.5 + 0.5 * vectors[::-1])
    tangent = core.tangent_normals(atlas.mesh, faces.uv, colors, normals=faces.normals, atlas=atlas)
    return np.ascontiguousarray(tangent[::-1]).astype(np.float32)


def filtered(image: bpy.types.Image, **settings: object) -> bpy.types.Image:
    """Filter a texture into a new image."""
    known = set(bpy.data.images)
    run("filter_texture", {"image": image.name, "assign": False, "radius": RADIUS, **settings})
    (result,) = set(bpy.data.images) - known
    return result


def draw(
    name: str,
    columns: list[tuple[str, bpy.types.Mesh]],
    images: list[bpy.types.Image],
    normals: bool = False,
) -> None:
    """Render a picture."""
    path = OUT / f"{name}.png"
    render(path, SPOT, columns, PIXELS, images, lit=True, normals=normals)
    shrink(path, COLORS)


if __name__ == "__main__":
    sys.exit(main())
