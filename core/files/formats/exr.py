# SPDX-License-Identifier: GPL-3.0-or-later
"""OpenEXR files: the colors are filtered, all other channels (depth, masks, passes) are kept."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy.typing as npt

from ...errors import ShockError
from ..image_file import ImageFile, lost
from ..reading import check_claim, needed

_MAGIC = b"\x76\x2f\x31\x01"
_PLAIN_HEADER = {
    *("channels", "compression", "dataWindow", "displayWindow", "lineOrder", "pixelAspectRatio"),
    *("screenWindowCenter", "screenWindowWidth", "tiles", "type", "chunkCount", "version"),
}
_COLORS = ("RGBA", "RGB", "Y")
_WINDOWS = ("dataWindow", "displayWindow", "preview")


def read_exr(path: Path) -> ImageFile:
    """Read the channels RGBA, RGB or Y, whichever come first; the others are kept beside them."""
    openexr = needed("OpenEXR", path)
    with path.open("rb") as stream:
        if stream.read(4) != _MAGIC:
            raise ShockError(f"{path} cannot be read; it is not an OpenEXR file.")
    try:
        with openexr.File(str(path), header_only=True) as file:
            low, high = file.header()["dataWindow"]
            width, height = high - low + 1.0
            check_claim(path, 4 * width * height * len(file.header()["channels"]))
        with openexr.File(str(path)) as file:
            parts = len(file.parts)
            header = dict(file.header())  # closing the file empties the original
            pixels = {name: channel.pixels for name, channel in file.channels().items()}
    except RuntimeError as error:
        raise ValueError(str(error)) from error
    if parts > 1:
        raise ShockError(f"{path} holds {parts} parts; save them as files of one part each.")
    name = next((name for name in _COLORS if name in pixels), None)
    if name is None:
        raise ShockError(
            f"{path} has no channels R, G, B or Y; it has: {', '.join(pixels)}. Rename the layer"
            " to be sharpened."
        )
    if pixels[name].dtype.kind != "f":
        raise ShockError(f"{path} holds whole numbers, not colors; save colors as half or float.")
    others = [other for other in pixels if other != name]
    only_own = [f"the other channels ({', '.join(others)})"] if others else []
    only_own += set(header) - _PLAIN_HEADER
    return ImageFile(pixels[name], "EXR", own=(header, pixels, name), only_own=only_own)


def write_exr(path: Path, image_file: ImageFile, pixels: npt.NDArray[Any]) -> list[str]:
    """Write half or float channels, with header and other channels of the source."""
    openexr = needed("OpenEXR", path)
    if image_file.format == "EXR":
        header, all_channels, name = image_file.own
        resized = pixels.shape[:2] != image_file.pixels.shape[:2]
        if resized:
            header = {key: value for key, value in header.items() if key not in _WINDOWS}
            all_channels = {}
    else:
        header = {"compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage}
        all_channels, name = {}, "Y" if pixels.ndim == 2 else {3: "RGB", 4: "RGBA"}[pixels.shape[2]]
    try:
        openexr.File(header, {**all_channels, name: pixels}).write(str(path))
    except RuntimeError as error:
        raise ShockError(
            f"{path.name} cannot be written ({error}); choose another output."
        ) from error
    if image_file.format == "EXR":
        channels = [name for name in image_file.only_own if name not in image_file.own[0]]
        fate = "have another size: left behind" if resized else "stay as they are"
        return [f"{name} {fate}" for name in channels]
    return lost(image_file, path, set())
