# SPDX-License-Identifier: GPL-3.0-or-later
"""Textured surfaces as a host program such as Blender keeps them, as arrays. Needs numpy only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from .picture import Picture


@dataclass(frozen=True)
class TexturedFaces:
    """The faces that show an image.

    Attributes
    ----------
    positions : (n, 3) float64
        Vertices in the world.
    triangles : (m, 3) int
    uv : (m, 3, 2) float64
        Texture coordinates of the triangles' corners.
    weights : (m, 3) float64 or None
        1 sharpens fully, 0 leaves the texture as it is at that corner.
    """

    positions: npt.NDArray[np.float64]
    triangles: npt.NDArray[np.int64]
    uv: npt.NDArray[np.float64]
    weights: npt.NDArray[np.float64] | None


@dataclass(frozen=True)
class TexturedSurface:
    """The faces that show an image, of all objects, and the image.

    Attributes
    ----------
    faces : TexturedFaces
    picture : Picture
    mask : (h, w) float64 or None
        1 sharpens a texel fully, 0 leaves it as it is; the faces' weights count, too.
    """

    faces: TexturedFaces
    picture: Picture
    mask: npt.NDArray[np.float64] | None

    @property
    def size(self) -> int:
        """How much work it is, beside others."""
        return self.picture.size
