# SPDX-License-Identifier: GPL-3.0-or-later
"""The preview of images and textures: patches, what is drawn, and that the image stays."""

import contextlib
import time
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from shock_filter.core import BeltramiSettings, ImageSettings
from shock_filter.core.base.srgb import decoded
from shock_filter.core.host.inputs import Denoising, HostImage
from shock_filter.core.preview.crop import crop_around, filtered_at_once
from shock_filter.core.preview.screen_colors import screen_colors
from shock_filter.shock_addon.data.image import images as image_data
from shock_filter.shock_addon.data.image import stand_in
from shock_filter.shock_addon.data.skipped import Refused
from shock_filter.shock_addon.modes import find
from shock_filter.shock_addon.preview import images as preview_images
from shock_filter.shock_addon.preview import operator as preview_operator
from shock_filter.shock_addon.preview.overlay import Overlay
from shock_filter.shock_addon.preview.pointing import is_over_view, pointed_at


def soft(height=96, width=120):
    """Soft stripes with some noise, opaque."""
    y, x = np.mgrid[:height, :width].astype(np.float32)
    pixels = np.ones((height, width, 4), dtype=np.float32)
    pixels[..., 0] = 0.5 + 0.4 * np.tanh(2.0 * np.sin(x / 6 + y / 15))
    pixels[..., 1] = 0.5 + 0.3 * np.sin(y / 5)
    pixels[..., 2] = 0.4
    pixels[..., :3] += np.random.default_rng(0).normal(scale=0.02, size=(height, width, 3))
    return pixels.clip(0.0, 1.0)


def add_image(pixels=None, name="Photo", **kind):
    pixels = soft() if pixels is None else pixels
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=True, **kind)
    image.pixels.foreach_set(np.ascontiguousarray(pixels).reshape(-1))
    image.update()
    return image


@pytest.fixture
def editor():
    """Return a function that shows an image in an Image Editor, and the context over it."""
    (window,) = bpy.context.window_manager.windows
    area = max(window.screen.areas, key=lambda area: area.width * area.height)
    before = area.type
    area.type = "IMAGE_EDITOR"

    def show(image):
        area.spaces.active.image = image
        return SimpleNamespace(
            area=area,
            mode="OBJECT",
            region=None,
            scene=bpy.context.scene,
            space_data=area.spaces.active,
            tool_settings=bpy.context.tool_settings,
        )

    yield show
    area.type = before


@pytest.fixture
def begun(editor, monkeypatch):
    """Return a function that begins a preview on an image; it is ended with the test."""
    running = []

    def begin(image, mode="image", size=None):
        if size is not None:
            monkeypatch.setattr(preview_images, "_QUICK", size)
            monkeypatch.setattr(preview_images, "_SLOW", size)
        monkeypatch.setattr(preview_images, "_place", lambda context, event: (0.5, 0.5))
        running.append(preview_images.begin(editor(image), None, find(mode)))
        return running[-1]

    yield begin
    for preview in running:
        with contextlib.suppress(ValueError):  # it was ended by the test
            preview.end()


def shown(preview):
    """Tick until the newest settings are drawn, and return what is."""
    for _ in range(6000):
        preview.tick()
        if preview._job is None:
            return preview.stage._overlay._pieces
        time.sleep(0.01)
    raise AssertionError("The preview did not settle.")


def state(image):
    packed = image.packed_file.data if image.packed_file else None
    return image_data.read_pixels(image).tobytes(), image.is_dirty, packed, len(bpy.data.images)


@pytest.mark.parametrize("mode", ["image", "denoise_image"])
@pytest.mark.parametrize("size", [None, 72**2])
def test_what_is_drawn_is_what_the_operator_makes(begun, mode, size):
    photo = add_image()
    preview = begun(photo, mode, size)
    preview.drag(-40 if mode == "image" else 20)
    preview.roll(5 if mode == "image" else -1)
    (piece,) = shown(preview)
    parameters = {
        name: getattr(preview.parameters, name) for name in (preview.dial, preview.second)
    }
    assert ("patch of 36 x 36 pixels" in preview.text()) == (size is not None)
    assert piece.framed == (size is not None)
    preview.end()
    run = getattr(bpy.ops.shock_filter, preview.mode.operator)
    assert run(image="Photo", output="REPLACE", **parameters) == {"FINISHED"}
    left, bottom, right, top = np.round(np.array(piece.box) * (120, 96, 120, 96)).astype(int)
    made = decoded(image_data.read_pixels(photo)[bottom:top, left:right, :3])
    # A patch sees less around it than the learned recipe of images looks at.
    close = 0.1 if mode == "image" and size is not None else 1e-6
    np.testing.assert_allclose(piece.colors[..., :3], made, atol=close)
    assert np.abs(made - decoded(soft()[bottom:top, left:right, :3])).max() > 0.02


@pytest.mark.parametrize("size", [None, 72**2])
def test_what_is_enlarged_is_drawn_in_its_place(begun, size):
    photo = add_image()
    bpy.context.scene.shock_filter.image.enlarge = 2
    preview = begun(photo, size=size)
    (piece,) = shown(preview)
    preview.end()
    bpy.ops.shock_filter.sharpen_image(image="Photo", enlarge=2)
    left, bottom, right, top = np.round(np.array(piece.box) * (240, 192, 240, 192)).astype(int)
    larger = image_data.read_pixels(bpy.data.images["Photo sharpened"])
    made = decoded(larger[bottom:top, left:right, :3])
    assert piece.colors.shape[:2] == made.shape[:2]
    # Where a patch is cut off, some bytes are rounded the other way.
    assert np.mean(abs(piece.colors[..., :3] - made) > 1e-6) < 1e-3


@pytest.mark.parametrize("float_buffer", [False, True])
@pytest.mark.parametrize("packed", [False, True])
def test_the_image_is_not_touched(begun, float_buffer, packed):
    photo = add_image(float_buffer=float_buffer)
    if packed:
        photo.pack()
    before = state(photo)
    preview = begun(photo)
    preview.drag(-200)
    shown(preview)
    assert preview.updates == 1
    assert state(photo) == before
    preview.end()
    assert state(photo) == before
    assert bpy.context.scene.shock_filter.image.amount == 1.0


def test_nothing_is_drawn_at_amount_0(begun):
    preview = begun(add_image())
    preview.drag(-400)
    assert "Amount 0 (move mouse)" in preview.text()
    (piece,) = shown(preview)
    stored = np.round(soft() * 255) / 255
    np.testing.assert_allclose(piece.colors[..., :3], decoded(stored[..., :3]), atol=1e-6)


def test_it_ends_when_the_image_is_gone_or_seen_no_more(begun, editor):
    photo, other = add_image(), add_image(name="Other")
    preview = begun(photo)
    assert preview.stage.lost() == ""
    editor(other)
    assert preview.stage.lost() == "the image is not shown any more"
    editor(photo)
    photo.scale(30, 30)
    assert preview.stage.lost() == "the image was removed or changed"
    bpy.data.images.remove(photo)
    assert preview.stage.lost() == "the image was removed or changed"


def test_images_that_cannot_be_sharpened_are_refused_in_words(editor):
    with pytest.raises(Refused, match="no image is open here"):
        preview_images.begin(editor(None), None, find("image"))
    tiled = bpy.data.images.new("Tiled", 8, 8, tiled=True)
    with pytest.raises(Refused, match="There is nothing to preview: it has UDIM tiles"):
        preview_images.begin(editor(tiled), None, find("image"))


@pytest.mark.parametrize(
    ("place", "box"),
    [
        ((0.5, 0.5), (40, 30, 60, 50)),
        ((0.0, 1.0), (0, 60, 20, 80)),
        ((7.0, -7.0), (80, 0, 100, 20)),
    ],
)
def test_a_patch_lies_inside_and_around_the_place(place, box):
    pixels = np.random.default_rng(0).random((80, 100, 4)).astype(np.float32)
    crop = crop_around(HostImage(pixels, "STRAIGHT", False, 0), place, 1600)
    left, bottom, right, top = box
    assert crop.box == (left / 100, bottom / 80, right / 100, top / 80)
    assert not crop.is_all
    np.testing.assert_array_equal(crop.shown(crop.image.pixels), pixels[bottom:top, left:right])
    height, width = crop.image.pixels.shape[:2]
    assert 20 < height <= 40
    assert 20 < width <= 40
    assert not np.shares_memory(crop.image.pixels, pixels)


def test_large_patches_begin_where_those_of_squares_do():
    pixels = np.zeros((1000, 1000, 4), np.float32)
    crop = crop_around(HostImage(pixels, "STRAIGHT", False, 0), (0.53, 0.61), 300_000)
    assert [n % 16 for n in crop.corner] == [0, 0]
    assert min(crop.rows.start, crop.columns.start) >= 64


@pytest.mark.parametrize("place", [(0.5, 0.5), (0.3, 0.7), (0.0, 1.0)])
def test_a_patch_shrinks_around_its_place(place):
    pixels = np.random.default_rng(0).random((80, 100, 4)).astype(np.float32)
    image = HostImage(pixels, "STRAIGHT", False, 0)
    less = crop_around(image, place, 400)
    for size in (3000, pixels.size):
        shrunk = crop_around(image, place, size).shrunk(place, 400)
        assert shrunk.box == less.box
        np.testing.assert_array_equal(shrunk.image.pixels, less.image.pixels)
    assert less.shrunk(place, 400) is less


def test_the_longer_a_kernel_works_the_smaller_is_the_patch_and_no_less_fast():
    def work(pixels, time, iterations):
        return pixels * min(58 * time, pixels) * iterations  # pixels that are reached

    sizes = [filtered_at_once(BeltramiSettings(time=time)) for time in (0.5, 1, 4, 16, 100)]
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[0] > 16_000
    assert sizes[-1] > 36**2
    for long, size in zip((0.5, 1, 4, 16, 100), sizes, strict=True):
        assert work(size, long, 2) < 7e6
    assert filtered_at_once(BeltramiSettings(time=4, iterations=8)) < 0.3 * sizes[2]
    assert filtered_at_once(BeltramiSettings(time=0)) > 1_000_000
    assert filtered_at_once(Denoising(BeltramiSettings(time=4), None)) == sizes[2]


class Reaching(BeltramiSettings):
    """Settings of a filter that reads 600 pixels for each one."""

    reach = 600.0


def test_any_filter_may_say_how_far_it_reaches():
    assert filtered_at_once(Reaching(iterations=1)) == 10_000
    assert filtered_at_once(Reaching(iterations=2)) == 5_000
    assert filtered_at_once(ImageSettings()) == np.inf
    assert filtered_at_once(ImageSettings(enlarge=4)) < filtered_at_once(ImageSettings(enlarge=2))


def test_denoising_longer_draws_a_smaller_patch(begun):
    pixels = np.full((200, 200, 4), 0.5, dtype=np.float32)
    preview = begun(add_image(pixels), "denoise_image")
    sides = []
    for kernel_time in (1.0, 24.0):
        preview.parameters.time = kernel_time
        (piece,) = shown(preview)
        sides.append(piece.colors.shape[0])
        assert f"patch of {sides[-1]} x {sides[-1]} pixels" in preview.text()
    assert sides[1] < 0.4 * sides[0]


def test_small_images_are_no_patch():
    pixels = np.zeros((4, 100, 4), dtype=np.float32)
    crop = crop_around(HostImage(pixels, "STRAIGHT", False, 0), (0.9, 0.9), 400)
    assert crop.is_all
    assert crop.shown(crop.image.pixels).shape == pixels.shape


def pixel(*values):
    return np.array(values, dtype=np.float32).reshape(1, 1, -1)


@pytest.mark.parametrize(
    ("image", "encoded", "early", "seen"),
    [
        (HostImage(pixel(0.5, 0, 1, 0.5), "STRAIGHT", False, 255), True, False, (0.107, 0, 0.5)),
        (HostImage(pixel(0.5, 0, 1, 0.5), "STRAIGHT", False, 255), True, True, (0.0509, 0, 0.214)),
        (HostImage(pixel(0.5, 0, 1, 0.5), "NONE", False, 255), True, True, (0.214, 0, 1)),
        (HostImage(pixel(0.5, 0, 1, 0.5), "CHANNEL_PACKED", False, 255), False, True, (0.5, 0, 1)),
        (HostImage(pixel(0.5, 0, 2, 0.5), "PREMUL", True, 0), False, True, (0.5, 0, 2)),
        (HostImage(pixel(0.5, 0, 1), "STRAIGHT", True, 0), False, False, (0.5, 0, 1)),
        (HostImage(pixel(0.5), "STRAIGHT", True, 0), False, False, (0.5, 0.5, 0.5)),
    ],
)
def test_screens_show_linear_colors_times_opacity(image, encoded, early, seen):
    ((color,),) = screen_colors(image, encoded, early)
    np.testing.assert_allclose(color[:3], seen, atol=1e-3)
    assert color[3] == (0.5 if image.pixels.shape[2] == 4 else 1.0)


@pytest.mark.parametrize(
    ("kind", "encoded"),
    [({}, True), ({"is_data": True}, False), ({"float_buffer": True}, False)],
)
def test_colors_are_decoded_as_the_image_is(begun, kind, encoded):
    preview = begun(add_image(np.full((8, 8, 4), 0.5, np.float32), **kind))
    (piece,) = shown(preview)
    expected = 0.25 if not encoded else 0.107 if bpy.app.version >= (5, 0, 0) else 0.0509
    if kind.get("float_buffer"):
        expected = 0.5  # Blender keeps these multiplied
    np.testing.assert_allclose(piece.colors[..., :3], expected, atol=2e-3)
    assert piece.transparent


def test_a_mouse_that_is_held_in_the_area_comes_in_at_the_other_side():
    view = SimpleNamespace(type="WINDOW", x=100, y=50, width=800, height=600)
    sidebar = SimpleNamespace(type="UI", x=800, y=50, width=100, height=600)
    area = SimpleNamespace(x=100, width=800, regions=[sidebar, view])
    for x, over in ((790, True), (890, False), (910, True), (90, False), (-10, True)):
        event = SimpleNamespace(mouse_x=x, mouse_y=70)
        assert is_over_view(area, event) == over
    assert not is_over_view(area, SimpleNamespace(mouse_x=790, mouse_y=700))
    assert is_over_view(None, None)


@pytest.mark.parametrize(
    ("mouse", "place"),
    [((130, 70), (30, 20)), ((850, 70), (400, 300)), ((950, 70), (400, 300))],
    ids=["view", "sidebar", "elsewhere"],
)
def test_the_mouse_points_or_else_the_middle_of_the_view(mouse, place):
    view = SimpleNamespace(type="WINDOW", x=100, y=50, width=800, height=600)
    sidebar = SimpleNamespace(type="UI", x=800, y=50, width=100, height=600)
    area = SimpleNamespace(x=100, width=800, regions=[sidebar, view])
    context = SimpleNamespace(area=area, region=view)
    event = SimpleNamespace(mouse_x=mouse[0], mouse_y=mouse[1])
    assert pointed_at(context, event) == (view, place)


def textured_sheet(image, left=0.0):
    """A sheet of 16 quads whose UVs fill a tile."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=4, y_subdivisions=4, calc_uvs=True)
    obj = bpy.context.object
    for loop in obj.data.uv_layers.active.uv:
        loop.vector.x += left
    material = bpy.data.materials.new("Paint")
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    material.node_tree.nodes.active = node
    obj.data.materials.append(material)
    return obj


def test_a_texture_is_drawn_as_the_operator_makes_it(editor):
    wood = add_image(soft(64, 64), "Wood")
    textured_sheet(wood)
    editor(wood)
    before = state(wood)
    preview = preview_images.begin(bpy.context, None, find("texture"))
    try:
        preview.drag(-100)
        preview.roll(3)
        (piece,) = shown(preview)
        assert state(wood)[:3] == before[:3]
        assert piece.box == (0, 0, 1, 1)
        assert preview.stage.chosen == {"image": "Wood"}
    finally:
        preview.end()
    assert state(wood) == before
    bpy.ops.shock_filter.sharpen_texture(
        output="REPLACE", amount=0.75, width=preview.parameters.width
    )
    made = decoded(image_data.read_pixels(wood)[..., :3])
    np.testing.assert_allclose(piece.colors[..., :3], made, atol=1e-6)


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT", "TEXTURE_PAINT"])
def test_a_texture_is_shown_on_the_model_and_the_material_comes_back(mode):
    wood = add_image(soft(64, 64), "Wood")
    sheet = textured_sheet(wood)
    twin = sheet.copy()
    twin.data = sheet.data.copy()
    bpy.context.collection.objects.link(twin)
    twin.data.materials[0] = sheet.active_material.copy()
    twin.select_set(False)
    nodes = [each.active_material.node_tree.nodes.active for each in (sheet, twin)]
    bpy.ops.object.mode_set(mode=mode)
    before, users = state(wood), wood.users
    preview = preview_images.begin(bpy.context, None, find("texture"))
    shown(preview)
    (instead,) = {node.image for node in nodes}
    assert instead != wood
    assert instead.colorspace_settings.name == wood.colorspace_settings.name
    result = image_data.read_pixels(instead)
    preview.compare()
    assert [node.image for node in nodes] == [wood, wood]
    preview.compare()
    assert [node.image for node in nodes] == [instead, instead]
    assert preview.stage.lost() == ""  # no editor is needed
    preview.end()
    assert [node.image for node in nodes] == [wood, wood]
    assert (state(wood), wood.users) == (before, users)
    assert bpy.context.object.mode == mode
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.shock_filter.sharpen_texture(output="REPLACE")
    np.testing.assert_array_equal(image_data.read_pixels(wood), result)


def test_nodes_of_groups_show_it_and_materials_of_other_files_do_not(tmp_path):
    wood = add_image(soft(16, 16), "Wood")
    sheet = textured_sheet(wood)
    group = bpy.data.node_groups.new("Inner", "ShaderNodeTree")
    inner = group.nodes.new("ShaderNodeTexImage")
    inner.image = wood
    tree = sheet.active_material.node_tree
    tree.nodes.remove(tree.nodes.active)
    tree.nodes.new("ShaderNodeGroup").node_tree = group
    assert stand_in.is_shown(sheet, wood)
    instead = stand_in.StandIn(wood)
    instead.show(image_data.read_pixels(wood))
    assert inner.image != wood
    bpy.data.images.remove(inner.image)  # whatever happens meanwhile
    instead.end()
    wood.source = "TILED"
    inner.image = wood
    assert not stand_in.is_shown(sheet, wood)


def test_tiles_of_a_texture_are_drawn_side_by_side():
    assert preview_images._tile_box(1001) == (0, 0, 1, 1)
    assert preview_images._tile_box(1003) == (2, 0, 3, 1)
    assert preview_images._tile_box(1020) == (9, 1, 10, 2)


def test_a_texture_needs_an_image_editor_for_its_preview(rounded_box, editor, monkeypatch):
    scene = bpy.context.scene.shock_filter
    scene.mode = "TEXTURE"
    rounded_box()
    obstacle = preview_operator._of_meshes
    assert (
        obstacle(bpy.context, find("texture"))
        == "Add an Image Texture node with an image to the material."
    )
    bpy.data.objects.remove(bpy.context.object)
    wood = add_image(soft(16, 16), "Wood")
    textured_sheet(wood)
    assert "Open the texture in an Image Editor" in obstacle(bpy.context, find("texture"))
    with monkeypatch.context() as patch:  # or a view that shows textures
        patch.setattr(preview_operator, "views_with_textures", lambda: ["view"])
        assert obstacle(bpy.context, find("texture")) == ""
        bpy.context.object.active_material.node_tree.nodes.active.image.source = "TILED"
        assert "has tiles that are not saved" in obstacle(bpy.context, find("texture"))
        wood.source = "GENERATED"
    editor(wood)
    assert obstacle(bpy.context, find("texture")) == ""


def test_the_reason_why_a_texture_cannot_be_previewed_is_the_true_one(
    rounded_box, editor, monkeypatch
):
    wood = add_image(soft(16, 16), "Wood")
    textured_sheet(wood)
    settings = bpy.context.scene.shock_filter
    settings.mode = "TEXTURE"
    obstacle = preview_operator._of_meshes
    monkeypatch.setattr(preview_operator, "views_with_textures", lambda: ["view"])
    add_image(soft(16, 16), "Other")
    settings.texture.image = "Other"
    assert "textures of its materials" in obstacle(bpy.context, find("texture"))
    settings.texture.image = "Wood"
    with monkeypatch.context() as patch:
        patch.setattr(stand_in, "is_shown", lambda obj, image: False)  # it has UDIM tiles
        assert "no UDIM tiles" in obstacle(bpy.context, find("texture"))
        patch.setattr(preview_operator.painting, "is_running", lambda: True)
        assert "A gain map is painted" in obstacle(bpy.context, find("texture"))
    assert obstacle(bpy.context, find("texture")) == ""
    wood.source = "MOVIE"
    said = preview_operator._of_images(editor(wood), find("image"))
    assert said.startswith("Wood: it is a movie")


def test_what_the_tab_shows_is_previewed():
    scene = bpy.context.scene.shock_filter
    scene.mode, scene.image_mode = "COLORS", "DENOISE_IMAGE"
    for kind, mode in (("VIEW_3D", "colors"), ("IMAGE_EDITOR", "denoise_image")):
        context = SimpleNamespace(
            scene=bpy.context.scene,
            space_data=SimpleNamespace(type=kind, image=None),
            mode="OBJECT",
            object=None,
            selected_objects=[],
        )
        assert preview_operator._shown_mode(context).key == mode


def test_drawing_ends_with_the_preview():
    overlay = Overlay(add_image())
    overlay.end()
    with pytest.raises(ValueError):
        bpy.types.SpaceImageEditor.draw_handler_remove(overlay._drawing, "WINDOW")
