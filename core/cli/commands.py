# SPDX-License-Identifier: GPL-3.0-or-later
"""The commands, and what differs between those who carry them out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from ..registry import FILTERS, MASK, Filter, Kind

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable
    from pathlib import Path

    from ..files.output import Outcome


class Command(NamedTuple):
    """What people may type first.

    Attributes
    ----------
    name : str
        The word.
    kind : Kind
        What it works on.
    about : str
        What it does.
    filter : Filter or None
        The filter that it runs; its settings become flags.
    """

    name: str
    kind: Kind
    about: str
    filter: Filter | None = None

    @property
    def settings(self) -> type | None:
        """The filter's settings class."""
        return None if self.filter is None else self.filter.settings

    @property
    def takes_mask(self) -> bool:
        """Whether a mask can protect parts of what is filtered."""
        return self.filter is not None and self.filter.takes_mask


TEXTURE_MASK = Command("texture-mask", MASK, "draw what each texel of a mesh's texture is")
COMMANDS = (
    *(Command(row.command, row.kind, row.about, row) for row in FILTERS),
    TEXTURE_MASK,
)

MASKS = {
    "active": "texels that linear sampling of some face reads",
    "boundary": "active texels that charts cover only in part",
    "face": "the face in which the texel's center lies",
    "chart": "the chart of that face",
    "count": "how many charts read the texel",
}
"""What `TEXTURE_MASK` can draw."""


class Backend(Protocol):
    """What differs between Blender and plain Python."""

    prog: str

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
