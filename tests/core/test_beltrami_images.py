# SPDX-License-Identifier: GPL-3.0-or-later
"""The short-time Beltrami kernel on images and parametric manifolds, and its distances."""

import math

import numpy as np
import pytest
import scipy.ndimage
from shock_filter import core
from shock_filter.core import settings as settings_module
from shock_filter.core.base.findings import gathering
from shock_filter.core.base.parallel import run
from shock_filter.core.beltrami import grid_smoothing
from shock_filter.core.beltrami.grid_smoothing import smooth_grid, smooth_rows
from shock_filter.core.grid.geodesics import march, open_band
from shock_filter.core.grid.noise import measure_noise


def photo(height=41, width=37, seed=0, channels=3, noise=0.05):
    """Random blotches with edges and noise, in [0, 1]."""
    rng = np.random.default_rng(seed)
    blotches = scipy.ndimage.gaussian_filter(rng.normal(size=(height, width, channels)), (4, 4, 0))
    return np.clip(0.5 + 0.3 * np.sign(blotches) + noise * rng.normal(size=blotches.shape), 0, 1)


def smooth(image, mask=None, **settings):
    return core.beltrami_image(image, core.BeltramiSettings(**{"beta": 7.0} | settings), mask=mask)


def square(n, size=1.0):
    return np.meshgrid(np.linspace(-size, size, n + 1), np.linspace(-size, size, n + 1))


def sphere(n, shear=0.0):
    u, v = square(n)
    u = u + shear * v
    return np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=-1)


def cone(n, angle=math.pi / 6):
    u, v = square(n)
    s = v + 2
    points = np.stack(
        [s * np.sin(angle) * np.cos(u), s * np.sin(angle) * np.sin(u), s * np.cos(angle)], axis=-1
    )
    u = u * np.sin(angle)
    return points, np.stack([s * np.cos(u), s * np.sin(u), 0 * s], axis=-1)


def great_circle(points, center):
    return 2 * np.arcsin(np.linalg.norm(points - center, axis=-1) / 2)


def distances_on_grid(points, y, x, limit=np.inf, flat=False):
    """Distances from one of a grid of points, by the march that the filters use: (h, w)."""
    height, width = points.shape[:2]
    guide, square = points.astype(np.float32), np.float32(limit**2)
    band, front = open_band(guide, np.float32(flat), square, 0, height)
    march((y + 1) * (width + 2) + x + 1, square, band, front)
    return np.sqrt(front.final.reshape(height + 2, width + 2)[1:-1, 1:-1])


def largest_error(points, exact, radius):
    n = len(points) - 1
    found = distances_on_grid(points, n // 2, n // 2, radius)
    near = exact < 0.95 * radius
    assert np.isfinite(found[near]).all()
    assert np.isinf(found[exact > 1.05 * radius]).all()
    return abs(found - exact)[near].max()


@pytest.mark.parametrize(
    "to_plane",
    [
        [[1, 0], [0, 1]],
        [[1, 2.3], [0, 1]],  # obtuse triangles, to be split
        [[1, -5], [0, 1]],  # and split again
        [[3, 1], [2, 0.5]],
        [[1, 0], [0, 6], [4, 9]],  # a steep image of one channel
    ],
)
def test_distances_on_planes_are_exact(to_plane):
    points = np.stack(square(24), axis=-1) @ np.transpose(to_plane)
    exact = np.linalg.norm(points, axis=-1)
    border = np.concatenate([exact[0], exact[-1], exact[:, 0], exact[:, -1]])
    assert largest_error(points, exact, 0.9 * border.min()) < 1e-6 * exact.max()


@pytest.mark.parametrize("shear, told", [(15, False), (25, True)])
def test_triangles_that_are_not_split_to_the_end_are_told_of(shear, told, caplog):
    x, y = np.meshgrid(*2 * [np.arange(-60.0, 61.0)])
    points = np.stack([x - shear * y, y], axis=-1)
    settings = core.BeltramiSettings(time=3.0, beta=1.0)
    exact = np.linalg.norm(points, axis=-1)
    longer = (distances_on_grid(points, 60, 60, 30.0) - exact)[exact < 28]
    assert longer.min() > -1e-3  # never too short
    assert (longer.max() > 0.1) == told
    guide, ones = points.astype(np.float32), np.ones(points.shape[:2], dtype=np.float32)
    with caplog.at_level("INFO"):
        smooth_grid(guide, guide, False, ones, settings)
    assert ("not to the end" in caplog.text) == told


def order(error, sizes=(16, 32, 64)):
    errors = [error(n) for n in sizes]
    return math.log2(errors[0] / errors[-1]) / math.log2(sizes[-1] / sizes[0])


@pytest.mark.parametrize("shear", [0.0, 1.5])
def test_distances_on_a_sphere_converge(shear):
    def error(n):
        points = sphere(n, shear)
        return largest_error(points, great_circle(points, points[n // 2, n // 2]), 0.4)

    assert error(64) < 1e-3
    assert order(error) >= 0.9


def test_distances_on_a_cone_and_on_a_cylinder_converge_with_order_two():
    def error_on_cone(n):
        points, unrolled = cone(n)
        return largest_error(
            points, np.linalg.norm(unrolled - unrolled[n // 2, n // 2], axis=-1), 0.4
        )

    def error_on_cylinder(n):
        u, v = square(n)
        points = np.stack([np.cos(u), np.sin(u), v], axis=-1)
        return largest_error(points, np.hypot(u, v), 0.9)

    assert order(error_on_cone) >= 1.8
    assert order(error_on_cylinder) >= 1.8


def test_distances_on_a_steep_image_go_around_a_wall():
    wall = np.zeros((31, 31, 1))
    wall[:20, 15] = 100.0
    found = distances_on_grid(wall, 10, 12, 40, flat=True)
    around = math.hypot(10, 3)  # to the wall's end, past it, and back
    assert found[10, 18] == pytest.approx(2 * around, rel=0.1)
    assert found[10, 9] == pytest.approx(3)


def test_without_a_limit_distances_reach_everything():
    found = distances_on_grid(np.stack(square(8), axis=-1), 0, 3)
    assert np.isfinite(found).all()


def test_the_result_does_not_depend_on_what_lies_beyond_the_reach():
    image = photo(70, 30)
    whole = smooth(image, time=1.5, beta=20.0)
    part = smooth(image[11:64], time=1.5, beta=20.0)
    reach = 2 * 7  # twice the kernel's radius: two iterations
    assert np.allclose(part[reach:-reach], whole[11 + reach : 64 - reach], atol=1e-7)


def test_beta_zero_is_gaussian_smoothing(monkeypatch):
    monkeypatch.setattr(settings_module, "CUTOFF", 1e-9)
    image = photo()
    for time in (0.3, 2.0):
        ours = smooth(image, beta=0.0, time=time, iterations=1)
        blur = {"sigma": (math.sqrt(2 * time),) * 2 + (0,), "mode": "constant", "truncate": 8.0}
        weight = scipy.ndimage.gaussian_filter(np.ones_like(image), **blur)
        assert np.allclose(ours, scipy.ndimage.gaussian_filter(image, **blur) / weight, atol=1e-6)


def test_constants_and_ramps_stay():
    flat = np.full((20, 17, 3), 0.4)
    assert np.allclose(smooth(flat, time=1.5), flat, atol=1e-7)
    y, x = np.mgrid[:40, :40]
    ramp = np.stack([0.01 * x + 0.02 * y, 0.5 - 0.03 * x], axis=-1)
    kept = smooth(ramp, alpha="none", time=1.5)
    inside = slice(14, -14)
    assert np.allclose(kept[inside, inside], ramp[inside, inside], atol=1e-6)


def test_a_step_stays_while_noise_falls():
    rng = np.random.default_rng(0)
    step = np.zeros((48, 48))
    step[:, 24:] = 1.0
    assert abs(smooth(step, beta=30.0, time=2.0) - step).max() < 1e-3
    noisy = step + 0.02 * rng.normal(size=step.shape)
    out = smooth(noisy, beta=12.0, time=2.0)
    for side in (slice(0, 24), slice(24, 48)):
        assert out[:, side].var() < noisy[:, side].var() / 4
        assert abs(out[:, side].mean() - noisy[:, side].mean()) < 1e-3


def test_nothing_crosses_a_thin_edge_that_straight_distances_do_not_see():
    image = np.full((30, 31), 0.5)
    image[:, 15] = 1.0
    image[:, 16:] = 0.51
    geodesic = smooth(image, beta=20.0, time=2.0, iterations=1)
    straight = bilateral(image[..., None], 2.0, 20.0, 6)[..., 0]
    assert abs(geodesic - image).max() < 1e-4
    assert abs(straight - image)[:, 14].min() > 2e-3


def test_turning_the_image_or_its_channels_turns_the_result():
    image = photo()
    expected = smooth(image)
    for turned, back in (
        (np.rot90(image), lambda a: np.rot90(a, -1)),
        (image[:, ::-1], lambda a: a[:, ::-1]),
        (image[..., ::-1], lambda a: a[..., ::-1]),
    ):
        assert np.allclose(back(smooth(turned)), expected, atol=1e-5)


def bilateral(image, time, beta, radius):
    total, weight = np.zeros_like(image), np.zeros(image.shape[:2])
    padded = np.pad(image, ((radius, radius), (radius, radius), (0, 0)), constant_values=np.nan)
    height, width = weight.shape
    for dy in range(-radius, radius + 1):
        for dx in range(-radius, radius + 1):
            there = padded[radius + dy :, radius + dx :][:height, :width]
            far = dy**2 + dx**2 + beta**2 * ((there - image) ** 2).sum(axis=2)
            share = np.nan_to_num(np.exp(-far / (4 * time)))
            weight += share
            total += share[..., None] * np.nan_to_num(there)
    return total / weight[..., None]


def in_window(image, half, time, beta):
    """Apply the kernel once to (h, w, c), no farther than so many pixels each way, as on tiles."""
    rows = np.arange(len(image))[:, None] + [-half, half + 1]
    out = np.empty_like(image)
    run(
        smooth_rows, len(image), image, (beta * image).astype(np.float32), np.float32(1),
        np.ones(image.shape[:2], np.float32), np.float32(core.BeltramiSettings(time=time).limit),
        np.float32(0.25 / time), half, np.clip(rows, 0, len(image)),
        np.zeros(len(image), np.int64), np.zeros((0, 0), np.bool_), out, chunk=16,
    )  # fmt: skip
    return out


def test_a_window_bounds_the_kernel():
    image = np.zeros((25, 25, 1))
    image[12, 12] = 1.0
    box = np.zeros_like(image, dtype=bool)
    box[9:16, 9:16] = True
    assert (smooth(image, beta=0.0, time=3.0, iterations=1)[12, 7:18] > 0).all()
    assert np.array_equal(in_window(image, 3, 3.0, 0.0) > 0, box)
    assert np.array_equal(in_window(image, 0, 3.0, 0.0), image)
    assert np.array_equal(in_window(image[12:, 12:].copy(), 3, 3.0, 0.0) > 0, box[12:, 12:])


@pytest.mark.parametrize("half", [0, 1, 3])
def test_no_way_leads_out_of_the_window_on_steep_images(half):
    # Obtuse triangles are split by ways to pixels that are farther than a neighbour.
    noise = np.random.default_rng(0).random((25, 27, 2))
    mark = np.ones((25, 27, 1))
    mark[12 - half : 13 + half, 12 - half : 13 + half] = 0
    image = np.concatenate([noise, 1e-9 * mark], axis=2)
    out = in_window(image, half, 100.0, 30.0)
    assert out[12, 12, 2] == 0
    assert (out[12, 13 + half :, 2] > 0).all()


def test_small_weights_count_as_nothing(monkeypatch):
    monkeypatch.setattr(settings_module, "CUTOFF", math.exp(-9.001 / 4))
    image = np.zeros((25, 25))
    image[12, 12] = 1.0
    out = smooth(image, beta=0.0, time=1.0, iterations=1)
    far = np.hypot(*(np.mgrid[:25, :25] - 12))
    assert np.array_equal(out > 0, far <= 3)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
@pytest.mark.parametrize("shape", [(9, 7), (9, 7, 1), (9, 7, 2), (9, 7, 4), (1, 7, 3), (1, 1)])
def test_zero_time_and_zero_mask_return_the_input_bit_for_bit(dtype, shape):
    rng = np.random.default_rng(0)
    image = (rng.random(shape) * (1 if np.dtype(dtype).kind == "f" else 200)).astype(dtype)
    before = image.copy()
    for out in (smooth(image, time=0), smooth(image, np.zeros(shape[:2]))):
        assert np.array_equal(out, before)
        assert out.dtype == dtype
        assert not np.may_share_memory(out, image)
    changed = smooth(image)
    assert (changed.shape, changed.dtype) == (shape, dtype)
    assert np.array_equal(image, before)


def test_a_mask_mixes_with_the_input():
    image = photo()
    mask = np.zeros(image.shape[:2])
    mask[:20] = 0.5
    full, out = smooth(image), smooth(image, mask)
    assert np.array_equal(out[20:], image[20:])
    assert np.allclose(out[:20], 0.5 * (image + full)[:20])


def test_values_stay_in_range_and_far_beyond_one():
    image = photo(noise=0.3)
    out = smooth(image, time=4.0)
    assert (out.min(axis=(0, 1)) >= image.min(axis=(0, 1)) - 1e-7).all()
    assert (out.max(axis=(0, 1)) <= image.max(axis=(0, 1)) + 1e-7).all()
    bright = 1e4 * photo(noise=0)
    assert np.allclose(smooth(bright), bright, rtol=1e-5)


def test_values_beyond_float32_do_no_harm():
    image = 1e300 * photo()
    out = smooth(image)
    assert image.min() <= out.min() <= out.max() <= image.max()


def test_bright_values_stay_finite():
    image = 1e20 * photo(channels=1)
    for beta in (1e-6, 1e-10):
        out = smooth(image.astype(np.float32), beta=beta)
        assert image.min() * 0.999 <= out.min() <= out.max() <= image.max() * 1.001


def test_whole_numbers_agree_with_floats_up_to_rounding():
    image = photo()
    for dtype, top in ((np.uint8, 255), (np.uint16, 65535)):
        whole = np.rint(image * top).astype(dtype)
        exact = smooth(whole / top) * top
        assert abs(smooth(whole) - exact).max() <= 0.5 + 1e-3 * top / 255


def test_opacity_stays_and_transparent_pixels_lend_no_color():
    image = np.zeros((40, 40, 4), dtype=np.float32)
    distance = np.hypot(*(np.mgrid[:40, :40] - 19.5))
    image[..., 3] = np.clip((15 - distance) / 4, 0, 1)
    image[..., 0] = 0.5
    hidden = image[..., 3] == 0
    image[hidden, 1] = 1.0  # garish, and never seen
    out = smooth(image, beta=1.0)
    assert np.array_equal(out[..., 3], image[..., 3])
    assert out[~hidden, 1].max() < 1e-6
    assert np.allclose(out[~hidden, 0], 0.5, atol=1e-6)
    bled = smooth(image, beta=1.0, alpha="none")
    assert bled[~hidden, 1].max() > 0.1
    assert not np.array_equal(bled[..., 3], image[..., 3])


def test_bad_input_is_refused():
    image = photo()
    broken = image.copy()
    broken[3, 4, 1] = np.nan
    with pytest.raises(core.InvalidSignal, match="NaN"):
        core.beltrami_image(broken)
    with pytest.raises(core.InvalidSignal, match="type"):
        core.beltrami_image(np.zeros((4, 4), dtype=int))
    with pytest.raises(core.InvalidSignal, match="mask"):
        core.beltrami_image(image, mask=np.zeros(3))
    points = sphere(8)
    with pytest.raises(core.InvalidSignal, match="embedding has the shape"):
        core.beltrami_manifold(image, points)
    with pytest.raises(core.InvalidSignal, match="embedding holds NaN"):
        core.beltrami_manifold(points, np.full_like(points, np.nan))
    with pytest.raises(core.InvalidSignal, match="one; give a surface"):
        core.beltrami_manifold(points, np.ones_like(points))
    with pytest.raises(core.InvalidSignal, match="scale it down"):
        core.beltrami_manifold(points, 1e200 * points)
    with pytest.raises(core.InvalidSettings, match="choose one of"):
        core.beltrami_manifold(points, points, smooth="colors")


def test_wide_kernels_are_cut_into_small_chunks(monkeypatch):
    chunks = []

    def run(*arguments, chunk):
        chunks.append(chunk)
        arguments[-1][:] = 0.0  # the result

    monkeypatch.setattr(grid_smoothing, "run", run)
    image = np.zeros((64, 4000), dtype=np.float32)
    for time in (0.1, 10.0, 100.0):
        smooth(image, iterations=1, time=time)
    assert chunks == [16, 1, 1]


def test_runs_can_be_cancelled():
    fractions = []

    def progress(fraction, message):
        fractions.append(fraction)
        return fraction < 0.4

    image = photo(200, 40)
    with pytest.raises(core.Cancelled):
        core.beltrami_image(image, progress=progress)
    assert fractions[-1] < 0.7
    seen = []
    core.beltrami_image(image, progress=lambda fraction, message: seen.append(fraction))
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


def test_a_flat_manifold_is_an_image():
    image = photo()
    y, x = np.mgrid[: image.shape[0], : image.shape[1]].astype(float)
    flat = np.stack([0.1 * y, 5 - 0.1 * x, 0 * x], axis=-1)  # turned, shifted, another unit
    out, embedding = core.beltrami_manifold(image, flat)
    assert np.allclose(out, smooth(image), atol=1e-5)
    assert np.array_equal(embedding, flat)


def test_a_fold_of_the_manifold_is_an_edge_of_the_image():
    # A faint edge on a fold of the surface; the fold is far across, the image alone is not.
    y, x = np.mgrid[:40, :40].astype(float)
    cliff = np.stack([x, y, np.where(x < 20, 0.0, 30.0)], axis=-1)
    step = np.where(x < 20, 0.4, 0.6)
    noisy = step + 0.05 * np.random.default_rng(0).normal(size=step.shape)
    settings = core.BeltramiSettings(beta=2.0, time=1.0, iterations=3)
    painted, _ = core.beltrami_manifold(noisy, cliff, settings)
    flat = core.beltrami_image(noisy, settings)
    assert np.sqrt(((painted - step) ** 2).mean()) < 0.5 * np.sqrt(((flat - step) ** 2).mean())


def test_components_are_smoothed_as_chosen():
    rng = np.random.default_rng(0)
    points = sphere(30)
    noisy = points + 0.01 * rng.normal(size=points.shape)
    clean = np.where(points[..., 1] > 0, 0.2, 0.8)[..., None] * [1.0, 0.5, 1.0]
    image = clean + 0.05 * rng.normal(size=clean.shape)
    settings = core.BeltramiSettings(beta=5.0, time=0.5)
    both = core.beltrami_manifold(image, noisy, settings, smooth="both")
    colors = core.beltrami_manifold(image, noisy, settings, smooth="image")
    surface = core.beltrami_manifold(image, noisy, settings, smooth="embedding")
    assert np.array_equal(colors[1], noisy)
    assert np.array_equal(surface[0], image)
    inside = slice(3, -3)
    for result in (both, surface):
        radii = np.linalg.norm(result[1], axis=2)[inside, inside]
        assert radii.std() < 0.5 * np.linalg.norm(noisy, axis=2).std()
    for result in (both, colors):
        assert (result[0] - clean).std() < 0.5 * (image - clean).std()


def test_a_pole_where_points_meet_is_no_obstacle():
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 33), np.linspace(0, np.pi / 2, 17))
    points = np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], axis=-1)
    image = points[..., 0] + 2
    out, _ = core.beltrami_manifold(image, points, core.BeltramiSettings(beta=0.0))
    assert np.isfinite(out).all()
    assert np.ptp(out[0]) < 1e-3
    assert abs(out - image).max() < 0.1


def test_times_that_would_take_a_day_are_refused():
    with pytest.raises(core.InvalidSettings, match="from 0 to 100"):
        core.BeltramiSettings(time=1e4)


def test_opacity_below_zero_counts_as_none():
    rng = np.random.default_rng(0)
    image = rng.random((24, 24, 4)).astype(np.float32)
    image[..., 3] -= 0.4
    out = core.beltrami_image(image)
    assert np.array_equal(out[..., 3], image[..., 3])
    assert image[..., :3].min() <= out[..., :3].min()
    assert out[..., :3].max() <= image[..., :3].max()


def textured(channels=3):
    """Blotches with soft edges and stripes in a half, (96, 96, channels) in [0, 1]."""
    clean = photo(24, 24, seed=4, channels=channels, noise=0.0).repeat(4, 0).repeat(4, 1)
    stripes = 0.03 * np.sin(np.arange(48) / 1.5)
    clean[48:] += stripes[:, None, None]
    return scipy.ndimage.gaussian_filter(clean, (1.0, 1.0, 0))


def rms(difference):
    return math.sqrt(np.square(difference).mean())


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("strength", [0.012, 0.03, 0.1])
def test_beta_follows_from_the_noise(channels, strength):
    clean = textured(channels)
    noise = strength * np.random.default_rng(5).normal(size=clean.shape)
    assert measure_noise(clean + noise, 1.0, -1) == pytest.approx(strength, rel=0.25)
    assert rms(core.beltrami_image(clean + noise) - clean) < 0.75 * strength


def test_clean_images_hardly_change():
    clean = textured()
    assert rms(core.beltrami_image(clean) - clean) < 0.005
    even = np.full((40, 40, 3), 0.3)
    np.testing.assert_allclose(core.beltrami_image(even), even, atol=1e-7)
    assert np.isfinite(core.beltrami_image(1e30 * clean)).all()
    with pytest.raises(core.InvalidSignal, match="holds values beyond 1e\\+30; scale or clip them"):
        core.beltrami_image(1e200 * clean)  # its noise cannot be measured


def test_more_noise_changes_gradually():
    clean = textured()
    noise = np.random.default_rng(6).normal(size=clean.shape)
    sizes = [
        rms(core.beltrami_image(clean + s * noise) - clean - s * noise)
        for s in np.arange(0, 0.1, 0.005)
    ]
    assert np.diff(sizes).min() > -0.001
    assert np.diff(sizes).max() < 0.009


def test_what_is_transparent_is_not_measured():
    noise = 0.05 * np.random.default_rng(7).normal(size=(96, 96, 3))
    image = np.concatenate([0.5 + noise, np.ones((96, 96, 1))], axis=2)
    image[:60] = 0.0
    assert measure_noise(image, 1.0, 3) == pytest.approx(0.05, rel=0.25)


def test_turned_images_have_the_same_noise():
    image = photo(84, 42, channels=4)
    image[:50, :20] = 0.0
    noise = measure_noise(image, 1.0, 3)
    for turned in (np.rot90(image), np.rot90(image, 2), np.rot90(image, 3), image[:, ::-1]):
        assert measure_noise(turned, 1.0, 3) == pytest.approx(noise, rel=1e-9)


def test_values_cut_at_the_ends_of_the_range_are_made_up_for():
    noise = 0.05 * np.random.default_rng(8).normal(size=(96, 96, 1))
    assert measure_noise(np.maximum(noise, 0.0), 1.0, -1) == pytest.approx(0.05, rel=0.3)


def test_lines_of_pixels_have_no_noise_to_measure():
    line = photo(1, 60)
    np.testing.assert_array_equal(core.beltrami_image(line), smooth(line))


def test_the_measured_noise_is_told():
    with gathering() as findings:
        core.beltrami_image(photo(48, 48, noise=0.05))
    assert str(findings[0]).startswith("Noise of ")


def test_no_number_is_told_of_hardly_any_noise():
    y, x = np.mgrid[:96, :96] / 96
    with gathering() as findings:
        core.beltrami_image(np.stack([x * y] * 3, axis=-1))
    assert [str(each) for each in findings] == ["Hardly any noise was found."]
