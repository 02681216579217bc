# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversion of textured mesh objects to arrays: an image, and the faces that show it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt
from bpy.app.translations import pgettext_rpt

from ....core.host.inputs import HostImage, TexturedFaces, TexturedSurface
from ....core.host.mosaic import Mosaic
from .. import PICTURES, arrays
from ..chosen import find_again, mesh_users, refusal, uids_of
from ..materials import image_nodes, materials_of
from ..mesh import meshes
from ..mesh.colors import find_colors
from ..mesh.masks import color_mask
from ..skipped import Skipped, as_reason, sentences, skip_if
from . import images as image_data
from .images import ImageTarget
from .maps import coordinates_of, normals_in
from .tiles import Tiles

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class TextureTarget(ImageTarget):
    """A texture as it was read, with what is needed to find it again and write the result.

    Attributes
    ----------
    mosaic : Mosaic or None
        The layout of UDIM tiles in one image.
    uids : dict of int to str
        Names by uids of the objects whose faces were read.
    notes : list of str
        Remarks on them for the report.
    """

    mosaic: Mosaic | None
    uids: dict[int, str]
    notes: list[str]

    @property
    def objects(self) -> list[str]:
        """List the names that these objects have now."""
        return [obj.name for obj in find_again(self.uids)[0]]


def read_texture(
    context: bpy.types.Context,
    image: bpy.types.Image,
    parameters: Any,
    takes_normals: bool = False,
) -> tuple[TextureTarget, list[str]]:
    """Read an image and the faces that show it.

    Parameters
    ----------
    context : bpy.types.Context
    image : bpy.types.Image
    parameters : object
        Has the properties of `color_mask`, and `mask_image` if the filter has a mask; `gain_map`
        and `gain_colors` if its gain may be painted; `data.PICTURES` if it merges images; `gutter`
        if it fills one, so that tiles are laid out farther apart; and `content` if it takes
        normals.
    takes_normals : bool
        Whether the filter turns normals to object space. Then the materials say whether the image
        holds normals, and shading normals of the faces are read.

    Returns
    -------
    target : TextureTarget
    skipped : list of str
        A sentence for each object that was left alone.

    Raises
    ------
    Skipped
        If the image or another named one cannot be used, or no object shows it.
    """
    skip_if(refusal(image, tiles=True))
    objects = mesh_users(context)
    named = any(_uses(obj, image) for obj in objects)
    shown = image if named else None
    faces, names, skipped = read_faces(context, objects, shown, parameters, takes_normals)
    parts = image_data.read_parts(image)
    mosaic, notes = None, []
    if image.source == "TILED":
        margin = getattr(parameters, "gutter", 0) + 1
        mosaic = Mosaic.of(image_data.sizes_of(parts), margin)
        faces, notes = _in_tiles(faces, mosaic)
    surface = TexturedSurface(
        faces=faces,
        picture=image_data.host_image(image, _whole(parts, mosaic)),
        mask=_read_mask(image, parameters, mosaic),
        grays=read_gain_map(image, parameters, mosaic),
        others=_read_others(image, parameters, mosaic),
    )
    if takes_normals and parameters.content == "values":
        content = normals_in(context, image)
        surface = replace(surface, content=content)
        notes += [pgettext_rpt(_AS_NORMALS).format(image=image.name)] if content else []
    notes += _other_users(context, image, objects)
    uids = uids_of([bpy.data.objects[name] for name in names])
    uid = image.session_uid
    return TextureTarget(image.name, uid, surface, parts, mosaic, uids, notes), skipped


def holding(
    target: TextureTarget, content: str, lead: TextureTarget | None = None
) -> TextureTarget:
    """Return the target with its content, and with the guide that moves its values."""
    guide = None if lead is None else lead.surface.picture
    return replace(target, surface=replace(target.surface, content=content, guide=guide))


def read_faces(
    context: bpy.types.Context,
    objects: list[bpy.types.Object],
    image: bpy.types.Image | None,
    parameters: Any,
    with_normals: bool = False,
) -> tuple[TexturedFaces, list[str], list[str]]:
    """Read the faces of objects whose material shows an image, or all faces.

    Returns
    -------
    faces : TexturedFaces
    names : list of str
        Names of the objects that were read.
    skipped : list of str
        A sentence for each other object.

    Raises
    ------
    Skipped
        If none could be read.
    """

    def read(obj: bpy.types.Object, mode: str) -> tuple[str, TexturedFaces]:
        return obj.name, _read_faces(obj, mode, image, parameters, with_normals)

    found, left = meshes.read_each(context, objects, read)
    skipped = sentences(left)
    if not found:
        raise Skipped("no object could be read. {reasons}", reasons=as_reason(" ".join(skipped)))
    names, faces = zip(*found, strict=True)
    return _joined(faces), list(names), skipped


def assign(names: list[str], old: bpy.types.Image, new: bpy.types.Image) -> list[str]:
    """Replace an image in the materials of the objects of these names, and paint on the new one.

    Returns
    -------
    list of str
        A sentence for each material that could not be changed.
    """
    notes = []
    for material in materials_of(names):
        nodes = [node for node in image_nodes(material) if node.image == old]
        for node in nodes:
            if node.id_data.library is None and material.library is None:
                node.image = new
        if any(node.image == old for node in nodes):
            text = pgettext_rpt(
                "The material {name} is linked from another file, so it still shows {image}."
            )
            notes.append(text.format(name=material.name, image=old.name))
    paint = bpy.context.tool_settings.image_paint
    if paint.canvas == old:
        paint.canvas = new
    return notes


def shown_by(names: list[str]) -> list[bpy.types.Image]:
    """List the images in the materials of the objects of these names."""
    nodes = [node for material in materials_of(names) for node in image_nodes(material)]
    return [node.image for node in nodes if node.image is not None]


def _whole(parts: Tiles, mosaic: Mosaic | None) -> npt.NDArray[np.float32]:
    return parts[image_data.UNTILED] if mosaic is None else mosaic.compose(parts)


# ---------------------------------------------------------------------------------------- materials


def _shows(material: bpy.types.Material | None, image: bpy.types.Image) -> bool:
    return material is not None and any(n.image == image for n in image_nodes(material))


def are_of_others(context: bpy.types.Context, names: list[str]) -> bool:
    """Whether materials of other objects show one of these images, and none of the chosen ones."""
    images = [bpy.data.images[name] for name in names if name in bpy.data.images]
    chosen = mesh_users(context)
    others = [obj for obj in context.scene.objects if obj.type == "MESH" and obj not in chosen]
    mine, theirs = (
        any(_uses(obj, image) for obj in objects for image in images)
        for objects in (chosen, others)
    )
    return theirs and not mine


def _uses(obj: bpy.types.Object, image: bpy.types.Image) -> bool:
    return any(_shows(slot.material, image) for slot in obj.material_slots)


def _other_users(
    context: bpy.types.Context, image: bpy.types.Image, objects: list[bpy.types.Object]
) -> list[str]:
    took_part = {obj.data for obj in objects}
    others = [
        obj.name
        for obj in context.scene.objects
        if obj.type == "MESH" and obj.data not in took_part and _uses(obj, image)
    ]
    if not others:
        return []
    text = pgettext_rpt(
        "{image} is also on {names}, which were not filtered; select all of them, or the gutter"
        " may run into their charts."
    )
    return [text.format(image=image.name, names=", ".join(others))]


# -------------------------------------------------------------------------------------------- faces


def _read_faces(
    obj: bpy.types.Object,
    mode: str,
    image: bpy.types.Image | None,
    parameters: Any,
    with_normals: bool,
) -> TexturedFaces:
    """Read the faces whose material shows the image, or all."""
    meshes.check_readable(obj)
    mesh = obj.data
    layer = uv_layer(obj, image)
    if layer is None:
        raise Skipped("it has no UV map; unwrap it in Edit Mode (UV > Unwrap)")
    corners = meshes.read_triangle_corners(mesh)
    if image is not None:
        corners = corners[_faces_with(obj, image)]
    if not len(corners):
        raise Skipped(
            "no face of it has a material that shows {image}; assign one", image=image.name
        )
    uv = arrays.read(layer.uv, "vector", 2)
    _check_finite(uv[corners])
    matrix = meshes.matrix_in_world(obj)
    if np.linalg.det(matrix[:3, :3]) < 0:  # mirrored: else its faces would be inside out
        corners = corners[:, ::-1]
    positions = meshes.read_positions(mesh).astype(np.float64)
    meshes.check_finite(positions)
    vertices = meshes.read_corner_vertices(mesh)
    return TexturedFaces(
        positions @ matrix[:3, :3].T + matrix[:3, 3],
        vertices[corners].astype(np.int64),
        uv[corners].astype(np.float64),
        _weights(obj, mode, parameters, vertices, corners),
        _grays(mesh, parameters, vertices, corners),
        _normals(mesh, corners, matrix) if with_normals else None,
    )


def _check_finite(uv: npt.NDArray) -> None:
    # As in the core, which does not know the objects that are joined for it.
    is_finite = np.isfinite(uv).all(axis=(1, 2))
    if not is_finite.all():
        text = pgettext_rpt(
            "Texture coordinates are NaN or infinite at {bad} of {count} faces, the first is face"
            " {first}; unwrap them again."
        )
        bad, first = np.count_nonzero(~is_finite), int(np.argmin(is_finite))
        raise Skipped(as_reason(text.format(bad=bad, count=len(uv), first=first)))


def uv_layer(
    obj: bpy.types.Object, image: bpy.types.Image | None
) -> bpy.types.MeshUVLoopLayer | None:
    """Return the UV map by which the materials of an object show an image, else the active one.

    Where no *UV Map* node names one, materials take that which is active for rendering.
    """
    layers = obj.data.uv_layers
    slots = [slot.material for slot in obj.material_slots] if image is not None else []
    nodes = [node for material in filter(None, slots) for node in image_nodes(material)]
    shown = [node for node in nodes if node.image == image]
    sources = {coordinates_of(node, ("REROUTE", "MAPPING")) for node in shown}
    rendered = next((("UV", each.name) for each in layers if each.active_render), None)
    sources = {rendered if source == ("UV", "") else source for source in sources}
    return next((each for each in layers if sources == {("UV", each.name)}), layers.active)


def _faces_with(obj: bpy.types.Object, image: bpy.types.Image) -> npt.NDArray[np.bool_]:
    mesh = obj.data
    shows = np.array([_shows(slot.material, image) for slot in obj.material_slots] or [False])
    slots = arrays.read(mesh.polygons, "material_index", dtype=np.int32)
    polygons = arrays.read(mesh.loop_triangles, "polygon_index", dtype=np.int32)
    return shows[np.clip(slots, 0, len(shows) - 1)][polygons]


def _weights(
    obj: bpy.types.Object, mode: str, parameters: Any, vertices: npt.NDArray, corners: npt.NDArray
) -> Floats | None:
    mask, free = color_mask(obj, mode, "CORNER", parameters)
    if mask is None and free is None:
        return None
    weights = np.ones(len(vertices)) if mask is None else mask[vertices]
    if free is not None:
        weights[~free] = 0.0
    return weights[corners]


def _grays(
    mesh: bpy.types.Mesh, parameters: Any, vertices: npt.NDArray, corners: npt.NDArray
) -> Floats | None:
    name = getattr(parameters, "gain_colors", "")
    if not name:
        return None
    attribute = find_colors(mesh, name)
    grays = arrays.read_attribute(attribute)[:, :3].mean(axis=1, dtype=np.float64)
    return grays[corners if attribute.domain == "CORNER" else vertices[corners]]


def _normals(mesh: bpy.types.Mesh, corners: npt.NDArray, matrix: Floats) -> Floats | None:
    # In the world.
    found = arrays.read(mesh.corner_normals, "vector", 3)[corners] @ np.linalg.inv(matrix[:3, :3])
    length = np.linalg.norm(found, axis=2, keepdims=True)
    return found / length if np.isfinite(length).all() and length.all() else None


def _joined(parts: Sequence[TexturedFaces]) -> TexturedFaces:
    weights = [part.weights for part in parts]
    masked = any(each is not None for each in weights)
    triangles, first = [], 0
    for number, part in enumerate(parts):
        triangles.append(part.triangles + first)
        first += len(part.positions)
        if masked and part.weights is None:
            weights[number] = np.ones(part.triangles.shape)
    grays = [part.grays for part in parts if part.grays is not None]
    normals = [part.normals for part in parts if part.normals is not None]
    return TexturedFaces(
        np.concatenate([part.positions for part in parts]),
        np.concatenate(triangles),
        np.concatenate([part.uv for part in parts]),
        np.concatenate(weights) if masked else None,
        np.concatenate(grays) if grays else None,
        np.concatenate(normals) if len(normals) == len(parts) else None,
    )


def _in_tiles(faces: TexturedFaces, mosaic: Mosaic) -> tuple[TexturedFaces, list[str]]:
    uv, inside = mosaic.place(faces.uv)
    if not inside.any():
        raise Skipped("no face lies in one of its tiles; move the UVs into them")
    left = int(np.count_nonzero(~inside))
    text = pgettext_rpt(
        "{number:,} triangles lie in no tile, or across the border of one; they were left out."
    )
    notes = [text.format(number=left)]
    weights = None if faces.weights is None else faces.weights[inside]
    grays = None if faces.grays is None else faces.grays[inside]
    normals = None if faces.normals is None else faces.normals[inside]
    triangles = faces.triangles[inside]
    kept = TexturedFaces(faces.positions, triangles, uv[inside], weights, grays, normals)
    return kept, notes if left else []


def _read_mask(image: bpy.types.Image, parameters: Any, mosaic: Mosaic | None) -> Floats | None:
    name = getattr(parameters, "mask_image", "")
    if not name or getattr(parameters, "output", "") == "LIVE":  # nodes take it as their mask
        return None
    weights = _read_grays(image, name, mosaic, _MASK_REASONS)
    weights = 1.0 - weights if parameters.invert_mask else weights
    if not weights.any():
        raise Skipped(
            "its mask {name} leaves nothing to sharpen; paint some of it white", name=name
        )
    return weights


def read_gain_map(
    image: bpy.types.Image, parameters: Any, mosaic: Mosaic | None = None
) -> Floats | None:
    """Read the gain map of an image as it is stored, if the parameters name one.

    Raises
    ------
    Skipped
        If the map cannot be used.
    """
    name = getattr(parameters, "gain_map", "")
    if name == image.name:
        raise Skipped("it is its own gain map; name the texture as the image")
    return _read_grays(image, name, mosaic, _GAIN_REASONS) if name else None


def _read_others(
    image: bpy.types.Image, parameters: Any, mosaic: Mosaic | None
) -> tuple[HostImage, ...]:
    """Read the further pictures that the parameters name."""
    given = [getattr(parameters, name, "") for name in PICTURES]
    others = []
    for name in filter(None, given):
        if name == image.name or given.count(name) > 1:
            raise Skipped("{name} is named twice; name each picture once", name=name)
        other = _beside(image, name, _PICTURE_REASONS)
        if other.is_float != image.is_float:
            raise Skipped(
                "the depth of its picture {name} differs; have both as bytes or both as floats",
                name=name,
            )
        space = image.colorspace_settings.name
        if other.colorspace_settings.name != space:
            raise Skipped(
                "its picture {name} has another color space; set it to {space}",
                name=name,
                space=space,
            )
        pixels = _whole(image_data.read_parts(other), mosaic)
        if not np.isfinite(pixels).all():
            raise Skipped("its picture {name} holds NaN; paint over it first", name=name)
        others.append(image_data.host_image(other, pixels))
    return tuple(others)


def grays_of(pixels: npt.NDArray[np.float32]) -> Floats:
    """Return the mean of the colors, without opacity, clipped to [0, 1]."""
    red, green, blue = (pixels[..., channel] for channel in range(3))
    return np.clip((red.astype(np.float64) + green + blue) / 3.0, 0.0, 1.0)


_AS_NORMALS = "{image} goes to a Normal Map node, so it was taken for normals."
_MASK_REASONS = (
    "there is no mask image named {name!r}; name another",
    "its mask {name} cannot be used: {reason}",
    "its mask {name} has another size; scale it to {size}",
    "its mask {name} holds NaN; paint over it first",
)
_PICTURE_REASONS = (
    "there is no picture named {name!r}; name another image",
    "its picture {name} cannot be used: {reason}",
    "its picture {name} has another size; scale it to {size}",
)
_GAIN_REASONS = (
    "there is no gain map named {name!r}; name another image",
    "its gain map {name} cannot be used: {reason}",
    "its gain map {name} has another size; scale it to {size}",
    "its gain map {name} holds NaN; paint over it first",
)


def _read_grays(
    image: bpy.types.Image, name: str, mosaic: Mosaic | None, reasons: tuple[str, str, str, str]
) -> Floats:
    """Read the named image, of the size of another one, as grays from 0 to 1."""
    *of_image, not_finite = reasons
    beside = _beside(image, name, of_image)
    grays = grays_of(_whole(image_data.read_parts(beside), mosaic))
    if not np.isfinite(grays).all():
        raise Skipped(not_finite, name=name)
    return grays


def _beside(image: bpy.types.Image, name: str, reasons: Sequence[str]) -> bpy.types.Image:
    """Find the named image, of the size of another one."""
    missing, refused, other_size = reasons
    beside = bpy.data.images.get(name)
    if beside is None:
        raise Skipped(missing, name=name)
    reason = refusal(beside, tiles=True)
    if reason:
        raise Skipped(refused, name=name, reason=pgettext_rpt(reason))
    sizes = image_data.part_sizes(image)
    if image_data.part_sizes(beside) != sizes:
        wanted = ", ".join(f"{width} x {height}" for height, width in sizes.values())
        raise Skipped(other_size, name=name, size=wanted)
    return beside
