# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers beside the pictures: how sharp creases are, and how true the normals."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.integer]

CREASE_ANGLE = np.radians(20.0)


def normals_and_areas(vertices: Floats, triangles: Ints) -> tuple[Floats, Floats]:
    """Unit normals (m, 3) and areas (m,) of triangles."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    double = np.linalg.norm(cross, axis=1)
    return cross / np.where(double > 0, double, 1.0)[:, None], 0.5 * double


def crease_share(vertices: Floats, triangles: Ints) -> float:
    """Share of all bending that sits in edges which bend by more than 20 degrees.

    Bending is the angle between the two faces of an edge times its length. A rounded crease
    spreads it over many edges, each a little; a sharp one has it in single edges.
    """
    normals, _ = normals_and_areas(vertices, triangles)
    half_edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    faces = np.tile(np.arange(len(triangles)), 3)
    low, high = half_edges.min(axis=1), half_edges.max(axis=1)
    order = np.lexsort((high, low))
    low, high, faces = low[order], high[order], faces[order]
    pairs = np.flatnonzero((low[1:] == low[:-1]) & (high[1:] == high[:-1]))
    f, g = normals[faces[pairs]], normals[faces[pairs + 1]]
    angles = np.arctan2(np.linalg.norm(np.cross(f, g), axis=1), (f * g).sum(axis=1))
    bending = angles * np.linalg.norm(vertices[high[pairs]] - vertices[low[pairs]], axis=1)
    return float(bending[angles > CREASE_ANGLE].sum() / bending.sum())


def normal_error(vertices: Floats, true_vertices: Floats, triangles: Ints) -> float:
    """Mean angle to the true normals, by area, in degrees."""
    normals, _ = normals_and_areas(vertices, triangles)
    truth, areas = normals_and_areas(true_vertices, triangles)
    angles = np.arctan2(
        np.linalg.norm(np.cross(normals, truth), axis=1), (normals * truth).sum(axis=1)
    )
    return float(np.degrees(np.average(angles, weights=areas)))


def color_slope(colors: Floats, triangles: Ints) -> float:
    """How much colors change along the steepest hundredth of all edges."""
    changes = np.linalg.norm(colors[triangles] - colors[np.roll(triangles, -1, axis=1)], axis=2)
    return float(np.percentile(changes, 99))
