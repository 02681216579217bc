# SPDX-License-Identifier: GPL-3.0-or-later
"""Elements of PLY files, and their lists, which may differ in length."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
ORDERS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
_TOO_SHORT = "less data than its header says"
_HEAD = re.compile(rb"ply\s.*?^end_header[ \t\r]*\n", re.DOTALL | re.MULTILINE)


class Property(NamedTuple):
    """A property of an element; `length` is the type of a list's length, empty if it is none."""

    name: str
    kind: str
    length: str = ""


class Element(NamedTuple):
    """A table of a PLY file."""

    name: str
    rows: int
    properties: list[Property]


def head_of(data: bytes) -> bytes | None:
    """The header with the line that ends it; None if there is none."""
    found = _HEAD.match(data)
    return found and found[0]


def elements_of(head: bytes) -> tuple[str, list[Element]]:
    """The encoding that a header names, and its elements."""
    lines = [line.split() for line in head.decode("latin-1").splitlines()]
    elements: list[Element] = []
    try:
        encoding = next(words[1] for words in lines if words[:1] == ["format"])
        for words in lines:
            if words[:1] == ["element"]:
                elements.append(Element(words[1], int(words[2]), []))
            elif words[:2] == ["property", "list"]:
                elements[-1].properties.append(Property(words[4], words[3], words[2]))
            elif words[:1] == ["property"]:
                elements[-1].properties.append(Property(words[-1], words[1]))
    except (IndexError, StopIteration) as error:
        raise ValueError("a line of the header is missing or too short") from error
    return encoding, elements


def with_even_lists(data: bytes) -> bytes | None:
    """A binary file as text if its lists differ in length, for readers that ask for one length.

    None if they do not, or if it is none.
    """
    head = head_of(data)
    if head is None:
        return None
    encoding, elements = elements_of(head)
    known = all(
        each.kind in TYPES and TYPES.get(each.length or "uchar", "f")[0] in "iu"
        for element in elements
        for each in element.properties
    ) and all(element.properties and element.rows >= 0 for element in elements)
    if encoding == "ascii" or encoding not in ORDERS or not known:
        return None  # whoever reads it says what is wrong
    place, layouts = len(head), []
    for element in elements:
        layouts.append(_layout(data, place, element, ORDERS[encoding]))
        place = layouts[-1].end
    if all((each.lengths == each.lengths[:1]).all() for each in layouts):
        return None
    text = re.sub(rb"(?m)^format[^\r\n]*", b"format ascii 1.0", head, count=1)
    pairs = zip(elements, layouts, strict=True)
    rows = [row for pair in pairs for row in _rows(data, *pair, ORDERS[encoding])]
    return text + "\n".join(rows).encode() + b"\n"


class _Layout(NamedTuple):
    # Where the rows of an element begin and end, and the lengths of the lists in each: (n, lists).
    starts: npt.NDArray[np.int64]
    lengths: npt.NDArray[np.int64]
    end: int


def _layout(data: bytes, place: int, element: Element, order: str) -> _Layout:
    if element.rows > len(data) - place:
        raise ValueError(_TOO_SHORT)
    lists = [each for each in element.properties if each.length]
    lengths = np.zeros((element.rows, len(lists)), dtype=np.int64)
    if element.rows and lists:
        first, _ = _row_lengths(data, place, element, order)
        lengths[:] = first
    dtype = _dtype(element, lengths[0] if element.rows else lengths.sum(axis=0), order)
    end = place + element.rows * dtype.itemsize
    starts = place + dtype.itemsize * np.arange(element.rows)
    if end <= len(data):
        records = np.frombuffer(data, dtype, element.rows, place)
        names = [f"length {k}" for k, each in enumerate(element.properties) if each.length]
        if all((records[name] == lengths[:, k]).all() for k, name in enumerate(names)):
            return _Layout(starts, lengths, end)
    if not lists:
        raise ValueError(_TOO_SHORT)
    end = place
    for row in range(element.rows):
        starts[row] = end
        lengths[row], end = _row_lengths(data, end, element, order)
    return _Layout(starts, lengths, end)


def _row_lengths(data: bytes, place: int, element: Element, order: str) -> tuple[list[int], int]:
    # The lengths of the lists in the row that begins at a place, and where it ends.
    lengths = []
    for each in element.properties:
        size, count = int(TYPES[each.kind][1]), 1
        if each.length:
            kind = TYPES[each.length]
            end = place + int(kind[1])
            which: Any = "big" if order == ">" else "little"
            count = int.from_bytes(data[place:end], which, signed=kind[0] == "i")
            place = end
            lengths.append(count)
        place += size * count
        if count < 0 or place > len(data):
            raise ValueError(_TOO_SHORT)
    return lengths, place


def _dtype(element: Element, lengths: Iterable[int], order: str) -> np.dtype[Any]:
    # The type of rows whose lists have these lengths.
    fields: list[tuple[Any, ...]] = []
    left = iter(lengths)
    for k, each in enumerate(element.properties):
        if each.length:
            fields.append((f"length {k}", order + TYPES[each.length]))
        count = int(next(left)) if each.length else 1
        fields.append((f"values {k}", order + TYPES[each.kind], (count,)))
    return np.dtype(fields)


def _rows(data: bytes, element: Element, layout: _Layout, order: str) -> list[str]:
    # The rows of an element as text.
    result = np.full(element.rows, "", dtype=object)
    kinds, owners = np.unique(layout.lengths, axis=0, return_inverse=True)
    memory = np.frombuffer(data, np.uint8)
    for number, lengths in enumerate(kinds):
        rows = np.flatnonzero(owners.reshape(-1) == number)
        dtype = _dtype(element, lengths, order)
        some = memory[layout.starts[rows, None] + np.arange(dtype.itemsize)].view(dtype)[:, 0]
        parts = [some[name] for name in dtype.names or ()]
        columns = [part.reshape(len(rows), math.prod(part.shape[1:])).tolist() for part in parts]
        result[rows] = [
            " ".join(str(value) for values in row for value in values)
            for row in zip(*columns, strict=True)
        ]
    return result.tolist()
