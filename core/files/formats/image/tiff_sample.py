# SPDX-License-Identifier: GPL-3.0-or-later
"""A few strips or tiles of a TIFF file as a small TIFF file, copied without decoding.

So another reader can tell what the values mean without decoding all of a large picture.
"""

from __future__ import annotations

import struct
from collections.abc import Collection
from pathlib import Path
from typing import Any, NamedTuple

from ...reading import needed

_WANTED, _LARGEST = 1 << 22, 1 << 27  # pixels
_LEAST_PARTS = 4
_CONTIGUOUS, _UNCOMPRESSED, _YCBCR = 1, 1, 6
_SHORT, _LONG = 3, 4  # types of tags
# Tags that say how values are stored, and what they mean.
_COPIED = (258, 259, 262, 266, 277, 284, 292, 293, 317, 320, 338, 339, 347, 529, 530, 531, 532)

Window = tuple[slice, slice]


class _Part(NamedTuple):
    """A strip, a tile, or a row of a picture that is one strip."""

    offset: int
    size: int
    window: Window


def sample_tiff(path: Path, compressions: Collection[int]) -> tuple[bytes, list[Window]] | None:
    """Return a TIFF file of some parts, stacked vertically, and their windows in the picture.

    Windows at the borders may be smaller than the parts. None if parts do not hold windows of
    pixels with all their channels, or if the compression is not among `compressions`.
    """
    with needed("tifffile", path).TiffFile(path) as file:
        page = next(page for page in file.pages if not page.is_reduced)
        is_planar = page.planarconfig != _CONTIGUOUS and page.samplesperpixel > 1
        if is_planar or page.compression not in compressions:
            return None
        (high, wide), parts = _parts(page)
        if not parts or high * wide > _LARGEST:
            return None
        count = min(max(_WANTED // (high * wide), _LEAST_PARTS), len(parts))
        chosen = [parts[(2 * each + 1) * len(parts) // (2 * count)] for each in range(count)]
        stored = []
        for part in chosen:
            file.filehandle.seek(part.offset)
            stored.append(file.filehandle.read(part.size))
        return _written(page, high, wide, stored), [part.window for part in chosen]


def _parts(page: Any) -> tuple[tuple[int, int], list[_Part]]:
    """Return rows and columns of a part, and the parts, without a shorter last strip."""
    height, width = page.imagelength, page.imagewidth
    offsets, sizes = page.dataoffsets, page.databytecounts
    if page.is_tiled:
        high, wide = page.tilelength, page.tilewidth
    else:
        high, wide = min(page.rowsperstrip, height), width
    is_plain = page.compression == _UNCOMPRESSED and page.photometric != _YCBCR
    if len(offsets) == 1 and is_plain and not page.is_tiled:
        size = -(-width * page.samplesperpixel * page.bitspersample // 8)
        offsets, sizes, high = [offsets[0] + size * row for row in range(height)], [size], 1
        sizes = sizes * height
    across = -(-width // wide)
    found = []
    for number, (offset, size) in enumerate(zip(offsets, sizes, strict=False)):
        top, left = high * (number // across), wide * (number % across)
        if top >= height:
            break
        if page.is_tiled or top + high <= height:  # tiles are padded to full size
            window = slice(top, min(top + high, height)), slice(left, min(left + wide, width))
            found.append(_Part(offset, size, window))
    return (high, wide), found


def _written(page: Any, high: int, wide: int, stored: list[bytes]) -> bytes:
    file = page.parent.filehandle
    order = page.parent.byteorder
    offsets, body = [], b""
    data = bytearray(8)
    for each in stored:
        offsets.append(len(data))
        data += each + bytes(len(each) % 2)
    sizes = [len(each) for each in stored]
    tags = {256: (_LONG, [wide]), 257: (_LONG, [high * len(stored)])}
    if page.is_tiled:
        tags |= {322: (_LONG, [wide]), 323: (_LONG, [high])}
        tags |= {324: (_LONG, offsets), 325: (_LONG, sizes)}
    else:
        tags |= {278: (_LONG, [high]), 273: (_LONG, offsets), 279: (_LONG, sizes)}
    entries = {
        code: (kind, len(values), struct.pack(f"{order}{len(values)}I", *values))
        for code, (kind, values) in tags.items()
    }
    for tag in page.tags.values():
        if tag.code in _COPIED:
            file.seek(tag.valueoffset)
            entries[tag.code] = int(tag.dtype), tag.count, file.read(tag.valuebytecount)
    table = struct.pack(f"{order}H", len(entries))
    beyond = len(data) + 2 + 12 * len(entries) + 4
    for code, (kind, count, value) in sorted(entries.items()):
        if len(value) > 4:
            place = beyond + len(body)
            body += value + bytes(len(value) % 2)
            value = struct.pack(f"{order}I", place)
        table += struct.pack(f"{order}HHI", code, kind, count) + value.ljust(4, b"\0")
    head = (b"II" if order == "<" else b"MM") + struct.pack(f"{order}HI", 42, len(data))
    data[:8] = head
    return bytes(data) + table + bytes(4) + body
