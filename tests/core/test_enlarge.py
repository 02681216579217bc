# SPDX-License-Identifier: GPL-3.0-or-later
"""Enlarged images are as crisp as small ones, and have no values that were not nearby."""

import math

import numpy as np
import OpenEXR
import pytest
from PIL import Image
from scipy import ndimage
from shock_filter import core
from shock_filter.core import cli
from shock_filter.core.color.image_sharpening import measure_image

TYPES = ["uint8", "uint16", "float32", "float64"]
SIZE = 128


def noise(*shape, dtype="float32", seed=0):
    values = np.random.default_rng(seed).random(shape)
    if np.dtype(dtype).kind == "u":
        return (values * np.iinfo(dtype).max).astype(dtype)
    return values.astype(dtype)


def drawing(seed):
    """Flat disks and squares, antialiased."""
    random = np.random.default_rng(seed)
    fine = 4 * SIZE
    y, x = np.mgrid[:fine, :fine]
    image = np.full((fine, fine, 3), random.random(3))
    for number in range(12):
        row, column = random.uniform(0, fine, 2)
        turn = random.uniform(0, math.pi)
        across = (x - column) * math.cos(turn) + (y - row) * math.sin(turn)
        along = (y - row) * math.cos(turn) - (x - column) * math.sin(turn)
        away = np.maximum(abs(across), abs(along)) if number % 2 else np.hypot(across, along)
        image[away < random.uniform(40, 120)] = random.random(3)
    return reduced(image, 4)


def reduced(image, times):
    height, width = (length // times for length in image.shape[:2])
    return image.reshape(height, times, width, times, -1).mean(axis=(1, 3))


def enlarged(image, times=2, mask=None, **settings):
    return core.sharpen_image(image, core.ImageSettings(enlarge=times, **settings), mask=mask)


def cubic(image, times=2):
    return enlarged(image, times, amount=0.0)


def fidelity(image, wanted):
    """PSNR in decibels."""
    return -10 * math.log10(((image - wanted) ** 2).mean())


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("shape", [(9, 14), (9, 14, 1), (7, 12, 3), (8, 5, 4), (1, 6, 3), (1, 1)])
@pytest.mark.parametrize("times", [2, 3, 4])
def test_size_and_type(dtype, shape, times):
    image = noise(*shape, dtype=dtype)
    result = enlarged(image, times)
    assert result.shape == (times * shape[0], times * shape[1], *shape[2:])
    assert result.dtype == image.dtype


@pytest.mark.parametrize("dtype", TYPES)
def test_even_colors_stay_bit_for_bit(dtype):
    image = np.empty((6, 7, 3), dtype)
    image[:] = noise(3, dtype=dtype)
    for amount in (0.0, 1.0):
        result = enlarged(image, 4, amount=amount)
        np.testing.assert_array_equal(result, np.broadcast_to(image[0, 0], result.shape))


@pytest.mark.parametrize("times", [2, 4])
def test_slopes_and_parabolas_are_met_by_the_cubic(times):
    rows, columns = (np.arange(24) + 0.5 for _ in range(2))
    fine = (np.arange(24 * times) + 0.5) / times
    inside = slice(3 * times, -3 * times)
    slope = 0.01 * rows[:, None] + 0.02 * columns
    result = cubic(slope, times)
    np.testing.assert_allclose(
        result[inside, inside], (0.01 * fine[:, None] + 0.02 * fine)[inside, inside], atol=1e-12
    )
    bent = np.broadcast_to(0.001 * rows[:, None] ** 2, (24, 24))
    middle = slice(3 * times, -3 * times)
    wanted = np.broadcast_to(0.001 * fine[:, None] ** 2, (24 * times, 24 * times))
    np.testing.assert_allclose(
        cubic(bent, times)[middle, middle], wanted[middle, middle], rtol=0.01
    )


@pytest.mark.parametrize("times", [2, 4])
def test_between_peaks_the_cubic_is_that_of_others(times):
    small = ndimage.gaussian_filter(noise(32, 32, seed=3), 1.5)
    size = (32 * times, 32 * times)
    theirs = np.asarray(Image.fromarray(small).resize(size, Image.Resampling.BICUBIC))
    inside = slice(3 * times, -3 * times)
    same = np.isclose(cubic(small, times), theirs, atol=1e-6)[inside, inside]
    assert same.mean() > 0.95


@pytest.mark.parametrize("what", ["drawing", "photo"])
@pytest.mark.parametrize("times", [2, 4])
def test_no_value_is_new(what, times):
    image = noise(24, 30, 3)
    reach = 4 + math.ceil(2.0)  # the cubic's, and a width's, each way
    window = (2 * reach + 1, 2 * reach + 1, 1)
    high = ndimage.maximum_filter(image, window).repeat(times, 0).repeat(times, 1)
    low = ndimage.minimum_filter(image, window).repeat(times, 0).repeat(times, 1)
    result = enlarged(image, times, what=what, width=2.0)
    assert (result <= high + 1e-6).all()
    assert (result >= low - 1e-6).all()
    plain = cubic(image, times)
    window = (5, 5, 1)
    high = ndimage.maximum_filter(image, window).repeat(times, 0).repeat(times, 1)
    low = ndimage.minimum_filter(image, window).repeat(times, 0).repeat(times, 1)
    assert (plain <= high).all()
    assert (plain >= low).all()


@pytest.mark.parametrize(("times", "least"), [(2, 4.0), (4, 2.5)])
@pytest.mark.parametrize("contrast", [1.0, 0.2])
def test_drawings_come_near_to_what_they_were(times, least, contrast):
    for seed in (7, 8):
        wanted = 0.5 + contrast * (drawing(seed) - 0.5)
        small = reduced(wanted, times).astype(np.float32)
        gain = fidelity(enlarged(small, times), wanted) - fidelity(cubic(small, times), wanted)
        assert gain > least


def test_thin_lines_are_not_taken_for_sharp():
    fine = np.zeros((8 * SIZE, 8 * SIZE, 1))
    y, x = np.mgrid[: 8 * SIZE, : 8 * SIZE] / 8.0
    for radius in (10.0, 18.0, 26.0):
        fine[abs(np.hypot(x - 0.5 * SIZE, 0.8 * (y - 0.5 * SIZE)) - radius) < 0.7] = 1.0
    small, wanted = (reduced(fine, times).astype(np.float32) for times in (8, 4))
    gain = fidelity(enlarged(small, 2), wanted) - fidelity(cubic(small, 2), wanted)
    assert gain > 2.0


def test_widths_are_those_of_the_image_as_it_is_given():
    # Borders of 6 pixels are closed, and as many of 24 are left alone.
    places = np.arange(-40, 40)
    narrow, wide = (np.tile(0.5 + 0.5 * np.tanh(places / s), (16, 1)) for s in (2.7, 11.0))
    for times in (1, 2):
        settings = {"times": times, "what": "drawing", "width": 6.0}
        closed, left = (
            enlarged(narrow, **settings)[8 * times],
            enlarged(wide, **settings)[8 * times],
        )
        assert np.diff(closed).max() > 0.3
        assert np.diff(left).max() < 1.5 * np.diff(wide[0]).max() / times


def test_what_is_measured_is_the_enlarged_image():
    small = reduced(drawing(9), 2).astype(np.float32)
    found = measure_image(small, core.ImageSettings(enlarge=2))
    assert found.what == "drawing"
    assert 2.0 < found.borders.width < 3.0 < found.width
    np.testing.assert_array_equal(
        core.sharpen_image(small, core.ImageSettings(enlarge=2), known=found), enlarged(small)
    )


@pytest.mark.parametrize("turn", [np.transpose, lambda a: a[::-1], lambda a: a[:, ::-1]])
def test_turning_the_image_turns_the_result(turn):
    image = ndimage.gaussian_filter(noise(20, 20, seed=4), 1.0)
    settings = {"what": "drawing", "width": 2.0}
    turned = enlarged(np.ascontiguousarray(turn(image)), **settings)
    np.testing.assert_allclose(turned, turn(enlarged(image, **settings)), atol=1e-4)


def test_transparent_pixels_lend_no_color():
    image = np.zeros((16, 16, 4), np.float32)
    image[..., 0] = 0.8
    image[:, :8] = (0.0, 1.0, 0.0, 0.0)
    image[:, 8:, 3] = 1.0
    result = enlarged(image, 4)
    seen = result[..., 3] > 0
    assert seen.any()
    np.testing.assert_array_equal(result[seen, 0], np.float32(0.8))
    np.testing.assert_array_equal(result[seen, 1], 0.0)
    np.testing.assert_array_equal(result[..., 3], enlarged(image[..., 3].copy(), 4))
    assert np.isfinite(result).all()


def test_opacity_beyond_its_range_counts_as_one_and_stays():
    image = noise(8, 8, 4)
    image[..., 3] = 3.0
    result = enlarged(image)
    np.testing.assert_array_equal(result[..., 3], 3.0)
    image[..., 3] = 1.0
    np.testing.assert_array_equal(result[..., :3], enlarged(image)[..., :3])


def test_values_beyond_one_stay_finite():
    image = noise(12, 12, 3) * np.float32(1e3)
    result = enlarged(image, 4)
    assert np.isfinite(result).all()
    assert result.max() <= image.max()


def test_a_mask_is_enlarged_with_the_image():
    image = reduced(drawing(10), 2).astype(np.float32)
    mask = np.zeros(image.shape[:2])
    mask[:, 32:] = 1.0
    result = enlarged(image, mask=mask)
    np.testing.assert_array_equal(result[:, :60], cubic(image)[:, :60])
    np.testing.assert_array_equal(result[:, 68:], enlarged(image)[:, 68:])


def test_a_time_acts_on_the_enlarged_image():
    image = ndimage.gaussian_filter(noise(20, 20, seed=6), 2.0)
    wanted = core.sharpen_image(cubic(image), core.ImageSettings(time=256.0))
    np.testing.assert_array_equal(enlarged(image, time=256.0), wanted)


def test_out_has_the_size_of_the_result():
    image = noise(8, 9, 3, dtype="uint8")
    out = np.empty((16, 18, 3), np.uint8)
    assert enlarged(image) is not out
    given = core.sharpen_image(image, core.ImageSettings(enlarge=2), out=out)
    assert np.shares_memory(given, out)
    np.testing.assert_array_equal(out, enlarged(image))
    with pytest.raises(core.InvalidSignal, match=r"give a contiguous uint8 array of shape \(16, 1"):
        core.sharpen_image(image, core.ImageSettings(enlarge=2), out=np.empty_like(image))


@pytest.mark.parametrize("times", [0, 9, 1.5])
def test_other_sizes_are_refused(times):
    with pytest.raises(core.InvalidSettings, match="enlarge is"):
        core.ImageSettings(enlarge=times)


def test_a_run_can_be_cancelled():
    calls = []

    def progress(fraction, message):
        calls.append(message)
        return len(calls) < 3

    with pytest.raises(core.Cancelled):
        core.sharpen_image(noise(200, 200, 3), core.ImageSettings(enlarge=4), progress=progress)
    assert "Enlarging" in calls


@pytest.mark.parametrize("ending", ["png", "tif", "npy"])
def test_the_command_line_writes_the_larger_file(tmp_path, monkeypatch, ending):
    monkeypatch.chdir(tmp_path)
    image = noise(10, 12, 3, dtype="uint8")
    if ending == "npy":
        np.save("in.npy", image)
    else:
        Image.fromarray(image).save(f"in.{ending}")
    assert cli.main(["sharpen-image", f"in.{ending}", f"out.{ending}", "--enlarge", "2"]) == 0
    if ending == "npy":
        result = np.load("out.npy")
    else:
        with Image.open(f"out.{ending}") as file:
            result = np.array(file)
    np.testing.assert_array_equal(result, enlarged(image))


def test_other_channels_of_exr_files_are_left_behind(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    image, depth = noise(10, 12, 3), noise(10, 12)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": image, "Z": depth}).write("in.exr")
    assert cli.main(["sharpen-image", "in.exr", "out.exr", "--enlarge", "2"]) == 0
    assert "the other channels (Z) have another size: left behind" in capsys.readouterr().out
    with OpenEXR.File("out.exr") as file:
        assert list(file.channels()) == ["RGB"]
        np.testing.assert_array_equal(file.channels()["RGB"].pixels, enlarged(image))


def test_colors_do_not_depend_on_how_opaque_all_pixels_are():
    image = noise(9, 14, 4)
    image[..., 3] = 1.0
    thin = image.copy()
    thin[..., 3] = 0.25
    np.testing.assert_allclose(cubic(thin)[..., :3], cubic(image)[..., :3], atol=1e-6)
