# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors of sharpened degraded pictures on meshes, for each *What* of vertex colors.

Pictures are those of `image_sharpening`, read at the vertices of meshes whose edges are about a
pixel long, and spoiled there: seen through a blur, smoothed from vertex to vertex, with noise.
These pictures and meshes are not used for training.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
from dials_of_colors import ball, sheet
from image_sharpening import SIZE, blur, fidelity, noise, pictures
from report import Page, table
from scipy import ndimage
from shock_filter import core
from shock_filter.core.mesh.calculus import smooth_vertices

PICTURES = (
    "astronaut", "coffee", "camera", "grass", "moon",
    "page", "logo", "color", "shapes41", "shapes42", "rings",
)  # fmt: skip

SIDE = 100
"""Pixels of a picture along the side of a grid."""

Floats = npt.NDArray[np.float64]


def grid() -> core.TriangleMesh:
    """A vertex for each pixel, row by row."""
    y, x = np.mgrid[:SIDE, :SIDE]
    first = (SIDE * y + x)[:-1, :-1].reshape(-1, 1)
    faces = np.concatenate([first + [0, 1, SIDE + 1], first + [0, SIDE + 1, SIDE]])
    return core.TriangleMesh(np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3), faces)


def remeshed() -> core.TriangleMesh:
    """A bumpy ball by marching cubes: small and large triangles side by side."""
    from skimage.measure import marching_cubes

    z, y, x = np.mgrid[:64, :64, :64] - 31.5
    field = np.sqrt(x * x + y * y + z * z) + 2 * np.sin(0.3 * x) * np.sin(0.25 * y + 1)
    vertices, faces, _, _ = marching_cubes(field, 26.3)
    return core.TriangleMesh(vertices, faces)


MESHES: dict[str, Callable[[], core.TriangleMesh]] = {
    "grid": grid,
    "ball": ball,
    "uneven sheet": sheet,
    "sheet with growing edges": lambda: sheet(1.4),
    "remeshed ball": remeshed,
}

SPOILINGS: dict[str, Callable[[core.TriangleMesh, Floats, Callable[[float], Floats]], Floats]] = {
    "sharp": lambda mesh, truth, seen: truth,
    "Gauss 1": lambda mesh, truth, seen: seen(1.0),
    "Gauss 2": lambda mesh, truth, seen: seen(2.0),
    "2 passes": lambda mesh, truth, seen: smooth_vertices(mesh, truth, 2),
    "8 passes": lambda mesh, truth, seen: smooth_vertices(mesh, truth, 8),
    "24 passes": lambda mesh, truth, seen: smooth_vertices(mesh, truth, 24),
    "4 passes, noise 4": lambda mesh, truth, seen: noise(
        smooth_vertices(mesh, truth, 4), 4.0, "4 passes"
    ),
}

SETTINGS = {word.title(): core.ShockSettings(what=word) for word in ("auto", "drawing", "photo")}


def as_bytes(values: Floats) -> Floats:
    """Round to bytes."""
    return np.rint(values).clip(0, 255)


def places(mesh: core.TriangleMesh) -> Floats:
    """Where vertices lie in a picture of `SIZE` pixels: (n, 2) rows and columns."""
    unit = np.sqrt(mesh.areas.sum() / mesh.vertex_count)
    flat = mesh.scaled_vertices[:, 1::-1] / unit
    return flat - (flat.min(axis=0) + flat.max(axis=0)) / 2 + SIZE // 2


def read(image: npt.NDArray, where: Floats) -> Floats:
    """Read a picture between its pixels: (n, 3)."""
    image = np.atleast_3d(image).astype(float)
    found = [
        ndimage.map_coordinates(plane, where.T, order=1, mode="mirror")
        for plane in np.moveaxis(image, 2, 0)
    ]
    return np.repeat(np.stack(found, axis=1), 3 // len(found), axis=1)


def gains(mesh: core.TriangleMesh, image: npt.NDArray) -> Floats:
    """Decibels that each way gains: (spoilings, ways); the PSNR to the truth of a sharp picture."""
    where = places(mesh)
    truth = as_bytes(read(image, np.rint(where)))
    rows = []
    for spoil in SPOILINGS.values():
        given = as_bytes(spoil(mesh, truth, lambda s: read(blur(image, s), where)))
        results = [core.sharpen_vertex_signal(mesh, given, each) for each in SETTINGS.values()]
        before = 0.0 if given is truth or (given == truth).all() else fidelity(given, truth)
        rows.append([fidelity(result, truth) - before for result in results])
    return np.array(rows)


def on_meshes() -> str:
    """Mean gains on each mesh, and how many come out worse."""
    groups = pictures(None)
    images = {k: v for group in groups.values() for k, v in group.items() if k in PICTURES}
    rows = []
    every = []
    for name, make in MESHES.items():
        mesh = make()
        found = np.array([gains(mesh, image) for image in images.values()])
        spoiled = found[:, 1:]
        every.append(spoiled.reshape(-1, len(SETTINGS)))
        for number, spoiling in enumerate(SPOILINGS):
            means = found[:, number].mean(axis=0)
            least = found[:, number].min(axis=0)
            unit = "{:.1f} ({:.1f})" if spoiling == "sharp" else "{:+.2f} ({:+.2f})"
            cells = [unit.format(a, b) for a, b in zip(means, least, strict=True)]
            rows.append([name, spoiling, *cells])
    every = np.concatenate(every)
    text = table(["", "", *(f"{name}: dB" for name in SETTINGS)], rows, words=2)
    for way, of_way in zip(SETTINGS, every.T, strict=True):
        text += (
            f"\n\n*{way}*: {of_way.mean():+.2f} dB in the mean of {len(of_way)} spoiled cases;"
            f" {(of_way < -0.1).sum()} worse than the input by over 0.1 dB,"
            f" {(of_way < -0.5).sum()} by over 0.5; least {of_way.min():+.2f}."
        )
    return text


def beside_images() -> str:
    """What the grid gains beside the image of the same pixels."""
    mesh, rows = grid(), []
    for sigma in (0.7, 1.0, 2.0, 3.0):
        lost = []
        for group in pictures(None).values():
            for whole in (group[name] for name in PICTURES if name in group):
                row, column = (length // 2 - SIDE // 2 for length in whole.shape[:2])
                if min(row, column) < 0:
                    continue
                image = np.atleast_3d(whole)[row : row + SIDE, column : column + SIDE]
                image = np.repeat(image, 3 // image.shape[2], axis=2)
                given = as_bytes(blur(image, sigma))
                flat = core.sharpen_image(given.astype(np.uint8))
                there = core.sharpen_vertex_signal(mesh, given.reshape(-1, 3), SETTINGS["Auto"])
                lost.append(fidelity(there.reshape(image.shape), image) - fidelity(flat, image))
        rows.append([f"{sigma:g}", f"{np.mean(lost):+.2f}", f"{np.min(lost):+.2f}"])
    return table(["Gauss", "grid less image: dB", "least"], rows)


def main() -> None:
    """Print the tables, or write them into a page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", type=Path, help="Markdown page to write the tables into")
    page = Page(parser.parse_args().write)
    page.write("vertex-colors", on_meshes())
    page.write("vertex-colors-images", beside_images())


if __name__ == "__main__":
    main()
