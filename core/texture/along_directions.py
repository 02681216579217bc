# SPDX-License-Identifier: GPL-3.0-or-later
"""Direction fields for textures, and the tensors that diffuse along them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import as_array, checked_word
from ..errors import InvalidSignal
from ..mesh.directions import PLACES, at_corners
from ..mesh.triangle_mesh import Floats, TriangleMesh


def checked_directions(
    mesh: TriangleMesh, directions: npt.ArrayLike | None, at: str | None
) -> Floats | None:
    """Return directions as unit vectors at the corners of faces; raises `InvalidSignal`."""
    if directions is None:
        if at is not None:
            checked_word(at, "at", PLACES)
        return None
    given = as_array(directions, "directions")
    at_corners(mesh, given, at, "directions have")
    if given.dtype.kind not in "iuf" or not np.isfinite(given).all():
        raise InvalidSignal("The directions hold NaN, infinity or no numbers; give vectors.")
    vectors = given.astype(np.float64)
    largest = np.abs(vectors).max(axis=1, keepdims=True)
    vectors /= np.where(largest > 0, largest, 1.0)
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    vectors /= np.where(length > 0, length, 1.0)
    return at_corners(mesh, vectors, at, "directions have")


def clearness(tensors: Floats) -> Floats:
    """Return the anisotropy of tensors, from 0 to 1: (m, 3) -> (m,).

    Parameters
    ----------
    tensors : (m, 3) float64
        As `core.mesh.directions.face_tensors` returns them.
    """
    trace, apart = tensors[:, 0] + tensors[:, 2], _apart(tensors)
    return np.where(trace > 1e-12, apart / np.maximum(trace, 1e-12), 0.0)


def stretched(tensors: Floats, along: Floats, across: Floats) -> Floats:
    """Make diffusion tensors with the directions of given tensors: (m, 3).

    Parameters
    ----------
    tensors : (m, 3) float64
    along, across : (m,) float64
        Diffusivity along and across the direction of each tensor.
    """
    a, b, c = tensors.T
    apart = np.maximum(_apart(tensors), 1e-300)
    mean, half = 0.5 * (along + across), 0.5 * (along - across)
    cosine, sine = (a - c) / apart, 2.0 * b / apart
    return np.stack([mean + half * cosine, half * sine, mean - half * cosine], axis=1)


def _apart(tensors: Floats) -> Floats:
    # The difference of the eigenvalues.
    a, b, c = tensors.T
    return np.hypot(a - c, 2.0 * b)
