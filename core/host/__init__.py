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
    from . import (  # noqa: F401
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
        registered,
        screen_colors,
        strokes,
        symmetry,
        textures,
        welding,
    )


def __getattr__(name: str) -> Any:
    try:
        return import_module(f".{name}", __name__)
    except ModuleNotFoundError as error:
        if error.name != f"{__name__}.{name}":
            raise
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}") from None
