# SPDX-License-Identifier: GPL-3.0-or-later
"""The flags that only Blender's command line has, and the operator properties that they set."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict
from typing import Any

from ...core.cli import Command
from ...core.cli.flows import ARRAYS
from ...core.cli.parsing import add_gain_map, add_mask, add_others, add_sources
from ...core.registry import COLORS, FIELD, FLOW, GEOMETRY, IMAGE, MASK, TEXTURE
from ..modes import MODES, Mode, Target
from .blender_files import operator

_AXES = ["x", "y", "z"]
_IMAGES = "PNG, JPEG, TIFF, EXR, HDR, Targa, BMP and WebP files"
_SCENES = "whatever this Blender reads and writes, such as blend, OBJ, PLY, STL, glTF, FBX, USD"

FORMATS = {
    GEOMETRY: _SCENES,
    COLORS: _SCENES,
    IMAGE: f"{_IMAGES}, which keep their format",
    TEXTURE: f"{_IMAGES}, which keep their format, on whatever meshes this Blender reads",
    FIELD: f"from whatever this Blender reads to {_IMAGES}; EXR and NumPy hold floats, all others"
    " 8 bits",
    FLOW: f"from {_IMAGES} as flow maps, {', '.join(ARRAYS)} files, and meshes that this Blender"
    " reads",
    MASK: f"from whatever this Blender reads to {_IMAGES}; EXR and NumPy hold numbers",
}
"""The files that commands on each kind of data read and write."""


def mode_of(command: Command) -> tuple[Mode, Target]:
    """Find the mode, and its target, that runs a command's filter."""
    name = command.name
    return next((mode, each) for mode in MODES for each in mode.targets if each.filter == name)


def add_arguments(parser: argparse.ArgumentParser, command: Command) -> None:
    """Add the flags for objects, vertex groups and color attributes."""
    if command.kind is IMAGE:
        return
    if command.takes_mask:
        of_meshes = (
            "vertex group that says how much is done to each vertex: 0 keeps it, 1 changes it fully"
        )
        add_mask(parser, command, of_meshes)
    if command.takes_gain:
        add_gain_map(parser)
    if command.takes_others:
        add_others(parser)
    add_sources(parser, command)
    parser.add_argument(
        "--object",
        metavar="NAME",
        action="append",
        dest="objects",
        help="take this object only, even if it is hidden (may be repeated); without it, all"
        " visible meshes of the scene",
    )
    if command.kind is FLOW:
        parser.add_argument(
            "--attribute",
            metavar="NAME",
            default="",
            help="attribute of the meshes: vectors, or numbers in whose way it flows",
        )
    if command.kind is COLORS:
        parser.add_argument(
            "--attribute",
            metavar="NAME",
            default="",
            help="color attribute to work on; each mesh's active one if left out",
        )
        parser.add_argument(
            "--live",
            action="store_true",
            help="keep the colors and let a modifier change them, whose Amount sets the strength"
            " later; OUT must be a blend file, or it may hold the old colors",
        )
    if command.kind is GEOMETRY:
        _add_shape_flags(parser, command)


def _add_shape_flags(parser: argparse.ArgumentParser, command: Command) -> None:
    """Add the properties of the operators that are no settings, with their descriptions."""
    known = operator(f"shock_filter.{mode_of(command)[0].operator}").get_rna_type().properties
    normals = known["custom_normals"]
    meanings = [f"{i.identifier.lower()}: {i.description}." for i in normals.enum_items]
    parser.add_argument(
        "--custom-normals",
        choices=[item.identifier.lower() for item in normals.enum_items],
        default=normals.default.lower(),
        help=f"{normals.description}. {' '.join(meanings)} (default {normals.default.lower()})",
    )
    parser.add_argument(
        "--mark-sharp", action="store_true", help=f"{known['mark_sharp'].description}."
    )
    angle = known["sharp_angle"]
    parser.add_argument(
        "--sharp-angle",
        type=_angle,
        metavar="N",
        help=f"{angle.description}. Implies --mark-sharp. (default"
        f" {math.degrees(angle.default):g}, 0 to 180, degrees)",
    )
    parser.add_argument(
        "--mirror",
        choices=_AXES,
        action="append",
        default=[],
        help="keep what is symmetric across this plane of the object so, as the mesh's mirror"
        " option does (may be repeated); meshes whose option is on stay symmetric without it",
    )
    output = parser.add_mutually_exclusive_group()
    output.add_argument(
        "--new-object",
        action="store_true",
        help="take what is seen of each object, with modifiers and shape keys applied, and put the"
        " new shape into a new object in its place; the original is hidden",
    )
    output.add_argument(
        "--new-shape-key",
        action="store_true",
        help="keep the mesh and put the new shape into a new shape key of value 1, whose slider"
        " sets the strength later; OUT must be of a format with shape keys, or it holds the new"
        " shape",
    )
    output.add_argument(
        "--live",
        action="store_true",
        help="keep the mesh and let a modifier move its vertices, whose Amount sets the strength"
        " later; OUT must be a blend file, or it holds the new shape",
    )


def _output(options: argparse.Namespace) -> str:
    if options.new_object:
        return "OBJECT"
    if options.live:
        return "LIVE"
    return "SHAPE_KEY" if options.new_shape_key else "MESH"


def _angle(text: str) -> float:
    """Convert an angle in degrees to radians."""
    degrees = float(text)
    if not 0.0 <= degrees <= 180.0:
        raise ValueError
    return math.radians(degrees)


_angle.__name__ = "angle from 0 to 180"  # argparse says "invalid angle ... value"


def values_of(command: Command, settings: Any, options: argparse.Namespace) -> dict[str, Any]:
    """Return the operator properties that settings and flags give."""
    mode, target = mode_of(command)
    values = {target.prefix + name: value for name, value in asdict(settings).items()}
    if target.steady_state and math.isinf(settings.time):
        values |= {target.time: 0.0, target.steady_state: True}
    if target.key:
        values["target"] = target.key
    if mode.follows is not None and options.then_sharpen is not None:
        values |= {"then_sharpen": True, "sharpen_time": options.then_sharpen}
    if not command.kind.is_image:
        values |= {"vertex_group": options.mask or "", "invert_mask": options.invert_mask}
    if command.kind is COLORS:
        values["attribute"] = options.attribute
        if options.live:
            values["output"] = "LIVE"
    if command.kind is GEOMETRY:
        values |= {
            "output": _output(options),
            "custom_normals": options.custom_normals.upper(),
            "mark_sharp": options.mark_sharp or options.sharp_angle is not None,
        }
        if options.sharp_angle is not None:
            values["sharp_angle"] = options.sharp_angle
    return values
