# SPDX-License-Identifier: GPL-3.0-or-later
"""A sheet with a texture, for tests of live textures, and what is seen of it."""

import bpy
import numpy as np
from shock_filter.shock_addon.data.image import images, mixing
from shock_filter.shock_addon.data.materials import live_mix

SIZE = 32


def add_image(name, pixels, is_data=True):
    image = bpy.data.images.new(name, SIZE, SIZE, alpha=True, float_buffer=True, is_data=is_data)
    image.pixels.foreach_set(np.ascontiguousarray(pixels, dtype=np.float32).reshape(-1))
    image.update()
    return image


def add_wood():
    """Add an image with a soft border, on a sheet that shows it by Emission."""
    place = (np.arange(SIZE) + 0.5) / SIZE
    step = np.broadcast_to(0.5 + 0.4 * np.tanh((place - 0.5) / 0.1), (SIZE, SIZE))
    image = add_image("Wood", np.stack([step, 1 - step, step, 1 + 0 * step], axis=-1))
    bpy.ops.mesh.primitive_plane_add(size=2)
    material = bpy.data.materials.new("Wood")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    node, light, end = map(
        tree.nodes.new, ("ShaderNodeTexImage", "ShaderNodeEmission", "ShaderNodeOutputMaterial")
    )
    node.image, node.interpolation = image, "Closest"
    tree.links.new(node.outputs["Color"], light.inputs["Color"])
    tree.links.new(light.outputs["Emission"], end.inputs["Surface"])
    bpy.context.object.data.materials.append(material)
    return image


def tree():
    return bpy.data.materials["Wood"].node_tree


def node_of(image):
    return next(each for each in tree().nodes if getattr(each, "image", None) == image)


def baked():
    """Return what is seen of the sheet, texel by texel."""
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    scene.cycles.device = "CPU"
    image = bpy.data.images.get("Baked") or add_image("Baked", np.zeros((SIZE, SIZE, 4)))
    target = tree().nodes.new("ShaderNodeTexImage")
    target.image, tree().nodes.active = image, target
    bpy.ops.object.bake(type="EMIT", margin=0)
    tree().nodes.remove(target)
    return images.read_pixels(image)[..., :3].copy()


def amount(value):
    live_mix(node_of(bpy.data.images["Wood"])).inputs[mixing.AMOUNT].default_value = value
