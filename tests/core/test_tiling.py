# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of tileable pictures: opposite sides meet, and all else stays."""

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage
from shock_filter import core
from shock_filter.core import cli
from shock_filter.core.repair.picture import repeated


def pictures():
    """A ramp with waves, noise, and stripes that end anywhere."""
    y, x = np.mgrid[:96, :128] / 96
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(96, 128))
    spectrum = np.fft.rfft2(noise)
    rate = np.hypot(np.fft.fftfreq(96)[:, None], np.fft.rfftfreq(128)[None])
    soft = np.fft.irfft2(spectrum / (0.02 + rate), (96, 128))
    soft = soft[8:-8, 8:-8]  # no longer periodic
    return {
        "ramp": 0.2 + 0.3 * x + 0.2 * y + 0.05 * np.sin(20 * x),
        "soft noise": 0.5 + 0.1 * (soft + 0.01 * np.mgrid[:80, :112][0]) / soft.std(),
        "stripes": 0.5 + 0.3 * np.sin(25 * x + 9 * y),
    }


def joints(image, axes):
    """Differences at each joint over those inside, of both orders, by 95th percentiles."""
    found = []
    for axis in {"x": (1,), "y": (0,), "both": (0, 1)}[axes]:
        lines = np.moveaxis(image, axis, 0)
        around = np.concatenate([lines[-2:], lines[:2]])
        for order in (1, 2):
            inside = np.quantile(np.abs(np.diff(lines, order, axis=0)), 0.95)
            joint = np.diff(around, order, axis=0)
            joint = joint[1] if order == 1 else joint
            found.append(np.quantile(np.abs(joint), 0.95) / inside)
    return found


@pytest.mark.parametrize("axes", ["both", "x", "y"])
def test_joints_are_no_steeper_than_what_is_inside(axes):
    image = pictures()["soft noise"]
    result = core.make_tileable(image, core.TileSettings(axes=axes))
    assert max(joints(result, axes)) < 1.0 < max(joints(image, axes))


@pytest.mark.parametrize("name", ["ramp", "stripes"])
def test_steps_vanish_from_smooth_pictures(name):
    image = pictures()[name]
    before, after = joints(image, "x")[0], joints(core.make_tileable(image), "x")[0]
    assert after < 1.0 and before > 5.0


def test_the_other_axis_keeps_its_sides():
    image = pictures()["ramp"]
    result = core.make_tileable(image, core.TileSettings(axes="x", radius=0.1))
    assert np.abs((result - image)[:, 40:-40]).max() < 0.05
    assert abs(result[0, 64] - result[-1, 64]) > 0.1


def test_colors_inside_stay_in_the_mean():
    for image in pictures().values():
        for radius in (0.05, 0.25, 1.0):
            result = core.make_tileable(image, core.TileSettings(radius=radius))
            h, w = image.shape
            middle = slice(h // 3, 2 * h // 3), slice(w // 3, 2 * w // 3)
            assert abs((result - image)[middle].mean()) < 2 / 255


def test_what_tiles_already_stays_nearly():
    y, x = np.mgrid[:64, :64] / 64 * 2 * np.pi
    image = 0.5 + 0.2 * np.sin(x) * np.cos(y)
    assert np.abs(core.make_tileable(image) - image).max() < 5e-3


def test_uneven_light_goes_and_detail_stays():
    y, x = np.mgrid[:128, :128] / 128
    detail = 0.05 * np.sin(2 * np.pi * 16 * x)
    image = 0.5 + 0.3 * (y - 0.5) ** 2 + 0.2 * x + detail
    result = core.make_tileable(image, core.TileSettings(even_light=1.0))
    rows = result.mean(axis=1)
    assert np.ptp(rows) < 0.4 * np.ptp(image.mean(axis=1))
    wave = np.sin(2 * np.pi * 16 * x)
    inner = slice(32, -32), slice(32, -32)
    assert (result * wave)[inner].mean() == pytest.approx(0.025, rel=0.05)


def test_types_masks_and_errors():
    image = np.random.default_rng(0).integers(0, 256, (40, 50, 4)).astype(np.uint8)
    mask = np.zeros((40, 50))
    mask[:, 10:] = 1.0
    result = core.make_tileable(image, mask=mask)
    assert result.dtype == np.uint8 and result.shape == image.shape
    assert (result[:, :10] == image[:, :10]).all()
    assert (result[:, -1] != image[:, -1]).any()
    one, other = core.TileSettings(axes="x"), core.TileSettings(axes="y")
    turned = core.make_tileable(image.transpose(1, 0, 2), other).transpose(1, 0, 2)
    assert (turned == core.make_tileable(image, one)).all()
    with pytest.raises(core.InvalidSignal, match="pixels"):
        core.make_tileable(np.zeros((3, 40)))


def test_slopes_at_joints_of_rough_pictures_lie_between_those_on_both_sides():
    rng = np.random.default_rng(1)
    image = 0.5 + 0.2 * ndimage.gaussian_filter(rng.normal(size=(96, 128)), 1.0)
    steps, slopes = np.reshape(joints(core.make_tileable(image), "both"), (2, 2)).T
    assert slopes.max() < 0.77
    assert steps.max() < 0.9


@pytest.mark.parametrize(("axes", "times"), [("both", (3, 3)), ("x", (1, 3)), ("y", (3, 1))])
def test_the_command_line_draws_how_a_picture_tiles(tmp_path, axes, times):
    image = np.random.default_rng(0).integers(0, 256, (24, 40, 3)).astype(np.uint8)
    source, target, picture = (tmp_path / name for name in ("in.png", "out.png", "tiled.png"))
    Image.fromarray(image).save(source)
    words = ["make-tileable", str(source), str(target), "--axes", axes]
    assert cli.main([*words, "--picture", str(picture)]) == 0
    result = np.asarray(Image.open(target))
    np.testing.assert_array_equal(np.asarray(Image.open(picture)), np.tile(result, (*times, 1)))
    assert cli.main([*words, "--overwrite", "--picture", str(picture.with_suffix(".txt"))]) != 0


def test_pictures_of_tiles_are_small_and_have_colors():
    gray = np.linspace(0.0, 1.0, 100 * 200).reshape(100, 200)
    assert repeated(gray, size=50).shape == (75, 150, 3)
    assert repeated(gray[..., None].repeat(2, axis=2), "x", size=500).shape == (100, 600, 3)


def test_steep_borders_beside_a_joint_turn_within_a_few_pixels():
    rng = np.random.default_rng(3)
    image = 0.5 + 0.1 * ndimage.gaussian_filter(rng.normal(size=(96, 128)), 3.0)
    image[:, :3] += 0.2 * np.linspace(1.0, 0.0, 3) * rng.choice([-1.0, 1.0], (24, 1)).repeat(4, 0)
    steps, slopes = joints(core.make_tileable(image, core.TileSettings(axes="x")), "x")
    assert steps < 1.0 and slopes < 1.0


@pytest.mark.parametrize("channels", [2, 4])
def test_opacity_of_floats_stays_opacity(channels):
    y, x = np.mgrid[:64, :64] / 63
    opacity = (0.5 + 0.8 * np.sin(3 * x + y)).clip(0.0, 1.0)
    image = np.stack([0.5 * x + 0.2 * y] * (channels - 1) + [opacity], axis=-1)
    assert core.make_tileable(opacity).max() > 1.01  # heights and the like may leave their range
    shown = core.make_tileable(image)[..., -1]
    assert 0.0 <= shown.min() <= shown.max() <= 1.0


def test_light_is_not_below_0_and_signed_values_are_free():
    image = 1e4 * np.random.default_rng(0).random((48, 64, 3)) ** 8
    assert core.make_tileable(image).min() == 0
    signed = core.make_tileable(image - 1e4)
    assert signed.min() < -1e4


def test_half_floats_stay_finite(tmp_path):
    values = 6e4 * np.random.default_rng(0).random((32, 32, 3))
    np.save(tmp_path / "a.npy", values.astype(np.float16))
    assert cli.main(["make-tileable", str(tmp_path / "a.npy"), str(tmp_path / "b.npy")]) == 0
    result = np.load(tmp_path / "b.npy")
    assert result.dtype == np.float16
    assert result.max() == np.finfo(np.float16).max
