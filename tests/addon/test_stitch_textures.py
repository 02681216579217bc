# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Stitch Textures: charts that differ, and several pictures of one surface."""

import time

import bpy
import numpy as np
import pytest
from shock_filter import core
from shock_filter.shock_addon.data.image import images as image_data
from shock_filter.shock_addon.modes import find
from shock_filter.shock_addon.operators import base as operators
from shock_filter.shock_addon.operators import keeping
from shock_filter.shock_addon.preview import images as preview_images

stitch_textures = bpy.ops.shock_filter.stitch_textures

SIZE = 64
HALF = SIZE // 2
STEP = 0.2


def read(image):
    return image_data.read_pixels(bpy.data.images[image] if isinstance(image, str) else image)


def add_image(name, pixels, **words):
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=True, **words)
    image.pixels.foreach_set(np.ascontiguousarray(pixels, np.float32).reshape(-1))
    image.update()
    return image


def show(obj, image):
    material = bpy.data.materials.new("Paint")
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    material.node_tree.nodes.active = node
    obj.data.materials.append(material)


def add_sheet():
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=8, y_subdivisions=8, calc_uvs=True)
    return bpy.context.object


def waves():
    """Gray waves of 32 texels, opaque."""
    y, x = np.mgrid[:SIZE, :SIZE]
    pixels = np.ones((SIZE, SIZE, 4), dtype=np.float32)
    pixels[..., :3] = (0.5 + 0.1 * np.cos(x / 16 * np.pi) * np.cos(y / 16 * np.pi))[..., None]
    return pixels


def lit(pixels, step, known):
    """The pixels in another light, transparent and red where nothing is known."""
    pixels = pixels.copy()
    pixels[..., :3] += step
    pixels[~known] = 1.0, 0.0, 0.0, 0.0
    return pixels


def spread(pixels, wanted):
    """How far colors differ from those that are wanted, but for one constant."""
    off = (pixels - wanted)[..., :3]
    return float((off - off.mean(axis=(0, 1))).std())


@pytest.fixture
def charts():
    """A sheet of two charts, swapped in the image, of which one is brighter."""
    sheet = add_sheet()
    uv = sheet.data.uv_layers.active.uv
    for polygon in sheet.data.polygons:
        is_left = polygon.center.x < 0
        for loop in polygon.loop_indices:
            u, v = uv[loop].vector
            uv[loop].vector = 0.5 * u + (0.72 if is_left else -0.22), 0.9 * v + 0.05
    pixels = np.full((SIZE, SIZE, 4), 0.3, dtype=np.float32)
    pixels[:, HALF:, :3] += STEP
    pixels[..., 3] = 1.0
    show(sheet, add_image("Bake", pixels))
    return sheet


@pytest.fixture
def photos():
    """A sheet, and three pictures of it, each of which knows two thirds."""
    sheet = add_sheet()
    x = np.broadcast_to(np.arange(SIZE), (SIZE, SIZE))
    seen = [x < 40, (x >= 12) & (x < 52), x >= 24]
    names = ("Left", "Middle", "Right")
    for name, known, step in zip(names, seen, (0.0, 0.15, -0.1), strict=True):
        add_image(name, lit(waves(), step, known))
    show(sheet, bpy.data.images["Left"])
    return sheet


THREE = {"image": "Left", "image_2": "Middle", "image_3": "Right"}


def values_of_charts(pixels):
    """The inner texels of both charts, left to right on the sheet."""
    return pixels[8:-8, HALF + 16 : HALF + 28, 0], pixels[8:-8, 4:16, 0]


def test_the_step_between_charts_goes_and_the_mean_stays(charts):
    before = read("Bake")
    assert stitch_textures(radius=1000.0, even_out="difference") == {"FINISHED"}
    np.testing.assert_array_equal(read("Bake"), before)
    result = read("Bake stitched")
    assert charts.active_material.node_tree.nodes.active.image.name == "Bake stitched"
    one, other = values_of_charts(result)
    assert abs(one.mean() - other.mean()) < 0.05 * STEP
    assert one.std() < 0.01 and other.std() < 0.01
    assert abs(0.5 * (one.mean() + other.mean()) - (0.3 + STEP / 2)) < 0.01
    said = operators.summaries["stitch"]
    assert said.startswith("Stitched the texture Bake on 1 object into Bake stitched: ")


def test_a_small_radius_keeps_what_lies_farther_away(charts):
    stitch_textures(radius=2.0)
    assert "Even Out: Auto took" in operators.summaries["stitch"]
    one, other = values_of_charts(read("Bake stitched"))
    assert abs(one[:, -3:] - other[:, :3]).max() > 0.8 * STEP


def test_what_even_out_took_can_be_kept_and_hides_no_advice(charts):
    stitch_textures(radius=1000.0)
    chosen = keeping.found_by(bpy.context, "stitch", "even_out")
    said = operators.summaries["stitch"]
    assert "Auto took differences" in said and chosen.text == "Difference"
    assert "need a larger Radius" not in said  # much has changed
    assert bpy.ops.shock_filter.keep_auto(mode="stitch", name="even_out") == {"FINISHED"}
    assert bpy.context.scene.shock_filter.stitch.even_out == "difference"
    stitch_textures(image="Bake stitched", radius=1000.0)  # hardly anything is left to do
    assert "steps that are still seen need a larger Radius" in operators.summaries["stitch"]


def test_at_seams_alone_the_rest_stays(charts):
    before = read("Bake")
    stitch_textures(where="seams", gutter=0)
    result = read("Bake stitched")
    assert 0 < (result != before).any(axis=2).mean() < 0.2
    for old, new in zip(values_of_charts(before), values_of_charts(result), strict=True):
        np.testing.assert_array_equal(new, old)


def test_pictures_become_one_where_each_is_known(photos):
    before = {name: read(name) for name in ("Left", "Middle", "Right")}
    assert stitch_textures(radius=1000.0, **THREE) == {"FINISHED"}
    result = read("Left stitched")
    assert (result[..., 3] == 1.0).all()
    assert spread(result, waves()) < 0.01
    np.testing.assert_allclose(result[..., 0], result[..., 1], atol=1.01 / 255)  # nothing is red
    for name, pixels in before.items():
        np.testing.assert_array_equal(read(name), pixels)


def test_what_no_picture_knows_stays_transparent(photos):
    before = {name: read(name) for name in ("Middle", "Right")}
    stitch_textures(image="Right", image_2="Middle", output="REPLACE")
    result = read("Right")
    assert (result[:, :11, 3] == 0.0).all()
    assert (result[:, 12:, 3] == 1.0).all()
    np.testing.assert_allclose(result[..., 0], result[..., 1], atol=1.01 / 255)  # nothing is red
    assert abs(np.diff(result[..., 0], axis=1)).max() < 0.05
    np.testing.assert_array_equal(read("Middle"), before["Middle"])
    assert (result != before["Right"]).any()


def test_the_order_of_pictures_does_not_matter(photos):
    stitch_textures(radius=1000.0, **THREE)
    stitch_textures(radius=1000.0, image="Right", image_2="Left", image_4="Middle")
    one, other = read("Left stitched"), read("Right stitched")
    np.testing.assert_allclose(one, other, atol=2.01 / 255)


@pytest.mark.parametrize("is_float", [False, True])
def test_what_is_opaque_stays_opaque(rounded_box, is_float):
    # Also the few texels along seams whose colors are those of points on the seams.
    show(rounded_box(), add_image("Opaque", waves(), float_buffer=is_float))
    assert stitch_textures() == {"FINISHED"}
    np.testing.assert_allclose(read("Opaque stitched")[..., 3], 1.0, atol=1e-6)


@pytest.mark.parametrize("is_float", [False, True])
def test_pictures_without_opacity_count_everywhere(is_float):
    sheet = add_sheet()
    for name, step in (("Dark", 0.0), ("Bright", STEP)):
        known = np.ones((SIZE, SIZE), dtype=bool)
        image = add_image(name, lit(waves(), step, known), float_buffer=is_float)
        image.alpha_mode = "NONE" if name == "Dark" else "STRAIGHT"
    show(sheet, bpy.data.images["Dark"])
    stitch_textures(image="Dark", image_2="Bright")
    wanted = waves()
    wanted[..., :3] += STEP / 2
    np.testing.assert_allclose(read("Dark stitched")[..., :3], wanted[..., :3], atol=0.006)
    stitch_textures(image="Bright", image_2="Dark")
    np.testing.assert_allclose(read("Bright stitched")[..., :3], wanted[..., :3], atol=0.006)


def test_colors_of_floats_count_before_they_are_multiplied():
    sheet = add_sheet()
    for name, opacity in (("One", 0.25), ("Other", 1.0)):
        pixels = waves()
        pixels[..., 3] = opacity
        pixels[..., :3] *= opacity
        add_image(name, pixels, float_buffer=True)
    show(sheet, bpy.data.images["One"])
    stitch_textures(image="One", image_2="Other")
    np.testing.assert_allclose(read("One stitched"), waves(), atol=1e-3)


def test_pictures_of_several_objects_become_one(photos):
    other = add_sheet()
    other.location.x = 9.0
    show(other, bpy.data.images["Left"])
    for obj, left in ((photos, 0.0), (other, 0.5)):
        for loop in obj.data.uv_layers.active.uv:
            loop.vector = left + 0.5 * loop.vector[0], loop.vector[1]
        obj.select_set(True)
    assert stitch_textures(**THREE) == {"FINISHED"}
    assert "on 2 objects" in operators.summaries["stitch"]
    result = read("Left stitched")
    for half in (slice(2, HALF - 2), slice(HALF + 2, SIZE - 2)):
        assert spread(result[2:-2, half], waves()[2:-2, half]) < 0.02


def test_a_mask_keeps_the_first_picture(photos):
    mask = np.ones((SIZE, SIZE, 4), dtype=np.float32)
    mask[:, :HALF, :3] = 0.0
    add_image("Mask", mask)
    stitch_textures(mask_image="Mask", gutter=0, **THREE)
    result, before = read("Left stitched"), read("Left")
    np.testing.assert_array_equal(result[:, :HALF], before[:, :HALF])
    assert (result[:, HALF:] != before[:, HALF:]).any(axis=2).all()


@pytest.mark.parametrize(
    ("make", "words", "reason"),
    [
        (lambda: None, {"image_3": "Gone"}, "there is no picture named 'Gone'"),
        (
            lambda: add_image("Small", waves()[:16, :16]),
            {"image_4": "Small"},
            "its picture Small has another size; scale it to 64 x 64",
        ),
        (
            lambda: setattr(add_image("Film", waves()), "source", "MOVIE"),
            {"image_2": "Film"},
            "its picture Film cannot be used: it is a movie",
        ),
        (lambda: None, {"image_2": "Left"}, "Left is named twice"),
        (lambda: None, {"image_2": "Right", "image_3": "Right"}, "Right is named twice"),
        (
            lambda: add_image("Floats", waves(), float_buffer=True),
            {"image_2": "Floats"},
            "the depth of its picture Floats differs",
        ),
        (
            lambda: add_image("Data", waves(), is_data=True),
            {"image_2": "Data"},
            "its picture Data has another color space; set it to sRGB",
        ),
    ],
)
def test_pictures_that_do_not_fit_are_named(photos, make, words, reason):
    make()
    before = bpy.data.images.keys()
    pixels = read("Left")
    with pytest.raises(RuntimeError, match=reason):
        stitch_textures(image="Left", output="REPLACE", **words)
    assert bpy.data.images.keys() == before
    np.testing.assert_array_equal(read("Left"), pixels)


def test_pictures_with_nan_are_named():
    sheet = add_sheet()
    show(sheet, add_image("Fine", waves(), float_buffer=True))
    add_image("Empty", np.full((SIZE, SIZE, 4), np.nan), float_buffer=True)
    with pytest.raises(RuntimeError, match="its picture Empty holds NaN"):
        stitch_textures(image="Fine", image_2="Empty")


def test_undo_takes_the_new_image_away(photos):
    for name in ("Middle", "Right"):
        bpy.data.images[name].use_fake_user = True
    bpy.ops.ed.undo_push(message="Before")
    stitch_textures("EXEC_DEFAULT", True, **THREE)
    assert "Left stitched" in bpy.data.images
    bpy.ops.ed.undo()
    assert "Left stitched" not in bpy.data.images


def test_redo_of_a_replaced_image_starts_from_the_old_pixels(charts, adjust):
    before = read("Bake")
    bpy.data.images["Bake"].use_fake_user = True
    bpy.ops.ed.undo_push(message="Start")
    stitch_textures("EXEC_DEFAULT", True, output="REPLACE", gutter=0)
    assert (read("Bake") != before).any()
    assert len(bpy.data.images) == 1
    adjust(where="seams")
    after = read("Bake")
    for old, new in zip(values_of_charts(before), values_of_charts(after), strict=True):
        np.testing.assert_array_equal(new, old)


def test_cancelling_changes_nothing(photos, monkeypatch):
    before = read("Left"), bpy.data.images.keys()
    monkeypatch.setattr(operators, "listener", lambda fraction, message: fraction < 0.5)
    assert stitch_textures(output="REPLACE", **THREE) == {"CANCELLED"}
    np.testing.assert_array_equal(read("Left"), before[0])
    assert bpy.data.images.keys() == before[1]


def test_a_preview_shows_what_a_run_makes(photos):
    settings = bpy.context.scene.shock_filter.stitch
    for name, value in THREE.items():
        setattr(settings, name, value)
    before = read("Left").tobytes(), len(bpy.data.images)
    preview = preview_images.begin(bpy.context, None, find("stitch"))
    try:
        preview.drag(-40)
        for _ in range(6000):
            preview.tick()
            if not preview.is_computing:
                break
            time.sleep(0.01)
        shown = bpy.context.object.active_material.node_tree.nodes.active.image
        result, radius, text = read(shown), preview.parameters.radius, preview.text()
    finally:
        preview.end()
    assert (read("Left").tobytes(), len(bpy.data.images)) == before
    assert radius < 100.0
    assert text.startswith(f"Radius {radius:.4g} (move mouse)")
    stitch_textures(radius=radius, **THREE)
    np.testing.assert_allclose(read("Left stitched"), result, atol=1.01 / 255)


def test_one_picture_is_what_the_core_makes(charts):
    from shock_filter.shock_addon.data.image.textures import read_faces

    faces, _, _ = read_faces(bpy.context, [charts], None, None)
    mesh = core.TriangleMesh(faces.positions, faces.triangles)
    wanted = core.stitch_textures(mesh, faces.uv, read("Bake"))
    stitch_textures()
    np.testing.assert_allclose(read("Bake stitched"), wanted, atol=1.01 / 255)
