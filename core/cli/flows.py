# SPDX-License-Identifier: GPL-3.0-or-later
"""The flags of ``visualize-flow``, whose three kinds of pictures have different settings."""

from __future__ import annotations

import argparse
from typing import Any, NamedTuple

from ..settings import ConvolutionSettings, DyeSettings, NoiseSettings, describe
from .inputs import FileName, UsageError, read_size

KINDS: dict[str, tuple[Any, str]] = {
    NoiseSettings.draws: (NoiseSettings, "noise that moves"),
    DyeSettings.draws: (DyeSettings, "dye that is released and carried along"),
    ConvolutionSettings.draws: (
        ConvolutionSettings,
        "a still picture of streaks; OUT is an image",
    ),
}
ARRAYS = (".npy", ".npz", ".nc", ".nc4", ".cdf", ".zarr")
"""Endings of files of velocities that are neither images nor meshes."""

_FRAMES = 100
_FPS = 25.0


class Shown(NamedTuple):
    """What is shown.

    Attributes
    ----------
    settings : NoiseSettings, DyeSettings or ConvolutionSettings
    under : NoiseSettings or None
        The noise below dye.
    frames : int
    """

    settings: Any
    under: Any
    frames: int


def add_flags(parser: argparse.ArgumentParser, add_settings: Any) -> None:
    """Add all flags; `add_settings` adds those of a settings class, except some."""
    meanings = ", ".join(f"{name}: {meaning}" for name, (_, meaning) in KINDS.items())
    parser.add_argument(
        "--kind", choices=list(KINDS), default="noise", help=f"{meanings} (default noise)"
    )
    parser.add_argument(
        "--frames",
        type=int,
        default=_FRAMES,
        metavar="N",
        help=f"how many frames there are (default {_FRAMES}, 1 for lines)",
    )
    parser.add_argument(
        "--size", type=read_size, metavar="WxH", help="of the frames; that of IN if left out"
    )
    parser.add_argument(
        "--fps",
        type=float,
        default=_FPS,
        metavar="N",
        help=f"frames a second, of animations and videos (default {_FPS:g})",
    )
    parser.add_argument(
        "--bits", type=int, choices=[8, 16], default=8, help="of PNG files (default 8)"
    )
    parser.add_argument(
        "--background",
        type=FileName,
        metavar="IMAGE",
        help="picture behind the noise or the dye, of the frames' size; frames have its size if"
        " there is no --size",
    )
    parser.add_argument(
        "--colors",
        action="store_true",
        help="noise in colors that say how fast it is, from dark blue to yellow",
    )
    parser.add_argument(
        "--source",
        metavar="X,Y",
        type=_points,
        action="append",
        default=[],
        dest="sources",
        help="dye comes from here, in shares of the width from the left and of the height from"
        " below; X,Y,X,Y,... is a line (may be repeated; spots all over the image if left out)",
    )
    parser.add_argument(
        "--source-width", type=float, default=16.0, metavar="N", help="in pixels (default 16)"
    )
    parser.add_argument(
        "--source-every",
        type=int,
        default=1,
        metavar="N",
        help="a release begins after so many frames, and lasts half of them; 1 always, 0 once"
        " (default 1)",
    )
    parser.add_argument(
        "--over-noise", action="store_true", help="lay dye over noise that moves with it"
    )
    known: set[str] = set()
    for name, (settings, _) in KINDS.items():
        add_settings(parser, settings, f"settings of {name}" if known else "settings", known)
        known |= describe(settings).keys()


def read_flags(options: argparse.Namespace) -> Shown:
    """Make the settings of the chosen kind, and refuse flags of the others."""
    settings, _ = KINDS[options.kind]
    fields = describe(settings)
    under = NoiseSettings if options.kind == "dye" and options.over_noise else None
    wanted = fields.keys() | (describe(under).keys() if under else set())
    for kind, (other, _) in KINDS.items():
        for name, (_, default, _) in describe(other).items():
            if name not in wanted and getattr(options, name) != default:
                flag = name.replace("_", "-")
                raise UsageError(f"--{flag} is of --kind {kind}; leave it out, or choose that kind")
    of_dye = {"--source": options.sources, "--over-noise": options.over_noise}
    for flag, given in of_dye.items():
        if given and options.kind != "dye":
            raise UsageError(f"{flag} is of --kind dye; leave it out, or choose that kind")
    if options.colors and options.kind != "noise":
        raise UsageError("--colors is of --kind noise; leave it out, or choose that kind")
    if options.background and options.kind == "lines":
        raise UsageError("lines have no background; leave --background out, or choose noise")
    return Shown(
        settings(**{name: getattr(options, name) for name in fields}),
        under and under(**{name: getattr(options, name) for name in describe(under)}),
        1 if options.kind == "lines" else options.frames,
    )


def look_of(shown: Shown, options: argparse.Namespace, background: Any) -> Any:
    """Return how frames look and are written, over a background that was read."""
    from ..files.flows import Look

    return Look(
        shown.settings,
        shown.frames,
        options.size,
        options.fps,
        options.bits,
        background,
        options.colors,
        options.sources,
        options.source_width,
        options.source_every,
        shown.under,
    )


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Add the flags that say how a file of velocities is interpreted."""
    parser.add_argument(
        "--y-axis",
        choices=["up", "down"],
        default="up",
        help="where the second component of flow maps and arrays points: up, or down as in maps"
        " for Unreal and DirectX (default up)",
    )
    parser.add_argument(
        "--variables",
        nargs=2,
        metavar=("U", "V"),
        help="names of both components in NetCDF, Zarr and .npz files; give it after OUT. Found by"
        " itself where they are u and v, or named as the CF conventions say",
    )
    parser.add_argument(
        "--select",
        metavar="NAME=N",
        type=_place,
        action="append",
        default=[],
        help="which one to take of a dimension of NetCDF and Zarr files, such as depth=0, counted"
        " from 0 (may be repeated)",
    )


def how_to_read(options: argparse.Namespace) -> dict[str, Any]:
    """Collect these flags, for `files.velocities.How`."""
    names = ("y_axis", "variables", "attribute", "material", "any_size")
    given = vars(options)
    found = {name: given[name] for name in names if name in given}
    return found | {"select": dict(options.select)}


def _points(text: str) -> list[tuple[float, float]]:
    numbers = [float(word) for word in text.split(",")]
    if len(numbers) % 2:
        raise ValueError
    return list(zip(numbers[::2], numbers[1::2], strict=True))


_points.__name__ = "place, such as 0.5,0.5"


def _place(text: str) -> tuple[str, int]:
    name, _, number = text.partition("=")
    if not name:
        raise ValueError
    return name, int(number)


_place.__name__ = "choice, such as depth=0"
