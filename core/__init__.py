# SPDX-License-Identifier: GPL-3.0-or-later
"""Shock filters on meshes and images: arrays in, arrays out.

The names below are the public interface. They are loaded when first used, so that importing
this package (Blender does when the extension is enabled) needs neither numba nor scipy.

References
----------
Docstrings cite these papers by letter, section and equation.

.. [A] F. Prada, M. Kazhdan: Unconditionally Stable Shock Filters for Image and Geometry Processing.
   Computer Graphics Forum 34(5), 2015, doi:10.1111/cgf.12708.
.. [B] F. Prada, M. Kazhdan, M. Chuang, H. Hoppe: Gradient-Domain Processing within a Texture Atlas.
   ACM Transactions on Graphics 37(4), 2018, doi:10.1145/3197517.3201317.
.. [C] A. Spira, R. Kimmel, N. Sochen: A Short-Time Beltrami Kernel for Smoothing Images and
   Manifolds. IEEE Transactions on Image Processing 16(6), 2007, doi:10.1109/TIP.2007.894253.
.. [D] B. Jobard, G. Erlebacher, M. Y. Hussaini: Lagrangian-Eulerian Advection for Unsteady Flow
   Visualization. IEEE Visualization 2001, doi:10.1109/VISUAL.2001.964493.
"""

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
from .lazy import load as _load
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
    from .filters.beltrami.images import beltrami_image, beltrami_manifold
    from .filters.beltrami.meshes import (
        beltrami_corner_signal,
        beltrami_joint,
        beltrami_mesh,
        beltrami_vertex_signal,
    )
    from .filters.fit import fit_to_normals
    from .filters.geometry import geometry_flow, sharpen_geometry, sharpen_normals
    from .filters.images import sharpen_image
    from .filters.pde import osher_rudin_image
    from .filters.signals import sharpen_corner_signal, sharpen_vertex_signal
    from .filters.textures import dilate_texture, sharpen_texture
    from .flow.potential import flow_field
    from .mesh.triangle_mesh import TriangleMesh, weld, weld_borders

_MODULES = {
    "atlas": ("TextureAtlas", "UVReport"),
    "filters.beltrami.images": ("beltrami_image", "beltrami_manifold"),
    "filters.beltrami.meshes": (
        "beltrami_corner_signal",
        "beltrami_joint",
        "beltrami_mesh",
        "beltrami_vertex_signal",
    ),
    "filters.fit": ("fit_to_normals",),
    "flow.potential": ("flow_field",),
    "filters.images": ("sharpen_image",),
    "mesh.triangle_mesh": ("TriangleMesh", "weld", "weld_borders"),
    "filters.pde": ("osher_rudin_image",),
    "filters.geometry": ("geometry_flow", "sharpen_geometry", "sharpen_normals"),
    "filters.signals": ("sharpen_corner_signal", "sharpen_vertex_signal"),
    "filters.textures": ("dilate_texture", "sharpen_texture"),
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
    return _load(__name__, _MODULES, name)


def __dir__() -> list[str]:
    return sorted(__all__)
