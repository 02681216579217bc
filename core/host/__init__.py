# SPDX-License-Identifier: GPL-3.0-or-later
"""The filters on what a host program such as Blender keeps: seams, scale, symmetry, opacity.

Everything here is arrays. Modules are imported when first used, as ``host.NAME``, so that a host
can start without numpy. `inputs` and what shows results need numpy only. `geometry`, `colors`,
`images`, `textures`, `denoising` and `flow` bring the compiled kernels along, which takes a while:
a host names their functions where they run, on a thread of its own.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import (
        colors,
        crop,
        denoising,
        dials,
        edge_marks,
        flow,
        forgetting,
        geometry,
        images,
        inputs,
        mosaic,
        patch,
        recolored,
        screen_colors,
        strokes,
        symmetry,
        textures,
        welding,
    )

__all__ = [
    "colors",
    "crop",
    "denoising",
    "dials",
    "edge_marks",
    "flow",
    "forgetting",
    "geometry",
    "images",
    "inputs",
    "mosaic",
    "patch",
    "recolored",
    "screen_colors",
    "strokes",
    "symmetry",
    "textures",
    "welding",
]

_OLD = {  # transition: names that are asked for without their module
    "inputs": ("Denoising", "PaintedSurface"),
    "colors": ("sharpen_colors",),
    "denoising": (
        "Both",
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
    for module, names in _OLD.items():  # transition
        if name in names and name[0].islower():  # transition: loads kernels when it is called
            return lambda *given: getattr(import_module(f".{module}", __name__), name)(*given)
        if name in names:  # transition
            return getattr(import_module(f".{module}", __name__), name)
    if name in __all__:
        return import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
