# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure how charts of a texture that differ in light, tint or offset become one.

``python benchmarks/stitching.py --data FOLDER --write docs/gradient-benchmarks.md``. Without data,
a ball made by code stands in. No method can know the light of the whole: what is compared is scaled
by one factor a channel first, or shifted where offsets differ.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from report import Page, table
from shock_filter import core
from texture_models import BALL, load_model

SIZE = 512
RADIUS = 1000.0
WAYS = "difference", "brightness", "auto"

Pixels = np.ndarray


def spoilt(image: Pixels, chart: Pixels, kind: str, rng: np.random.Generator) -> Pixels:
    """Bytes in which each chart has another light."""
    count = chart.max() + 1
    inside = chart[..., None] >= 0
    if kind == "offset":
        changed = image + rng.uniform(-40, 40, (count, 1))[chart]
    else:
        least, most, channels = (0.6, 1.35, 1) if kind == "brightness" else (0.75, 1.25, 3)
        changed = image * rng.uniform(least, most, (count, channels))[chart]
    return np.where(inside, np.clip(np.rint(changed), 0, 255), image).astype(np.uint8)


def decibels(found: Pixels, image: Pixels, inside: Pixels, kind: str) -> float:
    """Peak signal to noise, but for one factor or offset a channel."""
    a, b = found[inside].astype(float), image[inside].astype(float)
    a = a + (b - a).mean(0) if kind == "offset" else a * ((a * b).sum(0) / (a * a).sum(0))
    return float(20 * np.log10(255) - 10 * np.log10(np.mean((a - b) ** 2)))


def darkest(found: Pixels, image: Pixels, inside: Pixels) -> str:
    """Mean value, of 255, of what is black in the image."""
    black = inside & (image.max(axis=-1) <= 2)
    return f"{found[black].mean():.1f}" if black.any() else ""


def main() -> None:
    """Print the table, or write it into a page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path)
    parser.add_argument("--write", type=Path, help="Markdown page to write the table into")
    options = parser.parse_args()
    rng = np.random.default_rng(3)
    rows = []
    for name in [BALL, *(["spot", "blub"] if options.data else [])]:
        model = load_model(options.data if name != BALL else None, name, SIZE)
        mesh = model.mesh()
        atlas = core.TextureAtlas(mesh, model.uv, size=(SIZE, SIZE))
        chart, inside = atlas.masks().chart, atlas.inside
        for kind in ("brightness", "tint", "offset"):
            broken = spoilt(model.image, chart, kind, rng)
            results = [broken] + [
                core.stitch_textures(
                    mesh,
                    model.uv,
                    broken,
                    core.StitchSettings(radius=RADIUS, even_out=way),
                    atlas=atlas,
                )
                for way in WAYS
            ]
            rows.append(
                [f"{name}, {chart.max() + 1} charts, {kind}"]
                + [f"{decibels(x, model.image, inside, kind):.1f}" for x in results]
                + [darkest(x, model.image, inside) for x in results[1:3]]
            )
            print("; ".join(rows[-1]), flush=True)
    head = ["", "before", *WAYS, *(f"black: {way}" for way in WAYS[:2])]
    Page(options.write).write("stitching", table(head, rows))


if __name__ == "__main__":
    main()
