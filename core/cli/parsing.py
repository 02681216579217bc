# SPDX-License-Identifier: GPL-3.0-or-later
"""The parser: one command for each filter, one flag for each of its settings."""

from __future__ import annotations

import argparse
import math
from collections.abc import Collection
from typing import Any

from ... import __version__
from ..registry import WAYS, find
from ..settings import Setting, describe, removed_of
from . import flows
from .commands import Backend, Command
from .inputs import FileName, UsageError, read_size

_EPILOG = """\
exit codes:
  0    every input was filtered and written
  1    some inputs failed; the others were written
  2    the command line is wrong; nothing was done
  130  interrupted; the file at hand and those after it were not written

examples:
  {prog} sharpen-geometry scan.ply sharp.ply
  {prog} sharpen-geometry --time inf --smoothing-passes 3 scans/*.obj sharp/
  {prog} denoise-geometry scan.ply clean.ply --then-sharpen
  {prog} sharpen-colors painted.ply crisp.ply
  {prog} sharpen-image --what photo photos/*.png sharp/
  {prog} sharpen-texture model.obj wood.png metal.png sharp/
  {prog} visualize-flow flow.png frames/ --frames 120
  {prog} texture-mask model.obj charts.png --kind chart --like wood.png
"""


def build_parser(backend: Backend) -> argparse.ArgumentParser:
    """Make the parser; each field of a settings class becomes a flag."""
    parser = argparse.ArgumentParser(
        prog=backend.prog,
        description="Sharpen meshes, their colors, textures and images by shock filter advection,"
        " denoise them, and show flows.",
        epilog=_EPILOG.format(prog=backend.prog),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"Shock Filter {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for row in backend.offered:
        _add_command(commands, row, backend)
    return parser


def _add_command(commands: Any, row: Command, backend: Backend) -> None:
    parser = commands.add_parser(
        row.command,
        help=row.about,
        description=f"{row.about.capitalize()}: {backend.formats(row)}.",
        allow_abbrev=False,
    )
    parser.set_defaults(command=row, cluster=None, resume=False, picture=None, has_several=False)
    if row.kind.is_drawn:
        words: dict[str, Any] = {"nargs": 1, "metavar": "MESH", "help": row.kind.inputs}
        output = "image file to write, its ending says the format"
    elif row.kind.makes_frames:
        words = {"nargs": 1, "metavar": "IN", "help": row.kind.inputs}
        output = (
            "folder for PNG frames, which is made; or animated WebP (.webp) or PNG (.png, .apng),"
            " or video (.mp4)"
        )
    else:
        words = {"nargs": "+", "metavar": "IN", "help": f"{row.kind.inputs}; * and ** work"}
        output = (
            "file to write, its ending says the format; or folder, if it is one, ends in / or"
            " there are several inputs: files keep their names and formats there; folders are made"
        )
    if row.kind.on_mesh:
        parser.add_argument(
            "mesh", type=FileName, metavar="MESH", help="mesh file whose surface shows IN"
        )
    parser.add_argument("inputs", **words)
    parser.add_argument("output", metavar="OUT", help=output)
    parser.add_argument("--overwrite", action="store_true", help="replace files that exist")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    backend.add_arguments(parser, row)
    if row.then:
        _add_then_sharpen(parser, row)
    if row.kind.makes_frames:
        flows.add_reading(parser)
        flows.add_flags(parser, _add_settings)
    else:
        _add_settings(parser, row.settings)
    if row.kind.is_drawn:
        size = parser.add_mutually_exclusive_group(required=True)
        size.add_argument(
            "--size", type=read_size, metavar="WxH", help="width and height in texels"
        )
        size.add_argument(
            "--like", type=FileName, metavar="IMAGE", help="image file of the wanted size"
        )


def add_mask(parser: argparse.ArgumentParser, command: Command, of_meshes: str) -> None:
    """Add the flags of a mask; `of_meshes` describes masks of commands without images."""
    kind, metavar, text = str, "NAME", of_meshes
    if command.kind.is_image:
        kind, metavar, text = (
            FileName,
            "FILE",
            "gray image of the same size: black stays, white changes fully",
        )
    parser.add_argument("--mask", type=kind, metavar=metavar, help=text)
    parser.add_argument("--invert-mask", action="store_true", help="use one minus the mask")


def add_gain_map(parser: argparse.ArgumentParser) -> None:
    """Add the flag of painted gains."""
    parser.add_argument(
        "--gain-map",
        type=FileName,
        metavar="FILE",
        help="gray image of the same size that says where: white gives the gain, middle gray (128"
        " of 255) keeps detail as it is, black smooths it away",
    )


def add_others(parser: argparse.ArgumentParser) -> None:
    """Add the flag for further pictures."""
    parser.add_argument(
        "--with",
        type=FileName,
        metavar="FILE",
        action="append",
        default=[],
        dest="others",
        help="another picture of the surface, of the size and type of IN (may be repeated): one"
        " texture is made of all; opacity says where each is known",
    )


def add_sources(parser: argparse.ArgumentParser, command: Command) -> None:
    """Add the flags for what an image is made from besides the mesh."""
    if command.takes_starts:
        parser.add_argument(
            "--vertices",
            type=int,
            nargs="+",
            metavar="N",
            help="the distance is 0 at these vertices, counted from 0; give it after OUT",
        )
        parser.add_argument(
            "--painted",
            type=FileName,
            metavar="FILE",
            help="the distance is 0 where this gray image of the same size is white",
        )
    if command.way is not None:
        parser.add_argument(
            "--along",
            choices=list(WAYS),
            default=command.way or None,
            help=" ".join(f"{way}: {about}." for way, about in WAYS.items())
            + f" (default {command.way or 'none'})",
        )
    if command.takes_scale:
        parser.add_argument(
            "--scale-map",
            type=FileName,
            metavar="FILE",
            help="gray image of the same size: white has the scale, middle gray half of it",
        )


def sources_of(options: argparse.Namespace) -> dict[str, Any]:
    """Collect these flags; files by their names."""
    given = vars(options)
    names = ("vertices", "painted", "along", "scale_map")
    return {name: given[name] for name in names if given.get(name) is not None}


def _add_then_sharpen(parser: argparse.ArgumentParser, row: Command) -> None:
    unit = describe(find(row.then).settings)["time"][2].unit
    parser.add_argument(
        "--then-sharpen",
        nargs="?",
        type=_time,
        const=row.then_time,
        metavar="TIME",
        help="sharpen the result for this long; give it after OUT where TIME is left out"
        f" ({row.then_time:g} if left out, {unit})",
    )


def _time(text: str) -> float:
    try:
        return _number(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no time; give one, or --then-sharpen after OUT"
        ) from None


def _add_settings(
    parser: argparse.ArgumentParser,
    settings: type,
    title: str = "settings",
    known: Collection[str] = (),
) -> None:
    main_group = parser.add_argument_group(title)
    advanced = parser.add_argument_group(f"advanced {title}")
    for name, (kind, default, setting) in describe(settings).items():
        if name in known:
            continue
        (advanced if setting.advanced else main_group).add_argument(
            "--" + name.replace("_", "-"),
            dest=name,
            type=str if kind is str else _number,
            choices=list(setting.choices) or None,
            metavar=None if setting.choices else "N",
            default=default,
            help=_help(default, setting).replace("%", "%%"),
        )


def _help(default: Any, setting: Setting) -> str:
    parts = [setting.description + "."]
    parts += [f"{word}: {meaning}." for word, meaning in setting.choices.items()]
    facts = [f"default {default if setting.choices else format(default, 'g')}"]
    if not setting.choices:
        form = ".0f" if isinstance(default, int) else "g"
        facts.append(f"{setting.minimum:{form}} to {setting.maximum:{form}}")
    if setting.unit:
        facts.append(setting.unit)
    return " ".join([*parts, f"({', '.join(facts)})"])


def _number(text: str) -> float:
    # The settings check whether it must be whole.
    try:
        return int(text)
    except ValueError:
        return float(text)


_number.__name__ = "number"  # argparse says "invalid number value"


def refuse_unknown(options: argparse.Namespace, unknown: list[str]) -> None:
    """Raise `UsageError` for words that no flag takes, with what holds instead of former flags."""
    row = options.command
    kinds = [kind for kind, _ in flows.KINDS.values()] if row.kind.makes_frames else [row.settings]
    former = {name: text for kind in kinds for name, text in removed_of(kind).items()}
    for word in unknown:
        flag = word.partition("=")[0]
        name = flag.removeprefix("--").replace("-", "_")
        if flag.startswith("--") and name in former:
            raise UsageError(f"{flag} is no flag any more: {former[name]}")
    if unknown:
        raise UsageError(f"unrecognized arguments: {' '.join(unknown)}")


def read_settings(options: argparse.Namespace) -> Any:
    """Make the settings from the flags, and check combinations of flags."""
    row = options.command
    if row.kind.makes_frames:
        return flows.read_flags(options)
    settings = row.settings(**{name: getattr(options, name) for name in describe(row.settings)})
    if row.then and options.then_sharpen is not None:
        if not math.isfinite(options.then_sharpen):
            raise UsageError("the time of --then-sharpen must be finite; give one such as 4096")
        row.sharpening(options.then_sharpen)
    if getattr(options, "invert_mask", False) and not options.mask:
        raise UsageError("--invert-mask needs --mask; name the mask that it turns around")
    return settings
