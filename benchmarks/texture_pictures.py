# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of textures on their meshes, near to seams and sampled as a renderer does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pictures import visible
from shock_filter import core
from texture_models import Seams, sample

_AROUND = 220  # gray where there is no surface


@dataclass(frozen=True)
class Spot:
    """A place on a surface that is looked at straight from above.

    Attributes
    ----------
    point, normal, up : (3,) float64
        Middle of the picture, the way to the viewer, and roughly what points up.
    """

    point: np.ndarray
    normal: np.ndarray
    up: np.ndarray


def spot_at(atlas: core.TextureAtlas, seams: Seams, number: int) -> Spot:
    """Look at a sample of a seam, which then runs upwards."""
    mesh = atlas.mesh
    face, corner = divmod(int(seams.edges[number]), 3)
    start, end = mesh.vertices[mesh.faces[face, [corner, (corner + 1) % 3]]]
    normal = mesh.normals[face] + mesh.normals[mesh.twins[face, corner] // 3]
    return Spot(start + seams.shares[number] * (end - start), normal, end - start)


def look(
    atlas: core.TextureAtlas, image: np.ndarray, spot: Spot, texels: float, pixels: int
) -> np.ndarray:
    """Draw a texture on its mesh with linear sampling and no light: (pixels, pixels, 3) uint8.

    Parameters
    ----------
    image : (h, w, 3) uint8
        The texture, or a smaller size of it.
    texels : float
        Width of the picture on the surface, in texels of the full texture.
    """
    mesh = atlas.mesh
    front = spot.normal / np.linalg.norm(spot.normal)
    right = np.cross(spot.up, front)
    right /= np.linalg.norm(right)
    turn = np.stack([right, -np.cross(front, right), front])
    points = (mesh.vertices - spot.point) @ turn.T * (pixels / (texels * atlas.texel_size))
    points[:, :2] += (pixels - 1) / 2
    seen, shares = visible(points, mesh.faces, pixels)
    corners = atlas.charts.points[seen]
    there = corners[..., 0, :].copy()
    for corner in (1, 2):
        there += shares[..., corner - 1, None] * (corners[..., corner, :] - corners[..., 0, :])
    scale = np.array([len(image) / atlas.height, image.shape[1] / atlas.width])
    colors = sample(image, (there + 0.5) * scale - 0.5)
    return np.rint(np.where(seen[..., None] < 0, _AROUND, colors)).astype(np.uint8)


def smaller(image: np.ndarray, times: int) -> np.ndarray:
    """Average squares of `times` times `times` texels, as mip-mapping does."""
    height, width, channels = image.shape
    blocks = image.reshape(height // times, times, width // times, times, channels)
    return np.rint(blocks.mean(axis=(1, 3))).astype(np.uint8)
