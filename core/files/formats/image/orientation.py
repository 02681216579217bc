# SPDX-License-Identifier: GPL-3.0-or-later
"""Which way up a picture is shown: the tag of TIFF and EXIF, and what XMP says of the same.

Pixels are turned and the tags set to upright, since not all formats keep the tags.
"""

from __future__ import annotations

import re
import struct
from typing import Any

ORIENTATION = 274
"""The tag's code, in TIFF and in EXIF."""

UPRIGHT = 1
_TRANSPOSED = 5  # from here on, rows are columns
_MIRRORED_ROWS, _MIRRORED_COLUMNS = (3, 4, 7, 8), (2, 3, 6, 7)
_ORDERS = {b"II*\0": "<", b"MM\0*": ">"}
_ENTRY, _SHORT = 12, 3
_IN_XMP = re.compile(rb"(tiff:Orientation(?:\s*=\s*[\"']|>))([1-8])(?=[\"'<])")


def is_transposed(orientation: int) -> bool:
    """Whether what is stored as a row is shown as a column."""
    return orientation >= _TRANSPOSED


def turned(pixels: Any, orientation: int) -> Any:
    """Return an array, or one of dask, as it is to be shown."""
    if is_transposed(orientation):
        pixels = pixels.swapaxes(0, 1)
    if orientation in _MIRRORED_ROWS:
        pixels = pixels[::-1]
    return pixels[:, ::-1] if orientation in _MIRRORED_COLUMNS else pixels


def checked(value: Any) -> int:
    """Return a tag's value, or upright if it is none that is defined."""
    return value if isinstance(value, int) and UPRIGHT <= value <= 8 else UPRIGHT


def exif_orientation(exif: bytes) -> int | None:
    """Return what EXIF data say, if anything."""
    place = _place(exif)
    return None if place is None else checked(struct.unpack_from(*place)[0])


def upright_exif(exif: bytes) -> bytes:
    """Return EXIF data that call a picture upright; all else stays in its place."""
    place = _place(exif)
    if place is None:
        return exif
    order, data, start = place[0], bytearray(exif), place[2]
    struct.pack_into(order, data, start, UPRIGHT)
    return bytes(data)


def _place(exif: bytes) -> tuple[str, bytes, int] | None:
    """Return where the number stands, as `struct` takes it."""
    order = _ORDERS.get(exif[:4])
    if order is None:
        return None
    try:
        (start,) = struct.unpack_from(f"{order}I", exif, 4)
        (count,) = struct.unpack_from(f"{order}H", exif, start)
        for place in range(start + 2, start + 2 + _ENTRY * count, _ENTRY):
            if struct.unpack_from(f"{order}HHI", exif, place) == (ORIENTATION, _SHORT, 1):
                struct.unpack_from(f"{order}H", exif, place + 8)
                return f"{order}H", exif, place + 8
    except struct.error:  # cut short
        pass
    return None


def xmp_orientation(xmp: bytes) -> int | None:
    """Return what XMP data say, if anything."""
    found = _IN_XMP.search(xmp)
    return int(found[2]) if found else None


def upright_xmp(xmp: bytes) -> bytes:
    """Return XMP data that call a picture upright."""
    return _IN_XMP.sub(rb"\g<1>1", xmp)
