# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames on disk: a folder of PNG files, an animation, or a video.

Frames are written one by one and not kept in memory.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import Cancelled, InvalidSettings, ShockError
from .formats.image.animations import encoded_png, write_apng, write_webp_frames
from .formats.image.video import write_mp4
from .output import Unfinished, room, staged, taking
from .staging import is_at_work, temporary_folder

Frames = Iterable[npt.NDArray[Any]]

FILES = (".webp", ".png", ".apng", ".mp4")
"""Endings of files that hold all frames; a name without an ending is a folder."""

STEM = "frame_"
_LEAST_DIGITS = 4
_SLOWEST, _FASTEST = 0.1, 1000.0  # frames per second


def is_folder(target: Path) -> bool:
    """Whether frames go into a folder of this name."""
    return target.is_dir() or not target.suffix


def check_frames_target(target: Path, overwrite: bool) -> None:
    """Refuse targets that cannot hold frames, before any is computed."""
    if is_folder(target):
        if target.exists() and not target.is_dir():
            raise ShockError(f"{target} is a file; name a folder, or a file with an ending.")
        if is_at_work(target):
            raise ShockError(
                f"Another run writes to {target}; wait for its end, or choose another output."
            )
        if not overwrite and target.is_dir() and any(target.iterdir()):
            raise ShockError(
                f"The folder {target} is not empty; add --overwrite or choose another output."
            )
        return
    if target.suffix.lower() not in FILES:
        raise ShockError(
            f"{target}: frames cannot be written to such a file; name a folder, or use one of"
            f" {', '.join(FILES)}."
        )
    if target.exists() and not overwrite:
        raise ShockError(f"{target} exists already; add --overwrite or choose another output.")


def write_frames(
    frames: Frames,
    target: str | Path,
    count: int,
    *,
    fps: float = 25.0,
    bits: int = 8,
    overwrite: bool = False,
) -> int:
    """Write frames to a folder or a file.

    Parameters
    ----------
    frames : iterable of (h, w), (h, w, 3) or (h, w, 4) array of float
        Values from 0 to 1, all of one size: gray, colors, or colors with opacity.
    target : path
        A folder for PNG files named ``frame_0001.png`` and so on; or an animated WebP (.webp) or
        PNG (.png, .apng) file, or a video (.mp4), which appear when they are complete.
    count : int
        Number of frames.
    fps : float
        Frames per second, for files. Videos have no opacity: transparent pixels show black.
    bits : int
        8 or 16, for PNG.
    overwrite : bool
        Replace a file, or the frames in a folder, where other files are kept.

    Returns
    -------
    int
        Number of frames written.

    Raises
    ------
    ShockError
        If the target cannot be written.
    Unfinished
        If `frames` was cancelled: the frames up to then are in the folder.
    """
    target = Path(target)
    check_frames_target(target, overwrite)
    if not _SLOWEST <= fps <= _FASTEST:
        raise InvalidSettings(f"fps is {fps:g}; give {_SLOWEST:g} to {_FASTEST:g} frames a second.")
    if bits not in (8, 16):
        raise InvalidSettings(f"bits is {bits}; give 8 or 16.")
    if is_folder(target):
        return write_folder(frames, target, count, bits)
    ending = target.suffix.lower()
    if bits == 16 and ending not in (".png", ".apng"):
        raise InvalidSettings(f"{ending} holds 8 bits; write a folder or a PNG for 16.")
    with staged(target, overwrite) as path, _closing(frames):
        if ending == ".webp":
            write_webp_frames(path, (as_colors(frame) for frame in frames), fps)
        elif ending == ".mp4":
            write_mp4(path, (_on_black(frame) for frame in frames), fps)
        else:
            write_apng(path, (as_numbers(frame, bits) for frame in frames), count, fps)
    return count


def write_folder(frames: Frames, folder: Path, count: int, bits: int = 8) -> int:
    """Write frames as PNG files to a folder; each file appears when it is complete.

    Frames of an earlier, longer run are removed at the end; see `write_frames`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    done = 0
    with contextlib.ExitStack() as stack:
        stage = temporary_folder(folder, stack)
        stack.enter_context(_closing(frames))
        try:
            with room(folder):
                for number, frame in enumerate(frames, 1):
                    name = frame_name(number, count)
                    (stage / name).write_bytes(encoded_png(as_numbers(frame, bits)))
                    with taking(folder / name) as announce:
                        announce(stage / name)
                        os.replace(stage / name, folder / name)
                    done = number
        except Cancelled as error:
            raise Unfinished(done, count, folder) from error
    _remove_later(folder, count)
    return done


def frame_name(number: int, count: int) -> str:
    """Return the file name of a frame, counted from 1."""
    return f"{STEM}{number:0{max(_LEAST_DIGITS, len(str(count)))}}.png"


def _remove_later(folder: Path, count: int) -> None:
    known = {frame_name(number, count) for number in range(1, count + 1)}
    for path in folder.iterdir():
        if re.fullmatch(rf"{STEM}\d+\.png", path.name) and path.name not in known:
            path.unlink()


@contextlib.contextmanager
def _closing(frames: Frames) -> Iterator[None]:
    """Free the resources behind the frames, however writing ends."""
    try:
        yield
    finally:
        if hasattr(frames, "close"):
            frames.close()


def as_numbers(frame: npt.NDArray[Any], bits: int) -> npt.NDArray[Any]:
    """Convert values from 0 to 1 to whole numbers of `bits` bits; NaN becomes 0."""
    kind = np.uint8 if bits == 8 else np.uint16
    scaled = np.nan_to_num(frame, nan=0.0)
    scaled = np.clip(scaled, 0.0, 1.0, out=scaled) * np.float32(np.iinfo(kind).max)
    return (scaled + np.float32(0.5)).astype(kind)


def as_colors(frame: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """Convert values, gray ones too, to colors of 8 bits."""
    numbers = as_numbers(frame, 8)
    return np.repeat(numbers[..., None], 3, axis=2) if numbers.ndim == 2 else numbers


def _on_black(frame: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    if frame.ndim == 3 and frame.shape[2] == 4:
        frame = frame[..., :3] * frame[..., 3:]
    return as_colors(frame)
