# SPDX-License-Identifier: GPL-3.0-or-later
"""Are textures sharpened on their surface as well as flat pictures, and do their seams stay?

``python benchmarks/texture_sharpening.py --data FOLDER``. Textures of models, and photos that are
painted through made ones, are spoiled; the same recipe sharpens them through the atlas and as flat
pictures. Only texels inside charts count. An oracle chooses the best of nine unsharp masks.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from image_sharpening import SPOILINGS, as_bytes, best_unsharp
from report import Page, table
from scipy.ndimage import uniform_filter
from shock_filter import core
from texture_models import Model, ball, find_seams, load_model, sample

SIZE = 512
NAMES = ("sharp", "Gauss 1", "Gauss 2", "disk 3", "Gauss 1.5, JPEG 75", "Gauss 1.5, noise 3",
         "x2, cubic", "x2, Lanczos")  # fmt: skip
FILES = "spot", "blub"
FINE = 3
"""Pixels of a photo along a texel, so that textures are no softer than photos."""


def tube(size: int) -> Model:
    """Make a cylinder of three charts, each turned by an angle of its own."""
    around, along = 48, 16
    turn, up = np.meshgrid(np.arange(around + 1), np.arange(along + 1))
    angle = 2 * np.pi * turn / around
    places = np.stack([np.cos(angle), np.sin(angle), 2 * np.pi * up / around], axis=-1)
    flat = np.stack([turn, up], axis=-1) / around
    first = (np.arange(around) + (around + 1) * np.arange(along)[:, None]).reshape(-1, 1)
    quads = first[:, None] + np.array([[0, 1, around + 2], [0, around + 2, around + 1]])
    faces = quads.reshape(-1, 3)
    part = (np.arange(len(faces)) // 2 % around) // (around // 3)
    uv = flat.reshape(-1, 2)[faces]
    for k in range(3):
        angle = 0.5 * k
        rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        middle = np.array([(k + 0.5) / 3, along / around / 2])
        uv[part == k] = (uv[part == k] - middle) @ rotation + np.array([0.3, 0.3 + 0.0 * k])
        uv[part == k] += np.array([[0, 0], [0.4, 0.0], [0.2, 0.4]])[k]
    representatives, index = core.weld(np.round(places.reshape(-1, 3), 9))
    vertices = places.reshape(-1, 3)[representatives]
    return Model(vertices, index[faces], uv, np.zeros((size, size, 3), np.uint8))


def blocks(size: int) -> Model:
    """Make a square in 16 charts, some of which are turned by right angles."""
    steps, parts = 16, 4
    ticks = np.linspace(0, 1, steps + 1)
    across, up = np.meshgrid(ticks, ticks)
    vertices = np.stack([across, up, 0 * up], axis=-1).reshape(-1, 3)
    row, column = np.divmod(np.arange(steps**2), steps)
    first = (row * (steps + 1) + column)[:, None]
    quads = first[:, None] + np.array([[0, 1, steps + 2], [0, steps + 2, steps + 1]])
    faces = quads.reshape(-1, 3)
    uv = vertices[faces][..., :2].copy()
    part = np.repeat(row // (steps // parts) * parts + column // (steps // parts), 2)
    for k in range(parts**2):
        place = (np.array([k % parts, k // parts]) + 0.5) / parts
        way = [(1, 0), (0, 1), (-1, 0), (0, -1)][k % 4]
        turn = np.array([way, (-way[1], way[0])])
        uv[part == k] = 0.9 * (uv[part == k] - place) @ turn + place
    return Model(vertices, faces, uv, np.zeros((size, size, 3), np.uint8))


def bumpy(size: int) -> Model:
    """Make a ball whose sides are stretched, so that texels are of many sizes."""
    round_ = ball(size)
    vertices = round_.vertices * (1 + 0.4 * np.sin(3 * round_.vertices[:, [1, 2, 0]]))
    return Model(vertices, round_.faces, round_.uv, round_.image)


MADE = {"ball": ball, "tube": tube, "blocks": blocks, "bumpy": bumpy}
PHOTOS = {"ball": "astronaut", "tube": "coffee", "blocks": "chelsea", "bumpy": "page"}


def painted(model: Model, photo: np.ndarray) -> Model:
    """Paint a photo through a model, as a projector would along a slanted direction."""
    size = model.image.shape[:2]
    atlas = core.TextureAtlas(model.mesh(), model.uv, size=size)
    places = atlas.bake(model.vertices[model.faces])
    a, b = places @ np.array([0.9, 0.3, 0.3]), places @ np.array([-0.3, 0.9, 0.3])
    grid = np.stack([b, a], axis=-1) / atlas.texel_size
    fine = uniform_filter(np.float64(photo), (FINE, FINE, 0))  # each texel shows its mean
    colors = sample(fine, FINE * (grid - grid[atlas.inside].min(axis=0)))
    image = np.where(atlas.inside[..., None], colors, 0)
    return Model(model.vertices, model.faces, model.uv, as_bytes(image))


def models(data: Path | None) -> dict[str, Model]:
    """Load and make the textured models."""
    import skimage.data

    found = {name: load_model(data, name, SIZE) for name in FILES} if data else {}
    for name, make in MADE.items():
        photo = getattr(skimage.data, PHOTOS[name])()
        if photo.ndim == 2:
            photo = np.stack([photo] * 3, axis=-1)
        found[name] = painted(make(SIZE), photo)
    return found


class Case(NamedTuple):
    """PSNR inside charts by way, and the mean jump at seams, in bytes."""

    model: str
    spoiling: str
    scores: dict[str, float]
    jumps: dict[str, float]


def cases(found: dict[str, Model]) -> list[Case]:
    """Sharpen all textures in all ways."""
    out = []
    for name, model in found.items():
        mesh = model.mesh()
        atlas = core.TextureAtlas(mesh, model.uv, size=model.image.shape[:2])
        seams, inside = find_seams(atlas), atlas.inside
        wide = core.DilateSettings(gutter=16)
        truth = core.dilate_texture(mesh, model.uv, model.image, wide, atlas=atlas)
        for spoiling in NAMES:
            spoiled = as_bytes(SPOILINGS[spoiling](truth, name + spoiling))
            given = core.dilate_texture(mesh, model.uv, spoiled, wide, atlas=atlas)
            results = {"truth": truth, "input": given, "flat": core.sharpen_image(given)}
            results["unsharp"] = best_unsharp(given, truth)
            for way, what in (("surface", "auto"), ("photo", "photo"), ("drawing", "drawing")):
                settings = core.TextureSettings(what=what)
                results[way] = core.sharpen_texture(mesh, model.uv, given, settings, atlas=atlas)
            scores, jumps = {}, {}
            for way, image in results.items():
                error = np.square(image[inside].astype(float) - truth[inside]).mean()
                scores[way] = float(10 * np.log10(255**2 / max(error, 1e-2)))
                jumps[way] = seams.jump(image)
            out.append(Case(name, spoiling, scores, jumps))
    return out


def tables(found: list[Case]) -> str:
    """Mean gains by model, and jumps at seams."""
    ways = "surface", "flat", "photo", "drawing", "unsharp"
    rows = []
    for key in ("model", "spoiling"):
        for each in dict.fromkeys(getattr(case, key) for case in found):
            some = [case for case in found if getattr(case, key) == each]
            if key == "model":
                some = [case for case in some if case.spoiling != "sharp"]
            mean = [np.mean([c.scores[way] - c.scores["input"] for c in some]) for way in ways]
            if each == "sharp":
                mean = [np.mean([c.scores[way] for c in some]) for way in ways]
            jumps = [np.mean([c.jumps[way] for c in some]) for way in ("truth", "input", "surface")]
            rows.append([each, *(f"{g:+.2f}" for g in mean), *(f"{j:.2f}" for j in jumps)])
    spoiled = [case for case in found if case.spoiling != "sharp"]
    lost = np.array([c.scores["surface"] - c.scores["flat"] for c in spoiled])
    least = [min(c.scores[way] - c.scores["input"] for c in spoiled) for way in ways]
    rows.append(["least gain", *(f"{g:+.2f}" for g in least), "", "", ""])
    jump = max(c.jumps["surface"] - c.jumps["truth"] for c in found)
    lost = f"{lost.min():+.2f}", f"{lost.mean():+.2f}"
    rows.append(["surface less flat: least, mean", *lost, *[""] * 5, f"{jump:+.2f}"])
    head = ["", *ways, "jump: truth", "input", "surface"]
    return table(head, rows)


def main() -> None:
    """Print the table, or write it into the page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, help="what holds textured/")
    parser.add_argument("--write", type=Path, help="folder of the page to write the table into")
    options = parser.parse_args()
    page = Page(options.write and options.write / "texture-benchmarks.md")
    page.write("texture-sharpening", tables(cases(models(options.data))))


if __name__ == "__main__":
    main()
