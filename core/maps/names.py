# SPDX-License-Identifier: GPL-3.0-or-later
"""File names of maps, as other programs expect them; imports no numerical libraries."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

SUFFIXES = {
    "normals": "normal",
    "displacement": "height",
    "curvature": "curvature",
    "occlusion": "ao",
    "bent_normals": "bent_normal",
    "thickness": "thickness",
    "colors": "basecolor",
}
"""Suffixes of file names for each map of `bake_maps`."""


def files_of_maps(target: Path, maps: Sequence[str]) -> list[Path]:
    """Return the file of each map: the target itself for one map, with suffixes for several.

    Maps that are named twice are written once.

    Examples
    --------
    >>> from pathlib import Path
    >>> from shock_filter.core.maps.names import files_of_maps
    >>> [path.name for path in files_of_maps(Path("part.png"), ["normals", "occlusion"])]
    ['part_normal.png', 'part_ao.png']
    """
    names = list(dict.fromkeys(maps))
    if len(names) == 1:
        return [target]
    ending = target.suffix
    return [target.with_name(f"{target.stem}_{SUFFIXES[name]}{ending}") for name in names]
