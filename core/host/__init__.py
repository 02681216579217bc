# SPDX-License-Identifier: GPL-3.0-or-later
"""The core's filters on what Blender keeps: seams, scale, symmetry, opacity. Needs no bpy.

The names below are for the rest of the add-on. They are loaded when first used, so that enabling
the extension does not import numpy.
"""

from typing import Any

from ..lazy import load

_MODULES = {
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
    "picture": ("sharpen_picture",),
    "recolored": ("Recolored",),
    "geometry": ("Sharpened", "sharpen"),
    "textures": ("Retextured", "analyse", "dilate_texture", "sharpen_texture"),
}


def __getattr__(name: str) -> Any:
    return load(__name__, _MODULES, name)
