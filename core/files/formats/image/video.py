# SPDX-License-Identifier: GPL-3.0-or-later
"""MP4 files, encoded by ffmpeg from the package imageio-ffmpeg."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ....errors import ShockError
from ...reading import needed


def write_mp4(path: Path, frames: Iterable[npt.NDArray[Any]], fps: float) -> None:
    """Write (h, w, 3) frames of uint8; odd sides are padded by one, as the format requires.

    Frames go through a pipe one by one.
    """
    ffmpeg = needed("imageio_ffmpeg", path, "video").get_ffmpeg_exe()
    process = None
    with tempfile.TemporaryFile() as messages:
        try:
            for pixels in frames:
                height, width = pixels.shape[:2]
                even = np.pad(pixels, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
                if process is None:
                    command = _command(ffmpeg, even.shape[1], even.shape[0], fps, path)
                    process = subprocess.Popen(
                        command, stdin=subprocess.PIPE, stdout=messages, stderr=messages
                    )
                process.stdin.write(even.tobytes())  # type: ignore[union-attr]
            if process is not None:
                process.communicate()
        except BrokenPipeError:  # its messages say why
            pass
        finally:
            if process is not None and process.returncode is None:
                process.kill()
                process.communicate()
        if process is not None and process.returncode != 0:
            messages.seek(0)
            lines = messages.read().decode("utf-8", "replace").strip().splitlines()
            reason = lines[-1] if lines else "ffmpeg ended"
            raise ShockError(
                f"{path.name} could not be encoded ({reason}); write a folder of frames."
            )


def _command(ffmpeg: str, width: int, height: int, fps: float, path: Path) -> list[str]:
    given = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{fps:g}"]
    wanted = ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "18", "-movflags", "+faststart"]
    return [ffmpeg, "-loglevel", "error", "-y", *given, "-i", "-", *wanted, str(path)]
