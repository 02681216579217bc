# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixel art is enlarged by whole pixels, and nothing else is taken for it."""

from itertools import pairwise

import dask.array
import numpy as np
import pytest
from PIL import Image, ImageDraw
from shock_filter import core
from shock_filter.core.base.findings import gathering
from shock_filter.core.color.image_sharpening import measure_image
from shock_filter.core.color.pixel_art import pixel_art, put_pixels
from skimage import data

FOUND = "Taken for pixel art: pixels became squares. For smooth outlines set What to Drawing."


def sprite(seed, size=24, opacity=False):
    """A figure with an outline, of five colors, as bytes."""
    random = np.random.default_rng(seed)
    half = random.random((size, size // 2)) < 0.55
    body = np.concatenate([half, half[:, ::-1]], axis=1)
    around = np.pad(body, 1)
    outline = around[:-2, 1:-1] | around[2:, 1:-1] | around[1:-1, :-2] | around[1:-1, 2:]
    which = np.where(body, 1 + np.arange(size)[:, None] * 3 // size, 4 * (outline & ~body))
    colors = random.permutation(np.linspace(0, 255, 20).astype(np.uint8))[:15].reshape(5, 3)
    image = colors[which]
    if opacity:
        image = np.dstack([image, np.where(which > 0, 255, 0).astype(np.uint8)])
    return image


def shapes(seed, size=64, fine=4):
    """A drawing of three shapes as logos have them, antialiased."""
    random = np.random.default_rng(seed)
    n = size * fine
    image = Image.new("RGB", (n, n), (250, 240, 230))
    draw = ImageDraw.Draw(image)
    for number in range(3):
        fill = tuple(int(value) for value in random.integers(0, 200, 3))
        x, y = random.uniform(0.05, 0.45, 2) * n
        box = [x, y, x + 0.5 * n, y + 0.4 * n]
        [draw.ellipse, draw.rectangle, draw.ellipse][number](box, fill=fill)
    draw.polygon([(0.1 * n, 0.9 * n), (0.4 * n, 0.2 * n), (0.9 * n, 0.7 * n)], fill=(20, 30, 90))
    return np.asarray(image.resize((size, size), Image.Resampling.BOX))


def enlarged(image, times, **settings):
    return core.sharpen_image(image, core.ImageSettings(enlarge=times, **settings))


def squares(image, times):
    return image.repeat(times, 0).repeat(times, 1)


@pytest.mark.parametrize("times", range(2, 9))
def test_pixels_become_equal_squares(times):
    for opacity in (False, True):
        image = sprite(1, opacity=opacity)
        assert np.array_equal(enlarged(image, times), squares(image, times))


@pytest.mark.parametrize("dtype", ["uint16", "float32", "float64"])
def test_it_does_so_for_all_types(dtype):
    image = (sprite(2) / 255.0 * (65535 if dtype == "uint16" else 1)).astype(dtype)
    assert np.array_equal(enlarged(image, 3), squares(image, 3))


def test_it_says_so_and_what_overrides_it():
    image = sprite(3)
    with gathering() as findings:
        enlarged(image, 4)
    assert [str(each) for each in findings] == [FOUND]
    for given in ({"what": "drawing"}, {"what": "photo"}, {"width": 1.0}, {"time": 10.0}):
        with gathering() as findings:
            result = enlarged(image, 4, **given)
        assert not np.array_equal(result, squares(image, 4))
        assert FOUND not in [str(each) for each in findings]


@pytest.mark.parametrize("name", ["astronaut", "camera", "coins", "rocket", "coffee"])
@pytest.mark.parametrize("side", [16, 48, 128])
def test_photos_are_none(name, side):
    photo = Image.fromarray(getattr(data, name)())
    small = np.asarray(photo.resize((side, side), Image.Resampling.BOX))
    assert pixel_art(np.atleast_3d(small)) == 0.0


@pytest.mark.parametrize("fine", [2, 4])
@pytest.mark.parametrize("side", [16, 32, 64, 128])
@pytest.mark.parametrize("colors", [None, 16])
def test_antialiased_drawings_and_logos_are_none(fine, side, colors):
    for seed in range(4):
        image = Image.fromarray(shapes(seed, side, fine))
        if colors:
            image = image.quantize(colors, dither=Image.Dither.NONE).convert("RGB")
        assert pixel_art(np.asarray(image)) == 0.0


def test_gradients_and_even_and_large_images_are_none():
    slope = np.repeat(np.arange(64, dtype=np.uint8)[None, :, None], 64, axis=0)
    even, large = np.full((9, 9, 1), 7, np.uint8), np.tile(sprite(1), (22, 22, 1))
    for image in (slope, 4 * slope, even, large):
        assert pixel_art(image) == 0.0


def test_it_is_so_or_not_by_degrees():
    image = sprite(1)
    shares = []
    for soft in range(0, 25):  # one more row of steps between two colors at a time
        mixed = image.copy()
        for row in range(soft):
            mixed[row, 1:-1:3] = (image[row, :-2:3].astype(int) + image[row, 2::3]) // 2
        shares.append(pixel_art(mixed))
    assert shares[0] == 1.0
    assert all(later <= earlier + 0.35 for earlier, later in pairwise(shares))
    assert any(0.0 < share < 1.0 for share in shares)


def test_shares_mix_and_hidden_pixels_lend_no_color():
    image = np.zeros((1, 2, 4), np.float32)
    image[0, 0] = 0.8, 0.6, 0.4, 1.0
    image[0, 1, :3] = 9.0
    target = np.full((2, 4, 4), 0.5, np.float32)
    put_pixels(image, 0.5, 2, 3, target)
    np.testing.assert_allclose(target[0, 3], [0.5, 0.5, 0.5, 0.25])
    share = 0.5 / 0.75
    np.testing.assert_allclose(target[0, 0, 0], 0.5 + share * 0.3, rtol=1e-6)
    assert target[0, 0, 3] == 0.75


def test_chunks_and_parts_go_by_the_whole():
    image = np.tile(sprite(4), (4, 4, 1))
    chunked = core.sharpen_image(
        dask.array.from_array(image, chunks=(40, 31, 3)), core.ImageSettings(enlarge=3)
    )
    assert np.array_equal(chunked.compute(), squares(image, 3))
    settings = core.ImageSettings(enlarge=3)
    known = core.color.image_sharpening.measure_image(image, settings)
    assert known.pixel_art == 1.0
    one = np.zeros((5, 5, 3), np.uint8)  # by itself it has nothing to tell by
    one[2:] = 200
    part = core.sharpen_image(one, settings, known=known)
    assert np.array_equal(part, squares(one, 3))


def test_amount_and_masks_mix_with_the_spline():
    image = sprite(5)
    mask = np.zeros(image.shape[:2])
    mask[:12] = 1.0
    plain = enlarged(image, 2, amount=0.0)
    result = core.sharpen_image(image, core.ImageSettings(enlarge=2), mask=mask)
    assert np.array_equal(result[:20], squares(image, 2)[:20])
    assert np.array_equal(result[-20:], plain[-20:])


@pytest.mark.parametrize("dtype", ["uint8", "float32"])
def test_at_its_own_size_it_stays_bit_for_bit(dtype):
    image = sprite(3)
    image[5, 7], image[8, 3] = 255, 0  # highlights of one pixel
    image = image if dtype == "uint8" else (image / 255.0).astype(dtype)
    with gathering() as findings:
        assert np.array_equal(core.sharpen_image(image), image)
    assert [str(each) for each in findings] == [
        "Taken for pixel art, which is sharp. To sharpen it still, set What to Drawing."
    ]
    chunked = core.sharpen_image(dask.array.from_array(image, chunks=(13, 9, 3)))
    assert np.array_equal(chunked.compute(), image)


def test_what_is_nearly_some_changes_in_part():
    image = np.pad(sprite(1), ((10, 10), (10, 10), (0, 0)), constant_values=255)
    soft = image.copy()
    share, row = 1.0, 0
    while not 0.0 < share < 1.0:
        soft[row, 1:-1:3] = (image[row, :-2:3].astype(int) + image[row, 2::3]) // 2
        share, row = pixel_art(soft), row + 1
    soft = soft / 255.0
    known = measure_image(soft)
    change = core.sharpen_image(soft, known=known) - soft
    whole = core.sharpen_image(soft, known=known._replace(pixel_art=0.0)) - soft
    np.testing.assert_allclose(change, (1.0 - known.pixel_art) * whole, atol=1e-6)
    assert abs(change).max() > 0.0
