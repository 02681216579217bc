# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws signals at vertices into texels as smooth cubics, which show no triangles."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.sheet import ROWS, shares_of_corners
from ..base.checks import Floats
from ..base.parallel import kernel, run
from ..base.progress import ask, phase
from ..base.vectors import after
from ..mesh.jets import Frames, gradients_of
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import DilateSettings
from ..texture.texels import Texture, checked_atlas, written

_Single = npt.NDArray[np.float32]

_POINTS = 10
"""Control points of a cubic triangle: three corners, six on edges, one in the middle."""


def atlas_for(
    atlas: TextureAtlas | None, mesh: TriangleMesh, uv: npt.ArrayLike, shape: tuple[int, int]
) -> TextureAtlas:
    """Return the given atlas if it fits an image of this shape, or a new one if it is None."""
    return checked_atlas(atlas, mesh, uv, np.zeros((*shape, 1), dtype=np.float32))


def with_gutter(atlas: TextureAtlas, sheet: _Single, gutter: int) -> _Single:
    """Return the image of values on the sheet, (rows, columns, c), with its gutter filled."""
    empty = np.zeros((atlas.height, atlas.width, sheet.shape[2]), dtype=np.float32)
    return written(Texture(atlas, empty, made=True), sheet, DilateSettings(gutter=gutter), None)


def drawn_smoothly(atlas: TextureAtlas, frames: Frames, radii: Floats, signals: Floats) -> _Single:
    """Draw signals at the vertices on the sheet, as cubics that are smooth across edges.

    Parameters
    ----------
    atlas : TextureAtlas
    frames, radii
        Frames and radii for the fit of gradients, see `core.mesh.jets`.
    signals : (n, c) float64

    Returns
    -------
    (rows, columns, c) float32
        Values at nodes inside charts, see `with_gutter`.
    """
    mesh = atlas.mesh
    with phase(0.0, 0.7, "Drawing"):
        points = control_points(mesh, gradients_of(mesh, frames, radii, signals), signals)
    with phase(0.7, 1.0, "Drawing"):
        sheet = np.zeros((*atlas.sheet.nodes.shape, signals.shape[1]), dtype=np.float32)
        run(_draw, len(sheet), atlas.sheet.nodes, atlas.sheet.points, points,
            sheet, chunk=ROWS)  # fmt: skip
    return sheet


def control_points(mesh: TriangleMesh, gradients: Floats, signals: Floats) -> Floats:
    """Return the control points of a cubic Bezier triangle in each face: (m, 10, c).

    The cubics take the values and the gradients at the corners, and reproduce quadratics. No
    control point leaves the range of the values around its edge, so that a peak has no ditch
    around it.

    Parameters
    ----------
    mesh : TriangleMesh
    gradients : (n, c, 3) float64
        Per mean edge length.
    signals : (n, c) float64
    """
    start, ring = mesh.neighbours
    lows, highs = signals.copy(), signals.copy()
    run(_range_around, len(signals), start, ring, np.ascontiguousarray(signals), lows, highs)
    ask()
    points = np.empty((mesh.face_count, _POINTS, signals.shape[1]))
    run(_control, mesh.face_count, mesh.scaled_vertices, mesh.faces,
        np.ascontiguousarray(gradients), np.ascontiguousarray(signals), lows, highs,
        points)  # fmt: skip
    return points


@kernel
def _range_around(start, stop, ring_start, ring, values, lows, highs):
    for v in range(start, stop):
        for i in range(ring_start[v], ring_start[v + 1]):
            for c in range(values.shape[1]):
                lows[v, c] = min(lows[v, c], values[ring[i], c])
                highs[v, c] = max(highs[v, c], values[ring[i], c])


@kernel
def _control(start, stop, vertices, faces, gradients, values, lows, highs, points):
    # Corners 0 to 2; 3 + 2 k and 4 + 2 k on the edge from corner k to the next one; the middle.
    for f in range(start, stop):
        for c in range(values.shape[1]):
            corners, edges = 0.0, 0.0
            low, high = np.inf, -np.inf
            for k in range(3):
                a, b = faces[f, k], faces[f, after(k)]
                rise, fall = 0.0, 0.0
                for x in range(3):
                    along = (vertices[b, x] - vertices[a, x]) / 3.0
                    rise += gradients[a, c, x] * along
                    fall += gradients[b, c, x] * along
                least, most = min(lows[a, c], lows[b, c]), max(highs[a, c], highs[b, c])
                points[f, k, c] = values[a, c]
                points[f, 3 + 2 * k, c] = min(max(values[a, c] + rise, least), most)
                points[f, 4 + 2 * k, c] = min(max(values[b, c] - fall, least), most)
                corners += values[a, c]
                edges += points[f, 3 + 2 * k, c] + points[f, 4 + 2 * k, c]
                low, high = min(low, least), max(high, most)
            points[f, 9, c] = min(max(edges / 4.0 - corners / 6.0, low), high)


@kernel
def _draw(start, stop, nodes, places, points, sheet):
    for y in range(start, stop):
        for x in range(nodes.shape[1]):
            f = nodes[y, x]
            if f < 0:
                continue
            u, v, w = shares_of_corners(places, f, y, x)
            for c in range(sheet.shape[2]):
                p = points[f, :, c]
                sheet[y, x, c] = (
                    u * u * u * p[0] + v * v * v * p[1] + w * w * w * p[2]
                    + 3.0 * (u * u * v * p[3] + u * v * v * p[4] + v * v * w * p[5]
                             + v * w * w * p[6] + w * w * u * p[7] + w * u * u * p[8])
                    + 6.0 * u * v * w * p[9]
                )  # fmt: skip
