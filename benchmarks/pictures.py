# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures for the pages: crops of photos side by side, and meshes drawn flat-shaded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from shock_filter import core
from shock_filter.core.base.parallel import kernel

_TITLE = 22
_GAP = 4
_FINER = 2  # drawn so many times larger, then averaged
_LIGHT = np.array([-0.55, 0.55, 0.63])
_CLAY = np.array([235.0, 225.0, 210.0])


def sheet(titles: Sequence[str], rows: Sequence[Sequence[np.ndarray]], zoom: int) -> Image.Image:
    """Lay out rows of equally large uint8 images under titles, each pixel `zoom` pixels wide."""
    height, width = (zoom * size for size in rows[0][0].shape[:2])
    whole = Image.new(
        "RGB",
        (len(titles) * (width + _GAP) - _GAP, _TITLE + len(rows) * (height + _GAP) - _GAP),
        "white",
    )
    pen = ImageDraw.Draw(whole)
    font = ImageFont.load_default(14)
    for column, title in enumerate(titles):
        left = column * (width + _GAP)
        pen.text((left + width / 2, _TITLE / 2), title, fill="black", font=font, anchor="mm")
        for line, row in enumerate(rows):
            tile = Image.fromarray(row[column]).resize((width, height), Image.Resampling.NEAREST)
            whole.paste(tile, (left, _TITLE + line * (height + _GAP)))
    return whole


@dataclass(frozen=True)
class View:
    """How a mesh is seen.

    Attributes
    ----------
    turns : tuple of float
        Degrees by which it is turned about x, then y, then z; x points right and z to the viewer.
    centre : tuple of float
        The middle of the picture, right and up from the middle of the mesh, in its sizes.
    size : float
        Width of the picture, in the mesh's size.
    """

    turns: tuple[float, float, float] = (0.0, 0.0, 0.0)
    centre: tuple[float, float] = (0.0, 0.0)
    size: float = 1.05


def draw(
    mesh: core.TriangleMesh,
    reference: core.TriangleMesh,
    view: View,
    pixels: int,
    colors: np.ndarray | None = None,
) -> np.ndarray:
    """Draw a mesh flat-shaded, framed by a reference; return (pixels, pixels, 3) uint8.

    Faces are of clay, or have the given colors, (m, 3) in [0, 1].
    """
    turn = np.eye(3)
    for axis, degrees in enumerate(view.turns):
        turn = _rotation(axis, np.radians(degrees)) @ turn
    frame = reference.vertices @ turn.T
    low, high = frame.min(axis=0), frame.max(axis=0)
    extent = (high - low)[:2].max()
    middle = (low + high) / 2 + [view.centre[0] * extent, view.centre[1] * extent, 0.0]
    fine = pixels * _FINER
    points = (mesh.vertices @ turn.T - middle) * (fine / (view.size * extent))
    points[:, 1] *= -1
    points[:, :2] += (fine - 1) / 2
    cosines = (mesh.normals @ turn.T) @ (_LIGHT / np.linalg.norm(_LIGHT))
    brightness = (0.5 + 0.5 * cosines) ** 1.6
    seen, _ = visible(points, mesh.faces, fine)
    paint = _CLAY if colors is None else 255 * np.clip(colors[seen], 0, 1)
    picture = np.where(seen[..., None] < 0, 255.0, brightness[seen][..., None] * paint)
    picture = picture.reshape(pixels, _FINER, pixels, _FINER, 3).mean(axis=(1, 3))
    return np.rint(picture).astype(np.uint8)


def _rotation(axis: int, angle: float) -> np.ndarray:
    turn = np.eye(3)
    i, j = [k for k in range(3) if k != axis]
    sign = -1.0 if axis == 1 else 1.0
    turn[i, i] = turn[j, j] = np.cos(angle)
    turn[j, i] = sign * np.sin(angle)
    turn[i, j] = -turn[j, i]
    return turn


def visible(points: np.ndarray, faces: np.ndarray, pixels: int) -> tuple[np.ndarray, np.ndarray]:
    """Find what a square picture shows.

    Parameters
    ----------
    points : (n, 3) array
        (across, down, towards the viewer), in pixels; centres of pixels are at whole numbers.

    Returns
    -------
    seen : (pixels, pixels) int32
        The face in front, or -1.
    shares : (pixels, pixels, 2) float64
        Barycentric coordinates of its second and third corner.
    """
    depth = np.full((pixels, pixels), -np.inf)
    seen = np.full((pixels, pixels), -1, dtype=np.int32)
    shares = np.zeros((pixels, pixels, 2))
    _draw_faces(points, faces, depth, seen, shares)
    return seen, shares


@kernel
def _draw_faces(points, faces, depth, seen, shares):
    size = len(depth)
    for f in range(len(faces)):
        ax, ay, az = points[faces[f, 0], 0], points[faces[f, 0], 1], points[faces[f, 0], 2]
        bx, by, bz = points[faces[f, 1], 0], points[faces[f, 1], 1], points[faces[f, 1], 2]
        cx, cy, cz = points[faces[f, 2], 0], points[faces[f, 2], 1], points[faces[f, 2], 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0:
            continue
        for y in range(max(int(min(ay, by, cy)), 0), min(int(max(ay, by, cy)) + 2, size)):
            for x in range(max(int(min(ax, bx, cx)), 0), min(int(max(ax, bx, cx)) + 2, size)):
                b = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
                c = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
                if b >= 0 and c >= 0 and b + c <= 1:
                    z = az + b * (bz - az) + c * (cz - az)
                    if z > depth[y, x]:
                        depth[y, x] = z
                        seen[y, x] = f
                        shares[y, x, 0] = b
                        shares[y, x, 1] = c
