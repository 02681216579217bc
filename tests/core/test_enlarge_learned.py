# SPDX-License-Identifier: GPL-3.0-or-later
"""Networks enlarge images: their promises, and that they come nearer to what was there."""

import dask.array
import numpy as np
import pytest
from PIL import Image
from scipy import ndimage
from shock_filter import core
from shock_filter.core.color.learned import enlarging
from shock_filter.core.color.learned.enlarged_images import STEPS, is_enlarged_as_learned
from shock_filter.core.color.learned.planes import NONE, Planes

SIZE = 96


def soft(*shape, seed=0, sigma=0.8):
    values = np.random.default_rng(seed).random(shape)
    return ndimage.gaussian_filter(values, (sigma, sigma, 0)[: len(shape)]).astype(np.float32)


def enlarged(image, times=2, mask=None, **settings):
    return core.sharpen_image(image, core.ImageSettings(enlarge=times, **settings), mask=mask)


def stars(seed):
    """Stars of random colors on a slope, antialiased, as bytes."""
    random = np.random.default_rng(seed)
    n = 6 * SIZE
    y, x = np.mgrid[:n, :n] / n
    image = np.stack([0.3 + 0.3 * x, 0.5 - 0.2 * y, 0.4 + 0 * x], 2)
    for _ in range(14):
        row, column, size, turn = random.random(4)
        angle = np.arctan2(y - row, x - column) + 6 * turn
        away = np.hypot(y - row, x - column)
        image[away < (0.05 + 0.15 * size) * (1 + 0.5 * np.cos(5 * angle))] = random.random(3)
    return np.rint(255 * image.reshape(SIZE, 6, SIZE, 6, 3).mean((1, 3))).astype(np.uint8)


def fidelity(image, wanted):
    return -10 * np.log10((((image.astype(float) - wanted) / 255) ** 2).mean())


@pytest.mark.parametrize("way", ["BICUBIC", "LANCZOS", "BOX"])
@pytest.mark.parametrize(("times", "least"), [(2, 3.0), (3, 2.0), (4, 1.5)])
def test_drawings_come_nearer_than_by_a_spline_however_they_were_reduced(way, times, least):
    for seed in (1, 2):
        wanted = stars(seed)
        small = Image.fromarray(wanted).resize((SIZE // times,) * 2, Image.Resampling[way])
        plain = np.asarray(small.resize((SIZE, SIZE), Image.Resampling.BICUBIC))
        gain = fidelity(enlarged(np.asarray(small), times), wanted) - fidelity(plain, wanted)
        assert gain > least


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32", "float64"])
@pytest.mark.parametrize("times", [2, 3, 4, 6, 8])
def test_no_value_leaves_the_range_nearby(dtype, times):
    values = np.random.default_rng(times).random((14, 11, 3))
    image = values.astype(dtype)
    if image.dtype.kind == "u":
        image = (values * np.iinfo(dtype).max).astype(dtype)
    window = (4 * len(STEPS[times]) + 1, 4 * len(STEPS[times]) + 1, 1)
    high = ndimage.maximum_filter(image, window).repeat(times, 0).repeat(times, 1)
    low = ndimage.minimum_filter(image, window).repeat(times, 0).repeat(times, 1)
    result = enlarged(image, times)
    slack = 1e-7 if dtype == "float64" else 0
    assert (result <= high + slack).all()
    assert (result >= low - slack).all()


@pytest.mark.parametrize("turn", [np.transpose, lambda a: a[::-1], lambda a: a[:, ::-1], np.rot90])
@pytest.mark.parametrize("times", [2, 3, 4])
def test_turning_and_mirroring_the_image_does_so_to_the_result(turn, times):
    image = soft(21, 34)
    turned = enlarged(np.ascontiguousarray(turn(image)), times)
    np.testing.assert_allclose(turned, turn(enlarged(image, times)), atol=2e-6)


@pytest.mark.parametrize("times", [2, 3])
def test_scaled_and_shifted_values_have_results_that_are_so(times):
    image = soft(20, 24, 3)
    result = enlarged(3.0 * image + 0.5, times)
    np.testing.assert_allclose(result, 3.0 * enlarged(image, times) + 0.5, atol=1e-5)


def test_even_parts_stay_bit_for_bit():
    image = np.full((24, 40), 0.3)  # of more bits than networks compute with
    image[:, 20:] = soft(24, 20)
    result = enlarged(image, 3)
    assert (result[:, : 3 * 17] == 0.3).all()


def test_hidden_colors_do_not_matter_and_opacity_is_enlarged_as_gray():
    image = soft(20, 22, 4)
    image[..., 3] = np.clip(8.0 * soft(20, 22, seed=3) - 3.5, 0.0, 1.0)
    other = image.copy()
    other[image[..., 3] == 0, :3] = 7.0
    result = enlarged(image, 2)
    seen = result[..., 3] > 0
    np.testing.assert_array_equal(enlarged(other, 2)[seen], result[seen])
    np.testing.assert_array_equal(result[..., 3], enlarged(image[..., 3].copy(), 2))
    opaque = image.copy()
    opaque[..., 3] = 1.0
    np.testing.assert_allclose(enlarged(opaque)[..., :3], enlarged(image[..., :3]), atol=1e-6)


@pytest.mark.parametrize("times", [2, 3, 6])
def test_chunks_have_the_bits_of_the_whole(times):
    image = soft(150, 170, 3, seed=5)
    mask = np.random.default_rng(2).random(image.shape[:2])
    chunks = dask.array.from_array(image, chunks=(70, 60, 3))
    result = enlarged(chunks, times, mask=mask).compute()
    np.testing.assert_array_equal(result, enlarged(image, times, mask=mask))


def test_amounts_lie_between_the_cubic_and_the_networks():
    image = soft(20, 22, 3)
    both = [enlarged(image, amount=amount) for amount in (0.0, 1.0)]
    assert not np.array_equal(*both)
    np.testing.assert_allclose(enlarged(image, amount=0.5), sum(both) / 2, atol=1e-6)


def test_what_is_given_is_done_by_width():
    for times in range(2, 9):
        settings = core.ImageSettings(enlarge=times)
        assert is_enlarged_as_learned(settings, False) == (times not in (5, 7))
        assert not is_enlarged_as_learned(settings, True)
        for given in ({"what": "drawing"}, {"width": 2.0}, {"time": 16.0}):
            assert not is_enlarged_as_learned(settings.changed(**given), False)
    assert not is_enlarged_as_learned(core.ImageSettings(), False)


def test_without_what_networks_add_there_is_the_cubic():
    image = soft(16, 17)
    net = enlarging.networks()[3][0]
    still = enlarging.Network(tuple(0 * w for w in net.weights), tuple(0 * s for s in net.shifts))
    result = enlarging.enlarged_planes(Planes(image[None], NONE), 3, enlarging.views_of(still))
    np.testing.assert_allclose(result[0], enlarged(image, 3, amount=0.0), atol=0.02)
    assert np.isclose(result[0], enlarged(image, 3, amount=0.0), atol=1e-6).mean() > 0.8


def test_networks_are_those_of_these_numbers():
    for times, views in enlarging.networks().items():
        assert len(views) == enlarging.VIEWS
        assert views[0].weights[0].shape[0] == enlarging.TOLD
        assert len(views[0].shifts[-1]) == times**2
        assert views[0].version >= 1
        assert len(views[0].made_of) == 16
