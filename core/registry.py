# SPDX-License-Identifier: GPL-3.0-or-later
"""The table of filters: one row each, and what follows from it.

From the rows come the public names of `core`, the commands of ``shock-filter`` and of Blender's
command line, and the list of modules with kernels. A new filter of a kind that is here already
costs a settings class, a module in the room of its data and a row, with the small function above it
that imports the filter when it is first run. Needs neither numpy nor numba.
Annotations are not postponed here, since evaluating them later takes longer.
"""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, dataclass_transform

from . import settings as _settings
from .errors import InvalidSettings


@dataclass_transform(frozen_default=True)
class Row:
    """A row of a table, made of its values in order or by name; it is never changed.

    Named tuples do the same, but making six such classes would be a twentieth of enabling the
    extension.
    """

    def __init__(self, *values: Any, **named: Any) -> None:
        vars(self).update(zip(type(self).__annotations__, values, strict=False), **named)


class Kind(Row):
    """A kind of data, which says how a filter is called and which files it is for.

    Attributes
    ----------
    name : str
        For tables that differ by kind.
    inputs : str
        The files that hold such data, in the words of the command line.
    is_image : bool
        Whether these files are images; they are meshes otherwise.
    on_mesh : bool
        Whether a mesh file, whose surface shows the images, is needed beside each of them.
    is_drawn : bool
        Whether an image is made from the mesh alone.
    makes_frames : bool
        Whether frames are made, which go into a folder or a file of their own kind.
    """

    name: str
    inputs: str
    is_image: bool = False
    on_mesh: bool = False
    is_drawn: bool = False
    makes_frames: bool = False


GEOMETRY = Kind("geometry", "mesh files")
"""``function(mesh, settings, mask=, progress=)`` returns positions."""

COLORS = Kind("colors", "mesh files")
"""``function(mesh, signal, settings, mask=, progress=)`` returns a signal at the vertices.

`Filter.corners` names a function for signals at the corners.
"""

IMAGE = Kind("image", "image files", is_image=True)
"""``function(image, settings, mask=, progress=)`` returns an image.

If it has a parameter ``out``, it writes into that array, which may be a memory-mapped file. Zarr
arrays and large TIFF files come as dask arrays; it may return one, too.
"""

TEXTURE = Kind("texture", "image files that the mesh shows", is_image=True, on_mesh=True)
"""``function(mesh, uv, image, settings, mask=, progress=, atlas=)`` returns an image."""

FIELD = Kind("field", "mesh file", is_drawn=True)
"""``function(mesh, uv, settings, size=, progress=, atlas=)`` returns an image; some take more."""

FLOW = Kind("flow", "flow map, array, NetCDF or Zarr file, or mesh", makes_frames=True)
"""``function(velocity, settings, frames=, progress=)`` returns an iterator of frames."""

MASK = Kind("mask", "mesh file", is_drawn=True)
"""Masks of texels, drawn from a mesh; no filter has this kind."""


WAYS: Mapping[str, str] = {
    "flat": "The direction in which the surface bends least: along limbs and edges",
    "bending": "The direction in which it bends most: around limbs and edges",
    "x": "The X axis, projected onto the surface",
    "y": "The Y axis",
    "z": "The Z axis",
    "around_x": "Round the X axis",
    "around_y": "Round the Y axis",
    "around_z": "Around the Z axis, as on turned metal",
}
"""Directions on a surface that have names."""


class Filter(Row):
    """A row of the table.

    Attributes
    ----------
    name : str
        Name of the function, in `core` as in its module.
    module : str
        The module, as it is named inside `core`.
    settings : type
        Its settings class.
    kind : Kind
        What it works on.
    command : str
        The command that filters files.
    about : str
        What it is for, in a few words that follow the command's name.
    load : callable
        Imports the function and returns it.
    corners : str
        For `COLORS`: name of the function for signals at the corners, in the same module.
    load_corners : callable
        Imports that and returns it.
    vertices : str
        For `FIELD`: name of the function that gives values at the vertices instead, if there is
        one, in the same module.
    load_vertices : callable
        Imports that and returns it.
    load_solver : callable or None
        For `TEXTURE`: imports and returns a class that sets a filter up once for many gains:
        ``solver(mesh, uv, image, settings, normals=, atlas=)``, and
        ``solver.filtered(gain, mask)``, linear in the gain but for normals. None if there is none.
    is_slow : bool
        Whether a preview computes less at once than with other filters.
    needs_levels : bool
        For `TEXTURE`: whether it solves by multigrid, which small textures do not need.
    closes_creases : bool
        For `GEOMETRY`: whether it closes creases, whose edges a host may mark as sharp.
    fills_gutter : bool
        For `TEXTURE`: whether it changes the texels beside the charts, and not those in them.
    takes_mask : bool
        Whether it has a mask.
    mask_as : str
        The function's name for its mask.
    takes_guide : bool
        Whether the flow of another image may move the values.
    takes_known : bool
        Whether what it measures of a whole image may be that of another image.
    takes_gain : bool
        Whether its gain may be painted: the setting with that role.
    takes_others : bool
        Whether it merges several images into one.
    takes_normals : bool
        Whether it needs the mesh's shading normals, for normal maps.
    takes_starts : bool
        Whether it has sources: vertices, edges or painted texels.
    way : str or None
        The default of the `WAYS` that it follows, empty for none; None if it follows none.
    takes_scale : bool
        Whether its scale may be painted.
    then : str
        Name of the sharpening, of the same kind of data, that may follow in the same run.
    then_time : float
        Its default time.
    """

    name: str
    module: str
    settings: type
    kind: Kind
    command: str
    about: str
    load: Callable[[], Any]
    corners: str = ""
    load_corners: Callable[[], Any] | None = None
    vertices: str = ""
    load_vertices: Callable[[], Any] | None = None
    load_solver: Callable[[], Any] | None = None
    is_slow: bool = False
    needs_levels: bool = False
    closes_creases: bool = False
    fills_gutter: bool = False
    takes_mask: bool = True
    mask_as: str = "mask"
    takes_guide: bool = False
    takes_known: bool = False
    takes_gain: bool = False
    takes_others: bool = False
    takes_normals: bool = False
    takes_starts: bool = False
    way: str | None = None
    takes_scale: bool = False
    then: str = ""
    then_time: float = 256.0

    def function(
        self, then_time: float | None = None, corners: bool = False, vertices: bool = False
    ) -> Any:
        """Load the function.

        Parameters
        ----------
        then_time : float, optional
            Flow time of the sharpening that follows. Default: none follows.
        corners : bool
            For `COLORS`: whether the signal is given at the corners.
        vertices : bool
            For `FIELD`: whether the function returns values at the vertices.

        Returns
        -------
        callable
            ``function(*data, settings=None, mask=None, progress=None)``
        """
        load = self.load_corners if corners else self.load_vertices if vertices else self.load
        assert load is not None
        function = load()
        if not self.takes_mask and not self.kind.is_drawn:
            function = _without_mask(function)
        elif self.mask_as != "mask":
            function = _with_mask_as(function, self.mask_as)
        if then_time is None:
            return function
        from .then_sharpen import then_sharpen

        sharpen = find(self.then).function(corners=corners)
        return then_sharpen(function, sharpen, self.sharpening(then_time))

    def sharpening(self, time: float | None) -> Any:
        """Make the settings of the filter that follows; None without a time."""
        if time is None:
            return None
        settings = find(self.then).settings(time=time)
        if settings.time < 0:
            raise InvalidSettings(f"time is {settings.time:g}; give a value from 0.")
        return settings


def _denoise_geometry() -> Any:
    from .shape.denoising import denoise_geometry

    return denoise_geometry


def _beltrami_vertex_signal() -> Any:
    from .color.signal_denoising import beltrami_vertex_signal

    return beltrami_vertex_signal


def _beltrami_corner_signal() -> Any:
    from .color.signal_denoising import beltrami_corner_signal

    return beltrami_corner_signal


def _beltrami_image() -> Any:
    from .color.image_denoising import beltrami_image

    return beltrami_image


def _beltrami_texture() -> Any:
    from .texture.denoising import beltrami_texture

    return beltrami_texture


def _sharpen_geometry() -> Any:
    from .shape.sharpening import sharpen_geometry

    return sharpen_geometry


def _sharpen_vertex_signal() -> Any:
    from .color.signal_sharpening import sharpen_vertex_signal

    return sharpen_vertex_signal


def _sharpen_corner_signal() -> Any:
    from .color.signal_sharpening import sharpen_corner_signal

    return sharpen_corner_signal


def _sharpen_image() -> Any:
    from .color.image_sharpening import sharpen_image

    return sharpen_image


def _sharpen_texture() -> Any:
    from .texture.sharpening import sharpen_texture

    return sharpen_texture


def _filter_texture() -> Any:
    from .texture.gradient_domain import filter_texture

    return filter_texture


def _texture_solver() -> Any:
    from .texture.gradient_domain import TextureSolver

    return TextureSolver


def _stitch_textures() -> Any:
    from .stitch.stitching import stitch_textures

    return stitch_textures


def _fill_texture() -> Any:
    from .repair.filling import fill_texture

    return fill_texture


def _enlarge_texture() -> Any:
    from .repair.enlarging import enlarge_texture

    return enlarge_texture


def _repair_texture() -> Any:
    from .repair.repairing import repair_texture

    return repair_texture


def _make_tileable() -> Any:
    from .repair.tiling import make_tileable

    return make_tileable


def _remove_blocks() -> Any:
    from .repair.blocks import remove_blocks

    return remove_blocks


def _geodesic_distance() -> Any:
    from .texture.distance import geodesic_distance

    return geodesic_distance


def _vertex_distance() -> Any:
    from .texture.distance import vertex_distance

    return vertex_distance


def _surface_line_convolution() -> Any:
    from .texture.streaks import surface_line_convolution

    return surface_line_convolution


def _reaction_diffusion() -> Any:
    from .texture.patterns import reaction_diffusion

    return reaction_diffusion


def _curvature_map() -> Any:
    from .maps.curvature_map import curvature_map

    return curvature_map


def _ambient_occlusion() -> Any:
    from .maps.occlusion import ambient_occlusion

    return ambient_occlusion


def _thickness() -> Any:
    from .maps.occlusion import thickness

    return thickness


def _wear() -> Any:
    from .maps.wear import wear

    return wear


def _vertex_wear() -> Any:
    from .maps.wear import vertex_wear

    return vertex_wear


def _advect_noise() -> Any:
    from .advection.noise import advect_noise

    return advect_noise


def _dilate_texture() -> Any:
    from .texture.sharpening import dilate_texture

    return dilate_texture


FILTERS: tuple[Filter, ...] = (
    Filter(
        "denoise_geometry",
        "shape.denoising",
        _settings.BeltramiGeometrySettings,
        GEOMETRY,
        "denoise-geometry",
        "remove noise from meshes; creases stay",
        _denoise_geometry,
        is_slow=True,
        then="sharpen_geometry",
    ),
    Filter(
        "beltrami_vertex_signal",
        "color.signal_denoising",
        _settings.BeltramiMeshSettings,
        COLORS,
        "denoise-colors",
        "remove noise from the vertex colors of meshes; edges stay",
        _beltrami_vertex_signal,
        is_slow=True,
        corners="beltrami_corner_signal",
        load_corners=_beltrami_corner_signal,
        then="sharpen_vertex_signal",
    ),
    Filter(
        "beltrami_image",
        "color.image_denoising",
        _settings.BeltramiSettings,
        IMAGE,
        "denoise-image",
        "remove noise from images; edges stay",
        _beltrami_image,
        is_slow=True,
        then="sharpen_image",
        then_time=16.0,
    ),
    Filter(
        "beltrami_texture",
        "texture.denoising",
        _settings.BeltramiTextureSettings,
        TEXTURE,
        "denoise-texture",
        "remove noise from textures on the surface of a mesh, across seams; edges stay",
        _beltrami_texture,
        is_slow=True,
        then="sharpen_texture",
        then_time=16.0,
    ),
    Filter(
        "sharpen_geometry",
        "shape.sharpening",
        _settings.GeometrySettings,
        GEOMETRY,
        "sharpen-geometry",
        "sharpen the creases of meshes",
        _sharpen_geometry,
        closes_creases=True,
    ),
    Filter(
        "sharpen_vertex_signal",
        "color.signal_sharpening",
        _settings.ShockSettings,
        COLORS,
        "sharpen-colors",
        "sharpen the vertex colors of meshes",
        _sharpen_vertex_signal,
        corners="sharpen_corner_signal",
        load_corners=_sharpen_corner_signal,
    ),
    Filter(
        "sharpen_image",
        "color.image_sharpening",
        _settings.ImageSettings,
        IMAGE,
        "sharpen-image",
        "sharpen images",
        _sharpen_image,
        takes_guide=True,
        takes_known=True,
    ),
    Filter(
        "sharpen_texture",
        "texture.sharpening",
        _settings.TextureSettings,
        TEXTURE,
        "sharpen-texture",
        "sharpen textures on the surface of a mesh, across seams",
        _sharpen_texture,
        takes_guide=True,
    ),
    Filter(
        "filter_texture",
        "texture.gradient_domain",
        _settings.FilterSettings,
        TEXTURE,
        "filter-texture",
        "raise or smooth the detail of textures on the surface of a mesh, across seams",
        _filter_texture,
        load_solver=_texture_solver,
        needs_levels=True,
        takes_gain=True,
        takes_normals=True,
    ),
    Filter(
        "stitch_textures",
        "stitch.stitching",
        _settings.StitchSettings,
        TEXTURE,
        "stitch-textures",
        "take the steps at seams away: baked light, scans, projected photos",
        _stitch_textures,
        needs_levels=True,
        takes_others=True,
        takes_normals=True,
    ),
    Filter(
        "fill_texture",
        "repair.filling",
        _settings.FillSettings,
        TEXTURE,
        "fill-texture",
        "fill what a texture lacks from around it on the surface, across seams",
        _fill_texture,
        needs_levels=True,
        mask_as="missing",
        takes_normals=True,
    ),
    Filter(
        "enlarge_texture",
        "repair.enlarging",
        _settings.EnlargeSettings,
        TEXTURE,
        "enlarge-texture",
        "enlarge textures; charts see across their seams what the surface has there",
        _enlarge_texture,
        takes_mask=False,
    ),
    Filter(
        "repair_texture",
        "repair.repairing",
        _settings.RepairSettings,
        TEXTURE,
        "repair-texture",
        "repair textures of generated and photographed models: blocks, noise, holes, seams, blur",
        _repair_texture,
        is_slow=True,
        needs_levels=True,
        mask_as="missing",
        takes_normals=True,
    ),
    Filter(
        "make_tileable",
        "repair.tiling",
        _settings.TileSettings,
        IMAGE,
        "make-tileable",
        "make opposite sides of images meet, so that they can be repeated",
        _make_tileable,
    ),
    Filter(
        "remove_blocks",
        "repair.blocks",
        _settings.BlockSettings,
        IMAGE,
        "remove-blocks",
        "remove the blocks of JPEG compression from images",
        _remove_blocks,
    ),
    Filter(
        "geodesic_distance",
        "texture.distance",
        _settings.DistanceSettings,
        FIELD,
        "geodesic-distance",
        "draw how far each texel is along the surface",
        _geodesic_distance,
        vertices="vertex_distance",
        load_vertices=_vertex_distance,
        takes_mask=False,
        takes_starts=True,
    ),
    Filter(
        "surface_line_convolution",
        "texture.streaks",
        _settings.StreakSettings,
        FIELD,
        "surface-streaks",
        "draw streaks along directions on the surface, such as of brushed metal",
        _surface_line_convolution,
        takes_mask=False,
        way="flat",
    ),
    Filter(
        "reaction_diffusion",
        "texture.patterns",
        _settings.ReactionSettings,
        FIELD,
        "surface-pattern",
        "grow stripes, dots and labyrinths on the surface, as on animals",
        _reaction_diffusion,
        is_slow=True,
        takes_mask=False,
        way="",
        takes_scale=True,
    ),
    Filter(
        "curvature_map",
        "maps.curvature_map",
        _settings.CurvatureSettings,
        FIELD,
        "curvature-map",
        "draw the curvature of the surface, without facets: edges, cavities, masks for wear",
        _curvature_map,
        takes_mask=False,
    ),
    Filter(
        "ambient_occlusion",
        "maps.occlusion",
        _settings.OcclusionSettings,
        FIELD,
        "ambient-occlusion",
        "draw how much of the sky each texel sees: dirt in corners, contact shadows",
        _ambient_occlusion,
        is_slow=True,
        takes_mask=False,
    ),
    Filter(
        "thickness",
        "maps.occlusion",
        _settings.ThicknessSettings,
        FIELD,
        "thickness",
        "draw how thick the body behind each texel is, for light that shines through",
        _thickness,
        is_slow=True,
        takes_mask=False,
    ),
    Filter(
        "wear",
        "maps.wear",
        _settings.WearSettings,
        FIELD,
        "wear",
        "draw worn edges, dirt or dust: masks for materials",
        _wear,
        is_slow=True,
        vertices="vertex_wear",
        load_vertices=_vertex_wear,
        takes_mask=False,
    ),
    Filter(
        "advect_noise",
        "advection.noise",
        _settings.NoiseSettings,
        FLOW,
        "visualize-flow",
        "show a flow as a moving texture: noise, dye, or a still picture of streaks",
        _advect_noise,
        takes_mask=False,
    ),
    Filter(
        "dilate_texture",
        "texture.sharpening",
        _settings.DilateSettings,
        TEXTURE,
        "dilate-texture",
        "fill the texels around the charts of textures with what lies across the seams",
        _dilate_texture,
        fills_gutter=True,
        takes_mask=False,
    ),
)
"""All filters that have a command, in the order in which these are listed."""

OTHERS: dict[str, tuple[str, ...]] = {
    "errors": (
        "Cancelled",
        "InvalidMesh",
        "InvalidSettings",
        "InvalidSignal",
        "InvalidUV",
        "ShockError",
        "SolverError",
    ),
    "settings": ("BakeSettings", "ConvolutionSettings", "DyeSettings", "FitSettings"),
    "maps.baking": ("bake_maps",),
    "maps.curvature_map": ("curvature_directions",),
    "maps.occlusion": ("bent_normals",),
    "mesh.curvature": ("Curvatures", "curvature"),
    "mesh.directions": (
        "axis_directions",
        "gradient_directions",
        "principal_directions",
    ),
    "mesh.triangle_mesh": ("TriangleMesh",),
    "mesh.weld": ("weld", "weld_borders"),
    "atlas": ("TextureAtlas", "UVReport"),
    "flow.potential": ("flow_field",),
    "advection.convolution": ("line_integral_convolution",),
    "advection.dye": ("advect_dye",),
    "advection.flow_maps": ("flow_map_velocity",),
    "advection.sources": ("DyeSource",),
    "advection.surface": ("advect_on_surface",),
    "advection.velocity": ("flow_frames",),
    "color.image_denoising": ("beltrami_manifold",),
    "shape.crease_lines": ("CreaseLine", "find_creases"),
    "shape.denoising": ("beltrami_joint", "beltrami_mesh"),
    "shape.fit": ("fit_to_normals",),
    "shape.low_poly": ("LowPoly", "crisp_low_poly"),
    "shape.sharpening": ("geometry_flow", "sharpen_normals"),
    "repair.filling": ("find_missing",),
    "repair.repairing": ("repair_textures",),
    "texture.gradient_domain": ("TextureSolver",),
    "texture.normal_maps": ("object_normals", "tangent_normals"),
    "color.osher_rudin": ("osher_rudin_image",),
}
"""The public names that no row gives, by their modules."""


@cache
def find(name: str) -> Filter:
    """Find the row of a filter by its name."""
    return {row.name: row for row in FILTERS}[name]


def public_names() -> dict[str, str]:
    """Return the module inside `core` of each public name."""
    names = {name: module for module, given in OTHERS.items() for name in given}
    for row in FILTERS:
        names[row.name] = row.module
        names[row.settings.__name__] = "settings"
        for name in filter(None, (row.corners, row.vertices)):
            names[name] = row.module
    return names


def kernel_modules() -> list[str]:
    """List the modules, by their full names, whose import brings up all kernels."""
    modules = set(public_names().values()) - {"errors", "settings"}
    return [f"{__package__}.{module}" for module in sorted(modules)]


def _with_mask_as(function: Any, name: str) -> Any:
    # The mask says which texels are missing, not where the result is taken.
    return lambda *data, mask=None, **words: function(*data, **{name: mask}, **words)


def _without_mask(function: Any) -> Any:
    return lambda *data, mask=None, **words: function(*data, **words)
