# SPDX-License-Identifier: GPL-3.0-or-later
"""Shock filters on meshes and images: arrays in, arrays out.

The names below are the public interface. They are loaded when first used, so that importing
this package (Blender does when the extension is enabled) needs neither numba nor scipy.

References
----------
F. Prada, M. Kazhdan: Unconditionally Stable Shock Filters for Image and Geometry Processing,
2015.
"""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

from .errors import (
    Cancelled,
    InvalidMesh,
    InvalidSettings,
    InvalidSignal,
    InvalidUV,
    ShockError,
    SolverError,
)
from .settings import (
    BeltramiGeometrySettings,
    BeltramiMeshSettings,
    BeltramiSettings,
    DilateSettings,
    FitSettings,
    GeometrySettings,
    ImageSettings,
    ShockSettings,
    TextureSettings,
)

if _TYPE_CHECKING:
    from .atlas import TextureAtlas, UVReport
    from .beltrami.images import beltrami_image, beltrami_manifold
    from .beltrami.meshes import (
        beltrami_corner_signal,
        beltrami_joint,
        beltrami_mesh,
        beltrami_vertex_signal,
    )
    from .fit import fit_to_normals
    from .flow import flow_field
    from .images import sharpen_image
    from .mesh import TriangleMesh, weld, weld_borders
    from .pde import osher_rudin_image
    from .shock import geometry_flow, sharpen_geometry, sharpen_normals
    from .signals import sharpen_corner_signal, sharpen_vertex_signal
    from .textures import dilate_texture, sharpen_texture

_LAZY = {
    "TriangleMesh": "mesh",
    "weld": "mesh",
    "weld_borders": "mesh",
    "flow_field": "flow",
    "fit_to_normals": "fit",
    "geometry_flow": "shock",
    "sharpen_normals": "shock",
    "sharpen_geometry": "shock",
    "sharpen_vertex_signal": "signals",
    "sharpen_corner_signal": "signals",
    "sharpen_image": "images",
    "osher_rudin_image": "pde",
    "TextureAtlas": "atlas",
    "UVReport": "atlas",
    "beltrami_image": "beltrami.images",
    "beltrami_manifold": "beltrami.images",
    "beltrami_vertex_signal": "beltrami.meshes",
    "beltrami_corner_signal": "beltrami.meshes",
    "beltrami_mesh": "beltrami.meshes",
    "beltrami_joint": "beltrami.meshes",
    "dilate_texture": "textures",
    "sharpen_texture": "textures",
}

__all__ = [
    "BeltramiGeometrySettings",
    "BeltramiMeshSettings",
    "BeltramiSettings",
    "Cancelled",
    "DilateSettings",
    "FitSettings",
    "GeometrySettings",
    "ImageSettings",
    "InvalidMesh",
    "InvalidSettings",
    "InvalidSignal",
    "InvalidUV",
    "ShockError",
    "ShockSettings",
    "SolverError",
    "TextureAtlas",
    "TextureSettings",
    "TriangleMesh",
    "UVReport",
    "beltrami_corner_signal",
    "beltrami_image",
    "beltrami_joint",
    "beltrami_manifold",
    "beltrami_mesh",
    "beltrami_vertex_signal",
    "dilate_texture",
    "fit_to_normals",
    "flow_field",
    "geometry_flow",
    "osher_rudin_image",
    "sharpen_corner_signal",
    "sharpen_geometry",
    "sharpen_image",
    "sharpen_normals",
    "sharpen_texture",
    "sharpen_vertex_signal",
    "weld",
    "weld_borders",
]


def __getattr__(name: str) -> _Any:
    if name in _LAZY:
        value = getattr(_import_module("." + _LAZY[name], __name__), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
