# SPDX-License-Identifier: GPL-3.0-or-later
"""What the metadata of a Zarr folder ask for, looked at before any library acts on it.

Metadata name the codecs that decode chunks, and a library runs what is registered under a name.
Some codecs run code that the chunk holds (``pickle``). So each codec and each type has to be on a
list.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from ...errors import ShockError
from ..reading import check_claim

FILES = ("zarr.json", ".zarray", ".zgroup")
"""Each node of a hierarchy has one of these."""

_CONSOLIDATED = ".zmetadata"
_MOST_METADATA = 1 << 26
"""Bytes of one metadata file; the largest stores have some megabytes."""

_COMPRESSORS = {"blosc", "bz2", "gzip", "lz4", "lzma", "zlib", "zstd"}
_FILTERS = {
    "adler32", "astype", "bitround", "crc32", "crc32c", "delta", "fixedscaleoffset", "fletcher32",
    "jenkins_lookup3", "packbits", "quantize", "shuffle",
}  # fmt: skip
_SERIALIZERS = {"bytes", "endian", "sharding_indexed", "transpose", "vlen-bytes", "vlen-utf8"}
CODECS = frozenset(_COMPRESSORS | _FILTERS | _SERIALIZERS)
_RUN_CODE = {"pickle"}

_PLAIN_TYPE = re.compile(r"[<>|=]?(?:[biufc]\d+|[SUV]\d+|[mM]8(?:\[\d*\w+\])?)")  # of format 2
_TYPES = re.compile(
    r"bool|u?int(?:8|16|32|64)|b?float(?:16|32|64)|complex(?:64|128)|r\d+|string|bytes|raw_bytes"
    r"|variable_length_bytes|variable_length_utf8|fixed_length_utf32|null_terminated_bytes"
    r"|numpy\.(?:datetime64|timedelta64)"
)  # of format 3


@dataclass(frozen=True)
class ArrayClaim:
    """What the metadata say of an array's size.

    Attributes
    ----------
    name : str
        Where it is in the hierarchy; empty for the folder itself.
    shape, chunk : tuple of int
        Of the array, and of what is decoded at once.
    item : int
        Bytes of an element.
    """

    name: str
    shape: tuple[int, ...]
    chunk: tuple[int, ...]
    item: int

    @property
    def size(self) -> float:
        """Return the bytes of the whole array, or of a chunk that is larger."""
        return float(max(math.prod(self.shape), math.prod(self.chunk))) * self.item


def check_zarr(path: Path) -> list[ArrayClaim]:
    """Refuse a Zarr folder that runs code, leads elsewhere, or claims more than it can hold.

    Parameters
    ----------
    path : Path
        The folder of an array or a group.

    Returns
    -------
    list of ArrayClaim
        All arrays in it.

    Raises
    ------
    ShockError
        If it is no Zarr folder, its metadata cannot be read, a codec or a type is not on the list,
        a link leads out of the folder, or the arrays are far larger than what is stored.
    """
    if not path.exists():
        raise ShockError(f"There is no file {path}; check its name and folder.")
    if not is_zarr(path):
        raise ShockError(f"{path} is no Zarr array; save the picture as one, or as a tiled TIFF.")
    found: dict[str, ArrayClaim] = {}
    stored = 0
    for folder, _, names in _walk(path):
        for name in names:
            file = Path(folder, name)
            stored += file.lstat().st_size
            if name in FILES or name == _CONSOLIDATED:
                for claim in _Metadata(path, file).arrays():
                    known = found.get(claim.name, claim)
                    found[claim.name] = max(claim, known, key=lambda each: each.size)
    check_claim(path, sum(claim.size for claim in found.values()), stored)
    return list(found.values())


def is_zarr(path: Path) -> bool:
    """Whether a folder holds Zarr's own files."""
    return any((path / name).is_file() for name in FILES)


def _walk(path: Path) -> Iterator[tuple[str, list[str], list[str]]]:
    inside = path.resolve()
    for folder, folders, names in os.walk(path):
        for name in (*folders, *names):
            part = Path(folder, name)
            if part.is_symlink() and not part.resolve().is_relative_to(inside):
                raise ShockError(
                    f"{path}: {part.relative_to(path)} is a link out of the folder; copy the folder"
                    " with what its links point to."
                )
        yield folder, folders, names


class _Metadata:
    """One metadata file of a Zarr folder."""

    def __init__(self, root: Path, file: Path) -> None:
        self._root, self._file = root, file
        inner = file.parent.relative_to(root).as_posix()
        self._name = "" if inner == "." else inner

    def arrays(self) -> Iterator[ArrayClaim]:
        """Check all that the file says, and return what it says of arrays."""
        document = self._read()
        kind = self._file.name
        if kind == _CONSOLIDATED:
            yield from self._consolidated(document)
        elif kind == ".zarray":
            yield self._array_of_format_2(self._name, document)
        elif kind == "zarr.json":
            yield from self._node_of_format_3(self._name, document)

    def _read(self) -> dict[str, Any]:
        if self._file.stat().st_size > _MOST_METADATA:
            raise self._broken("is too large")
        try:
            document = json.loads(self._file.read_bytes())
        except (ValueError, RecursionError) as error:
            raise self._broken(f"is no JSON ({error})") from error
        if not isinstance(document, dict):
            raise self._broken("is no JSON object")
        return document

    def _consolidated(self, document: dict[str, Any]) -> Iterator[ArrayClaim]:
        for key, value in self._mapping(document.get("metadata", {}), "metadata").items():
            name, _, kind = key.rpartition("/")
            self._check_inside(name)
            if kind == ".zarray":
                inner = self._mapping(value, key)
                yield self._array_of_format_2(str(PurePosixPath(self._name, name)), inner)

    def _array_of_format_2(self, name: str, array: dict[str, Any]) -> ArrayClaim:
        item = self._check_type(array.get("dtype"))
        for place in ("filters", "compressor"):
            codecs = array.get(place)
            for codec in codecs if isinstance(codecs, list) else [codecs]:
                if codec is not None:
                    configuration = self._mapping(codec, place)
                    self._check_codec(configuration.get("id"), configuration)
        chunk = self._whole_numbers(array.get("chunks"), "chunks")
        return ArrayClaim(_clean(name), self._shape(array), chunk, item)

    def _node_of_format_3(self, name: str, node: dict[str, Any]) -> Iterator[ArrayClaim]:
        if node.get("node_type") == "array":
            yield self._array_of_format_3(name, node)
        consolidated = node.get("consolidated_metadata")
        if consolidated is not None:
            inner = self._mapping(consolidated, "consolidated_metadata").get("metadata", {})
            for key, value in self._mapping(inner, "metadata").items():
                self._check_inside(key)
                yield from self._node_of_format_3(
                    str(PurePosixPath(name, key)), self._mapping(value, key)
                )

    def _array_of_format_3(self, name: str, array: dict[str, Any]) -> ArrayClaim:
        kind, configuration = self._named(array.get("data_type"), "data_type")
        if not _TYPES.fullmatch(kind):
            raise self._refused("type", kind)
        if array.get("storage_transformers"):
            raise self._refused("storage transformer", str(array["storage_transformers"]))
        self._check_codecs(array.get("codecs"))
        grid, words = self._named(array.get("chunk_grid"), "chunk_grid")
        if grid != "regular":
            raise self._refused("chunk grid", grid)
        chunk = self._whole_numbers(words.get("chunk_shape"), "chunk_shape")
        return ArrayClaim(_clean(name), self._shape(array), chunk, _item_size(kind, configuration))

    def _check_codecs(self, codecs: Any) -> None:
        if not isinstance(codecs, list):
            raise self._broken("has no list of codecs")
        for codec in codecs:
            name, configuration = self._named(codec, "codecs")
            self._check_codec(name.removeprefix("numcodecs."), configuration)
            for inner in ("codecs", "index_codecs"):
                if inner in configuration:
                    self._check_codecs(configuration[inner])

    def _check_codec(self, name: Any, configuration: dict[str, Any]) -> None:
        if name not in CODECS:
            raise self._refused("codec", str(name))
        for key in ("dtype", "astype", "encode_dtype", "decode_dtype"):
            if key in configuration:
                self._check_type(configuration[key])

    def _check_type(self, kind: Any) -> int:
        """Check a type as numpy writes it, and return its bytes."""
        if isinstance(kind, str) and _PLAIN_TYPE.fullmatch(kind):
            digits = re.search(r"\d+", kind)
            size = int(digits[0]) if digits else 1
            return 4 * size if "U" in kind else size
        if isinstance(kind, str) and _TYPES.fullmatch(kind):
            return _item_size(kind, {})
        raise self._refused("type", str(kind))

    def _named(self, value: Any, where: str) -> tuple[str, dict[str, Any]]:
        """Return name and configuration of an extension point of format 3."""
        if isinstance(value, str):
            return value, {}
        found = self._mapping(value, where)
        name = found.get("name")
        if not isinstance(name, str):
            raise self._broken(f"has a {where} without a name")
        return name, self._mapping(found.get("configuration", {}), where)

    def _mapping(self, value: Any, where: str) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise self._broken(f"has {where} that are no JSON object")
        return value

    def _shape(self, array: dict[str, Any]) -> tuple[int, ...]:
        return self._whole_numbers(array.get("shape"), "shape")

    def _whole_numbers(self, value: Any, where: str) -> tuple[int, ...]:
        fits = isinstance(value, list) and all(type(size) is int and size >= 0 for size in value)
        if not fits:
            raise self._broken(f"has no {where} of whole numbers")
        return tuple(value)

    def _check_inside(self, name: str) -> None:
        parts = name.replace("\\", "/").split("/")
        if name and (name.startswith("/") or ".." in parts or ":" in name):
            raise self._broken(f"names an array {name!r}, which is not in the folder")

    def _broken(self, what: str) -> ShockError:
        place = self._file.relative_to(self._root)
        return ShockError(f"{self._root}: {place} {what}; save or copy the array again.")

    def _refused(self, what: str, name: str) -> ShockError:
        runs_code = name in _RUN_CODE or name.strip("|<>=") == "O"
        reason = "since it can run code" if runs_code else "since it is not known to be safe"
        return ShockError(
            f"{self._root}: {what} {name!r} is not read, {reason}; save plain numbers, packed with"
            " zstd or not at all."
        )


def _clean(name: str) -> str:
    return "" if name == "." else name.removeprefix("./")


def _item_size(kind: str, configuration: dict[str, Any]) -> int:
    digits = re.search(r"\d+$", kind)
    if "length" in kind or "bytes" in kind:
        size = configuration.get("length_bytes", 1)
        return size if type(size) is int and size > 0 else 1
    if "time" in kind or kind == "string":
        return 8
    return int(digits[0]) // 8 or 1 if digits else 1
