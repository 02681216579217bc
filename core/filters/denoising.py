# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoise by the short-time Beltrami kernel, then sharpen what is left, in one run.

Noise has to go before edges are pulled together: what remains of it is taken for edges.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import checked_mask, checked_signal, checked_type
from ..base.parallel import Progress
from ..base.progress import ProgressCallback
from ..mesh.calculus import group_means
from ..mesh.triangle_mesh import Floats, TriangleMesh, split_at_jumps
from ..settings import (
    BeltramiGeometrySettings,
    BeltramiMeshSettings,
    BeltramiSettings,
    GeometrySettings,
    ImageSettings,
    ShockSettings,
)
from .beltrami.images import beltrami_image
from .beltrami.meshes import (
    beltrami_corner_signal,
    beltrami_joint,
    beltrami_mesh,
    beltrami_vertex_signal,
)
from .fit import moved_vertices
from .geometry import sharpen_geometry
from .images import sharpen_image
from .signals import from_own_corners, sharpen_corner_signal, sharpen_vertex_signal, to_own_corners


def denoise_geometry(
    mesh: TriangleMesh,
    settings: BeltramiGeometrySettings,
    sharpen_time: float | None = None,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> Floats:
    """Denoise a mesh, then sharpen its creases.

    Parameters
    ----------
    mesh, settings, mask, progress
        As in `beltrami_mesh`.
    sharpen_time : float, optional
        Time of the sharpening; none follows if left out. Normals are read by linear sampling,
        which removes the noise that is left where detail sampling keeps it.

    Returns
    -------
    (n, 3) float64
    """
    first, second = _parts(progress, sharpen_time)
    positions = beltrami_mesh(mesh, settings, mask, first)
    if sharpen_time is None:
        return positions
    moved = _moved(mesh, positions)
    if _has_shrunk(moved, mesh):
        return positions
    return _sharpened(moved, sharpen_time, mask, second)


def denoise_vertex_signal(
    mesh: TriangleMesh,
    signal: npt.ArrayLike,
    settings: BeltramiMeshSettings,
    sharpen_time: float | None = None,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> npt.NDArray:
    """Denoise a signal given at the vertices, then sharpen it; see `beltrami_vertex_signal`."""
    first, second = _parts(progress, sharpen_time)
    result = beltrami_vertex_signal(mesh, signal, settings, mask, first)
    if sharpen_time is None:
        return result
    return sharpen_vertex_signal(mesh, result, ShockSettings(time=sharpen_time), mask, second)


def denoise_corner_signal(
    mesh: TriangleMesh,
    signal: npt.ArrayLike,
    settings: BeltramiMeshSettings,
    sharpen_time: float | None = None,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> npt.NDArray:
    """Denoise a signal given at the corners, then sharpen it; see `beltrami_corner_signal`."""
    first, second = _parts(progress, sharpen_time)
    result = beltrami_corner_signal(mesh, signal, settings, mask, first)
    if sharpen_time is None:
        return result
    return sharpen_corner_signal(mesh, result, ShockSettings(time=sharpen_time), mask, second)


def denoise_jointly(
    mesh: TriangleMesh,
    signal: npt.ArrayLike,
    settings: BeltramiMeshSettings,
    sharpen_time: float | None = None,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> tuple[Floats, npt.NDArray]:
    """Denoise a mesh and the signal at its corners with the same weights, then sharpen both.

    Where corners at a vertex differ, nothing crosses, as in `beltrami_corner_signal`; the vertex
    moves as the mean of its sides does, so that the mesh does not crack open.

    Parameters
    ----------
    mesh, signal, settings, mask, progress
        As in `beltrami_corner_signal`.
    sharpen_time : float, optional
        Time of the sharpening of both; none follows if left out.

    Returns
    -------
    positions : (n, 3) float64
    signal : array like `signal`
    """
    given = checked_type(signal)
    values = checked_signal(to_own_corners(mesh, given), 3 * mesh.face_count)
    weights = checked_mask(mask, mesh.vertex_count)
    first, second = _parts(progress, sharpen_time)
    cut, cut_values = split_at_jumps(mesh, values, Progress.of(first))
    corners = cut.own_corners(cut.faces).reshape(-1)
    vertex = np.empty(cut.vertex_count, dtype=np.intp)
    vertex[corners] = mesh.faces.reshape(-1)
    points, filtered = beltrami_joint(
        cut, cut_values, settings, None if weights is None else weights[vertex], first
    )
    moved = np.zeros_like(mesh.vertices)
    last = Progress.of(first).part(1.0, 1.0, "Denoising")
    group_means(vertex, points - cut.vertices, moved, last)
    positions = moved_vertices(mesh, moved)
    after = np.where(filtered[corners] == values, values, filtered[corners])  # the sign of 0 too
    result = from_own_corners(mesh, after.astype(given.dtype), given)
    moved_mesh = _moved(mesh, positions)
    if sharpen_time is None or _has_shrunk(moved_mesh, mesh):
        return positions, result
    geometry, painted = _parts(second, sharpen_time)
    positions = _sharpened(moved_mesh, sharpen_time, mask, geometry)
    sharpening = ShockSettings(time=sharpen_time)
    return positions, sharpen_corner_signal(
        _moved(mesh, positions), result, sharpening, mask, painted
    )


def denoise_image(
    image: npt.ArrayLike,
    settings: BeltramiSettings,
    sharpen_time: float | None = None,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> npt.NDArray:
    """Denoise an image, then sharpen it; see `beltrami_image`."""
    first, second = _parts(progress, sharpen_time)
    result = beltrami_image(image, settings, mask, first)
    if sharpen_time is None:
        return result
    sharpening = ImageSettings(time=sharpen_time, alpha=settings.alpha)
    return sharpen_image(result, sharpening, mask, second)


def _moved(mesh: TriangleMesh, positions: Floats) -> TriangleMesh:
    moved = mesh.displaced(positions - mesh.vertices)
    moved.vertices = positions  # the sum differs in the last bits, and in the sign of 0
    return moved


def _has_shrunk(moved: TriangleMesh, mesh: TriangleMesh) -> bool:
    # A long time draws all vertices to a point or a line, where nothing is left to sharpen.
    return moved.mean_edge_length < 1e-9 * mesh.mean_edge_length or not moved.areas.any()


def _sharpened(
    mesh: TriangleMesh,
    time: float,
    mask: npt.ArrayLike | None,
    progress: ProgressCallback | None,
) -> Floats:
    settings = GeometrySettings(time=time, sampling="linear")
    return sharpen_geometry(mesh, settings, mask, progress)


def _parts(
    progress: ProgressCallback | None, sharpen_time: float | None
) -> tuple[ProgressCallback | None, ProgressCallback | None]:
    # The callbacks of two runs, of which the second may be missing; a bad time is refused here.
    if sharpen_time is not None:
        ShockSettings(time=sharpen_time)
    if progress is None or sharpen_time is None:
        return progress, None
    return (
        lambda fraction, message: progress(0.5 * fraction, message),
        lambda fraction, message: progress(0.5 + 0.5 * fraction, message),
    )
