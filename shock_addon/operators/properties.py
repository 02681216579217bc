# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversion between Blender properties and settings of the core."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import bpy

from ...core.registry import WAYS, Filter, find
from ...core.settings import Setting, describe, named
from ..data import PICTURES
from ..modes import JOBS, MODES, STEADY_STATE, Mode, choices, job_of, modes_of
from ..modes import find as mode_of
from . import choosing

AUTO = "_auto"
"""Suffix of the names of switches that make a setting automatic."""

OWN_WORDS = "Shock Filter"
"""Translation context of properties whose words are not to be Blender's own."""

_WIDE = 100.0
"""Numbers with a larger range are shown with one decimal instead of three."""


def annotations_of(
    settings: type, prefix: str = "", defaults: Mapping[str, Any] = {}
) -> dict[str, Any]:
    """Make the annotations of a Blender class from a settings class.

    Each field becomes a property of the same name, after the prefix; `defaults` replaces defaults.
    Numbers in Blender cannot be infinite, so a time that may be infinite gets a checkbox for the
    steady state.
    """
    annotations = {}
    for name, (kind, default, about) in describe(settings).items():
        default = defaults.get(name, default)
        annotations[prefix + name] = _property(name, kind, default, about)
        if about.auto is not None:
            annotations[prefix + name + AUTO] = _auto(prefix + name, about)
        if about.role == "time" and math.isinf(about.maximum):
            annotations[prefix + STEADY_STATE] = bpy.props.BoolProperty(
                name="Steady State",
                description="Flow until nothing changes any more: the time is infinite",
                default=math.isinf(default),
            )
    return annotations


def _auto(name: str, about: Setting) -> Any:
    """Make the switch that sets a number to `Setting.auto`, and back."""

    def get(owner: Any) -> bool:
        return getattr(owner, name) == about.auto

    def set_(owner: Any, is_auto: bool) -> None:
        if is_auto != get(owner):
            setattr(owner, name, about.auto if is_auto else about.usual)

    return bpy.props.BoolProperty(
        name=about.auto_label,
        description=about.auto_description,
        get=get,
        set=set_,
        options={"HIDDEN", "SKIP_SAVE"},
    )


def label(name: str) -> str:
    """Convert the name of a setting to its label."""
    return name.replace("_", " ").title()


def settings_from(settings: type, owner: Any, prefix: str = "") -> Any:
    """Read a settings object from the properties of an operator or property group.

    Parameters
    ----------
    settings : type
    owner : bpy.types.Operator or bpy.types.PropertyGroup
    prefix : str
        Prefix of the names of the properties.
    """
    values = {}
    fields = describe(settings)
    for name, (kind, _, about) in fields.items():
        value = getattr(owner, prefix + name)
        if kind is float:
            value = min(max(shortest(value), about.minimum), about.maximum)
        values[name] = value
    if getattr(owner, prefix + STEADY_STATE, False):
        values[named(settings, "time")] = math.inf
    return settings(**values)


def settings_of(mode: Mode, owner: Any) -> Any:
    """Read the settings of a mode's filter: a `Denoising` if a sharpening may follow."""
    target = mode.target(owner)
    settings = settings_from(target.row.settings, owner, target.prefix)
    if mode.follows is None:
        return settings
    from ...core.host.inputs import Denoising

    return Denoising(settings, shortest(owner.sharpen_time) if owner.then_sharpen else None)


def shortest(value: float) -> float:
    """Return the shortest number that Blender stores as this one: 0.1 for 0.100000001."""
    import numpy as np

    return float(str(np.float32(value)))


def _property(name: str, kind: type, default: Any, about: Setting) -> Any:
    text = {"name": about.label or label(name), "description": about.description}
    if about.unit:
        text["description"] += f".\nUnit: {about.unit}"
    if kind is str:
        items = [(word, label(word), meaning) for word, meaning in about.choices.items()]
        if "creases" in about.choices:  # Blender's word for these differs from that on the buttons
            text["translation_context"] = OWN_WORDS
        return bpy.props.EnumProperty(items=items, default=default, **text)
    low = max(about.minimum, about.soft_minimum)
    high = min(about.maximum, about.soft_maximum)
    limits = {"min": kind(about.minimum), "soft_min": kind(low)}
    if high < math.inf:
        limits["soft_max"] = kind(high)
    if about.maximum < math.inf:
        limits["max"] = kind(about.maximum)
    if kind is int:
        return bpy.props.IntProperty(default=default, **limits, **text)
    return bpy.props.FloatProperty(
        default=default,
        precision=1 if high - low > _WIDE else 3,
        # A click on an arrow adds this, in hundredths: a hundredth of the range, or less.
        step=min(high - low, 100.0 * default / 16.0) if default > 0 else high - low,
        **limits,
        **text,
    )


def _output(*items: tuple[Any, ...]) -> Any:
    return bpy.props.EnumProperty(name="Output", items=items, default=items[0][0])


def _weld(description: str) -> Any:
    return bpy.props.BoolProperty(name="Weld", description=description, default=True)


# Files keep the numbers.
_MESH_OUTPUT = _output(
    (
        "AUTO",
        "Auto",
        "New Object in Object Mode if a Remesh, Boolean, Bevel, Subdivision or Geometry Nodes"
        " modifier is the last one, so that the visible shape is filtered; otherwise Mesh",
        3,
    ),
    (
        "MESH",
        "Mesh",
        "Move the vertices; on a mesh with shape keys, those of the active key",
        0,
    ),
    (
        "SHAPE_KEY",
        "New Shape Key",
        "Keep the mesh and put the new shape into a new shape key, whose value sets the strength",
        1,
    ),
    (
        "OBJECT",
        "New Object",
        "Put the visible shape, with modifiers and shape keys applied, into a new object in the"
        " same place, and hide the original",
        2,
    ),
    (
        "LIVE",
        "Live",
        "Keep the mesh, and add a Geometry Nodes modifier that moves its vertices, by an amount"
        " that can be changed later and animated. From the result of other modifiers a live copy"
        " is made, which can be updated",
        4,
    ),
)

_COLORS_OUTPUT = _output(
    ("AUTO", "Auto", "Live if the colors are live already; otherwise Mesh", 3),
    ("MESH", "Mesh", "Replace the colors", 0),
    (
        "LIVE",
        "Live",
        "Keep the colors, and add a Geometry Nodes modifier that changes them, by an amount that"
        " can be changed later and animated",
        4,
    ),
)

OUTPUTS_OF_COLORS = ("AUTO", "MESH", "LIVE")
"""Those outputs of shapes that colors have; with others the colors are replaced."""

# Files keep the numbers.
_IMAGE_OUTPUTS = (
    ("NEW", "New Image", "Keep the image and add a new one", 0),
    (
        "REPLACE",
        "Replace",
        "Overwrite the image's pixels. Blender cannot undo this; the file on disk stays until"
        " you save the image",
        1,
    ),
)

_LIVE_TEXTURE = (
    "LIVE",
    "Live",
    "Keep the image, and mix it with the new one in the materials of the objects, by an amount"
    " that can be changed later and animated. A mask image becomes the mask of the mix, and can"
    " be painted",
    2,
)

_TEXTURE_IMAGE = {
    "name": "Image",
    "description": "Texture to filter. If empty: the one in the Image Editor, the one that is"
    " painted on in Texture Paint Mode, or that of the active Image Texture node in the active"
    " object's material",
}


def _maps(others: str) -> Any:
    return bpy.props.EnumProperty(
        name="Maps",
        description="Whether the other images of the material are filtered in the same run",
        items=[
            ("ONE", "This One", "This image only"),
            ("MATERIAL", "All of Material", others),
        ],
        default="ONE",
    )


def _picture(name: str) -> Any:
    return bpy.props.StringProperty(
        name=label(name),
        description="Another picture of the surface in the same UV map and of the same size,"
        " such as a photo projected from another side. It counts where it is opaque",
    )


_DRAWN = "distance", "streaks", "pattern", "curvature", "occlusion", "thickness", "wear"
"""Kinds of images that are drawn from the mesh alone."""

_STARTS = [
    (
        "AUTO",
        "Auto",
        "The vertices and edges that are selected in Edit Mode; if nothing or everything is"
        " selected, the edges that are marked as sharp, or else the lowest vertices",
    ),
    ("SELECTED", "Selection", "The vertices and edges that are selected in Edit Mode"),
    ("LOWEST", "Lowest Point", "The lowest vertices in the scene, such as those on the ground"),
    ("GROUP", "Vertex Group", "The vertices with a weight of 0.5 or more in a vertex group"),
    ("SEAMS", "Marked Seams", "The edges that are marked as seams"),
    ("SHARP", "Marked Edges", "The edges that are marked as sharp"),
    ("IMAGE", "Painted Image", "Where an image of the same size is white"),
]

_PLACES = {
    "attribute": bpy.props.StringProperty(
        name="Attribute",
        description="Color attribute to filter. If empty, each object's active one is used",
    ),
    "vertex_group": bpy.props.StringProperty(
        name="Vertex Group",
        description="Vertices with weight 1 change fully, with weight 0 not at all. If empty,"
        " all vertices change",
    ),
    "invert_mask": bpy.props.BoolProperty(
        name="Invert",
        description="Change where the mask is 0 and protect where it is 1",
        default=False,
    ),
    "selected_only": bpy.props.BoolProperty(
        name="Selected Only",
        description="In Edit Mode, change only what is selected",
        default=True,
    ),
    "mask_image": bpy.props.StringProperty(
        name="Mask Image",
        description="Image of the texture's size: white is sharpened fully, black not at all. If"
        " empty, everything is sharpened",
    ),
    "gain_map": bpy.props.StringProperty(
        name="Gain Map",
        description="Image of the texture's size that sets the gain: white gives the Gain,"
        " middle gray (0.5) keeps detail as it is, black smooths it away. If empty, the Gain is"
        " used everywhere",
    ),
    "gain_colors": bpy.props.StringProperty(
        name="Gain Colors",
        description="Color attribute that sets the gain on the mesh: white gives the Gain,"
        " middle gray (0.5) keeps, black smooths. With a map, both gains are multiplied",
    ),
    "image": bpy.props.StringProperty(**_TEXTURE_IMAGE),
    **{name: _picture(name) for name in PICTURES},
    **{
        f"{kind} image": bpy.props.StringProperty(
            name="Image",
            description="Image whose pixels are replaced. If empty, a new one is made",
        )
        for kind in _DRAWN
    },
    "image_size": bpy.props.EnumProperty(
        name="Size",
        description="Width and height of a new image, in pixels",
        items=[(str(1 << n), f"{1 << n}", f"{1 << n} x {1 << n} pixels") for n in range(8, 14)],
        default="1024",
    ),
    "add_node": bpy.props.BoolProperty(
        name="Add Node",
        description="Add the image as an unlinked Image Texture node to each object's material;"
        " an object without a material gets one that shows it",
        default=True,
    ),
    "frames": bpy.props.IntProperty(
        name="Frames",
        description="How many frames there are",
        default=100,
        min=1,
        soft_max=1000,
    ),
    "in_colors": bpy.props.BoolProperty(
        name="Colors",
        description="Color each place by its speed, from dark blue to yellow",
    ),
    "folder": bpy.props.StringProperty(
        name="Folder",
        description="Folder for the frames, which is created if missing. If empty, a new one is"
        " made beside the blend file",
        subtype="DIR_PATH",
    ),
    "field": bpy.props.StringProperty(
        name="Attribute",
        description="Attribute of vectors, which are velocities; or of colors or numbers, such"
        " as Distance: the flow goes uphill",
    ),
    "y_axis": bpy.props.EnumProperty(
        name="Green",
        description="Where green points in the flow map",
        items=[
            ("UP", "Up", "As in maps for OpenGL and Blender"),
            ("DOWN", "Down", "As in maps for DirectX and Unreal"),
        ],
    ),
    "flow_map image": bpy.props.StringProperty(
        name="Flow Map",
        description="Image whose red is the velocity to the right and green the velocity up,"
        " with 0.5 for zero. If empty, the one in the Image Editor is used",
    ),
    "into": bpy.props.EnumProperty(
        name="Into",
        description="What is made",
        items=[
            ("IMAGE", "Image", "An image on the UV map"),
            (
                "ATTRIBUTE",
                "Attribute",
                "An attribute of the vertices, named Distance or Wear, for geometry nodes and"
                " shaders",
            ),
        ],
        default="IMAGE",
    ),
    "start": bpy.props.EnumProperty(
        name="From",
        description="Source of the distance, where it is 0",
        items=_STARTS,
        default="AUTO",
    ),
    "start_group": bpy.props.StringProperty(
        name="Group",
        description="Vertex group; vertices of weight 0.5 or more have the distance 0",
    ),
    "start_image": bpy.props.StringProperty(
        name="Painted",
        description="Image of the same size; where it is white (0.5 or more) the distance is 0",
    ),
    "along": bpy.props.EnumProperty(
        name="Along",
        description="Which way streaks run",
        items=[
            *((way.upper(), label(way), about) for way, about in WAYS.items()),
            ("ATTRIBUTE", "Attribute", "The direction of an attribute of the mesh"),
        ],
    ),
    "along_attribute": bpy.props.StringProperty(
        name="Attribute",
        description="Attribute of vectors, which streaks follow; or of colors or numbers, such"
        " as Distance: streaks run uphill",
    ),
    "stretch_along": bpy.props.EnumProperty(
        name="Along",
        description="Direction in which the pattern is stretched, by the factor Stretch",
        items=[
            ("NONE", "None", "It is alike in all directions"),
            *((way.upper(), label(way), about) for way, about in WAYS.items()),
        ],
    ),
    "occlude": bpy.props.BoolProperty(
        name="Others Occlude",
        description="Other visible objects also occlude",
        default=True,
    ),
    "marked": bpy.props.BoolProperty(
        name="Marked Edges",
        description="Only edges that are marked as sharp are worn, not those found automatically",
    ),
    "scale_map": bpy.props.StringProperty(
        name="Scale Map",
        description="Image of the same size: white gives the Scale, middle gray half of it. If"
        " empty, the Scale is used everywhere",
    ),
    "detail maps": _maps(
        "Also the other images in the materials that show it, such as roughness, height and"
        " normals, each by itself"
    ),
    "maps": _maps(
        "Also the other images in the materials that show it, such as roughness, metallic and"
        " normals. They follow the flow of the base color, so that borders lie in the same places"
    ),
    "geometry output": _MESH_OUTPUT,
    "colors output": _COLORS_OUTPUT,
    "both output": _MESH_OUTPUT,
    "texture output": _output(*_IMAGE_OUTPUTS, _LIVE_TEXTURE),
    "detail output": _output(*_IMAGE_OUTPUTS, _LIVE_TEXTURE),
    "output": _output(*_IMAGE_OUTPUTS),
    "assign": bpy.props.BoolProperty(
        name="Assign",
        description="Show the new image instead of the old one in the materials of the objects",
        default=True,
    ),
    "geometry weld": _weld(
        "Vertices at exactly the same place move together, so that meshes that are split along UV"
        " seams do not crack open. Nothing is merged"
    ),
    "colors weld": _weld(
        "Vertices at exactly the same place count as one where their colors agree, so that colors"
        " flow across UV seams of split meshes. Nothing is merged"
    ),
    "both weld": _weld(
        "Vertices at exactly the same place count as one (for colors only where these agree), so"
        " that meshes that are split along UV seams do not crack open. Nothing is merged"
    ),
    "custom_normals": bpy.props.EnumProperty(
        name="Custom Normals",
        description="What happens to custom normals, on meshes that have them",
        items=[
            ("KEEP", "Keep", "Keep them; they rotate with the surface"),
            (
                "RECOMPUTE",
                "Recompute",
                "Recompute them from the new surface and its sharp edges, where vertices may"
                " change",
            ),
            ("CLEAR", "Clear", "Remove them from the whole mesh"),
        ],
        default="KEEP",
    ),
    "geometry mark_sharp": bpy.props.BoolProperty(
        name="Mark Sharp",
        description="After the run, mark the edges of creases that were closed, or were sharp"
        " before, as sharp if they are stronger than the angle, so that smooth shading breaks"
        " there. Needs Where: Creases; has no effect on shape keys, or where custom normals are"
        " kept. Existing marks stay",
        default=True,
    ),
    "mark_sharp": bpy.props.BoolProperty(
        name="Mark Sharp",
        description="After the run, mark edges as sharp whose faces meet at more than the angle"
        " and whose vertices may change, so that smooth shading breaks there. Existing marks"
        " stay",
        default=False,
    ),
    "sharp_angle": bpy.props.FloatProperty(
        name="Sharp Angle",
        description="Edges whose faces meet at more than this angle are marked. 0 marks all that"
        " are not flat, 180 none",
        subtype="ANGLE",
        default=math.radians(30.0),
        min=0.0,
        max=math.pi,
    ),
}
"""Properties of the data: by name, or by kind of data and name where kinds differ."""

_RESULT = bpy.props.StringProperty(
    name="Result",
    description="Image that an earlier run has written, which redo writes again",
    options={"HIDDEN", "SKIP_SAVE"},
)

OF_ONE_RUN = {
    "image": {
        "image": bpy.props.StringProperty(
            name="Image",
            description="Image to filter. If empty, the one in the Image Editor is used",
            options={"SKIP_SAVE"},
        ),
        "result": _RESULT,
    },
    "texture": {
        "image": bpy.props.StringProperty(options={"SKIP_SAVE"}, **_TEXTURE_IMAGE),
        "result": _RESULT,
    },
}
OF_ONE_RUN["detail"] = OF_ONE_RUN["stitch"] = OF_ONE_RUN["texture"]
OF_ONE_RUN |= {kind: {"result": _RESULT} for kind in _DRAWN}
OF_ONE_RUN["flow_map"] = {
    "image": bpy.props.StringProperty(
        name="Flow Map",
        description="Image whose red is the velocity to the right and green the velocity up,"
        " with 0.5 for zero. If empty, the one in the Image Editor is used",
        options={"SKIP_SAVE"},
    ),
    "result": bpy.props.StringProperty(
        name="Result",
        description="Folder that an earlier run has written, which redo writes again",
        options={"HIDDEN", "SKIP_SAVE"},
    ),
}
"""Properties of operators on a kind of data that the panel does not have."""


@cache
def parameters_of(mode: Mode) -> dict[str, Any]:
    """Make the annotations that a mode's property group and its operator share."""
    found: dict[str, Any] = {}
    if len(mode.targets) > 1:
        found["target"] = bpy.props.EnumProperty(
            name="Target",
            description=f"What to {mode.label.lower()}",
            items=[(target.key, target.label, target.about) for target in mode.targets],
        )
    for target in mode.targets:
        found |= annotations_of(target.row.settings, target.prefix, target.defaults)
    if mode.follows is not None:
        found |= _then_sharpen(mode.targets[0].row)
    for target in mode.targets:
        for name in target.places:
            found[name] = _PLACES.get(f"{target.data_kind} {name}") or _PLACES[name]
    if "start" in found:
        found[FROM] = _from()
    if "blending" in found:
        found[LENGTH] = _length()
    return found


FROM = "start_from"
"""The choice that combines `source` and `start`."""

_BORDERS = ("border", "seams")
"""Sources for which `start` does not count."""


def _from() -> Any:
    starts = _STARTS + [
        ("BORDER", "Mesh Border", "Where the mesh ends"),
        ("CHARTS", "Chart Borders", "Where charts or the mesh end"),
    ]
    given = len(_STARTS)

    def get(owner: Any) -> int:
        if owner.source in _BORDERS:
            return given + _BORDERS.index(owner.source)
        return [start for start, _, _ in _STARTS].index(owner.start)

    def set_(owner: Any, number: int) -> None:
        if number >= given:
            owner.source = _BORDERS[number - given]
        else:
            owner.source, owner.start = "given", _STARTS[number][0]

    return bpy.props.EnumProperty(
        name="From",
        description="From where distance counts",
        items=starts,
        get=get,
        set=set_,
        options={"HIDDEN", "SKIP_SAVE"},
    )


LENGTH = "streak_frames"
"""The number that shows `blending` as the length of streaks."""


def _length() -> Any:
    def get(owner: Any) -> float:
        return 1.0 / owner.blending

    def set_(owner: Any, frames: float) -> None:
        owner.blending = 1.0 / frames

    return bpy.props.FloatProperty(
        name="Length",
        description="How long streaks are: the number of frames over which they fade. 5 draws"
        " short ones, 20 long ones; 1 shows the plain noise.\nUnit: frames",
        get=get,
        set=set_,
        min=1.0,
        max=200.0,
        soft_min=2.0,
        soft_max=33.0,
        precision=1,
        step=100,
        options={"HIDDEN", "SKIP_SAVE"},
    )


def _then_sharpen(row: Filter) -> dict[str, Any]:
    kind, _, about = describe(find(row.then).settings)["time"]
    text = "How long the result is sharpened. 0 changes nothing; 4096 closes wide edges"
    return {
        "then_sharpen": bpy.props.BoolProperty(
            name="Then Sharpen",
            description="Sharpen the denoised result in the same run",
            default=False,
        ),
        "sharpen_time": _property(
            "sharpen_time", kind, row.then_time, about._replace(description=text, minimum=0.0)
        ),
    }


def _choice(description: str, in_images: bool) -> Any:
    return bpy.props.EnumProperty(
        name="Mode",
        description=description,
        items=[
            (mode.key.upper(), mode.label, (in_images and mode.about_in_images) or mode.about)
            for mode in MODES
            if (mode.data.in_images if in_images else mode.data.on_surface)
        ],
        default="IMAGE" if in_images else "GEOMETRY",
        update=choosing.was_chosen,
    )


def _job(choice: str) -> Any:
    """Make the choice of the first row, which reads and sets the mode."""
    jobs = JOBS[choice]

    def get(group: Any) -> int:
        return jobs.index(job_of(choice, choosing.mode(bpy.context, choice)))

    def set_(group: Any, number: int) -> None:
        setattr(group, choice, modes_of(choice, jobs[number])[0].key.upper())

    return bpy.props.EnumProperty(
        name="Job",
        description="What to work on",
        items=[(job.key, job.label, job.about) for job in jobs],
        get=get,
        set=set_,
        options={"HIDDEN", "SKIP_SAVE"},
    )


_NOISY = {"geometry": "Mesh", "colors": "Colors", "both": "Both"}
"""What the second row of Denoise calls the targets of a mesh."""


def _noisy() -> Any:
    """Make the choice of the second row of Denoise, which sets the mode or its target."""
    targets = mode_of("denoise").targets
    items = [(target.key, _NOISY[target.key], target.about) for target in targets]
    items.append(("texture", "Texture", mode_of("denoise_texture").about))

    def get(group: Any) -> int:
        if choosing.mode(bpy.context, "mode").key == "denoise_texture":
            return len(targets)
        return [target.key for target in targets].index(group.denoise.target)

    def set_(group: Any, number: int) -> None:
        if number == len(targets):
            group.mode = "DENOISE_TEXTURE"
        else:
            group.mode, group.denoise.target = "DENOISE", targets[number].key

    return bpy.props.EnumProperty(
        name="Denoise",
        description="What to denoise",
        items=items,
        get=get,
        set=set_,
        options={"HIDDEN", "SKIP_SAVE"},
    )


def _group(name: str, about: str, annotations: dict[str, Any]) -> type:
    parts = {"__doc__": about, "__module__": __name__, "__annotations__": annotations}
    return type(f"SHOCK_FILTER_PG_{name}", (bpy.types.PropertyGroup,), parts)


_classes: list[type] = []


def register() -> None:
    """Add the property groups and the scene's settings."""
    kept = {
        "mode": _choice("What to do", in_images=False),
        "image_mode": _choice("What to do with the image", in_images=True),
        "job": _job("mode"),
        "image_job": _job("image_mode"),
        "noisy": _noisy(),
    }
    for mode in choices():
        about = f"The panel's parameters for the mode {label(mode.key)}."
        _classes.append(_group(mode.key, about, parameters_of(mode)))
        kept[mode.key] = bpy.props.PointerProperty(type=_classes[-1])
    _classes.append(_group("scene", "What the panels keep in each scene.", kept))
    for cls in _classes:
        bpy.utils.register_class(cls)
    bpy.types.Scene.shock_filter = bpy.props.PointerProperty(type=_classes[-1])


def unregister() -> None:
    """Remove them."""
    del bpy.types.Scene.shock_filter
    for cls in reversed(_classes):
        bpy.utils.unregister_class(cls)
    _classes.clear()


def reset_unknown_choices() -> None:
    """Reset choices that only a newer version knows, in all scenes; their values are empty."""
    for scene in bpy.data.scenes:
        kept = scene.shock_filter
        for group in (kept, *(getattr(kept, mode.key) for mode in choices())):
            for rna in group.bl_rna.properties:
                is_choice = rna.type == "ENUM" and not rna.is_enum_flag and not rna.is_skip_save
                if is_choice and not getattr(group, rna.identifier):
                    group.property_unset(rna.identifier)
