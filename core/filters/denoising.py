# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoise, then sharpen what is left, in one run.

Noise has to go before edges are pulled together: what remains of it is taken for edges.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy.typing as npt

from ..base.progress import ProgressCallback, phase, reporting
from ..errors import InvalidMesh
from ..mesh.triangle_mesh import Floats, TriangleMesh
from ..settings import GeometrySettings, ImageSettings, ShockSettings
from .beltrami.images import beltrami_image
from .beltrami.meshes import (
    beltrami_corner_signal,
    beltrami_joint_corners,
    beltrami_mesh,
    beltrami_vertex_signal,
)
from .geometry import sharpen_geometry
from .images import sharpen_image
from .signals import sharpen_corner_signal, sharpen_vertex_signal

Filter = Callable[..., Any]


def then_sharpen(denoise: Filter, time: float | None) -> Filter:
    """Have what a filter has denoised be sharpened in the same run.

    Parameters
    ----------
    denoise : callable
        `beltrami_mesh`, `beltrami_vertex_signal`, `beltrami_corner_signal`, `beltrami_image` or
        `beltrami_joint_corners`.
    time : float or None
        Flow time of the sharpening, as in `ShockSettings`; None leaves it out.

    Returns
    -------
    callable
        ``function(*data, settings=None, mask=None, progress=None)``. Data and result, settings and
        mask are those of `denoise`; the sharpening has the same mask. Each half of the progress
        is one of the two.

    Raises
    ------
    InvalidSettings
        At once, if the time is negative or no number.

    Notes
    -----
    All other settings of the sharpening are fixed here. Normals of geometry are read by linear
    sampling, which removes the noise that is left where detail sampling keeps it; opacity of an
    image is what the kernel's settings say.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> from shock_filter.core.filters.denoising import then_sharpen
    >>> step = np.repeat([[0.2, 0.3, 0.7, 0.8]], 3, axis=0)
    >>> function = then_sharpen(core.beltrami_image, 16.0)
    >>> function(step, settings=core.BeltramiSettings(time=0.5)).shape
    (3, 4)
    """
    if time is None:
        return denoise
    sharpen, fixed = _SHARPENINGS[denoise]
    timed = replace(fixed, time=time)

    def denoise_and_sharpen(
        *data: Any,
        settings: Any = None,
        mask: npt.ArrayLike | None = None,
        progress: ProgressCallback | None = None,
    ) -> Any:
        sharpening = replace(timed, alpha=settings.alpha) if hasattr(settings, "alpha") else timed
        with reporting(progress):
            with phase(0.0, 0.5, "Denoising"):
                result = denoise(*data, settings=settings, mask=mask)
            with phase(0.5, 1.0, "Sharpening"):
                return sharpen(*data, result, sharpening, mask)

    return denoise_and_sharpen


_LINEAR = GeometrySettings(sampling="linear")


def _sharpen_moved(
    mesh: TriangleMesh, positions: Floats, settings: GeometrySettings, mask: npt.ArrayLike | None
) -> Floats:
    moved = _moved(mesh, positions)
    return positions if moved is None else sharpen_geometry(moved, settings, mask)


def _sharpen_both(
    mesh: TriangleMesh,
    _: Any,
    result: tuple[Floats, npt.NDArray],
    settings: ShockSettings,
    mask: npt.ArrayLike | None,
) -> tuple[Floats, npt.NDArray]:
    # The colors flow on the surface that is sharp already.
    positions, signal = result
    moved = _moved(mesh, positions)
    if moved is None:
        return result
    with phase(0.0, 0.5, "Sharpening"):
        positions = sharpen_geometry(moved, replace(_LINEAR, time=settings.time), mask)
    with phase(0.5, 1.0, "Sharpening"):
        sharp = mesh.moved_to(positions)
        return positions, sharpen_corner_signal(sharp, signal, settings, mask)


_SHARPENINGS: dict[Filter, tuple[Filter, Any]] = {
    beltrami_mesh: (_sharpen_moved, _LINEAR),
    beltrami_vertex_signal: (
        lambda mesh, _, *rest: sharpen_vertex_signal(mesh, *rest),
        ShockSettings(),
    ),
    beltrami_corner_signal: (
        lambda mesh, _, *rest: sharpen_corner_signal(mesh, *rest),
        ShockSettings(),
    ),
    beltrami_image: (lambda _, *rest: sharpen_image(*rest), ImageSettings()),
    beltrami_joint_corners: (_sharpen_both, ShockSettings()),
}
"""Per filter: what sharpens, given its data and result, settings and mask; and these settings."""


def _moved(mesh: TriangleMesh, positions: Floats) -> TriangleMesh | None:
    # A long time draws all vertices to a point or a line, where nothing is left to sharpen.
    try:
        return mesh.moved_to(positions)
    except InvalidMesh:
        return None
