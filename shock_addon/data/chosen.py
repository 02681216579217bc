# SPDX-License-Identifier: GPL-3.0-or-later
"""The objects and the image that an operator acts on; their data is not read."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
from bpy.app.translations import pgettext_rpt

from . import LIVE_COLORS, LIVE_SOURCE, LIVE_STAMP, MOVE
from .materials import active_image, masked_image
from .skipped import Skipped, sentences

CONVERTIBLE = {"CURVE", "SURFACE", "FONT", "META", "CURVES", "POINTCLOUD"}
"""Types of objects that Blender can convert to meshes."""

FLOW_MAP = "shock_filter_flow_map"
"""Key of the flow map that an image sequence shows, among the sequence's own properties."""

_MAKES_FACES = {"REMESH", "BOOLEAN", "BEVEL", "SUBSURF", "NODES"}
_KEEPS_FACES = {"WEIGHTED_NORMAL", "NORMAL_EDIT", "TRIANGULATE"}
_SMOOTH_BY_ANGLE = "Smooth by Angle"
"""The node group that Shade Auto Smooth adds, which marks edges only."""

_REFUSED = {
    "MOVIE": "it is a movie; save the frame as an image and open that",
    "SEQUENCE": "it is an image sequence; open its files one by one as single images",
    "TILED": "it has UDIM tiles; Sharpen Texture takes these, or open them one by one as single"
    " images",
    "VIEWER": "it is a render result or a viewer; save it (Image > Save As) and open the file",
}


def mesh_objects(context: bpy.types.Context) -> list[bpy.types.Object]:
    """List the mesh objects that an operator acts on; the active one comes first."""
    if context.mode == "OBJECT":
        objects = list(context.selected_objects)
    elif context.mode == "EDIT_MESH":
        objects = list(context.objects_in_mode)
    else:
        objects = [context.object]
    meshes = [obj for obj in objects if obj is not None and obj.type == "MESH"]
    return sorted(meshes, key=lambda obj: obj != context.object)


def modifier_on_top(obj: bpy.types.Object) -> bpy.types.Modifier | None:
    """Return the last modifier that is shown, if it makes faces that the mesh does not have.

    It is one of the kinds Remesh, Boolean, Bevel, Subdivision and Geometry Nodes; those above it
    that leave the shape as it is do not count.
    """
    shown = [each for each in obj.modifiers if each.show_viewport and not _keeps_faces(each)]
    return shown[-1] if shown and shown[-1].type in _MAKES_FACES else None


def _keeps_faces(modifier: bpy.types.Modifier) -> bool:
    if modifier.type != "NODES":
        return modifier.type in _KEEPS_FACES
    group = modifier.node_group
    if group is None or LIVE_STAMP in group or LIVE_COLORS in group:
        return True
    return group.name.startswith(_SMOOTH_BY_ANGLE)


def live_modifier(obj: bpy.types.Object, key: str = LIVE_STAMP) -> bpy.types.NodesModifier | None:
    """Return the modifier that shows an object's live result; None if it has none.

    That of live colors with the key `LIVE_COLORS`.
    """
    for modifier in obj.modifiers:
        group = modifier.node_group if modifier.type == "NODES" else None
        if group is not None and key in group:
            return modifier
    return None


def is_live_copy(obj: bpy.types.Object) -> bool:
    """Whether an object is a live copy, even if its source was removed.

    It is none any more once its live shape is gone, as by *Apply*: its mesh is the artist's then.
    """
    is_marked = LIVE_SOURCE in obj and obj.type == "MESH"
    return is_marked and MOVE in obj.data.attributes


def live_source(obj: bpy.types.Object) -> bpy.types.Object | None:
    """Return the object that a live copy was made of; None for other objects."""
    source = obj[LIVE_SOURCE] if is_live_copy(obj) else None
    is_there = isinstance(source, bpy.types.Object) and source.type == "MESH" and source != obj
    return source if is_there else None


def live_modifiers(obj: bpy.types.Object) -> list[bpy.types.NodesModifier]:
    """List the modifiers that show an object's live shape and colors."""
    found = [live_modifier(obj, key) for key in (LIVE_STAMP, LIVE_COLORS)]
    return [each for each in found if each is not None]


def is_live(obj: bpy.types.Object, key: str = LIVE_STAMP) -> bool:
    """Whether an object shows a live result that its mesh says how to make again."""
    return key in obj.data and live_modifier(obj, key) is not None


def mesh_users(context: bpy.types.Context) -> list[bpy.types.Object]:
    """List these objects without those that share the mesh of an earlier one."""
    users: dict[bpy.types.Mesh, bpy.types.Object] = {}
    for obj in mesh_objects(context):
        users.setdefault(obj.data, obj)
    return list(users.values())


def in_image_editor(context: bpy.types.Context) -> bool:
    """Whether the context is an Image Editor."""
    space = context.space_data
    return space is not None and space.type == "IMAGE_EDITOR"


def edited_image(context: bpy.types.Context) -> bpy.types.Image | None:
    """Return the image that the Image Editor shows, if the context is one."""
    return context.space_data.image if in_image_editor(context) else None


def flow_map_of(image: bpy.types.Image) -> bpy.types.Image:
    """Return the flow map that an image sequence shows, if one is known; else the image itself."""
    source = image.get(FLOW_MAP) if image.source == "SEQUENCE" else None
    return source if isinstance(source, bpy.types.Image) else image


def uids_of(objects: Sequence[bpy.types.Object]) -> dict[int, str]:
    """Return the names of objects by their uids, by which they are found after a run."""
    return {obj.session_uid: obj.name for obj in objects}


def find_again(uids: dict[int, str]) -> tuple[list[bpy.types.Object], list[str]]:
    """Return the objects of these uids, and a sentence for each that was removed meanwhile."""
    there = {obj.session_uid: obj for obj in bpy.data.objects if obj.data is not None}
    gone = pgettext_rpt("it was removed meanwhile")
    left = [(name, gone) for uid, name in uids.items() if uid not in there]
    return [there[uid] for uid in uids if uid in there], sentences(left)


def subjects(context: bpy.types.Context) -> set[int]:
    """Return the uids of a panel's data: the image in the Image Editor, or mesh objects."""
    image = edited_image(context)
    return {each.session_uid for each in (mesh_objects(context) if image is None else [image])}


def refusal(image: bpy.types.Image, tiles: bool = False) -> str:
    """Return why an image cannot be sharpened; empty if it can. UDIM tiles can be allowed."""
    if image.library is not None or image.override_library is not None:
        return "it is linked from another file; make it local first"
    if image.type == "MULTILAYER":
        return "it has several layers; save the one you want as an image of its own"
    if image.source in _REFUSED and not (tiles and image.source == "TILED"):
        return _REFUSED[image.source]
    is_saved = image.filepath_raw or image.packed_files
    if image.source == "TILED" and (image.is_dirty or not is_saved):
        return "it has tiles that are not saved; save it first (Image > Save)"
    if not image.size[0] * image.size[1]:
        return "it has no pixels; check that its file exists"
    return ""


def mesh_refusal(mesh: bpy.types.Mesh) -> str:
    """Return why a mesh cannot be changed; empty if it can."""
    if mesh.library is not None:
        return (
            "its mesh is linked from another file; make it local first (Object > Relations > Make"
            " Local > Selected Objects and Data)"
        )
    if mesh.override_library is not None:
        return (
            "its mesh is a library override, which Blender keeps as it is; make it local first"
            " (Object > Relations > Make Local > Selected Objects and Data)"
        )
    return ""


def shown_image(context: bpy.types.Context) -> bpy.types.Image:
    """Return the image to work on.

    It is the one in the Image Editor, or the one painted on in Texture Paint Mode; where that is
    the mask of a live texture, the texture itself. Else, or where that is a mask or a gain map of
    the panel, it is that of the active image texture node in the active object's material. If
    another node is active, it is the image of the base color, or the only image.

    Raises
    ------
    Skipped
        If there is none.
    """
    if in_image_editor(context):
        if edited_image(context) is None:
            raise Skipped("no image is open here; open one in the Image Editor")
        return edited_image(context)
    paint = context.tool_settings.image_paint
    if context.mode == "PAINT_TEXTURE" and paint.mode == "IMAGE":
        if paint.canvas is None:
            raise Skipped("nothing is painted on; choose an image in the Texture Slots")
        image = masked_image(context.object, paint.canvas) or paint.canvas
        if not _says_where(context, image):
            return image
    material = mesh_objects(context)[0].active_material
    if material is None:
        raise Skipped("it has no material; add one with an Image Texture node, or name an image")
    is_slot = context.mode == "PAINT_TEXTURE" and paint.mode == "MATERIAL"
    if is_slot and material.texture_paint_images:
        return material.texture_paint_images[material.paint_active_slot]
    return active_image(material)


def _says_where(context: bpy.types.Context, image: bpy.types.Image) -> bool:
    """Whether settings in the panel name an image as a mask or a gain map."""
    kept = context.scene.shock_filter
    groups = [getattr(kept, each.identifier) for each in kept.bl_rna.properties]
    names = ("mask_image", "gain_map")
    return any(getattr(group, name, "") == image.name for group in groups for name in names)


def chosen_image(context: bpy.types.Context, name: str) -> bpy.types.Image:
    """Return the image that the panel's buttons work on.

    In the Image Editor it is the visible image; elsewhere it is the one of this name, if any, or
    else that of `shown_image`.

    Raises
    ------
    Skipped
        If there is none.
    """
    if not name or edited_image(context) is not None:
        return shown_image(context)
    image = bpy.data.images.get(name)
    if image is None:
        raise Skipped(
            "there is no image named {name!r}; choose one of the file's images", name=name
        )
    return image
