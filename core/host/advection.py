# SPDX-License-Identifier: GPL-3.0-or-later
"""Show a flow as moving noise, with the arrays of a host program such as Blender."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..advection.pictures import pictures_of_plane, pictures_of_surface
from ..base.progress import ProgressCallback, part_of, phase, reporting
from ..color.signals import luminance, to_own_corners
from ..flow.potential import flow_field
from ..mesh.directions import gradient_directions
from ..mesh.triangle_mesh import TriangleMesh
from ..mesh.weld import split_at_jumps
from ..settings import NoiseSettings
from ..shape.sharpening import geometry_flow
from .inputs import TexturedFaces
from .textures import analyse

_ANALYSIS = 0.1  # of the time that a run takes

_FAST = 0.98
"""Quantile of the speeds to which faster faces are limited. Without the limit, a few fast faces at
creases would make all others seem to stand still."""


@dataclass(frozen=True)
class FlowSurface:
    """A flow on the faces that will show it.

    Attributes
    ----------
    faces : TexturedFaces
    shape : (int, int)
        Height and width of the frames.
    of : str
        The kind of `given`: "shape", settings of `geometry_flow`; "colors", corner colors
        (m, 3, c) and settings of `flow_field`; "directions", vectors (m, 3); or "rising", numbers
        at the corners (m, 3), along whose gradient it flows.
    given : object
    """

    faces: TexturedFaces
    shape: tuple[int, int]
    of: str
    given: Any

    @property
    def size(self) -> int:
        """The amount of work, for comparison with other data."""
        return self.shape[0] * self.shape[1]


@dataclass(frozen=True)
class FlowPlane:
    """A flow in an image: (h, w, 2) velocities, from the top down, to the right and up."""

    velocity: npt.NDArray[np.float32]

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the frames."""
        height, width, _ = self.velocity.shape
        return height, width

    @property
    def size(self) -> int:
        """The amount of work, for comparison with other data."""
        return self.shape[0] * self.shape[1]


def frames_of(
    flow: FlowSurface | FlowPlane,
    settings: NoiseSettings,
    frames: int,
    in_colors: bool,
    progress: ProgressCallback | None = None,
    background: npt.NDArray[np.float32] | None = None,
) -> Iterator[npt.NDArray[np.float32]]:
    """Return frames of moving noise, rows from the top down.

    Parameters
    ----------
    flow : FlowSurface or FlowPlane
    settings : NoiseSettings
    frames : int
    in_colors : bool
        Whether colors show the speed.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.
    background : (h, w, 3) float32, optional
        As in `advect_noise`.

    Raises
    ------
    ShockError
        See `TriangleMesh`, `TextureAtlas`, `advect_noise` and `advect_on_surface`.
    """
    if isinstance(flow, FlowPlane):
        return pictures_of_plane(
            flow.velocity, settings, frames, in_colors=in_colors, background=background,
            progress=progress,
        )  # fmt: skip

    with reporting(part_of(progress, 0.0, _ANALYSIS)):
        with phase(0.0, 0.5, "Preparing the mesh"):
            atlas = analyse(flow.faces, flow.shape)
        with phase(0.5, 1.0, "Computing the flow"):
            field = limited(_field(flow, atlas.mesh))
    behind = None if background is None else background[::-1]
    pictures = pictures_of_surface(
        atlas.mesh, flow.faces.uv, field, flow.shape, settings, frames, at="faces",
        in_colors=in_colors, background=behind, progress=part_of(progress, _ANALYSIS, 1.0),
        atlas=atlas,
    )  # fmt: skip
    return (picture[::-1] for picture in pictures)


def _field(flow: FlowSurface, mesh: TriangleMesh) -> npt.NDArray[np.float64]:
    if flow.of == "shape":
        return geometry_flow(mesh, flow.given)[1]
    if flow.of == "rising":
        return gradient_directions(mesh, flow.given)
    if flow.of == "directions":
        return flow.given
    colors, settings = flow.given
    cut, values = split_at_jumps(mesh, to_own_corners(mesh, colors))
    if settings.channels == "luminance":
        values = luminance(values)
    return flow_field(cut, values, settings)[1]


def limited(field: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Limit the speed of outliers to that of the fastest other vectors."""
    speeds = np.linalg.norm(field, axis=1)
    some = speeds[speeds > 0]
    if not len(some):
        return field
    fast = np.quantile(some, _FAST)
    return field * np.minimum(1.0, fast / np.maximum(speeds, fast))[:, None]
