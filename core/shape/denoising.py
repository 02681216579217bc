# SPDX-License-Identifier: GPL-3.0-or-later
"""The short-time Beltrami kernel on triangle meshes: painted signals, the surface, or both.

A signal I painted on a mesh makes a surface of its own, with the vertices at (X, beta I): X in
mean edge lengths, I in [0, 1]. Each value becomes the mean of the values around it, weighted by
``exp(-d^2 / 4 t)`` with d the geodesic distance on that surface (paper C, equations 20 to 22; the
constant H0 is what makes the weights sum to one).

The paper integrates over the surface and does not say what a vertex stands for: here, for a third
of the area around it on the mesh, so that crowded vertices do not count more.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from ..base.checks import by_keyword, checked_mask, checked_signal, checked_type
from ..base.progress import ProgressCallback, aside, phase, reporting
from ..beltrami.mesh_smoothing import smooth_graph
from ..color.signals import from_own_corners, like, to_own_corners
from ..mesh.calculus import group_means, lumped_mass
from ..mesh.geodesics import stencils
from ..mesh.order import in_good_order
from ..mesh.triangle_mesh import Floats, TriangleMesh, check_mesh
from ..mesh.weld import split_at_jumps
from ..settings import BeltramiGeometrySettings, BeltramiMeshSettings, given_or_default
from .fit import moved_vertices, refitted
from .noise import noise_of_normals, repeats, smoothed_normals


@by_keyword
def beltrami_vertex_signal(
    mesh: TriangleMesh,
    signal: npt.ArrayLike,
    settings: BeltramiMeshSettings | None = None,
    *,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> npt.NDArray:
    """Denoise a signal given at the vertices of a mesh, such as vertex colors; edges stay.

    Parameters
    ----------
    mesh : TriangleMesh
    signal : (n,) or (n, d) array of float32 or float64
        Any number of channels, which are filtered together; `beta` is meant for values in
        [0, 1].
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
    Paper C, equations 20 to 22, of which only the components of the signal are filtered
    (equation 7). Lengths are in mean edge lengths; differs from the paper in weighing vertices by
    the area around them, which it leaves open.

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
        _, filtered = _smoothed(mesh, values, settings)
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

    Where corners at a vertex differ, the signal jumps, and nothing crosses; elsewhere they are
    one, and stay one.

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
    Paper C, as in `beltrami_vertex_signal`, on the surface that is cut open at the jumps.

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
        cut, cut_values, corners = _cut_at_jumps(mesh, values)
        _, filtered = _smoothed(cut, cut_values, settings)
        corner_weights = None if weights is None else weights[mesh.faces.reshape(-1)]
        with phase(1.0, 1.0, "Denoising"):
            mixed = like(own, values, filtered[corners], corner_weights)
        return from_own_corners(mesh, mixed, given)


@by_keyword
def beltrami_joint(
    mesh: TriangleMesh,
    signal: npt.ArrayLike,
    settings: BeltramiMeshSettings | None = None,
    *,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> tuple[Floats, npt.NDArray]:
    """Denoise a mesh and the signal painted on it together (paper C, equation 22).

    Both are averaged with the same weights: edges of the signal keep the shape there, too.

    Parameters
    ----------
    mesh, signal, settings, mask, progress
        As in `beltrami_vertex_signal`.

    Returns
    -------
    positions : (n, 3) float64
        In the unit of `mesh.vertices`.
    signal : array like `signal`
        A time of 0 returns both bit for bit.

    Raises
    ------
    InvalidSignal, Cancelled
        As in `beltrami_vertex_signal`.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> positions, colors = core.beltrami_joint(mesh, np.full((4, 3), 0.5))
    >>> positions.shape, colors.round(6).max().item()
    ((4, 3), 0.5)
    """
    check_mesh(mesh)
    given = checked_type(signal)
    values = checked_signal(given, mesh.vertex_count)
    weights = checked_mask(mask, mesh.vertex_count)
    settings = given_or_default(settings, BeltramiMeshSettings)
    if settings.time == 0:
        return mesh.vertices.copy(), given.copy()
    with reporting(progress):
        points, filtered = _smoothed(mesh, values, settings, moves=True)
        with phase(1.0, 1.0, "Denoising"):
            positions = moved_vertices(mesh, _moves_to(points, mesh, weights))
            return positions, like(given, values, filtered, weights)


def beltrami_joint_corners(
    mesh: TriangleMesh,
    signal: npt.ArrayLike,
    settings: BeltramiMeshSettings | None = None,
    *,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> tuple[Floats, npt.NDArray]:
    """Denoise a mesh and the signal at its corners together (paper C, equation 22).

    Where corners at a vertex differ, nothing crosses, as in `beltrami_corner_signal`; the vertex
    moves as the mean of its sides does, so that the mesh does not crack open.

    Parameters
    ----------
    mesh, signal, settings, mask, progress
        As in `beltrami_corner_signal`.

    Returns
    -------
    positions : (n, 3) float64
        In the unit of `mesh.vertices`.
    signal : array like `signal`

    Raises
    ------
    InvalidSignal, Cancelled
        As in `beltrami_corner_signal`.
    """
    check_mesh(mesh)
    given = checked_type(signal)
    values = checked_signal(to_own_corners(mesh, given), 3 * mesh.face_count)
    weights = checked_mask(mask, mesh.vertex_count)
    with reporting(progress):
        cut, cut_values, corners = _cut_at_jumps(mesh, values)
        vertex = np.empty(cut.vertex_count, dtype=np.intp)
        vertex[corners] = mesh.faces.reshape(-1)
        cut_weights = None if weights is None else weights[vertex]
        points, filtered = beltrami_joint(cut, cut_values, settings, mask=cut_weights)
        moved = np.zeros_like(mesh.vertices)
        with phase(1.0, 1.0, "Denoising"):
            group_means(vertex, points - cut.vertices, moved)
            positions = moved_vertices(mesh, moved)
        after = filtered[corners]
        after = np.where(after == values, values, after)  # the sign of 0 too
        return positions, from_own_corners(mesh, after.astype(given.dtype), given)


@by_keyword
def denoise_geometry(
    mesh: TriangleMesh,
    settings: BeltramiGeometrySettings | None = None,
    *,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> Floats:
    """Denoise a mesh; creases stay.

    Parameters
    ----------
    mesh : TriangleMesh
    settings : BeltramiGeometrySettings, optional
    mask : (n,) array of float in [0, 1], optional
        1 filters fully, less filters less, 0 leaves the vertex in place bit for bit.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    (n, 3) float64
        New positions in the unit of `mesh.vertices`. A time of 0 returns the old ones bit for
        bit.

    Raises
    ------
    InvalidSignal
        If the mask does not fit the mesh or leaves [0, 1].
    SolverError
        If the refit's linear system cannot be solved.
    Cancelled
        If `progress` returned False.

    Notes
    -----
    Paper C filters the positions, which rounds creases with the noise. Beyond the paper, the
    kernel is applied to the normals of the faces, a signal that is painted on the mesh and jumps
    at creases, and the positions are fitted to them (see `fit_to_normals`). Two neighbouring
    faces are as far apart as their centres at (X, beta N), and distances run from face to face.
    N is mollified before distances are measured, since the noise of single faces would hide the
    creases; what is averaged are the normals themselves. And `beta` is divided by the noise that
    the normals have, so that one setting serves for light noise and strong noise, and a clean
    mesh hardly changes.

    Noise of scans has bumps wider than a face, and may be hard to tell from relief. What smoothing
    leaves of it tells which it is, and whether the surface below is calm between creases or is
    relief itself. For such noise, the kernel is applied in steps so short that they reach the
    faces around only: on calm surfaces many, with distances between the mean normals of even
    patches, as guidance of normals by Zhang et al. (2015); on relief few, once.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> x, y = np.meshgrid(np.arange(12.0), np.arange(12.0))
    >>> rough = 0.1 * np.random.default_rng(0).normal(size=x.shape)
    >>> vertices = np.stack([x, y, rough], axis=-1).reshape(-1, 3)
    >>> first = (np.arange(11)[:, None] * 12 + np.arange(11)).reshape(-1)
    >>> faces = np.concatenate([first[:, None] + (0, 1, 13), first[:, None] + (0, 13, 12)])
    >>> smooth = core.denoise_geometry(core.TriangleMesh(vertices, faces))
    >>> bool(abs(smooth[:, 2]).mean() < 0.5 * abs(rough).mean())
    True
    """
    check_mesh(mesh)
    settings = given_or_default(settings, BeltramiGeometrySettings)
    weights = checked_mask(mask, mesh.vertex_count)
    if settings.time == 0:
        return mesh.vertices.copy()
    with reporting(progress):
        moved = in_good_order(mesh, partial(_displacement, settings), weights)
        with phase(1.0, 1.0, "Denoising"):
            return moved_vertices(mesh, moved)


beltrami_mesh = denoise_geometry
"""The name that goes with the paper's other kernels."""


def _cut_at_jumps(
    mesh: TriangleMesh, values: Floats
) -> tuple[TriangleMesh, Floats, npt.NDArray[np.int32]]:
    # The mesh cut open where the values of its corners jump, the values at its vertices, and
    # which of these each corner of the mesh has become.
    cut, cut_values = split_at_jumps(mesh, values)
    return cut, cut_values, cut.own_corners(cut.faces).reshape(-1)


def _smoothed(
    mesh: TriangleMesh, values: Floats, settings: BeltramiMeshSettings, *, moves: bool = False
) -> tuple[Floats, Floats]:
    # The vertices, in mean edge lengths, which are smoothed if the mesh moves, and the values.
    # Lengths and areas stay those of the given mesh: only so are the iterations alike. Means keep
    # to the range of the input but for rounding.
    with aside("Denoising"):
        mass = lumped_mass(mesh)
    points, beta = mesh.scaled_vertices, settings.beta
    low, high = values.min(axis=0), values.max(axis=0)
    for turn in range(settings.iterations):
        with phase(turn / settings.iterations, (turn + 1) / settings.iterations, "Denoising"):
            embedding = np.concatenate([points, beta * values], axis=1)
            with aside("Denoising"):
                graph = stencils(mesh, embedding)
            signal = np.concatenate([points, values], axis=1) if moves else values
            means = smooth_graph(graph, mass, signal, settings, mesh.has_hubs)
            if moves:
                points, means = np.split(means, [3], axis=1)
            values = np.clip(means, low, high)
    return points, values


def _displacement(
    settings: BeltramiGeometrySettings, mesh: TriangleMesh, weights: Floats | None
) -> Floats:
    if settings.filtered == "positions":
        points, _ = _smoothed(mesh, np.zeros((mesh.vertex_count, 0)), settings, moves=True)
        return _moves_to(points, mesh, weights)
    with aside("Denoising"):
        noise = noise_of_normals(mesh)

    def denoise(current: TriangleMesh) -> Floats:
        return smoothed_normals(current, settings, noise)

    return refitted(
        mesh, denoise, replace(settings, repeat=repeats(settings, noise)), weights, "Denoising"
    )


def _moves_to(points: Floats, mesh: TriangleMesh, weights: Floats | None) -> Floats:
    # From mean edge lengths to the mesh's unit, as far as the weights allow.
    moved = (points - mesh.scaled_vertices) * mesh.mean_edge_length
    return moved if weights is None else weights[:, None] * moved
