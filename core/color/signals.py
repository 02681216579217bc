# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening of colors and other signals on meshes (paper A, sections 3 and 4).

Where Width says how far values flow, `dials` says for how long; that is not in the paper.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt

from ..base.checks import by_keyword, checked_mask, checked_signal, checked_type
from ..base.findings import is_gathered
from ..base.memo import kept
from ..base.parallel import kernel, run
from ..base.progress import ProgressCallback, aside, ask, phase, reporting
from ..errors import InvalidSignal
from ..flow.advect import average_corners, read_points
from ..flow.borders import borders_of, diffused, local_contrast, measured, nearby_range, noise_of
from ..flow.potential import flow_potential
from ..flow.trace import corner_offsets, trace
from ..grid.channels import brightness_weights
from ..mesh.triangle_mesh import Floats, TriangleMesh, check_mesh
from ..mesh.weld import split_at_jumps
from ..settings import ShockSettings, given_or_default
from .dials import (
    Plan,
    blended,
    counted_width,
    flow_times,
    limited_unsharp,
    plan_of,
    tell_widths,
)


@by_keyword
def sharpen_vertex_signal(
    mesh: TriangleMesh,
    signal: npt.ArrayLike,
    settings: ShockSettings | None = None,
    *,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> npt.NDArray:
    """Sharpen a signal given at the vertices of a mesh, such as vertex colors.

    Parameters
    ----------
    mesh : TriangleMesh
    signal : (n,) or (n, d) array of float32 or float64
        Any number of channels; times and contrasts are meant for values in [0, 1].
    settings : ShockSettings, optional
        By default the width of the borders is measured, and they are closed.
    mask : (n,) array of float in [0, 1], optional
        1 sharpens fully, less mixes with the input, 0 keeps it bit for bit.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    array like `signal`
        Within the input's range. A time or an amount of 0, and borders that are sharp already,
        return the input bit for bit.

    Raises
    ------
    InvalidSignal
        If signal or mask do not fit the mesh, or hold NaN or infinity.
    Cancelled
        If `progress` returned False.

    Notes
    -----
    Paper A, sections 3.2, 3.3 and Appendix A, "Vertex Advection".

    Examples
    --------
    A soft step becomes a steep one.

    >>> import numpy as np
    >>> from shock_filter import core
    >>> x, y = np.mgrid[:9, :9]
    >>> vertices = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    >>> first = (9 * x + y)[:-1, :-1].reshape(-1, 1)
    >>> faces = np.concatenate([first + [0, 9, 10], first + [0, 10, 1]])
    >>> mesh = core.TriangleMesh(vertices, faces)
    >>> colors = 1 / (1 + np.exp(4.0 - vertices[:, :1]))
    >>> sharp = core.sharpen_vertex_signal(mesh, colors, core.ShockSettings(width=4.0))
    >>> steepest = [np.ptp(c[mesh.faces], axis=1).max() for c in (colors, sharp)]
    >>> bool(steepest[1] > 2.0 * steepest[0])
    True

    With a time, this is the filter of the paper.

    >>> sharp = core.sharpen_vertex_signal(mesh, colors, core.ShockSettings(time=300.0))
    >>> bool(np.ptp(sharp[mesh.faces], axis=1).max() > 1.5 * steepest[0])
    True
    """
    with reporting(progress):
        check_mesh(mesh)
        given = checked_type(signal)
        values = checked_signal(given, mesh.vertex_count)
        weights = checked_mask(mask, mesh.vertex_count)
        settings = given_or_default(settings, ShockSettings)
        if settings.is_neutral:
            return given.copy()
        result = _sharpened(mesh, values, settings, partial(average_corners, mesh))
        if _is_measured(settings):
            _tell_widths(mesh, values, result)
        if result is None:
            return given.copy()
        weights = _times_amount(weights, settings.amount, len(values))
        with phase(1.0, 1.0, "Sharpening"):
            return like(given, values, result, weights)


@by_keyword
def sharpen_corner_signal(
    mesh: TriangleMesh,
    signal: npt.ArrayLike,
    settings: ShockSettings | None = None,
    *,
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
        Within the input's range; unchanged where `sharpen_vertex_signal` changes nothing.

    Raises
    ------
    InvalidSignal, Cancelled
        As in `sharpen_vertex_signal`.

    Examples
    --------
    As in `sharpen_vertex_signal`, with a value for each corner.

    >>> import numpy as np
    >>> from shock_filter import core
    >>> x, y = np.mgrid[:9, :9]
    >>> vertices = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    >>> first = (9 * x + y)[:-1, :-1].reshape(-1, 1)
    >>> faces = np.concatenate([first + [0, 9, 10], first + [0, 10, 1]])
    >>> mesh = core.TriangleMesh(vertices, faces)
    >>> colors = 1 / (1 + np.exp(4.0 - vertices[:, :1]))
    >>> sharp = core.sharpen_corner_signal(mesh, colors[faces], core.ShockSettings(time=300.0))
    >>> sharp.shape, bool(np.ptp(sharp, axis=1).max() > np.ptp(colors[faces], axis=1).max())
    ((128, 3, 1), True)
    """
    with reporting(progress):
        with aside("Sharpening"):
            check_mesh(mesh)
            given = checked_type(signal)
            own = to_own_corners(mesh, given)
            ask()
            values = checked_signal(own, 3 * mesh.face_count)
            ask()
            weights = checked_mask(mask, mesh.vertex_count)
            settings = given_or_default(settings, ShockSettings)
            if settings.is_neutral:
                return given.copy()
            cut, cut_values = _cut_at_jumps(mesh, own)

        def turn(corner_values: Floats) -> Floats:
            rows = corner_values.reshape(mesh.face_count, 3, -1)
            return cut.own_corners(rows).reshape(corner_values.shape)

        def keep(corner_values: Floats, old: Floats) -> Floats:
            return turn(corner_values)

        result = _sharpened(cut, cut_values, settings, keep)
        if _is_measured(settings):
            merged = result if result is None else average_corners(cut, turn(result), cut_values)
            _tell_widths(cut, cut_values, merged)
        if result is None:
            return given.copy()
        weights = _times_amount(weights, settings.amount, mesh.vertex_count)
        corner_weights = None if weights is None else weights[mesh.faces.reshape(-1)]
        with phase(1.0, 1.0, "Sharpening"):
            mixed = like(own, values, result, corner_weights)
            return from_own_corners(mesh, mixed, given)


def width_to_close(mesh: TriangleMesh, signal: npt.NDArray, what: str) -> float:
    """Return the width that counts where none is given; 0 if nothing is to be done.

    Parameters
    ----------
    mesh : TriangleMesh
    signal : (n, d) or (m, 3, d) array of float
        At vertices or corners.
    what : str
        As in `ShockSettings`.
    """
    if signal.ndim == 2:
        borders = borders_of(mesh, checked_signal(signal, mesh.vertex_count))
    else:
        borders = borders_of(*_cut_at_jumps(mesh, to_own_corners(mesh, signal)))
    return counted_width(0.0, borders.width, what)


def _cut_at_jumps(mesh: TriangleMesh, own: npt.NDArray) -> tuple[TriangleMesh, Floats]:
    def split() -> tuple[TriangleMesh, Floats]:
        return split_at_jumps(mesh, checked_signal(own, 3 * mesh.face_count))

    return kept(mesh, "cut", (own,), split)


Gather = Callable[[Floats, Floats], Floats]


def _sharpened(
    mesh: TriangleMesh, values: Floats, settings: ShockSettings, finish: Gather
) -> Floats | None:
    # `finish` makes the result of what the corners' traces read. None: it is sharp already.
    if not settings.by_width:
        flow = partial(_flow_together, mesh, settings, finish)
        return _by_channels(values, settings, flow)
    borders = borders_of(mesh, values) if settings.width == 0 else None
    measured_width = borders.width if borders else 0.0
    width = counted_width(settings.width, measured_width, settings.what)
    if width == 0:
        return None
    noise = borders.noise if borders else noise_of(mesh, values)
    plan = plan_of(settings.what, width, noise, settings.smoothing_passes)
    with phase(0.2, 1.0, "Sharpening"):
        return _by_channels(values, settings, partial(_by_plan, mesh, plan, settings, finish))


def _is_measured(settings: ShockSettings) -> bool:
    return settings.by_width and settings.width == 0 and is_gathered()


def _tell_widths(mesh: TriangleMesh, values: Floats, result: Floats | None) -> None:
    with aside("Measuring borders"):
        found = borders_of(mesh, values)
        closed = None if result is None else measured(mesh, result).width
    tell_widths("edge lengths", found.width, found.seen, closed)


def _times_amount(weights: Floats | None, amount: float, count: int) -> Floats | None:
    if amount == 1.0:
        return weights
    return np.full(count, amount) if weights is None else amount * weights


def _by_channels(
    values: Floats, settings: ShockSettings, function: Callable[[Floats], Floats]
) -> Floats:
    if settings.channels != "independent":
        return function(values)
    columns = []
    count = values.shape[1]
    for j in range(count):
        with phase(j / count, (j + 1) / count, "Sharpening"):
            columns.append(function(np.ascontiguousarray(values[:, j : j + 1])))
    return np.concatenate(columns, axis=1)


def _by_plan(
    mesh: TriangleMesh, plan: Plan, settings: ShockSettings, finish: Gather, values: Floats
) -> Floats:
    with phase(0.0, 0.2, "Sharpening"):
        smooth = diffused(mesh, values, plan.blur)
        low, high = nearby_range(mesh, values, plan.limit)
        unsharp = limited_unsharp(plan, values, smooth, low, high)
    source = unsharp if plan.unsharp_first else values
    corners = mesh.faces.reshape(-1)
    if plan.square > 0:
        guide = luminance(source) if settings.channels == "luminance" else source
        with phase(0.2, 0.4, "Measuring borders"):
            contrasts = local_contrast(mesh, guide, plan.presmooth, plan.reach)
        with phase(0.4, 0.5, "Computing the flow"):
            potential = flow_potential(mesh, guide, plan.passes)
        with phase(0.5, 1.0, "Tracing flow-lines"):
            points, coordinates = corner_offsets(mesh)
            times = flow_times(plan, contrasts)[corners]
            trace(mesh, potential, times, points, coordinates)
        read = read_points(mesh, source, points, coordinates, settings.sampling == "nearest")
    else:
        read = source[corners]
    with phase(1.0, 1.0, "Sharpening"):
        flowed = finish(read, source)
        if plan.unsharp_first:
            return flowed
        return blended(plan, finish(unsharp[corners], unsharp), flowed)


def _flow_together(
    mesh: TriangleMesh, settings: ShockSettings, finish: Gather, values: Floats
) -> Floats:
    nearest = settings.sampling == "nearest"
    guide = luminance(values) if settings.channels == "luminance" else values
    with phase(0.0, 0.5, "Computing the flow"):
        potential = flow_potential(mesh, guide, settings.smoothing_passes)
    with phase(0.5, 1.0, "Tracing flow-lines"):
        points, coordinates = corner_offsets(mesh)
        trace(mesh, potential, settings.time, points, coordinates)
    with phase(1.0, 1.0, "Tracing flow-lines"):
        return finish(read_points(mesh, values, points, coordinates, nearest), values)


def luminance(values: Floats) -> Floats:
    """The brightness of linear colors: (n, d) -> (n, 1); the mean where they are not RGB."""
    weights = brightness_weights(values.shape[1])
    return np.ascontiguousarray(values[:, : len(weights)] @ weights[:, None])


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


def like(given: npt.NDArray, values: Floats, result: Floats, weights: Floats | None) -> npt.NDArray:
    """Mix a result with the values before by weights, in the type and shape that were given."""
    if weights is None:
        return result.astype(given.dtype).reshape(given.shape)
    mixed = np.empty(result.shape, dtype=given.dtype)
    run(mix_rows, len(result), values, result, weights, mixed)
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
