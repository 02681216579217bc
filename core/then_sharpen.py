# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoise and then sharpen, in one run.

Noise must be removed first, because the sharpening would take it for edges.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy.typing as npt

from .base.progress import ProgressCallback, phase, reporting
from .color.signal_sharpening import sharpen_corner_signal
from .errors import InvalidMesh
from .mesh.triangle_mesh import Floats, TriangleMesh
from .settings import GeometrySettings, ShockSettings, describe
from .shape.sharpening import sharpen_geometry

Filter = Callable[..., Any]


def then_sharpen(denoise: Filter, sharpen: Filter, sharpening: Any) -> Filter:
    """Make a filter that denoises and then sharpens.

    Parameters
    ----------
    denoise, sharpen : callable
        Filters of the same kind of data, see `registry.Kind`; or `beltrami_joint_corners` and
        `sharpen_both`.
    sharpening : object or None
        The settings of `sharpen`; None if nothing is sharpened.

    Returns
    -------
    callable
        ``function(*data, settings=None, mask=None, progress=None)``. Data, settings, mask and
        result are those of `denoise`; `sharpen` gets the same mask. Each of the two takes half of
        the progress.

    Notes
    -----
    `sharpen` takes over the settings of `denoise` that describe the data, such as the opacity of an
    image and the content of a texture.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> from shock_filter.core.then_sharpen import then_sharpen
    >>> step = np.repeat([[0.2, 0.3, 0.7, 0.8]], 3, axis=0)
    >>> sharpening = core.ImageSettings(time=16.0)
    >>> function = then_sharpen(core.beltrami_image, core.sharpen_image, sharpening)
    >>> function(step, settings=core.BeltramiSettings(time=0.5)).shape
    (3, 4)
    """
    if sharpening is None:
        return denoise

    def denoise_and_sharpen(
        *data: Any,
        settings: Any = None,
        mask: npt.ArrayLike | None = None,
        progress: ProgressCallback | None = None,
        **more: Any,
    ) -> Any:
        chosen = _on_same_data(sharpening, settings)
        with reporting(progress):
            with phase(0.0, 0.5, "Denoising"):
                result = denoise(*data, settings=settings, mask=mask, **more)
            with phase(0.5, 1.0, "Sharpening"):
                # The result replaces the last of the data, which was denoised.
                last = data[-1]
                denoised = _moved(last, result) if isinstance(last, TriangleMesh) else result
                if denoised is None:
                    return result
                return sharpen(*data[:-1], denoised, settings=chosen, mask=mask, **more)

    return denoise_and_sharpen


def _on_same_data(sharpening: Any, settings: Any) -> Any:
    # The first filter's settings describe the data.
    if settings is None:
        return sharpening
    given = {
        name: getattr(settings, name)
        for name, (_, _, about) in describe(type(settings)).items()
        if about.of_data and name in describe(type(sharpening))
    }
    return replace(sharpening, **given)


def sharpen_both(
    mesh: TriangleMesh,
    both: tuple[Floats, npt.NDArray],
    settings: ShockSettings,
    mask: npt.ArrayLike | None = None,
) -> tuple[Floats, npt.NDArray]:
    """Sharpen a mesh at new positions, and then the colors of its corners on the result."""
    positions, signal = both
    moved = _moved(mesh, positions)
    if moved is None:
        return both
    with phase(0.0, 0.5, "Sharpening"):
        shape = GeometrySettings.of_paper(time=settings.time, sampling="linear")
        positions = sharpen_geometry(moved, shape, mask=mask)
    with phase(0.5, 1.0, "Sharpening"):
        sharp = mesh.moved_to(positions)
        return positions, sharpen_corner_signal(sharp, signal, settings, mask=mask)


def _moved(mesh: TriangleMesh, positions: Floats) -> TriangleMesh | None:
    # A long time contracts the mesh to a point or a line, where nothing is left to sharpen.
    try:
        return mesh.moved_to(positions)
    except InvalidMesh:
        return None
