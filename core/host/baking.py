# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake several maps, with the arrays of a host program such as Blender."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..base.progress import ProgressCallback, phase, reporting
from ..maps.baking import bake_maps
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import BakeSettings
from .inputs import TexturedFaces
from .textures import analyse


@dataclass(frozen=True)
class WorldMesh:
    """A mesh in the world.

    Attributes
    ----------
    positions : (n, 3) float64
    triangles : (m, 3) int
    colors : (n, c) float64 or None
        Of the vertices.
    """

    positions: npt.NDArray[np.float64]
    triangles: npt.NDArray[np.int64]
    colors: npt.NDArray[np.float64] | None = None

    @property
    def mesh(self) -> TriangleMesh:
        """The mesh for the core."""
        return TriangleMesh(self.positions, self.triangles)


@dataclass(frozen=True)
class BakeSurface:
    """The faces that will show maps, and what these are of.

    Attributes
    ----------
    faces : TexturedFaces
    shape : (int, int)
        Height and width of the images.
    maps : tuple of str
    high : WorldMesh or None
        The detailed mesh.
    occluders : sequence of WorldMesh
    """

    faces: TexturedFaces
    shape: tuple[int, int]
    maps: tuple[str, ...]
    high: WorldMesh | None = None
    occluders: Sequence[WorldMesh] = ()

    @property
    def size(self) -> int:
        """How much work it is, beside others."""
        return self.shape[0] * self.shape[1]


@dataclass(frozen=True)
class Baked:
    """Images (h, w, c) by the names of maps, from the bottom up, and remarks on the UV map."""

    images: dict[str, npt.NDArray[np.float32]]
    notes: tuple[str, ...]


def bake(
    surface: BakeSurface, settings: BakeSettings, progress: ProgressCallback | None = None
) -> Baked:
    """Bake maps; see `bake_maps`.

    Parameters
    ----------
    surface : BakeSurface
    settings : BakeSettings
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.
    """
    faces, high = surface.faces, surface.high
    with reporting(progress):
        with phase(0.0, 0.15, "Preparing the mesh"):
            atlas = analyse(faces, surface.shape)
        with phase(0.15, 1.0, "Baking maps"):
            found = bake_maps(
                atlas.mesh,
                faces.uv,
                settings,
                size=surface.shape,
                maps=surface.maps,
                high=None if high is None else high.mesh,
                colors=None if high is None else high.colors,
                normals=faces.normals,
                occluders=[each.mesh for each in surface.occluders],
                atlas=atlas,
            )
    images = {name: each if each.ndim == 3 else each[..., None] for name, each in found.items()}
    return Baked(images, tuple(atlas.report.sentences()))
