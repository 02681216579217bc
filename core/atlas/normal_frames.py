# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversion of a texture's normals between tangent space and object space, texel by texel.

In object space, normals are plain vectors: all that filters and stitches textures across seams
also works for normals, however the charts lie.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import Floats
from ..base.parallel import kernel, run
from ..mesh.tangents import tangent_frames
from .atlas import TextureAtlas
from .sheet import NOTHING, ROWS, shares_of_corners


class NormalFrames:
    """The frames of an atlas for tangent-space normals: those of MikkTSpace.

    Parameters
    ----------
    atlas : TextureAtlas
    normals : (m, 3, 3) float64, optional
        The mesh's unit normals at the corners of its faces; smooth ones if left out.
    green_down : bool
        Whether green points against the second texture coordinate, as in DirectX.
    """

    def __init__(
        self, atlas: TextureAtlas, normals: Floats | None = None, *, green_down: bool = False
    ) -> None:
        self._sheet = atlas.sheet
        # Texture coordinates from the charts' points: scaled, but not rotated.
        row, column = np.moveaxis(atlas.charts.points, -1, 0)
        uv = np.stack([column / atlas.width, row / atlas.height], axis=-1)
        found = tangent_frames(atlas.mesh, uv, normals)
        self.corners = found._replace(signs=-found.signs) if green_down else found

    def to_object(self, values: npt.NDArray[np.float32]) -> None:
        """Convert the nodes inside charts, in place; values are colors (n + 1) / 2 of normals n."""
        run(_to_object, len(values), self._sheet, self.corners, values, chunk=ROWS)

    def to_tangent(self, values: npt.NDArray[np.float32]) -> None:
        """Convert all nodes of a sheet, in place; ghosts to the frames of their own chart."""
        run(_to_tangent, len(values), self._sheet, self.corners, values, chunk=ROWS)


@kernel
def axes_at(points, frames, f, y, x, axes):
    """Interpolate tangent, bitangent and normal of a face at a place in or near it: rows."""
    shares = shares_of_corners(points, f, y, x)
    axes[:] = 0.0
    for k in range(3):
        for i in range(3):
            axes[0, i] += shares[k] * frames.tangents[f, k, i]
            axes[2, i] += shares[k] * frames.normals[f, k, i]
    _cross(axes[2], axes[0], axes[1])
    for i in range(3):
        axes[1, i] *= frames.signs[f]


@kernel
def into_frame(axes, color):
    """Convert a normal's color from object space to a frame, in place."""
    vector, rotated, across = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        vector[i] = 2.0 * color[i] - 1.0
    # Cramer's rule; of the determinant only the sign matters.
    _cross(axes[1], axes[2], across)
    det = axes[0, 0] * across[0] + axes[0, 1] * across[1] + axes[0, 2] * across[2]
    sign = 1.0 if det >= 0 else -1.0
    for k in range(3):
        _cross(axes[(k + 1) % 3], axes[(k + 2) % 3], across)
        rotated[k] = sign * (across[0] * vector[0] + across[1] * vector[1] + across[2] * vector[2])
    _store(vector, rotated, color)


@kernel
def _cross(u, v, out):
    out[0] = u[1] * v[2] - u[2] * v[1]
    out[1] = u[2] * v[0] - u[0] * v[2]
    out[2] = u[0] * v[1] - u[1] * v[0]


@kernel
def _store(vector, rotated, color):
    # Stores a vector, normalized, as a color; uses `vector` if it has zero length.
    length = np.sqrt(rotated[0] ** 2 + rotated[1] ** 2 + rotated[2] ** 2)
    if not length > 1e-12:
        rotated[:] = vector
        length = max(np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2), 1e-12)
    for i in range(3):
        color[i] = 0.5 + 0.5 * rotated[i] / length


@kernel
def _to_object(start, stop, sheet, frames, values):
    nodes = sheet.nodes
    axes, vector, rotated = np.empty((3, 3)), np.empty(3), np.empty(3)
    for y in range(start, stop):
        for x in range(nodes.shape[1]):
            if nodes[y, x] < 0:
                continue
            axes_at(sheet.points, frames, nodes[y, x], y, x, axes)
            for i in range(3):
                vector[i] = 2.0 * values[y, x, i] - 1.0
            for i in range(3):
                rotated[i] = (
                    vector[0] * axes[0, i] + vector[1] * axes[1, i] + vector[2] * axes[2, i]
                )
            _store(vector, rotated, values[y, x])


@kernel
def _to_tangent(start, stop, sheet, frames, values):
    nodes = sheet.nodes
    axes = np.empty((3, 3))
    for y in range(start, stop):
        for x in range(nodes.shape[1]):
            f = nodes[y, x]
            if f < NOTHING:
                f = sheet.ghost_edges[-2 - f] // 3  # -1 for ghosts of no chart
            if f < 0:
                continue
            axes_at(sheet.points, frames, f, y, x, axes)
            into_frame(axes, values[y, x])
