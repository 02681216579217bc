# SPDX-License-Identifier: GPL-3.0-or-later
# Written by tools/write_stub.py from core/registry.py.

from .advection.convolution import (
    line_integral_convolution,
)
from .advection.dye import (
    advect_dye,
)
from .advection.flow_maps import (
    flow_map_velocity,
)
from .advection.noise import (
    advect_noise,
)
from .advection.sources import (
    DyeSource,
)
from .advection.surface import (
    advect_on_surface,
)
from .advection.velocity import (
    flow_frames,
)
from .atlas import (
    TextureAtlas,
    UVReport,
)
from .color.image_denoising import (
    beltrami_image,
    beltrami_manifold,
)
from .color.image_sharpening import (
    sharpen_image,
)
from .color.osher_rudin import (
    osher_rudin_image,
)
from .color.signal_denoising import (
    beltrami_corner_signal,
    beltrami_vertex_signal,
)
from .color.signal_sharpening import (
    sharpen_corner_signal,
    sharpen_vertex_signal,
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
from .flow.potential import (
    flow_field,
)
from .maps.baking import (
    bake_maps,
)
from .maps.curvature_map import (
    curvature_directions,
    curvature_map,
)
from .maps.occlusion import (
    ambient_occlusion,
    bent_normals,
    thickness,
)
from .maps.wear import (
    vertex_wear,
    wear,
)
from .mesh.curvature import (
    Curvatures,
    curvature,
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
from .repair.blocks import (
    remove_blocks,
)
from .repair.enlarging import (
    enlarge_texture,
)
from .repair.filling import (
    fill_texture,
    find_missing,
)
from .repair.repairing import (
    repair_texture,
    repair_textures,
)
from .repair.tiling import (
    make_tileable,
)
from .settings import (
    BakeSettings,
    BeltramiGeometrySettings,
    BeltramiMeshSettings,
    BeltramiSettings,
    BeltramiTextureSettings,
    BlockSettings,
    ConvolutionSettings,
    CurvatureSettings,
    DilateSettings,
    DistanceSettings,
    DyeSettings,
    EnlargeSettings,
    FillSettings,
    FilterSettings,
    FitSettings,
    GeometrySettings,
    ImageSettings,
    NoiseSettings,
    OcclusionSettings,
    ReactionSettings,
    RepairSettings,
    ShockSettings,
    StitchSettings,
    StreakSettings,
    TextureSettings,
    ThicknessSettings,
    TileSettings,
    WearSettings,
)
from .shape.crease_lines import (
    CreaseLine,
    find_creases,
)
from .shape.denoising import (
    beltrami_joint,
    beltrami_mesh,
    denoise_geometry,
)
from .shape.fit import (
    fit_to_normals,
)
from .shape.low_poly import (
    LowPoly,
    crisp_low_poly,
)
from .shape.sharpening import (
    geometry_flow,
    sharpen_geometry,
    sharpen_normals,
)
from .stitch.stitching import (
    stitch_textures,
)
from .texture.denoising import (
    beltrami_texture,
)
from .texture.distance import (
    geodesic_distance,
    vertex_distance,
)
from .texture.gradient_domain import (
    TextureSolver,
    filter_texture,
)
from .texture.normal_maps import (
    object_normals,
    tangent_normals,
)
from .texture.patterns import (
    reaction_diffusion,
)
from .texture.sharpening import (
    dilate_texture,
    sharpen_texture,
)
from .texture.streaks import (
    surface_line_convolution,
)

__all__ = [
    "BakeSettings",
    "BeltramiGeometrySettings",
    "BeltramiMeshSettings",
    "BeltramiSettings",
    "BeltramiTextureSettings",
    "BlockSettings",
    "Cancelled",
    "ConvolutionSettings",
    "CreaseLine",
    "CurvatureSettings",
    "Curvatures",
    "DilateSettings",
    "DistanceSettings",
    "DyeSettings",
    "DyeSource",
    "EnlargeSettings",
    "FillSettings",
    "FilterSettings",
    "FitSettings",
    "GeometrySettings",
    "ImageSettings",
    "InvalidMesh",
    "InvalidSettings",
    "InvalidSignal",
    "InvalidUV",
    "LowPoly",
    "NoiseSettings",
    "OcclusionSettings",
    "ReactionSettings",
    "RepairSettings",
    "ShockError",
    "ShockSettings",
    "SolverError",
    "StitchSettings",
    "StreakSettings",
    "TextureAtlas",
    "TextureSettings",
    "TextureSolver",
    "ThicknessSettings",
    "TileSettings",
    "TriangleMesh",
    "UVReport",
    "WearSettings",
    "advect_dye",
    "advect_noise",
    "advect_on_surface",
    "ambient_occlusion",
    "axis_directions",
    "bake_maps",
    "beltrami_corner_signal",
    "beltrami_image",
    "beltrami_joint",
    "beltrami_manifold",
    "beltrami_mesh",
    "beltrami_texture",
    "beltrami_vertex_signal",
    "bent_normals",
    "crisp_low_poly",
    "curvature",
    "curvature_directions",
    "curvature_map",
    "denoise_geometry",
    "dilate_texture",
    "enlarge_texture",
    "fill_texture",
    "filter_texture",
    "find_creases",
    "find_missing",
    "fit_to_normals",
    "flow_field",
    "flow_frames",
    "flow_map_velocity",
    "geodesic_distance",
    "geometry_flow",
    "gradient_directions",
    "line_integral_convolution",
    "make_tileable",
    "object_normals",
    "osher_rudin_image",
    "principal_directions",
    "reaction_diffusion",
    "remove_blocks",
    "repair_texture",
    "repair_textures",
    "sharpen_corner_signal",
    "sharpen_geometry",
    "sharpen_image",
    "sharpen_normals",
    "sharpen_texture",
    "sharpen_vertex_signal",
    "stitch_textures",
    "surface_line_convolution",
    "tangent_normals",
    "thickness",
    "vertex_distance",
    "vertex_wear",
    "wear",
    "weld",
    "weld_borders",
]
