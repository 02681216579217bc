# SPDX-License-Identifier: GPL-3.0-or-later
"""OpenEXR files: the colors are filtered, all other channels (depth, masks, passes) are kept."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ....errors import ShockError
from ...reading import check_claim, needed
from .image_file import ImageFile, lost

_MAGIC = b"\x76\x2f\x31\x01"
_PLAIN_HEADER = {
    *("channels", "compression", "dataWindow", "displayWindow", "lineOrder", "pixelAspectRatio"),
    *("screenWindowCenter", "screenWindowWidth", "tiles", "type", "chunkCount", "version"),
}
_COLORS = ("RGBA", "RGB", "Y")
_REC_709 = (0.2126, 0.7152, 0.0722)
_WINDOWS = ("dataWindow", "displayWindow", "preview")


def read_exr(path: Path) -> ImageFile:
    """Read the channels RGBA, RGB or Y, whichever exist first; others are kept beside them."""
    openexr = needed("OpenEXR", path)
    with path.open("rb") as stream:
        if stream.read(4) != _MAGIC:
            raise ShockError(f"{path} cannot be read; it is not an OpenEXR file.")
    try:
        with openexr.File(str(path), separate_channels=True, header_only=True) as file:
            if file.header().get("type") in (openexr.deepscanline, openexr.deeptile):
                raise ShockError(f"{path} holds deep pixels; flatten it first.")
            low, high = file.header()["dataWindow"]
            width, height = high - low + 1.0
            check_claim(path, 4 * width * height * len(file.header()["channels"]))
        try:
            parts, header, pixels = _contents(openexr, path)
        except ValueError as error:
            if "coalesce" not in str(error):  # colors and opacity of different types
                raise
            parts, header, pixels = _contents(openexr, path, separate_channels=True)
    except RuntimeError as error:
        raise ValueError(str(error)) from error
    notes = []
    if set("RGB") <= set(pixels):
        names = "RGBA" if "A" in pixels else "RGB"
        pixels[names] = np.dstack([pixels.pop(name) for name in names])
        notes.append(f"its channels of different types became {pixels[names].dtype}")
    if parts > 1:
        raise ShockError(f"{path} holds {parts} parts; save them as files of one part each.")
    if {"Y", "RY", "BY"} <= set(pixels):
        colors = _of_luminance(pixels.pop("Y"), pixels.pop("RY"), pixels.pop("BY"), header)
        pixels["RGBA" if "A" in pixels else "RGB"] = (
            np.dstack([colors, pixels.pop("A")]) if "A" in pixels else colors
        )
        notes.append("its luminance and chroma became RGB channels")
    name = next((name for name in _COLORS if name in pixels), None)
    if name is None:
        raise ShockError(
            f"{path} has no channels R, G, B or Y; it has: {', '.join(pixels)}. Rename the layer"
            " to be sharpened."
        )
    if pixels[name].dtype.kind != "f":
        raise ShockError(f"{path} holds whole numbers, not colors; save colors as half or float.")
    others = [other for other in pixels if other != name]
    coarse = [other for other in others if pixels[other].shape[:2] != pixels[name].shape[:2]]
    if coarse:
        raise ShockError(
            f"{path} has channels of a lower resolution ({', '.join(coarse)}); save them at the"
            " resolution of the picture."
        )
    if header.get("compression") not in _lossless(openexr):
        header["compression"] = openexr.ZIP_COMPRESSION
        notes.append("its lossy compression became ZIP, so that all values stay")
    tiles = header.get("tiles")
    if tiles is not None and tiles.mode != openexr.ONE_LEVEL:
        tiles.mode = openexr.ONE_LEVEL
        notes.append("its smaller copies (levels): left behind")
    only_own = [f"the other channels ({', '.join(others)})"] if others else []
    only_own += set(header) - _PLAIN_HEADER
    return ImageFile(
        *(pixels[name], "EXR", {}, notes, (header, pixels, name), only_own),
        premultiplied=name == "RGBA",
    )


def _lossless(openexr: Any) -> set[Any]:
    names = ("NO", "RLE", "ZIPS", "ZIP", "PIZ")
    return {getattr(openexr, f"{name}_COMPRESSION") for name in names}


def _contents(
    openexr: Any, path: Path, **words: bool
) -> tuple[int, dict[str, Any], dict[str, npt.NDArray[Any]]]:
    """The number of parts, the header, and the pixels by channels or groups of these."""
    with openexr.File(str(path), **words) as file:
        header = dict(file.header())  # a copy, as closing the file clears the original
        pixels = {name: channel.pixels for name, channel in file.channels().items()}
        return len(file.parts), header, pixels


def _of_luminance(
    luminance: npt.NDArray[Any],
    red: npt.NDArray[Any],
    blue: npt.NDArray[Any],
    header: dict[str, Any],
) -> npt.NDArray[Any]:
    """Return the colors of luminance Y and chroma, (R - Y) / Y and (B - Y) / Y, on a coarser grid.

    The luminance weights are those of the file's primaries, by default of Rec. 709.
    """
    y = luminance.astype(np.float32)
    chroma = [_resampled(each.astype(np.float32), y.shape) for each in (red, blue)]
    of_red, of_green, of_blue = _luminance_weights(header.get("chromaticities"))
    with np.errstate(invalid="ignore", over="ignore"):  # the file may hold infinity
        r, b = ((each + 1) * y for each in chroma)
        g = (y - of_red * r - of_blue * b) / of_green
        return np.dstack([r, g, b]).astype(luminance.dtype)


def _resampled(values: npt.NDArray[Any], shape: tuple[int, ...]) -> npt.NDArray[Any]:
    """Interpolate linearly between grids whose first samples coincide."""
    for axis in (0, 1):
        places = np.arange(shape[axis]) * (values.shape[axis] / shape[axis])
        before = np.minimum(places.astype(np.intp), values.shape[axis] - 1)
        after = np.minimum(before + 1, values.shape[axis] - 1)
        share = np.expand_dims((places - before).astype(np.float32), 1 - axis)
        values = (1 - share) * values.take(before, axis) + share * values.take(after, axis)
    return values


def _luminance_weights(chromaticities: Any) -> tuple[float, float, float]:
    """Return the luminance weights of red, green and blue, from the primaries and white."""
    if chromaticities is None:
        return _REC_709
    places = np.asarray(tuple(chromaticities), float).reshape(4, 2)
    xyz = np.column_stack([places, 1 - places.sum(axis=1)])
    primaries, white = xyz[:3].T, xyz[3] / xyz[3, 1]
    red, green, blue = np.linalg.solve(primaries, white) * primaries[1]
    return float(red), float(green), float(blue)


def write_exr(path: Path, image_file: ImageFile, pixels: npt.NDArray[Any]) -> list[str]:
    """Write half or float channels, with the header and the other channels of the source."""
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
