# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure how well charts that differ in light, tint or offset are stitched.

``python benchmarks/stitching.py --data FOLDER --write docs/gradient-benchmarks.md``. Without data,
a generated ball is used. No method can know the light of the whole: what is compared is scaled
by one factor a channel first, or shifted where offsets differ, or both for haze. Values are sRGB,
as files hold them; exposure is multiplied in linear light.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from report import Page, table
from shock_filter import core
from shock_filter.core.base.srgb import decoded, encoded
from texture_models import BALL, FILES, load_model

SIZE = 512
RADIUS = 1000.0
SEEDS = 3, 4, 5
WAYS = "difference", "brightness", "auto"
BY_OFFSETS = "offset", "tint by offsets"
KINDS = "brightness", "tint", "exposure", *BY_OFFSETS, "haze"

Pixels = np.ndarray


def spoilt(image: Pixels, chart: Pixels, kind: str, rng: np.random.Generator) -> Pixels:
    """Bytes in which each chart has another light."""
    count = chart.max() + 1
    inside = chart[..., None] >= 0
    if kind == "offset":
        changed = image + rng.uniform(-40, 40, (count, 1))[chart]
    elif kind == "tint by offsets":
        changed = image + rng.uniform(-25, 25, (count, 3))[chart]
    elif kind == "haze":
        share = rng.uniform(0.0, 0.4, (count, 1))[chart]
        changed = image + share * (204.0 - image)
    elif kind == "exposure":
        light = decoded(image / 255.0) * 2.0 ** rng.uniform(-1.0, 0.6, (count, 1))[chart]
        changed = 255.0 * encoded(light)
    else:
        least, most, channels = (0.6, 1.35, 1) if kind == "brightness" else (0.75, 1.25, 3)
        changed = image * rng.uniform(least, most, (count, channels))[chart]
    return np.where(inside, np.clip(np.rint(changed), 0, 255), image).astype(np.uint8)


def decibels(found: Pixels, image: Pixels, inside: Pixels, kind: str) -> float:
    """Peak signal to noise, but for one factor or offset a channel, or both."""
    a, b = found[inside].astype(float), image[inside].astype(float)
    if kind in BY_OFFSETS:
        a = a + (b - a).mean(0)
    elif kind == "haze":
        off = a - a.mean(0)
        a = b.mean(0) + off * ((off * b).sum(0) / (off * off).sum(0))
    else:
        a = a * ((a * b).sum(0) / (a * a).sum(0))
    return float(20 * np.log10(255) - 10 * np.log10(np.mean((a - b) ** 2)))


def darkest(found: Pixels, broken: Pixels, image: Pixels, inside: Pixels) -> str:
    """How much, of 255, that is black before and in the image changes in the mean."""
    black = inside & (image.max(axis=-1) <= 2) & (broken.max(axis=-1) <= 2)
    off = found[black].astype(float) - image[black]
    return f"{np.abs(off).mean():.1f}" if black.any() else ""


def unspoilt(data: Path | None, name: str) -> list[str]:
    """How much of 255 a texture without other light changes in the mean, and its charts."""
    model = load_model(data, name, SIZE)
    mesh = model.mesh()
    atlas = core.TextureAtlas(mesh, model.uv, size=(SIZE, SIZE))
    row = [f"{name}, {atlas.masks().chart.max() + 1} charts"]
    for seams in ("continue", "auto"):
        how = core.StitchSettings(seams=seams)
        found = core.stitch_textures(mesh, model.uv, model.image, how, atlas=atlas)
        off = np.abs(found[atlas.inside].astype(float) - model.image[atlas.inside])
        row.append(f"{off.mean():.2f}")
    print("; ".join(row), flush=True)
    return row


def main() -> None:
    """Print the table, or write it into a page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path)
    parser.add_argument("--write", type=Path, help="Markdown page to write the table into")
    options = parser.parse_args()
    rows, worse, cases = [], 0, 0
    for name in [BALL, *(["spot", "blub"] if options.data else [])]:
        model = load_model(options.data if name != BALL else None, name, SIZE)
        mesh = model.mesh()
        atlas = core.TextureAtlas(mesh, model.uv, size=(SIZE, SIZE))
        chart, inside = atlas.masks().chart, atlas.inside
        for kind in KINDS:
            found, blacks = [], []
            for seed in SEEDS:
                broken = spoilt(model.image, chart, kind, np.random.default_rng(seed))
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
                found.append([decibels(x, model.image, inside, kind) for x in results])
                blacks.append([darkest(x, broken, model.image, inside) for x in results[1:]])
                worse += found[-1][-1] < found[-1][0]
                cases += 1
            each = np.array(found)
            rows.append(
                [f"{name}, {chart.max() + 1} charts, {kind}"]
                + [f"{value:.1f}" for value in each.mean(axis=0)]
                + [f"{(each[:, -1] - each[:, 0]).min():+.1f}"]
                + [max(of_way, key=lambda text: float(text or -1))
                   for of_way in list(zip(*blacks, strict=True))[::2]]
            )  # fmt: skip
            print("; ".join(rows[-1]), flush=True)
    head = ["", "before", *WAYS, "auto, least gain", "black: difference", "black: auto"]
    text = f"In {worse} of {cases} cases *Auto* is farther from the original than the input."
    names = [BALL, *(FILES if options.data else [])]
    kept = table(
        ["mean change of 255, without other light", "seams: continue", "auto"],
        [unspoilt(options.data if name != BALL else None, name) for name in names],
    )
    Page(options.write).write("stitching", f"{table(head, rows)}\n\n{text}\n\n{kept}")


if __name__ == "__main__":
    main()
