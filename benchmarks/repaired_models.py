# SPDX-License-Identifier: GPL-3.0-or-later
"""Degrade textured models, repair them, and measure the gain of each step.

``python benchmarks/repaired_models.py --data FOLDER --write
docs/repair-benchmarks.md``. Decibels of the texels inside charts against what the texture was; the
steps are switched on one after the other.
"""

from __future__ import annotations

import argparse
import io
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image
from repair_images import compressed, decibels
from report import Page, table
from shock_filter import core
from shock_filter.core import cli
from shock_filter.core.files.formats.mesh.gltf import GltfFile
from texture_models import BALL, FILES, Model, load_model

Pixels = np.ndarray

SIZE = 1024
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
    """Measure the gain of each step."""
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


def files(data: Path, names: list[str]) -> str:
    """Measure the results of the command on GLB files, with its defaults."""
    rows, least = [], np.inf
    for name in names:
        model = load_model(data, name, SIZE)
        atlas = core.TextureAtlas(model.mesh(), model.uv, size=(SIZE, SIZE))
        inside = atlas.inside
        row = [name]
        for fault, spoil in faults(model, atlas).items():
            spoiled = spoil(model.image)
            with TemporaryDirectory() as folder:
                given, result = Path(folder) / "in.glb", Path(folder) / "out.glb"
                write_glb(given, model, spoiled)
                if cli.main(["repair-model", str(given), str(result), "--quiet"]):
                    raise SystemExit(f"{name} by {fault} was not repaired.")
                found = color_of(result)
            before = decibels(spoiled[inside], model.image[inside])
            after = decibels(found[inside], model.image[inside])
            row.append(f"{_shown(before)} to {_shown(after)}")
            if fault != "nothing":
                least = min(least, after - before)
        rows.append(row)
        print("|", " | ".join(row), "|", flush=True)
    head = ["", "nothing", "blur", "noise", "holes", "steps", "blocks", "all"]
    return table(head, rows) + f"\n\nAt least {least:+.3f} dB."


def write_glb(path: Path, model: Model, image: Pixels) -> None:
    """Write a model with its texture to a GLB file."""
    import trimesh

    count = 3 * len(model.faces)
    visual = trimesh.visual.TextureVisuals(
        uv=model.uv.reshape(-1, 2), image=Image.fromarray(np.ascontiguousarray(image[::-1]))
    )
    corners = np.arange(count).reshape(-1, 3)
    points = model.vertices[model.faces].reshape(-1, 3)
    trimesh.Trimesh(points, corners, visual=visual, process=False).export(path)


def color_of(path: Path) -> Pixels:
    """Read the texture of a GLB file, row 0 at v = 0."""
    groups, _ = GltfFile(path).read_maps()
    [found] = [image for group in groups for image in group.images if image.part == "color"]
    with Image.open(io.BytesIO(found.data)) as image:
        return np.asarray(image.convert("RGB"))[::-1]


def _shown(value: float) -> str:
    return "same" if value > 100 else f"{value:.2f}"


def main() -> None:
    """Print the table, or write it into a page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--models", nargs="+", choices=[BALL, *FILES], default=[BALL, *FILES])
    parser.add_argument("--only", choices=["steps", "files"], help="one of the tables")
    parser.add_argument("--write", type=Path, help="Markdown page to write the table into")
    options = parser.parse_args()
    page = Page(options.write)
    if options.only != "files":
        page.write("repairs", repairs(options.data, options.models))
    if options.only != "steps":
        page.write("repaired files", files(options.data, options.models))


if __name__ == "__main__":
    main()
