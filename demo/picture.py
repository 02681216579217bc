# SPDX-License-Identifier: GPL-3.0-or-later
"""Render meshes side by side with Cycles."""

from __future__ import annotations

import contextlib
import math
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import bpy
import mathutils

SAMPLES = 16

PAINT = "Paint"

_APART = 20.0
"""Depth between columns, which is not seen: none is in another one's shadow."""


@dataclass(frozen=True)
class View:
    """How a shape is seen.

    Attributes
    ----------
    rotation : tuple of float
        Euler angles in degrees that turn the shape towards the camera, which looks along +Y.
    centre : tuple of float
        The point of the turned shape in the middle of its column (X, Z).
    size : float
        Width of a column in units of length; smaller is closer.
    light : tuple of float
        Where the lamp stands.
    """

    rotation: tuple[float, float, float]
    centre: tuple[float, float]
    size: float
    light: tuple[float, float, float]


def render(
    path: Path,
    view: View,
    columns: list[tuple[str, bpy.types.Mesh]],
    pixels: int,
    textures: list[bpy.types.Image] | None = None,
    lit: bool = False,
    normals: bool = False,
) -> None:
    """Render labelled meshes side by side, each `pixels` wide.

    Flat-shaded and without shadows, as that shows each face as it is: smooth shading would hide
    facets and blur creases. The texture of a column, or else a color attribute named `PAINT`, is
    shown as it is, without light. If `lit`, as people look at models: with lamps, shadows, and the
    shading that each mesh has; with `normals` the textures are tangent-space normals then.
    """
    scene = bpy.data.scenes.new("Picture")
    if lit:
        materials = [_lit(image, normals) for image in textures or [None] * len(columns)]
        _add_lamps(scene, view.light)
    elif textures:
        materials = [_paint(image) for image in textures]
    else:
        clay, paint = _clay(view.light), _paint()
        materials = [paint if PAINT in mesh.attributes else clay for _, mesh in columns]
    ink = _glowing("Ink")
    label_height = 0.07 * view.size
    for index, ((label, mesh), material) in enumerate(zip(columns, materials, strict=True)):
        left = (index - 0.5 * (len(columns) - 1)) * view.size
        if not lit:
            mesh.shade_flat()
        _add_mesh(scene, mesh, view, (left, index * _APART), material)
        _add_label(scene, label, (left, -0.5 * view.size), label_height, ink)
    _add_camera(scene, view.size, len(columns), label_height)
    scene.render.resolution_x = pixels * len(columns)
    scene.render.resolution_y = round(pixels * (1 + 2 * label_height / view.size))
    scene.render.filepath = str(path)
    _use_cycles(scene)
    if lit:
        _use_light(scene)
    with _silent_blender():
        bpy.ops.render.render(write_still=True, scene=scene.name)
    bpy.data.scenes.remove(scene)


@contextlib.contextmanager
def _silent_blender() -> Iterator[None]:
    """Drop what Cycles prints of its progress, which goes past Python's stdout."""
    sys.stdout.flush()
    stdout = os.dup(1)
    with open(os.devnull, "wb") as nothing:
        os.dup2(nothing.fileno(), 1)
        try:
            yield
        finally:
            os.dup2(stdout, 1)
            os.close(stdout)


def _glowing(name: str) -> bpy.types.Material:
    """A material that is as bright as its emission, black so far."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    material.cycles.emission_sampling = "NONE"  # it is seen, but lights nothing else
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    emission = nodes.new("ShaderNodeEmission")
    emission.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    output = nodes.new("ShaderNodeOutputMaterial")
    links.new(emission.outputs["Emission"], output.inputs["Surface"])
    return material


def _clay(light: tuple[float, float, float]) -> bpy.types.Material:
    """Clay under one lamp: brightness goes by the angle to it, also where a face looks away."""
    material = _glowing("Clay")
    nodes, links = material.node_tree.nodes, material.node_tree.links
    normal = nodes.new("ShaderNodeNewGeometry")
    cosine = nodes.new("ShaderNodeVectorMath")
    cosine.operation = "DOT_PRODUCT"
    cosine.inputs[1].default_value = mathutils.Vector(light).normalized()
    linear = nodes.new("ShaderNodeMapRange")
    linear.inputs["From Min"].default_value = -1.0
    brightness = nodes.new("ShaderNodeMath")
    brightness.operation = "POWER"
    brightness.inputs[1].default_value = 2.5
    links.new(normal.outputs["Normal"], cosine.inputs[0])
    links.new(cosine.outputs["Value"], linear.inputs["Value"])
    links.new(linear.outputs["Result"], brightness.inputs[0])
    links.new(brightness.outputs["Value"], nodes["Emission"].inputs["Color"])
    return material


def _paint(image: bpy.types.Image | None = None) -> bpy.types.Material:
    """The image or the color attribute, darker where the surface turns away."""
    material = _glowing(PAINT)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    if image is None:
        color = nodes.new("ShaderNodeVertexColor")
        color.layer_name = PAINT
    else:
        color = nodes.new("ShaderNodeTexImage")
        color.image = image
    facing = nodes.new("ShaderNodeLayerWeight")
    shade = nodes.new("ShaderNodeMapRange")
    shade.inputs["To Min"].default_value = 1.0
    shade.inputs["To Max"].default_value = 0.3
    shaded = nodes.new("ShaderNodeVectorMath")
    shaded.operation = "SCALE"
    links.new(facing.outputs["Facing"], shade.inputs["Value"])
    links.new(color.outputs["Color"], shaded.inputs[0])
    links.new(shade.outputs["Result"], shaded.inputs["Scale"])
    links.new(shaded.outputs["Vector"], nodes["Emission"].inputs["Color"])
    return material


def _lit(image: bpy.types.Image | None, normals: bool) -> bpy.types.Material:
    """A matt material of the image's colors, or of a light gray and perhaps its normals."""
    material = bpy.data.materials.new("Lit")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    surface = nodes["Principled BSDF"].inputs
    surface["Roughness"].default_value = 0.55
    surface["Base Color"].default_value = (0.6, 0.62, 0.66, 1.0)
    if image is not None:
        color = nodes.new("ShaderNodeTexImage")
        color.image = image
        if normals:
            turn = nodes.new("ShaderNodeNormalMap")
            links.new(color.outputs["Color"], turn.inputs["Color"])
            links.new(turn.outputs["Normal"], surface["Normal"])
        else:
            links.new(color.outputs["Color"], surface["Base Color"])
    return material


def _add_lamps(scene: bpy.types.Scene, light: tuple[float, float, float]) -> None:
    """A lamp where `light` says, and a weak one on the other side."""
    x, y, z = light
    for place, strength in ((light, 3.6), ((-x, y, 0.3 * z), 0.5)):
        data = bpy.data.lights.new("Lamp", "SUN")
        data.energy, data.angle = strength, math.radians(3)
        lamp = bpy.data.objects.new("Lamp", data)
        lamp.rotation_euler = mathutils.Vector(place).to_track_quat("Z", "Y").to_euler()
        scene.collection.objects.link(lamp)


def _add_mesh(
    scene: bpy.types.Scene,
    mesh: bpy.types.Mesh,
    view: View,
    place: tuple[float, float],
    material: bpy.types.Material,
) -> None:
    mesh.materials.clear()
    mesh.materials.append(material)
    obj = bpy.data.objects.new(mesh.name, mesh)
    obj.rotation_euler = [math.radians(angle) for angle in view.rotation]
    obj.location = (place[0] - view.centre[0], place[1], -view.centre[1])
    scene.collection.objects.link(obj)


def _add_label(
    scene: bpy.types.Scene,
    text: str,
    place: tuple[float, float],
    height: float,
    material: bpy.types.Material,
) -> None:
    curve = bpy.data.curves.new(text, "FONT")
    curve.body = text
    curve.size = height
    curve.align_x = "CENTER"
    curve.align_y = "CENTER"
    curve.materials.append(material)
    label = bpy.data.objects.new(text, curve)
    label.rotation_euler = (math.radians(90), 0.0, 0.0)
    label.location = (place[0], -3.0, place[1])  # in front of the shapes
    scene.collection.objects.link(label)


def _add_camera(scene: bpy.types.Scene, size: float, columns: int, label_height: float) -> None:
    data = bpy.data.cameras.new("Camera")
    data.type = "ORTHO"
    data.sensor_fit = "HORIZONTAL"
    data.ortho_scale = size * columns
    camera = bpy.data.objects.new("Camera", data)
    camera.location = (0.0, -10.0, -label_height)
    camera.rotation_euler = (math.radians(90), 0.0, 0.0)
    scene.collection.objects.link(camera)
    scene.camera = camera


def _use_light(scene: bpy.types.Scene) -> None:
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.15
    scene.render.film_transparent = True  # else the weak light of the world is seen
    scene.render.image_settings.color_mode = "RGBA"
    scene.cycles.samples = 64
    scene.cycles.max_bounces = 1


def _use_cycles(scene: bpy.types.Scene) -> None:
    scene.world = bpy.data.worlds.new("White")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = SAMPLES  # for smooth outlines: the shading itself has no noise
    scene.cycles.max_bounces = 0
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.use_denoising = False
    scene.view_settings.view_transform = "Standard"
    scene.render.dither_intensity = 0.0  # its noise would only make the files larger
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGB"
    # The pictures say nothing about when and where they were made.
    for stamp in ("date", "time", "render_time", "frame", "camera", "scene", "filename", "memory"):
        setattr(scene.render, f"use_stamp_{stamp}", False)
