# SPDX-License-Identifier: GPL-3.0-or-later
"""Images are sharpened by the width of their borders, whatever their contrast."""

import math

import numpy as np
import pytest
from scipy import ndimage
from scipy.special import erf
from shock_filter import core
from shock_filter.core.base.findings import gathering
from shock_filter.core.color.by_width.dials import counted_width, plan_of, tell_widths
from shock_filter.core.color.by_width.measuring import measured
from shock_filter.core.grid import borders
from shock_filter.core.grid.channels import channel_groups
from shock_filter.core.grid.windows import gaussian, least_and_greatest, smooth
from shock_filter.core.settings import WIDTH_OF_SIGMA


def edge(sigma, contrast=1.0, degrees=0.0, size=96):
    """A straight border, and how far each pixel is from it."""
    y, x = np.mgrid[:size, :size] - (size - 1) / 2 + 0.2
    away = x * math.cos(math.radians(degrees)) + y * math.sin(math.radians(degrees))
    values = 0.5 + contrast * 0.5 * erf(away / (sigma * math.sqrt(2)))
    return values.astype(np.float32), away


def width_of(image, away):
    """From 10 to 90 percent of the border's mean profile."""
    rows = slice(len(image) // 4, -len(image) // 4)
    values, places = image[rows].ravel(), away[rows].ravel()
    order = np.argsort(places)
    values, places = values[order], places[order]
    profile = ndimage.uniform_filter1d(values, 25, mode="nearest")
    low, high = profile[:200].mean(), profile[-200:].mean()
    shares = np.maximum.accumulate((profile - low) / (high - low))
    return np.interp(0.9, shares, places) - np.interp(0.1, shares, places)


def drawing(seed, size=192, contrast=1.0):
    """Flat shapes, with smooth borders as wide as a pixel."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[:size, :size]
    image = np.full((size, size, 3), 0.5)
    for _ in range(12):
        row, column = random.uniform(0, size, 2)
        radius = random.uniform(15, 45)
        away = np.hypot(y - row, x - column)
        if random.random() < 0.5:
            away = np.maximum(abs(y - row), abs(x - column))
        inside = np.clip(radius - away + 0.5, 0, 1)[..., None]
        image += inside * (random.uniform(0, 1, 3) - image)
    return (0.5 + contrast * (image - 0.5)).astype(np.float32)


def texture(seed, size=192):
    """Noise with detail at all scales, as photos have."""
    random = np.random.default_rng(seed)
    rows, columns = np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None]
    away = np.hypot(rows, columns)
    away[0, 0] = 1.0
    waves = np.fft.rfft2(random.normal(size=(size, size))) / away**1.2
    values = np.fft.irfft2(waves, s=(size, size))
    values = np.tanh(values / values.std())
    return np.repeat((0.5 + 0.45 * values).astype(np.float32)[..., None], 3, axis=2)


def blurred(image, sigma):
    return ndimage.gaussian_filter(image, (sigma, sigma, 0)[: image.ndim])


def fidelity(image, wanted):
    """PSNR in decibels."""
    return -10 * math.log10(((image - wanted) ** 2).mean())


def by_width(image, mask=None, **settings):
    return core.sharpen_image(image, core.ImageSettings(**settings), mask=mask)


def found_in(image, **settings):
    settings = core.ImageSettings(**settings)
    pixels = image.reshape(*image.shape[:2], -1)
    return measured(pixels, channel_groups(pixels.shape[2], settings)[0], settings)


@pytest.mark.parametrize("contrast", [1.0, 0.5, 0.2, 0.05])
def test_borders_close_up_to_the_width_whatever_their_contrast(contrast):
    for times, least, most in ((1.0, 0.0, 0.3), (0.5, 0.0, 0.6), (3.0, 0.85, 1.01)):
        image, away = edge(6.0 * times / WIDTH_OF_SIGMA, contrast, 20.0)
        out = by_width(image, what="drawing", width=6.0)
        ratio = width_of(out, away) / width_of(image, away)
        assert least <= ratio <= most, (times, ratio)


@pytest.mark.parametrize("sigma", [1.5, 2.0, 3.0, 5.0])
@pytest.mark.parametrize("degrees", [0.0, 20.0, 45.0])
def test_the_width_of_a_blurred_edge_is_measured(sigma, degrees):
    for contrast in (1.0, 0.2):
        width = found_in(edge(sigma, contrast, degrees)[0]).width
        assert width == pytest.approx(WIDTH_OF_SIGMA * sigma, rel=0.1)


@pytest.mark.parametrize("sigma", [1.5, 3.0])
@pytest.mark.parametrize("contrast", [1.0, 0.2])
def test_blurred_drawings_come_back(sigma, contrast):
    wanted = drawing(1, contrast=contrast)
    image = blurred(wanted, sigma)
    out = by_width(image)
    assert found_in(image)[0] == "drawing"
    assert fidelity(out, wanted) > fidelity(image, wanted) + 4.5


def test_blurred_detail_gains_and_makes_no_halo():
    wanted = texture(2)
    image = blurred(wanted, 2.0)
    out = by_width(image)
    assert found_in(image)[0] == "photo"
    assert fidelity(out, wanted) > fidelity(image, wanted) + 0.3
    low = ndimage.minimum_filter(image, (15, 15, 1))
    high = ndimage.maximum_filter(image, (15, 15, 1))
    assert (out >= low - 1e-5).all() and (out <= high + 1e-5).all()


def test_the_contrast_of_the_whole_does_not_matter():
    image = blurred(drawing(3), 2.0)
    out = by_width(image, what="drawing")
    for share in (0.5, 0.2):
        faint = by_width(0.5 + share * (image - 0.5), what="drawing")
        assert fidelity(0.5 + (faint - 0.5) / share, out) > 40


def test_sharp_images_stay_bit_for_bit():
    image = drawing(4)
    assert found_in(image)[1] == 0
    np.testing.assert_array_equal(by_width(image, what="drawing"), image)
    even = np.full((40, 50, 3), 0.3, np.float32)
    np.testing.assert_array_equal(by_width(even), even)
    np.testing.assert_array_equal(by_width(even, width=5.0), even)


def test_amount_mixes():
    image = blurred(drawing(5), 2.0)
    full = by_width(image)
    np.testing.assert_array_equal(by_width(image, amount=0.0), image)
    np.testing.assert_array_equal(by_width(image, amount=1.0, mask=np.ones(image.shape[:2])), full)
    for mask in (None, np.full(image.shape[:2], 0.5)):
        half = by_width(image, mask=mask, amount=0.5)
        share = 0.5 if mask is None else 0.25
        np.testing.assert_allclose(half, image + share * (full - image), atol=1e-6)
    with_time = by_width(image, time=64.0)
    half = by_width(image, time=64.0, amount=0.5)
    np.testing.assert_allclose(half, (image + with_time) / 2, atol=1e-6)


def test_a_mask_of_zero_keeps_bits():
    image = blurred(drawing(6), 2.0)
    mask = np.zeros(image.shape[:2])
    mask[40:80] = 1.0
    out = by_width(image, mask)
    np.testing.assert_array_equal(out[mask == 0], image[mask == 0])
    assert (out != image).any()


def test_a_time_overrides_what_and_width():
    image = blurred(drawing(7), 2.0)
    for time in (0.0, 16.0, math.inf):
        plain = by_width(image, time=time)
        other = by_width(image, time=time, what="photo", width=9.0)
        np.testing.assert_array_equal(other, plain)
    assert (by_width(image) != by_width(image, time=16.0)).any()


@pytest.mark.parametrize("what", ["drawing", "photo"])
def test_types_agree(what):
    image = blurred(drawing(8, size=96), 2.0)
    wanted = by_width(image, what=what, width=5.0)
    bytes_ = by_width(np.rint(255 * image).astype(np.uint8), what=what, width=5.0)
    assert fidelity(bytes_ / 255.0, wanted) > 40
    words = by_width(np.rint(65535 * image).astype(np.uint16), what=what, width=5.0)
    assert fidelity(words / 65535.0, wanted) > 50
    double = by_width(image.astype(np.float64), what=what, width=5.0)
    assert double.dtype == np.float64
    assert fidelity(double, wanted) > 60


@pytest.mark.parametrize("what", ["drawing", "photo"])
def test_transparent_pixels_lend_no_color(what):
    color = blurred(drawing(9, size=96), 2.0)
    opacity = np.zeros((96, 96, 1), np.float32)
    opacity[:, 30:] = 1.0
    image = np.concatenate([color, opacity], axis=2)
    other = image.copy()
    other[:, :30, :3] = 7.0
    first, second = (by_width(each, what=what, width=5.0) for each in (image, other))
    np.testing.assert_allclose(first[..., 3:], opacity, atol=5e-4)  # crisp before
    np.testing.assert_allclose(first[:, 30:], second[:, 30:], atol=1e-5)
    assert np.isfinite(second).all()


@pytest.mark.parametrize("channels", ["independent", "luminance"])
def test_channels_may_be_guided_otherwise(channels):
    wanted = drawing(10)
    image = blurred(wanted, 2.0)
    out = by_width(image, what="drawing", channels=channels)
    assert fidelity(out, wanted) > fidelity(image, wanted) + 2


@pytest.mark.parametrize("shape", [(1, 30), (30, 1), (2, 2), (1, 1), (5, 40, 2)])
def test_small_images_are_done(shape):
    image = np.random.default_rng(11).random(shape).astype(np.float32)
    for settings in ({}, {"width": 5.0, "what": "drawing"}, {"width": 64.0, "what": "photo"}):
        out = by_width(image, **settings)
        assert np.isfinite(out).all()
        assert image.min() - 1e-6 <= out.min() and out.max() <= image.max() + 1e-6


def test_bright_floats_are_done():
    image = 1000.0 * blurred(drawing(12, size=96), 2.0)
    out = by_width(image, what="drawing")
    faint = by_width(image / 1000.0, what="drawing")
    assert fidelity(out / 1000.0, faint) > 40


def test_turned_images_give_turned_results():
    image = blurred(drawing(13, size=96), 2.0)
    out = by_width(image, what="photo", width=5.0)
    turned = by_width(np.ascontiguousarray(image[:, ::-1]), what="photo", width=5.0)
    np.testing.assert_allclose(turned[:, ::-1], out, atol=1e-4)


def test_large_images_are_measured_in_places():
    image = np.tile(drawing(14), (12, 12, 1))
    image = blurred(image, 2.0)
    found = found_in(image)
    part = found_in(np.ascontiguousarray(image[:192, :192]))
    assert found.what == part.what == "drawing"
    assert found.width == pytest.approx(part.width, rel=0.05)


@pytest.mark.parametrize("noise", [0.01, 0.03])
def test_noise_is_measured_and_not_sharpened(noise):
    image = blurred(drawing(15), 2.0)
    noisy = image + np.random.default_rng(16).normal(0, noise, image.shape).astype(np.float32)
    found = found_in(noisy)
    assert found.borders.noise == pytest.approx(noise, rel=0.15)
    assert found.width == pytest.approx(2 * WIDTH_OF_SIGMA, rel=0.25)
    even = np.full((96, 96, 3), 0.5, np.float32)
    even += np.random.default_rng(17).normal(0, noise, even.shape).astype(np.float32)
    assert by_width(even, what="photo", width=5.0).std() < 1.05 * noise


@pytest.mark.parametrize("contrast", [1.0, 0.2])
def test_noisy_drawings_come_closer_to_clean_ones(contrast):
    wanted = drawing(20, contrast=contrast)
    image = blurred(wanted, 2.0)
    image += np.random.default_rng(21).normal(0, 0.01, image.shape).astype(np.float32)
    out = by_width(image, what="drawing")
    assert fidelity(out, wanted) > fidelity(image, wanted) + 1.5


def test_widths_that_count():
    assert counted_width(3.0, 9.0, "photo") == 3.0
    assert counted_width(0.0, 9.0, "drawing") == 9.0
    assert counted_width(0.0, 1.5, "drawing") == 0.0
    assert counted_width(0.0, 40.0, "drawing") == 16.0
    assert counted_width(0.0, 40.0, "photo") == 8.0


@pytest.mark.parametrize("shape", [(50, 70), (3, 40), (40, 3), (1, 1)])
@pytest.mark.parametrize("reach", [0, 1, 7, 77])
def test_windows_have_their_least_and_greatest_values(shape, reach):
    plane = np.random.default_rng(18).random(shape).astype(np.float32)
    low, high = plane.copy(), plane.copy()
    least_and_greatest(low, high, reach)
    np.testing.assert_array_equal(low, ndimage.minimum_filter(plane, 2 * reach + 1))
    np.testing.assert_array_equal(high, ndimage.maximum_filter(plane, 2 * reach + 1))


@pytest.mark.parametrize("sigma", [1.0, 4.0, 25.0])
def test_smoothing_is_a_gaussian_with_mirrored_borders(sigma):
    plane = np.random.default_rng(19).random((30, 45)).astype(np.float32)
    expected = ndimage.gaussian_filter(plane, sigma, truncate=3.5)
    np.testing.assert_allclose(smooth(plane, gaussian(sigma)), expected, atol=1e-3)


@pytest.mark.parametrize(
    ("result", "sentence"),
    [
        (1.5, "Borders 9.2 pixels wide, closed to 1.5."),
        (29.3, "Borders up to 9.2 pixels wide were closed."),
        (0.0, "Borders up to 9.2 pixels wide were closed."),
        (None, "Already sharp: borders 9.2 pixels wide."),
    ],
)
def test_widths_are_told_so_that_they_make_sense(result, sentence):
    with gathering() as found:
        tell_widths("pixels", 9.2, 100, result)
    assert list(map(str, found)) == [sentence]


def test_beside_opacity_straight_colors_are_sharpened_as_premultiplied_ones_are_smoothed():
    # Photos with borders of 2 pixels are not moved, but half of the unsharp part is added.
    random = np.random.default_rng(20)
    colors = np.kron(random.random((6, 8, 3)), np.ones((8, 8, 1)))
    alpha = np.clip(np.linspace(1.6, -0.6, 64), 0, 1)[None, :, None] * np.ones((48, 1, 1))
    image = np.concatenate([colors, alpha], axis=2)
    found = by_width(image, what="photo", width=2.0)
    plan = plan_of("photo", 2.0)
    assert plan.square == 0
    weights = gaussian(plan.blur)
    row = np.concatenate([weights[:0:-1], weights]).astype(np.float64)

    def blurred_by_row(plane):
        for axis in (0, 1):
            plane = ndimage.convolve1d(plane, row, axis=axis, mode="reflect")
        return plane

    visible = alpha[..., 0] > 0
    spread = blurred_by_row(alpha[..., 0])
    for c in range(3):
        smoothed = blurred_by_row(colors[..., c] * alpha[..., 0]) / np.maximum(spread, 1e-30)
        low = ndimage.minimum_filter(np.where(visible, colors[..., c], np.inf), 3)
        high = ndimage.maximum_filter(np.where(visible, colors[..., c], -np.inf), 3)
        added = plan.unsharp * (colors[..., c] - smoothed)
        sharp = np.clip(colors[..., c] + added, low, high)
        wanted = colors[..., c] + (1.0 - plan.share) * (sharp - colors[..., c])
        np.testing.assert_allclose(found[visible, c], wanted[visible], atol=1e-5)
    np.testing.assert_allclose(found[~visible], image[~visible], atol=1e-7)
    assert np.abs(found - image)[visible].max() > 0.01


@pytest.mark.parametrize("sigma", [0.8, 1.0, 1.2])
def test_narrow_borders_are_measured_as_wide_as_they_are(sigma):
    image = np.concatenate([edge(sigma, degrees=degrees)[0] for degrees in (0, 20, 45, 70)], axis=1)
    found = found_in(image[..., None]).borders.width
    assert found == pytest.approx(WIDTH_OF_SIGMA * sigma, rel=0.05)


def test_profiles_that_lead_to_what_is_not_seen_do_not_count():
    plane = np.tile(erf(np.arange(-20, 20) / 4.0), (9, 1)).astype(np.float32)[None]
    ridge = np.array([[4.0, 20.0, 0.0, 1.0, 0.28]], dtype=np.float32)
    seen = np.ones(plane.shape[1:], dtype=np.bool_)
    assert borders._profiles(plane, seen, ridge, 1.0)[0, 1] > 1.5
    seen[:, 24:] = False
    assert borders._profiles(plane, seen, ridge, 1.0)[0, 1] == 0
