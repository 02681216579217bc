# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of removing the blocks of JPEG compression, with pictures made by code."""

import io

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage
from shock_filter import core
from shock_filter.core.repair.blocks import compression_of


def picture(seed=0, size=(160, 192)):
    """Edges, soft noise and slow colors."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: size[0], : size[1]] / size[0]
    rate = np.hypot(np.fft.fftfreq(size[0])[:, None], np.fft.rfftfreq(size[1])[None])
    values = []
    for channel in range(3):
        soft = np.fft.irfft2(np.fft.rfft2(rng.normal(size=size)) / (0.01 + rate) ** 1.2, size)
        edge = np.tanh(40 * (np.sin(5 * x + channel) * np.cos(4 * y) - 0.2))
        values.append(125 + 30 * soft / soft.std() + 45 * edge + 20 * x)
    return np.clip(np.rint(np.stack(values, axis=-1)), 0, 255).astype(np.uint8)


def compressed(image, quality):
    file = io.BytesIO()
    Image.fromarray(image).save(file, "JPEG", quality=quality)
    return np.asarray(Image.open(file))


def decibels(one, other):
    return -10 * np.log10(np.mean((one.astype(float) - other) ** 2))


@pytest.mark.parametrize("quality", [30, 50, 80])
def test_compressed_pictures_come_nearer_to_what_they_were(quality):
    image = picture()
    broken = compressed(image, quality)
    found = compression_of(broken)
    assert found.offset == (0, 0) and found.times == 1
    assert found.quality == pytest.approx(quality, abs=2)
    result = core.remove_blocks(broken)
    assert decibels(result, image) > decibels(broken, image) + 0.1


def test_pictures_without_blocks_stay_bit_for_bit():
    for seed in range(3):
        image = picture(seed)
        flat = np.full((64, 64), 90, np.uint8)
        for each in (image, image[..., 0], image / np.float32(255), flat):
            assert compression_of(each.reshape(*each.shape[:2], -1)) is None
            assert (core.remove_blocks(each) == each).all()


@pytest.mark.parametrize("seed", [0, 2, 5])
def test_soft_pictures_fit_all_grids_alike_and_have_no_blocks(seed):
    soft = ndimage.gaussian_filter(picture(seed).astype(float), (1.5, 1.5, 0))
    assert compression_of(np.rint(soft).astype(np.uint8)) is None
    blurred = np.rint(ndimage.gaussian_filter(picture(seed).astype(float), (1, 1, 0)))
    assert compression_of(compressed(blurred.astype(np.uint8), 50)) is not None


@pytest.mark.parametrize("seed", range(40))
def test_sheets_of_a_sprite_have_no_blocks(seed):
    sprite = np.zeros((32, 24, 1), np.uint8)
    body = np.random.default_rng(seed).integers(0, 256, (10, 7, 1))
    sprite[6:26, 5:19] = body.repeat(2, 0).repeat(2, 1)
    assert compression_of(np.tile(sprite, (6, 8, 1))) is None


def test_cut_and_repeated_pictures_are_recognized():
    broken = compressed(picture(), 40)
    assert compression_of(broken[3:, 5:]).offset == (5, 3)
    large = broken.repeat(2, 0).repeat(2, 1)
    assert compression_of(large).times == 2
    result = core.remove_blocks(large)
    assert (result[::2, ::2] == core.remove_blocks(broken)).all()


def test_strength_masks_opacity_and_types():
    broken = compressed(picture(), 40)
    none = core.BlockSettings(strength=0.0)
    assert (core.remove_blocks(broken, none) == broken).all()
    mask = np.zeros(broken.shape[:2])
    mask[80:] = 1.0
    result = core.remove_blocks(broken, mask=mask)
    assert (result[:80] == broken[:80]).all() and (result[80:] != broken[80:]).any()
    alpha = np.random.default_rng(0).integers(0, 256, broken.shape[:2]).astype(np.uint8)
    both = core.remove_blocks(np.dstack([broken, alpha]))
    assert (both[..., 3] == alpha).all()
    assert (both[..., :3] == core.remove_blocks(broken)).all()
    floats = core.remove_blocks(broken / np.float32(255))
    assert np.abs(floats * 255 - core.remove_blocks(broken)).max() < 0.6
