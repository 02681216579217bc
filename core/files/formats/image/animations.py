# SPDX-License-Identifier: GPL-3.0-or-later
"""PNG frames and animated PNG, encoded here, and animated WebP, whose frames Pillow encodes.

Frames are written one by one and not kept in memory, as Pillow's own animations are; and PNG works
without Pillow, as in Blender.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from ....errors import ShockError
from ...reading import needed
from .pillow import SIGNATURE, chunk

_Pixels = npt.NDArray[Any]

_COLORS = {1: 0, 2: 4, 3: 2, 4: 6}  # the standard's color type of each number of channels
_LEFT = 1  # the filter that stores differences to the pixel on the left
_MOST_WEBP = 1 << 14  # pixels along a side
_QUALITY = 80
_TOP_DOWN = 0x02  # flag of a WebP frame: it replaces the one below
_ANIMATED, _CLEAR = 0x02, 0x10


def encoded_png(pixels: _Pixels) -> bytes:
    """Encode (h, w) or (h, w, channels) of uint8 or uint16 as a PNG file."""
    parts = [_header(pixels), (b"IDAT", _compressed(pixels)), (b"IEND", b"")]
    return SIGNATURE + b"".join(chunk(*part) for part in parts)


def write_apng(path: Path, frames: Iterable[_Pixels], count: int, fps: float) -> None:
    """Write an animated PNG file, which repeats forever."""
    delay = Fraction(1.0 / fps).limit_denominator(1000)
    numbers = iter(range(2 * count))
    with path.open("wb") as stream:
        for index, pixels in enumerate(frames):
            if index == 0:
                stream.write(SIGNATURE + chunk(*_header(pixels)))
                stream.write(chunk(b"acTL", struct.pack(">II", count, 0)))
            height, width = pixels.shape[:2]
            times = min(delay.numerator, 65535), delay.denominator
            control = struct.pack(">IIIIIHHBB", next(numbers), width, height, 0, 0, *times, 0, 0)
            stream.write(chunk(b"fcTL", control))
            data = _compressed(pixels)
            if index == 0:
                stream.write(chunk(b"IDAT", data))
            else:
                stream.write(chunk(b"fdAT", struct.pack(">I", next(numbers)) + data))
        stream.write(chunk(b"IEND", b""))


def write_webp_frames(path: Path, frames: Iterable[_Pixels], fps: float) -> None:
    """Write an animated WebP file, which repeats forever."""
    needed("PIL", path)
    with path.open("wb") as stream:
        for index, pixels in enumerate(frames):
            height, width = pixels.shape[:2]
            if index == 0:
                if max(height, width) > _MOST_WEBP:
                    raise ShockError(
                        f"WebP holds {_MOST_WEBP} pixels along a side, and frames are {width} x"
                        f" {height}; choose a smaller size, or write a folder of frames."
                    )
                stream.write(b"RIFF\0\0\0\0WEBP")
                flags = _ANIMATED | (_CLEAR if pixels.ndim == 3 and pixels.shape[2] == 4 else 0)
                _write_part(stream, b"VP8X", bytes([flags, 0, 0, 0]) + _sides(width, height))
                _write_part(stream, b"ANIM", struct.pack("<IH", 0, 0))
            times = round(1000 * (index + 1) / fps) - round(1000 * index / fps)
            head = bytes(6) + _sides(width, height) + struct.pack("<I", times)[:3]
            _write_part(stream, b"ANMF", head + bytes([_TOP_DOWN]) + _webp_frame(pixels))
        size = stream.tell()
        stream.seek(4)
        stream.write(struct.pack("<I", size - 8))


def _header(pixels: _Pixels) -> tuple[bytes, bytes]:
    height, width = pixels.shape[:2]
    kind = _COLORS[pixels.shape[2] if pixels.ndim == 3 else 1]
    bits = 8 * pixels.dtype.itemsize
    return b"IHDR", struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0)


def _compressed(pixels: _Pixels) -> bytes:
    big = pixels.astype(pixels.dtype.newbyteorder(">"), copy=False)
    rows = np.ascontiguousarray(big).view(np.uint8).reshape(len(pixels), -1)
    step = rows.shape[1] // pixels.shape[1]  # bytes per pixel
    stored = np.empty((len(rows), 1 + rows.shape[1]), dtype=np.uint8)
    stored[:, 0] = _LEFT
    stored[:, 1 : 1 + step] = rows[:, :step]
    np.subtract(rows[:, step:], rows[:, :-step], out=stored[:, 1 + step :])
    # Noise repeats only single values: half the time of a search, and slightly smaller.
    packer = zlib.compressobj(1, zlib.DEFLATED, zlib.MAX_WBITS, 9, zlib.Z_RLE)
    return packer.compress(stored.data) + packer.flush()


def _webp_frame(pixels: _Pixels) -> bytes:
    """Return the chunks that hold the pixels of a WebP file of one picture."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "WEBP", quality=_QUALITY)
    data, place, kept = stream.getvalue(), 12, []
    while place < len(data):
        length = struct.unpack_from("<I", data, place + 4)[0]
        end = place + 8 + length + length % 2
        if data[place : place + 4] in (b"ALPH", b"VP8 ", b"VP8L"):
            kept.append(data[place:end])
        place = end
    return b"".join(kept)


def _write_part(stream: BinaryIO, kind: bytes, data: bytes) -> None:
    stream.write(kind + struct.pack("<I", len(data)) + data + bytes(len(data) % 2))


def _sides(width: int, height: int) -> bytes:
    return struct.pack("<I", width - 1)[:3] + struct.pack("<I", height - 1)[:3]
