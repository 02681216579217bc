# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoising of virtual scans, ours and other ways."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import common
import numpy as np
import peers
import scipy.sparse as sp
from report import Target, table, targets
from shock_filter import core
from shock_filter.core.filters.creases import consistent_normals
from virtual_scans import Errors, Floats, Scan, errors, fused, range_image, with_white_noise

Filter = Callable[[core.TriangleMesh], Floats]


class Case(NamedTuple):
    """A shape, how it is scanned, how finely, and with how much noise."""

    shape: str
    scanner: str
    size: int
    noise: float
    part: bool = False

    @property
    def label(self) -> str:
        """Its name in a table."""
        return f"{Path(self.shape).stem}, {self.scanner} {self.noise:g}"


RANGE, FUSED, WHITE = "range image", "fused", "white noise"

DEVELOPED = [
    Case("fandisk.obj", WHITE, 0, 0.1, True),
    Case("fandisk.obj", WHITE, 0, 0.3, True),
    Case("julius.obj", WHITE, 0, 0.2),
    Case("fandisk.obj", RANGE, 150, 0.2, True),
    Case("gear", RANGE, 120, 0.15, True),
    Case("gear", RANGE, 180, 0.35, True),
    Case("washer", RANGE, 110, 0.25, True),
    Case("julius.obj", RANGE, 160, 0.15),
    Case("bunny.obj", RANGE, 140, 0.25),
    Case("lion_statue.obj", RANGE, 180, 0.2),
    Case("boulder", RANGE, 110, 0.2),
    Case("fandisk.obj", FUSED, 80, 0.3, True),
    Case("gear", FUSED, 60, 0.25, True),
    Case("washer", FUSED, 48, 0.3, True),
    Case("washer", FUSED, 48, 0.6, True),
    Case("julius.obj", FUSED, 60, 0.35),
    Case("julius.obj", FUSED, 80, 0.15),
    Case("bunny.obj", FUSED, 60, 0.35),
    Case("lion_statue.obj", FUSED, 80, 0.25),
    Case("boulder", FUSED, 44, 0.4),
]
HELD_OUT = [
    Case("block.obj", WHITE, 0, 0.2, True),
    Case("sharp sphere", WHITE, 0, 0.3, True),
    Case("nicolo.obj", WHITE, 0, 0.1),
    Case("nicolo.obj", WHITE, 0, 0.3),
    Case("block.obj", RANGE, 150, 0.2, True),
    Case("nut", RANGE, 120, 0.15, True),
    Case("casting.off", RANGE, 180, 0.25, True),
    Case("nut", RANGE, 130, 0.3, True),
    Case("nicolo.obj", RANGE, 150, 0.2),
    Case("igea.ply", RANGE, 140, 0.15),
    Case("dragon_50k.obj", RANGE, 180, 0.2),
    Case("block.obj", FUSED, 70, 0.35, True),
    Case("nut", FUSED, 50, 0.3, True),
    Case("casting.off", FUSED, 80, 0.25, True),
    Case("sharp sphere", FUSED, 50, 0.35, True),
    Case("nicolo.obj", FUSED, 60, 0.3),
    Case("igea.ply", FUSED, 60, 0.4),
    Case("dragon_50k.obj", FUSED, 90, 0.25),
    Case("armadillo.obj", FUSED, 80, 0.3),
]
MAKERS = {RANGE: range_image, FUSED: fused}


def scan_of(data: Path | None, case: Case, seed: int) -> Scan:
    """Make a case's scan."""
    if case.scanner == WHITE:
        return with_white_noise(data, case.shape, case.noise, seed)
    return MAKERS[case.scanner](data, case.shape, case.size, case.noise, seed)


def smoothed(mesh: core.TriangleMesh, passes: int, back: float = 0.0) -> Floats:
    """Laplacian smoothing by steps of half a way; with steps `back`, Taubin's filter."""
    ends = np.concatenate([mesh.faces[:, [k, (k + 1) % 3]] for k in range(3)])
    ends = np.concatenate([ends, ends[:, ::-1]])
    near = sp.coo_matrix((np.ones(len(ends)), ends.T), shape=(mesh.vertex_count,) * 2).tocsr()
    near.data[:] = 1.0
    near = sp.diags(1 / np.maximum(np.asarray(near.sum(axis=1)).reshape(-1), 1)) @ near
    points = mesh.vertices
    for _ in range(passes):
        points = points + 0.5 * (near @ points - points)
        points = points - back * (near @ points - points)
    return points


def normals_averaged(mesh: core.TriangleMesh, spread: float, guided: bool) -> Floats:
    """Bilateral averages of normals (Zheng et al. 2011), or guided ones (Zhang et al. 2015).

    Over the faces that share a vertex, twenty times. The positions are fitted as ours are.
    """
    count, normals = mesh.face_count, mesh.normals
    corners = sp.coo_matrix(
        (np.ones(3 * count), (np.repeat(np.arange(count), 3), mesh.faces.reshape(-1)))
    ).tocsr()
    one, other = (corners @ corners.T).nonzero()
    centres = mesh.vertices[mesh.faces].mean(axis=1)
    squares = ((centres[one] - centres[other]) ** 2).sum(axis=1)
    weights = mesh.areas[other] * np.exp(-0.5 * squares / squares.mean())
    for turn in range(20):
        guide = normals
        if guided and turn % 2 == 0:
            guide = consistent_normals(mesh, normals, np.ones(count, bool), 1)
        if turn % 2 == 0 or not guided:
            apart = ((guide[one] - guide[other]) ** 2).sum(axis=1)
            mean = sp.csr_matrix(
                (weights * np.exp(-0.5 * apart / spread**2), (one, other)), shape=(count, count)
            )
        normals = mean @ normals
        normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    normals[mesh.areas == 0] = 0.0
    return core.fit_to_normals(mesh, normals, core.FitSettings(screening_radius=5.0))
