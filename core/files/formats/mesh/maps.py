# SPDX-License-Identifier: GPL-3.0-or-later
"""The maps of materials: images that a model's faces show, in groups that belong together."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from ...document import Bools, Floats, InPlaceDocument

COLOR = "color"
"""The part of the map that leads: what is missing of it, others may lack, too."""

NORMALS = "normals"
OPACITY = "opacity"

_FIRST = (COLOR, OPACITY, NORMALS)


class MapImage(NamedTuple):
    """An image that a material shows.

    Attributes
    ----------
    key : hashable
        The document's key for the image.
    name : str
        Name shown to people.
    part : str
        What it is to the material: `COLOR`, `NORMALS`, or another word.
    ending : str
        Ending of files of its format, such as ``".png"``.
    data : bytes
        The image as a file.
    is_cut_out : bool
        Whether a material shows its opacity, which must stay then.
    """

    key: Hashable
    name: str
    part: str
    ending: str
    data: bytes
    is_cut_out: bool = False


class MapGroup(NamedTuple):
    """The maps of the materials that share any, the one of colors first.

    Attributes
    ----------
    images : list of MapImage
    faces : (t,) bool
        The triangles that show them.
    """

    images: list[MapImage]
    faces: Bools


class TexturedDocument(InPlaceDocument, Protocol):
    """A file whose materials name images, which can be replaced."""

    def read_maps(self) -> tuple[list[MapGroup], list[str]]:
        """Groups of images that triangles show, and sentences on those that cannot be read."""

    def save_maps(
        self, path: Path, positions: Floats, moved: Bools, images: Mapping[Any, bytes]
    ) -> list[str]:
        """Write the file with other positions and images (PNG, by their keys); returns notes."""


def grouped(uses: Sequence[tuple[Bools, list[MapImage]]]) -> list[MapGroup]:
    """Join materials, each with its triangles and images, that share an image."""
    groups: list[MapGroup] = []
    cut_out = {image.key for _, images in uses for image in images if image.is_cut_out}
    for faces, images in uses:
        keys = {image.key for image in images}
        joined, apart = list(images), []
        for group in groups:
            if keys.isdisjoint(image.key for image in group.images):
                apart.append(group)
                continue
            faces = faces | group.faces
            joined = group.images + joined
        known = {
            image.key: image._replace(is_cut_out=image.key in cut_out) for image in reversed(joined)
        }
        groups = [*apart, MapGroup(list(known.values()), faces)] if known else groups
    return [group._replace(images=sorted(group.images, key=_rank)) for group in groups]


def _rank(image: MapImage) -> int:
    return _FIRST.index(image.part) if image.part in _FIRST else len(_FIRST)
