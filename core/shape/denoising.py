# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoise a mesh, alone or together with a signal.

Signals alone are filtered in `core.color.signal_denoising`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from ..base.checks import by_keyword, checked_mask, checked_signal, checked_type
from ..base.findings import tell
from ..base.progress import ProgressCallback, aside, phase, reporting
from ..beltrami.mesh_smoothing import smooth_painted
from ..color.signals import corner_rows, cut_at_jumps, from_own_corners, like, to_own_corners
from ..mesh.calculus import group_means
from ..mesh.order import in_good_order
from ..mesh.triangle_mesh import Floats, TriangleMesh, check_mesh
from ..settings import BeltramiGeometrySettings, BeltramiMeshSettings, given_or_default
from .fit import moved_vertices, refitted
from .learned import learned_displacement
from .noise import noise_of_normals, smoothed_normals


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

    Both are averaged with the same weights, so that edges of the signal also preserve the shape.

    Parameters
    ----------
    mesh : TriangleMesh
    signal : (n,) or (n, d) array of float32 or float64
        At the vertices; `beta` assumes values in [0, 1].
    settings : BeltramiMeshSettings, optional
    mask : (n,) array of float in [0, 1], optional
        1 filters fully, less mixes with the input, 0 keeps it bit for bit.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    positions : (n, 3) float64
        In the unit of `mesh.vertices`.
    signal : array like `signal`
        A time of 0 returns both bit for bit.

    Raises
    ------
    InvalidSignal
        If signal or mask do not fit the mesh, or hold NaN or infinity.
    Cancelled
        If `progress` returned False.

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
        points, filtered = smooth_painted(mesh, values, settings, moves=True)
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

    Where the corners at a vertex differ, nothing is averaged across the seam, as in
    `beltrami_corner_signal`. The vertex moves by the mean of both sides, so that the mesh does not
    crack open.

    Parameters
    ----------
    mesh, settings, progress
        As in `beltrami_joint`.
    signal : (m, 3) or (m, 3, d) array of float32 or float64
        One value for each corner, in the order of the faces that the mesh was made from.
    mask : (n,) array of float in [0, 1], optional
        Weights of the vertices.

    Returns
    -------
    positions : (n, 3) float64
        In the unit of `mesh.vertices`.
    signal : array like `signal`

    Raises
    ------
    InvalidSignal, Cancelled
        As in `beltrami_joint`.
    """
    check_mesh(mesh)
    given = checked_type(signal)
    own = to_own_corners(mesh, given)
    values = checked_signal(own, 3 * mesh.face_count)
    weights = checked_mask(mask, mesh.vertex_count)
    with reporting(progress):
        cut, cut_values = cut_at_jumps(mesh, own)
        corners = corner_rows(cut)
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
    """Denoise a mesh, and keep its creases.

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
        New positions in the unit of `mesh.vertices`. A strength of 0 returns the old ones bit for
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
    With `method` "automatic", which is not in the papers, the face normals are smoothed in many
    ways: by plain means, by means of similar normals, by means guided by uniform patches (Zhang et
    al. 2015), and by umbrella smoothing of the vertices. In each of three stages a small network,
    trained on synthetic solids with known normals, mixes these candidates face by face, and the
    positions are fitted to the mixture (see `fit_to_normals`). To tell noise from relief, the
    network sees how far the candidates are apart around the face, and how high the bumps are that
    they remove. Faces stay bit for bit where no face around them turns, and where noise is
    impossible: where most faces share a plane with a neighbour and edges have many lengths, as in
    exports of design programs, or in components of up to 32 faces. Where the fit would leave
    normals farther from the mixture than the input's, as it may with long thin faces, the
    displacement is undone, in part or fully. At the end creases are sharpened (see
    `sharpen_geometry`) as far as the noisy normals agree.

    With "beltrami", the kernel of paper C is applied. Filtering the positions, as the paper does,
    rounds creases together with the noise. So the kernel is applied to the face normals, a signal
    that is discontinuous at creases, and the positions are fitted to the result. Distances are
    measured from face to face, between the points (X, beta N) of a centre X and a normal N. For
    these distances N is mollified, because the noise of single faces would hide the creases; the
    averaged normals are not. `beta` is divided by the noise of the normals, so that one setting
    serves for light and strong noise, and a clean mesh hardly changes.

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
    if settings.is_neutral:
        return mesh.vertices.copy()
    with reporting(progress):
        moved = in_good_order(mesh, partial(_displacement, settings), weights)
        if settings.method == "beltrami" and settings.strength != 1:
            moved = settings.strength * moved
        with phase(1.0, 1.0, "Denoising"):
            return moved_vertices(mesh, moved)


@by_keyword
def beltrami_mesh(
    mesh: TriangleMesh,
    settings: BeltramiGeometrySettings | None = None,
    *,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> Floats:
    """Denoise a mesh by the Beltrami kernel, whatever `method` in the settings says.

    With `filtered` "positions" as in paper C, equations 20 to 22; with "normals" the same kernel is
    applied to the face normals, see `denoise_geometry`.

    Parameters
    ----------
    mesh, settings, mask, progress
        As in `denoise_geometry`.

    Returns
    -------
    (n, 3) float64
        New positions in the unit of `mesh.vertices`. A time of 0 returns the old ones bit for bit.

    Raises
    ------
    InvalidSignal, SolverError, Cancelled
        As in `denoise_geometry`.

    Examples
    --------
    >>> from shock_filter import core
    >>> mesh = core.TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> still = core.beltrami_mesh(mesh, core.BeltramiGeometrySettings(time=0.0))
    >>> bool((still == mesh.vertices).all())
    True
    """
    settings = replace(given_or_default(settings, BeltramiGeometrySettings), method="beltrami")
    return denoise_geometry(mesh, settings, mask=mask, progress=progress)


def _displacement(
    settings: BeltramiGeometrySettings, mesh: TriangleMesh, weights: Floats | None
) -> Floats:
    if settings.method == "automatic":
        dials = {
            name: getattr(settings, name) for name in ("strength", "bump_size", "keep_creases")
        }
        if settings != BeltramiGeometrySettings(**dials):
            tell("With Method: Automatic only Strength, Bump Size and Keep Creases count; for other"
                 " settings choose Beltrami.")  # fmt: skip
        return learned_displacement(
            mesh,
            weights,
            settings.strength,
            bump_size=settings.bump_size,
            keep_creases=settings.keep_creases,
        )
    if settings.filtered == "positions":
        points, _ = smooth_painted(mesh, np.zeros((mesh.vertex_count, 0)), settings, moves=True)
        return _moves_to(points, mesh, weights)
    with aside("Denoising"):
        noise = noise_of_normals(mesh)

    def denoise(current: TriangleMesh) -> Floats:
        return smoothed_normals(current, settings, noise)

    return refitted(mesh, denoise, settings, weights, "Denoising")


def _moves_to(points: Floats, mesh: TriangleMesh, weights: Floats | None) -> Floats:
    # The displacement to points in mean edge lengths, in the unit of the mesh, times the weights.
    moved = (points - mesh.scaled_vertices) * mesh.mean_edge_length
    return moved if weights is None else weights[:, None] * moved
