# SPDX-License-Identifier: GPL-3.0-or-later
"""Images are sharpened by default as networks have learned, and what that promises."""

import math

import dask.array
import numpy as np
import pytest
from scipy import ndimage
from shock_filter import core
from shock_filter.core.base.findings import gathering
from shock_filter.core.color.chunked import counting_reruns
from shock_filter.core.color.image_sharpening import measure_image
from shock_filter.core.color.learned.planes import Planes
from shock_filter.core.color.learned.recipe import DEFINITION, STAGES, WEIGHTS
from shock_filter.core.color.learned.report import tell_learned
from shock_filter.core.color.learned.rows import half_log
from shock_filter.core.grid.borders import Borders
from shock_filter.core.grid.channels import Channels
from shock_filter.core.grid.part import Part
from shock_filter.core.grid.windows import gaussian, smooth, smooth_rows
from shock_filter.core.mixture.network import load
from test_images_by_width import blurred, drawing, fidelity, texture

NONE = np.empty(0, np.float32)


def as_bytes(image):
    return np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8)


def scene(seed, size=192):
    """A drawing beside a texture, blurred a little, with light noise."""
    image = np.concatenate([drawing(seed, size), texture(seed + 50, size)], axis=1)
    noise = np.random.default_rng(seed).normal(0, 0.004, image.shape)
    return (blurred(image, 1.5) + noise).astype(np.float32)


def rms(a):
    return math.sqrt(np.square(a, dtype=np.float64).mean())


@pytest.mark.parametrize(("wanted", "sigma", "least"), [
    (drawing(1), 1.0, 4.0), (drawing(2), 2.0, 4.0), (texture(3), 1.0, 0.25), (texture(4), 2.0, 0.5),
    (drawing(5, contrast=0.2), 1.5, 3.0),
], ids=["drawing", "soft drawing", "texture", "soft texture", "faint drawing"])  # fmt: skip
def test_blurred_images_come_nearer_to_what_they_were(wanted, sigma, least):
    given = as_bytes(blurred(wanted, sigma))
    found = core.sharpen_image(given)
    assert fidelity(found / 255, wanted) > fidelity(given / 255, wanted) + least


def test_noise_is_taken_away_and_not_sharpened():
    wanted = drawing(6)
    noise = np.random.default_rng(7).normal(0, 0.03, wanted.shape)
    given = as_bytes(blurred(wanted, 1.0) + noise)
    found = core.sharpen_image(given)
    assert fidelity(found / 255, wanted) > fidelity(given / 255, wanted) + 2.5


def test_sharp_drawings_hardly_change():
    image = as_bytes(drawing(4))
    assert fidelity(core.sharpen_image(image) / 255, image / 255) > 40


@pytest.mark.parametrize("length", [4, 6, 10, 24])
def test_waves_without_borders_hardly_change(length):
    y, x = 2 * np.pi / length * np.mgrid[:160, :160]
    slanted = 0.5 + 0.4 * np.sin(0.96 * x + 0.28 * y)
    egg_box = 0.5 + 0.2 * np.sin(x) + 0.2 * np.sin(y)
    for waves in (slanted, egg_box):
        given = as_bytes(waves)
        assert rms(core.sharpen_image(given) / 255 - given / 255) < 0.015


@pytest.mark.parametrize("settings", [{}, {"width": 9.0}, {"sampling": "nearest"}], ids=str)
@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_values_stay_within_those_nearby(kind, settings):
    image = scene(8)
    image = as_bytes(image) if kind is np.uint8 else image
    out = core.sharpen_image(image, core.ImageSettings(**settings))
    assert (out != image).mean() > 0.2
    assert (out >= ndimage.minimum_filter(image, (15, 15, 1))).all()
    assert (out <= ndimage.maximum_filter(image, (15, 15, 1))).all()


@pytest.mark.parametrize("kind", ["u1", "u2", "f4", "f8"])
def test_even_images_stay_bit_for_bit(kind):
    image = np.full((40, 70, 3), (0.3, 0.1, 0.7))
    image = (image if kind[0] == "f" else image * np.iinfo(kind).max).astype(kind)
    np.testing.assert_array_equal(core.sharpen_image(image), image)
    half = image.copy()
    half[:, 35:] //= 2 if kind[0] == "u" else 1
    out = core.sharpen_image(half)
    np.testing.assert_array_equal(out[:, :28], half[:, :28])


@pytest.mark.parametrize(("scale", "shift"), [(0.25, 0.5), (-1.0, 1.0), (900.0, 0.0), (1e-3, 0.0)])
def test_scaled_and_shifted_values_give_scaled_and_shifted_results(scale, shift):
    image = scene(9)
    out = core.sharpen_image(image)
    other = core.sharpen_image((scale * image + shift).astype(np.float32))
    away = (other - shift) / scale - out
    assert rms(away) < 0.0005
    assert np.quantile(np.abs(away), 0.99) < 0.0005


@pytest.mark.parametrize("turn", [
    lambda a: np.rot90(a), lambda a: a[::-1], lambda a: a[:, ::-1], lambda a: a.swapaxes(0, 1),
], ids=["quarter", "up", "across", "diagonal"])  # fmt: skip
def test_turned_and_mirrored_images_give_turned_and_mirrored_results(turn):
    image = scene(10)  # of a multiple of 16 pixels, so that squares of these are the same
    away = core.sharpen_image(np.ascontiguousarray(turn(image))) - turn(core.sharpen_image(image))
    assert rms(away) < 0.0005
    assert np.quantile(np.abs(away), 0.99) < 0.0005


def test_gray_alone_and_as_colors_agree():
    image = scene(11)[..., 0]
    out = core.sharpen_image(image)
    colors = core.sharpen_image(np.repeat(image[..., None], 3, axis=2))
    assert rms(colors - out[..., None]) < 0.0005


def test_types_agree():
    image = scene(12)
    wanted = core.sharpen_image(image)
    double = core.sharpen_image(image.astype(np.float64))
    assert double.dtype == np.float64
    np.testing.assert_array_equal(double.astype(np.float32), wanted)
    words = core.sharpen_image(np.rint(65535 * np.clip(image, 0, 1)).astype(np.uint16))
    assert fidelity(words / 65535, np.clip(wanted, 0, 1)) > 55
    assert fidelity(core.sharpen_image(as_bytes(image)) / 255, np.clip(wanted, 0, 1)) > 38


def test_what_did_not_change_keeps_the_bits_of_doubles():
    image = np.full((64, 64), 1 / 3)
    image[:, 40:] = 2 / 3
    out = core.sharpen_image(image)
    np.testing.assert_array_equal(out[:, :32], image[:, :32])


def logo() -> np.ndarray:
    """Disks, a ring and a bar with soft outlines of a pixel, multiplied by their opacity."""
    y, x = np.mgrid[:160, :160] + 0.5

    def disk(cy, cx, r):
        return np.clip(r + 0.5 - np.hypot(y - cy, x - cx), 0, 1)

    bar = np.clip(8.5 - np.abs(y - 128), 0, 1) * np.clip(50.5 - np.abs(x - 80), 0, 1)
    parts = [(disk(50, 45, 30) - disk(50, 45, 17), (0.9, 0.2, 0.1)), (bar, (0.1, 0.1, 0.2)),
             (disk(60, 115, 24), (0.1, 0.4, 0.9))]  # fmt: skip
    return sum(part[..., None] * np.array([*color, 1.0]) for part, color in parts)


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_a_soft_logo_gets_a_crisp_outline(dtype):
    truth = logo()
    soft = np.stack([ndimage.gaussian_filter(truth[..., c], 2.2) for c in range(4)], axis=2)
    opacity = soft[..., 3:]
    image = np.concatenate([soft[..., :3] / np.maximum(opacity, 1e-9), opacity], axis=2)
    image = as_bytes(image) if dtype == np.uint8 else image.astype(dtype)
    scale = 255 if dtype == np.uint8 else 1
    sharp = core.sharpen_image(image)
    hidden = image[..., 3] == 0
    np.testing.assert_array_equal(sharp[hidden], image[hidden])

    def half_transparent(pixels):
        alpha = pixels[..., 3] / scale
        return ((alpha > 0.03) & (alpha < 0.97)).mean()

    true, before, after = half_transparent(scale * truth), *map(half_transparent, (image, sharp))
    assert after - true < 0.15 * (before - true)
    found = sharp / scale
    assert fidelity(found[..., :3] * found[..., 3:], truth[..., :3]) > (
        fidelity(soft[..., :3], truth[..., :3]) + 4.0
    )


def test_opacity_is_sharpened_as_a_gray_image_but_not_where_a_time_is_given():
    alpha = ndimage.gaussian_filter(logo()[..., 3], 1.5).astype(np.float32) * np.float32(0.9) + 0.1
    image = np.concatenate([scene(16)[:160, :160], alpha[..., None]], axis=2)
    for what in ("auto", "drawing"):
        settings = core.ImageSettings(what=what)
        sharp, gray = (core.sharpen_image(each, settings) for each in (image, alpha))
        np.testing.assert_array_equal(sharp[..., 3], gray)
        assert not np.array_equal(gray, alpha)
    for words in ({"time": 64.0}, {"amount": 0.0}):
        sharp = core.sharpen_image(image, core.ImageSettings(**words))
        np.testing.assert_array_equal(sharp[..., 3], alpha)


def test_hidden_pixels_lend_no_color_and_stay_hidden():
    color = scene(13)
    opacity = np.zeros((*color.shape[:2], 1), np.float32)
    opacity[:, 150:] = np.clip(np.linspace(0, 3, 384 - 150), 0, 1)[None, :, None]
    image = np.concatenate([color, opacity], axis=2)
    other = image.copy()
    other[:, :150, :3] = 1e6
    one, two = core.sharpen_image(image), core.sharpen_image(other)
    np.testing.assert_array_equal(one[:, 151:], two[:, 151:])
    np.testing.assert_array_equal(one[:, :151], image[:, :151])
    np.testing.assert_array_equal(two[:, :151], other[:, :151])
    assert (one[:, 151:, :3] != image[:, 151:, :3]).any()


def test_the_report_says_that_opacity_was_sharpened():
    alpha = ndimage.gaussian_filter(logo()[..., 3], 1.5).astype(np.float32)
    image = np.concatenate([np.full((*alpha.shape, 3), 0.5, np.float32), alpha[..., None]], axis=2)
    with gathering() as findings:
        core.sharpen_image(image)
    assert "Opacity was sharpened, too." in map(str, findings)
    image[..., 3] = 1
    with gathering() as findings:
        core.sharpen_image(image)
    assert "Opacity was sharpened, too." not in map(str, findings)


def test_even_opacity_changes_nothing():
    color = scene(14)
    plain = core.sharpen_image(color)
    for share in (1.0, 0.5):
        opacity = np.full((*color.shape[:2], 1), share, np.float32)
        found = core.sharpen_image(np.concatenate([color, opacity], axis=2))
        assert rms(found[..., :3] - plain) < 0.0005


def test_half_transparent_neighbors_count_by_their_opacity():
    values = np.random.default_rng(15).random((1, 20, 30)).astype(np.float32)
    opacity = np.random.default_rng(16).random((20, 30)).astype(np.float32)
    weights = gaussian(1.5)
    wanted = smooth(values[0] * opacity, weights) / smooth(opacity, weights)
    found = Planes(values, opacity).smoothed((1.5,), 4, 13)
    np.testing.assert_allclose(found[0, 0], wanted[4:13], rtol=1e-5)


def test_amount_and_masks_mix_evenly():
    image = scene(17)
    full = core.sharpen_image(image)
    none = core.sharpen_image(image, core.ImageSettings(amount=0.0))
    np.testing.assert_array_equal(none, image)
    half = core.sharpen_image(image, core.ImageSettings(amount=0.5))
    np.testing.assert_allclose(half, image + 0.5 * (full - image), atol=1e-6)
    mask = np.zeros(image.shape[:2])
    mask[40:80] = 1.0
    part = core.sharpen_image(image, mask=mask)
    np.testing.assert_array_equal(part[mask == 0], image[mask == 0])
    np.testing.assert_array_equal(part[mask == 1], full[mask == 1])


def test_a_given_width_takes_the_place_of_the_measured_one():
    image = blurred(drawing(18), 3.0)
    results = [
        core.sharpen_image(image, core.ImageSettings(width=width))
        for width in (1.5, 3.0, 4.5, 6.0, 7.7, 11.5)
    ]
    changes = [float(abs(result - image).mean()) for result in results]
    assert changes[:5] == sorted(changes[:5]) and changes[4] > 10 * changes[0]
    assert changes[5] > 0.8 * changes[4]  # wider than the blur: no more, and little less
    assert fidelity(results[4], core.sharpen_image(image)) > 40


def test_widths_beyond_all_that_it_has_learned_are_as_the_widest():
    image = blurred(drawing(3), 3.0)
    widest, wide = (
        core.sharpen_image(image, core.ImageSettings(width=width)) for width in (11.6, 64.0)
    )
    np.testing.assert_array_equal(wide, widest)


def test_what_another_way_has_measured_lacks_no_detail():
    image = blurred(drawing(3), 2.0)
    known = measure_image(image, core.ImageSettings(what="photo"))
    np.testing.assert_array_equal(
        core.sharpen_image(image, known=known),
        core.sharpen_image(image, known=measure_image(image)),
    )


def test_what_or_a_guide_leave_it_to_the_width():
    image = blurred(drawing(19), 2.0)
    learned = core.sharpen_image(image)
    drawn = core.sharpen_image(image, core.ImageSettings(what="drawing"))
    assert rms(learned - drawn) > 0.003
    guided = core.sharpen_image(image, guide=image)
    np.testing.assert_allclose(guided, drawn, atol=1e-4)


@pytest.mark.parametrize("channels", ["independent", "luminance"])
def test_channels_may_be_guided_otherwise(channels):
    image = scene(20)
    out = core.sharpen_image(image, core.ImageSettings(channels=channels))
    if channels == "independent":
        one = core.sharpen_image(np.ascontiguousarray(image[..., 1]))
        np.testing.assert_array_equal(out[..., 1], one)
    else:
        assert 0.001 < rms(out - core.sharpen_image(image)) < 0.02


def grainy(seed, strength, size=128):
    """Stone with grain in all channels alike: brightness from 0 to 1 times a part, slowly."""
    random = np.random.default_rng(seed)
    slow = ndimage.gaussian_filter(random.normal(size=(size, size)), 16, mode="wrap")
    slow = 0.35 + 0.3 * (slow - slow.min()) / np.ptp(slow)
    return (slow + strength * random.normal(size=slow.shape))[..., None].repeat(3, axis=2)


def test_strong_grain_stays():
    for strength in (0.05, 0.1, 0.15):
        image = np.clip(grainy(61, strength), 0, 1).astype(np.float32)
        assert rms(core.sharpen_image(image) - image) < 0.05 * strength
        np.testing.assert_allclose(
            core.sharpen_image(0.1 * image), 0.1 * core.sharpen_image(image), atol=1e-5
        )
    faint = grainy(61, 0.005).astype(np.float32)  # noise
    away = core.sharpen_image(faint) - faint
    assert rms(away) > 0.8 * 0.005
    sizes = []
    for strength in np.arange(0.005, 0.05, 0.0025):  # and what lies between changes evenly
        image = grainy(61, strength).astype(np.float32)
        sizes.append(rms(core.sharpen_image(image) - image))
    assert np.abs(np.diff(sizes)).max() < 0.004


def test_hidden_pixels_are_no_grain():
    below, right = np.mgrid[:96, :96]
    away = np.hypot(below - 48, right - 48)
    flat = np.where(right < 16, 0.7, 0.9)[..., None]
    image = np.dstack([flat + 0.02 * np.random.default_rng(64).normal(size=(96, 96, 3)), away < 40])
    image[away >= 40] = 0
    noise = core.sharpen_image(image.astype(np.float32))[..., :3] - flat
    rim, middle = (noise[place & (right > 24)] for place in ((away < 39) & (away > 34), away < 20))
    assert rms(rim) < 1.5 * rms(middle)


def test_strong_grain_stays_beside_borders_that_become_sharp():
    image = as_bytes(blurred(drawing(62), 2.0)).astype(np.float32) / 255
    given = image.copy()
    given[:, 96:] = grainy(63, 0.15, len(image))[:, 96 : given.shape[1]]
    given = given.clip(0, 1)
    found = core.sharpen_image(given)
    np.testing.assert_allclose(found[:, 130:], given[:, 130:], atol=0.02)
    assert rms(found[:, :60] - given[:, :60]) > 0.4 * rms(
        core.sharpen_image(image)[:, :60] - image[:, :60]
    )


@pytest.mark.parametrize("shape", [
    (1, 1), (1, 30), (30, 1), (2, 2), (3, 5, 1), (17, 4, 2), (33, 70, 4), (5, 40, 5),
], ids=str)  # fmt: skip
def test_small_images_are_done(shape):
    image = np.random.default_rng(21).random(shape).astype(np.float32)
    out = core.sharpen_image(image)
    assert np.isfinite(out).all()
    assert image.min() <= out.min() and out.max() <= image.max()


def test_extreme_values_are_done_and_worse_ones_refused():
    image = scene(22, 64)
    for scale in (1e15, 1e-9):
        out = core.sharpen_image((scale * np.clip(image, 0, 1)).astype(np.float32))
        assert np.isfinite(out).all()
        assert rms(out / scale - core.sharpen_image(np.clip(image, 0, 1))) < 0.001
    for value in (np.nan, np.inf, 1e16):
        image[5, 5, 1] = value
        with pytest.raises(core.InvalidSignal):
            core.sharpen_image(image)


@pytest.mark.parametrize(
    "settings",
    [
        {},
        pytest.param({"width": 6.0}, marks=pytest.mark.slow),
        pytest.param({"channels": "independent"}, marks=pytest.mark.slow),
        pytest.param({"smoothing_passes": 3}, marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_chunks_have_the_bits_of_the_whole(settings):
    settings = core.ImageSettings(**settings)
    image = as_bytes(np.tile(scene(23), (3, 2, 1))[:531, :, :2])
    image[..., 1] = as_bytes(ndimage.gaussian_filter(drawing(24, 768), 3)[:531, :, 0])
    expected = core.sharpen_image(image, settings)
    with counting_reruns() as counts:
        lazy = core.sharpen_image(dask.array.from_array(image, chunks=(250, 256, 2)), settings)
    found, reruns = dask.compute(lazy, counts[0], scheduler="synchronous")
    assert reruns.shape == (2, 3) and reruns.sum() == 0
    np.testing.assert_array_equal(found, expected)


def test_flow_lines_that_leave_make_chunks_run_again(monkeypatch):
    from shock_filter.core.color import chunked

    monkeypatch.setattr(chunked, "_LEARNED_WALK", -40)
    image = as_bytes(blurred(np.tile(drawing(25), (3, 2, 1)), 4.0))
    expected = core.sharpen_image(image)
    with counting_reruns() as counts:
        lazy = core.sharpen_image(dask.array.from_array(image, chunks=(193, 193, 3)))
    found, reruns = dask.compute(lazy, counts[0].sum(), scheduler="synchronous")
    assert reruns > 0
    np.testing.assert_array_equal(found, expected)


def test_parts_begin_where_squares_of_pixels_do():
    part = Part((100, 80), slice(40, 60), slice(30, 50), (True, False, True, True), 9, (5, 32))
    begun = part.begun_at(16)
    assert begun.origin == (16, 32) and begun.shape == (89, 80)
    assert (begun.rows, begun.columns) == (slice(29, 49), slice(30, 50))
    wider = begun.wider(31)
    assert (wider.rows, wider.columns) == (slice(0, 80), slice(0, 80))
    assert part.enlarged(2).origin == (10, 64)


def test_a_patch_goes_by_the_detail_of_the_whole():
    image = scene(27, 96)
    patch = image[:64, :64].copy()
    own, whole = measure_image(patch), measure_image(image)
    assert own.borders.detail != whole.borders.detail > 0
    by_itself = core.sharpen_image(patch)
    np.testing.assert_array_equal(core.sharpen_image(patch, known=own), by_itself)
    large = own._replace(borders=own.borders._replace(detail=1e4 * own.borders.detail))
    assert rms(core.sharpen_image(patch, known=large) - by_itself) > 1e-4


def test_it_can_be_followed_and_cancelled():
    image, seen = scene(28), []

    def watch(fraction, message):
        seen.append((fraction, message))
        return True

    core.sharpen_image(image, progress=watch)
    fractions = [fraction for fraction, _ in seen]
    assert fractions == sorted(fractions) and fractions[-1] == 1.0
    assert len({round(fraction, 1) for fraction in fractions}) > 6
    for stop in (0.05, 0.3, 0.6, 0.9):
        with pytest.raises(core.Cancelled):
            core.sharpen_image(image, progress=lambda fraction, _, stop=stop: fraction < stop)


def test_widths_are_told_when_somebody_listens():
    with gathering() as found:
        core.sharpen_image(as_bytes(blurred(drawing(29), 2.0)))
    assert [each.sentence for each in found] == [
        "Borders {width:.1f} pixels wide, closed to {result:.1f}."
    ]
    with gathering() as found:
        core.sharpen_image(np.full((40, 40), 0.5))
    assert [str(each) for each in found] == ["Nothing to sharpen was found."]


def test_what_was_done_is_told():
    before = Borders(width=6.0, number=100, detail=1.0)
    for after, words in (
        (None, "Already sharp: borders 6.0 pixels wide."),
        (Borders(width=2.0, number=90, detail=1.5), "Borders 6.0 pixels wide, closed to 2.0."),
        (Borders(width=0.0, number=2, detail=1.5), "Borders up to 6.0 pixels wide were closed."),
        (Borders(width=9.0, number=20, detail=1.5), "Texture was sharpened"),
        (Borders(width=6.1, number=90, detail=0.5), "Noise was smoothed"),
        (Borders(width=6.1, number=90, detail=1.5), "Texture was sharpened"),
        (Borders(width=6.1, number=90, detail=0.99), "Already sharp: borders 6.0 pixels wide."),
        (Borders(width=6.1, number=90, detail=1.01), "Already sharp: borders 6.0 pixels wide."),
    ):
        with gathering() as found:
            tell_learned("pixels", before, after)
        assert str(found[0]).startswith(words)


def test_the_way_to_close_borders_that_hardly_got_narrower_is_told():
    before = Borders(width=4.4, number=100, detail=1.0)
    with gathering() as found:
        tell_learned("edge lengths", before, Borders(width=3.9, number=90, detail=1.5))
    assert str(found[0]) == (
        "Borders stay 3.9 edge lengths wide; in flat colors, What: Drawing closes them."
    )


def test_the_way_to_close_wide_borders_is_told():
    before = Borders(width=16.0, number=100, detail=1.0)
    advice = "pixels wide; in flat colors, What: Drawing closes them."
    for after, words in (
        (None, f"Borders stay 16.0 {advice}"),
        (Borders(width=15.0, number=90, detail=1.5), f"Borders stay 15.0 {advice}"),
        (Borders(width=2.0, number=90, detail=1.5), "Borders 16.0 pixels wide, closed to 2.0."),
    ):
        with gathering() as found:
            tell_learned("pixels", before, after)
        assert str(found[0]).startswith(words)


def test_results_move_as_little_as_images_do():
    truth = drawing(30)
    rise = texture(31) - 0.5
    sizes = []
    for amount in np.arange(0, 0.0501, 0.005):
        image = blurred(truth + amount * rise, 1.5).astype(np.float32)
        sizes.append(rms(core.sharpen_image(image) - image))
    assert max(sizes) > 0.02
    assert np.abs(np.diff(sizes)).max() < 0.002


def test_shipped_networks_belong_to_the_code():
    found = load(WEIGHTS, DEFINITION)
    assert set(found) == set(STAGES)
    for network in found.values():
        assert network.version >= 1 and len(network.made_of) == 16
    with pytest.raises(ValueError, match="train it again"):
        load(WEIGHTS, "other")


def test_some_rows_are_smoothed_as_all_are():
    plane = np.random.default_rng(32).random((21, 13)).astype(np.float32)
    for sigma, top, bottom in ((0.6, 0, 3), (2.0, 6, 9), (4.5, 12, 21), (9.0, 2, 20)):
        weights = gaussian(sigma)
        reach = len(weights) - 1
        first, last = max(top - reach, 0), min(bottom + reach, 21)
        out = np.empty((bottom - top, 13), np.float32)
        smooth_rows(plane[first:last], first, 21, weights, top, out)
        np.testing.assert_array_equal(out, smooth(plane, weights)[top:bottom])


def test_logarithms_are_exact_enough():
    values = np.concatenate([[0.0], np.geomspace(1e-6, 1e20, 500)]).astype(np.float32)
    found = np.array([half_log(value) for value in values])
    np.testing.assert_allclose(found, 0.5 * np.log(values + 1e-5) + 2, atol=2e-4)


def test_logarithms_of_nan_are_the_same_on_all_processors():
    nan = np.array([0x7FC00000, 0xFFC00000], np.uint32).view(np.float32)  # of ARM, of x86
    assert half_log(nan[0]) == half_log(nan[1]) == pytest.approx(-42.1588, abs=1e-3)


def test_planes_hold_hidden_pixels_as_0_and_ranges_without_them():
    pixels = np.full((9, 9, 2), 200, np.uint8)
    pixels[:, 4:, 1] = 0
    pixels[4, 2, 0] = 100
    planes = Planes.of(pixels, Channels(0, 1, 1, NONE))
    assert planes.values[0, 0].tolist() == [200] * 4 + [0] * 5
    low, high = planes.ranges((1, 3), 0, 9)
    assert (low[0, 0, :, :4].min(), high[1, 0, :, :4].max()) == (100, 200)
    assert low[0, 0, 0, 3] == 200
    assert (low[..., 4:] == 0).all() and (high[..., 4:] == 0).all()


def test_a_sun_changes_nothing_far_from_it():
    image = np.tile(scene(31), (5, 5, 1))[:600, :600]
    sunny = image.copy()
    sunny[20:23, 20:23] = 1e5
    one, two = core.sharpen_image(image), core.sharpen_image(sunny)
    far = slice(300, None)
    assert rms(two[far, far] - one[far, far]) < 0.05 * rms(one[far, far] - image[far, far])


@pytest.mark.parametrize("is_chunked", [False, True])
def test_the_report_of_opacity_is_about_what_was_mixed(is_chunked):
    alpha = ndimage.gaussian_filter(logo()[..., 3], 1.5).astype(np.float32)
    image = np.concatenate([np.full((*alpha.shape, 3), 0.5, np.float32), alpha[..., None]], axis=2)
    for mask, is_told in ((np.zeros(alpha.shape), False), (np.ones(alpha.shape), True)):
        with gathering() as findings:
            given = dask.array.from_array(image, chunks=(96, 96, 4)) if is_chunked else image
            found = core.sharpen_image(given, mask=mask)
            if is_chunked:
                found = found.compute(scheduler="synchronous")
        assert (found[..., 3] != image[..., 3]).any() == is_told
        assert ("Opacity was sharpened, too." in map(str, findings)) == is_told
