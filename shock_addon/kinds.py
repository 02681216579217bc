# SPDX-License-Identifier: GPL-3.0-or-later
"""The kinds of Blender's data: their properties in panels, and how they are read and written.

Enabling the extension must import neither numpy nor kernels, so the functions here import what they
need when they are called. This module does not use bpy. Its annotations are not postponed, because
evaluating them later takes longer.
"""

from collections.abc import Callable
from typing import Any

from ..core.registry import Row
from .data import PICTURES

_WHERE = ("vertex_group", "invert_mask", "selected_only")
MASK = {*_WHERE, "mask_image"}
"""Properties that say what may change."""

_TEXTURE = ("image", "maps", "output", "assign")

_GENERATED = ("image", "image_size", "add_node")
"""Properties of generated images."""

_SHADING = ("custom_normals", "mark_sharp", "sharp_angle")

_FRAMES = ("frames", "in_colors", "folder")
"""Properties of frames."""

_ON_SURFACE = ("image_size", "add_node")


class Data(Row):
    """A kind of Blender's data.

    Attributes
    ----------
    handled_as : str
        ``"meshes"``, ``"images"``, ``"textures"``, ``"fields"`` (images made from the shape) or
        ``"films"``; chooses operators and previews.
    properties : tuple of str
        Names of its properties besides settings; see `operators.properties`.
    filter : callable
        ``filter(surface, name, settings, weld, progress)`` filters what was read by the filter of
        that name in the registry, on any thread. `weld` says whether vertices at the same place
        are one.
    read, write : callable or None
        For meshes: ``read(obj, object_mode, parameters)``, see `data.mesh.meshes.read_targets`;
        and ``write(target, result, key_name)``, which returns the object.
    flow : callable or None
        Like `filter`; computes the flow of a shock filter, for Show Flow.
    moves, paints : bool
        For meshes: whether vertices move, and whether colors change.
    object_modes : tuple of str
        Object modes whose menu offers it.
    in_images : bool
        Whether the Image Editor offers it.
    on_surface : bool
        Whether it needs a mesh object.
    in_floats : bool
        For fields: whether a new image holds floats.
    """

    handled_as: str
    properties: tuple[str, ...]
    filter: Callable[..., Any]
    read: Callable[..., Any] | None = None
    write: Callable[..., Any] | None = None
    flow: Callable[..., Any] | None = None
    moves: bool = False
    paints: bool = False
    object_modes: tuple[str, ...] = ()
    in_images: bool = False
    on_surface: bool = True
    in_floats: bool = False


def filter_shape(surface: Any, name: str, settings: Any, weld: bool, progress: Any) -> Any:
    """Filter the vertices of a mesh."""
    from ..core.host.geometry import filter_shape

    return filter_shape(surface, name, settings, weld, progress)


def filter_colors(surface: Any, name: str, settings: Any, weld: bool, progress: Any) -> Any:
    """Filter the colors of a mesh."""
    from ..core.host.colors import filter_colors

    return filter_colors(surface, name, settings, weld, progress)


def filter_both(surface: Any, name: str, settings: Any, weld: bool, progress: Any) -> Any:
    """Filter vertices and colors of a mesh with the same weights."""
    from ..core.host.denoising import filter_both

    return filter_both(surface, name, settings, weld, progress)


def filter_image(image: Any, name: str, settings: Any, weld: bool, progress: Any) -> Any:
    """Filter an image."""
    from ..core.host.images import filter_image

    return filter_image(image, name, settings, progress)


def filter_texture(surface: Any, name: str, settings: Any, weld: bool, progress: Any) -> Any:
    """Filter an image on its surface."""
    from ..core.host.textures import filter_texture

    return filter_texture(surface, name, settings, progress)


def make_image(surface: Any, name: str, settings: Any, weld: bool, progress: Any) -> Any:
    """Generate an image from the shape of a surface."""
    from ..core.host.fields import generate

    return generate(surface, name, settings, progress)


def draw_frames(film: Any, name: str, settings: Any, weld: bool, progress: Any) -> Any:
    """Draw the frames of a flow, and write them into a hidden folder."""
    from ..core.host.advection import frames_of
    from .data.image.sequences import stage

    frames = frames_of(film.flow, settings, film.frames, film.in_colors, progress)
    return stage(frames, film.parent, film.frames)


def flow_of_shape(surface: Any, name: str, settings: Any, weld: bool, progress: Any) -> Any:
    """Compute the flow of the shock filter of vertices."""
    from ..core.preview.flow import flow_of_shape

    return flow_of_shape(surface, settings, weld, progress)


def flow_of_colors(surface: Any, name: str, settings: Any, weld: bool, progress: Any) -> Any:
    """Compute the flow of the shock filter of colors."""
    from ..core.preview.flow import flow_of_colors

    return flow_of_colors(surface, settings, weld, progress)


def read_geometry(obj: Any, object_mode: str, parameters: Any) -> Any:
    """Read the shape of an object."""
    from .data.mesh.geometry import read_geometry

    return read_geometry(obj, object_mode, parameters)


def write_geometry(target: Any, result: Any, key_name: str) -> Any:
    """Write a new shape into its object."""
    from .data.mesh.geometry import write_geometry

    return write_geometry(target, result, key_name)


def read_colors(obj: Any, object_mode: str, parameters: Any) -> Any:
    """Read the colors of an object."""
    from .data.mesh.colors import read_colors

    return read_colors(obj, object_mode, parameters)


def write_colors(target: Any, result: Any, key_name: str) -> Any:
    """Write new colors into their object."""
    from .data.mesh.colors import write_colors

    return write_colors(target, result)


def read_painted(obj: Any, object_mode: str, parameters: Any) -> Any:
    """Read the shape and the colors of an object."""
    from .data.mesh.painted import read_painted

    return read_painted(obj, object_mode, parameters)


def write_painted(target: Any, result: Any, key_name: str) -> Any:
    """Write a new shape and new colors into their object."""
    from .data.mesh.painted import write_painted

    return write_painted(target, result, key_name)


DATA = {
    "geometry": Data(
        "meshes",
        (*_WHERE, "output", "weld", *_SHADING),
        filter_shape,
        read_geometry,
        write_geometry,
        flow_of_shape,
        moves=True,
        object_modes=("OBJECT", "EDIT_MESH", "SCULPT"),
    ),
    "colors": Data(
        "meshes",
        ("attribute", *_WHERE, "output", "weld"),
        filter_colors,
        read_colors,
        write_colors,
        flow_of_colors,
        paints=True,
        object_modes=("OBJECT", "PAINT_VERTEX"),
    ),
    "both": Data(
        "meshes",
        ("attribute", *_WHERE, "output", "weld", *_SHADING),
        filter_both,
        read_painted,
        write_painted,
        moves=True,
        paints=True,
        object_modes=("OBJECT",),
    ),
    "image": Data("images", ("output",), filter_image, in_images=True, on_surface=False),
    "texture": Data(
        "textures",
        (*_WHERE, "mask_image", *_TEXTURE),
        filter_texture,
        object_modes=("OBJECT", "PAINT_TEXTURE"),
        in_images=True,
    ),
    "detail": Data(
        "textures",
        (*_WHERE, "mask_image", "gain_map", "gain_colors", *_TEXTURE),
        filter_texture,
        object_modes=("OBJECT", "PAINT_TEXTURE"),
        in_images=True,
    ),
    "stitch": Data(
        "textures",
        (*_WHERE, "mask_image", *PICTURES, "image", "output", "assign"),
        filter_texture,
        object_modes=("OBJECT", "PAINT_TEXTURE"),
        in_images=True,
    ),
    "distance": Data(
        "fields",
        ("start", "start_group", "start_image", "into", *_GENERATED),
        make_image,
        object_modes=("OBJECT", "EDIT_MESH"),
        in_floats=True,
    ),
    "streaks": Data(
        "fields", ("along", "along_attribute", *_GENERATED), make_image, object_modes=("OBJECT",)
    ),
    "pattern": Data(
        "fields", ("scale_map", "stretch_along", *_GENERATED), make_image, object_modes=("OBJECT",)
    ),
    **{
        kind: Data("fields", _GENERATED, make_image, object_modes=("OBJECT",), in_floats=True)
        for kind in ("curvature", "thickness")
    },
    "occlusion": Data(
        "fields", ("occlude", *_GENERATED), make_image, object_modes=("OBJECT",), in_floats=True
    ),
    "wear": Data(
        "fields",
        ("marked", "into", *_GENERATED),
        make_image,
        object_modes=("OBJECT",),
        in_floats=True,
    ),
    "flow": Data("films", (*_FRAMES, *_ON_SURFACE), draw_frames, object_modes=("OBJECT",)),
    "attribute_flow": Data(
        "films", ("field", *_FRAMES, *_ON_SURFACE), draw_frames, object_modes=("OBJECT",)
    ),
    "flow_map": Data("films", ("image", "y_axis", *_FRAMES), draw_frames, in_images=True),
}
"""The kinds of Blender's data. Kinds of the registry have the same names here."""
