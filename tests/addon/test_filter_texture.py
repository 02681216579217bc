# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Filter Texture, and painted gains."""

import time

import bpy
import numpy as np
import pytest
from shock_filter import core
from shock_filter.shock_addon.data.image import images as image_data
from shock_filter.shock_addon.data.image import tiles
from shock_filter.shock_addon.modes import find
from shock_filter.shock_addon.operators import base as operators
from shock_filter.shock_addon.preview import gain, painting
from shock_filter.shock_addon.preview import images as preview_images
from shock_filter.shock_addon.preview.previewing import parameters_of

filter_texture = bpy.ops.shock_filter.filter_texture

SIZE = 64
MIDDLE = 128 / 255


def read(image):
    return image_data.read_pixels(image)


def add_image(name, pixels, **words):
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=True, **words)
    image.pixels.foreach_set(np.ascontiguousarray(pixels, np.float32).reshape(-1))
    image.update()
    return image


def add_sheet(image):
    """A sheet of 64 quads whose UVs fill the image."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=8, y_subdivisions=8, calc_uvs=True)
    sheet = bpy.context.object
    material = bpy.data.materials.new("Paint")
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    material.node_tree.nodes.active = node
    sheet.data.materials.append(material)
    return sheet


def shown(preview):
    """Tick until the newest settings are shown."""
    for _ in range(6000):
        preview.tick()
        if not preview.is_computing:
            return
        time.sleep(0.01)
    raise AssertionError("The preview did not settle.")


def waves(size=SIZE):
    """Gray waves of 8 texels, opaque."""
    y, x = np.mgrid[:size, :size]
    pixels = np.ones((size, size, 4), dtype=np.float32)
    pixels[..., :3] = (0.5 + 0.1 * np.sin(x / 4 * np.pi) * np.sin(y / 4 * np.pi))[..., None]
    return pixels


def detail(pixels):
    """How much each quarter of the columns varies in the red channel."""
    inner = pixels[8:-8, :, 0]
    return [float(part[:, 4:-4].std()) for part in np.split(inner, 4, axis=1)]


def gray_image(name, values, **words):
    """An image of gray columns, with values from 0 to 1."""
    pixels = np.ones((SIZE, SIZE, 4), dtype=np.float32)
    pixels[..., :3] = np.repeat(values, SIZE // len(values))[None, :, None]
    return add_image(name, pixels, **words)


def paint_corners(obj, kind, values):
    """A color attribute of the corners in columns of gray; bytes are stored as they are given."""
    colors = obj.data.color_attributes.new("Grays", kind, "CORNER")
    name = "color_srgb" if kind == "BYTE_COLOR" else "color"
    for polygon in obj.data.polygons:
        value = values[int(0.5 * (polygon.center.x + 1.0) * len(values))]
        for loop in polygon.loop_indices:
            setattr(colors.data[loop], name, (value, value, value, 1.0))


@pytest.fixture
def sheet():
    """A sheet with waves."""
    return add_sheet(add_image("Wood", waves()))


@pytest.mark.parametrize(("gain", "times"), [(0.0, 0.0), (0.5, 0.5), (2.0, 2.0)])
def test_detail_is_raised_and_smoothed_by_the_gain(sheet, gain, times):
    wood = bpy.data.images["Wood"]
    before = read(wood)
    assert filter_texture(gain=gain) == {"FINISHED"}
    np.testing.assert_array_equal(read(wood), before)
    result = read(bpy.data.images["Wood filtered"])
    assert sheet.active_material.node_tree.nodes.active.image.name == "Wood filtered"
    np.testing.assert_allclose(detail(result), times * np.array(detail(before)), atol=0.004)
    assert (result[..., 3] == before[..., 3]).all()


def test_a_gain_of_1_changes_nothing_and_the_report_says_why(sheet):
    assert filter_texture(gain=1.0) == {"FINISHED"}
    said = said_that_nothing_changed()
    assert "a Gain of 1 changes nothing" in said


def said_that_nothing_changed():
    said = operators.summaries["detail"]
    assert said.startswith("Nothing in Wood has changed, so no copy was made: 4,096 pixels")
    assert "Wood filtered" not in bpy.data.images
    return said


def waves_stored():
    return read(bpy.data.images["Wood"])


@pytest.mark.parametrize("is_float", [False, True])
@pytest.mark.parametrize("is_data", [False, True])
def test_a_gain_map_says_where_by_its_stored_values(sheet, is_float, is_data):
    gray_image("Map", [0.0, MIDDLE, MIDDLE, 1.0], float_buffer=is_float, is_data=is_data)
    filter_texture(gain=3.0, gain_map="Map")
    before, after = (detail(read(bpy.data.images[name])) for name in ("Wood", "Wood filtered"))
    ratios = np.array(after) / before
    np.testing.assert_allclose(ratios, [0.0, 1.0, 1.0, 3.0], atol=0.12)


def test_middle_gray_keeps_every_bit(sheet):
    gray_image("Map", [127 / 255, MIDDLE])
    filter_texture(gain=3.0, gain_map="Map")
    said_that_nothing_changed()


def squeeze(obj, left, width):
    """Move the UVs, which fill the image, into these columns of it."""
    for loop in obj.data.uv_layers.active.uv:
        loop.vector = left + width * loop.vector[0], loop.vector[1]


def test_objects_on_one_image_have_gain_colors_of_their_own():
    wood = add_image("Wood", waves())
    for left, gray in ((0.0, 0.0), (0.5, 1.0)):
        sheet = add_sheet(wood)
        squeeze(sheet, left, 0.5)
        sheet.location.x = 9.0 * left
        paint_corners(sheet, "FLOAT_COLOR", [gray])
    for obj in bpy.data.objects:
        obj.select_set(True)
    assert filter_texture(gain=3.0, radius=8.0, gain_colors="Grays") == {"FINISHED"}
    assert "on 2 objects" in operators.summaries["detail"]
    before, after = detail(waves()), detail(read(bpy.data.images["Wood filtered"]))
    assert after[0] < 0.1 * before[0]
    assert after[3] > 2.5 * before[3]


def add_tiles(name, folder, tiles):
    """An image with UDIM tiles, from files."""
    for number, pixels in tiles.items():
        part = add_image("part", pixels, is_data=True)
        part.file_format = "PNG"
        part.save(filepath=f"{folder}/{name}.{number}.png")
        bpy.data.images.remove(part)
    image = bpy.data.images.load(f"{folder}/{name}.{min(tiles)}.png")
    image.name, image.source = name, "TILED"
    image.colorspace_settings.name = "Non-Color"
    return image


def test_tiles_have_gain_maps_with_the_same_tiles(tmp_path):
    sheet = add_sheet(add_tiles("Wood", tmp_path, {1001: waves(), 1002: waves()}))
    squeeze(sheet, 0.0, 2.0)
    sheet.scale.x = 2.0
    bpy.context.view_layer.update()
    black, white = np.zeros((SIZE, SIZE, 4)), np.ones((SIZE, SIZE, 4))
    black[..., 3] = 1.0
    add_tiles("Grays", tmp_path, {1001: black, 1002: white})
    assert filter_texture(gain=3.0, radius=8.0, gain_map="Grays") == {"FINISHED"}
    result = tiles.read_tiles(bpy.data.images["Wood filtered"])
    before = detail(waves())
    assert detail(result[1001])[0] < 0.1 * before[0]
    assert detail(result[1002])[3] > 2.5 * before[3]


@pytest.mark.parametrize("kind", ["BYTE_COLOR", "FLOAT_COLOR"])
def test_gain_colors_say_the_same_on_the_mesh(sheet, kind):
    paint_corners(sheet, kind, [0.0, 0.5, 0.5, 1.0])
    filter_texture(gain=3.0, gain_colors="Grays")
    before, after = (detail(read(bpy.data.images[name])) for name in ("Wood", "Wood filtered"))
    np.testing.assert_allclose(np.array(after) / before, [0.0, 1.0, 1.0, 3.0], atol=0.12)
    gray_image("Map", [1.0, 1.0, 0.0, MIDDLE])
    filter_texture(image="Wood", gain=3.0, gain_colors="Grays", gain_map="Map")
    after = detail(read(bpy.data.images["Wood filtered.001"]))
    np.testing.assert_allclose(np.array(after) / before, [0.0, 3.0, 0.0, 3.0], atol=0.12)


def test_colors_that_are_all_middle_gray_keep_every_bit(sheet):
    paint_corners(sheet, "BYTE_COLOR", [0.5])
    filter_texture(gain=3.0, gain_colors="Grays")
    said_that_nothing_changed()


@pytest.mark.parametrize(
    ("make", "words", "reason"),
    [
        (lambda: None, {"gain_map": "Gone"}, "there is no gain map named 'Gone'"),
        (
            lambda: add_image("Small", waves(16)),
            {"gain_map": "Small"},
            "its gain map Small has another size; scale it to 64 x 64",
        ),
        (
            lambda: setattr(add_image("Film", waves()), "source", "MOVIE"),
            {"gain_map": "Film"},
            "its gain map Film cannot be used: it is a movie",
        ),
        (
            lambda: add_image("Empty", np.full((SIZE, SIZE, 4), np.nan), float_buffer=True),
            {"gain_map": "Empty"},
            "its gain map Empty holds NaN",
        ),
        (lambda: None, {"gain_colors": "Gone"}, "it has no color attribute"),
    ],
)
def test_bad_gain_maps_are_named(sheet, make, words, reason):
    make()
    before = bpy.data.images.keys()
    with pytest.raises(RuntimeError, match=reason):
        filter_texture(**words)
    assert bpy.data.images.keys() == before


def test_a_mask_keeps_what_it_protects_bit_for_bit(sheet):
    gray_image("Mask", [0.0, 0.0, 1.0, 1.0])
    filter_texture(mask_image="Mask")
    result, before = read(bpy.data.images["Wood filtered"]), waves_stored()
    np.testing.assert_array_equal(result[:, : SIZE // 2], before[:, : SIZE // 2])
    assert (result[:, SIZE // 2 :] != before[:, SIZE // 2 :]).any(axis=2).mean() > 0.5


def test_other_maps_are_filtered_too_and_normals_as_such(sheet):
    material = sheet.active_material
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shader = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    color = next(node for node in nodes if node.type == "TEX_IMAGE")
    links.new(color.outputs[0], shader.inputs["Base Color"])
    for name in ("Rough", "Normals"):
        node = nodes.new("ShaderNodeTexImage")
        node.image = add_image(name, waves(), is_data=True)
        if name == "Normals":
            turn = nodes.new("ShaderNodeNormalMap")
            links.new(node.outputs[0], turn.inputs["Color"])
            links.new(turn.outputs[0], shader.inputs["Normal"])
        else:
            links.new(node.outputs[0], shader.inputs["Roughness"])
    filter_texture(maps="MATERIAL")
    assert "Rough filtered" in bpy.data.images
    vectors = 2.0 * read(bpy.data.images["Normals filtered"])[..., :3] - 1.0
    assert np.abs(np.linalg.norm(vectors, axis=2) - 1.0).max() < 0.02


def test_a_preview_turns_the_gain_without_solving_again(sheet, monkeypatch):
    wood = bpy.data.images["Wood"]
    made = []
    init = core.TextureSolver.__init__
    monkeypatch.setattr(
        core.TextureSolver,
        "__init__",
        lambda self, *data, **words: (made.append(1), init(self, *data, **words))[1],
    )
    before = read(wood).tobytes(), len(bpy.data.images)
    preview = preview_images.begin(bpy.context, None, find("detail"))
    try:
        for pixels in (0, 30, -75):
            preview.drag(pixels)
            shown(preview)
        result = read(shown_image())
        gain = preview.parameters.gain
        text = preview.text()
    finally:
        preview.end()
    assert (read(wood).tobytes(), len(bpy.data.images)) == before
    assert len(made) == 1
    assert gain != 2.0
    assert text.startswith(f"Gain {gain:.4g} (move mouse) | Radius 10 (wheel)")
    filter_texture(gain=gain, output="REPLACE")
    np.testing.assert_allclose(read(wood), result, atol=1.01 / 255)


def test_the_panel_keeps_its_parameters():
    names = vars(parameters_of(bpy.context.scene, find("detail")))
    assert {"gain", "radius", "gutter", "gain_map", "gain_colors", "maps"} <= set(names)


# ---------------------------------------------------------------------------------------- painting

paint_gain = bpy.ops.shock_filter.paint_gain


@pytest.fixture
def painted(sheet):
    """A gain map that is being painted."""
    bpy.context.scene.shock_filter.mode = "DETAIL"
    assert paint_gain() == {"FINISHED"}
    yield sheet
    painting.stop()


def test_strokes_go_by_the_uv_map_that_shows_the_texture(sheet):
    bpy.context.scene.shock_filter.mode = "DETAIL"
    layers = bpy.context.object.data.uv_layers
    shown = layers.active.name
    layers.active = layers.new(name="Light map")
    assert paint_gain() == {"FINISHED"}
    painting.stop()
    assert bpy.context.object.data.uv_layers.active.name == shown


def settled():
    """Tick until what is painted and set is shown; return the pixels that the model shows."""
    (one,) = painting._running
    one.tick()
    for _ in range(6000):
        if not one.preview.is_computing:
            break
        time.sleep(0.01)
        one.preview.tick()
    return read(shown_image())


def shown_image():
    return bpy.context.object.active_material.node_tree.nodes.active.image


def paint(name, part, value):
    pixels = read(bpy.data.images[name])
    pixels[:, part, :3] = value
    bpy.data.images[name].pixels.foreach_set(pixels.reshape(-1))
    bpy.data.images[name].update()


def test_painting_begins_with_a_map_that_keeps_everything(painted):
    settings = bpy.context.scene.shock_filter.detail
    assert (settings.image, settings.gain_map) == ("Wood", "Wood gain")
    gain_map = bpy.data.images["Wood gain"]
    assert bpy.context.mode == "PAINT_TEXTURE"
    assert bpy.context.tool_settings.image_paint.canvas == gain_map
    assert gain_map.packed_file is not None
    np.testing.assert_array_equal(settled(), waves_stored())
    assert shown_image().name.startswith(".")


def test_the_stand_in_has_an_icon_so_that_none_is_drawn_from_its_pixels(painted):
    settled()
    assert shown_image().preview.is_icon_custom
    assert shown_image().preview.is_image_custom


def test_what_is_painted_and_set_is_shown(painted):
    before = waves_stored()
    paint("Wood gain", slice(SIZE // 2, SIZE), 1.0)
    ratios = np.array(detail(settled())) / detail(before)
    np.testing.assert_allclose(ratios, [1.0, 1.0, 2.0, 2.0], atol=0.12)
    bpy.context.scene.shock_filter.detail.gain = 3.0
    ratios = np.array(detail(settled())) / detail(before)
    np.testing.assert_allclose(ratios, [1.0, 1.0, 3.0, 3.0], atol=0.12)
    paint("Wood gain", slice(0, SIZE // 2), 0.0)
    result = settled()
    np.testing.assert_allclose(detail(result)[0], 0.0, atol=0.01)
    np.testing.assert_array_equal(waves_stored(), before)
    assert paint_gain() == {"FINISHED"}  # ends it
    assert not painting.is_running()
    assert shown_image().name == "Wood"
    assert not [image for image in bpy.data.images if image.name.startswith(".")]
    bpy.ops.object.mode_set(mode="OBJECT")
    filter_texture(image="Wood", gain=3.0, gain_map="Wood gain")
    made = read(bpy.data.images["Wood filtered"])
    np.testing.assert_allclose(made, result, atol=1.5 / 255)


def test_painting_goes_on_when_the_map_is_renamed(painted):
    bpy.data.images["Wood gain"].name = "Gain"
    painting._tick()
    assert painting.is_running()


def test_painting_chooses_its_mode(sheet):
    bpy.context.scene.shock_filter.mode = "GEOMETRY"
    assert paint_gain() == {"FINISHED"}
    assert bpy.context.scene.shock_filter.mode == "DETAIL"
    painting._tick()
    assert painting.is_running()
    painting.stop()


def test_a_run_ends_painting_and_reads_the_texture_itself(painted):
    paint("Wood gain", slice(0, SIZE), 1.0)
    settled()
    filter_texture(image="Wood", gain_map="Wood gain", output="REPLACE")
    assert shown_image().name == "Wood"
    painting._tick()
    assert not painting.is_running()
    np.testing.assert_allclose(detail(waves_stored()), 2.0 * np.array(detail(waves())), atol=0.01)


@pytest.mark.parametrize("end", ["mode", "save", "load", "image", "map", "object"])
def test_painting_ends_with_what_it_is_about(painted, end, tmp_path):
    settled()
    if end == "mode":
        bpy.context.scene.shock_filter.mode = "TEXTURE"
    elif end == "save":
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"), copy=True)
    elif end == "image":
        bpy.data.images.remove(bpy.data.images["Wood"])
    elif end == "map":
        bpy.data.images.new("Other", SIZE, SIZE)
        bpy.context.scene.shock_filter.detail.gain_map = "Other"
    elif end == "object":
        bpy.data.objects.remove(bpy.context.object)
    else:
        bpy.ops.wm.read_homefile(use_empty=True)
    painting._tick()
    assert not painting.is_running()
    assert not [image for image in bpy.data.images if image.name.startswith(".")]
    if end == "save":
        with bpy.data.libraries.load(str(tmp_path / "a.blend")) as (names, _):
            assert sorted(names.images) == ["Wood", "Wood gain"]


def test_files_that_were_saved_meanwhile_show_the_texture(painted, tmp_path):
    settled()
    stand_in = shown_image()
    stand_in.use_fake_user = True
    path = str(tmp_path / "auto.blend")
    bpy.app.handlers.save_pre.remove(painting.stop)  # as Blender saves by itself
    try:
        bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    finally:
        bpy.app.handlers.save_pre.append(painting.stop)
    painting.stop()
    bpy.ops.wm.open_mainfile(filepath=path)
    assert sorted(bpy.data.images.keys()) == ["Wood", "Wood gain"]
    assert shown_image().name == "Wood"


def view_3d():
    """The space of the first 3D view."""
    areas = bpy.context.window_manager.windows[0].screen.areas
    return next(area for area in areas if area.type == "VIEW_3D").spaces.active


@pytest.mark.parametrize("engine", ["BLENDER_WORKBENCH", "CYCLES", "BLENDER_EEVEE_NEXT"])
@pytest.mark.parametrize("kind", ["WIREFRAME", "SOLID", "RENDERED"])
def test_painting_begins_in_every_engine_and_shading(sheet, over_view, engine, kind):
    bpy.context.scene.shock_filter.mode = "DETAIL"
    bpy.context.scene.render.engine = engine
    space = view_3d()
    space.shading.type, space.shading.color_type = kind, "MATERIAL"
    over_view(paint_gain)
    assert painting.is_running()
    assert bpy.context.mode == "PAINT_TEXTURE"
    if kind == "RENDERED":
        assert space.shading.type == kind
    elif engine == "BLENDER_WORKBENCH":  # it has no Material Preview
        assert (space.shading.type, space.shading.color_type) == ("SOLID", "TEXTURE")
    else:
        assert space.shading.type == "MATERIAL"
    # Workbench shows what is painted on, so that the result is drawn over it.
    assert gain.is_workbench(space) == (engine == "BLENDER_WORKBENCH")
    paint("Wood gain", slice(0, SIZE), 1.0)
    result = settled()
    (one,) = painting._running
    assert np.abs(result - waves_stored()).max() > 0.01
    np.testing.assert_allclose(one.stage._coat._values, result, atol=1.5 / 255)
    painting.stop()
    assert one.stage._coat._drawing is None


def test_it_says_what_black_and_white_do(sheet, capfd):
    bpy.context.scene.shock_filter.mode = "DETAIL"
    paint_gain()
    assert "White raises detail, black smooths it" in capfd.readouterr().out
    (one,) = painting._running
    assert one.stage._hint is not None  # drawn in the view
    painting.stop()
    assert one.stage._hint is None


@pytest.mark.parametrize("failing", ["_Stage", "Preview"])
def test_painting_that_cannot_begin_changes_nothing(sheet, over_view, monkeypatch, failing):
    chosen = bpy.context.scene.shock_filter
    chosen.mode = "DETAIL"
    bpy.context.scene.render.engine = "BLENDER_WORKBENCH"
    space, paints = view_3d(), bpy.context.tool_settings.image_paint
    space.shading.type, space.shading.color_type = "WIREFRAME", "RANDOM"

    def state():
        shading = space.shading.type, space.shading.color_type
        names = chosen.detail.image, chosen.detail.gain_map
        return sorted(bpy.data.images.keys()), shading, names, paints.mode, paints.canvas

    def fail(*_):
        raise RuntimeError("No luck.")

    before = state()
    monkeypatch.setattr(gain, failing, fail)
    with pytest.raises(RuntimeError, match="No luck"):
        over_view(paint_gain)
    assert (state(), bpy.context.mode) == (before, "OBJECT")
    assert shown_image().name == "Wood"
    assert not painting.is_running()


def test_a_map_must_be_another_image(sheet):
    with pytest.raises(RuntimeError, match="it is its own gain map"):
        filter_texture(image="Wood", gain_map="Wood")
