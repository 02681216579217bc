# SPDX-License-Identifier: GPL-3.0-or-later
"""Images made from a mesh file alone: distances, streaks, patterns."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..atlas import TextureAtlas
from ..base.progress import phase, reporting
from ..errors import ShockError
from ..mesh.directions import named_directions
from ..texture.texels import check_covered, grays_of
from .image_formats import Pixels, image_size, read_grays
from .images import write_image_file
from .output import DEFAULTS, Options, Outcome
from .textures import RAW, read_textured_mesh

FILES = {"painted": "image", "scale_map": "rates"}
"""Sources that are given as names of files, and the functions' names for their values."""


def field_file(
    function: Callable[..., Pixels],
    mesh: str | Path,
    target: str | Path,
    size: tuple[int, int] | str | Path,
    sources: Mapping[str, Any],
    options: Options = DEFAULTS,
) -> Outcome:
    """Make an image on the surface of a mesh and write it.

    Parameters
    ----------
    function : callable
        ``function(mesh, uv, size=, atlas=, **sources)`` returns (h, w) floats with row 0 at v = 0;
        see `registry.FIELD`.
    mesh, options
        As in :func:`shock_filter.core.files.textures.filter_texture_file`.
    target : path
        NumPy, TIFF and EXR files hold the values; PNG files 16 bits, others 8 bits, from 0 to 1.
    size : (int, int), or path
        Height and width in texels, or an image file of the wanted size.
    sources : mapping
        Further arguments of the function; images as paths, under the names of their flags.
    """
    target = Path(target)
    height, width = size if isinstance(size, tuple) else image_size(size, options.any_size, False)
    surface = read_textured_mesh(mesh, options.material, options.any_size)
    words = {FILES.get(name, name): value for name, value in sources.items()}
    for flag, name in FILES.items():
        if flag in sources:
            grays = read_grays(
                Path(sources[flag]), flag.replace("_", " "), options.any_size, upright=False
            )
            words[name] = np.ascontiguousarray(grays[::-1])
    with reporting(options.progress):
        if "along" in words:
            words["directions"], words["at"] = named_directions(surface.mesh, words.pop("along"))
        with phase(0.0, 0.3, "Finding the charts"):
            atlas = TextureAtlas(surface.mesh, surface.uv, size=(height, width))
            check_covered(atlas)
        with phase(0.3, 1.0, "Generating"):
            made = function(surface.mesh, surface.uv, size=(height, width), atlas=atlas, **words)
    values = grays_of(made, atlas.inside)
    depth = np.uint16 if target.suffix.lower() == ".png" else np.uint8
    pixels = field_pixels(values, atlas.inside, target, depth)
    write_image_file(target, np.ascontiguousarray(pixels[::-1]), options.overwrite)
    notes = (*surface.notes, *atlas.report.sentences(made=True))
    return field_outcome(values, atlas.inside, notes)


def field_pixels(values: Pixels, inside: Pixels, target: Path, depth: type) -> Pixels:
    """Convert values to what the target's format holds: floats, or whole numbers of `depth`.

    Raises
    ------
    ShockError
        If the format holds only numbers from 0 to 1, and there are others.
    """
    if target.suffix.lower() in RAW:
        return values
    shown, whole = values[inside], np.iinfo(depth).max
    least, largest = shown.min(initial=0.0), shown.max(initial=0.0)
    negative = least < -0.5 / whole  # others are rounded to 0
    if negative or not largest <= 1.0:
        reached = f"from {least:g} to {largest:g}" if negative else f"{largest:g}"
        raise ShockError(
            f"The values reach {reached}, and {target.suffix} files hold 0 to 1; choose another"
            " look, or write .npy, .tif or .exr."
        )
    return np.rint(whole * np.clip(values, 0.0, 1.0)).astype(depth)


def field_outcome(values: Pixels, inside: Pixels, notes: tuple[str, ...]) -> Outcome:
    """Report the range of the values, and the part of the image that they cover."""
    shown = values[inside]
    low, high = shown.min(initial=np.inf), shown.max(initial=-np.inf)
    done = f"values {low:.3g} to {high:.3g} on {{changed}} of {{total}} texels"
    return Outcome(values.size, len(shown), notes, done)
