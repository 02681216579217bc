# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks of the metadata of a Zarr folder, before any library acts on them.

Metadata name the codecs that decode chunks, and a library runs whatever is registered under a
name. Some codecs run code from the chunk (``pickle``). So each codec and each type must be on a
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

from ....errors import ShockError
from ...reading import check_claim

FILES = ("zarr.json", ".zarray", ".zgroup")
"""Each node of a hierarchy has one of these files."""

_CONSOLIDATED = ".zmetadata"
_OF_ARRAYS = {
    "chunk_grid", "chunks", "codecs", "compressor", "data_type", "dtype", "filters", "shape",
}  # fmt: skip
_MOST_METADATA = 1 << 26
"""Most bytes of one metadata file; the largest stores have a few megabytes."""

_COMPRESSORS = {"blosc", "bz2", "gzip", "lz4", "lzma", "zlib", "zstd"}
_FILTERS = {
    "adler32", "astype", "bitround", "crc32", "crc32c", "delta", "fixedscaleoffset", "fletcher32",
    "jenkins_lookup3", "packbits", "quantize", "shuffle",
}  # fmt: skip
_SERIALIZERS = {"bytes", "endian", "sharding_indexed", "transpose", "vlen-bytes", "vlen-utf8"}
CODECS = frozenset(_COMPRESSORS | _FILTERS | _SERIALIZERS)
_RUN_CODE = {"pickle"}

# Types of format 2 and of format 3.
_PLAIN_TYPE = re.compile(r"[<>|=]?(?:[biufc]\d{1,2}|[SUV]\d{1,9}|[mM]8(?:\[\d*\w+\])?)")
_TYPES = re.compile(
    r"bool|u?int(?:8|16|32|64)|b?float(?:16|32|64)|complex(?:64|128)|r\d{1,9}|string|bytes|raw_bytes"
    r"|variable_length_bytes|variable_length_utf8|fixed_length_utf32|null_terminated_bytes"
    r"|numpy\.(?:datetime64|timedelta64)"
)


@dataclass(frozen=True)
class ArrayClaim:
    """The size of an array, as claimed by its metadata.

    Attributes
    ----------
    name : str
        Path in the hierarchy; empty for the folder itself.
    shape, chunk : tuple of int
        Shapes of the array, and of the unit that is decoded at once.
    item : int
        Bytes of an element.
    """

    name: str
    shape: tuple[int, ...]
    chunk: tuple[int, ...]
    item: int

    @property
    def size(self) -> float:
        """Return the bytes of the whole array, or of a chunk if that is larger."""
        return float(max(math.prod(self.shape), math.prod(self.chunk))) * self.item


def check_zarr(path: Path) -> int:
    """Refuse a Zarr folder that runs code, leads elsewhere, or claims more data than it holds.

    Parameters
    ----------
    path : Path
        The folder of an array or a group.

    Returns
    -------
    int
        The bytes of all files in it.

    Raises
    ------
    ShockError
        If it is not a Zarr folder, its metadata cannot be read, a codec or a type is not on the
        list, a link leads out of the folder, or the arrays are far larger than the stored data.
    """
    if not path.exists():
        raise ShockError(f"There is no file {path}; check its name and folder.")
    if not is_zarr(path):
        raise ShockError(f"{path} is no Zarr array; save the picture as one, or as a tiled TIFF.")
    found: dict[str, ArrayClaim] = {}
    stored = 0
    for file in _files(path):
        stored += file.lstat().st_size
        # Some systems ignore the case of names.
        if file.name.lower() in (*FILES, _CONSOLIDATED):
            for claim in _Metadata(path, file).arrays():
                known = found.get(claim.name, claim)
                found[claim.name] = max(claim, known, key=lambda each: each.size)
    check_claim(path, sum(claim.size for claim in found.values()), stored)
    return stored


def is_zarr(path: Path) -> bool:
    """Whether a folder holds Zarr's own files."""
    return any((path / name).is_file() for name in FILES)


def _files(path: Path) -> Iterator[Path]:
    """Yield all files in a folder; refuse links that lead out, and anything but files."""
    inside = path.resolve()

    def stop(error: OSError) -> None:
        raise error  # a folder that cannot be listed may still be opened

    for folder, folders, names in os.walk(path, onerror=stop):
        for name in (*folders, *names):
            part = Path(folder, name)
            if part.is_symlink() and not part.resolve().is_relative_to(inside):
                raise ShockError(
                    f"{path}: {part.relative_to(path)} is a link out of the folder; copy the folder"
                    " with what its links point to."
                )
            if not part.is_file() and not part.is_dir():
                raise ShockError(
                    f"{path}: {part.relative_to(path)} is neither a file nor a folder; remove it."
                )
        yield from (Path(folder, name) for name in names)


class _Metadata:
    """One metadata file of a Zarr folder."""

    def __init__(self, root: Path, file: Path) -> None:
        self._root, self._file = root, file
        inner = file.parent.relative_to(root).as_posix()
        self._name = "" if inner == "." else inner

    def arrays(self) -> Iterator[ArrayClaim]:
        """Check the whole file, and yield its claims on arrays."""
        document = self._read()
        try:
            if self._file.name.lower() == _CONSOLIDATED:
                found = list(self._consolidated(document))
            else:
                found = list(self._node(self._name, document))
        except RecursionError as error:
            raise self._broken("is nested too deeply") from error
        return iter(found)

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
            if kind != ".zattrs":
                inner = self._mapping(value, key)
                yield from self._node(str(PurePosixPath(self._name, name)), inner)

    def _node(self, name: str, node: dict[str, Any]) -> Iterator[ArrayClaim]:
        """Check an array or a group, by the format that it names, whatever file it is in."""
        if node.get("node_type") == "array" or not _OF_ARRAYS.isdisjoint(node):
            if node.get("zarr_format") == 2:
                yield self._array_of_format_2(name, node)
            elif node.get("zarr_format") == 3:
                yield self._array_of_format_3(name, node)
            else:
                raise self._broken("has an array of a format other than 2 and 3")
        consolidated = node.get("consolidated_metadata")
        if consolidated is not None:
            inner = self._mapping(consolidated, "consolidated_metadata").get("metadata", {})
            for key, value in self._mapping(inner, "metadata").items():
                self._check_inside(key)
                yield from self._node(str(PurePosixPath(name, key)), self._mapping(value, key))

    def _array_of_format_2(self, name: str, array: dict[str, Any]) -> ArrayClaim:
        item = self._check_type(array.get("dtype"))
        packed = 0
        for place in ("filters", "compressor"):
            codecs = array.get(place)
            for codec in codecs if isinstance(codecs, list) else [codecs]:
                if codec is not None:
                    configuration = self._mapping(codec, place)
                    packed += self._check_codec(configuration.get("id"), configuration)
        self._check_packed(packed)
        return self._claim(name, array.get("shape"), array.get("chunks"), item)

    def _array_of_format_3(self, name: str, array: dict[str, Any]) -> ArrayClaim:
        kind, configuration = self._named(array.get("data_type"), "data_type")
        if not _TYPES.fullmatch(kind):
            raise self._refused("type", kind)
        if array.get("storage_transformers"):
            raise self._refused("storage transformer", str(array["storage_transformers"]))
        self._check_packed(self._check_codecs(array.get("codecs")))
        grid, words = self._named(array.get("chunk_grid"), "chunk_grid")
        if grid != "regular":
            raise self._refused("chunk grid", grid)
        item = _item_size(kind, configuration)
        return self._claim(name, array.get("shape"), words.get("chunk_shape"), item)

    def _claim(self, name: str, shape: Any, chunk: Any, item: int) -> ArrayClaim:
        sizes = self._whole_numbers(shape, "shape", 0), self._whole_numbers(chunk, "chunks", 1)
        if len(sizes[0]) != len(sizes[1]):
            raise self._broken("has chunks with other axes than its shape")
        return ArrayClaim(_clean(name), *sizes, item)

    def _check_codecs(self, codecs: Any) -> int:
        """Check a chain of codecs, nested ones too, and count those that decompress."""
        if not isinstance(codecs, list):
            raise self._broken("has no list of codecs")
        packed = 0
        for codec in codecs:
            name, configuration = self._named(codec, "codecs")
            packed += self._check_codec(name.removeprefix("numcodecs."), configuration)
            if "codecs" in configuration:
                packed += self._check_codecs(configuration["codecs"])
            if "index_codecs" in configuration:
                self._check_packed(self._check_codecs(configuration["index_codecs"]))
        return packed

    def _check_packed(self, times: int) -> None:
        """Refuse data compressed twice: a few bytes could then unpack to any size."""
        if times > 1:
            raise ShockError(
                f"{self._root}: its chunks are packed {times} times over; save it with one"
                " compressor, or with none."
            )

    def _check_codec(self, name: Any, configuration: dict[str, Any]) -> bool:
        """Check a codec, and return whether it decompresses."""
        if not isinstance(name, str) or name not in CODECS:
            raise self._refused("codec", str(name))
        for key in ("dtype", "astype", "encode_dtype", "decode_dtype"):
            if key in configuration:
                self._check_type(configuration[key])
        return name in _COMPRESSORS

    def _check_type(self, kind: Any) -> int:
        """Check a type in numpy's notation, and return its bytes."""
        if isinstance(kind, str) and _PLAIN_TYPE.fullmatch(kind):
            digits = re.search(r"\d+", kind)
            size = int(digits[0]) if digits else 1
            return 4 * size if "U" in kind else size
        if isinstance(kind, str) and _TYPES.fullmatch(kind):
            return _item_size(kind, {})
        raise self._refused("type", str(kind))

    def _named(self, value: Any, where: str) -> tuple[str, dict[str, Any]]:
        """Return the name and the configuration of an extension point of format 3."""
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

    def _whole_numbers(self, value: Any, where: str, least: int) -> tuple[int, ...]:
        fits = isinstance(value, list) and all(
            type(size) is int and size >= least for size in value
        )
        if not fits:
            raise self._broken(f"has no {where} of whole numbers from {least} on")
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
