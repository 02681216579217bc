# SPDX-License-Identifier: GPL-3.0-or-later
"""Short-time Beltrami kernel on signals on triangle meshes (paper C)."""

from __future__ import annotations

import numpy.typing as npt

from ..base.checks import by_keyword, checked_mask, checked_signal, checked_type
from ..base.progress import ProgressCallback, phase, reporting
from ..beltrami.mesh_smoothing import smooth_painted
from ..mesh.triangle_mesh import TriangleMesh, check_mesh
from ..settings import BeltramiMeshSettings, given_or_default
from .signals import corner_rows, cut_at_jumps, from_own_corners, like, to_own_corners


@by_keyword
def beltrami_vertex_signal(
    mesh: TriangleMesh,
    signal: npt.ArrayLike,
    settings: BeltramiMeshSettings | None = None,
    *,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> npt.NDArray:
    """Denoise a signal given at the vertices of a mesh, such as vertex colors; keep its edges.

    Parameters
    ----------
    mesh : TriangleMesh
    signal : (n,) or (n, d) array of float32 or float64
        Any number of channels, which are filtered together; `beta` assumes values in [0, 1].
    settings : BeltramiMeshSettings, optional
    mask : (n,) array of float in [0, 1], optional
        1 filters fully, less mixes with the input, 0 keeps it bit for bit.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    array like `signal`
        Within the input's range. A time of 0 returns the input bit for bit.

    Raises
    ------
    InvalidSignal
        If signal or mask do not fit the mesh, or hold NaN or infinity.
    Cancelled
        If `progress` returned False.

    Notes
    -----
    Paper C, equations 20 to 22, applied to the components of the signal only (equation 7). Lengths
    are in mean edge lengths. Vertices are weighted by the area around them; the paper does not
    specify weights.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> core.beltrami_vertex_signal(mesh, np.array([0.5, 0.51, 0.5, 0.49])).round(2).tolist()
    [0.5, 0.5, 0.5, 0.5]
    """
    check_mesh(mesh)
    given = checked_type(signal)
    values = checked_signal(given, mesh.vertex_count)
    weights = checked_mask(mask, mesh.vertex_count)
    settings = given_or_default(settings, BeltramiMeshSettings)
    if settings.time == 0:
        return given.copy()
    with reporting(progress):
        _, filtered = smooth_painted(mesh, values, settings)
        with phase(1.0, 1.0, "Denoising"):
            return like(given, values, filtered, weights)


@by_keyword
def beltrami_corner_signal(
    mesh: TriangleMesh,
    signal: npt.ArrayLike,
    settings: BeltramiMeshSettings | None = None,
    *,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> npt.NDArray:
    """Denoise a signal given at the corners of the faces of a mesh, such as corner colors.

    Where the corners at a vertex differ, the signal is discontinuous, and is not averaged across
    the discontinuity; equal corners stay equal.

    Parameters
    ----------
    mesh : TriangleMesh
    signal : (m, 3) or (m, 3, d) array of float32 or float64
        Corners in the order of the faces that the mesh was made from.
    settings, progress
        As in `beltrami_vertex_signal`.
    mask : (n,) array of float in [0, 1], optional
        Weights of the vertices.

    Returns
    -------
    array like `signal`
        Within the input's range. A time of 0 returns the input bit for bit.

    Raises
    ------
    InvalidSignal, Cancelled
        As in `beltrami_vertex_signal`.

    Notes
    -----
    The same as `beltrami_vertex_signal` on the surface cut open at the discontinuities.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    >>> core.beltrami_corner_signal(mesh, corners).tolist()
    [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]
    """
    check_mesh(mesh)
    given = checked_type(signal)
    own = to_own_corners(mesh, given)
    values = checked_signal(own, 3 * mesh.face_count)
    weights = checked_mask(mask, mesh.vertex_count)
    settings = given_or_default(settings, BeltramiMeshSettings)
    if settings.time == 0:
        return given.copy()
    with reporting(progress):
        cut, cut_values = cut_at_jumps(mesh, own)
        _, filtered = smooth_painted(cut, cut_values, settings)
        corner_weights = None if weights is None else weights[mesh.faces.reshape(-1)]
        with phase(1.0, 1.0, "Denoising"):
            mixed = like(own, values, filtered[corner_rows(cut)], corner_weights)
        return from_own_corners(mesh, mixed, given)
