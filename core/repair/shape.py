# SPDX-License-Identifier: GPL-3.0-or-later
"""Repair of the shape of generated and photographed models."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.progress import phase
from ..mesh.triangle_mesh import TriangleMesh
from ..shape.denoising import denoise_geometry
from ..shape.sharpening import sharpen_geometry


def repair_shape(mesh: TriangleMesh, how: str) -> npt.NDArray[np.float64]:
    """Return new positions of the vertices: (n, 3).

    Parameters
    ----------
    mesh : TriangleMesh
    how : str
        As `ModelSettings.geometry`.
    """
    positions = mesh.vertices
    if how in ("denoise", "both"):
        with phase(0.0, 0.5 if how == "both" else 1.0, "Removing noise"):
            positions = denoise_geometry(mesh)
    if how in ("creases", "both"):
        with phase(0.5 if how == "both" else 0.0, 1.0, "Closing creases"):
            positions = sharpen_geometry(mesh.moved_to(positions) if how == "both" else mesh)
    return positions
