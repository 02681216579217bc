# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the pictures of docs/visualize-flow.md: frames of flows in the plane and on a cow.

``python demo/visualize_flow.py FOLDER`` writes them to docs/images/visualize-flow. Needs what
demo/run.py needs, and a folder with spot_triangulated.obj (Keenan Crane, CC0).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import bpy
import numpy as np
import shock_filter
from guide import shrink
from picture import View, render
from PIL import Image
from run import run
from shock_filter.core import cli

OUT = Path(__file__).resolve().parent.parent / "docs" / "images" / "visualize-flow"
PIXELS, COLORS = 420, 96
IN_PLANE = 300, 160
"""Width of pictures of the plane, and their colors."""
SPOT = View(rotation=(90, 0, 215), centre=(-0.1, 0.08), size=1.8, light=(-0.3, -1.0, 0.6))
KINDS = (
    [],
    ["--colors"],
    ["--kind", "dye", "--over-noise", "--contrast", "0.4"],
    ["--kind", "lines", "--length", "40"],
)
"""Flags for each picture of the plane."""


def main() -> None:
    """Make all pictures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="folder of the model")
    model = next(parser.parse_args().folder.rglob("spot_triangulated.obj"))
    OUT.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as name:
        show_kinds(Path(name))
        bpy.ops.wm.read_homefile(use_empty=True)
        shock_filter.register()
        try:
            show_model(model, Path(name))
        finally:
            shock_filter.unregister()  # Blender may hang or crash at exit otherwise


def two_vortices(size: int) -> np.ndarray:
    """Two vortices that turn against each other, slower outside."""
    y, x = np.mgrid[1 : -1 : size * 1j, -1 : 1 : size * 1j]
    velocity = np.zeros((size, size, 2), np.float32)
    for side in (-0.4, 0.4):
        strength = np.sign(side) / ((x - side) ** 2 + y**2 + 0.04)
        velocity += (strength * np.exp(-(x**2) - y**2))[..., None] * np.dstack([y, side - x])
    return velocity


def show_kinds(folder: Path) -> None:
    """Show the flow in the plane in all ways, beside each other."""
    width, colors = IN_PLANE
    np.save(folder / "flow.npy", two_vortices(width))
    size = f"{width}x{width}"
    pictures = []
    for number, words in enumerate(KINDS):
        target = folder / (f"{number}.png" if "lines" in words else f"{number}")
        frames = [] if "lines" in words else ["--frames", "60"]
        given = ["visualize-flow", str(folder / "flow.npy"), str(target), "--size", size]
        assert cli.main([*given, *words, *frames]) == cli.DONE
        path = target if target.is_file() else max(target.iterdir())
        pictures.append(np.array(Image.open(path).convert("RGB")))
    line = np.full((width, 8, 3), 255, np.uint8)
    row = [part for picture in pictures for part in (line, picture)][1:]
    Image.fromarray(np.concatenate(row, axis=1)).save(OUT / "kinds.png")
    shrink(OUT / "kinds.png", colors)


def show_model(model: Path, folder: Path) -> None:
    """Show where the filter pulls a cow's shape, and a wind around it, in three frames each."""
    bpy.ops.wm.obj_import(filepath=str(model))
    cow = bpy.context.object
    cow.data.shade_smooth()
    points = np.empty(3 * len(cow.data.vertices), np.float32)
    cow.data.vertices.foreach_get("co", points)
    x, _, z = points.reshape(-1, 3).T
    wind = cow.data.attributes.new("Wind", "FLOAT_VECTOR", "POINT")
    wind.data.foreach_set("vector", np.stack([-z, 0.3 + 0 * x, x], axis=1).ravel())
    words = {"target": "attribute", "field": "Wind", "frames": 9, "in_colors": True}
    run("visualize_flow", {**words, "image_size": "1024", "folder": str(folder / "cow")})
    frames = sorted((folder / "cow").iterdir())[::4]
    images = [bpy.data.images.load(str(path)) for path in frames]
    meshes = [(f"Frame {4 * number + 1}", cow.data.copy()) for number in range(len(images))]
    render(OUT / "spot.png", SPOT, meshes, PIXELS, images, lit=True)
    shrink(OUT / "spot.png", COLORS)


if __name__ == "__main__":
    sys.exit(main())
