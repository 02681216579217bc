# SPDX-License-Identifier: GPL-3.0-or-later
"""The filters on what a host program such as Blender keeps: seams, scale, symmetry, opacity.

Everything here is arrays. Modules are imported when first used, as ``host.NAME``, so that a host
can start without numpy.
"""

from importlib import import_module
from typing import Any

_OLD = {  # transition: names that are asked for without their module
    "colors": ("sharpen_colors",),
    "denoising": (
        "Both",
        "Denoising",
        "PaintedSurface",
        "denoise_both",
        "denoise_colors",
        "denoise_picture",
        "denoise_shape",
    ),
    "flow": ("flow_of_colors", "flow_of_shape"),
    "images": ("sharpen_picture",),
    "recolored": ("Recolored",),
    "geometry": ("Sharpened", "sharpen"),
    "textures": ("Retextured", "analyse", "dilate_texture", "sharpen_texture"),
}


def __getattr__(name: str) -> Any:
    for module, names in _OLD.items():
        if name in names:
            return getattr(import_module(f".{module}", __name__), name)
    try:
        return import_module(f".{name}", __name__)
    except ModuleNotFoundError as error:
        if error.name != f"{__name__}.{name}":
            raise
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}") from None
