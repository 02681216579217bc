# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure quality and speed of texture filling, compared with filling in the flat image.

``python benchmarks/filling.py --data FOLDER --write docs/repair-benchmarks.md``. Holes are balls
around points on seams; a ball made by code stands beside the models. Needs opencv-python-headless
for its inpainting; push-pull averages what is known in smaller and smaller images and reads it
back.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from common import in_own_process, peak_memory
from report import Page, table
from shock_filter import core
from texture_models import BALL, Model, load_model, read_model

SIZE = 512
LARGE = 2048
TIMES = 6
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
    """Fill in the flat image with other methods; texels beside the charts are also unknown."""
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
    parser.add_argument("--write", type=Path, help="Markdown page to write the tables into")
    parser.add_argument("--only", choices=["quality", "speed"], help="one of the tables")
    options = parser.parse_args()
    page = Page(options.write)
    if options.only != "speed":
        page.write("filling", quality(options.data))
    if options.data and options.only != "quality":
        page.write("filling speed", speed(options.data))


def quality(data: Path | None) -> str:
    """Compare filled texels with the original ones."""
    rows, found = [], []
    for name in [BALL, *(["spot", "blub", "WaterBottle"] if data else [])]:
        model = load_model(data if name != BALL else None, name, SIZE)
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
    return table(HEAD, rows, 3)


def speed(data: Path) -> str:
    """Time large textures a fifth of which is missing."""
    rows = []
    for name in (BALL, "spot"):
        model = load_model(data, name, LARGE)
        missing = spread_holes(model)
        with TemporaryDirectory() as folder:
            model.save(Path(folder) / "model.npz")
            np.save(Path(folder) / "missing.npy", missing)
            wall, spent, peak = in_own_process(timed, Path(folder))
        faces = f"{len(model.faces):,}"
        rows.append([name, faces, f"{wall:.2f}", f"{spent:.2f}", f"{peak / 2**20:.0f}"])
        print("; ".join(rows[-1]), flush=True)
    head = "model", "triangles", "seconds", "of all cores together", "MiB of the process"
    return table(head, rows, 1)


def spread_holes(model: Model) -> Pixels:
    """Texels of a fifth of the surface, around points on it."""
    mesh = model.mesh()
    atlas = core.TextureAtlas(mesh, model.uv, size=model.image.shape[:2])
    places = atlas.bake(mesh.own_corners(mesh.vertices[mesh.faces])).astype(np.float32)
    seeds = np.random.default_rng(0).choice(np.flatnonzero(atlas.inside), 30)
    nearest = np.full(atlas.inside.shape, np.inf, dtype=np.float32)
    for center in places.reshape(-1, 3)[seeds]:
        np.minimum(nearest, ((places - center) ** 2).sum(axis=-1), out=nearest)
    return (nearest < np.quantile(nearest[atlas.inside], 0.2)) & atlas.inside


def timed(folder: Path) -> tuple[float, float, int]:
    """Fill a texture in a process of its own: seconds, those of all cores, bytes at the peak."""
    model, missing = read_model(folder / "model.npz"), np.load(folder / "missing.npy")
    mesh = model.mesh()
    broken = np.where(missing[..., None], 0, model.image).astype(np.uint8)
    times = []
    for _ in range(TIMES):
        begin, used = time.perf_counter(), time.process_time()
        core.fill_texture(mesh, model.uv, broken, missing=missing)
        times.append((time.perf_counter() - begin, time.process_time() - used))
    return *min(times[1:]), peak_memory()  # the first one may compile


if __name__ == "__main__":
    main()
