# SPDX-License-Identifier: GPL-3.0-or-later
"""Carries out commands on files outside Blender."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..registry import COLORS, FIELD, FLOW, GEOMETRY, IMAGE, MASK, TEXTURE, Kind
from ..settings import named, value_of
from . import flows
from .commands import BAKE_MAPS, COMMANDS, MAPS, MODEL, REPAIR_MODEL, TILES, Command
from .inputs import FileName, picture_of
from .parsing import add_gain_map, add_mask, add_others, add_sources, sources_of

if TYPE_CHECKING:
    from ..files.output import Outcome

_IMAGES = "PNG, JPEG, TIFF, EXR, BMP, WebP and NumPy (.npy) files"
_MESHES = "OBJ, PLY, GLB and glTF files with texture coordinates"
_FORMATS = {
    GEOMETRY: "PLY, OBJ, STL, OFF, GLB and glTF files",
    COLORS: "PLY, OBJ, GLB and glTF files, which keep their format",
    IMAGE: f"{_IMAGES}; 16 bits stay 16 bits; Zarr arrays (.zarr) and tiled TIFF of any size",
    TEXTURE: f"{_IMAGES}; 16 bits stay 16 bits; on {_MESHES}",
    FIELD: f"from {_MESHES} to {_IMAGES}; NumPy, TIFF and EXR hold floats, PNG 16 bits",
    FLOW: "from flow maps (PNG, JPEG, TIFF, EXR, BMP, WebP), NumPy (.npy, .npz), NetCDF and Zarr"
    " files, and PLY files with texture coordinates and vectors at their vertices",
    MODEL: "GLB, glTF and OBJ files with PNG, JPEG, WebP, TIFF or BMP textures; what is repaired is"
    " stored as PNG",
    BAKE_MAPS.kind: f"from {_MESHES} to {_IMAGES}; NumPy, TIFF and EXR hold floats, PNG 16 bits;"
    " the detailed mesh may also be an STL or OFF file",
    MASK: f"from {_MESHES} to {_IMAGES}; NumPy, TIFF and EXR hold numbers, -1 for none, all others"
    " a picture",
}


class FileBackend:
    """Files outside Blender."""

    prog = "shock-filter"
    offered = (*COMMANDS, REPAIR_MODEL, BAKE_MAPS)

    def formats(self, command: Command) -> str:
        """Name the files that a command reads and writes."""
        return _FORMATS[command.kind]

    def add_arguments(self, parser: argparse.ArgumentParser, command: Command) -> None:
        """Add the flags for sizes, masks and materials."""
        parser.add_argument(
            "--any-size",
            action="store_true",
            help="read files, too, whose header claims far more than their size can hold",
        )
        parser.add_argument(
            "--cluster",
            metavar="ADDRESS",
            help="have files done by the workers of the Dask scheduler there, such as"
            " tcp://host:8786, which see the same disk; local starts a worker for each core here",
        )
        parser.add_argument(
            "--resume",
            action="store_true",
            help="skip outputs that this version has made with --resume or --cluster, from the same"
            " files and with the same settings; make those again where one of these differs",
        )
        if command.kind.makes_frames:
            parser.add_argument(
                "--attribute",
                metavar="NAME",
                help="vectors of a mesh: flow for flow_x, flow_y and flow_z; the only ones if left"
                " out",
            )
        if command.kind.on_mesh or command.kind.is_drawn or command.kind.makes_frames:
            parser.add_argument(
                "--material",
                metavar="NAME",
                help="only the faces with this material show the texture; all do if left out",
            )
        if command.kind is MODEL:
            parser.add_argument(
                "--picture",
                type=os.path.abspath,
                metavar="PICTURE",
                help="also draw the model before and after; of several inputs, each gets its file"
                " name in front of this one: a.glb seen.png",
            )
        if command.name == TILES:
            parser.add_argument(
                "--picture",
                type=os.path.abspath,
                metavar="PICTURE",
                help="also draw the result three times along each joined axis; of several inputs,"
                " each gets its file name in front of this one: a.png tiles.png",
            )
        if command is BAKE_MAPS:
            parser.add_argument(
                "--map",
                choices=MAPS,
                required=True,
                nargs="+",
                action="extend",
                help="what to bake in one run; of several maps, OUT part.png becomes"
                " part_normal.png, part_ao.png and so on",
            )
            parser.add_argument(
                "--high",
                type=FileName,
                metavar="FILE",
                help="detailed mesh in the same place, of which the maps are",
            )
        if command.takes_mask:
            of_meshes = (
                "vertex property of PLY files that says how much is done to each vertex: 0 keeps"
                " it, 1 (or the largest whole number of its type) changes it fully"
            )
            add_mask(parser, command, of_meshes)
        if command.takes_guide:
            parser.add_argument(
                "--guide",
                type=FileName,
                metavar="FILE",
                help="image of the same size whose flow moves the values of IN, so that several"
                " maps get their borders in the same places",
            )
        if command.takes_known:
            parser.add_argument(
                "--like",
                type=FileName,
                metavar="FILE",
                help="image whose blur and noise count instead of those of each IN, such as the"
                " first frame of a sequence",
            )
        if command.takes_gain:
            add_gain_map(parser)
        if command.takes_others:
            add_others(parser)
        add_sources(parser, command)

    def filter(
        self,
        command: Command,
        source: str,
        target: Path,
        settings: Any,
        options: argparse.Namespace,
        progress: Callable[[float, str], bool],
    ) -> Outcome:
        """Filter one file into another."""
        from ..files.output import Options

        given = vars(options)  # not all commands have all flags
        names = {field.name for field in fields(Options)} & given.keys()
        asked = Options(progress=progress, **{name: given[name] for name in names})
        if command.takes_gain:
            asked = replace(asked, gain=value_of(settings, "gain"))
        if command.kind is MODEL:
            picture = picture_of(source, options)
            return command.load()(source, target, settings, asked, picture=picture)
        if command is BAKE_MAPS:
            size = options.size or options.like
            words = {"high": options.high, "size": size, "settings": settings}
            return command.load()(source, target, options.map, options=asked, **words)
        if command.kind is MASK:
            size = options.size or options.like
            return command.load()(source, target, settings.kind, size, asked)
        if command.kind is FLOW:
            return _visualize(source, target, settings, options, asked)
        if command.kind is FIELD:
            from ..files.fields import field_file

            function = partial(command.function(), settings=settings)
            size = options.size or options.like
            return field_file(function, source, target, size, sources_of(options), asked)
        files = [options.mesh, source, target] if command.kind.on_mesh else [source, target]
        function = command.function(options.then_sharpen if command.then else None)
        words = {}
        if named(command.settings, "enlargement"):
            words["times"] = value_of(settings, "enlargement")
        filtering = partial(function, settings=settings)
        if command.name == TILES and (picture := picture_of(source, options)):
            return _tile_file()(filtering, *files, asked, picture, settings.axes)
        if command.takes_known and options.like:
            filtering = partial(filtering, known=_measured(options.like, settings, asked))
        return _pipeline(command.kind)(filtering, *files, asked, **words)


def _measured(path: str, settings: Any, asked: Any) -> Any:
    # The measurements of another image.
    from ..color.image_sharpening import measure_image
    from ..files.image_formats import read_image

    pixels = read_image(Path(path), asked.any_size).pixels
    if pixels.dtype.name == "float16":
        pixels = pixels.astype("float32")
    return measure_image(pixels, settings)


def _pipeline(kind: Kind) -> Any:
    # The function that reads, filters and writes files of this kind.
    if kind is GEOMETRY:
        from ..files.meshes import filter_mesh_file

        return filter_mesh_file
    if kind is COLORS:
        from ..files.meshes import filter_colors_file

        return filter_colors_file
    if kind is IMAGE:
        from ..files.images import filter_image_file

        return filter_image_file
    from ..files.textures import filter_texture_file

    return filter_texture_file


def _tile_file() -> Any:
    from ..files.images import filter_tile_file

    return filter_tile_file


def _visualize(
    source: str, target: Path, shown: flows.Shown, options: argparse.Namespace, asked: Any
) -> Outcome:
    from ..files.flows import check_target_of_flow, read_background, write_flow
    from ..files.velocities import How, read_velocity

    behind = options.background and read_background(options.background, options.any_size)
    look = flows.look_of(shown, options, behind)
    check_target_of_flow(target, look, options.overwrite)
    return write_flow(read_velocity(source, How(**flows.how_to_read(options))), target, look, asked)
