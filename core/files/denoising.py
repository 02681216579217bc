# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoise meshes and images on disk, outside Blender."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..filters.denoising import denoise_geometry, denoise_image, denoise_vertex_signal
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import BeltramiGeometrySettings, BeltramiMeshSettings, BeltramiSettings
from .document import Floats
from .images import Pixels, filter_image_file, read_mask
from .meshes import filter_colors_file, filter_mesh_file
from .output import Outcome

Progress = Callable[[float, str], bool]


def denoise_file(
    source: str | Path,
    target: str | Path,
    settings: BeltramiGeometrySettings | None = None,
    *,
    sharpen_time: float | None = None,
    mask: str | None = None,
    invert_mask: bool = False,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Outcome:
    """Denoise the geometry of a mesh file and write it to another.

    Parameters
    ----------
    source, target, mask, invert_mask, overwrite, progress
        As in `sharpen_file`.
    settings : BeltramiGeometrySettings, optional
        Strength and all else; the defaults if left out.
    sharpen_time : float, optional
        Sharpen the result for this long; not at all if left out.

    Returns
    -------
    Outcome
        Counts, and notes on what did not survive.
    """
    chosen = settings or BeltramiGeometrySettings()

    def denoise(mesh: TriangleMesh, weights: Floats | None, part: Progress | None) -> Floats:
        return denoise_geometry(mesh, chosen, sharpen_time, weights, part)

    return filter_mesh_file(source, target, denoise, mask, invert_mask, overwrite, progress)


def denoise_colors_file(
    source: str | Path,
    target: str | Path,
    settings: BeltramiMeshSettings | None = None,
    *,
    sharpen_time: float | None = None,
    mask: str | None = None,
    invert_mask: bool = False,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Outcome:
    """Denoise the vertex colors of a mesh file and write it to another of the same format.

    Parameters
    ----------
    source, target, mask, invert_mask, overwrite, progress
        As in `sharpen_colors_file`.
    settings : BeltramiMeshSettings, optional
        Strength and all else; the defaults if left out.
    sharpen_time : float, optional
        As in `denoise_file`.

    Returns
    -------
    Outcome
        Counts, and notes on what did not survive.
    """
    chosen = settings or BeltramiMeshSettings()

    def denoise(
        mesh: TriangleMesh, colors: Floats, weights: Floats | None, part: Progress | None
    ) -> Floats:
        return denoise_vertex_signal(mesh, colors, chosen, sharpen_time, weights, part)

    return filter_colors_file(source, target, denoise, mask, invert_mask, overwrite, progress)


def denoise_image_file(
    source: str | Path,
    target: str | Path,
    settings: BeltramiSettings | None = None,
    *,
    sharpen_time: float | None = None,
    mask: str | Path | None = None,
    invert_mask: bool = False,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Outcome:
    """Denoise an image file and write it to another.

    Parameters
    ----------
    source, target, mask, invert_mask, overwrite, progress
        As in `sharpen_image_file`.
    settings : BeltramiSettings, optional
        Strength and all else; the defaults if left out.
    sharpen_time : float, optional
        As in `denoise_file`.

    Returns
    -------
    Outcome
        Counts of pixels, and notes on what did not survive.
    """
    chosen = settings or BeltramiSettings()
    weights = read_mask(mask, invert_mask) if mask else None

    def denoise(pixels: Pixels, result: Pixels) -> None:
        values = pixels.astype(np.float32) if pixels.dtype == np.float16 else pixels
        result[...] = denoise_image(values, chosen, sharpen_time, weights, progress)

    return filter_image_file(source, target, denoise, overwrite)
