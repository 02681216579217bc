# SPDX-License-Identifier: GPL-3.0-or-later
"""Speed and memory of denoising: seconds an iteration, by size."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path

import common
import numpy as np
import variants
from denoise_meshes import creased_sphere, with_noise
from report import Target, table, targets
from shock_filter import core
from skimage import data as photos

MEBIBYTE = 2.0**20
RUNS = 2
SIDES = [256, 512, 1024]
IMAGE_BOUND, MESH_BOUND, MESH_SIZE = 0.6, 1.5, 134_345


def noisy_photo(side: int) -> np.ndarray:
    """The astronaut, cut or repeated to a square, with noise of 0.1: (side, side, 3) float32."""
    photo = photos.astronaut().astype(np.float32) / 255
    times = -(-side // len(photo))
    whole = np.tile(photo, (times, times, 1))[:side, :side]
    noise = np.random.default_rng(0).normal(0, 0.1, whole.shape)
    return (whole + noise).astype(np.float32)


def measured(run: Callable, compile_kernels: Callable, count: int) -> tuple[float, float]:
    """Seconds of the fastest run, and the bytes that it needs for each of `count` values."""
    compile_kernels()
    before = common.peak_memory()
    seconds = common.fastest(run, 1)
    memory = (common.peak_memory() - before) / count
    return min(seconds, common.fastest(run, RUNS - 1)), memory


def time_image(side: int, distance: str) -> tuple[float, float]:
    """Seconds of one iteration on a photo, and bytes a pixel."""
    image = noisy_photo(side)
    settings = core.BeltramiSettings(iterations=1)
    with variants.distances(distance):
        return measured(
            lambda: core.beltrami_image(image, settings),
            lambda: core.beltrami_image(image[:32, :32].copy(), settings),
            side * side,
        )


def filter_paint(mesh: core.TriangleMesh, distance: str) -> None:
    """Filter noisy vertex colors once."""
    colors = np.random.default_rng(0).normal(0.5, 0.1, (mesh.vertex_count, 3))
    with variants.distances(distance):
        core.beltrami_vertex_signal(mesh, colors, core.BeltramiMeshSettings(iterations=1))


def _kernel(**settings: int) -> core.BeltramiGeometrySettings:
    return core.BeltramiGeometrySettings(method="beltrami", **settings)


def filter_shape(mesh: core.TriangleMesh, distance: str) -> None:
    """Filter the surface once: the normals, and the fit to them."""
    with variants.distances(distance):
        core.denoise_geometry(mesh, _kernel(iterations=1, repeat=1))


def filter_shape_fully(mesh: core.TriangleMesh, distance: str) -> None:
    """Filter the surface with the default settings."""
    with variants.distances(distance):
        core.denoise_geometry(mesh, _kernel())


WHOLE = "surface, defaults"
FILTERS = {
    "vertex colors": filter_paint,
    "surface": filter_shape,
    WHOLE: filter_shape_fully,
}


def time_mesh(path: Path, what: str, distance: str) -> tuple[float, float]:
    """Seconds of one iteration on a stored mesh, and bytes a vertex."""
    mesh = with_noise(core.TriangleMesh(*common.read_mesh(path)), 0.1)
    tiny = with_noise(creased_sphere(2), 0.1)
    return measured(
        functools.partial(FILTERS[what], mesh, distance),
        functools.partial(FILTERS[what], tiny, distance),
        mesh.vertex_count,
    )


def row(label: list[str], count: int, seconds: float, memory: float) -> list[str]:
    """Lay out a measurement."""
    peak = memory * count / MEBIBYTE
    return [*label, f"{seconds:.3f}", f"{1e6 * seconds / count:.2f}", f"{peak:.0f}"]


def speed(job: common.Job) -> None:
    """Seconds an iteration on photos and meshes of growing size."""
    text, goals = [], []
    rows, curves = [], {}
    for distance in ("geodesic", "euclidean"):
        found = [common.in_own_process(time_image, side, distance) for side in SIDES]
        pixels = [side * side for side in SIDES]
        curves[f"image, {distance}"] = (pixels, [seconds for seconds, _ in found])
        for side, (seconds, memory) in zip(SIDES, found, strict=True):
            rows.append(row([distance, f"{side} x {side} x 3"], side * side, seconds, memory))
            if (side, distance) == (512, "geodesic"):
                goals.append(Target("seconds, 512 x 512 x 3", seconds, IMAGE_BOUND))
        goals.append(growth(f"images, {distance}", *curves[f"image, {distance}"]))
    head = ["seconds", "µs each", "more memory, MiB"]
    text += [
        "A noisy photo in float32, settings at their defaults, one"
        f" iteration; fastest of {RUNS} runs.",
        table(["distance", "image", *head], rows, words=2),
    ]

    rows = []
    stored = [job.stored(*mesh) for mesh in job.scaling_meshes()[:3]]
    sizes = [count for _, count in stored]
    for what in FILTERS:
        whole = what == WHOLE
        for distance in ("geodesic",) if whole else ("geodesic", "euclidean"):
            every_size = distance == "geodesic" and not whole
            several = stored if every_size else stored[1:2]
            found = [common.in_own_process(time_mesh, path, what, distance) for path, _ in several]
            for (_, count), (seconds, memory) in zip(several, found, strict=True):
                rows.append(row([what, distance, f"{count:,}"], count, seconds, memory))
            if every_size:
                goals.append(Target(f"seconds, {what}, {sizes[1]:,} vertices", found[1][0],
                                    MESH_BOUND * sizes[1] / MESH_SIZE))  # fmt: skip
                curves[f"mesh, {what}"] = (sizes, [seconds for seconds, _ in found])
                goals.append(growth(f"meshes, {what}", *curves[f"mesh, {what}"]))
    names = ", ".join(common.mesh_label(*mesh) for mesh in job.scaling_meshes()[:3])
    text += [
        f"Meshes ({names}) with noise of 0.1 mean edge lengths, built before. Vertex colors have"
        " three channels. *Surface* is one iteration with its fit; *surface, defaults* is the"
        " whole filter: three iterations, three times over.",
        table(["what", "distance", "vertices", *head], rows, words=3),
        targets(goals),
    ]
    plot = job.page.plot("speed", curves, "pixels or vertices", "seconds an iteration")
    job.page.write("speed", "\n\n".join(text) + plot)


def growth(what: str, sizes: list[int], seconds: list[float]) -> Target:
    """Check that time grows with a power near 1 of the size."""
    slope = float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])
    return Target(f"power of the size that time grows with, {what}", slope, 1.15)
