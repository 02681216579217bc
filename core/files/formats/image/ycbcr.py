# SPDX-License-Identifier: GPL-3.0-or-later
"""TIFF pictures in luminance and chroma (YCbCr) without JPEG, which tifffile does not convert.

TIFF 6.0, section 21.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ....errors import ShockError

_COEFFICIENTS, _SUBSAMPLING, _REFERENCE = 529, 530, 532
_LUMA = (0.299, 0.587, 0.114)
_FULL_RANGE = (0.0, 255.0, 128.0, 255.0, 128.0, 255.0)
_REVERSED = 2  # bits of each byte in reverse order


def read_ycbcr(page: Any) -> npt.NDArray[np.uint8]:
    """Read a page of 8 bits as (h, w, 3) colors.

    Raises
    ------
    ShockError
        For other depths, or subsampled chroma that is predicted or stored in planes.
    """
    if page.bitspersample != 8 or page.samplesperpixel != 3:
        raise ShockError(
            f"{page.parent.filehandle.name} has YCbCr colors of another depth than 8 bits; save it"
            " as RGB."
        )
    across, down = _numbers(page, _SUBSAMPLING, (2, 2))
    if (across, down) == (1, 1):
        values = page.asarray()
        values = np.moveaxis(values, 0, -1) if page.axes.startswith("S") else values
    else:
        values = _upsampled(page, int(across), int(down))
    return _converted(page, values)


def _numbers(page: Any, code: int, default: tuple[float, ...]) -> tuple[float, ...]:
    """Return the numbers of a tag; rationals are pairs."""
    if code not in page.tags:
        return default
    value = page.tags[code].value
    if not isinstance(value, tuple):
        return default
    if len(value) == 2 * len(default):
        value = [top / (bottom or 1) for top, bottom in zip(value[::2], value[1::2], strict=True)]
    return tuple(map(float, value)) if len(value) == len(default) else default


def _converted(page: Any, values: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    red, green, blue = _numbers(page, _COEFFICIENTS, _LUMA)
    black_and_white = _numbers(page, _REFERENCE, _FULL_RANGE)
    coded = []
    for channel, full in enumerate((255.0, 127.0, 127.0)):
        low, high = black_and_white[2 * channel : 2 * channel + 2]
        coded.append((values[..., channel] - low) * (full / ((high - low) or 1.0)))
    luma, blueness, redness = coded
    r = luma + (2 - 2 * red) * redness
    b = luma + (2 - 2 * blue) * blueness
    g = (luma - red * r - blue * b) / (green or 1.0)
    return np.rint(np.clip(np.stack([r, g, b], axis=-1), 0, 255)).astype(np.uint8)


def _upsampled(page: Any, across: int, down: int) -> npt.NDArray[np.uint8]:
    """Read strips or tiles of blocks, each with several luminances and one pair of chromas."""
    from tifffile import TIFF

    if page.predictor != 1 or page.planarconfig != 1 or not 1 <= across * down <= 16:
        raise ShockError(
            f"{page.parent.filehandle.name} stores its chroma in a way that is not read; save it"
            " as RGB."
        )
    height, width = page.imagelength, page.imagewidth
    high, wide = page.chunks[:2]
    per_row = -(-width // wide)
    blocks_across = -(-wide // across)
    out = np.zeros((height, width, 3), np.uint8)
    decompress = TIFF.DECOMPRESSORS[page.compression]
    file = page.parent.filehandle
    for number, (offset, size) in enumerate(
        zip(page.dataoffsets, page.databytecounts, strict=True)
    ):
        top, left = high * (number // per_row), wide * (number % per_row)
        if top >= height:
            break
        rows = high if page.is_tiled else min(high, height - top)
        blocks_down = -(-rows // down)
        file.seek(offset)
        data = bytes(file.read(size))
        if page.fillorder == _REVERSED:
            data = np.packbits(
                np.unpackbits(np.frombuffer(data, np.uint8), bitorder="little")
            ).tobytes()
        found = np.frombuffer(decompress(data), np.uint8)
        count = blocks_down * blocks_across * (across * down + 2)
        if len(found) < count:
            raise ValueError("a part of the picture is cut short")
        blocks = found[:count].reshape(blocks_down, blocks_across, across * down + 2)
        luma = blocks[..., :-2].reshape(blocks_down, blocks_across, down, across)
        part = np.empty((blocks_down * down, blocks_across * across, 3), np.uint8)
        part[..., 0] = luma.swapaxes(1, 2).reshape(part.shape[:2])
        part[..., 1:] = blocks[..., -2:].repeat(down, axis=0).repeat(across, axis=1)
        part = part[: height - top, : min(wide, width - left)]
        out[top : top + len(part), left : left + part.shape[1]] = part
    return out
