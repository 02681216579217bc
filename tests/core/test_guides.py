# SPDX-License-Identifier: GPL-3.0-or-later
"""Several maps follow the flow of one, so that their borders lie in the same places."""

import numpy as np
import pytest
from atlases import Blocks
from PIL import Image
from scipy.ndimage import gaussian_filter
from shapes import grid
from shock_filter import core
from shock_filter.core import cli

SIZE = 96


def blotches(seed=0, contrast=0.6, sigma=2.0, size=SIZE):
    """Two values with soft borders between them."""
    noise = gaussian_filter(np.random.default_rng(seed).normal(size=(size, size)), 9.0)
    steps = gaussian_filter((noise > 0).astype(np.float32), sigma)
    return (0.5 + contrast * (steps - 0.5)).astype(np.float32)


def colored(gray):
    return np.stack([gray, 1.0 - gray, 0.5 * gray], axis=-1)


def sharpened(image, guide=None, mask=None, **settings):
    return core.sharpen_image(image, core.ImageSettings(**settings), mask=mask, guide=guide)


def flat_square():
    vertices, faces = grid(4, 4)
    return core.TriangleMesh(vertices, faces), vertices[faces][..., :2] / 4


def on_square(image, guide=None, **settings):
    mesh, uv = flat_square()
    return core.sharpen_texture(mesh, uv, image, core.TextureSettings(**settings), guide=guide)


BOTH = pytest.mark.parametrize("filtered", [sharpened, on_square], ids=["image", "texture"])


@BOTH
@pytest.mark.parametrize("how", [{"time": 256.0}, {}, {"what": "photo"}, {"what": "drawing"}])
@pytest.mark.parametrize("channels", ["coupled", "luminance"])
def test_an_image_that_guides_itself_is_sharpened_as_ever(filtered, channels, how):
    image = colored(blotches())
    settings = {**how, "channels": channels}
    guided = filtered(image, image, **settings)
    if not how:  # a guide leaves it to the width
        settings["what"] = "drawing"
    np.testing.assert_allclose(
        guided, filtered(image, **settings), atol=1e-4 if not how.get("time") else 0
    )


@BOTH
@pytest.mark.parametrize("what", ["auto", "drawing", "photo"])
def test_faint_maps_get_their_borders_where_the_guide_has_them(filtered, what):
    lead, faint = blotches(), blotches(contrast=0.05)
    result = filtered(faint, lead, what=what)
    sides = lead > 0.5
    inner = np.zeros_like(sides)
    inner[8:-8, 8:-8] = True
    level = np.where(sides, faint.max(), faint.min())
    left = abs(result - level)[inner].mean() / abs(faint - level)[inner].mean()
    assert left < (0.55 if what == "photo" else 0.45)


@BOTH
def test_noise_in_a_map_makes_no_borders(filtered):
    # By itself it would be pulled to borders of its own.
    lead = blotches()
    grain = gaussian_filter(np.random.default_rng(1).normal(size=lead.shape), 3.0)
    grain = (0.5 + 0.1 * grain / grain.std()).astype(np.float32)
    still = np.hypot(*np.gradient(gaussian_filter(lead, 4.0))) < 1e-3
    assert still.mean() > 0.15
    alone, led = filtered(grain, time=65536.0), filtered(grain, lead, time=65536.0)
    steps = [abs(np.diff(each, axis=0))[still[1:]].max() for each in (grain, alone, led)]
    assert steps[1] > 1.5 * steps[0]
    assert steps[2] < 1.2 * steps[0]


@BOTH
@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float64"])
def test_types_may_differ(filtered, dtype):
    lead = (blotches() * 255).astype(np.uint8)
    image = colored(blotches(1))
    scale = np.iinfo(dtype).max if dtype.startswith("u") else 1
    image = (image * scale).astype(dtype)
    result = filtered(image, lead, width=4.0)
    assert (result.dtype, result.shape) == (image.dtype, image.shape)
    assert image.min() - 1e-6 <= result.min() <= result.max() <= image.max() + 1e-6


def test_opacity_of_the_image_stays_and_that_of_the_guide_weighs():
    lead = np.concatenate([colored(blotches()), np.zeros((SIZE, SIZE, 1))], axis=2)
    image = np.concatenate([colored(blotches(1)), blotches(2)[..., None]], axis=2)
    unmoved = sharpened(image, lead.astype(np.float32), time=256.0)
    np.testing.assert_allclose(unmoved, image, atol=1e-4)  # nothing is seen of the guide
    lead[..., 3] = 1.0
    moved = sharpened(image, lead.astype(np.float32), time=256.0)
    np.testing.assert_array_equal(moved[..., 3], image[..., 3])
    assert abs(moved - image).max() > 0.1


def test_masks_amount_and_neutral_settings_hold():
    lead, image = blotches(), blotches(1)
    full = sharpened(image, lead, width=4.0)
    np.testing.assert_array_equal(sharpened(image, lead, amount=0.0), image)
    np.testing.assert_array_equal(sharpened(image, lead, time=0.0), image)
    half = sharpened(image, lead, width=4.0, amount=0.5)
    np.testing.assert_allclose(half, (image + full) / 2, atol=1e-6)
    mask = np.zeros((SIZE, SIZE))
    np.testing.assert_array_equal(sharpened(image, lead, mask, width=4.0), image)


def test_a_sharp_guide_moves_nothing():
    image = blotches(1)
    lead = np.kron(np.eye(12), np.ones((8, 8))).astype(np.float32)
    np.testing.assert_array_equal(sharpened(image, lead), image)


def test_guide_and_image_are_enlarged_together():
    lead, image = blotches(), blotches(contrast=0.05)
    result = sharpened(image, lead, width=4.0, enlarge=2)
    assert result.shape == (2 * SIZE, 2 * SIZE)
    wanted = sharpened(image, lead, width=4.0).repeat(2, 0).repeat(2, 1)
    assert abs(result - wanted).mean() < 0.003


def test_a_line_of_pixels_can_be_guided():
    result = sharpened(blotches()[:1], blotches()[:1], time=64.0)
    np.testing.assert_array_equal(result, sharpened(blotches()[:1], time=64.0))


@BOTH
def test_guides_that_do_not_fit_are_named(filtered):
    image = blotches()
    with pytest.raises(core.InvalidSignal, match="The guide has 95 x 96 pixels, the image 96 x 96"):
        filtered(image, image[:, 1:])
    with pytest.raises(core.InvalidSignal, match="NaN"):
        filtered(image, np.full_like(image, np.nan))
    with pytest.raises(core.InvalidSettings, match="'independent', and a guide moves all alike"):
        filtered(image, image, channels="independent")


def test_charts_do_not_show():
    lead, faint = (colored(blotches(size=128, contrast=c)) for c in (0.6, 0.1))
    maps = {}
    for name, picture in (("lead", lead), ("faint", faint)):
        blocks = Blocks(picture)
        maps[name] = blocks.texture(0.0).astype(np.float32)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    settings = core.TextureSettings(width=6.0, what="drawing")
    cut = core.sharpen_texture(mesh, blocks.uv, maps["faint"], settings, guide=maps["lead"])
    plane, uv = flat_square()
    whole = core.sharpen_texture(plane, uv, faint, settings, guide=lead)
    y, x = np.mgrid[12:116, 12:116] + 0.5
    seen = blocks.read(cut, np.stack([x, y], axis=-1))
    change = np.abs(whole - faint)[12:116, 12:116].mean()
    assert np.abs(seen - whole[12:116, 12:116]).mean() < 0.05 * change


def test_normals_that_follow_stay_unit_vectors():
    mesh, uv = flat_square()
    lead = blotches()
    slope = np.stack(np.gradient(10.0 * gaussian_filter(lead, 1.0)), axis=-1)
    normals = np.concatenate([-slope, np.ones((SIZE, SIZE, 1))], axis=2)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    image = (0.5 + 0.5 * normals).astype(np.float32)
    settings = core.TextureSettings(content="normals", width=5.0)
    result = core.sharpen_texture(mesh, uv, image, settings, guide=lead)
    assert np.abs(result - image).max() > 0.05
    np.testing.assert_allclose(np.linalg.norm(2 * result - 1, axis=2), 1.0, atol=1e-5)


def test_the_command_line_takes_a_guide(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    lead, *maps = ((blotches(seed) * 255).astype(np.uint8) for seed in (0, 1, 2))
    Image.fromarray(lead).save("base.png")
    for name, pixels in zip("ab", maps, strict=True):
        Image.fromarray(pixels).save(f"{name}.png")
    words = ["--guide", "base.png", "--width", "5"]
    assert cli.main(["sharpen-image", "a.png", "b.png", "out/", *words]) == 0
    for name, pixels in zip("ab", maps, strict=True):
        with Image.open(f"out/{name}.png") as file:
            np.testing.assert_array_equal(np.array(file), sharpened(pixels, lead, width=5.0))
    Image.fromarray(lead[1:]).save("base.png")
    assert cli.main(["sharpen-image", "a.png", "c.png", *words]) == 1
    assert "The guide has 96 x 95 pixels" in capsys.readouterr().err


def test_textures_on_the_command_line_take_a_guide(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mesh, uv = flat_square()
    lines = [f"v {x} {y} {z}" for x, y, z in mesh.vertices]
    lines += [f"vt {u} {v}" for u, v in uv.reshape(-1, 2)]
    corners = np.arange(1, uv.shape[0] * 3 + 1).reshape(-1, 3)
    lines += [
        "f " + " ".join(f"{v + 1}/{c}" for v, c in zip(face, corner, strict=True))
        for face, corner in zip(mesh.faces, corners, strict=True)
    ]
    (tmp_path / "mesh.obj").write_text("\n".join(lines) + "\n")
    lead, image = ((blotches(seed) * 255).astype(np.uint8) for seed in (0, 1))
    Image.fromarray(lead[::-1]).save("base.png")
    Image.fromarray(image[::-1]).save("in.png")
    words = ["mesh.obj", "in.png", "out.png", "--guide", "base.png", "--width", "5"]
    assert cli.main(["sharpen-texture", *words]) == 0
    with Image.open("out.png") as file:
        found = np.array(file)[::-1]
    np.testing.assert_array_equal(found, on_square(image, lead, width=5.0))


def test_noise_of_a_map_is_not_amplified_where_the_guide_has_none():
    lead = blotches()
    even = np.random.default_rng(0).normal(0.5, 0.02, lead.shape).astype(np.float32)
    result = sharpened(even, lead, what="drawing")
    assert result.std() < 1.02 * even.std()
