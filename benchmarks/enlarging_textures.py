# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare enlarged textures with enlarged flat pictures, inside charts and at seams.

``python benchmarks/enlarging_textures.py --data FOLDER --write docs/repair-benchmarks.md``. Four
models have textures of their own; others carry a photo that is projected onto them, which is one
picture on the surface, whatever the charts.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image
from repair_images import decibels
from report import Page, table
from scipy.ndimage import map_coordinates
from shock_filter import core
from texture_models import BALL, FILES, Model, load_model

Pixels = np.ndarray

SIZE = 512
PHOTOS = (
    (BALL, "kodim13"),
    ("spot", "kodim05"),
    ("blub", "kodim08"),
    ("DamagedHelmet", "kodim04"),
    ("WaterBottle", "kodim05"),
)
"""A model, and what is projected onto it."""


def projected(model: Model, photo: Pixels) -> Model:
    """Project a photo onto a model, twice as fine as its texture will be, and reduce it."""
    wide = 2 * SIZE
    mesh = model.mesh()
    atlas = core.TextureAtlas(mesh, model.uv, size=(wide, wide))
    places = atlas.bake(model.vertices[model.faces])
    low, high = model.vertices.min(axis=0), model.vertices.max(axis=0)
    unit = (places - low) / (high - low).max()
    depth = 0.25 * unit[..., 2]  # so that walls along the view are no stripes
    rows = (photo.shape[0] - 1) * (0.75 * unit[..., 1] + depth)
    columns = (photo.shape[1] - 1) * (0.75 * unit[..., 0] + depth)
    colors = np.stack(
        [
            map_coordinates(photo[..., c].astype(float), [rows, columns], order=1, mode="reflect")
            for c in range(3)
        ],
        axis=-1,
    )
    image = np.where(atlas.inside[..., None], colors, 0.0).astype(np.float32)
    image = core.dilate_texture(mesh, model.uv, image, atlas=atlas)
    means = image.reshape(SIZE, 2, SIZE, 2, 3).mean(axis=(1, 3))
    return replace(model, image=np.rint(means).clip(0, 255).astype(np.uint8))


def models(data: Path) -> dict[str, Model]:
    """Load and make ten models."""
    found = {name: load_model(data, name, SIZE) for name in FILES}
    found[BALL] = load_model(data, BALL, SIZE)
    for name, photo in PHOTOS:
        pixels = np.asarray(Image.open(data / "images" / f"{photo}.png").convert("RGB"))
        found[f"{name}, {photo}"] = projected(load_model(data, name, SIZE), pixels)
    return found


def seam_jump(model: Model, mesh: core.TriangleMesh, image: Pixels) -> float:
    """Mean difference between both sides of seams, in levels of 255."""
    twins, corners = mesh.twins.reshape(-1), mesh.own_corners(model.uv)
    edges = np.flatnonzero(twins > np.arange(len(twins)))
    (face, k), (other, m) = np.divmod(edges, 3), np.divmod(twins[edges], 3)
    one = corners[face, k], corners[face, (k + 1) % 3]
    two = corners[other, (m + 1) % 3], corners[other, m]
    apart = (np.abs(one[0] - two[0]) + np.abs(one[1] - two[1])).max(axis=1) > 1e-6
    height, width = image.shape[:2]
    off = []
    for share in (0.25, 0.5, 0.75):
        sides = [(1 - share) * a[apart] + share * b[apart] for a, b in (one, two)]
        shown = [
            np.stack(
                [
                    map_coordinates(
                        image[..., c].astype(float),
                        [side[:, 1] * height - 0.5, side[:, 0] * width - 0.5],
                        order=1,
                        mode="grid-wrap",
                    )
                    for c in range(3)
                ]
            )
            for side in sides
        ]
        off.append(np.abs(shown[0] - shown[1]).max(axis=0))
    return float(np.mean(off))


def results(model: Model, mesh: core.TriangleMesh, given: Pixels) -> list[Pixels]:
    """Enlarge a texture in four ways."""
    picture = Image.fromarray(given)
    return [
        np.asarray(picture.resize((SIZE, SIZE), Image.Resampling.BICUBIC)),
        np.asarray(picture.resize((SIZE, SIZE), Image.Resampling.LANCZOS)),
        core.sharpen_image(given, core.ImageSettings(enlarge=2)),
        core.enlarge_texture(mesh, model.uv, given),
    ]


def enlarging(data: Path) -> str:
    """Compare textures that were reduced and enlarged with what they were."""
    rows, numbers = [], []
    half = SIZE // 2
    for name, model in models(data).items():
        mesh, image = model.mesh(), model.image
        inside = core.TextureAtlas(mesh, model.uv, size=image.shape[:2]).inside
        means = image.reshape(half, 2, half, 2, 3).mean(axis=(1, 3))
        averaged = np.rint(means).astype(np.uint8)
        lanczos = np.asarray(Image.fromarray(image).resize((half, half), Image.Resampling.LANCZOS))
        for how, given in (("means", averaged), ("Lanczos", lanczos)):
            found = results(model, mesh, given)
            quality = [decibels(each[inside], image[inside]) for each in found]
            jumps = [seam_jump(model, mesh, each) for each in (given, *found[2:])]
            numbers.append([*quality, *jumps])
            rows.append([name, how, *(f"{value:.2f}" for value in numbers[-1])])
    mean = np.mean(numbers, axis=0)
    rows.append(["**mean**", "", *(f"**{value:.2f}**" for value in mean)])
    head = [
        "", "reduced by", "bicubic", "Lanczos", "image alone", "on the surface",
        "jump before", "image alone", "on the surface",
    ]  # fmt: skip
    worst = min(row[3] - row[2] for row in numbers)
    rise = max(row[6] - row[4] for row in numbers)
    text = f"Against the image alone at least {worst:+.2f} dB; seams jump by at most {rise:+.2f}"
    return table(head, rows, 2) + f"\n\n{text} of 255 more than before."


def main() -> None:
    """Print the table, or write it into a page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--write", type=Path, help="Markdown page to write the table into")
    options = parser.parse_args()
    text = enlarging(options.data)
    print(text, flush=True)
    Page(options.write).write("enlarging", text)


if __name__ == "__main__":
    main()
