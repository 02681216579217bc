# SPDX-License-Identifier: GPL-3.0-or-later
"""Make an image on the surface that will show it, as a host program such as Blender keeps both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base.progress import ProgressCallback, phase, reporting
from ..filters.texels import grays_of
from ..mesh.directions import gradient_directions, named_directions
from ..registry import find
from .inputs import TexturedFaces
from .textures import analyse

_ANALYSIS = 0.3  # of the time that a run takes


@dataclass(frozen=True)
class FieldSurface:
    """The faces that will show an image.

    Attributes
    ----------
    faces : TexturedFaces
    shape : (int, int)
        Height and width of the image.
    given : mapping
        What the function in the registry takes by name beside its settings; instead of
        directions also the name of some (`along`), or numbers at the corners that rise in their
        way (`rising`).
    at_vertices : bool
        Whether values at the vertices are wanted instead of an image.
    """

    faces: TexturedFaces
    shape: tuple[int, int]
    given: Mapping[str, Any] = field(default_factory=dict)
    at_vertices: bool = False

    @property
    def size(self) -> int:
        """How much work it is, beside others."""
        return self.shape[0] * self.shape[1]


@dataclass(frozen=True)
class Generated:
    """A new image or attribute, and what is unusual about the texture coordinates.

    Attributes
    ----------
    values : (h, w) or (n,) float32
        Of texels, from the bottom up; or of the vertices.
    shown : (h, w) or (n,) bool
        Which of them lie on the surface, at a finite distance.
    notes : tuple of str
    """

    values: npt.NDArray[np.float32]
    shown: npt.NDArray[np.bool_]
    notes: tuple[str, ...]


def generate(
    surface: FieldSurface, name: str, settings: Any, progress: ProgressCallback | None = None
) -> Generated:
    """Make an image.

    Parameters
    ----------
    surface : FieldSurface
    name, settings
        As in `images.filter_image`.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Raises
    ------
    ShockError
        See `TriangleMesh`, `TextureAtlas` and the function.
    """
    with reporting(progress):
        with phase(0.0, _ANALYSIS, "Preparing the mesh"):
            atlas = analyse(surface.faces, surface.shape)
        with phase(_ANALYSIS, 1.0, "Generating"):
            uv, given = surface.faces.uv, dict(surface.given)
            if "along" in given:
                given["directions"] = named_directions(atlas.mesh, given.pop("along"))
            if "rising" in given:
                given["directions"] = gradient_directions(atlas.mesh, given.pop("rising"))
            function = find(name).function(vertices=surface.at_vertices)
            made = function(atlas.mesh, uv, surface.shape, settings=settings, atlas=atlas, **given)
    values = made if surface.at_vertices else grays_of(made, atlas.inside)
    shown = np.isfinite(values) if surface.at_vertices else np.isfinite(values) & atlas.inside
    values = values.astype(np.float32, copy=False)
    return Generated(values, shown, tuple(atlas.report.sentences()))
