# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures as they are shown: rotated by their tags, with opacity as the target expects it."""

from __future__ import annotations

import numpy as np

from .image_file import EXIF, RESOLUTION, XMP, ImageFile
from .orientation import UPRIGHT, is_transposed, turned, upright_exif, upright_xmp
from .pillow import make_chunks_upright
from .tiff import is_unstated, make_tags_upright

_TIFFS = (".tif", ".tiff")


def make_upright(image_file: ImageFile) -> None:
    """Rotate a picture by its orientation, and set its tags to upright.

    Its pixels may be an array of numpy or dask.
    """
    if image_file.orientation == UPRIGHT:
        return
    image_file.pixels = turned(image_file.pixels, image_file.orientation)
    about = image_file.about
    was_transposed = is_transposed(image_file.orientation)
    if was_transposed and RESOLUTION in about:
        about[RESOLUTION] = about[RESOLUTION][::-1]
    image_file.orientation = UPRIGHT
    for name, upright in ((EXIF, upright_exif), (XMP, upright_xmp)):
        if name in about:
            about[name] = upright(about[name])
    if image_file.format == "TIFF":
        make_tags_upright(image_file)
    elif image_file.format == "PNG":
        make_chunks_upright(image_file, was_transposed)
    image_file.notes.append("turned upright, as its orientation tag said")


def fit_opacity(image_file: ImageFile, ending: str) -> None:
    """Convert colors and opacity to the convention of the target's format, if needed.

    EXR multiplies opacity into colors, and TIFF files of floats may; whole numbers do not.
    """
    pixels = image_file.pixels
    channels = pixels.shape[2] if pixels.ndim == 3 else 1
    if image_file.format != "TIFF" or channels not in (2, 4) or ending in _TIFFS:
        return
    if is_unstated(image_file) and ending != ".npy" and not pixels[..., -1].any():
        image_file.pixels = np.ascontiguousarray(pixels[..., :-1])  # otherwise invisible
        note = "its last channel, which is empty and whose meaning is not stated: left behind"
    elif is_unstated(image_file):
        note = "its last channel, whose meaning is not stated, became opacity"
    elif image_file.premultiplied:
        note = "" if ending == ".exr" else "its colors stay multiplied by opacity"
    elif ending == ".exr":
        opacity = pixels[..., -1:]
        image_file.pixels = np.concatenate([pixels[..., :-1] * opacity, opacity], axis=-1)
        note = "opacity was multiplied into its colors, as EXR files have it"
    else:
        return
    image_file.notes += [note] if note else []
