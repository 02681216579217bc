# SPDX-License-Identifier: GPL-3.0-or-later
"""Even meshes with relief, as displacement makes them.

A ball, a sheet, a pipe and a rounded cube out of quads, with lumps, scales, dimples, knurls and
cells. Training has other relief on other meshes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree
from shock_filter import core

Floats = np.ndarray

SEED = 123


def _joined(grid: Floats, closed: bool) -> tuple[Floats, np.ndarray]:
    # Two triangles for each quad of a grid of places, whose last column meets the first or not.
    rows, columns = grid.shape[:2]
    i, j = np.mgrid[: rows - 1, : columns - (not closed)]
    at = lambda x, y: (x * columns + y % columns).ravel()  # noqa: E731
    a, b, c, d = at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)
    return grid.reshape(-1, 3), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def ball() -> tuple[Floats, np.ndarray]:
    """A ball of quads, open at its poles."""
    t, a = np.linspace(0.15, np.pi - 0.15, 110), np.arange(220) * np.pi / 110
    r, z = np.sin(t)[:, None], np.repeat(-np.cos(t)[:, None], 220, 1)
    return _joined(np.stack([r * np.cos(a), r * np.sin(a), z], -1), True)


def sheet() -> tuple[Floats, np.ndarray]:
    """A flat square."""
    x, y = np.meshgrid(np.linspace(-1, 1, 140), np.linspace(-1, 1, 140))
    return _joined(np.stack([x, y, 0 * x], -1), False)


def pipe() -> tuple[Floats, np.ndarray]:
    """An open pipe."""
    a, z = np.arange(200) * np.pi / 100, np.arange(100)[:, None] * np.pi / 200
    x, y = 0.5 * np.cos(a), 0.5 * np.sin(a)
    return _joined(np.stack(np.broadcast_arrays(x, y, z), -1), True)


def cube() -> tuple[Floats, np.ndarray]:
    """A cube of quads, blown up to a ball."""
    line = np.tan(np.linspace(-np.pi / 4, np.pi / 4, 64))
    x, y = np.meshgrid(line, line)
    side = np.stack([x, y, np.ones_like(x)], -1)
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    places, faces = [], []
    for axis in range(3):
        for way in (1, -1):
            v, f = _joined(way * np.roll(side, axis, -1), False)
            faces.append(f[:, ::way] + len(v) * len(places))
            places.append(v)
    together, index = np.unique(np.concatenate(places).round(9), axis=0, return_inverse=True)
    return together, index.reshape(-1)[np.concatenate(faces)]


SHAPES = {"ball": ball, "sheet": sheet, "pipe": pipe, "cube": cube}


def lumps(p: Floats, width: float) -> Floats:
    """Noise of two octaves, between random values on a grid."""
    values = np.random.default_rng(SEED).random((40, 40, 40))

    def octave(q: Floats) -> Floats:
        cell = np.floor(q + 20)
        t = q + 20 - cell
        t = t * t * t * (t * (6 * t - 15) + 10)
        total = np.zeros(len(q))
        for corner in np.ndindex(2, 2, 2):
            x, y, z = (cell + corner).astype(int).T % 40
            total += values[x, y, z] * np.where(corner, t, 1 - t).prod(axis=1)
        return 2 * total - 1

    return 0.7 * octave(2 * p / width) + 0.35 * octave(4 * p / width + 7)


def _some(p: Floats, width: float, share: float) -> Floats:
    # Distances to the nearest of some of the places.
    count = max(int(share * np.ptp(p[:, 0]) ** 2 / width**2), 20)
    chosen = np.random.default_rng(SEED).choice(len(p), count, replace=False)
    return cKDTree(p[chosen]).query(p)[0]


def scales(p: Floats, width: float) -> Floats:
    """Round scales with sharp grooves."""
    return 0.5 - np.clip(_some(p, width, 4) / width / 0.7, 0, 1) ** 2


def dimples(p: Floats, width: float) -> Floats:
    """Soft dimples in what is even."""
    return -(np.clip(1 - (_some(p, width, 2) / (0.35 * width)) ** 2, 0, 1) ** 2)


def knurls(p: Floats, width: float) -> Floats:
    """Two sets of waves across each other."""
    k = 2 * np.pi / width
    return np.sin(k * (p[:, 0] + p[:, 2])) * np.sin(k * (p[:, 1] - p[:, 2]))


def cells(p: Floats, width: float) -> Floats:
    """Waves along all axes."""
    return 0.4 * np.sin(2 * np.pi / width * p).sum(axis=1)


RELIEF: dict[str, Callable[[Floats, float], Floats]] = {
    "lumps": lumps, "scales": scales, "dimples": dimples, "knurls": knurls, "cells": cells,
}  # fmt: skip


def with_relief(shape: str, relief: str, wave: float, steep: float = 1 / 6) -> core.TriangleMesh:
    """A shape whose vertices relief moves along its normals, up to `steep` of its wave.

    A wave is about so many mean edges from one bump to the next.
    """
    places, faces = SHAPES[shape]()
    mesh = core.TriangleMesh(places, faces)
    width = wave * mesh.mean_edge_length
    high = RELIEF[relief](places, width) * steep * width
    normals = np.zeros_like(places)
    for corner in faces.T:
        np.add.at(normals, corner, mesh.areas[:, None] * mesh.normals)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return core.TriangleMesh(places + high[:, None] * normals, faces)
