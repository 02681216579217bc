# SPDX-License-Identifier: GPL-3.0-or-later
"""Spoil textured models, repair them, and measure what each step brings.

``python benchmarks/repaired_models.py --data FOLDER --write
docs/repair-benchmarks.md``. Decibels of the texels inside charts against what the texture was; the
steps are switched on one after the other.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from repair_images import compressed, decibels
from report import Page, table
from shock_filter import core
from texture_models import BALL, FILES, Model, load_model

Pixels = np.ndarray

SIZE = 256
STEPS = {
    "blocks": {"blocks": 1.0},
    "noise": {"denoise": 1.0},
    "fill": {"fill": "auto"},
    "seams": {"stitch": "seams"},
    "sharpen": {"sharpen": 1.0},
}
NONE = {"blocks": 0.0, "denoise": 0.0, "fill": "nothing", "stitch": "nothing", "sharpen": 0.0}


def holes(model: Model, atlas: core.TextureAtlas, image: Pixels) -> Pixels:
    """Blacken faces around some points of the surface, as where no photo saw it."""
    middle = model.vertices[model.faces].mean(axis=1)
    low, high = middle.min(axis=0), middle.max(axis=0)
    rng = np.random.default_rng(1)
    seeds = middle[rng.integers(0, len(middle), 6)]
    near = np.linalg.norm(middle[:, None] - seeds, axis=2).min(axis=1)
    unseen = near < 0.05 * np.linalg.norm(high - low)
    face = atlas.masks().face
    black = (face >= 0) & unseen[np.maximum(face, 0)]
    return np.where(black[..., None], 0, image).astype(np.uint8)


def blurred(image: Pixels, sigma: float = 1.0) -> Pixels:
    """Blur an image, as interpolation from photos does."""
    from scipy.ndimage import gaussian_filter

    return np.rint(gaussian_filter(image.astype(float), (sigma, sigma, 0))).astype(np.uint8)


def noisy(image: Pixels, sigma: float = 6.0) -> Pixels:
    """Add noise."""
    noise = np.random.default_rng(0).normal(0.0, sigma, image.shape)
    return np.rint(np.clip(image + noise, 0, 255)).astype(np.uint8)


def stepped(atlas: core.TextureAtlas, image: Pixels) -> Pixels:
    """Change the brightness of each chart by up to 8 %."""
    charts = atlas.masks().chart
    factors = 1 + np.random.default_rng(2).uniform(-0.08, 0.08, int(charts.max()) + 2)
    return np.rint(np.clip(image * factors[charts][..., None], 0, 255)).astype(np.uint8)


def faults(model: Model, atlas: core.TextureAtlas) -> dict[str, Callable[[Pixels], Pixels]]:
    """Ways to spoil the texture of a model."""
    single: dict[str, Callable[[Pixels], Pixels]] = {
        "blur": blurred,
        "noise": noisy,
        "holes": lambda image: holes(model, atlas, image),
        "steps": lambda image: stepped(atlas, image),
        "blocks": lambda image: compressed(image, 50),
    }

    def everything(image: Pixels) -> Pixels:
        for spoil in single.values():
            image = spoil(image)
        return image

    return {"nothing": lambda image: image, **single, "all": everything}


def repairs(data: Path, names: list[str]) -> str:
    """Tell what each step brings."""
    rows, least = [], np.inf
    for name in names:
        model = load_model(data, name, SIZE)
        mesh = model.mesh()
        atlas = core.TextureAtlas(mesh, model.uv, size=(SIZE, SIZE))
        inside = atlas.inside
        for fault, spoil in faults(model, atlas).items():
            spoiled = spoil(model.image)
            row = [decibels(spoiled[inside], model.image[inside])]
            settings = dict(NONE)
            for step in STEPS.values():
                settings |= step
                asked = core.RepairSettings(**settings)
                found = core.repair_texture(mesh, model.uv, spoiled, asked, atlas=atlas)
                row.append(decibels(found[inside], model.image[inside]))
            if fault != "nothing":
                least = min(least, row[-1] - row[0])
            rows.append([name, fault, *(_shown(value) for value in row)])
            print("|", " | ".join(rows[-1]), "|", flush=True)
    head = ["", "spoiled by", "as it is", *(f"+ {step}" for step in STEPS)]
    return table(head, rows, 2) + f"\n\nAt least {least:+.3f} dB in all."


def _shown(value: float) -> str:
    return "same" if value > 100 else f"{value:.2f}"


def main() -> None:
    """Print the table, or write it into a page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--models", nargs="+", choices=[BALL, *FILES], default=[BALL, *FILES])
    parser.add_argument("--write", type=Path, help="Markdown page to write the table into")
    options = parser.parse_args()
    text = repairs(options.data, options.models)
    print(text, flush=True)
    Page(options.write).write("repairs", text)


if __name__ == "__main__":
    main()
