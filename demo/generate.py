# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the pictures of docs/generate.md: distances, streaks and patterns on two animals.

``python demo/generate.py FOLDER`` writes them to docs/images/generate. Needs what demo/run.py
needs, and a folder with spot_triangulated.obj and blub_triangulated.obj (Keenan Crane, CC0), maybe
in folders of their names.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import bpy
import numpy as np
import photo
import shock_filter
from guide import shrink
from picture import View, render
from run import run
from shock_filter.shock_addon.modes import find

OUT = Path(__file__).resolve().parent.parent / "docs" / "images" / "generate"
TEXELS, PIXELS, COLORS = 1024, 420, 192
VIEWS = {
    "spot": View(rotation=(90, 0, 215), centre=(-0.1, 0.08), size=1.8, light=(-0.3, -1.0, 0.6)),
    "blub": View(rotation=(90, 0, 125), centre=(-0.28, 0.25), size=2.7, light=(-0.3, -1.0, 0.6)),
}
INK, PAPER = (0.02, 0.08, 0.16), (0.9, 0.8, 0.62)
"""Colors of 0 and of 1."""

SCALES: dict[str, dict[str, object]] = {
    "distance": {},
    "streaks": {},
    "pattern": {"image_size": "512", "pattern_scale": 14.0},  # smooth enough
}

Column = tuple[str, dict[str, object]]
DISTANCES: list[Column] = [
    ("Gradient", {}),
    ("Lines", {"look": "lines"}),
    ("Lines from seams", {"look": "lines", "source": "seams"}),
]
STREAKS: list[Column] = [
    ("Defaults", {}),
    ("Brushed Metal, Z", {"along": "Z"}),
    ("Hair, Around Z", {"along": "AROUND_Z"}),
]
PATTERNS: list[Column] = [(name, {}) for name in ("Stripes", "Dots", "Labyrinth", "Coral")]


def main() -> None:
    """Make all pictures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="folder of the models")
    folder = parser.parse_args().folder
    OUT.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.read_homefile(use_empty=True)
    shock_filter.register()
    try:
        for name in reversed(VIEWS):  # the cow is the last one
            obj = read(next(folder.rglob(f"{name}_triangulated.obj")))
            draw(name, "distance", obj, DISTANCES)
            draw(name, "streaks", obj, STREAKS)
            draw(name, "pattern", obj, PATTERNS)
        show_three(obj)
    finally:
        shock_filter.unregister()  # Blender may hang or crash at exit otherwise


def read(path: Path) -> bpy.types.Object:
    """Read a model; its vertex that lies farthest to the front is selected, and it alone."""
    bpy.ops.wm.obj_import(filepath=str(path))
    obj = bpy.context.object
    obj.data.shade_smooth()
    for elements in (obj.data.polygons, obj.data.edges, obj.data.vertices):
        elements.foreach_set("select", [False] * len(elements))
    min(obj.data.vertices, key=lambda vertex: vertex.co.z).select = True
    return obj


def draw(name: str, target: str, obj: bpy.types.Object, columns: list[Column]) -> None:
    """Generate an image for each column, and render the model with it."""
    images = [generated(target, label.partition(",")[0], words) for label, words in columns]
    show(f"{target}-{name}", name, obj, images, [label for label, _ in columns])


def show_three(obj: bpy.types.Object) -> None:
    """Show one of each kind."""
    asked = ("distance", "Contour Lines"), ("streaks", "Defaults"), ("pattern", "Labyrinth")
    images = [generated(target, preset, {}) for target, preset in asked]
    show("three", "spot", obj, images, ["Distance", "Streaks", "Pattern"])


def show(
    file: str, name: str, obj: bpy.types.Object, images: list[bpy.types.Image], labels: list[str]
) -> None:
    """Render a model with each image."""
    path = OUT / f"{file}.png"
    pixels = 3 * PIXELS // len(images)
    meshes = [(label, obj.data.copy()) for label in labels]
    render(path, VIEWS[name], meshes, pixels, images, lit=True)
    shrink(path, COLORS)


def generated(target: str, preset: str, words: dict[str, object]) -> bpy.types.Image:
    """Generate an image by a preset, if there is one of this name, and color it."""
    known = set(bpy.data.images)
    presets = {each.name: each.values for each in find("generate").presets}
    settings = dict(presets.get(preset, {})) | SCALES[target] | {"target": target}
    run("generate", {"image_size": str(TEXELS), "add_node": False, **settings, **words})
    (image,) = set(bpy.data.images) - known
    grays = np.clip(photo.from_blender(image)[..., :1], 0.0, 1.0)
    colors = grays * np.array(PAPER) + (1.0 - grays) * np.array(INK)
    return photo.to_blender(image.name, colors.astype(np.float32))


if __name__ == "__main__":
    sys.exit(main())
