# SPDX-License-Identifier: GPL-3.0-or-later
"""Read mesh objects, sources and directions for generated images."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt
from bpy.app.translations import pgettext_rpt

from ....core.host.fields import FieldSurface
from .. import arrays
from ..chosen import find_again, mesh_refusal, mesh_users, refusal, uids_of
from ..materials import image_nodes
from ..mesh import meshes
from ..mesh.vertex_groups import group_weights
from ..skipped import Skipped, skip_if
from . import images, in_world, textures
from .images import ImageTarget
from .linking import is_linked
from .tiles import Tiles

_HALF = 0.5


@dataclass(frozen=True)
class FieldTarget(ImageTarget):
    """The objects that will show an image, and the image to write; its uid is 0 if it is new.

    Attributes
    ----------
    objects : dict of int to str
        Names by uids of the objects whose faces were read, the active one first.
    notes : list of str
        Remarks on them for the report.
    """

    objects: dict[int, str]
    notes: list[str]


def read_field(
    context: bpy.types.Context,
    image: bpy.types.Image | None,
    parameters: Any,
    places: Sequence[str],
) -> tuple[FieldTarget, list[str]]:
    """Read the faces of the chosen objects, and the inputs of an image on them.

    Parameters
    ----------
    context : bpy.types.Context
    image : bpy.types.Image or None
        The image to write; None for a new one.
    parameters : object
        Has `image_size` and `places`.
    places : sequence of str
        Names of the properties to read; see `kinds.DATA`.

    Returns
    -------
    target : FieldTarget
    skipped : list of str
        A sentence for each object that was left alone.

    Raises
    ------
    Skipped
        If the image or what is named cannot be used, or no object could be read.
    """
    if image is not None:
        skip_if(refusal(image))
    parts: Tiles = {} if image is None else images.read_parts(image)
    size = int(parameters.image_size)
    shape = (size, size) if image is None else (image.size[1], image.size[0])
    faces, names, skipped = textures.read_faces(context, mesh_users(context), None, None)
    objects = [bpy.data.objects[name] for name in names]
    with meshes.object_mode(context):
        given, notes = _given(objects, parameters, places, shape)
        if "occlude" in places and parameters.occlude:
            given["occluders"] = in_world.others(context, objects)
    at_vertices = "into" in places and parameters.into == "ATTRIBUTE"
    surface = FieldSurface(faces, shape, given, at_vertices)
    uid = 0 if image is None else image.session_uid
    name = names[0] if image is None else image.name
    return FieldTarget(name, uid, surface, parts, uids_of(objects), notes), skipped


def add_or_reuse(
    name: str, used: str, pixels: npt.NDArray[np.float32], is_float: bool
) -> bpy.types.Image:
    """Write pixels into the image `used` if an earlier run made it alike, or into a new one.

    That run was of the same objects if the image has the same name, but for a number.
    """
    height, width = pixels.shape[:2]
    image = bpy.data.images.get(used)
    fits = image is not None and tuple(image.size) == (width, height)
    fits = fits and name.startswith(re.sub(r"\.\d{3}$", "", used))
    if not (fits and image.is_float == is_float and images.is_as_written(image)):
        image = bpy.data.images.new(
            name, width, height, alpha=False, float_buffer=is_float, is_data=True
        )
    images.write_parts(image, {images.UNTILED: pixels}, pack=True)
    images.note_written(image)
    return image


def pixels_of(values: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Convert (h, w) values to opaque grays: (h, w, 4); infinite values become 0."""
    pixels = np.repeat(values[..., None], 4, axis=2)
    pixels[~np.isfinite(values)] = 0.0
    pixels[..., 3] = 1.0
    return pixels


def write_attribute(
    uids: dict[int, str], attribute: str, values: npt.NDArray[np.float32]
) -> bpy.types.Object:
    """Write values at the vertices of the objects of these uids, in their order.

    The attribute gets that name.

    Returns
    -------
    bpy.types.Object
        The first one.

    Raises
    ------
    Skipped
        If an object was removed, has other vertices now, or cannot take the attribute.
    """
    objects, gone = find_again(uids)
    with meshes.object_mode(bpy.context):
        counts = [len(obj.data.vertices) for obj in objects]
        if gone or sum(counts) != len(values):
            raise Skipped("it was changed meanwhile; run again")
        for obj in objects:
            skip_if(mesh_refusal(obj.data))
            there = attribute in obj.data.attributes
            if there and not arrays.find_attribute(obj.data, attribute, "FLOAT", "POINT"):
                raise Skipped(
                    "it has another attribute named {name}; rename that one", name=attribute
                )
        for obj, part in zip(objects, np.split(values, np.cumsum(counts)[:-1]), strict=True):
            found = arrays.find_or_add_attribute(obj.data, attribute, "FLOAT", "POINT")
            arrays.write_attribute(found, part)
            obj.data.update()
    return objects[0]


def add_nodes(uids: dict[int, str], image: bpy.types.Image, *, activate: bool = False) -> list[str]:
    """Add an Image Texture node for an image to the active material of each object of these uids.

    An object without a material gets one that shows the image.

    Parameters
    ----------
    uids : dict of int to str
        As from `uids_of`.
    image : bpy.types.Image
    activate : bool
        Whether the node becomes the active one, whose image Solid shading shows. Otherwise it does
        so only in materials without other images.

    Returns
    -------
    list of str
        A sentence for each object that got a material or could not get the node, and one if it
        waits to be linked.
    """
    (objects, notes), waits = find_again(uids), False
    for obj in objects:
        material = obj.active_material
        if material is None and not mesh_refusal(obj.data):
            material = give_material(obj)
            _link_to_color(material, image_node(obj, material, image, activate))
            text = pgettext_rpt("{name} had no material, and got one that shows {image}.")
            notes.append(text.format(name=obj.name, image=image.name))
        elif material is None or material.library is not None or material.node_tree is None:
            text = pgettext_rpt("{name} cannot take a node; name {image} in one by hand.")
            notes.append(text.format(name=(material or obj).name, image=image.name))
        else:
            waits |= not is_linked(image_node(obj, material, image, activate))
    if waits and not activate:
        text = pgettext_rpt("{name} is in the material, not linked yet: press Link.")
        notes.append(text.format(name=image.name))
    return notes


def give_material(obj: bpy.types.Object) -> bpy.types.Material:
    """Give an object that has no active material a new one with nodes."""
    material = bpy.data.materials.new(obj.name)
    if bpy.app.version < (5, 0, 0):  # later, all use them
        material.use_nodes = True
    if obj.material_slots:
        obj.material_slots[obj.active_material_index].material = material
    else:
        obj.data.materials.append(material)
    return material


def image_node(
    obj: bpy.types.Object, material: bpy.types.Material, image: bpy.types.Image, activate: bool
) -> bpy.types.Node:
    """Return the node of an image in a material of an object, a new one if there is none.

    A new one shows the image by the active UV map, by which it was made.
    """
    nodes = material.node_tree.nodes
    before = nodes.active
    others = any(each.image not in {None, image} for each in image_nodes(material))
    node = next((n for n in nodes if n.type == "TEX_IMAGE" and n.image == image), None)
    if node is None:
        node = nodes.new("ShaderNodeTexImage")
        node.image = image
        low = min((each.location[1] for each in nodes), default=0.0)
        node.location = min((each.location[0] for each in nodes), default=0.0), low - 300.0
        if name := uv_map_to_name(obj.data):
            uv = nodes.new("ShaderNodeUVMap")
            uv.uv_map, uv.location = name, (node.location[0] - 200.0, node.location[1])
            material.node_tree.links.new(uv.outputs["UV"], node.inputs["Vector"])
    nodes.active = node if activate or not others else before
    return node


def uv_map_to_name(mesh: bpy.types.Mesh) -> str:
    """Name the active UV map if nodes that name none take another one, that of renders."""
    active = mesh.uv_layers.active
    return "" if active is None or active.active_render else active.name


def _link_to_color(material: bpy.types.Material, node: bpy.types.Node) -> None:
    for shader in material.node_tree.nodes:
        if "Base Color" in shader.inputs:
            material.node_tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])


def _given(
    objects: list[bpy.types.Object],
    parameters: Any,
    places: Sequence[str],
    shape: tuple[int, int],
) -> tuple[dict[str, Any], list[str]]:
    # The keyword arguments for the function in the registry, and remarks for the report.
    given: dict[str, Any] = {}
    if "start" in places and parameters.source != "given":
        return given, []
    if "start" in places and parameters.start == "IMAGE":
        given["image"] = _grays(parameters.start_image, shape)
    elif "start" in places and parameters.start == "LOWEST":
        given |= _lowest(objects)
    elif "start" in places and parameters.start == "AUTO":
        found, remarks = _found_start(objects)
        return given | found, remarks
    elif "start" in places:
        given |= _starts(objects, parameters.start, parameters.start_group)
    if "along" in places and parameters.along == "ATTRIBUTE":
        given |= read_directions(objects, parameters.along_attribute)
    elif "along" in places:
        given["along"] = parameters.along.lower()
    if "stretch_along" in places and parameters.stretch_along != "NONE":
        given["along"] = parameters.stretch_along.lower()
    if "marked" in places and parameters.marked and parameters.wear_kind == "edges":
        given["edges"] = _marked(objects)
    if "scale_map" in places and parameters.scale_map:
        given["rates"] = _grays(parameters.scale_map, shape)
    return given, []


def read_directions(objects: list[bpy.types.Object], name: str) -> dict[str, Any]:
    """Read an attribute: vectors at the faces, or numbers at their corners, whose gradient counts.

    Raises
    ------
    Skipped
        If an object has none, or one of another kind than others.
    """
    vectors, numbers = [], []
    for obj in objects:
        mesh = obj.data
        attribute = mesh.attributes.get(name)
        if attribute is None or attribute.domain == "EDGE" or not arrays.is_readable(attribute):
            raise Skipped(
                "it has no attribute named {name!r} with numbers, colors or vectors of vertices,"
                " corners or faces; name another",
                name=name,
            )
        values = arrays.read_attribute(attribute).astype(np.float64)
        corners = meshes.read_triangle_corners(mesh)
        rows = {
            "POINT": meshes.read_corner_vertices(mesh)[corners],
            "CORNER": corners,
            "FACE": np.repeat(arrays.read(mesh.loop_triangles, "polygon_index", 1, np.int32), 3),
        }[attribute.domain]
        at_corners = values[rows.reshape(-1)].reshape(len(corners), 3, -1)
        if not np.isfinite(at_corners).all():
            raise Skipped("its attribute {name} holds NaN or infinity; name another", name=name)
        if attribute.data_type == "FLOAT_VECTOR":
            turn = meshes.matrix_in_world(obj)[:3, :3]
            vectors.append(at_corners.mean(axis=1) @ turn.T)
        else:
            numbers.append(at_corners[..., :3].mean(axis=2))
    if vectors and numbers:
        raise Skipped("its attribute {name} is of another kind on other objects", name=name)
    if vectors:
        return {"directions": np.concatenate(vectors)}
    return {"rising": np.concatenate(numbers)}


def _found_start(objects: list[bpy.types.Object]) -> tuple[dict[str, Any], list[str]]:
    # What the artist has chosen in some way, and remarks for the report.
    for start, remark in _CHOSEN.items():
        try:
            return _starts(objects, start), [pgettext_rpt(remark)] if remark else []
        except Skipped:
            pass
    text = "Nothing, or all, is selected, so the distance counts from the lowest vertices."
    return _lowest(objects), [pgettext_rpt(text)]


_CHOSEN = {
    "SELECTED": "",
    "SHARP": "Nothing, or all, is selected, so the distance counts from the edges that are marked"
    " as sharp.",
}


def _starts(objects: list[bpy.types.Object], start: str, vertex_group: str = "") -> dict[str, Any]:
    # Vertices and edges, numbered through all objects.
    vertices, edges, first = [], [], 0
    for obj in objects:
        mesh = obj.data
        pairs = arrays.read(mesh.edges, "vertices", 2, dtype=np.int32)
        chosen = np.zeros(len(mesh.vertices), dtype=bool)
        if start == "GROUP":
            chosen = group_weights(obj, vertex_group) >= _HALF
            marked = chosen[pairs].all(axis=1)
        else:
            marked = arrays.read(mesh.edges, _MARKS[start], dtype=bool)
        if start == "SELECTED":
            chosen = arrays.read(mesh.vertices, "select", dtype=bool)
            chosen[pairs[marked]] = True  # as Edit Mode does: it is more than lines
        vertices.append(first + np.flatnonzero(chosen))
        edges.append(first + pairs[marked])
        first += len(mesh.vertices)
    joined = {"vertices": np.concatenate(vertices), "edges": np.concatenate(edges)}
    if start == "SELECTED" and len(joined["vertices"]) == first:
        raise Skipped("all is selected; select only where the distance is 0, in Edit Mode")
    if not any(len(part) for part in joined.values()):
        raise Skipped(_NOTHING[start])
    return joined


def _marked(objects: list[bpy.types.Object]) -> npt.NDArray[np.int32]:
    # Edges that are marked as sharp, numbered through all objects.
    try:
        edges: npt.NDArray[np.int32] = _starts(objects, "SHARP")["edges"]
    except Skipped:
        raise Skipped(
            "no edge is marked as sharp; mark some (Edge > Mark Sharp), or turn Marked Edges off"
        ) from None
    return edges


def _lowest(objects: list[bpy.types.Object]) -> dict[str, Any]:
    # Vertices up to a thousandth of the height, and edges between them.
    heights, edges, first = [], [], 0
    for obj in objects:
        matrix = meshes.matrix_in_world(obj)
        heights.append(meshes.read_positions(obj.data) @ matrix[2, :3] + matrix[2, 3])
        edges.append(first + arrays.read(obj.data.edges, "vertices", 2, dtype=np.int32))
        first += len(heights[-1])
    joined, pairs = np.concatenate(heights), np.concatenate(edges)
    low = joined <= joined.min() + 1e-3 * np.ptp(joined)
    return {"vertices": np.flatnonzero(low), "edges": pairs[low[pairs].all(axis=1)]}


_MARKS = {"SELECTED": "select", "SEAMS": "use_seam", "SHARP": "use_edge_sharp"}
_NOTHING = {
    "SELECTED": "nothing is selected; select vertices or edges in Edit Mode, or start elsewhere",
    "GROUP": "no vertex of its group weighs 0.5 or more; assign some, or start elsewhere",
    "SEAMS": "no edge is marked as a seam; mark some (Edge > Mark Seam), or start elsewhere",
    "SHARP": "no edge is marked as sharp; mark some (Edge > Mark Sharp), or start elsewhere",
}


def _grays(name: str, shape: tuple[int, int]) -> npt.NDArray[np.float64]:
    image = bpy.data.images.get(name)
    if image is None:
        raise Skipped("there is no image named {name!r}; name another", name=name)
    skip_if(refusal(image))
    height, width = shape
    if tuple(image.size) != (width, height):
        raise Skipped(
            "its image {name} has another size; scale it to {width} x {height}",
            name=name,
            width=width,
            height=height,
        )
    grays = textures.grays_of(arrays.read_pixels(image))
    if not np.isfinite(grays).all():
        raise Skipped("its image {name} holds NaN; paint over it first", name=name)
    return grays
