# SPDX-License-Identifier: GPL-3.0-or-later
"""Read what maps are baked of, and write the maps into images and materials."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
import numpy.typing as npt
from bpy.app.translations import pgettext_rpt

from ....core.host.fields import BakeSurface, WorldMesh
from ....core.maps.names import SUFFIXES
from ..chosen import find_again, mesh_objects, mesh_refusal, mesh_users, uids_of
from ..mesh import meshes
from ..skipped import Skipped, as_reason, listed, sentences
from . import fields, images, in_world, textures

_OF_HIGH = "normals", "displacement", "colors"


@dataclass(frozen=True)
class BakeTarget:
    """What is baked, and the objects that get the maps.

    Attributes
    ----------
    name : str
        That of the first of these.
    surface : BakeSurface
    objects : dict of int to str
        Names by session uids, the active object first.
    """

    name: str
    surface: BakeSurface
    objects: dict[int, str]


def read(
    context: bpy.types.Context, maps: set[str], size: int, *, from_selected: bool, occlude: bool
) -> tuple[BakeTarget, list[str]]:
    """Read the chosen objects, or the active one and the others as the detailed mesh.

    Parameters
    ----------
    context : bpy.types.Context
    maps : set of str
        Names of maps; those that need a detailed mesh are left out where there is none.
    size : int
        Width and height of the images.
    from_selected : bool
        Whether the other selected objects are the detailed mesh.
    occlude : bool
        Whether other visible objects stand in the way of occlusion.

    Returns
    -------
    target : BakeTarget
    skipped : list of str
        A sentence for each object that was left alone.

    Raises
    ------
    Skipped
        If nothing can be read, or no map is left.
    """
    objects = mesh_users(context)
    details: list[bpy.types.Object] = []
    if from_selected:
        details = [obj for obj in mesh_objects(context) if obj != context.object]
        objects = [obj for obj in objects if obj == context.object]
        if not details or not objects:
            raise Skipped("select the detailed objects, and last the one that gets the maps")
    faces, names, skipped = textures.read_faces(context, objects, None, None, with_normals=True)
    with meshes.object_mode(context):
        parts, left = in_world.read_each(details)
        others = in_world.others(context, [*objects, *details]) if occlude else []
    skipped += sentences(left)
    if details and not parts:
        reasons = as_reason(" ".join(skipped))
        raise Skipped("no object could be read. {reasons}", reasons=reasons)
    high = _joined(parts) if parts else None
    possible = [name for name in SUFFIXES if high is not None or name not in _OF_HIGH]
    if high is not None and high.colors is None:
        possible.remove("colors")
    wanted = tuple(name for name in possible if name in maps)
    if not wanted:
        raise Skipped("no map is left; choose some, such as curvature")
    surface = BakeSurface(faces, (size, size), wanted, high, others)
    read_ones = [bpy.data.objects[name] for name in names]
    return BakeTarget(names[0], surface, uids_of(read_ones)), skipped


def write(
    target: BakeTarget, found: dict[str, npt.NDArray[np.float32]], used: str, *, in_floats: bool
) -> dict[str, bpy.types.Image]:
    """Write maps into images, which those of the last run become again if they are untouched.

    Parameters
    ----------
    target : BakeTarget
    found : dict
        Images (h, w, c) by the names of maps.
    used : str
        Names of the images of the last run, in lines.
    in_floats : bool
        Whether images hold floats; colors always do.
    """
    before = dict(line.split("\t") for line in used.splitlines() if "\t" in line)
    made = {}
    for name, values in found.items():
        is_float = in_floats or name == "colors"
        pixels = np.ones((*values.shape[:2], 4), dtype=np.float32)
        pixels[..., :3] = values[..., :3]
        if not is_float:
            _dither(pixels)
        title = f"{target.name}_{SUFFIXES[name]}"
        made[name] = fields.add_or_reuse(title, before.get(name, ""), pixels, is_float)
        images.keep(made[name])
    return made


def show(target: BakeTarget, made: dict[str, bpy.types.Image]) -> tuple[list[str], list[str]]:
    """Put maps into the active materials of objects: normals and colors linked, others not.

    Returns
    -------
    lost : list of str
        A sentence for each object that was left alone.
    notes : list of str
        A sentence for each object that got a material, or could not get the maps.
    """
    (objects, lost), notes = find_again(target.objects), []
    for obj in objects:
        material = obj.active_material
        if material is None and not mesh_refusal(obj.data):
            material = fields.give_material(obj)
            text = pgettext_rpt("{name} had no material, and got one with the maps.")
            notes.append(text.format(name=obj.name))
        if material is None or material.library is not None or material.node_tree is None:
            text = pgettext_rpt("{name} cannot take a node; name {image} in one by hand.")
            names = listed([image.name for image in made.values()])
            notes.append(text.format(name=(material or obj).name, image=names))
            continue
        for key, image in made.items():
            node = fields.image_node(obj, material, image, activate=False)
            _link(material, key, node, fields.uv_map_to_name(obj.data))
    return lost, notes


def _link(material: bpy.types.Material, key: str, node: bpy.types.Node, uv_map: str) -> None:
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shader = next((each for each in nodes if each.type == "BSDF_PRINCIPLED"), None)
    if shader is None:
        return
    color, normal = shader.inputs["Base Color"], shader.inputs["Normal"]
    if key == "colors" and not color.is_linked:
        links.new(node.outputs["Color"], color)
    if key == "normals" and not normal.is_linked and not node.outputs["Color"].is_linked:
        between = nodes.new("ShaderNodeNormalMap")
        between.location = node.location[0] + 300.0, node.location[1]
        between.uv_map = uv_map  # along which the tangents run
        links.new(node.outputs["Color"], between.inputs["Color"])
        links.new(between.outputs["Normal"], normal)


def _joined(parts: list[WorldMesh]) -> WorldMesh:
    firsts = np.cumsum([0, *(len(part.positions) for part in parts)])
    colors = [part.colors for part in parts if part.colors is not None]
    return WorldMesh(
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.triangles + n for part, n in zip(parts, firsts, strict=False)]),
        np.concatenate(colors) if len(colors) == len(parts) else None,
    )


def _dither(pixels: npt.NDArray[np.float32]) -> None:
    # Noise of one step of 8 bits, so that slow ramps show no bands; flat ends stay.
    noise = np.random.default_rng(0).random(pixels.shape[:2], dtype=np.float32) - np.float32(0.5)
    shown = (pixels[..., :3] > 0) & (pixels[..., :3] < 1)
    pixels[..., :3] += np.where(shown, noise[..., None] / 255, 0)
    np.clip(pixels, 0.0, 1.0, out=pixels)
