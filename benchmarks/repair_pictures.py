# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the pictures of the manual's pages on repairs.

``python benchmarks/repair_pictures.py --data FOLDER --out docs/images/repair``: a model that was
spoiled and repaired; and a picture repeated three times three times, as it is, with its border
cross-faded, and made tileable.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from PIL import Image
from repaired_models import blurred, holes, noisy, stepped
from shock_filter import core
from shock_filter.core.repair.picture import Painted, side_by_side
from texture_models import load_model

Pixels = np.ndarray

SIZE = 512

SHARE = 0.25
"""Of the picture, over which a cross-fade mixes."""


def spoiled_and_repaired(data: Path) -> Pixels:
    """Draw Spot with many faults, and repaired."""
    model = load_model(data, "spot", SIZE)
    mesh = model.mesh()
    atlas = core.TextureAtlas(mesh, model.uv, size=(SIZE, SIZE))
    spoiled = holes(model, atlas, stepped(atlas, noisy(blurred(model.image))))
    settings = core.RepairSettings(stitch="everywhere")
    repaired = core.repair_texture(mesh, model.uv, spoiled, settings, atlas=atlas)
    corners = model.vertices[model.faces]
    shown = [[Painted(corners, model.uv, each)] for each in (spoiled, repaired)]
    return side_by_side(shown, 400)


def cross_faded(image: Pixels) -> Pixels:
    """Mix a picture with itself, shifted by half: what image editors' tutorials do."""
    mixed = image.astype(float)
    for axis in (0, 1):
        count = mixed.shape[axis]
        along = (np.arange(count) + 0.5) / count
        weight = np.clip(np.minimum(along, 1 - along) / SHARE, 0, 1)
        weight = weight.reshape([-1 if k == axis else 1 for k in range(3)])
        mixed = weight * mixed + (1 - weight) * np.roll(mixed, count // 2, axis=axis)
    return np.rint(mixed).astype(np.uint8)


def tiled(image: Pixels) -> Pixels:
    """Repeat a picture three times three times, at a third of its size."""
    small = Image.fromarray(image).reduce(2)
    return np.tile(np.asarray(small), (3, 3, 1))


def tilings(data: Path) -> Pixels:
    """Draw the three tilings side by side."""
    photo = np.asarray(Image.open(data / "images" / "kodim13.png").convert("RGB"))
    image = np.ascontiguousarray(photo[-212:-20, 330:522])
    ways = (image, cross_faded(image), core.make_tileable(image, core.TileSettings(even_light=1)))
    return np.concatenate([tiled(each) for each in ways], axis=1)


def main() -> None:
    """Write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for name, draw in (("spot", spoiled_and_repaired), ("tiling", tilings)):
        picture = Image.fromarray(draw(options.data)).quantize(24)  # a sixth of the bytes
        picture.save(options.out / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
