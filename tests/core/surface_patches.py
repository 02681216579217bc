# SPDX-License-Identifier: GPL-3.0-or-later
"""Patches of surfaces whose curvatures are known, in triangulations and UV layouts of all kinds."""

from typing import NamedTuple

import numpy as np
from atlases import apart
from scipy.spatial import Delaunay
from shapes import grid
from shock_filter import core


class Known(NamedTuple):
    """Places (k, 3), and their mean and Gaussian curvature (k,), convex positive."""

    places: np.ndarray
    mean: np.ndarray
    gaussian: np.ndarray


def _of_height(x, y, z, fx, fy, fxx, fxy, fyy):
    square = 1 + fx**2 + fy**2
    mean = ((1 + fy**2) * fxx - 2 * fx * fy * fxy + (1 + fx**2) * fyy) / (2 * square**1.5)
    return Known(np.stack([x, y, z], axis=1), -mean, (fxx * fyy - fxy**2) / square**2)


def saddle(p):
    """Heights (x^2 - 2 y^2) / 2 over a square of side 2."""
    x, y = (2 * p - 1).T
    one = np.ones_like(x)
    return _of_height(x, y, 0.5 * x**2 - y**2, x, -2 * y, one, 0 * one, -2 * one)


def sphere(p):
    """A part of the sphere of radius 1.25."""
    x, y = (1.6 * p - 0.8).T
    places = np.stack([x, y, np.ones_like(x)], axis=1)
    places *= 1.25 / np.linalg.norm(places, axis=1, keepdims=True)
    return Known(places, np.full(len(p), 0.8), np.full(len(p), 0.64))


def cylinder(p):
    """A third of the cylinder of radius 0.8."""
    angle, height = (2 * p - 1).T
    places = np.stack([0.8 * np.sin(angle), 1.6 * height, 0.8 * np.cos(angle)], axis=1)
    return Known(places, np.full(len(p), 0.625), np.zeros(len(p)))


def torus(p):
    """A part of the torus of radii 1 and 0.4, from its outer to its inner side."""
    u, v = (1.2 * p[:, 0] - 0.6), np.pi * p[:, 1]
    far = 1 + 0.4 * np.cos(v)
    places = np.stack([far * np.cos(u), far * np.sin(u), 0.4 * np.sin(v)], axis=1)
    along = np.cos(v) / far
    return Known(places, 0.5 * (2.5 + along), 2.5 * along)


SURFACES = {"saddle": saddle, "sphere": sphere, "cylinder": cylinder, "torus": torus}


def triangulated(kind, n, seed=0):
    """A unit square: "regular", "random" or "stretched" 10 : 1; points (k, 2) and faces."""
    if kind == "random":
        points = np.random.default_rng(seed).random(((n - 1) ** 2, 2))
        side = np.arange(n) / n
        rim = [
            (side, 0 * side),
            (0 * side + 1, side),
            (1 - side, 0 * side + 1),
            (0 * side, 1 - side),
        ]
        points = np.concatenate([points, *(np.stack(each, axis=1) for each in rim)])
        return points, Delaunay(points).simplices
    columns = 10 * n if kind == "stretched" else n
    vertices, faces = grid(columns, n)
    return vertices[:, :2] / vertices[:, :2].max(axis=0), faces


def patch(surface, kind, n):
    """A mesh with normals outwards, and the coordinates in the square at its corners (m, 3, 2)."""
    points, faces = triangulated(kind, n)
    known = surface(points)
    mesh = core.TriangleMesh(known.places, faces)
    away = known.places - [0.0, 0.0, -9.0] if surface is not torus else known.places - [1, 0, 0]
    if (mesh.normals * away[mesh.faces].mean(axis=1)).sum() < 0:
        mesh = core.TriangleMesh(known.places, faces[:, ::-1])
    return mesh, points[mesh.faces]


def laid_out(mesh, square, layout, size):
    """UV coordinates in one chart, in four turned ones, or one for each face; and the size."""
    if layout == "whole":
        return 0.05 + 0.9 * square, size
    if layout == "faces":
        return apart(mesh, texels_per_length=size / 8)
    quarter = (square.mean(axis=1) > 0.5).astype(int)
    number = quarter @ [1, 2]
    inside = square - 0.25 - 0.5 * quarter[:, None]
    angle = 0.3 + 1.9 * number
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    turned = np.stack(
        [c * inside[..., 0] - s * inside[..., 1], s * inside[..., 0] + c * inside[..., 1]], axis=-1
    )
    return 0.25 + 0.5 * quarter[:, None] + 0.5 * turned, size
