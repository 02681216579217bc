# SPDX-License-Identifier: GPL-3.0-or-later
"""The commands, and the interface of the backends that carry them out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from ..maps.names import SUFFIXES
from ..registry import FILTERS, MASK, Filter, Kind
from ..settings import BakeSettings, MaskSettings, ModelSettings

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable
    from pathlib import Path

    from ..files.output import Outcome

Command = Filter
"""The row of a command, also of commands that are no filters."""


def _texture_mask_file() -> Any:
    from ..files.textures import texture_mask_file

    return texture_mask_file


TEXTURE_MASK = Command(
    "texture_mask",
    "files.textures",
    MaskSettings,
    MASK,
    "texture-mask",
    "draw what each texel of a mesh's texture is",
    _texture_mask_file,
    takes_mask=False,
)
COMMANDS = (*FILTERS, TEXTURE_MASK)
"""The commands of all backends."""

MODEL = Kind("model", "model files with textures")
"""Meshes with the images that their materials show."""


def _repair_model_file() -> Any:
    from ..files.models import repair_model_file

    return repair_model_file


TILES = "make_tileable"
"""Name of the command that can also draw how its result tiles."""

REPAIR_MODEL = Command(
    "repair_model",
    "files.models",
    ModelSettings,
    MODEL,
    "repair-model",
    "repair models as they come from generators and photogrammetry, with all their textures",
    _repair_model_file,
    takes_mask=False,
)
"""Only outside Blender, where models with their textures are files."""


def _bake_file() -> Any:
    from ..files.baking import bake_file

    return bake_file


MAPS = tuple(name for name in SUFFIXES if name != "colors")
"""Maps that can be baked: those of `core.bake_maps` that need no colors."""

BAKE_MAPS = Command(
    "bake_maps",
    "files.baking",
    BakeSettings,
    Kind("bake", "mesh file with texture coordinates", is_drawn=True),
    "bake-maps",
    "bake maps of a mesh, or of a detailed mesh onto a simple one",
    _bake_file,
    takes_mask=False,
)
"""Only outside Blender, where both meshes are files."""


class Backend(Protocol):
    """The parts that differ between Blender and plain Python."""

    prog: str
    offered: tuple[Command, ...]

    def formats(self, command: Command) -> str:
        """Name the files that a command reads and writes."""

    def add_arguments(self, parser: argparse.ArgumentParser, command: Command) -> None:
        """Add the flags that only this backend has."""

    def filter(
        self,
        command: Command,
        source: str,
        target: Path,
        settings: Any,
        options: argparse.Namespace,
        progress: Callable[[float, str], bool],
    ) -> Outcome:
        """Filter one file into another; raises ShockError or OSError."""
