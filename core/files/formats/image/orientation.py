# SPDX-License-Identifier: GPL-3.0-or-later
"""The orientation in which a picture is shown: the tag of TIFF and EXIF, and its copy in XMP.

Pixels are rotated and the tags set to upright, since not all formats keep the tags.
"""

from __future__ import annotations

import re
import struct
from typing import Any

ORIENTATION = 274
"""The tag's code, in TIFF and in EXIF."""

UPRIGHT = 1
_TRANSPOSED = 5  # from this number on, rows and columns are exchanged
_MIRRORED_ROWS, _MIRRORED_COLUMNS = (3, 4, 7, 8), (2, 3, 6, 7)
_ORDERS = {b"II*\0": "<", b"MM\0*": ">"}
_ENTRY, _SHORT = 12, 3
_IN_XMP = re.compile(rb"(tiff:Orientation(?:\s*=\s*[\"']|>))([1-8])(?=[\"'<])")


def is_transposed(orientation: int) -> bool:
    """Whether stored rows are shown as columns."""
    return orientation >= _TRANSPOSED


def turned(pixels: Any, orientation: int) -> Any:
    """Return an array, of numpy or dask, rotated for display."""
    if is_transposed(orientation):
        pixels = pixels.swapaxes(0, 1)
    if orientation in _MIRRORED_ROWS:
        pixels = pixels[::-1]
    return pixels[:, ::-1] if orientation in _MIRRORED_COLUMNS else pixels


def checked(value: Any) -> int:
    """Return a tag's value, or upright if it is undefined."""
    return value if isinstance(value, int) and UPRIGHT <= value <= 8 else UPRIGHT


def exif_orientation(exif: bytes) -> int | None:
    """Return the orientation in EXIF data, if any."""
    place = _place(exif)
    return None if place is None else checked(struct.unpack_from(*place)[0])


def upright_exif(exif: bytes) -> bytes:
    """Return EXIF data with an upright orientation; all else stays in its place."""
    place = _place(exif)
    if place is None:
        return exif
    order, data, start = place[0], bytearray(exif), place[2]
    struct.pack_into(order, data, start, UPRIGHT)
    return bytes(data)


def _place(exif: bytes) -> tuple[str, bytes, int] | None:
    """Return the place of the number, in the arguments of `struct`."""
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
    except struct.error:  # truncated
        pass
    return None


def xmp_orientation(xmp: bytes) -> int | None:
    """Return the orientation in XMP data, if any."""
    found = _IN_XMP.search(xmp)
    return int(found[2]) if found else None


def upright_xmp(xmp: bytes) -> bytes:
    """Return XMP data with an upright orientation."""
    return _IN_XMP.sub(rb"\g<1>1", xmp)
