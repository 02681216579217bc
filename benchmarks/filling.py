# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure how what is missing of a texture is filled, beside filling in the image.

``python benchmarks/filling.py --data FOLDER --write docs/repair-benchmarks.md``. Holes are balls
around points on seams; a ball made by code stands beside the models. Needs opencv-python-headless
for its inpainting; push-pull averages what is known in smaller and smaller images and reads it
back.
"""

from __future__ import annotations

import argparse
import resource
import time
from pathlib import Path

import numpy as np
from report import Page, table
from shock_filter import core
from texture_models import BALL, load_model

SIZE = 512
LARGE = 2048
HOLES = 12
RADII = 0.03, 0.06, 0.1
SMOOTH = "smooth function of places"
HEAD = (
    "model", "radius of holes", "what", "missing",
    "push-pull", "OpenCV Telea", "OpenCV Navier-Stokes", "membrane", "thin plate",
)  # fmt: skip

Pixels = np.ndarray


def push_pull(image: Pixels, missing: Pixels) -> Pixels:
    """Fill by averages over twice as large pixels, until all are known; then back, linearly."""
    if not missing.any() or min(image.shape[:2]) < 2:
        return image
    height, width = (n + n % 2 for n in missing.shape)
    weights = np.zeros((height, width, 1))
    weights[: missing.shape[0], : missing.shape[1], 0] = ~missing
    values = np.zeros((height, width, 3))
    values[: missing.shape[0], : missing.shape[1]] = image
    blocks = (height // 2, 2, width // 2, 2)
    sums = (values * weights).reshape(*blocks, 3).sum(axis=(1, 3))
    counts = weights.reshape(*blocks, 1).sum(axis=(1, 3))
    small = push_pull(sums / np.maximum(counts, 1), counts[..., 0] == 0)
    y, x = (np.clip((np.arange(n) + 0.5) / 2 - 0.5, 0, m - 1)
            for n, m in zip(missing.shape, small.shape, strict=False))  # fmt: skip
    rows, columns = y.astype(int), x.astype(int)
    v, u = (y - rows)[:, None, None], (x - columns)[None, :, None]
    below, right = (np.minimum(low + 1, n - 1) for low, n in
                    zip((rows, columns), small.shape, strict=False))  # fmt: skip
    large = (1 - v) * ((1 - u) * small[np.ix_(rows, columns)] + u * small[np.ix_(rows, right)])
    large += v * ((1 - u) * small[np.ix_(below, columns)] + u * small[np.ix_(below, right)])
    return np.where(missing[..., None], large, image)


def decibels(found: Pixels, image: Pixels, where: Pixels) -> float:
    """Peak signal to noise."""
    off = found[where].astype(float) - image[where]
    return float(20 * np.log10(255) - 10 * np.log10(max(np.mean(off**2), 1e-9)))


def smooth(places: Pixels) -> Pixels:
    """Bytes of three slow functions on the surface."""
    unit = places / np.abs(places).max()
    values = [np.sin(3.0 * unit @ axis) for axis in ([1, 0.5, 0], [0, 1, 0.6], [0.5, -0.2, 1])]
    return np.rint(127.5 + 110 * np.stack(values, axis=-1)).astype(np.uint8)


def holes_at_seams(mesh: core.TriangleMesh, atlas: core.TextureAtlas, places: Pixels,
                   radius: float, count: int = HOLES) -> Pixels:  # fmt: skip
    """Texels in balls around points on seams; the radius is a share of the model's."""
    twins = mesh.twins.reshape(-1)
    seams = atlas.charts.borders[twins[atlas.charts.borders] >= 0]
    chosen = np.random.default_rng(0).choice(seams, count)
    face, k = np.divmod(chosen, 3)
    centers = mesh.vertices[mesh.faces[face, k]]
    size = radius * np.ptp(mesh.vertices, axis=0).max()
    missing = np.zeros(atlas.inside.shape, dtype=bool)
    for center in centers:
        missing |= ((places - center) ** 2).sum(axis=-1) < size**2
    return missing & atlas.inside


def inpainted(image: Pixels, missing: Pixels, gutter: Pixels) -> list[Pixels]:
    """Fill in the image by other ways; what lies beside the charts is not known either."""
    import cv2

    lacking = missing | gutter
    mask = lacking.astype(np.uint8)
    return [
        push_pull(image.astype(float), lacking),
        cv2.inpaint(image, mask, 5, cv2.INPAINT_TELEA),
        cv2.inpaint(image, mask, 5, cv2.INPAINT_NS),
    ]


def main() -> None:
    """Print the table, or write it into a page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path)
    parser.add_argument("--write", type=Path, help="Markdown page to write the table into")
    options = parser.parse_args()
    rows, found = [], []
    for name in [BALL, *(["spot", "blub", "WaterBottle"] if options.data else [])]:
        model = load_model(options.data if name != BALL else None, name, SIZE)
        mesh = model.mesh()
        atlas = core.TextureAtlas(mesh, model.uv, size=model.image.shape[:2])
        places = atlas.bake(mesh.own_corners(mesh.vertices[mesh.faces]))
        for radius in RADII:
            missing = holes_at_seams(mesh, atlas, places, radius)
            for what, image in ((SMOOTH, smooth(places)), ("its texture", model.image)):
                broken = np.where(missing[..., None], 0, image).astype(np.uint8)
                results = inpainted(broken, missing, ~atlas.inside) + [
                    core.fill_texture(mesh, model.uv, broken, core.FillSettings(surface=surface),
                                      missing=missing, atlas=atlas)
                    for surface in ("membrane", "thin_plate")
                ]  # fmt: skip
                each = [decibels(x, image, missing) for x in results]
                found.append((what == SMOOTH, each))
                rows.append([name, f"{radius:g}", what,
                             f"{100 * missing.sum() / atlas.inside.sum():.1f} %",
                             *(f"{value:.1f}" for value in each)])  # fmt: skip
                print("; ".join(rows[-1]), flush=True)
    for is_smooth, what in ((True, SMOOTH), (False, "textures")):
        mean = np.mean([each for kind, each in found if kind == is_smooth], axis=0)
        rows.append(["**mean**", "", what, "", *(f"**{value:.1f}**" for value in mean)])
        print("; ".join(rows[-1]), flush=True)
    text = table(HEAD, rows, 3)
    if options.data:
        text += "\n\n" + speed(options.data)
        print(text.splitlines()[-1])
    Page(options.write).write("filling", text)


def speed(data: Path) -> str:
    """Time a large texture a fifth of which is missing."""
    model = load_model(data, "spot", LARGE)
    mesh = model.mesh()
    atlas = core.TextureAtlas(mesh, model.uv, size=model.image.shape[:2])
    places = atlas.bake(mesh.own_corners(mesh.vertices[mesh.faces])).astype(np.float32)
    seeds = np.random.default_rng(0).choice(np.flatnonzero(atlas.inside), 30)
    centers = places.reshape(-1, 3)[seeds]
    nearest = np.full(atlas.inside.shape, np.inf, dtype=np.float32)
    for center in centers:
        np.minimum(nearest, ((places - center) ** 2).sum(axis=-1), out=nearest)
    missing = (nearest < np.quantile(nearest[atlas.inside], 0.2)) & atlas.inside
    broken = np.where(missing[..., None], 0, model.image).astype(np.uint8)
    times = []
    for _ in range(4):
        begin, used = time.perf_counter(), resource.getrusage(resource.RUSAGE_SELF)
        core.fill_texture(mesh, model.uv, broken, missing=missing)
        now = resource.getrusage(resource.RUSAGE_SELF)
        spent = now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime
        times.append((time.perf_counter() - begin, spent))
    wall, spent = min(times[1:])
    share = 100 * missing.sum() / atlas.inside.sum()
    return (
        f"{LARGE} x {LARGE} texels of spot, {share:.0f} % missing: {wall:.1f} s,"
        f" {spent:.1f} s of all cores together."
    )


if __name__ == "__main__":
    main()
