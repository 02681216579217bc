# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender properties, made from the core's settings, and the way back."""

from __future__ import annotations

import math
from typing import Any

import bpy

from ...core.settings import (
    BeltramiGeometrySettings,
    BeltramiMeshSettings,
    BeltramiSettings,
    DilateSettings,
    GeometrySettings,
    ImageSettings,
    Setting,
    ShockSettings,
    TextureSettings,
    describe,
)

STEADY_STATE = "steady_state"

_WIDE = 100.0
"""Numbers with a larger range are shown with one digit after the point instead of three."""


def annotations_of(settings: type, prefix: str = "") -> dict[str, Any]:
    """Make the annotations of a Blender class from a settings class.

    Each field becomes a property of the same name, after the prefix. Blender's numbers cannot be
    infinite, so a time that may be has a checkbox for the steady state beside it.
    """
    annotations = {}
    for name, (kind, default, about) in describe(settings).items():
        annotations[prefix + name] = _property(name, kind, default, about)
        if name == "time" and math.isinf(about.maximum):
            annotations[STEADY_STATE] = bpy.props.BoolProperty(
                name="Steady State",
                description="Flow until nothing changes any more: the time is infinite",
                default=math.isinf(default),
            )
    return annotations


def label(name: str) -> str:
    """Turn a setting's name into the words on screen."""
    return name.replace("_", " ").title()


def settings_from(settings: type, owner: Any, prefix: str = "") -> Any:
    """Read a settings object from the properties of an operator or property group.

    Parameters
    ----------
    settings : type
    owner : bpy.types.Operator or bpy.types.PropertyGroup
    prefix : str
        What the properties' names begin with.

    Raises
    ------
    InvalidSettings
        If the values contradict each other.
    """
    values = {}
    for name, (kind, _, about) in describe(settings).items():
        value = getattr(owner, prefix + name)
        if kind is float:
            value = min(max(shortest(value), about.minimum), about.maximum)
        values[name] = value
    if values.get("fidelity"):  # the panel grays the radius out, which says the same
        values.pop("screening_radius")
    if getattr(owner, STEADY_STATE, False):
        values["time"] = math.inf
    return settings(**values)


def shortest(value: float) -> float:
    """Read a float property: Blender keeps 0.1 as 0.100000001, but 0.1 was typed."""
    import numpy as np

    return float(str(np.float32(value)))


def _property(name: str, kind: type, default: Any, about: Setting) -> Any:
    text = {"name": about.label or label(name), "description": about.description}
    if about.unit:
        text["description"] += f".\nUnit: {about.unit}"
    if kind is str:
        items = [(word, label(word), meaning) for word, meaning in about.choices.items()]
        return bpy.props.EnumProperty(items=items, default=default, **text)
    low = max(about.minimum, about.soft_minimum)
    high = min(about.maximum, about.soft_maximum)
    limits = {"min": about.minimum, "max": about.maximum, "soft_min": low, "soft_max": high}
    limits = {key: kind(limit) for key, limit in limits.items() if math.isfinite(limit)}
    if kind is int:
        return bpy.props.IntProperty(default=default, **limits, **text)
    return bpy.props.FloatProperty(
        default=default,
        precision=1 if high - low > _WIDE else 3,
        step=_step(default, high - low),
        **limits,
        **text,
    )


def _step(default: float, width: float) -> float:
    """Choose what a click on an arrow or a pixel of dragging adds, in hundredths.

    It is a hundredth of the range, but at most a sixteenth of the default.
    """
    return min(width, 100.0 * default / 16.0) if default else width


_WHERE = {
    "vertex_group": bpy.props.StringProperty(
        name="Vertex Group",
        description="Vertices with weight 1 change fully, with weight 0 not at all."
        " Empty changes all vertices",
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
}


def _output(*items: tuple[str, str, str]) -> Any:
    return bpy.props.EnumProperty(name="Output", items=items, default=items[0][0])


def _weld(description: str) -> Any:
    return bpy.props.BoolProperty(name="Weld", description=description, default=True)


_SHADING = {
    "custom_normals": bpy.props.EnumProperty(
        name="Custom Normals",
        description="What happens to custom normals, on meshes that have them",
        items=[
            ("KEEP", "Keep", "Keep them; they turn along with the surface"),
            (
                "RECOMPUTE",
                "Recompute",
                "Set them anew from the new surface and its sharp edges, where vertices may change",
            ),
            ("CLEAR", "Clear", "Remove them from the whole mesh"),
        ],
        default="KEEP",
    ),
    "mark_sharp": bpy.props.BoolProperty(
        name="Mark Sharp",
        description="Afterwards mark edges as sharp where faces meet at more than the angle and"
        " vertices may change, so that smooth shading breaks there. Marks that are there stay",
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


class GeometryProperties:
    """All parameters of the operator Sharpen Geometry; the panel keeps the same ones."""

    __annotations__ = {
        **annotations_of(GeometrySettings),
        **_WHERE,
        "output": _output(
            (
                "MESH",
                "Mesh",
                "Move the vertices; on a mesh with shape keys, those of the active key",
            ),
            (
                "SHAPE_KEY",
                "New Shape Key",
                "Keep the mesh and put the new shape into a new shape key, whose value"
                " sets the strength",
            ),
        ),
        "weld": _weld(
            "Vertices at exactly the same place move together, so that meshes that are split"
            " along UV seams do not crack open. Nothing is merged"
        ),
        **_SHADING,
    }


class ColorProperties:
    """All parameters of the operator Sharpen Colors; the panel keeps the same ones."""

    __annotations__ = {
        **annotations_of(ShockSettings),
        "attribute": bpy.props.StringProperty(
            name="Attribute",
            description="Color attribute to work on. Empty takes each object's active one",
        ),
        **_WHERE,
        "weld": _weld(
            "Vertices at exactly the same place count as one where their colors agree, so that"
            " colors flow across UV seams of split meshes. Nothing is merged"
        ),
    }


_IMAGE_OUTPUT = {
    "output": _output(
        ("NEW", "New Image", "Keep the image and put the new one beside it"),
        (
            "REPLACE",
            "Replace",
            "Overwrite the image's pixels. Blender cannot undo this; the file on disk stays until"
            " you save the image",
        ),
    ),
}


class ImageProperties:
    """The parameters of the operator Sharpen Image that the panel keeps, too."""

    __annotations__ = {**annotations_of(ImageSettings), **_IMAGE_OUTPUT}


def texture_image(options: set[str]) -> Any:
    """Make the property that names a texture."""
    return bpy.props.StringProperty(
        name="Image",
        description="Texture to work on. Empty takes the one in the Image Editor, the one that is"
        " painted on in Texture Paint Mode, or that of the active Image Texture node in the active"
        " object's material",
        options=options,
    )


_TEXTURE = {
    "image": texture_image(set()),
    **_IMAGE_OUTPUT,
    "assign": bpy.props.BoolProperty(
        name="Assign",
        description="Show the new image instead of the old one in the materials of the objects",
        default=True,
    ),
}


class TextureProperties:
    """The parameters of the operator Sharpen Texture that the panel keeps, too."""

    __annotations__ = {
        **annotations_of(TextureSettings),
        **_WHERE,
        "mask_image": bpy.props.StringProperty(
            name="Mask Image",
            description="Image of the texture's size: white is sharpened fully, black not at all."
            " Empty sharpens everywhere",
        ),
        **_TEXTURE,
    }


class DilateProperties:
    """The parameters of the operator Dilate Texture; the panel keeps them with the others."""

    __annotations__ = {**annotations_of(DilateSettings), **_TEXTURE}


COLOR_PREFIX = "color_"
"""What the names of the settings for denoising colors begin with."""


def _then_sharpen(settings: type) -> dict[str, Any]:
    kind, default, about = describe(settings)["time"]
    about = about._replace(
        description="How long the result is sharpened. 0 changes nothing;"
        " 4096 pulls wide edges together",
    )
    return {
        "then_sharpen": bpy.props.BoolProperty(
            name="Then Sharpen",
            description="Sharpen what is denoised in the same run",
            default=False,
        ),
        "sharpen_time": _property("sharpen_time", kind, default, about),
    }


class DenoiseProperties:
    """All parameters of the operator Denoise; the panel keeps the same ones."""

    __annotations__ = {
        "target": bpy.props.EnumProperty(
            name="Target",
            description="What to denoise",
            items=[
                ("geometry", "Geometry", "Move vertices so that the surface becomes smooth between"
                 " its creases"),
                ("colors", "Colors", "Average colors within the areas between edges"),
                ("both", "Both", "Average vertices and colors with the same weights, so that edges"
                 " between colors keep the shape, too"),
            ],
        ),
        **annotations_of(BeltramiGeometrySettings),
        **annotations_of(BeltramiMeshSettings, COLOR_PREFIX),
        **_then_sharpen(GeometrySettings),
        **{name: ColorProperties.__annotations__[name] for name in ("attribute", *_WHERE)},
        "output": GeometryProperties.__annotations__["output"],
        "weld": _weld(
            "Vertices at exactly the same place count as one, so that meshes that are split along"
            " UV seams do not crack open; as to colors, where these agree. Nothing is merged"
        ),
        **_SHADING,
    }  # fmt: skip


class DenoiseImageProperties:
    """The parameters of the operator Denoise Image that the panel keeps, too."""

    __annotations__ = {
        **annotations_of(BeltramiSettings),
        **_then_sharpen(ImageSettings),
        **_IMAGE_OUTPUT,
    }


class SHOCK_FILTER_PG_denoise(DenoiseProperties, bpy.types.PropertyGroup):
    """The panel's parameters for denoising meshes and colors."""


class SHOCK_FILTER_PG_denoise_image(DenoiseImageProperties, bpy.types.PropertyGroup):
    """The Image Editor's parameters for denoising."""


class SHOCK_FILTER_PG_geometry(GeometryProperties, bpy.types.PropertyGroup):
    """The panel's parameters for geometry."""


class SHOCK_FILTER_PG_colors(ColorProperties, bpy.types.PropertyGroup):
    """The panel's parameters for colors."""


class SHOCK_FILTER_PG_image(ImageProperties, bpy.types.PropertyGroup):
    """The Image Editor's parameters."""


class SHOCK_FILTER_PG_texture(TextureProperties, bpy.types.PropertyGroup):
    """The panels' parameters for textures."""


class SHOCK_FILTER_PG_scene(bpy.types.PropertyGroup):
    """What the panels keep in each scene."""

    __annotations__ = {
        "mode": bpy.props.EnumProperty(
            name="Mode",
            description="What to do",
            items=[
                ("DENOISE", "Denoise", "Remove noise from vertices and colors; creases and edges"
                 " stay"),
                ("GEOMETRY", "Geometry", "Move vertices so that rounded creases become sharp"),
                ("COLORS", "Colors", "Move the colors on the surface so that blurred edges in"
                 " them become sharp"),
                ("TEXTURE", "Texture", "Move the colors of an image on the surface that shows it,"
                 " across seams, so that blurred edges in it become sharp"),
            ],
            default="GEOMETRY",
        ),
        "image_mode": bpy.props.EnumProperty(
            name="Mode",
            description="What to do with the image",
            items=[
                ("DENOISE_IMAGE", "Denoise", "Remove noise; edges stay"),
                ("IMAGE", "Image", "Sharpen it as a flat picture"),
                ("TEXTURE", "Texture", "Sharpen it on the surface of the selected objects that show"
                 " it, across seams"),
            ],
            default="IMAGE",
        ),
        "denoise": bpy.props.PointerProperty(type=SHOCK_FILTER_PG_denoise),
        "denoise_image": bpy.props.PointerProperty(type=SHOCK_FILTER_PG_denoise_image),
        "geometry": bpy.props.PointerProperty(type=SHOCK_FILTER_PG_geometry),
        "colors": bpy.props.PointerProperty(type=SHOCK_FILTER_PG_colors),
        "image": bpy.props.PointerProperty(type=SHOCK_FILTER_PG_image),
        "texture": bpy.props.PointerProperty(type=SHOCK_FILTER_PG_texture),
    }  # fmt: skip


NAMES = {
    "denoise": tuple(DenoiseProperties.__annotations__),
    "denoise_image": tuple(DenoiseImageProperties.__annotations__),
    "geometry": tuple(GeometryProperties.__annotations__),
    "colors": tuple(ColorProperties.__annotations__),
    "image": tuple(ImageProperties.__annotations__),
    "texture": tuple(TextureProperties.__annotations__),
}
"""The names of each mode's parameters; the scene keeps them under the mode's name."""


def denoise_names(target: str) -> list[str]:
    """List the parameters of the operator Denoise that matter for a target."""
    return [name for name in NAMES["denoise"] if name not in _WITHOUT[target]]


_GEOMETRY = set(describe(BeltramiGeometrySettings))
_COLORS = {COLOR_PREFIX + name for name in describe(BeltramiMeshSettings)} | {"attribute"}
_WITHOUT = {
    "geometry": _COLORS,
    "colors": _GEOMETRY | {"output", *_SHADING},
    "both": _GEOMETRY,
}


DILATE_NAMES = tuple(DilateProperties.__annotations__)
"""The names of the parameters of Dilate Texture, which are among those of textures."""

CLASSES = (
    SHOCK_FILTER_PG_denoise,
    SHOCK_FILTER_PG_denoise_image,
    SHOCK_FILTER_PG_geometry,
    SHOCK_FILTER_PG_colors,
    SHOCK_FILTER_PG_image,
    SHOCK_FILTER_PG_texture,
    SHOCK_FILTER_PG_scene,
)


def register() -> None:
    """Add the property groups and the scene's settings."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.shock_filter = bpy.props.PointerProperty(type=SHOCK_FILTER_PG_scene)


def unregister() -> None:
    """Remove them."""
    del bpy.types.Scene.shock_filter
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
