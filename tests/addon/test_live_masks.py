# SPDX-License-Identifier: GPL-3.0-or-later
"""Live textures: masks that are painted, or made of painted gain, and results made again."""

import bpy
import numpy as np
import pytest
import shock_filter
from shock_filter.shock_addon.data.image import images, mixing, stand_in
from shock_filter.shock_addon.data.materials import live_mask, live_mix
from shock_filter.shock_addon.operators.base import Task, summaries
from wooden import SIZE, add_image, amount, baked, node_of, tree

sharpen = bpy.ops.shock_filter.sharpen_texture
detail = bpy.ops.shock_filter.filter_texture
paint_where = bpy.ops.shock_filter.paint_live_texture
LEFT = np.s_[:, : SIZE // 2]


def mix_of(name="Wood"):
    return live_mix(node_of(bpy.data.images[name]))


def mask():
    return live_mask(mix_of())[0].image


def object_mode():
    bpy.ops.object.mode_set(mode="OBJECT")


def paint(image, where, value):
    pixels = images.read_pixels(image)
    pixels[where][..., :3] = value
    images.write_parts(image, {images.UNTILED: pixels}, pack=True)


def grays(value, where=LEFT):
    """Return a gain map that is middle gray but for a part."""
    pixels = np.full((SIZE, SIZE, 4), 0.5, np.float32)
    pixels[where] = value
    return add_image("Gain", pixels)


def result_of(name="Wood"):
    return mixing.results(["Plane"], bpy.data.images[name])[0].image


def test_painting_where_shows_the_result_under_the_brush_only(wood):
    before = baked()
    sharpen(output="LIVE")
    after = baked()
    assert paint_where() == {"FINISHED"}
    settings = bpy.context.tool_settings.image_paint
    assert bpy.context.mode == "PAINT_TEXTURE"
    assert (settings.mode, settings.canvas) == ("IMAGE", mask())
    assert mask().colorspace_settings.is_data and mask().packed_file is not None
    object_mode()
    np.testing.assert_array_equal(baked(), before)
    paint(mask(), LEFT, 1.0)
    shown = baked()
    np.testing.assert_allclose(shown[LEFT], after[LEFT], rtol=0, atol=2e-6)
    np.testing.assert_array_equal(shown[:, SIZE // 2 :], before[:, SIZE // 2 :])


def test_brushes_paint_by_the_uv_map_that_shows_the_texture(wood):
    layers = bpy.context.object.data.uv_layers
    shown = layers.active.name
    layers.active = layers.new(name="Light map")
    sharpen(output="LIVE")
    assert paint_where() == {"FINISHED"}
    object_mode()
    assert bpy.context.object.data.uv_layers.active.name == shown


def test_painting_where_is_one_step_of_undo_and_paints_on_the_same_mask_again(wood):
    sharpen(output="LIVE")
    count = len(tree().nodes)
    bpy.ops.ed.undo_push(message="Live")
    paint_where("EXEC_DEFAULT", True)
    assert bpy.context.mode == "PAINT_TEXTURE"
    bpy.ops.ed.undo()
    assert bpy.context.mode == "OBJECT" and len(tree().nodes) == count
    assert live_mask(mix_of())[0] is None
    paint_where()
    first = mask()
    object_mode()
    paint(first, LEFT, 1.0)
    assert paint_where() == {"FINISHED"} and mask() == first
    assert images.read_pixels(first)[LEFT][..., 0].min() == 1.0


def test_a_press_while_the_mask_is_painted_works_on_the_texture(wood):
    sharpen(output="LIVE")
    paint_where()
    painted, first = mask(), result_of()
    sharpen(output="LIVE", time=4.0)
    assert bpy.context.mode == "PAINT_TEXTURE" and mask() == painted
    assert result_of() not in (first, wood)
    object_mode()


def test_the_mask_is_no_texture_of_the_material(wood):
    """Also where a shader's base color depends on it, and as a map among all of the material."""
    shader = tree().nodes.new("ShaderNodeBsdfPrincipled")
    tree().links.new(node_of(wood).outputs["Color"], shader.inputs["Base Color"])
    sharpen(output="LIVE")
    paint_where()
    object_mode()
    tree().nodes.active = shader
    assert sharpen(output="LIVE", maps="MATERIAL") == {"FINISHED"}
    assert {each.name for each in bpy.data.images if "Wood" in each.name} == {
        "Wood", "Wood sharpened", "Wood mask",
    }  # fmt: skip


@pytest.mark.parametrize("inverted", [False, True])
def test_a_mask_image_that_is_there_is_painted(wood, inverted):
    own = add_image("Own", np.ones((SIZE, SIZE, 4)))
    sharpen(output="LIVE", mask_image="Own", invert_mask=inverted)
    assert paint_where() == {"FINISHED"}
    assert bpy.context.tool_settings.image_paint.canvas == own == mask()
    object_mode()


def without_result(obj):
    object_mode()
    mixing.remove([obj.name], bpy.data.images["Wood"])


def without_uv(obj):
    obj.data.uv_layers.remove(obj.data.uv_layers[0])


def test_a_removed_result_comes_back(wood):
    sharpen(output="LIVE")
    wanted = images.read_pixels(result_of())
    tree().nodes.remove(mixing.results(["Plane"], wood)[0])
    assert paint_where() == {"FINISHED"}
    object_mode()
    shock_filter.live.update(bpy.context.object)
    np.testing.assert_array_equal(images.read_pixels(result_of()), wanted)


def masked_by_nodes(obj):
    noise = tree().nodes.new("ShaderNodeTexNoise")
    tree().links.new(noise.outputs[0], mix_of().inputs["Mask"])


def in_edit_mode(obj):
    bpy.ops.object.mode_set(mode="EDIT")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (without_result, "Make a texture of the active object live first"),
        (lambda obj: obj.data.materials.clear(), "Make a texture of the active object live first"),
        (without_uv, "it has no UV map"),
        (masked_by_nodes, "Nodes without an image go into Mask of"),
        (in_edit_mode, "Go to Object Mode first"),
        (lambda obj: bpy.data.objects.remove(obj), "Select a mesh object"),
    ],
)
def test_where_nothing_can_be_painted_a_sentence_says_why(wood, change, reason):
    sharpen(output="LIVE")
    change(bpy.context.object)
    count = len(bpy.data.images)
    with pytest.raises(RuntimeError, match=reason):
        paint_where()
    assert len(bpy.data.images) == count and bpy.context.mode != "PAINT_TEXTURE"


def test_linked_materials_are_not_painted(wood, tmp_path):
    sharpen(output="LIVE")
    path = str(tmp_path / "wood.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(path, link=True) as (there, wanted):
        wanted.materials = there.materials
    bpy.ops.mesh.primitive_plane_add()
    bpy.context.object.data.materials.append(bpy.data.materials["Wood"])
    with pytest.raises(RuntimeError, match="linked from another file"):
        paint_where()


def test_painted_gain_makes_a_mask_outside_of_which_nothing_changes(wood):
    before = baked()
    grays(1.0)
    assert detail(output="LIVE", gain=3.0, radius=4.0, gain_map="Gain") == {"FINISHED"}
    shown, white = baked(), images.read_pixels(mask())[..., 0]
    assert white[LEFT].min() == 1.0 and white[:, SIZE // 2 :].max() == 0.0
    np.testing.assert_array_equal(shown[:, SIZE // 2 :], before[:, SIZE // 2 :])
    assert np.abs(shown - before)[LEFT].max() > 0.01


def test_the_mask_follows_the_gain_until_it_is_painted_on(wood):
    gain_map = grays(1.0)
    settings = {"output": "LIVE", "gain": 3.0, "radius": 4.0, "gain_map": "Gain", "image": "Wood"}
    detail(**settings)
    first = mask()
    gain_map.pixels.foreach_set(np.ones(SIZE * SIZE * 4, np.float32))
    detail(**settings)
    assert mask() == first and images.read_pixels(first).min() == 1.0
    paint(first, LEFT, 0.0)
    painted = images.read_pixels(first)
    detail(**settings)
    assert mask() == first
    np.testing.assert_array_equal(images.read_pixels(first), painted)
    assert any("Wood mask was painted on, so it stayed" in text for text in summaries.values())


def test_a_new_mask_begins_where_gain_was_painted(wood):
    grays(1.0)
    detail(output="LIVE", gain=3.0, radius=4.0, gain_map="Gain")
    tree().nodes.remove(live_mask(mix_of())[0])
    paint_where()
    object_mode()
    assert images.read_pixels(mask())[..., 0].mean() == 0.5


def test_a_result_is_made_again_from_the_image_with_its_settings(wood):
    sharpen(output="LIVE", time=4.0)
    result = result_of()
    wanted = images.read_pixels(result)
    amount(0.25)
    paint_where()
    object_mode()
    count = len(bpy.data.images), len(tree().nodes)
    paint(wood, np.s_[:], 0.5)
    shock_filter.live.update(bpy.context.object)
    assert result_of() == result and (len(bpy.data.images), len(tree().nodes)) == count
    np.testing.assert_allclose(images.read_pixels(result)[..., :3], 0.5, atol=1e-6)
    assert mix_of().inputs[mixing.AMOUNT].default_value == 0.25
    x = (np.arange(SIZE) + 0.5) / SIZE
    step = np.broadcast_to(0.5 + 0.4 * np.tanh((x - 0.5) / 0.1), (SIZE, SIZE))
    pixels = np.stack([step, 1 - step, step, 1 + 0 * step], axis=-1).astype(np.float32)
    images.write_parts(wood, {images.UNTILED: pixels}, pack=False)
    assert bpy.ops.shock_filter.update_live() == {"FINISHED"}
    np.testing.assert_array_equal(images.read_pixels(result), wanted)


def test_all_objects_of_a_texture_take_part_whatever_they_are_called_now(wood, select):
    bpy.ops.mesh.primitive_plane_add(size=2, location=(3, 0, 0))
    other, first = bpy.context.object, bpy.data.objects["Plane"]
    other.data.materials.append(first.active_material)
    for obj, corner in ((first, 0.0), (other, 0.5)):
        layer = obj.data.uv_layers.active.uv
        for each in layer:
            each.vector = [corner + 0.5 * value for value in each.vector]
    select(first, other)
    sharpen(output="LIVE")
    wanted = images.read_pixels(result_of())
    wood.name, first.name = "Oak", "Sheet"
    select(first)
    shock_filter.live.update(first)
    np.testing.assert_array_equal(
        images.read_pixels(mixing.results(["Sheet"], wood)[0].image), wanted
    )


def test_shape_and_texture_are_made_again_together(wood):
    bpy.context.object.modifiers.clear()
    bpy.ops.shock_filter.sharpen_geometry(output="LIVE")
    sharpen(output="LIVE")
    steps = shock_filter.shock_addon.live.updating.steps_of(bpy.context.object)
    assert [step.operator for step in steps] == ["sharpen_geometry", "sharpen_texture"]
    shock_filter.live.update(bpy.context.object)


def test_objects_that_share_a_texture_compute_it_once(wood, select, monkeypatch):
    first = bpy.context.object
    bpy.ops.mesh.primitive_plane_add(size=2, location=(3, 0, 0))
    other = bpy.context.object
    other.data.materials.append(first.active_material)
    select(first, other)
    sharpen(output="LIVE")
    wanted = images.read_pixels(result_of())
    paint(wood, np.s_[:], 0.5)
    computed, run = [], Task.run
    monkeypatch.setattr(Task, "run", lambda *given: computed.append(1) or run(*given))
    for pair in ((first, other), (other, first)):
        select(*pair)
        assert bpy.ops.shock_filter.update_live() == {"FINISHED"}
        assert len(computed) == 1
        computed.clear()
    assert (images.read_pixels(result_of()) != wanted).any()
    select(first, other)
    bpy.ops.shock_filter.sharpen_geometry(output="LIVE")
    assert bpy.ops.shock_filter.update_live() == {"FINISHED"}
    assert len(computed) == 1 + 2 + 1  # the press, both shapes, the texture


def test_a_mix_without_settings_cannot_be_made_again(wood):
    sharpen(output="LIVE")
    del mix_of()["shock_filter_live_texture"]
    with pytest.raises(RuntimeError, match="Plane has no live result"):
        shock_filter.live.update(bpy.context.object)


def test_previews_show_their_stand_in_and_not_the_old_result(wood):
    sharpen(output="LIVE")
    after, result = baked(), result_of()
    shown = stand_in.StandIn(wood)
    shown.show(np.full((SIZE, SIZE, 4), 0.125, np.float32))
    np.testing.assert_array_equal(baked(), np.float32(0.125))
    shown.show_before()
    np.testing.assert_array_equal(baked(), after)
    shown.show(np.full((SIZE, SIZE, 4), 0.25, np.float32))
    stand_in.put_away()  # as in a file that Blender saved by itself
    np.testing.assert_array_equal(baked(), after)
    assert result_of() == result


def test_tiles_have_masks_with_the_same_tiles(wood, tmp_path):
    tiles = {number: np.ones((8, 8, 4), np.float32) * 0.5 for number in (1001, 1002)}
    from shock_filter.shock_addon.data.image.tiles import new_tiled_like

    tiled = new_tiled_like(wood, "Tiled", tiles)
    node_of(wood).image = tiled
    sharpen(output="LIVE")
    assert paint_where() == {"FINISHED"}
    object_mode()
    found = live_mask(mix_of("Tiled"))[0].image
    assert found.source == "TILED" and images.part_sizes(found) == images.part_sizes(tiled)
    assert max(pixels[..., :3].max() for pixels in images.read_parts(found).values()) == 0.0
