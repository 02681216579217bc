# SPDX-License-Identifier: GPL-3.0-or-later
"""The inputs, and the file that each is written to."""

from __future__ import annotations

import argparse
import glob
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..errors import ShockError
from ..files.output import check_plain, make_folder
from ..files.staging import tidy
from ..maps.names import files_of_maps


class UsageError(Exception):
    """The command line asks for something impossible."""


class FileName(str):
    """The name of a file in a flag; the result depends on its contents."""


def files_of(options: argparse.Namespace) -> list[tuple[str, Path]]:
    """Each input with its output.

    First finishes or removes what killed runs have left in the folders of both. Also notes in
    `options` whether there are several, as their pictures have other names.
    """
    _tidy(options.inputs)
    pairs = _files_of(options)
    options.has_several = len(pairs) > 1
    _check_pictures(pairs, options)
    _tidy(each for pair in pairs for each in outputs_of(*pair, options))
    return pairs


def outputs_of(source: str, target: Path, options: argparse.Namespace) -> list[Path]:
    """All files that are made from an input; messages name the first."""
    if maps := getattr(options, "map", None):
        return files_of_maps(target, maps)
    picture = picture_of(source, options)
    return [target] if picture is None else [target, picture]


def picture_of(source: str, options: argparse.Namespace) -> Path | None:
    """The picture that is also drawn of an input."""
    if options.picture is None:
        return None
    path = Path(options.picture)
    # With the ending, as a.png and a.jpg are two inputs.
    return path.with_name(f"{Path(source).name} {path.name}") if options.has_several else path


def _check_pictures(pairs: list[tuple[str, Path]], options: argparse.Namespace) -> None:
    """Refuse pictures in the place of another file of the run."""
    if options.picture is None:
        return
    taken = {os.path.realpath(name): "is read" for name in files_named(vars(options).values())}
    taken |= {os.path.realpath(source): "is an input" for source, _ in pairs}
    taken |= {os.path.realpath(target): "is an output" for _, target in pairs}
    for pair in pairs:
        _, picture = outputs_of(*pair, options)
        place = os.path.realpath(picture)
        if place in taken:
            raise UsageError(f"{picture} {taken[place]}, too; name another file with --picture")
        taken[place] = "is the picture of another input"


def _tidy(names: Iterable[str | Path]) -> None:
    for name in names:
        for path in (name, os.path.realpath(name)):
            tidy(Path(path).parent)


def _files_of(options: argparse.Namespace) -> list[tuple[str, Path]]:
    if options.command.kind.makes_frames:  # one folder for all frames, not one per input
        tidy(Path(options.output))
        if options.output.endswith(("/", os.sep)):  # else its ending may name a file
            _make_folder(Path(options.output))
        return [(options.inputs[0], Path(options.output))]
    pairs = _pairs(options.inputs, options.output)
    for source, target in pairs if options.cluster is not None or options.resume else ():
        if os.path.realpath(source) == os.path.realpath(target):
            raise UsageError(
                f"{source} would replace itself, and be filtered twice if it is tried again; with"
                " --cluster and --resume write to another folder"
            )
    return pairs


def _make_folder(folder: Path) -> None:
    try:
        make_folder(folder)
    except ShockError as error:
        raise UsageError(str(error)) from error


def _pairs(patterns: list[str], output: str) -> list[tuple[str, Path]]:
    """Each input with the file that it is written to."""
    sources = list(dict.fromkeys(name for pattern in patterns for name in _expand(pattern)))
    if "-" in sources and len(sources) > 1:
        raise UsageError("- (the open file) must be the only input")
    is_folder = _is_folder(output)
    if len(sources) > 1 and not is_folder and os.path.exists(output):
        raise UsageError(f"{output} is a file; several inputs need a folder as OUT")
    if len(sources) == 1 and not is_folder:
        return [(sources[0], Path(output))]
    if sources == ["-"]:
        raise UsageError("name the file to write for - (the open file), not a folder")
    taken: dict[Path, str] = {}
    for source in sources:
        target = Path(output, Path(source).name)
        if target in taken:
            raise UsageError(f"{taken[target]} and {source} would both be written to {target}")
        taken[target] = source
    return [(source, target) for target, source in taken.items()]


def _is_folder(output: str) -> bool:
    # Zarr arrays are folders, too, but represent a file.
    if Path(output).suffix.lower() == ".zarr":
        return False
    return os.path.isdir(output) or output.endswith(("/", os.sep))


def _expand(pattern: str) -> list[str]:
    # A name that cannot be found is kept, to be reported as a failed input.
    if os.path.exists(pattern) or not glob.has_magic(pattern):
        return [pattern]
    return sorted(glob.glob(pattern, recursive=True)) or [pattern]


def files_named(values: Iterable[Any]) -> list[FileName]:
    """The files that the values of flags name."""
    lists = [value if isinstance(value, list) else [value] for value in values]
    return [each for value in lists for each in value if isinstance(each, FileName)]


def whole(options: argparse.Namespace) -> dict[str, Any]:
    """Return all flags, with file names that are valid in any folder."""

    def completed(value: Any) -> Any:
        if isinstance(value, list):
            return [completed(each) for each in value]
        return FileName(os.path.abspath(value)) if isinstance(value, FileName) else value

    return {name: completed(value) for name, value in vars(options).items()}


def check_target(target: Path, overwrite: bool) -> None:
    """Refuse to write to a folder or a pipe, or over a file unless requested."""
    if not target.is_dir() or target.suffix.lower() != ".zarr":
        check_plain(target)
    if target.exists() and not overwrite:
        raise ShockError(f"{target} exists already; add --overwrite or choose another output.")


def read_size(text: str) -> tuple[int, int]:
    """Read height and width."""
    width, height = map(int, text.lower().split("x"))
    if width < 1 or height < 1:
        raise ValueError
    return height, width


read_size.__name__ = "size, such as 1024x512"  # argparse says "invalid size, ... value"
