# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Sharpen Image."""

import itertools
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from shock_filter.shock_addon.data import chosen
from shock_filter.shock_addon.data.image import images as image_data
from shock_filter.shock_addon.operators import base as operators
from shock_filter.shock_addon.operators import images as image_operator

sharpen = bpy.ops.shock_filter.sharpen_image


def read(image):
    return image_data.read_pixels(image)


def bits(image):
    return read(image).tobytes()


def blend(height=24, width=40):
    """A blurred edge in three channels, opaque."""
    step = 0.5 + 0.5 * np.tanh((np.arange(width) - width / 2) / 3)
    pixels = np.ones((height, width, 4), dtype=np.float32)
    pixels[..., 0] = step
    pixels[..., 1] = 1 - step
    pixels[..., 2] = 0.4 * step
    return pixels


def add(name="Photo", pixels=None, float_buffer=False, is_data=False, alpha_mode="STRAIGHT"):
    pixels = blend() if pixels is None else pixels
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(
        name, width, height, alpha=True, float_buffer=float_buffer, is_data=is_data
    )
    image.alpha_mode = alpha_mode
    image.pixels.foreach_set(pixels.reshape(-1))
    image.update()
    return image


def steepness(pixels):
    """How far the red channel is from a step of two values: 0 for a step."""
    red = pixels[..., 0]
    return np.minimum(red - red.min(), red.max() - red).mean()


def noise(height=16, width=16, seed=0):
    return np.random.default_rng(seed).random((height, width, 4)).astype(np.float32)


@pytest.mark.parametrize("float_buffer", [False, True])
def test_a_blend_becomes_an_edge_in_a_new_image(float_buffer):
    photo = add(float_buffer=float_buffer)
    before = read(photo)
    assert sharpen(image="Photo", time=1024.0) == {"FINISHED"}
    result = bpy.data.images["Photo sharpened"]
    after = read(result)
    np.testing.assert_array_equal(read(photo), before)
    assert after.shape == before.shape
    assert result.is_float == float_buffer
    assert steepness(after) < 0.6 * steepness(before)
    assert after.min() >= before.min()
    assert after.max() <= before.max()
    assert operators.summaries["image"].startswith(
        "Sharpened the image Photo into Photo sharpened: 960 pixels, changed "
    )


KINDS = [
    {"float_buffer": float_buffer, "is_data": is_data, "alpha_mode": alpha_mode}
    for float_buffer, is_data, alpha_mode in itertools.product(
        [False, True], [False, True], ["STRAIGHT", "PREMUL", "CHANNEL_PACKED", "NONE"]
    )
]


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: "-".join(map(str, kind.values())))
def test_time_zero_changes_no_bit_of_any_kind(kind, packed):
    pixels = noise()
    if kind["float_buffer"]:
        pixels[0, 0] = (-0.0, 1e3, -2.0, 0.25)
        pixels[0, 1] = (0.5, 3.0, 0.1, 0.0)
    photo = add(pixels=pixels, **kind)
    if packed:
        photo.pack()
    before, state = bits(photo), state_of(photo)
    for _ in range(3):
        assert sharpen(image="Photo", time=0.0, output="REPLACE") == {"FINISHED"}
    assert bits(photo) == before
    assert state_of(photo) == state
    sharpen(image="Photo", time=0.0)
    assert (bits(photo), state_of(photo), bpy.data.images.keys()) == (before, state, ["Photo"])
    sharpen(image="Photo", time=1.0)
    assert state_of(bpy.data.images["Photo sharpened"]) == packed_state(photo)


def packed_state(image):
    """The state of its packed copy: floats are packed as they are in memory, multiplied."""
    *rest, alpha, depth, space, _ = state_of(image)
    if alpha in {"STRAIGHT", "PREMUL"}:
        alpha = "PREMUL" if image.is_float else "STRAIGHT"
    return *rest, alpha, depth, space, True


def state_of(image):
    space = image.colorspace_settings.name
    packed = image.packed_file is not None
    return tuple(image.size), image.is_float, image.alpha_mode, image.depth, space, packed


def test_a_second_press_that_changes_nothing_leaves_no_copy():
    add()
    assert sharpen(image="Photo") == {"FINISHED"}
    made = bits(bpy.data.images["Photo sharpened"])
    assert sharpen(image="Photo sharpened", amount=0.0) == {"FINISHED"}
    assert sorted(bpy.data.images.keys()) == ["Photo", "Photo sharpened"]
    assert bits(bpy.data.images["Photo sharpened"]) == made
    said = operators.summaries["image"]
    assert said.startswith(
        "Nothing in Photo sharpened has changed, so no copy was made: 960 pixels"
    )
    # With something to change there is one.
    assert sharpen(image="Photo sharpened", what="photo", width=8.0) == {"FINISHED"}
    assert sorted(bpy.data.images.keys())[2:] == ["Photo sharpened.001"]


def test_a_second_press_on_the_same_image_makes_no_equal_copy():
    photo = add()
    before = bits(photo)
    assert sharpen(image="Photo", amount=0.0) == {"FINISHED"}
    said = operators.summaries["image"]
    assert said.startswith("Nothing in Photo has changed, so no copy was made: 960 pixels")
    assert (bits(photo), bpy.data.images.keys()) == (before, ["Photo"])
    for press in range(2):
        assert sharpen(image="Photo") == {"FINISHED"}
        assert bpy.data.images.keys() == ["Photo", "Photo sharpened"]
        said = "The result is in Photo sharpened already, so no copy was made."
        assert (said in operators.summaries["image"]) == (press == 1)
    # What the artist has painted on since is none.
    bpy.data.images["Photo sharpened"].pixels[0] = 0.25
    sharpen(image="Photo")
    assert bpy.data.images.keys() == ["Photo", "Photo sharpened", "Photo sharpened.001"]


def test_all_bytes_survive():
    levels = (np.arange(32 * 32 * 4) % 256 / 255).reshape(32, 32, 4).astype(np.float32)
    photo = add(pixels=levels)
    sharpen(image="Photo", time=0.0, output="REPLACE")
    np.testing.assert_array_equal(np.rint(255 * read(photo)), np.rint(255 * levels))


def test_pixels_that_stay_are_not_counted():
    levels = (np.arange(32 * 32 * 4) % 256 / 255).reshape(32, 32, 4).astype(np.float32)
    add(pixels=levels)
    sharpen(image="Photo", time=0.0)
    assert "1,024 pixels, changed 0, largest change 0 " in operators.summaries["image"]


def test_one_pixel_is_one():
    add(pixels=np.full((1, 1, 4), 0.5, np.float32))
    sharpen(image="Photo", time=0.0)
    assert " 1 pixel, changed 0, " in operators.summaries["image"]


def test_an_enlarged_image_whose_values_stay_is_not_changed():
    add(pixels=np.full((16, 16, 4), 0.5, np.float32))
    sharpen(image="Photo", enlarge=2)
    assert " 1,024 pixels, changed 0, largest change 0" in operators.summaries["image"]


def test_high_dynamic_range_is_kept():
    pixels = blend()
    pixels[..., :3] *= 20.0
    add(pixels=pixels, float_buffer=True)
    sharpen(image="Photo", time=16.0)
    after = read(bpy.data.images["Photo sharpened"])
    assert after.max() == pytest.approx(pixels.max(), rel=1e-3)
    assert (after != pixels).any()


def test_non_color_data_is_filtered_as_it_is():
    plain, data = add("Plain"), add("Data", is_data=True)
    assert data.colorspace_settings.name != plain.colorspace_settings.name
    sharpen(image="Plain", time=256.0)
    sharpen(image="Data", time=256.0)
    result = bpy.data.images["Data sharpened"]
    assert result.colorspace_settings.is_data
    np.testing.assert_array_equal(read(result), read(bpy.data.images["Plain sharpened"]))


def test_files_and_color_spaces_come_through(tmp_path):
    photo = add()
    path = str(tmp_path / "photo.png")
    photo.save(filepath=path)
    loaded = bpy.data.images.load(path)
    loaded.colorspace_settings.name = "Linear Rec.709"
    sharpen(image=loaded.name, time=256.0)
    result = bpy.data.images["photo sharpened"]
    assert result.colorspace_settings.name == "Linear Rec.709"
    assert result.filepath == ""
    assert (read(result) != read(loaded)).any()


@pytest.mark.parametrize("float_buffer", [False, True])
@pytest.mark.parametrize("output", ["NEW", "REPLACE"])
def test_a_packed_image_comes_back_from_the_file(output, float_buffer, tmp_path):
    photo = add(float_buffer=float_buffer)
    photo.colorspace_settings.name = "sRGB"
    photo.pixels.foreach_set(blend().reshape(-1))
    photo.pack()
    photo.use_fake_user = True
    sharpen(image="Photo", time=256.0, output=output)
    result = bpy.data.images["Photo" if output == "REPLACE" else "Photo sharpened"]
    assert result.packed_file is not None
    assert not result.is_dirty
    result.name = "Kept"
    sharp = read(result)
    assert steepness(sharp) < steepness(blend())
    path = str(tmp_path / "kept.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    np.testing.assert_allclose(read(bpy.data.images["Kept"]), sharp, atol=1e-6)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: "-".join(map(str, kind.values())))
def test_a_new_image_comes_back_from_the_file(kind, tmp_path):
    pixels = blend()
    pixels[..., 3] = np.linspace(0.2, 1.0, 40)
    add(pixels=pixels, **kind)
    sharpen(image="Photo", time=256.0)
    result = bpy.data.images["Photo sharpened"]
    sharp = read(result)
    path = str(tmp_path / "kept.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    seen = slice(3 if kind["alpha_mode"] == "NONE" else 4)  # its opacity is not read again
    found = read(bpy.data.images["Photo sharpened"])[..., seen]
    np.testing.assert_allclose(found, sharp[..., seen], atol=1e-6)


@pytest.mark.parametrize("float_buffer", [False, True])
def test_opacity_stays_and_transparent_pixels_lend_no_color(float_buffer):
    pixels = blend()
    pixels[..., 3] = np.where(np.arange(40) < 24, 1.0, 0.0)
    pixels[:, 24:, :3] = (1.0, 0.0, 1.0)  # what nobody sees
    if float_buffer:
        pixels[..., :3] *= pixels[..., 3:]
    photo = add(pixels=pixels, float_buffer=float_buffer)
    before = read(photo)
    sharpen(image="Photo", time=1024.0)
    after = read(bpy.data.images["Photo sharpened"])
    np.testing.assert_array_equal(after[..., 3], before[..., 3])
    seen = before[:, :24]
    assert (after[:, :24] <= seen.max(axis=(0, 1)) + 1e-6).all()
    assert (after[:, :24] >= seen.min(axis=(0, 1)) - 1e-6).all()
    assert (after != before).any()


def test_multiplied_floats_are_filtered_as_the_colors_that_they_stand_for():
    pixels = blend()
    pixels[..., 3] = 0.25
    straight = add("Straight", pixels)
    multiplied = pixels.copy()
    multiplied[..., :3] *= 0.25
    add("Multiplied", multiplied, float_buffer=True)
    sharpen(image="Straight", time=4096.0)
    sharpen(image="Multiplied", time=4096.0)
    bytes_ = read(bpy.data.images["Straight sharpened"])
    floats = read(bpy.data.images["Multiplied sharpened"])
    np.testing.assert_allclose(floats[..., :3] / 0.25, bytes_[..., :3], atol=2e-2)
    assert np.abs(bytes_ - read(straight)).max() > 0.05


def test_without_opacity_the_fourth_channel_stays_and_does_not_count():
    pixels = noise()
    opaque = pixels.copy()
    opaque[..., 3] = 1.0
    for name, values in (("Ignored", pixels), ("Opaque", opaque)):
        add(name, values, float_buffer=True, alpha_mode="NONE")
        sharpen(image=name, time=64.0)
    ignored = read(bpy.data.images["Ignored sharpened"])
    np.testing.assert_array_equal(ignored[..., 3], pixels[..., 3])
    np.testing.assert_array_equal(
        ignored[..., :3], read(bpy.data.images["Opaque sharpened"])[..., :3]
    )


@pytest.mark.parametrize("how", ["CHANNEL_PACKED", "setting"])
def test_packed_channels_are_filtered_alike(how):
    pixels = blend()
    pixels[..., 3] = pixels[..., 0]
    mode = how if how == "CHANNEL_PACKED" else "STRAIGHT"
    add(pixels=pixels, alpha_mode=mode)
    sharpen(image="Photo", time=256.0, alpha="none" if how == "setting" else "auto")
    after = read(bpy.data.images["Photo sharpened"])
    np.testing.assert_array_equal(after[..., 3], after[..., 0])
    assert (after[..., 3] != pixels[..., 3]).any()


def test_replacing_keeps_the_number_of_images():
    photo = add()
    before = read(photo)
    sharpen(image="Photo", time=256.0, output="REPLACE")
    assert bpy.data.images.keys() == ["Photo"]
    assert steepness(read(photo)) < steepness(before)
    assert photo.is_dirty


def last_properties():
    """What the last operator keeps for its redo."""
    return bpy.context.window_manager.operators[-1].properties


def test_redo_writes_the_same_image_again():
    add()
    sharpen("EXEC_DEFAULT", True, image="Photo", time=16.0)
    kept = last_properties()
    assert (kept.image, kept.result) == ("Photo", "Photo sharpened")
    first = read(bpy.data.images["Photo sharpened"])
    sharpen(image=kept.image, result=kept.result, time=1024.0)
    assert bpy.data.images.keys() == ["Photo", "Photo sharpened"]
    assert (read(bpy.data.images["Photo sharpened"]) != first).any()
    sharpen(image="Photo")
    assert bpy.data.images.keys() == ["Photo", "Photo sharpened", "Photo sharpened.001"]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("Photo.001", "Photo.001 sharpened"),
        ("photo.old.PNG", "photo.old sharpened"),
        ("photo.exr.002", "photo sharpened"),
        ("Photo sharpened", "Photo sharpened.001"),
        ("Photo sharpened.004", "Photo sharpened"),
        ("Photo denoised", "Photo denoised sharpened"),
        (".png", ".png sharpened"),
    ],
)
def test_new_names_have_no_file_ending_and_one_suffix(old, new):
    add(old)
    sharpen(image=old)
    assert bpy.data.images.keys() == sorted([old, new])


def test_redo_makes_another_image_if_the_first_cannot_take_it():
    add()
    bpy.data.images.new("Photo sharpened", 3, 3)
    sharpen(image="Photo", result="Photo sharpened")
    assert bpy.data.images["Photo sharpened"].size[0] == 3
    assert bpy.data.images["Photo sharpened.001"].size[0] == 40


def filtered(pixels, kind, **settings):
    """What a run makes of pixels in an image of its own."""
    image = add("Sample", pixels, **kind)
    sharpen(image="Sample", output="REPLACE", **settings)
    result = read(image)
    bpy.data.images.remove(image)
    return result


def replaced(kind, packed):
    """Sharpen an image in place, from the interface; returns the old pixels."""
    photo = add(**kind)
    photo.use_fake_user = True
    if packed:
        photo.pack()
    old = read(photo)
    bpy.ops.ed.undo_push(message="Start")
    sharpen("EXEC_DEFAULT", True, image="Photo", time=16.0, output="REPLACE")
    assert (read(photo) != old).any()
    return old


def pixels_of(name):
    return read(bpy.data.images[name])


def paint(image):
    """A stroke, which Blender's undo does not know; returns all pixels."""
    pixels = read(image)
    pixels[:4, :, :3] = (1.0, 0.0, 0.0)
    image.pixels.foreach_set(pixels.reshape(-1))
    return read(image)


REPLACED = pytest.mark.parametrize(
    ("kind", "packed"),
    [({"float_buffer": floats}, packed) for floats in (False, True) for packed in (False, True)],
    ids=["bytes", "packed-bytes", "floats", "packed-floats"],
)


@REPLACED
def test_redo_of_a_replaced_image_starts_from_the_old_pixels(adjust, kind, packed):
    expected = filtered(blend(), kind, time=256.0)
    old = replaced(kind, packed)
    for _ in range(2):
        adjust(time=256.0)
        np.testing.assert_array_equal(pixels_of("Photo"), expected)
    adjust(output="NEW")
    np.testing.assert_array_equal(pixels_of("Photo"), old)
    np.testing.assert_array_equal(pixels_of("Photo sharpened"), expected)


@REPLACED
def test_repeating_a_replacement_sharpens_what_is_there(repeat, kind, packed):
    replaced(kind, packed)
    for now in (pixels_of("Photo"), paint(bpy.data.images["Photo"])):
        bpy.data.images["Photo"].pixels.foreach_set(now.reshape(-1))
        repeat()
        found = pixels_of("Photo")
        np.testing.assert_array_equal(found, filtered(now, kind, time=16.0))


def test_strokes_on_a_replaced_image_outlive_a_redo(adjust):
    replaced({}, packed=False)
    painted = paint(bpy.data.images["Photo"])
    adjust(time=256.0)
    found = pixels_of("Photo")
    np.testing.assert_array_equal(found, filtered(painted, {}, time=256.0))


def test_strokes_on_a_result_outlive_a_repetition(repeat):
    add()
    sharpen("EXEC_DEFAULT", True, image="Photo", time=16.0)
    made = pixels_of("Photo sharpened")
    repeat()
    assert bpy.data.images.keys() == ["Photo", "Photo sharpened"]
    painted = paint(bpy.data.images["Photo sharpened"])
    repeat()
    np.testing.assert_array_equal(pixels_of("Photo sharpened"), painted)
    np.testing.assert_array_equal(pixels_of("Photo sharpened.001"), made)
    repeat()
    assert bpy.data.images.keys() == ["Photo", "Photo sharpened", "Photo sharpened.001"]


def test_a_result_of_another_depth_is_not_reused():
    """Nor does the source's depth change what an earlier result can take."""
    add()
    sharpen(image="Photo")
    bpy.data.images.remove(bpy.data.images["Photo"])
    photo = add(float_buffer=True)
    sharpen(image="Photo", result="Photo sharpened")
    assert not bpy.data.images["Photo sharpened"].is_float
    assert bpy.data.images["Photo sharpened.001"].is_float == photo.is_float


def test_undo_takes_the_new_image_away_and_redo_brings_it_back():
    add().use_fake_user = True
    bpy.ops.ed.undo_push(message="Before")
    sharpen(image="Photo")
    bpy.data.images["Photo sharpened"].use_fake_user = True
    bpy.ops.ed.undo_push(message="After")
    sharp = bits(bpy.data.images["Photo sharpened"])
    bpy.ops.ed.undo()
    assert bpy.data.images.keys() == ["Photo"]
    bpy.ops.ed.redo()
    assert bits(bpy.data.images["Photo sharpened"]) == sharp


def with_source(source):
    image = bpy.data.images.new("Photo", 4, 4)
    image.source = source


def rendered():
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 1
    scene.render.resolution_x = scene.render.resolution_y = 8
    bpy.ops.render.render()
    bpy.data.images["Render Result"].name = "Photo"


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: with_source("MOVIE"), "it is a movie"),
        (lambda: with_source("SEQUENCE"), "it is an image sequence"),
        (lambda: with_source("FILE"), "it has no pixels; check that its file exists"),
        (lambda: bpy.data.images.new("Photo", 4, 4, tiled=True), "it has UDIM tiles"),
        (rendered, "it is a render result or a viewer"),
    ],
    ids=["movie", "sequence", "missing", "tiles", "render"],
)
def test_what_cannot_be_sharpened_is_refused_with_the_reason(make, reason):
    make()
    with pytest.raises(RuntimeError, match=rf"Skipped Photo: {reason}"):
        sharpen(image="Photo")
    assert "Photo sharpened" not in bpy.data.images


def test_linked_images_are_refused(tmp_path):
    photo = add()
    photo.pack()
    library = str(tmp_path / "library.blend")
    bpy.data.libraries.write(library, {photo})
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(library, link=True) as (_, wanted):
        wanted.images = ["Photo"]
    with pytest.raises(RuntimeError, match=r"Skipped Photo: it is linked .* make it local"):
        sharpen(image="Photo")


def test_nan_is_named_and_nothing_is_added():
    pixels = blend()
    pixels[3, 4, 1] = np.nan
    add(pixels=pixels, float_buffer=True)
    with pytest.raises(RuntimeError, match=r"Skipped Photo: The image holds NaN"):
        sharpen(image="Photo")
    assert bpy.data.images.keys() == ["Photo"]


def test_no_image_greys_the_button_out_and_unknown_names_are_named():
    assert not sharpen.poll()
    add()
    assert sharpen.poll()
    with pytest.raises(RuntimeError, match="There is no image named 'Nowhere'"):
        sharpen(image="Nowhere")
    with pytest.raises(RuntimeError, match="Open an image in the Image Editor"):
        sharpen()


def test_an_image_that_was_removed_meanwhile_is_skipped():
    photo = add()
    target = image_data.read_image(photo)
    bpy.data.images.remove(photo)
    with pytest.raises(image_operator.Skipped, match="it was removed meanwhile"):
        image_data.find_image(target)


def test_an_image_of_another_size_is_skipped():
    photo = add()
    target = image_data.read_image(photo)
    photo.scale(10, 10)
    with pytest.raises(image_operator.Skipped, match="it was changed meanwhile"):
        image_data.find_image(target)


def test_an_image_that_was_painted_on_meanwhile_is_not_replaced():
    photo = add()
    target = image_data.read_image(photo)
    painted = np.zeros_like(target.surface.pixels)
    image_data.write_parts(photo, {image_data.UNTILED: painted}, pack=False)
    new = {image_data.UNTILED: target.surface.pixels * 0.5}
    with pytest.raises(image_operator.Skipped, match="it was changed meanwhile"):
        image_data.overwrite(photo, target.parts, new)
    np.testing.assert_array_equal(image_data.read_pixels(photo), painted)


def test_an_image_that_was_renamed_meanwhile_is_found():
    photo = add()
    target = image_data.read_image(photo)
    photo.name = "Another"
    assert image_data.find_image(target) == photo


def test_only_the_image_editor_has_an_edited_image():
    photo = add()
    editor = SimpleNamespace(type="IMAGE_EDITOR", image=photo)
    assert chosen.edited_image(SimpleNamespace(space_data=editor)) == photo
    editor.type = "VIEW_3D"
    assert chosen.edited_image(SimpleNamespace(space_data=editor)) is None
    assert chosen.edited_image(SimpleNamespace(space_data=None)) is None


@pytest.fixture
def editors():
    """Show an image in the first two Image Editors of Blender's workspaces."""
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    add().use_fake_user = True
    add("Other").use_fake_user = True
    areas = [(area, screen) for screen in bpy.data.screens for area in screen.areas]
    found = [(area, screen) for area, screen in areas if area.type == "IMAGE_EDITOR"][:2]
    for area, _ in found:
        area.spaces.active.image = bpy.data.images["Photo"]
    return found


def sharpen_in(editors):
    (area, screen), _ = editors
    with bpy.context.temp_override(screen=screen, area=area):
        assert sharpen() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="Sharpen")


def shown(editors):
    return [area.spaces.active.image.name for area, _ in editors]


def test_the_image_editor_shows_the_result(editors):
    sharpen_in(editors)
    assert shown(editors) == ["Photo sharpened", "Photo"]


def test_image_editors_follow_undo_and_redo(editors):
    bpy.ops.ed.undo_push(message="Before")
    sharpen_in(editors)
    sharpen_in(editors)
    assert shown(editors) == ["Photo sharpened.001", "Photo"]
    bpy.ops.ed.undo()
    assert shown(editors) == ["Photo sharpened", "Photo"]
    bpy.ops.ed.undo()
    assert shown(editors) == ["Photo", "Photo"]
    bpy.ops.ed.redo()
    bpy.ops.ed.redo()
    assert shown(editors) == ["Photo sharpened.001", "Photo"]


def test_an_image_editor_in_which_another_image_was_opened_keeps_it(editors):
    bpy.ops.ed.undo_push(message="Before")
    sharpen_in(editors)
    bpy.ops.ed.undo()
    editors[0][0].spaces.active.image = bpy.data.images["Other"]
    bpy.ops.ed.redo()
    assert shown(editors) == ["Other", "Photo"]
    editors[0][0].spaces.active.image = bpy.data.images["Photo"]
    bpy.ops.ed.undo_push(message="Later")
    bpy.ops.ed.undo()
    assert shown(editors) == ["Photo", "Photo"]


@pytest.mark.parametrize("alpha_mode", ["STRAIGHT", "PREMUL", "CHANNEL_PACKED", "NONE"])
@pytest.mark.parametrize("float_buffer", [False, True])
def test_an_enlarged_image_is_a_new_and_larger_one(float_buffer, alpha_mode):
    pixels = blend()
    if alpha_mode != "NONE":
        pixels[:, :10, 3] = 0.5
    photo = add(pixels=pixels, float_buffer=float_buffer, alpha_mode=alpha_mode)
    assert sharpen(image="Photo", enlarge=2) == {"FINISHED"}
    result = bpy.data.images["Photo sharpened"]
    assert (*result.size, *photo.size) == (80, 48, 40, 24)
    assert result.packed_file is not None
    after, before = read(result), read(photo)
    assert abs(after[::2, ::2] - before).max() < 0.6
    assert abs(after[..., 3] - before[..., 3].repeat(2, 0).repeat(2, 1)).max() < 0.3
    assert operators.summaries["image"].startswith(
        "Sharpened the image Photo into Photo sharpened: 3,840 pixels, changed 3,840, "
    )


def test_the_panel_enlarges_once():
    add(pixels=noise())
    kept = bpy.context.scene.shock_filter.image
    kept.enlarge = 2
    sharpen(image="Photo", amount=0.0)  # a script's own
    assert kept.enlarge == 2
    sharpen(image="Photo", amount=0.0, enlarge=2)
    assert kept.enlarge == 1
    height, width = 2 * noise().shape[0], 2 * noise().shape[1]
    said = f"Enlarged to {width} x {height} pixels. Enlarge was set back to 1"
    assert said in operators.summaries["image"]
    sharpen(image="Photo", amount=0.0, enlarge=kept.enlarge)
    assert "Enlarge" not in operators.summaries["image"]


def test_the_colors_of_enlarged_floats_are_not_multiplied_twice():
    pixels = np.full((12, 12, 4), 0.5, dtype=np.float32)
    add(pixels=pixels, float_buffer=True, alpha_mode="PREMUL")
    sharpen(image="Photo", enlarge=2)
    np.testing.assert_allclose(read(bpy.data.images["Photo sharpened"]), 0.5, atol=1e-6)


def test_redo_with_another_size_makes_another_image():
    add()
    sharpen("EXEC_DEFAULT", True, image="Photo")
    sharpen(image="Photo", result="Photo sharpened", enlarge=2)
    assert tuple(bpy.data.images["Photo sharpened.001"].size) == (80, 48)
    sharpen(image="Photo", result="Photo sharpened.001", enlarge=2, amount=0.5)
    assert len(bpy.data.images) == 3


@REPLACED
def test_an_image_that_is_enlarged_in_place_gets_its_size_back(adjust, kind, packed):
    photo = add(**kind)
    photo.use_fake_user = True
    if packed:
        photo.pack()
    old = read(photo)
    bpy.ops.ed.undo_push(message="Start")
    sharpen("EXEC_DEFAULT", True, image="Photo", enlarge=2, output="REPLACE")
    assert pixels_of("Photo").shape == (48, 80, 4)
    adjust(enlarge=4)
    assert pixels_of("Photo").shape == (96, 160, 4)
    adjust(enlarge=1, output="NEW")
    np.testing.assert_array_equal(pixels_of("Photo"), old)
