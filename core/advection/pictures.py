# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of a flow: noise, dye or streaks, chosen by the class of the settings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..base.progress import ProgressCallback
from ..errors import InvalidSettings
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import ConvolutionSettings, DyeSettings, NoiseSettings
from .convolution import line_integral_convolution
from .dye import advect_dye
from .noise import advect_noise
from .sources import DyeSource
from .surface import advect_on_surface

Settings = NoiseSettings | DyeSettings | ConvolutionSettings

SPEEDS = np.array(
    [
        [0.05, 0.08, 0.35],
        [0.10, 0.35, 0.60],
        [0.15, 0.62, 0.60],
        [0.65, 0.82, 0.35],
        [1.00, 0.95, 0.60],
    ]
)
"""Color map of the speed; the lightness rises evenly."""

DYES = ((1.0, 0.45, 0.1), (0.15, 0.55, 1.0))
"""Orange and blue, the default colors of dye, used in turn."""

_ROWS = 6  # of sources, along the shorter side
_WIDTH = 0.3  # of sources, in parts of their distance
_EVERY = 24  # frames between releases


def pictures_of_plane(
    velocity: npt.ArrayLike,
    settings: Settings,
    frames: int,
    *,
    size: tuple[int, int] | None = None,
    background: npt.ArrayLike | None = None,
    in_colors: bool = False,
    sources: Sequence[DyeSource] = (),
    under: NoiseSettings | None = None,
    progress: ProgressCallback | None = None,
) -> Iterator[npt.NDArray[np.float32]]:
    """Show a flow in the plane as frames of noise or dye, or as a picture of lines.

    Parameters
    ----------
    velocity, frames, size, background, progress
        As in `advect_noise`.
    settings : NoiseSettings, DyeSettings or ConvolutionSettings
    in_colors : bool
        Whether noise has colors by speed.
    sources : sequence of DyeSource
        Sources of dye. Default: those of `spread_sources`.
    under : NoiseSettings, optional
        Draws dye over noise.
    """
    if settings.draws == "lines":
        if frames != 1:
            raise InvalidSettings("Lines are a still picture; choose noise for frames.")
        return iter([line_integral_convolution(
            velocity, settings=settings, size=size, progress=progress
        )])  # fmt: skip
    if settings.draws == "noise":
        return advect_noise(
            velocity, with_noise_mask(settings, in_colors), frames=frames, size=size,
            background=background, colors=SPEEDS if in_colors else None, progress=progress,
        )  # fmt: skip
    if not sources:
        rows, columns = size or np.shape(velocity)[-3:-1]
        sources = spread_sources((rows, columns), frames if settings.loop else 0)
    return advect_dye(
        velocity, sources, settings, frames=frames, size=size, noise=under, background=background,
        progress=progress,
    )  # fmt: skip


def pictures_of_surface(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    field: npt.ArrayLike,
    size: tuple[int, int],
    settings: NoiseSettings,
    frames: int,
    *,
    at: str | None = None,
    in_colors: bool = False,
    background: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
) -> Iterator[npt.NDArray[np.float32]]:
    """Show a flow on a surface; see `advect_on_surface`, and `pictures_of_plane` for the rest."""
    return advect_on_surface(
        mesh, uv, field, with_noise_mask(settings, in_colors), size=size, frames=frames, at=at,
        background=background, colors=SPEEDS if in_colors else None, progress=progress, atlas=atlas,
    )  # fmt: skip


def with_noise_mask(settings: NoiseSettings, in_colors: bool) -> NoiseSettings:
    """Set a `noise_mask`, which makes noise the opacity of colors, unless there is one."""
    if not in_colors or settings.noise_mask:
        return settings
    return replace(settings, noise_mask=1.0)


def spread_sources(size: tuple[int, int], repeats: int = 0) -> list[DyeSource]:
    """Spread spots of dye over an image, which release orange and blue in turn.

    Parameters
    ----------
    size : (int, int)
        Rows and columns.
    repeats : int
        Number of frames after which releases repeat; 0 if they need not.
    """
    distance = min(size) / _ROWS
    width = max(_WIDTH * distance, 1.0)
    counts = [max(round(side / distance), 1) for side in size]
    every = releases_in(repeats, len(DYES)) if repeats else _EVERY
    places = [(np.arange(count) + 0.5) / count for count in counts]
    return [
        DyeSource([(x, y)], width=width, colors=DYES, every=every, lasting=max(every // 2, 1))
        for y in places[0]
        for x in places[1]
    ]


def releases_in(frames: int, colors: int) -> int:
    """Choose the period of releases of dye, so that colors repeat with a loop."""
    fitting = [n for n in range(1, _EVERY + 1) if frames % (n * colors) == 0]
    if not fitting:
        raise InvalidSettings(
            "The loop has {frames} frames, and {colors} colors of dye do not come out even in it;"
            " give a multiple of {colors}.",
            frames=frames,
            colors=colors,
        )
    return fitting[-1]


def is_picture(settings: Settings) -> bool:
    """Whether the settings draw a single picture instead of frames."""
    return settings.draws == "lines"
