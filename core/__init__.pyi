# SPDX-License-Identifier: GPL-3.0-or-later
# Written by tools/write_stub.py from core/registry.py.

from .atlas import (
    TextureAtlas,
    UVReport,
)
from .errors import (
    Cancelled,
    InvalidMesh,
    InvalidSettings,
    InvalidSignal,
    InvalidUV,
    ShockError,
    SolverError,
)
from .filters.advection.convolution import (
    line_integral_convolution,
)
from .filters.advection.dye import (
    advect_dye,
)
from .filters.advection.flow_maps import (
    flow_map_velocity,
)
from .filters.advection.noise import (
    advect_noise,
)
from .filters.advection.sources import (
    DyeSource,
)
from .filters.advection.surface import (
    advect_on_surface,
)
from .filters.advection.velocity import (
    flow_frames,
)
from .filters.beltrami.images import (
    beltrami_image,
    beltrami_manifold,
)
from .filters.beltrami.meshes import (
    beltrami_corner_signal,
    beltrami_joint,
    beltrami_mesh,
    beltrami_vertex_signal,
    denoise_geometry,
)
from .filters.beltrami.textures import (
    beltrami_texture,
)
from .filters.fit import (
    fit_to_normals,
)
from .filters.geodesic_distance import (
    geodesic_distance,
    vertex_distance,
)
from .filters.geometry import (
    geometry_flow,
    sharpen_geometry,
    sharpen_normals,
)
from .filters.gradient_domain import (
    TextureSolver,
    filter_texture,
)
from .filters.images import (
    sharpen_image,
)
from .filters.line_convolution import (
    surface_line_convolution,
)
from .filters.normal_maps import (
    object_normals,
    tangent_normals,
)
from .filters.pde import (
    osher_rudin_image,
)
from .filters.reaction_diffusion import (
    reaction_diffusion,
)
from .filters.signals import (
    sharpen_corner_signal,
    sharpen_vertex_signal,
)
from .filters.stitching import (
    stitch_textures,
)
from .filters.textures import (
    dilate_texture,
    sharpen_texture,
)
from .flow.potential import (
    flow_field,
)
from .mesh.directions import (
    axis_directions,
    gradient_directions,
    principal_directions,
)
from .mesh.triangle_mesh import (
    TriangleMesh,
)
from .mesh.weld import (
    weld,
    weld_borders,
)
from .settings import (
    BeltramiGeometrySettings,
    BeltramiMeshSettings,
    BeltramiSettings,
    BeltramiTextureSettings,
    ConvolutionSettings,
    DilateSettings,
    DistanceSettings,
    DyeSettings,
    FilterSettings,
    FitSettings,
    GeometrySettings,
    ImageSettings,
    NoiseSettings,
    ReactionSettings,
    ShockSettings,
    StitchSettings,
    StreakSettings,
    TextureSettings,
)

__all__ = [
    "BeltramiGeometrySettings",
    "BeltramiMeshSettings",
    "BeltramiSettings",
    "BeltramiTextureSettings",
    "Cancelled",
    "ConvolutionSettings",
    "DilateSettings",
    "DistanceSettings",
    "DyeSettings",
    "DyeSource",
    "FilterSettings",
    "FitSettings",
    "GeometrySettings",
    "ImageSettings",
    "InvalidMesh",
    "InvalidSettings",
    "InvalidSignal",
    "InvalidUV",
    "NoiseSettings",
    "ReactionSettings",
    "ShockError",
    "ShockSettings",
    "SolverError",
    "StitchSettings",
    "StreakSettings",
    "TextureAtlas",
    "TextureSettings",
    "TextureSolver",
    "TriangleMesh",
    "UVReport",
    "advect_dye",
    "advect_noise",
    "advect_on_surface",
    "axis_directions",
    "beltrami_corner_signal",
    "beltrami_image",
    "beltrami_joint",
    "beltrami_manifold",
    "beltrami_mesh",
    "beltrami_texture",
    "beltrami_vertex_signal",
    "denoise_geometry",
    "dilate_texture",
    "filter_texture",
    "fit_to_normals",
    "flow_field",
    "flow_frames",
    "flow_map_velocity",
    "geodesic_distance",
    "geometry_flow",
    "gradient_directions",
    "line_integral_convolution",
    "object_normals",
    "osher_rudin_image",
    "principal_directions",
    "reaction_diffusion",
    "sharpen_corner_signal",
    "sharpen_geometry",
    "sharpen_image",
    "sharpen_normals",
    "sharpen_texture",
    "sharpen_vertex_signal",
    "stitch_textures",
    "surface_line_convolution",
    "tangent_normals",
    "vertex_distance",
    "weld",
    "weld_borders",
]
