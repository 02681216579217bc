# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoising of textures: the error beside seams and inside charts, and the run time."""

from __future__ import annotations

import time

import common
import numpy as np
from report import Target, table, targets
from scipy.ndimage import distance_transform_edt
from shock_filter import core
from texture_models import Model, find_seams, load_model, names, painted

NOISE = 0.08
SIZE = 512
BESIDE, INSIDE = 1.5, 6.0
"""Depths in the charts, in texels: up to the one is beside a seam, from the other on inside."""

MOST_BESIDE, MOST_TIME = 1.2, 2.0


def rms(difference: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(difference))))


def seconds_of(work) -> tuple[np.ndarray, float]:
    """Do the work, and return its processor time."""
    start = time.process_time()
    result = work()
    return result, time.process_time() - start


def measure(model: Model) -> tuple[list[float], float, float]:
    """Denoise a known texture with noise: errors, jumps, and time over that of as many pixels."""
    mesh = model.mesh()
    atlas = core.TextureAtlas(mesh, model.uv, size=model.image.shape[:2])
    open_seams = core.DilateSettings(seams="continue")
    clean = model.image / 255.0
    noise = NOISE * np.random.default_rng(0).normal(size=clean.shape)
    # Extend the colors around the charts, as baking programs do.
    noisy = core.dilate_texture(
        mesh, model.uv, clean + noise, core.DilateSettings(seams="extend"), atlas=atlas
    ).astype(np.float32)
    settings = core.BeltramiTextureSettings(seams="continue")
    core.beltrami_image(noisy[:32, :32].copy())

    def on_surface() -> np.ndarray:
        return core.beltrami_texture(mesh, model.uv, noisy, settings, atlas=atlas)

    on_surface()  # compiles
    surface, took = seconds_of(on_surface)
    flat, flat_took = seconds_of(lambda: core.beltrami_image(noisy))
    flat = core.dilate_texture(mesh, model.uv, flat, open_seams, atlas=atlas)
    places = find_seams(atlas)
    away = np.ones(atlas.inside.shape, dtype=bool)
    rows, columns = np.moveaxis(np.rint(places.sides).astype(int), -1, 0)
    away[rows % atlas.height, columns % atlas.width] = False
    beside = atlas.inside & (distance_transform_edt(away) <= BESIDE)
    inside = distance_transform_edt(atlas.inside) >= INSIDE
    errors = [rms((found - clean)[at]) for found in (flat, surface) for at in (beside, inside)]
    jumps = [places.jump(found) for found in (flat, surface)]
    share = atlas.inside.mean()
    return [*errors, *jumps], errors[2] / errors[3], took / (share * flat_took)


def textures(job: common.Job) -> None:
    """Errors beside seams and inside, on the layouts of models with a known pattern."""
    rows, beside, times = [], [], []
    for name in names(job.data):
        found, ratio, took = measure(painted(load_model(job.data, name, SIZE)))
        beside.append(ratio)
        times.append(took)
        rows.append([name, *(f"{value:.4f}" for value in found), f"{took:.2f}"])
    head = ["layout", "image, beside seams", "image, inside", "surface, beside seams",
            "surface, inside", "image, jump", "surface, jump", "time"]  # fmt: skip
    text = [
        f"A pattern in space, in {SIZE}² texels of the layouts of models, with noise of {NOISE:g}:"
        " root mean square error after denoising as an image and on the surface, up to"
        f" {BESIDE:g} texels from seams, and from {INSIDE:g} texels on from where charts end; mean"
        " difference of both sides along the seams. Time is that of the processor for a texel in a"
        " chart, over that of *Denoise Image* for a pixel.",
        table(head, rows),
        targets(
            [
                Target("error beside seams / inside, worst", max(beside), MOST_BESIDE),
                Target("time of a texel / of a pixel, worst", max(times), MOST_TIME),
            ]
        ),
    ]
    job.page.write("textures", "\n\n".join(text))
