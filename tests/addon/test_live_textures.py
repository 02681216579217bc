# SPDX-License-Identifier: GPL-3.0-or-later
"""Textures with the output Live: nodes that mix an image with its result."""

import bpy
import numpy as np
import pytest
from shock_filter.shock_addon.data import LIVE_TEXTURE
from shock_filter.shock_addon.data.image import images, mixing
from shock_filter.shock_addon.data.live import graph, recipes
from shock_filter.shock_addon.data.materials import active_image, live_mask, live_mix
from shock_filter.shock_addon.operators import base
from shock_filter.shock_addon.operators.base import summaries
from wooden import SIZE, add_image, amount, baked, node_of, tree

sharpen = bpy.ops.shock_filter.sharpen_texture


def test_amounts_go_from_the_image_to_the_result(wood):
    before = baked()
    assert sharpen(output="LIVE") == {"FINISHED"}
    result = images.read_pixels(bpy.data.images["Wood sharpened"])[..., :3]
    assert np.abs(result - before).max() > 0.05
    for value in (1.0, 0.0, 0.5, 2.0, -1.0):
        amount(value)
        want = before + value * (result - before)
        np.testing.assert_allclose(baked(), want, rtol=0, atol=2e-6)
    assert node_of(wood).image == wood


def test_pressing_again_starts_from_the_image_and_keeps_the_amount(wood):
    sharpen(output="LIVE")
    amount(0.25)
    first, count = bpy.data.images["Wood sharpened"], len(tree().nodes)
    sharpen(output="LIVE", time=4.0)
    assert len(tree().nodes) == count
    (node,) = mixing.results(["Plane"], wood)
    assert node.image not in (wood, first) and node.interpolation == "Closest"
    mix = live_mix(node_of(wood))
    assert mix.inputs[mixing.AMOUNT].default_value == 0.25


def test_another_output_takes_the_nodes_away(wood, capfd):
    nodes = [each.bl_idname for each in tree().nodes]
    mask = add_image("Mask", np.ones((SIZE, SIZE, 4)))
    sharpen(output="LIVE", mask_image=mask.name, invert_mask=True)
    assert len(tree().nodes) > len(nodes)
    sharpen(output="NEW", image=wood.name)
    assert [each.bl_idname for each in tree().nodes] == nodes
    assert "The live mix of Wood in the materials was removed." in capfd.readouterr().out
    result = next(each.image for each in tree().nodes if each.type == "TEX_IMAGE")
    np.testing.assert_allclose(baked(), images.read_pixels(result)[..., :3], rtol=0, atol=1e-6)


def test_a_filter_that_changes_nothing_leaves_the_mix_of_another(wood):
    sharpen(output="LIVE")
    shown = baked()
    bpy.ops.shock_filter.fill_texture(output="NEW", image=wood.name)
    assert summaries["fill"].startswith("Nothing in Wood has changed, so no copy was made")
    assert "live mix" not in summaries["fill"]
    np.testing.assert_array_equal(baked(), shown)


def test_a_filter_that_would_fill_the_gutter_alone_leaves_the_mix_of_another(wood):
    pixels = images.read_pixels(wood)
    pixels[...] = (0.2, 0.4, 0.6, 1.0)
    pixels[:, : SIZE // 2, :3] = 0.0
    wood.pixels.foreach_set(pixels.ravel())
    for point in bpy.context.object.data.uv_layers[0].uv:
        point.vector.x = 0.6 + 0.4 * point.vector.x
    sharpen(output="LIVE")
    count = len(bpy.data.images)
    bpy.ops.shock_filter.denoise_texture(output="NEW", image=wood.name, gutter=8)
    assert summaries["denoise_texture"].startswith("Nothing in Wood has changed, so no copy")
    assert len(bpy.data.images) == count and live_mix(node_of(wood)) is not None


@pytest.mark.parametrize("inverted", [False, True])
def test_a_mask_image_can_be_painted_afterwards(wood, inverted):
    before = baked()
    pixels = np.ones((SIZE, SIZE, 4), np.float32)
    mask = add_image("Mask", pixels)
    sharpen(output="LIVE", mask_image=mask.name, invert_mask=inverted)
    result = images.read_pixels(bpy.data.images["Wood sharpened"])[..., :3]
    np.testing.assert_allclose(baked(), before if inverted else result, rtol=0, atol=2e-6)
    pixels[: SIZE // 2, :, :3] = 0.0
    images.write_parts(mask, {images.UNTILED: pixels}, pack=False)
    mask.update()
    shown = baked()
    one, other = (result, before) if inverted else (before, result)
    np.testing.assert_allclose(shown[: SIZE // 2], one[: SIZE // 2], rtol=0, atol=2e-6)
    np.testing.assert_allclose(shown[SIZE // 2 :], other[SIZE // 2 :], rtol=0, atol=2e-6)


def test_a_run_follows_names_that_change_meanwhile(wood, monkeypatch):
    mask = add_image("Mask", np.ones((SIZE, SIZE, 4)))
    obj, run = bpy.context.object, base.Task.run

    def rename(task, progress):
        found = run(task, progress)
        obj.name, wood.name, mask.name = "Sheet", "Oak", "Where"
        add_image("Mask", np.zeros((SIZE, SIZE, 4)))
        return found

    monkeypatch.setattr(base.Task, "run", rename)
    assert sharpen(output="LIVE", mask_image=mask.name) == {"FINISHED"}
    mix = live_mix(node_of(wood))
    assert live_mask(mix)[0].image == mask
    _, settings = recipes.noted(mix, LIVE_TEXTURE)
    kept = {name: settings[name] for name in ("image", "mask_image", "objects")}
    assert kept == {"image": "Oak", "mask_image": "Where", "objects": ["Sheet"]}


def test_before_and_after_swap_it(wood):
    before = baked()
    sharpen(output="LIVE")
    after = baked()
    assert (after != before).any()
    bpy.ops.shock_filter.before_after()
    np.testing.assert_allclose(baked(), before, rtol=0, atol=2e-6)
    bpy.ops.shock_filter.before_after()
    np.testing.assert_array_equal(baked(), after)
    assert node_of(wood).image == wood


def test_normal_maps_are_known_behind_the_mix(wood):
    bumps = tree().nodes.new("ShaderNodeNormalMap")
    tree().links.new(node_of(wood).outputs["Color"], bumps.inputs["Color"])
    from shock_filter.shock_addon.data.image.maps import normals_in

    assert normals_in(bpy.context, wood) == "normals"
    sharpen(output="LIVE")
    assert live_mix(node_of(wood)) is not None
    assert normals_in(bpy.context, wood) == "normals"


@pytest.mark.parametrize("name", ["dilate", "denoise", "filter", "fill"])
def test_other_filters_of_textures_have_it_too(wood, name):
    getattr(bpy.ops.shock_filter, f"{name}_texture")(output="LIVE")
    found = mixing.results(["Plane"], wood)
    assert [node.image for node in found] != [wood]
    assert node_of(wood).image == wood


def replaced_link(name):
    """Return the sockets that the input of a mix joins, after taking the link away."""
    mix = live_mix(node_of(bpy.data.images["Wood"]))
    (link,) = mix.inputs[name].links
    ends = link.from_socket, link.to_socket
    tree().links.remove(link)
    return ends


def test_replacing_takes_the_mix_away_and_undo_brings_it_back(wood):
    nodes = [each.bl_idname for each in tree().nodes]
    sharpen(output="LIVE")
    bpy.ops.ed.undo_push(message="Live")
    sharpen("EXEC_DEFAULT", True, image=wood.name, output="REPLACE")
    assert any("live mix of Wood" in text for text in summaries.values())
    assert [each.bl_idname for each in tree().nodes] == nodes
    wood = bpy.data.images["Wood"]
    np.testing.assert_allclose(baked(), images.read_pixels(wood)[..., :3], rtol=0, atol=2e-6)
    bpy.ops.ed.undo()
    assert live_mix(node_of(bpy.data.images["Wood"])) is not None


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        (mixing.OLD, "NodeReroute"),
        (mixing.NEW, ""),
        (mixing.NEW, "NodeReroute"),
        (mixing.NEW, "ShaderNodeInvert"),
        (mixing.NEW, "ShaderNodeTexImage"),
    ],
)
def test_a_mix_that_was_rewired_is_found_again(wood, name, kind):
    before = len(tree().nodes)
    sharpen(output="LIVE")
    count, (first,) = len(tree().nodes), mixing.results(["Plane"], wood)
    ahead, behind = replaced_link(name)
    if kind:
        between = tree().nodes.new(kind)
        if kind != "ShaderNodeTexImage":
            tree().links.new(ahead, between.inputs["Color" if len(between.inputs) > 1 else 0])
        tree().links.new(between.outputs[0], behind)
    sharpen(output="LIVE", image=wood.name, time=4.0)
    assert len(tree().nodes) == count + bool(kind)
    assert mixing.results(["Plane"], wood) == [first] and first.image != wood
    assert mixing._reads(live_mix(node_of(wood)).inputs[mixing.NEW], first)
    assert mixing.remove(["Plane"], wood)
    assert len(tree().nodes) == before + bool(kind)
    if kind:
        assert between in list(tree().nodes)


def test_results_that_are_not_linked_are_no_images_of_a_material(wood):
    sharpen(output="LIVE")
    replaced_link(mixing.NEW)
    assert active_image(bpy.data.materials["Wood"]) == wood


@pytest.mark.parametrize("room", [mixing, graph])
def test_groups_that_could_not_be_built_are_not_used(monkeypatch, room):
    def build(tree):
        tree.nodes.new("NodeGroupInput")
        raise RuntimeError("in the middle")

    monkeypatch.setattr(mixing, "_build", build)
    count = len(bpy.data.node_groups)
    with pytest.raises(RuntimeError, match="middle"):
        mixing._find_or_build() if room is mixing else graph.find_or_add("G", "key", 1, build)
    assert len(bpy.data.node_groups) == count
