# SPDX-License-Identifier: GPL-3.0-or-later
"""Flows on disk, shown as moving textures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..advection.pictures import DYES, is_picture, pictures_of_plane, pictures_of_surface
from ..advection.sources import DyeSource
from ..errors import ShockError
from ..settings import NoiseSettings
from .frames import as_numbers, check_frames_target, is_folder, write_frames
from .image_formats import Pixels, read_pixels
from .images import write_image_file
from .output import DEFAULTS, Options, Outcome
from .velocities import PlaneFlow, SurfaceFlow


@dataclass(frozen=True)
class Look:
    """How a flow is shown and its frames are written; see `pictures` and `frames`.

    Attributes
    ----------
    settings : NoiseSettings, DyeSettings or ConvolutionSettings
        They select noise, dye or lines.
    frames : int
    size : (int, int), optional
        Rows and columns; those of the background or the velocity if left out.
    fps, bits
        As in `write_frames`.
    background : (h, w) or (h, w, 3) array of float, optional
    in_colors : bool
    sources : sequence of sequences of points
        Where dye comes from; see `DyeSource`.
    source_width, source_every
        Width and period of all sources.
    under : NoiseSettings, optional
    """

    settings: Any
    frames: int = 100
    size: tuple[int, int] | None = None
    fps: float = 25.0
    bits: int = 8
    background: npt.NDArray[np.float32] | None = None
    in_colors: bool = False
    sources: Sequence[Sequence[tuple[float, float]]] = ()
    source_width: float = 16.0
    source_every: int = 1
    under: NoiseSettings | None = None


def check_target_of_flow(target: Path, look: Look, overwrite: bool) -> None:
    """Refuse an unusable target before anything is read."""
    if not is_picture(look.settings):
        check_frames_target(target, overwrite)
    elif is_folder(target):
        raise ShockError(f"{target}: lines are a still picture; name an image, such as lines.png.")


def write_flow(
    flow: PlaneFlow | SurfaceFlow, target: Path, look: Look, options: Options = DEFAULTS
) -> Outcome:
    """Show a flow and write its frames.

    Parameters
    ----------
    flow : PlaneFlow or SurfaceFlow
        See `read_velocity`.
    target : path
        As in `write_frames`; an image file for lines.
    look : Look
    options : Options
        Whether to replace files, and the progress callback.

    Raises
    ------
    ShockError
        As `read_velocity`, `write_frames` and the functions that draw the frames.
    """
    check_target_of_flow(target, look, options.overwrite)
    if isinstance(flow, SurfaceFlow):
        pictures = _on_surface(flow, look, options)
    else:
        pictures = _in_plane(flow, look, options)
    return write_pictures(pictures, target, look, flow.notes, options.overwrite)


def write_pictures(
    pictures: Iterator[Pixels], target: Path, look: Look, notes: tuple[str, ...], overwrite: bool
) -> Outcome:
    """Write pictures of a flow: frames, or the single picture of lines."""
    if is_picture(look.settings):
        shown = next(pictures)
        pixels = (
            shown if target.suffix.lower() in (".npy", ".exr") else as_numbers(shown, look.bits)
        )
        write_image_file(target, pixels, overwrite)
        return Outcome(shown.size, shown.size, notes, "drew {total} pixels")
    sizes: list[tuple[int, ...]] = []

    def seen() -> Iterator[Pixels]:
        for frame in pictures:
            sizes[:] = [frame.shape]
            yield frame

    count = write_frames(
        seen(), target, look.frames, fps=look.fps, bits=look.bits, overwrite=overwrite
    )
    height, width = sizes[0][:2]
    done = f"{{changed}} frames of {width} x {height} pixels"
    return Outcome(count, count, notes, done)


def _in_plane(flow: PlaneFlow, look: Look, options: Options) -> Iterator[Pixels]:
    size = look.size
    if size is None and look.background is not None:
        size = look.background.shape[:2]  # type: ignore[assignment]
    every = look.source_every
    sources = [
        DyeSource(
            points, width=look.source_width, colors=DYES, every=every, lasting=max(every // 2, 1)
        )
        for points in look.sources
    ]
    return pictures_of_plane(
        flow.velocity, look.settings, look.frames, size=size, background=look.background,
        in_colors=look.in_colors, sources=sources, under=look.under, progress=options.progress,
    )  # fmt: skip


def _on_surface(flow: SurfaceFlow, look: Look, options: Options) -> Iterator[Pixels]:
    size = size_on_surface(look)
    behind = None if look.background is None else look.background[::-1]
    frames = pictures_of_surface(
        flow.mesh, flow.uv, flow.vectors, size, look.settings, look.frames, at="vertices",
        in_colors=look.in_colors, background=behind, progress=options.progress,
    )  # fmt: skip
    return (frame[::-1] for frame in frames)


def size_on_surface(look: Look) -> tuple[int, int]:
    """Return rows and columns of the texture; refuses kinds that cannot be shown on surfaces."""
    if look.settings.draws != "noise":
        raise ShockError(
            "On a mesh flows are shown as noise; leave --kind out, or draw still streaks with"
            " surface-streaks."
        )
    if look.size is not None:
        return look.size
    if look.background is None:
        raise ShockError("A texture needs a size; add one such as --size 1024x1024.")
    return look.background.shape[:2]  # type: ignore[return-value]


def read_background(path: str | Path, any_size: bool = False) -> npt.NDArray[np.float32]:
    """Read a picture as floats from 0 to 1, gray or in colors, without opacity."""
    return background_of(read_pixels(path, any_size))


def background_of(pixels: Pixels) -> npt.NDArray[np.float32]:
    """Convert the pixels of an image to a background."""
    if pixels.dtype.kind == "u":
        pixels = pixels / np.float32(np.iinfo(pixels.dtype).max)
    if pixels.ndim == 3:
        pixels = pixels[..., 0] if pixels.shape[2] < 3 else pixels[..., :3]
    return np.ascontiguousarray(pixels, dtype=np.float32)
