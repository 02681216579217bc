# SPDX-License-Identifier: GPL-3.0-or-later
"""Signals on meshes: rows at vertices and corners, cuts at jumps, brightness, mixing by weights."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import checked_signal
from ..base.memo import kept
from ..base.parallel import kernel, run
from ..errors import InvalidSignal
from ..grid.channels import brightness_weights
from ..mesh.triangle_mesh import Floats, TriangleMesh
from ..mesh.weld import split_at_jumps


def luminance(values: Floats) -> Floats:
    """Return the brightness of linear colors, or the mean if they are not RGB: (n, d) -> (n, 1)."""
    weights = brightness_weights(values.shape[1])
    return np.ascontiguousarray(values[:, : len(weights)] @ weights[:, None])


def to_own_corners(mesh: TriangleMesh, given: npt.NDArray) -> npt.NDArray:
    """Return a corner signal as one row per corner, in the order of ``mesh.faces``: (3 m, d)."""
    if given.ndim not in (2, 3) or given.shape[:2] != (mesh.face_count, 3):
        raise InvalidSignal(
            f"The signal has the shape {given.shape}; give ({mesh.face_count}, 3) or"
            f" ({mesh.face_count}, 3, channels)."
        )
    return mesh.own_corners(given.reshape(mesh.face_count, 3, -1)).reshape(3 * len(given), -1)


def from_own_corners(mesh: TriangleMesh, own: npt.NDArray, given: npt.NDArray) -> npt.NDArray:
    """Undo `to_own_corners`: (3 m, d) to the shape of the signal that was given."""
    return mesh.own_corners(own.reshape(mesh.face_count, 3, -1)).reshape(given.shape)


def cut_at_jumps(mesh: TriangleMesh, own: npt.NDArray) -> tuple[TriangleMesh, Floats]:
    """Cut a mesh open where the values of its corners differ; the result is cached with it.

    Parameters
    ----------
    mesh : TriangleMesh
    own : (3 m, d) array
        Corner values as `to_own_corners` orders them.

    Returns
    -------
    cut : TriangleMesh
        With the faces of `mesh`, in order.
    values : (n', d) float64
        The values at its vertices.
    """

    def split() -> tuple[TriangleMesh, Floats]:
        return split_at_jumps(mesh, checked_signal(own, 3 * mesh.face_count))

    return kept(mesh, "cut", (own,), split)


def corner_rows(cut: TriangleMesh) -> npt.NDArray[np.int32]:
    """Return the vertex of each corner, in the order of the faces given for a cut mesh: (3 m,)."""
    return cut.own_corners(cut.faces).reshape(-1)


def like(given: npt.NDArray, values: Floats, result: Floats, weights: Floats | None) -> npt.NDArray:
    """Mix a result with its input by weights, in the type and shape of the given signal."""
    if weights is None:
        return result.astype(given.dtype).reshape(given.shape)
    mixed = np.empty(result.shape, dtype=given.dtype)
    run(mix_rows, len(result), values, result, weights, mixed)
    return mixed.reshape(given.shape)


@kernel
def mix_rows(start, stop, values, result, weights, mixed):
    """Mix rows of a result with those of the input, which weights of 0 and 1 keep as they are."""
    for i in range(start, stop):
        for j in range(values.shape[1]):
            value = values[i, j]
            if weights[i] == 1:
                value = result[i, j]
            elif weights[i] != 0:
                value += weights[i] * (result[i, j] - value)
            mixed[i, j] = value
