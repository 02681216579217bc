# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening of colors and other signals on meshes (paper A, sections 3 and 4).

Without a time, `by_width` computes the flow times, or with What at "auto" the learned recipe is
followed: see `vertices_learned`. Both go beyond the paper.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ..base.checks import by_keyword, checked_mask, checked_signal, checked_type
from ..base.findings import is_gathered
from ..base.progress import ProgressCallback, aside, ask, phase, reporting
from ..flow.advect import average_corners
from ..flow.borders import borders_of, measured, noise_of
from ..mesh.triangle_mesh import Floats, TriangleMesh, check_mesh
from ..settings import ShockSettings, given_or_default
from .by_width.dials import counted_width, plan_of, tell_widths
from .by_width.domain import flow_for_time
from .by_width.mesh_domain import MeshDomain
from .by_width.recipe import sharpen_by_width
from .signals import (
    cut_at_jumps,
    from_own_corners,
    like,
    to_own_corners,
)
from .vertex_planes import Vertices
from .vertices_learned import is_learned, sharpen_vertices_learned, tell_sharpened

_REST = 2.0
"""Width, in mean edge lengths, that a second pass closes in drawings. Borders stay about so wide
after the first: vertices take the mean of their corners, and a faint border near a third color gets
the short time of a strong one."""


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
        Any number of channels; times and contrasts assume values in [0, 1].
    settings : ShockSettings, optional
        By default, the width of the borders is measured and closed.
    mask : (n,) array of float in [0, 1], optional
        1 sharpens fully, less mixes with the input, 0 keeps it bit for bit.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    array like `signal`
        Within the input's range. It is the input bit for bit if the time or the amount is 0, or if
        all borders are sharp already.

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
        result = _sharpened(mesh, values, settings, at_corners=False)
        if _is_measured(settings):
            _tell(mesh, values, result, settings)
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

    Where the corners at a vertex differ, the signal is discontinuous, and nothing flows across the
    discontinuity; equal corners are one vertex. Each corner of the result has the value at the end
    of its own flow-line, so that edges can run between faces. With What at "auto", equal corners
    stay equal.

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
        As from `sharpen_vertex_signal`.

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
            cut, cut_values = cut_at_jumps(mesh, own)

        result = _sharpened(cut, cut_values, settings, at_corners=True)
        if _is_measured(settings):
            merged = result if result is None else average_corners(cut, result, cut_values)
            _tell(cut, cut_values, merged, settings)
        if result is None:
            return given.copy()
        weights = _times_amount(weights, settings.amount, mesh.vertex_count)
        corner_weights = None if weights is None else weights[mesh.faces.reshape(-1)]
        with phase(1.0, 1.0, "Sharpening"):
            rows = cut.own_corners(result.reshape(mesh.face_count, 3, -1))
            mixed = like(own, values, rows.reshape(result.shape), corner_weights)
            return from_own_corners(mesh, mixed, given)


def width_to_close(mesh: TriangleMesh, signal: npt.NDArray, what: str) -> float:
    """Return the width that is closed by default, in mean edge lengths; 0 if borders are sharp.

    Parameters
    ----------
    mesh : TriangleMesh
    signal : (n, d) or (m, 3, d) array of float
        At vertices or corners.
    what : {"drawing", "photo"}
    """
    if signal.ndim == 2:
        borders = borders_of(mesh, checked_signal(signal, mesh.vertex_count))
    else:
        borders = borders_of(*cut_at_jumps(mesh, to_own_corners(mesh, signal)))
    return counted_width(0.0, borders.width, what)


def _sharpened(
    mesh: TriangleMesh, values: Floats, settings: ShockSettings, *, at_corners: bool
) -> Floats | None:
    # Returns values at the vertices, (n, d), or at the corners of ``mesh.faces``, (3 m, d). None if
    # all borders are sharp already.
    brightness, nearest = settings.channels == "luminance", settings.sampling == "nearest"
    domain = MeshDomain(mesh, brightness, nearest, at_corners)
    passes = settings.smoothing_passes
    if is_learned(settings):
        with phase(0.0, 0.1, "Sharpening"):
            vertices = Vertices(mesh)

        def sharpen(values: Floats, result: Floats) -> None:
            result[...] = domain.as_result(sharpen_vertices_learned(vertices, values, settings))

    elif not settings.by_width:

        def sharpen(values: Floats, result: Floats) -> None:
            flow_for_time(domain, values, domain, values, passes, settings.time, result)

    else:
        borders = borders_of(mesh, values) if settings.width == 0 else None
        measured_width = borders.width if borders else 0.0
        width = counted_width(settings.width, measured_width, settings.what)
        if width == 0:
            return None
        noise = borders.noise if borders else noise_of(mesh, values)
        plan = plan_of(settings.what, width, noise, passes)

        def sharpen(values: Floats, result: Floats) -> None:
            if settings.what != "drawing":
                sharpen_by_width(domain, plan, values, result)
                return
            once = values.copy()
            with phase(0.0, 0.5, "Sharpening"):
                sharpen_by_width(replace(domain, at_corners=False), plan, values, once)
            with aside("Measuring borders"):
                rest = plan_of(settings.what, min(width, _REST), noise_of(mesh, once), passes)
            with phase(0.5, 1.0, "Sharpening"):
                sharpen_by_width(domain, rest, once, result)

    def finish(values: Floats) -> Floats:
        result = np.array(domain.as_result(values))
        ask()
        sharpen(values, result)
        return result

    with phase(0.2 if settings.by_width else 0.0, 1.0, "Sharpening"):
        return _by_channels(values, settings, finish)


def _is_measured(settings: ShockSettings) -> bool:
    return settings.by_width and settings.width == 0 and is_gathered()


def _tell(
    mesh: TriangleMesh, values: Floats, result: Floats | None, settings: ShockSettings
) -> None:
    if is_learned(settings):
        tell_sharpened(mesh, values, result)
        return
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
