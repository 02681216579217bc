# SPDX-License-Identifier: GPL-3.0-or-later
"""Removal of thumbnails in metadata, which would show the old pixels: EXIF and Photoshop blocks."""

from __future__ import annotations

import struct

_ORDERS = {b"II*\0": "<", b"MM\0*": ">"}
_PLACE, _SIZE = 0x0201, 0x0202
_STRIPS, _STRIP_SIZES = 0x0111, 0x0117
_ENTRY, _IN_PLACE = 12, 4
_SHORT = 3
_PHOTOSHOP = b"Photoshop 3.0\0"
_RESOURCE = b"8BIM"
_THUMBNAILS = {0x0409, 0x040C}


def without_exif_thumbnail(exif: bytes) -> tuple[bytes, bool]:
    """Return EXIF data without the second directory, the thumbnail's, and whether there was one.

    The first directory then leads to the third, if there is one. All else stays in its place, since
    makers' notes rely on that.
    """
    order = _ORDERS.get(exif[:4])
    if order is None:
        return exif, False
    data = bytearray(exif)
    try:
        (first,) = struct.unpack_from(f"{order}I", data, 4)
        (count,) = struct.unpack_from(f"{order}H", data, first)
        link = first + 2 + _ENTRY * count
        (second,) = struct.unpack_from(f"{order}I", data, link)
        if not second:
            return exif, False
        struct.pack_into(f"{order}I", data, link, 0)
        (count,) = struct.unpack_from(f"{order}H", data, second)
        end = second + 2 + _ENTRY * count
        entries = {}
        for place in range(second + 2, end, _ENTRY):
            code, kind, number = struct.unpack_from(f"{order}HHI", data, place)
            letter = "H" if kind == _SHORT else "I"
            if number * struct.calcsize(letter) > _IN_PLACE:
                (place,) = struct.unpack_from(f"{order}I", data, place + 8)
            else:
                place += 8
            if code in (_PLACE, _SIZE, _STRIPS, _STRIP_SIZES):
                entries[code] = struct.unpack_from(f"{order}{number}{letter}", data, place)
        for starts, sizes in ((_PLACE, _SIZE), (_STRIPS, _STRIP_SIZES)):
            pairs = zip(entries.get(starts, ()), entries.get(sizes, ()), strict=False)
            for start, size in pairs:
                stop = min(start + size, len(data))
                data[start:stop] = bytes(max(stop - start, 0))
        third = int.from_bytes(exif[end : end + 4], "little" if order == "<" else "big")
        if third not in (first, second):  # a circle otherwise
            struct.pack_into(f"{order}I", data, link, third)
        data[second:end] = bytes(end - second)
    except struct.error:  # truncated, so no reader reads on either
        return bytes(data), data != exif
    return bytes(data), True


def without_photoshop_thumbnail(block: bytes) -> tuple[bytes, bool]:
    """Return a JPEG's Photoshop resources without thumbnails, and whether there were any."""
    kept, place, found = [_PHOTOSHOP], len(_PHOTOSHOP), False
    while block[place : place + 4] == _RESOURCE and place + 12 <= len(block):
        name = place + 6
        start = name + block[name] + 1
        start += (start - name) % 2
        if start + 4 > len(block):
            break
        size = int.from_bytes(block[start : start + 4], "big")
        end = start + 4 + size + size % 2
        if int.from_bytes(block[place + 4 : place + 6], "big") in _THUMBNAILS:
            found = True
        else:
            kept.append(block[place:end])
        place = end
    return (b"".join([*kept, block[place:]]), True) if found else (block, False)
