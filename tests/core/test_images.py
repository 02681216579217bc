# SPDX-License-Identifier: GPL-3.0-or-later
import math

import numpy as np
import pytest
import scipy.ndimage
from grid_walks import follow
from shock_filter import core
from shock_filter.core.grid import advect, walk
from shock_filter.core.grid.channels import Channels
from shock_filter.core.grid.potential import image_potential

NONE = np.empty(0, dtype=np.float32)
GRAY = Channels(0, 1, -1, NONE)
SCHEMES = [
    {},
    {"channels": "independent"},
    {"channels": "luminance"},
    {"sampling": "nearest"},
    {"smoothing_passes": 0},
    {"smoothing_passes": 4},
]


def photo(height=61, width=53, seed=0, sigma=1.5, channels=3):
    """Soft random blotches with edges, in [0, 1]."""
    rng = np.random.default_rng(seed)
    noise = scipy.ndimage.gaussian_filter(rng.normal(size=(height, width, channels)), (4, 4, 0))
    return np.clip(
        0.5 + 0.4 * scipy.ndimage.gaussian_filter(np.sign(noise), (sigma, sigma, 0)), 0, 1
    )


def sharpen(image, mask=None, **settings):
    return core.sharpen_image(image, core.ImageSettings(**settings), mask=mask)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
@pytest.mark.parametrize("shape", [(9, 7), (9, 7, 1), (9, 7, 2), (9, 7, 3), (9, 7, 4), (9, 7, 7)])
def test_zero_time_and_zero_mask_return_the_input_bit_for_bit(dtype, shape):
    rng = np.random.default_rng(0)
    image = (rng.random(shape) * (1 if np.dtype(dtype).kind == "f" else 200)).astype(dtype)
    before = image.copy()
    for out in (sharpen(image, time=0), sharpen(image, np.zeros((9, 7)))):
        assert np.array_equal(out, before)
        assert out.dtype == dtype
        assert out.shape == shape
        assert not np.may_share_memory(out, image)
    sharpen(image)
    assert np.array_equal(image, before)


@pytest.mark.parametrize("settings", SCHEMES)
@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_constants_stay_and_values_stay_in_range(settings, dtype):
    scale = 1 if dtype == np.float32 else 255
    flat = np.full((20, 17, 3), 0.4 * scale).astype(dtype)
    assert np.allclose(sharpen(flat, time=30, **settings), flat, rtol=1e-6)
    image = (photo() * scale).astype(dtype)
    out = sharpen(image, time=60, **settings)
    slack = 0 if scale > 1 else 1e-6
    assert (out.min(axis=(0, 1)) >= image.min(axis=(0, 1)) - slack).all()
    assert (out.max(axis=(0, 1)) <= image.max(axis=(0, 1)) + slack).all()


@pytest.mark.parametrize("time", [1.0, 50.0, 1e4, math.inf])
def test_any_time_is_stable_and_values_come_from_nearby(time):
    image = photo(channels=1)[..., 0]
    out = sharpen(image, time=time)
    potential = image_potential(image[..., None], 1.0, GRAY, 1)
    slope = 0.5 * np.hypot(*np.gradient(potential)).max() * 2  # bounds |u| in every square
    radius = math.ceil(min(slope * time + 1, max(image.shape)))
    window = 2 * radius + 1
    assert (out >= scipy.ndimage.minimum_filter(image, window) - 1e-12).all()
    assert (out <= scipy.ndimage.maximum_filter(image, window) + 1e-12).all()


def test_extrema_keep_their_values():
    image = photo(channels=1)[..., 0]
    out = sharpen(image, time=math.inf)
    # Where P has a local minimum with no flow, such as flat tops, the value stays.
    assert out.max() == pytest.approx(image.max(), abs=1e-3)
    assert out.min() == pytest.approx(image.min(), abs=1e-3)


def test_total_variation_is_kept_in_one_dimension():
    x = np.linspace(0, 6 * np.pi, 400)
    profile = 0.5 + 0.2 * np.sin(x) + 0.1 * np.sin(2.3 * x)
    image = np.tile(profile, (8, 1))
    for time in (10.0, 1e3, 1e5):
        out = sharpen(image, time=time)[4]
        assert np.abs(np.diff(out)).sum() == pytest.approx(np.abs(np.diff(profile)).sum(), rel=0.02)


def test_a_blurred_step_steepens_and_a_sharp_one_stays():
    x = np.arange(60)
    for angle in (0.0, 0.3, np.pi / 2):
        distance = np.cos(angle) * (x[None, :] - 29.6) + np.sin(angle) * (x[:, None] - 29.6)
        soft = 1 / (1 + np.exp(-distance / 3))
        out = sharpen(soft, time=1e4)
        inside = slice(12, -12)

        def steepest(image, inside=inside):
            return np.hypot(*np.gradient(image))[inside, inside].max()

        assert steepest(out) > 3 * steepest(soft)
        sharp = (distance > 0).astype(float)
        kept = sharpen(sharp, time=1e4, smoothing_passes=0)[inside, inside]
        assert abs(kept - sharp[inside, inside]).mean() < 0.02


def test_turning_and_mirroring_the_image_turns_the_result():
    image = photo()
    expected = sharpen(image, time=40)
    assert np.allclose(sharpen(np.rot90(image), time=40), np.rot90(expected), atol=1e-5)
    assert np.allclose(sharpen(image[:, ::-1], time=40), expected[:, ::-1], atol=1e-5)
    assert np.allclose(sharpen(image[..., ::-1], time=40), expected[..., ::-1], atol=1e-5)


def test_coupled_channels_share_a_flow_and_independent_ones_do_not():
    image = photo()
    gray = np.repeat(image[..., :1], 3, axis=2)
    alone = sharpen(image[..., 0], time=30)
    assert np.allclose(sharpen(gray, time=10)[..., 0], alone, atol=1e-5)  # three times P
    independent = sharpen(image, time=30, channels="independent")
    assert np.allclose(independent[..., 0], alone)
    assert not np.allclose(sharpen(image, time=30)[..., 0], alone, atol=1e-3)
    luminance = sharpen(gray, time=30, channels="luminance")
    assert np.allclose(luminance[..., 2], alone, atol=1e-5)


def test_whole_numbers_agree_with_floats_up_to_rounding():
    image = photo()
    for dtype, top in ((np.uint8, 255), (np.uint16, 65535)):
        whole = np.rint(image * top).astype(dtype)
        exact = sharpen(whole / top, time=30) * top
        assert abs(sharpen(whole, time=30) - exact).max() <= 0.5 + 1e-3 * top / 255


def test_opacity_stays_and_transparent_pixels_lend_no_color():
    image = np.zeros((40, 40, 4), dtype=np.float32)
    distance = np.hypot(*(np.mgrid[:40, :40] - 19.5))
    image[..., 3] = np.clip((15 - distance) / 4, 0, 1)
    image[..., 0] = 0.5 + 0.02 * (np.mgrid[:40, :40][0] - 20)
    hidden = image[..., 3] == 0
    image[hidden, 1] = 1.0  # garish, and never seen
    out = sharpen(image, time=1e4)
    assert np.array_equal(out[..., 3], image[..., 3])
    assert out[~hidden, 1].max() < 1e-6
    bled = sharpen(image, time=1e4, alpha="none")
    assert bled[~hidden, 1].max() > 0.1


def test_opacity_beyond_its_range_counts_as_its_nearest_bound():
    rng = np.random.default_rng(1)
    image = rng.random((20, 20, 4))
    image[..., 3] = rng.uniform(-0.5, 1.5, (20, 20))
    clipped = image.copy()
    clipped[..., 3] = np.clip(image[..., 3], 0, 1)
    result = sharpen(image, time=3.0)
    expected = sharpen(clipped, time=3.0)
    np.testing.assert_array_equal(result[..., :3], expected[..., :3])
    np.testing.assert_array_equal(result[..., 3], image[..., 3])
    assert (result != image).any()


def test_values_beyond_one_are_kept():
    image = photo().astype(np.float32) * 40
    out = sharpen(image, time=1.0)
    assert out.max() > 20
    huge = image * np.float32(1e30)
    assert np.isfinite(sharpen(huge, time=5.0)).all()


def test_masks_mix():
    image = photo()
    full = sharpen(image, time=50)
    mask = np.linspace(0, 1, image.shape[1])[None, :].repeat(image.shape[0], axis=0)
    out = sharpen(image, mask, time=50)
    assert np.allclose(out, image + mask[..., None] * (full - image))
    assert np.array_equal(out[:, 0], image[:, 0])
    assert np.array_equal(sharpen(image, np.ones_like(mask), time=50), full)


@pytest.mark.parametrize("shape", [(1, 30), (30, 1), (1, 1), (2, 2), (1, 30, 3), (2, 30)])
def test_thin_images(shape):
    image = np.random.default_rng(0).random(shape)
    out = sharpen(image, time=50)
    assert out.shape == shape
    assert np.isfinite(out).all()
    if min(shape[:2]) == 1 and max(shape[:2]) > 1:
        wide = np.repeat(image, 3, axis=shape.index(1))
        assert np.allclose(out, np.take(sharpen(wide, time=50), [1], axis=shape.index(1)), atol=0.3)


def in_straight_steps(potential, time, points, step):
    """Follow -grad(P) / 2 as the paper does: up to the border, or a turn by a right angle."""
    p = potential.astype(np.float64)
    down, across = np.diff(p, axis=0), np.diff(p, axis=1)
    flow = -0.25 * np.stack([down[:, :-1] + down[:, 1:], across[:-1] + across[1:]], axis=-1)
    last = np.array(flow.shape[:2])

    def flow_at(points):
        rows, columns = np.minimum(points.astype(int), last - 1).T
        return flow[rows, columns]

    points, left = points.copy(), np.full(len(points), time)
    walking, velocity = np.arange(len(points)), flow_at(points)
    while len(walking):
        pace = np.minimum(left[walking], step / np.linalg.norm(velocity, axis=1))
        left[walking] -= pace
        ahead = points[walking] + velocity * pace[:, None]
        points[walking] = np.clip(ahead, 0, last)
        came, velocity = velocity, flow_at(points[walking])
        goes_on = (left[walking] > 0) & (ahead == points[walking]).all(axis=1)
        goes_on &= (came * velocity).sum(axis=1) > 0
        walking, velocity = walking[goes_on], velocity[goes_on]
    return points


@pytest.mark.parametrize("scale", [1.0, 30.0])
def test_exact_walk_is_the_limit_of_small_steps(scale):
    image = photo(channels=1)
    potential = image_potential(image, 1.0, GRAY, 1)
    out = np.empty_like(image)
    advect.advect_pixels(image, GRAY, potential, 20.0 * scale, out)
    pixels = np.stack(np.mgrid[1:60:3, 1:52:3], axis=-1).reshape(-1, 2)
    exact = out[pixels[:, 0], pixels[:, 1], 0]
    beside = walk.OFFSET / 2 * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
    starts = (pixels[:, None] + beside).reshape(-1, 2)
    errors = []
    for step in (0.1, 0.02, 0.004):
        ends = in_straight_steps(potential, 20.0 * scale, starts, step)
        read = scipy.ndimage.map_coordinates(image[..., 0], ends.T, order=1)
        errors.append(np.median(abs(read.reshape(-1, 4).mean(axis=1) - exact)))
    assert errors[2] < 0.02 * abs(out - image).mean()
    assert errors[2] < errors[1] / 2 < errors[0] / 4


def test_potential_agrees_with_brute_force():
    image = photo(14, 11, channels=2).astype(np.float32)
    channels = Channels(0, 2, -1, NONE)
    weight = math.exp(-1)

    def smooth(values):
        padded = np.pad(values, 1)
        there = np.pad(np.ones_like(values), 1)
        total, count = values.copy(), np.ones_like(values)
        for dy, dx in ((0, 1), (2, 1), (1, 0), (1, 2)):
            window = slice(dy, dy + len(values)), slice(dx, dx + values.shape[1])
            total += weight * padded[window]
            count += weight * there[window]
        return total / count

    for passes in (0, 1, 3):
        energy = np.zeros((13, 10))
        for c in range(2):
            v = image[..., c].astype(float)
            for _ in range(passes):
                v = smooth(v)
            gx = 0.5 * (v[:-1, 1:] - v[:-1, :-1] + v[1:, 1:] - v[1:, :-1])
            gy = 0.5 * (v[1:, :-1] - v[:-1, :-1] + v[1:, 1:] - v[:-1, 1:])
            energy += gx**2 + gy**2
        expected = np.zeros((14, 11))
        for y in range(14):
            for x in range(11):
                expected[y, x] = energy[max(y - 1, 0) : y + 1, max(x - 1, 0) : x + 1].mean()
        for _ in range(passes):
            expected = smooth(expected)
        found = image_potential(image, 1.0, channels, passes)
        assert np.allclose(found, expected, rtol=1e-4, atol=1e-7)


def test_bands_of_rows_do_not_show():
    # Bands are 16 rows; the same rows in the middle of taller images give the same result.
    image = photo(90, 40)
    whole = sharpen(image, time=5.0)
    part = sharpen(image[21:83], time=5.0)
    assert np.allclose(part[15:-15], whole[36:68], atol=1e-6)


def test_images_mapped_from_disk(tmp_path):
    image = np.rint(photo(70, 50) * 255).astype(np.uint8)
    np.save(tmp_path / "in.npy", image)
    mapped = np.load(tmp_path / "in.npy", mmap_mode="r")
    out = np.lib.format.open_memmap(
        tmp_path / "out.npy", mode="w+", dtype=np.uint8, shape=image.shape
    )
    core.sharpen_image(mapped, out=out)
    out.flush()
    assert np.array_equal(np.load(tmp_path / "out.npy"), core.sharpen_image(image))


@pytest.mark.parametrize(
    ("image", "arguments", "words"),
    [
        (np.zeros((3, 3), np.int32), {}, "uint8"),
        (np.zeros((3, 3)), {"out": []}, "out is of type list"),
        (np.zeros((3, 3)), {"out": np.broadcast_to(0.0, (3, 3))}, "contiguous"),
        (np.zeros((3, 3)), {"mask": np.ma.masked_all((3, 3))}, "masked values"),
        (np.zeros((3, 3), bool), {}, "uint8"),
        (np.zeros((3, 3), complex), {}, "uint8"),
        (np.zeros((0, 3)), {}, "shape"),
        (np.zeros((3, 3, 0)), {}, "shape"),
        (np.zeros(3), {}, "shape"),
        (np.zeros((2, 2, 2, 2)), {}, "shape"),
        (np.array([[0, np.nan], [0, 0]]), {}, "NaN"),
        (np.array([[0, np.inf], [0, 0]]), {}, "infinity"),
        (np.zeros((3, 4)), {"mask": np.zeros((4, 3))}, "mask has the shape"),
        (np.zeros((3, 4)), {"mask": np.full((3, 4), 2.0)}, "0 to 1"),
        (np.zeros((3, 4)), {"mask": np.full((3, 4), np.nan)}, "NaN"),
        (np.zeros((3, 4)), {"out": np.zeros((3, 3))}, "out is"),
        (np.zeros((3, 4)), {"out": np.zeros((3, 4), np.float32)}, "out is"),
    ],
)
def test_bad_input_is_refused(image, arguments, words):
    with pytest.raises(core.InvalidSignal, match=words):
        core.sharpen_image(image, **arguments)


def test_out_must_not_be_the_image():
    image = np.zeros((4, 4))
    with pytest.raises(core.InvalidSignal, match="shares"):
        core.sharpen_image(image, out=image)


def test_progress_rises_to_one_and_cancels():
    image = photo()
    for settings in SCHEMES:
        calls = []
        settings = core.ImageSettings(time=3, **settings)
        core.sharpen_image(image, settings, progress=lambda f, m, c=calls: c.append(f) or True)
        assert calls == sorted(calls)
        assert calls[-1] == 1
        with pytest.raises(core.Cancelled):
            core.sharpen_image(image, settings, progress=lambda f, m: f < 0.3)


class TestOsherRudin:
    @pytest.mark.parametrize("detector", ["gradient", "laplacian", "flow"])
    def test_keeps_the_range_and_constants_and_steepens(self, detector):
        image = photo()
        before = image.copy()
        out = core.osher_rudin_image(image, steps=100, time_step=0.4, edge_detector=detector)
        assert np.array_equal(image, before)
        core.osher_rudin_image(image[..., 0].copy(), steps=3, time_step=0.4, edge_detector=detector)
        assert out.min() >= image.min()
        assert out.max() <= image.max()
        flat = np.full((9, 9), 0.5)
        assert np.array_equal(
            core.osher_rudin_image(flat, steps=10, time_step=0.4, edge_detector=detector), flat
        )
        assert np.array_equal(core.osher_rudin_image(image, steps=0), image)
        if detector != "flow":
            gradient = [np.hypot(*np.gradient(i, axis=(0, 1))).max() for i in (image, out)]
            assert gradient[1] > 2 * gradient[0]

    def test_agrees_with_advection_on_blurred_images(self):
        image = photo(channels=1, sigma=3.0)[..., 0].copy()
        before, time = image.copy(), 20.0
        advected = sharpen(image, time=time, smoothing_passes=0) - image
        evolved = (
            core.osher_rudin_image(image, steps=100, time_step=time / 100, edge_detector="flow")
            - image
        )
        assert np.array_equal(image, before)
        assert np.corrcoef(advected.ravel(), evolved.ravel())[0, 1] > 0.8
        assert np.linalg.norm(evolved) == pytest.approx(np.linalg.norm(advected), rel=0.5)

    @pytest.mark.parametrize(
        ("image", "words", "error", "sentence"),
        [
            (np.zeros((4, 4), np.uint8), {"steps": 1}, core.InvalidSignal, "of float32 or float64"),
            (np.zeros((1, 4)), {"steps": 1}, core.InvalidSignal, "at least 2 x 2"),
            (np.full((4, 4), np.nan), {"steps": 1}, core.InvalidSignal, "holds NaN"),
            (np.zeros((4, 4)), {"steps": -1}, core.InvalidSettings, "steps is -1"),
            (np.zeros((4, 4)), {"steps": 1.5}, core.InvalidSettings, "steps is 1.5"),
            (np.zeros((4, 4)), {"steps": math.nan}, core.InvalidSettings, "steps is nan"),
            (np.zeros((4, 4)), {"steps": math.inf}, core.InvalidSettings, "steps is inf"),
            (
                np.zeros((4, 4)),
                {"steps": 1, "time_step": 0.6},
                core.InvalidSettings,
                r"value in \(0, 0\.5\]",
            ),
            (
                np.zeros((4, 4)),
                {"steps": 1, "time_step": 0, "edge_detector": "flow"},
                core.InvalidSettings,
                r"value in \(0, 1e\+09\]",
            ),
            (
                np.zeros((4, 4)),
                {"steps": 1, "time_step": math.inf, "edge_detector": "flow"},
                core.InvalidSettings,
                "time_step is inf",
            ),
            (
                np.zeros((4, 4)),
                {"steps": 1, "time_step": 0.4, "edge_detector": "sobel"},
                core.InvalidSettings,
                "edge_detector is",
            ),
        ],
    )
    def test_bad_input_is_refused(self, image, words, error, sentence):
        with pytest.raises(error, match=sentence):
            core.osher_rudin_image(image, **words)

    def test_long_steps_of_flow_are_shortened(self):
        image = photo(channels=1) * 4  # so that steps of 8 are cut to below 1
        long = core.osher_rudin_image(image, steps=1, time_step=8.0, edge_detector="flow")
        assert image.min() <= long.min() < long.max() <= image.max()
        # As far in time as steps that are short by themselves; clipped speeds would be 0.68 off.
        short = core.osher_rudin_image(image, steps=400, time_step=0.02, edge_detector="flow")
        assert np.linalg.norm(long - short) < 0.4 * np.linalg.norm(short - image)
        with pytest.raises(core.InvalidSettings, match="too long"):
            core.osher_rudin_image(image, steps=1, time_step=1e9, edge_detector="flow")

    def test_parts_of_a_step_are_half_of_the_fastest_speed(self):
        x = np.linspace(0, 1, 20)
        image = np.tile(3 * x**2, (20, 1))  # L = I_x I_xx, largest at the right
        second = 6 * (x[1] - x[0]) ** 2
        largest = 0.5 * (image[0, -1] - image[0, -3]) * second
        once = core.osher_rudin_image(image, steps=1, time_step=0.5 / largest, edge_detector="flow")
        twice = core.osher_rudin_image(
            image, steps=1, time_step=0.5 / largest * 1.01, edge_detector="flow"
        )
        inner = (slice(None), slice(2, -3))
        slope = np.minimum(np.diff(image, axis=1)[:, :-1], np.diff(image, axis=1)[:, 1:])
        edge = 0.5 * (image[:, 2:] - image[:, :-2]) * second
        expected = image.copy()
        expected[:, 1:-1] -= 0.5 / largest * edge * slope
        np.testing.assert_allclose(once[inner], expected[inner])
        assert not np.allclose(twice[inner], expected[inner], rtol=1e-4)

    def test_cancels(self):
        with pytest.raises(core.Cancelled):
            core.osher_rudin_image(np.zeros((4, 4)), steps=5, progress=lambda f, m: False)


def cell_field(function, height=40, width=50):
    """Vectors (down, across) of a function of (row, column) at the centres of the cells."""
    rows, columns = np.mgrid[: height - 1, : width - 1] + 0.5
    return np.stack(np.broadcast_arrays(*function(rows, columns), rows)[:2], axis=-1).astype(float)


def random_points(count, height=40, width=50, seed=0):
    return np.random.default_rng(seed).uniform((0, 0), (height - 1, width - 1), (count, 2))


def in_small_steps(vectors, time, points, step=1e-3):
    """Follow a field by Euler's method, in the cell that each point is in."""
    points = points.copy()
    last = np.array(vectors.shape[:2], dtype=float)
    for _ in range(round(time / step)):
        rows, columns = np.minimum(points.astype(int), vectors.shape[:2] - np.array(1)).T
        points += step * vectors[rows, columns]
        np.clip(points, 0, last, out=points)
    return points


def test_a_uniform_given_field_is_followed_straight_to_the_border():
    starts = random_points(300)
    vectors = cell_field(lambda y, x: (0.6, -0.4))
    ends, _ = follow(vectors, 20.0, starts)
    # The time until the border is reached, from inside.
    until = np.minimum((39 - starts[:, 0]) / 0.6, starts[:, 1] / 0.4)
    np.testing.assert_allclose(
        ends, starts + np.minimum(until, 20.0)[:, None] * (0.6, -0.4), atol=1e-9
    )
    assert (until < 20).any()
    assert (until > 20).any()


def test_a_given_rotation_keeps_the_distance_from_its_centre():
    # A full turn: more than a right angle, which would end a walk of the shock filter.
    vectors = cell_field(lambda y, x: (x - 20, 20 - y), 41, 41)
    angles = np.linspace(0, 2 * np.pi, 50, endpoint=False)
    for radius in (3.1, 7.7, 12.3):
        circle = radius * np.stack([np.sin(angles), np.cos(angles)], axis=1)
        for turn in (0.7, np.pi, 2 * np.pi):
            ends = follow(vectors, turn, 20 + circle)[0] - 20
            cosine, sine = np.cos(turn), np.sin(turn)
            expected = circle @ np.array([[cosine, -sine], [sine, cosine]])
            assert abs(ends - expected).max() < 0.5  # of a cell


def test_given_fields_are_followed_as_in_small_steps():
    vectors = cell_field(lambda y, x: (np.sin(0.2 * x) + 0.3, np.cos(0.17 * y + 0.1 * x)))
    starts = random_points(200)
    ends, _ = follow(vectors, 12.0, starts)
    inside = ((ends > 0) & (ends < vectors.shape[:2])).all(axis=1)
    assert inside.sum() > 50
    steps = in_small_steps(vectors, 12.0, starts[inside])
    assert np.median(abs(ends[inside] - steps)) < 2e-3
    assert (abs(ends[inside] - steps).max(axis=1) < 0.05).mean() > 0.95


def test_given_fields_slide_where_both_sides_flow_together():
    # Onto the line at row 20 from above at speed 1 and from below at speed 3: the part of each
    # that keeps a point on it is 3/4 of the upper flow and 1/4 of the lower one (Filippov).
    vectors = cell_field(lambda y, x: (np.where(y < 20, 1.0, -3.0), np.where(y < 20, 0.2, 1.0)))
    ends, _ = follow(vectors, 10.0, np.array([[18.0, 5.25], [23.0, 5.25]]))
    along = 0.75 * 0.2 + 0.25 * 1.0
    np.testing.assert_allclose(ends, [[20, 5.65 + 8 * along], [20, 6.25 + 9 * along]])
    # Sliding towards each other from both sides, points rest where they meet.
    sink = cell_field(lambda y, x: (20.0 - y, 25.0 - x))
    np.testing.assert_allclose(follow(sink, 1e6, random_points(100))[0], [[20, 25]] * 100)


def test_walks_that_are_cut_off_are_counted(monkeypatch, caplog):
    image = photo(channels=1)
    potential = image_potential(image, 1.0, GRAY, 1)
    out = np.empty_like(image)
    advect.advect_pixels(image, GRAY, potential, 1e4, out)
    assert not caplog.records
    monkeypatch.setattr(advect, "MOST_STEPS", 2)
    advect.advect_pixels(image, GRAY, potential, 1e4, out)
    (record,) = caplog.records
    assert 100 < record.args[0] <= 4 * out.size
    assert np.isfinite(out).all()


def test_given_fields_that_are_cut_off_are_told():
    starts = np.array([[1.5, 1.5], [37.5, 1.5]])
    _, unfinished = follow(cell_field(lambda y, x: (1.0, 0.0)), 10.0, starts, most_steps=2)
    assert unfinished.tolist() == [True, False]


@pytest.mark.parametrize("name", ["mask", "guide", "image"])
def test_no_result_is_written_over_what_is_given(name):
    image, other = np.random.default_rng(0).random((2, 40, 40))
    words = {"out": image} if name == "image" else {name: other, "out": other}
    given = image[::-1] if name == "image" else image
    with pytest.raises(core.InvalidSignal, match="shares memory"):
        core.sharpen_image(given, core.ImageSettings(time=50.0), **words)
