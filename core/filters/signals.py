# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening of colors and other signals on meshes (Prada and Kazhdan 2015, sections 3 and 4)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from ..base.checks import checked_mask, checked_signal, checked_type
from ..base.memo import kept
from ..base.parallel import Progress, kernel, run
from ..base.progress import ProgressCallback
from ..errors import InvalidSignal
from ..flow.advect import average_corners, read_points
from ..flow.potential import flow_potential
from ..flow.trace import corner_offsets, trace
from ..grid.pixels import LUMINANCE
from ..mesh.triangle_mesh import Floats, TriangleMesh, split_at_jumps
from ..settings import ShockSettings


def sharpen_vertex_signal(
    mesh: TriangleMesh,
    signal: npt.ArrayLike,
    settings: ShockSettings | None = None,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> npt.NDArray:
    """Sharpen a signal given at the vertices of a mesh, such as vertex colors.

    Parameters
    ----------
    mesh : TriangleMesh
    signal : (n,) or (n, d) array of float32 or float64
        Any number of channels; times are meant for values in [0, 1].
    settings : ShockSettings, optional
    mask : (n,) array of float in [0, 1], optional
        1 sharpens fully, less mixes with the input, 0 keeps it bit for bit.
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
    Paper A, sections 3.2, 3.3 and Appendix A, "Vertex Advection".
    """
    given = checked_type(signal)
    values = checked_signal(given, mesh.vertex_count)
    weights = checked_mask(mask, mesh.vertex_count)
    settings = settings or ShockSettings()
    if settings.time == 0:
        return given.copy()

    def average(corner_values: Floats, old: Floats, phase: Progress = Progress(None)) -> Floats:
        return average_corners(mesh, corner_values, old, phase)

    phases = Progress.of(progress)
    result = _sharpened(mesh, values, settings, average, average, phases)
    return like(given, values, result, weights, phases.part(1.0, 1.0, "Sharpening"))


def sharpen_corner_signal(
    mesh: TriangleMesh,
    signal: npt.ArrayLike,
    settings: ShockSettings | None = None,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> npt.NDArray:
    """Sharpen a signal given at the corners of the faces of a mesh, such as corner colors.

    Where corners at a vertex differ, the signal jumps, and nothing flows across; elsewhere they
    are one. In the result each corner has the value that its own flow-line finds, so that edges
    can run between faces.

    Parameters
    ----------
    mesh : TriangleMesh
    signal : (m, 3) or (m, 3, d) array of float32 or float64
        Corners in the order of the faces that the mesh was made from.
    settings, progress
        As in `sharpen_vertex_signal`.
    mask : (n,) array of float in [0, 1], optional
        Weights of the vertices.

    Returns
    -------
    array like `signal`
        Within the input's range. A time of 0 returns the input bit for bit.

    Raises
    ------
    InvalidSignal, Cancelled
        As in `sharpen_vertex_signal`.
    """
    phases = Progress.of(progress).part(0.0, 1.0, "Sharpening")
    given = checked_type(signal)
    own = to_own_corners(mesh, given)
    phases.update(0.0)
    values = checked_signal(own, 3 * mesh.face_count, progress=phases)
    phases.update(0.0)
    weights = checked_mask(mask, mesh.vertex_count)
    settings = settings or ShockSettings()
    if settings.time == 0:
        return given.copy()
    cut, cut_values = kept(mesh, "cut", (own,), lambda: split_at_jumps(mesh, values, phases))
    phases.update(0.0)

    def average(corner_values: Floats, old: Floats, phase: Progress = Progress(None)) -> Floats:
        return average_corners(cut, corner_values, old, phase)

    def keep(corner_values: Floats, old: Floats, phase: Progress = Progress(None)) -> Floats:
        rows = corner_values.reshape(mesh.face_count, 3, -1)
        return cut.own_corners(rows).reshape(corner_values.shape)

    result = _sharpened(cut, cut_values, settings, average, keep, phases)
    corner_weights = None if weights is None else weights[mesh.faces.reshape(-1)]
    mixed = like(own, values, result, corner_weights, phases.part(1.0, 1.0, "Sharpening"))
    return from_own_corners(mesh, mixed, given)


Gather = Callable[[Floats, Floats, Progress], Floats]


def _sharpened(
    mesh: TriangleMesh,
    values: Floats,
    settings: ShockSettings,
    gather: Gather,
    finish: Gather,
    progress: Progress = Progress(None),
) -> Floats:
    # `gather` makes vertex values of what the corners' traces read, between steps; `finish`
    # makes the result.
    if settings.channels != "independent":
        return _flowed(mesh, values, settings, gather, finish, progress)
    count = values.shape[1]
    columns = [
        _flowed(mesh, np.ascontiguousarray(values[:, j : j + 1]), settings, gather, finish,
                progress.part(j / count, (j + 1) / count, "Sharpening"))
        for j in range(count)
    ]  # fmt: skip
    return np.concatenate(columns, axis=1)


def _flowed(
    mesh: TriangleMesh,
    values: Floats,
    settings: ShockSettings,
    gather: Gather,
    finish: Gather,
    progress: Progress = Progress(None),
) -> Floats:
    nearest = settings.sampling == "nearest"
    durations = step_durations(settings)
    source, current = values, values
    message = "Tracing flow-lines"
    points, coordinates = corner_offsets(mesh, progress.part(0.0, 0.0, message))
    for number, duration in enumerate(durations):
        start, stop = number / len(durations), (number + 1) / len(durations)
        still = progress.part(start, start, message)
        if number:
            read = read_points(mesh, source, points, coordinates, nearest, still)
            current = gather(read, current, still)
        if settings.scheme == "naive" and number:
            source = current
            points, coordinates = corner_offsets(mesh, still)
        guide = luminance(current) if settings.channels == "luminance" else current
        step = progress.part(start, stop, "Sharpening")
        potential = flow_potential(
            mesh, guide, settings.smoothing_passes, step.part(0.0, 0.5, "Computing the flow")
        )
        trace(mesh, potential, duration, points, coordinates,
              progress=step.part(0.5, 1.0, message))  # fmt: skip
    last = progress.part(1.0, 1.0, message)
    read = read_points(mesh, source, points, coordinates, nearest, last)
    return finish(read, current, last)


def step_durations(settings: ShockSettings) -> list[float]:
    """Cut the time into steps: one for a fixed flow, else of length 1 and a rest."""
    if settings.scheme == "fixed":
        return [settings.time]
    whole = math.floor(settings.time)
    rest = settings.time - whole
    return [1.0] * whole + ([rest] if rest > 0 else [])


def luminance(values: Floats) -> Floats:
    """The brightness of linear colors: (n, d) -> (n, 1); the mean where they are not RGB."""
    if values.shape[1] >= 3:
        return np.ascontiguousarray(values[:, :3] @ LUMINANCE[:, None])
    return values.mean(axis=1, keepdims=True)


def to_own_corners(mesh: TriangleMesh, given: npt.NDArray) -> npt.NDArray:
    """Rows of a corner signal, one a corner, in the order of ``mesh.faces``: (3 m, d)."""
    if given.ndim not in (2, 3) or given.shape[:2] != (mesh.face_count, 3):
        raise InvalidSignal(
            f"The signal has the shape {given.shape}; give ({mesh.face_count}, 3) or"
            f" ({mesh.face_count}, 3, channels)."
        )
    return mesh.own_corners(given.reshape(mesh.face_count, 3, -1)).reshape(3 * len(given), -1)


def from_own_corners(mesh: TriangleMesh, own: npt.NDArray, given: npt.NDArray) -> npt.NDArray:
    """Undo `to_own_corners`: (3 m, d) to the shape of the signal that was given."""
    return mesh.own_corners(own.reshape(mesh.face_count, 3, -1)).reshape(given.shape)


def like(
    given: npt.NDArray,
    values: Floats,
    result: Floats,
    weights: Floats | None,
    progress: Progress = Progress(None),
) -> npt.NDArray:
    """Mix a result with the values before by weights, in the type and shape that were given."""
    if weights is None:
        return result.astype(given.dtype).reshape(given.shape)
    mixed = np.empty(result.shape, dtype=given.dtype)
    run(mix_rows, len(result), values, result, weights, mixed, progress=progress)
    return mixed.reshape(given.shape)


@kernel
def mix_rows(start, stop, values, result, weights, mixed):
    """Mix rows of a result with the values before; where the weight is 0 these stay."""
    for i in range(start, stop):
        for j in range(values.shape[1]):
            value = values[i, j]
            if weights[i] != 0:
                value += weights[i] * (result[i, j] - value)
            mixed[i, j] = value
