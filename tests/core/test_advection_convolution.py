# SPDX-License-Identifier: GPL-3.0-or-later
"""Line integral convolution in the plane."""

from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest
from flows import angle_to_flow, correlation, rotation, saddle, uniform
from shock_filter import core
from shock_filter.core.base import parallel

SIZE = (160, 192)
PLAIN = core.ConvolutionSettings(length=40.0, contrast=0.0)


@pytest.mark.parametrize("field", [rotation, saddle])
def test_streaks_lie_along_the_flow(field):
    velocity = field(SIZE)
    image = core.line_integral_convolution(velocity)
    assert image.shape == SIZE and image.dtype == np.float32
    assert 0 <= image.min() and image.max() <= 1  # noqa: SIM300
    away = np.hypot(*np.moveaxis(velocity, -1, 0)) > 20
    assert angle_to_flow(image, velocity, away) < 5.0


def test_uniform_flow_averages_neighbors():
    noise = np.random.default_rng(0).random(SIZE)
    image = core.line_integral_convolution(uniform(SIZE, 0.01, 0.0), noise=noise, settings=PLAIN)
    expected = np.mean([np.roll(noise, k, axis=1) for k in range(-20, 21)], axis=0)
    np.testing.assert_allclose(image[:, 21:-21], expected[:, 21:-21], atol=1e-5)
    np.testing.assert_allclose(image[:, 0], noise[:, :21].mean(axis=1), atol=1e-5)


def test_sides_that_are_joined_go_on():
    noise = np.random.default_rng(0).random(SIZE)
    settings = core.ConvolutionSettings(length=300.0, contrast=0.0, periodic="y")
    image = core.line_integral_convolution(uniform(SIZE, 0.0, 1.0), noise=noise, settings=settings)
    around = np.mean([np.roll(noise, k, axis=0) for k in range(-150, 151)], axis=0)
    np.testing.assert_allclose(image, around, atol=1e-5)
    drawn = core.line_integral_convolution(
        uniform(SIZE, 1.0, 0.0), settings=core.ConvolutionSettings(periodic="x")
    )
    assert correlation(drawn[:, 0], drawn[:, -1]) > 0.9


def test_a_circle_is_followed_in_second_order():
    """What is bright on a ring stays on it, all the way round."""
    y, x = np.mgrid[:SIZE[0], :SIZE[1]]  # fmt: skip
    radius = np.hypot(x - (SIZE[1] - 1) / 2, y - (SIZE[0] - 1) / 2)
    rings = 0.5 + 0.5 * np.cos(radius / 2)
    settings = core.ConvolutionSettings(length=300.0, contrast=0.0)
    image = core.line_integral_convolution(rotation(SIZE), noise=rings, settings=settings)
    inside = (radius > 20) & (radius < 70)
    assert correlation(image[inside], rings[inside]) > 0.99
    assert image[inside].std() > 0.8 * rings[inside].std()


def test_length_0_returns_the_noise():
    noise = np.random.default_rng(0).random(SIZE).astype(np.float32)
    settings = core.ConvolutionSettings(length=0.0)
    image = core.line_integral_convolution(rotation(SIZE), noise=noise, settings=settings)
    np.testing.assert_allclose(image, noise, atol=1e-6)


def test_contrast_fills_the_range():
    flat = core.line_integral_convolution(rotation(SIZE), settings=PLAIN)
    full = core.line_integral_convolution(rotation(SIZE))
    assert flat.std() < 0.12
    assert abs(full.std() - 0.18) < 0.01
    assert abs(full.mean() - 0.5) < 0.02


def test_averages_end_where_the_flow_is_undefined():
    noise = np.zeros(SIZE)
    noise[:, 90:100] = 1.0
    velocity = uniform(SIZE, 1.0, 0.0)
    velocity[:, 90:100] = np.nan
    image = core.line_integral_convolution(velocity, noise=noise, settings=PLAIN)
    assert (image == 0).all()
    noise[:] = 0.5
    mask = np.isfinite(velocity[..., 0])
    image = core.line_integral_convolution(
        uniform(SIZE, 1, 0), noise=noise, settings=PLAIN, mask=mask
    )
    np.testing.assert_allclose(image[mask], 0.5, atol=1e-6)
    assert (image[~mask] == 0).all()


def test_pictures_may_be_larger_than_the_field():
    image = core.line_integral_convolution(rotation((8, 10)), size=SIZE)
    y, x = np.mgrid[:SIZE[0], :SIZE[1]]  # fmt: skip
    away = np.hypot(x - 95.5, y - 79.5) > 30
    assert angle_to_flow(image, rotation(SIZE), away) < 5.0


@pytest.mark.parametrize("value", [0.0, np.nan, 1e-40])
def test_fields_without_a_direction_give_sound_pictures(value):
    image = core.line_integral_convolution(np.full((9, 1, 2), value))
    assert np.isfinite(image).all()


def test_one_seed_gives_one_picture_on_any_number_of_threads(monkeypatch):
    found = []
    for threads in (1, 3):
        pool = ThreadPoolExecutor(max(threads - 1, 1))
        monkeypatch.setattr(parallel, "thread_count", lambda threads=threads: threads)
        monkeypatch.setattr(parallel, "_pool", cache(lambda pool=pool: pool))
        found.append(core.line_integral_convolution(rotation(SIZE)))
    np.testing.assert_array_equal(*found)
    other = core.line_integral_convolution(
        rotation(SIZE), settings=core.ConvolutionSettings(seed=1)
    )
    assert abs(correlation(found[0], other)) < 0.1


def test_canceling():
    with pytest.raises(core.Cancelled):
        core.line_integral_convolution(rotation(SIZE), progress=lambda *_: False)


@pytest.mark.parametrize("noise, message", [
    (np.ones((3, 3, 1)), "shape"),
    (np.full((3, 3), np.nan), "NaN"),
    (np.ones((3, 3), dtype=np.uint8), "floats"),
])  # fmt: skip
def test_bad_noise_is_named(noise, message):
    with pytest.raises(core.InvalidSignal, match=message):
        core.line_integral_convolution(np.ones((3, 3, 2)), noise=noise)


def test_unsteady_fields_are_refused():
    with pytest.raises(core.InvalidSignal, match="changes with time"):
        core.line_integral_convolution(np.ones((2, 3, 3, 2)))
