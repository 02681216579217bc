# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of stitching: one texture of several pictures, or of charts that differ."""

import numpy as np
import pytest
from atlases import Blocks, sample
from scipy.ndimage import binary_dilation, distance_transform_edt
from shapes import cube, grid
from shock_filter import core
from shock_filter.core.base.findings import gathering
from shock_filter.core.elements.multigrid import SheetSolver
from shock_filter.core.stitch import design, light, stitching


def picture(n, channels=3):
    """Waves that end flat at the sides of a square."""
    y, x = (np.mgrid[:n, :n] + 0.5) / n * np.pi
    waves = [np.cos((2 + c) * x) * np.cos((4 - c) * y) for c in range(channels)]
    return (0.5 + 0.3 * np.stack(waves, axis=-1)).astype(np.float32)


def of_square(n, angle=0.4):
    blocks = Blocks(picture(n), angle)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    return blocks, mesh, blocks.texture()


def inside_of(mesh, blocks):
    return core.TextureAtlas(mesh, blocks.uv, size=(blocks.width, blocks.width))


def with_steps(mesh, blocks, image, size=0.2):
    """The image with another constant added in each chart."""
    chart = inside_of(mesh, blocks).masks().chart
    steps = size * np.random.default_rng(0).uniform(-1, 1, chart.max() + 1)
    return np.where(chart >= 0, steps[chart], 0.0)[..., None].astype(np.float32) + image


def plain(n=32):
    vertices, faces = grid(1, 1)
    return core.TriangleMesh(vertices * n, faces), vertices[faces][..., :2]


@pytest.mark.parametrize("angle", [None, 0.4])
def test_charts_of_different_brightness_become_one(angle):
    blocks, mesh, image = of_square(64, angle)
    broken = with_steps(mesh, blocks, image)
    settings = core.StitchSettings(radius=1e5)
    result = core.stitch_textures(mesh, blocks.uv, broken, settings)
    inside = inside_of(mesh, blocks).inside
    before, error = ((pixels - image)[inside] for pixels in (broken, result))
    assert np.std(before) > 0.1
    assert np.abs(error.mean(axis=0) - before.mean(axis=0)).max() < 0.01
    error -= error.mean(axis=0)
    assert np.sqrt(np.mean(error**2)) < 0.01
    points = np.random.default_rng(0).uniform(2, 62, size=(4000, 2))
    off = blocks.read(result, points) - sample(blocks.picture, points / 64)
    off -= off.mean(axis=0)
    assert np.quantile(np.abs(off), 0.99) < 0.03


@pytest.mark.parametrize(
    ("of", "even_out", "said"),
    [
        ("factors", "auto", ["Even Out: Auto took factors of brightness, which keep black."]),
        ("steps", "auto", ["Even Out: Auto took differences, which are added."]),
        ("factors", "brightness", []),
        ("factors", "difference", []),
        ("below 0", "brightness",
         ["Factors of brightness need values above 0; differences were added instead."]),
    ],
)  # fmt: skip
def test_what_auto_chose_is_said(of, even_out, said):
    blocks, mesh, image = of_square(32)
    broken = with_steps(mesh, blocks, image)
    if of == "factors":
        broken = image * np.exp(2 * (broken - image))
    if of == "below 0":
        broken -= 1
    with gathering() as found:
        core.stitch_textures(mesh, blocks.uv, broken, core.StitchSettings(even_out=even_out))
    assert [str(each) for each in found] == said


def test_a_texture_without_steps_stays():
    blocks, mesh, image = of_square(64)
    result = core.stitch_textures(mesh, blocks.uv, image)
    inside = inside_of(mesh, blocks).inside
    # Next to corners of charts, where little tells how values go on, it moves a little.
    assert np.quantile(np.abs(result - image)[inside], 0.99) < 0.01
    assert np.sqrt(np.mean((result - image)[inside] ** 2)) < 0.003


def test_pictures_that_are_the_same_give_that_picture():
    mesh, uv = plain()
    image = picture(32)
    trust = np.random.default_rng(0).random((2, 32, 32)) + 0.1
    for given in ({}, {"confidences": trust}):
        settings = core.StitchSettings(radius=5.0)
        result = core.stitch_textures(mesh, uv, [image, image], settings, **given)
        assert np.abs(result - image).max() < 1e-5


@pytest.mark.parametrize("as_labels", [False, True])
def test_the_step_between_two_pictures_vanishes(as_labels):
    mesh, uv = plain()
    image = np.tile(np.linspace(0.1, 0.5, 32), (32, 1))
    left = np.tile(np.arange(32) < 16, (32, 1))
    given = {"labels": (~left).astype(int)} if as_labels else {"confidences": [left, ~left]}
    settings = core.StitchSettings(radius=1e4)
    result = core.stitch_textures(mesh, uv, [image, image + 0.4], settings, **given)
    slope = np.diff(result[16])
    assert slope.max() < 1.2 * np.diff(image[0]).max()
    assert np.abs(np.delete(slope, 15) - 0.4 / 31).max() < 1e-3


def test_steps_between_labels_of_one_picture_vanish():
    mesh, uv = plain()
    image = np.tile(np.linspace(0.1, 0.5, 32), (32, 1))
    right = np.tile(np.arange(32) >= 16, (32, 1))
    settings = core.StitchSettings(radius=1e4, even_out="difference")
    broken = image + 0.4 * right
    result = core.stitch_textures(mesh, uv, broken, settings, labels=7 * right)
    slope = np.diff(result, axis=1)
    assert np.abs(np.delete(slope, 15, axis=1) - 0.4 / 31).max() < 5e-3
    assert np.abs(slope[:, 15]).max() < 0.5 / 31  # where nothing is known
    without = core.stitch_textures(mesh, uv, broken, settings)
    assert np.abs(without - broken).max() < 1e-3


def test_labels_that_cross_seams_hide_their_steps():
    blocks, mesh, image = of_square(64)
    atlas = inside_of(mesh, blocks)
    right = atlas.bake(mesh.vertices[mesh.faces])[..., 0] > 30
    settings = core.StitchSettings(radius=1e5)
    broken = image + np.float32(0.3) * right[..., None]
    result = core.stitch_textures(mesh, blocks.uv, broken, settings, labels=right.astype(int))
    error = (result - image)[atlas.inside]
    error -= error.mean(axis=0)
    # Along the step the slope is unknown, and so lost.
    assert np.sqrt(np.mean(error**2)) < 0.04


def test_what_nobody_knows_is_filled_smoothly():
    mesh, uv = plain()
    image = np.tile(np.linspace(0.0, 1.0, 32), (32, 1))
    known = np.ones((32, 32))
    known[:, 10:20] = 0.0
    broken = np.where(known > 0, image, 77.0)
    settings = core.StitchSettings(radius=3.0)
    result = core.stitch_textures(mesh, uv, broken, settings, confidences=[known])
    assert np.abs(result[:, :8] - image[:, :8]).max() < 0.1
    row = result[16, 9:21]
    assert (np.diff(row) > 0).all()
    assert np.abs(np.diff(row, 2)).max() < 0.2 * np.ptp(row)


def test_a_change_fades_across_faces_without_texels():
    # Between two squares lies a strip that has no area in the texture. What takes away the step
    # within the first square fades on the strip as it does elsewhere, and so reaches the second.
    n, gap, radius = 24, 12.0, 12.0
    vertices, faces = grid(3, 1)
    column = vertices[:, 0].astype(int)
    uv = np.stack([np.array([0.0, 0.5, 0.5, 1.0])[column], vertices[:, 1]], axis=-1)[faces]
    x = np.array([0.0, n, n + gap, 2 * n + gap])
    mesh = core.TriangleMesh(np.stack([x[column], n * vertices[:, 1], 0 * column], axis=-1), faces)
    bright = np.tile(np.arange(2 * n) >= n // 2, (n, 1))
    image = np.where(bright, 0.7, 0.3)
    settings = core.StitchSettings(radius=radius, even_out="difference")
    result = core.stitch_textures(mesh, uv, image, settings, labels=bright.astype(int))
    place = np.arange(2 * n) + 0.5 + np.where(np.arange(2 * n) >= n, gap, 0.0)
    shape = np.cosh((x[-1] - place) / radius)  # u'' = u / radius^2, and u' = 0 at the end
    change = (result - image).mean(axis=0)
    ratio = change / change[n - 1] / (shape / shape[n - 1])
    assert np.abs(ratio[n // 2 + 2 :] - 1).max() < 0.05
    assert np.abs(change[-1]) > 0.005


def test_opacity_says_what_is_known():
    mesh, uv = plain()
    image = np.tile(np.linspace(0.1, 0.5, 32), (32, 1))
    left = np.tile(np.arange(32) < 20, (32, 1)).astype(float)
    right = np.tile(np.arange(32) >= 12, (32, 1)).astype(float)
    pictures = [np.stack([np.where(seen > 0, image, 9.0), seen], axis=-1) for seen in (left, right)]
    result = core.stitch_textures(mesh, uv, pictures)
    assert np.abs(result[..., 0] - image).max() < 1e-3
    assert (result[..., 1] == 1.0).all()


def test_what_lies_beside_the_charts_does_not_count():
    blocks, mesh, image = of_square(32)
    broken = with_steps(mesh, blocks, image)
    inside = inside_of(mesh, blocks).inside
    results = [
        core.stitch_textures(mesh, blocks.uv, np.where(inside[..., None], broken, paint))
        for paint in (np.float32(0.0), np.float32(1e5))
    ]
    assert (results[0][inside] == results[1][inside]).all()


def test_at_seams_alone_the_rest_stays():
    blocks, mesh, image = of_square(64)
    broken = with_steps(mesh, blocks, image)
    settings = core.StitchSettings(where="seams")
    result = core.stitch_textures(mesh, blocks.uv, broken, settings)
    along = np.random.default_rng(1).uniform(1, 63, size=1000)
    across, off = np.stack([np.full(1000, 32.0), along], axis=1), np.array([1e-6, 0.0])
    jumps = [
        np.abs(blocks.read(pixels, across - off) - blocks.read(pixels, across + off)).mean()
        for pixels in (broken, result)
    ]
    assert jumps[0] > 0.05
    assert jumps[1] < 0.1 * jumps[0]
    middle = np.stack(np.meshgrid([8.0, 24.0, 40.0, 56.0], [8.0, 24.0, 40.0, 56.0]), axis=-1)
    assert np.abs(blocks.read(result - broken, middle.reshape(-1, 2))).max() < 1e-6


def test_many_stretched_charts_are_stitched_in_few_iterations(monkeypatch):
    # Each square of a grid is a chart.
    count, size = 16, 96
    vertices, faces = grid(count, count)
    places = vertices[faces][..., :2]
    squares = np.floor(places.mean(axis=1, keepdims=True)) + 0.5
    uv = (squares + 0.7 * (places - squares)) / count
    mesh = core.TriangleMesh(vertices * [30.0, 1.0, 1.0], faces)
    shades = np.random.default_rng(0).uniform(0.3, 0.7, (count, count))
    image = np.kron(shades, np.ones((size // count, size // count))).astype(np.float32)
    found = []

    class Solver(SheetSolver):
        def solve(self, *values, **words):
            report = super().solve(*values, **words)
            found.append((report.iterations, self._levels[0]))

    monkeypatch.setattr(stitching, "SheetSolver", Solver)
    settings = core.StitchSettings(where="seams", seams="continue", even_out="difference")
    core.stitch_textures(mesh, uv, image, settings)
    iterations, level = found[0]
    assert 0 < iterations <= 6  # without factors about ten times as many
    assert len(level.block._factors.values) <= 40 * len(level.rows.unknowns)


@pytest.mark.parametrize("angle", [None, 0.4])
@pytest.mark.parametrize("where", ["everywhere", "seams"])
def test_what_nobody_knows_takes_the_color_around_it(angle, where):
    # Also at corners of charts, where points on seams are unknown, too.
    blocks, mesh, image = of_square(48, angle)
    known = np.ones(image.shape[:2])
    known[10:30, 10:40] = known[-20:, -20:] = 0.0
    given = np.where(known[..., None] > 0, np.float32(0.7), np.float32(9.0)) + 0 * image
    settings = core.StitchSettings(where=where)
    found = core.stitch_textures(mesh, blocks.uv, given, settings, confidences=[known])
    inside = inside_of(mesh, blocks).inside
    assert np.abs(found - 0.7)[inside].max() < 2e-3


@pytest.mark.parametrize("even_out", ["brightness", "difference", "auto"])
@pytest.mark.parametrize("where", ["everywhere", "seams"])
@pytest.mark.parametrize("as_opacity", [False, True])
def test_parts_of_which_nothing_is_known_stay(even_out, where, as_opacity):
    # Two squares that share no point; of the second, nothing is known.
    vertices, faces = grid(1, 1)
    mesh = core.TriangleMesh(
        np.concatenate([24 * vertices, 24 * vertices + 99.0]), np.concatenate([faces, faces + 4])
    )
    half = 0.45 * vertices[faces][..., :2] + 0.025
    uv = np.concatenate([half * [1.0, 2.0], half * [1.0, 2.0] + [0.5, 0.0]])
    image = np.tile(np.linspace(0.3, 0.6, 64), (64, 1))[..., None]
    image = np.concatenate([image, image**2, 0 * image + 1.0], axis=-1).astype(np.float32)
    known = np.tile(np.arange(64) < 32, (64, 1)).astype(np.float32)
    settings = core.StitchSettings(even_out=even_out, where=where)
    if as_opacity:
        found = core.stitch_textures(mesh, uv, np.dstack([image, known]), settings)[..., :3]
    else:
        found = core.stitch_textures(mesh, uv, image, settings, confidences=[known])
    inside = core.TextureAtlas(mesh, uv, size=(64, 64)).inside
    assert inside[:, 32:].any()
    np.testing.assert_allclose(found[inside], image[inside], atol=1e-3)
    other = inside & (known == 0)
    np.testing.assert_array_equal(found[other], image[other])


def test_a_mask_keeps_the_first_picture():
    mesh, uv = plain()
    image = picture(32)
    mask = np.zeros((32, 32))
    mask[:, 16:] = 1.0
    result = core.stitch_textures(mesh, uv, [image, image + 0.2], mask=mask)
    assert (result[:, :16] == image[:, :16]).all()
    assert np.abs(result - image)[:, 16:].min() > 0.05


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_whole_numbers_come_back(dtype):
    blocks = Blocks(picture(32), 0.4)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    image = (blocks.texture() * np.iinfo(dtype).max).astype(dtype)
    result = core.stitch_textures(mesh, blocks.uv, [image, image])
    assert result.dtype == dtype
    assert result.shape == image.shape


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"images": []}, "no image"),
        ({"images": [np.zeros((8, 8)), np.zeros((8, 9))]}, "one size"),
        ({"images": [np.zeros((8, 8)), np.zeros((8, 8), np.uint8)]}, "one size and type"),
        ({"images": [np.full((8, 8), np.nan)]}, "NaN"),
        ({"confidences": [np.ones((8, 8))]}, "1 confidences for 2"),
        ({"confidences": [np.ones((8, 8)), np.ones((7, 8))]}, "shape"),
        ({"confidences": [np.ones((8, 8)), -np.ones((8, 8))]}, "negative"),
        ({"labels": np.zeros((8, 8))}, "whole numbers"),
        ({"labels": np.full((8, 8), 2)}, "count from 0"),
        ({"confidences": [np.zeros((8, 8))] * 2}, "Nothing is known"),
        ({"labels": np.full((8, 8), -1)}, "Nothing is known"),
        ({"labels": np.zeros((8, 8), int), "confidences": [np.ones((8, 8))] * 2}, "one of them"),
    ],
)
def test_what_does_not_fit_is_named(given, words):
    mesh, uv = plain(8)
    images = given.pop("images", [np.zeros((8, 8)), np.ones((8, 8))])
    with pytest.raises(core.InvalidSignal, match=words):
        core.stitch_textures(mesh, uv, images, **given)


def test_parts_that_share_an_edge_of_three_sheets_become_one():
    _, faces = grid(4, 4)
    flat, _ = grid(4, 4)
    sheets, corners, uv = [], [], []
    for number, angle in enumerate((0.0, 2.0, 4.0)):
        points = flat * 4.0
        x, y = points[:, 0], points[:, 1]
        sheets.append(np.stack([x * np.cos(angle), y, x * np.sin(angle)], axis=-1))
        corners.append(faces + number * len(flat))
        uv.append(points[faces][..., :2] / 4.0 / flat.max() * 0.25 + [0.05 + 0.3 * number, 0.05])
    kept, index = core.weld(np.round(np.concatenate(sheets), 9))
    mesh = core.TriangleMesh(np.concatenate(sheets)[kept], index[np.concatenate(corners)])
    uv = np.concatenate(uv)
    image = np.zeros((64, 64))
    for number in range(3):
        image[:, 64 * number // 3 : 64 * (number + 1) // 3] = 0.2 + 0.3 * number
    inside = core.TextureAtlas(mesh, uv, size=(64, 64)).inside
    settings = core.StitchSettings(radius=1e4, seams="continue")
    result = core.stitch_textures(mesh, uv, image, settings)
    assert np.ptp(result[inside]) < 0.02


def with_factors(mesh, blocks, image, channels=1):
    """The image with each chart in another light."""
    chart = inside_of(mesh, blocks).masks().chart
    factors = np.random.default_rng(1).uniform(0.6, 1.4, (chart.max() + 1, channels))
    return np.where((chart >= 0)[..., None], factors[chart], 1.0).astype(np.float32) * image


def rms_but_for_one_factor(result, image, inside):
    ratio = (image[inside] * result[inside]).sum(0) / (result[inside] ** 2).sum(0)
    return float(np.sqrt(np.mean((ratio * result - image)[inside] ** 2)))


@pytest.mark.parametrize("channels", [1, 3])
def test_charts_in_different_light_become_one_and_black_stays_black(channels):
    spotted = picture(64)
    spotted[38:43, 38:43] = 0.0
    blocks = Blocks(spotted, 0.4)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    image, inside = blocks.texture(), inside_of(mesh, blocks).inside
    broken = with_factors(mesh, blocks, image, channels)
    off = {
        by: core.stitch_textures(
            mesh, blocks.uv, broken, core.StitchSettings(radius=1e5, even_out=by)
        )
        for by in ("difference", "brightness", "auto")
    }
    assert (off["auto"] == off["brightness"]).all()
    errors = {by: rms_but_for_one_factor(result, image, inside) for by, result in off.items()}
    assert errors["brightness"] < 0.1 * errors["difference"]
    black = inside & (image.max(axis=-1) < 1e-6)
    assert black.any()
    assert off["brightness"][black].max() < 1 / 255
    assert off["brightness"].min() >= 0


def test_charts_that_differ_by_sums_are_told_from_others():
    blocks, mesh, image = of_square(64)
    broken = np.maximum(with_steps(mesh, blocks, image, 0.15), 0.01)
    auto, summed = (
        core.stitch_textures(mesh, blocks.uv, broken, core.StitchSettings(even_out=by))
        for by in ("auto", "difference")
    )
    assert (auto == summed).all()


def test_between_factors_and_offsets_both_count():
    blocks, mesh, image = of_square(64)
    factors, offsets = with_factors(mesh, blocks, image), with_steps(mesh, blocks, image, 0.15)
    mixed = [
        np.maximum(share * factors + (1 - share) * offsets, 0.01).astype(np.float32)
        for share in np.linspace(0.0, 1.0, 9)
    ]

    def results(broken):
        return [
            core.stitch_textures(mesh, blocks.uv, broken, core.StitchSettings(even_out=by))
            for by in ("auto", "difference", "brightness")
        ]

    kinds = set()
    for auto, summed, multiplied in map(results, mixed):
        low, high = np.minimum(summed, multiplied), np.maximum(summed, multiplied)
        assert (auto >= low - 1e-5).all()
        assert (auto <= high + 1e-5).all()
        kinds.add("sum" if (auto == summed).all() else "product" if (auto == multiplied).all()
                  else "both")  # fmt: skip
    assert kinds >= {"sum", "product"}


@pytest.mark.parametrize(("off", "share"), [(1.04, 1.0), (1.075, 0.5), (1.2, 0.0)])
def test_the_share_of_factors_falls_with_what_they_leave(monkeypatch, off, share):
    monkeypatch.setattr(light, "_at_seams", lambda space, corners: iter([]))
    monkeypatch.setattr(light, "_unexplained", lambda a, b, group: (1e3, off * 1e3))
    values = [np.full((4, 1), 0.5, np.float32)] * 2
    known = [np.ones(4, bool)] * 2
    found = light.share_of_factors(None, values, [], known, 0.0)
    assert found == pytest.approx(share, abs=1e-3)


def test_values_below_zero_take_differences():
    mesh, uv = plain()
    image = picture(32) - 1.0
    results = [
        core.stitch_textures(mesh, uv, [image, image + 0.2], core.StitchSettings(even_out=by))
        for by in ("brightness", "difference")
    ]
    assert (results[0] == results[1]).all()


def fine(n, length=6.0):
    """Waves of a few texels in many directions."""
    rng = np.random.default_rng(5)
    y, x = np.mgrid[:n, :n]
    total = np.zeros((n, n, 3))
    for _ in range(12):
        angle = rng.uniform(0, 2 * np.pi)
        rate = 2 * np.pi / (length * rng.uniform(0.8, 1.3))
        along = rate * (np.cos(angle) * x + np.sin(angle) * y)
        total += np.sin(along[..., None] + rng.uniform(0, 2 * np.pi, 3))
    return (0.5 + 0.05 * total).astype(np.float32)


def of_fine_square():
    blocks = Blocks(fine(96), 0.4)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    return blocks, mesh, blocks.texture()


def test_a_fine_texture_without_steps_hardly_changes():
    blocks, mesh, image = of_fine_square()
    inside = inside_of(mesh, blocks).inside
    result = core.stitch_textures(mesh, blocks.uv, image, core.StitchSettings(radius=1000.0))
    change = np.abs(result - image)[inside]
    assert change.mean() < 0.004
    assert np.quantile(change, 0.99) < 0.03


def test_steps_are_seen_below_fine_detail():
    blocks, mesh, image = of_fine_square()
    inside = inside_of(mesh, blocks).inside
    broken = with_steps(mesh, blocks, image)
    result = core.stitch_textures(mesh, blocks.uv, broken, core.StitchSettings(radius=1e5))
    before, after = ((pixels - image)[inside] for pixels in (broken, result))
    assert np.std(before - before.mean(axis=0)) > 0.1
    assert np.std(after - after.mean(axis=0)) < 0.018


def test_textures_that_differ_by_rounding_differ_little_when_stitched():
    blocks, mesh, image = of_fine_square()
    moved = image + np.random.default_rng(0).normal(0, 1e-5, image.shape).astype(np.float32)
    one, other = (core.stitch_textures(mesh, blocks.uv, each) for each in (image, moved))
    assert np.abs(one - other).max() < 1e-3


def strokes(n, seed):
    """Patches of a few colors, some texels wide."""
    rng = np.random.default_rng(seed)
    small = rng.uniform(0.2, 0.8, 3) + 0.15 * rng.standard_normal((n // 8 + 2, n // 8 + 2, 3))
    places = (np.mgrid[:n, :n].transpose(1, 2, 0)[..., ::-1] + 0.5) / n
    return np.clip(sample(small, places), 0.0, 1.0).astype(np.float32)


def of_materials(n=96):
    """Charts that show different materials."""
    made = [Blocks(strokes(n, seed), 0.4) for seed in range(16)]
    mesh = core.TriangleMesh(made[0].vertices, made[0].faces)
    atlas = inside_of(mesh, made[0])
    chart = atlas.masks().chart
    choices = np.array([each.texture() for each in made])
    image = np.take_along_axis(choices, np.maximum(chart, 0)[None, ..., None], axis=0)[0]
    return mesh, made[0].uv, image, atlas


def test_different_materials_stay_as_they_are():
    mesh, uv, image, atlas = of_materials()
    auto, all_of_them = (
        core.stitch_textures(mesh, uv, image, core.StitchSettings(seams=seams))
        for seams in ("auto", "continue")
    )
    changes = [np.abs(each - image)[atlas.inside].mean() for each in (auto, all_of_them)]
    assert changes[1] > 0.05
    assert changes[0] < 0.05 * changes[1]


def of_colors(colors, n=96):
    """Charts that show one of the colors each."""
    blocks = Blocks(picture(n), 0.4)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    atlas = inside_of(mesh, blocks)
    chart = np.maximum(atlas.masks().chart, 0)
    return mesh, blocks.uv, np.asarray(colors, np.float32)[chart % len(colors)], atlas


@pytest.mark.parametrize("noise", [0.0, 0.03])
def test_plain_colors_of_a_palette_stay_and_one_color_in_many_lights_becomes_one(noise):
    rng = np.random.default_rng(2)
    palette = [[0.7, 0.15, 0.1], [0.15, 0.3, 0.7], [0.85, 0.75, 0.2], [0.1, 0.4, 0.15]]
    mesh, uv, image, atlas = of_colors(palette)
    grain = (noise * rng.standard_normal(image.shape)).astype(np.float32)
    found = core.stitch_textures(mesh, uv, image + grain)
    assert np.abs(found - image - grain)[atlas.inside].mean() < 0.01
    color = np.array([0.45, 0.35, 0.25])
    for lights in (rng.uniform(0.6, 1.35, (16, 1)), rng.uniform(0.75, 1.25, (16, 3))):
        mesh, uv, image, atlas = of_colors(color * lights)
        auto, everything = (
            core.stitch_textures(
                mesh, uv, image + grain, core.StitchSettings(radius=1e5, seams=seams)
            )
            for seams in ("auto", "continue")
        )
        moved = [np.abs(each - image - grain)[atlas.inside].mean() for each in (auto, everything)]
        assert moved[0] > 0.9 * moved[1] > 0.02


def test_plain_grays_that_charts_share_stay_and_one_gray_in_many_lights_becomes_one():
    mesh, uv, image, atlas = of_colors([[0.8]] * 5 + [[0.45]] + [[0.8]] * 6 + [[0.45]] * 4)
    found = core.stitch_textures(mesh, uv, image)
    assert np.abs(found - image)[atlas.inside].max() < 0.01
    lights = np.random.default_rng(2).uniform(0.6, 1.35, (16, 1))
    mesh, uv, image, atlas = of_colors(0.6 * lights)
    found = core.stitch_textures(mesh, uv, image, core.StitchSettings(radius=1e5))
    assert np.ptp(found[atlas.inside]) < 0.2 * np.ptp(image[atlas.inside])


def test_plain_charts_that_differ_by_offsets_become_one():
    offsets = np.random.default_rng(2).uniform(-0.1, 0.1, (16, 1))
    mesh, uv, image, atlas = of_colors(np.array([0.2, 0.25, 0.4]) + offsets)
    settings = core.StitchSettings(radius=1e5, even_out="difference")
    found = core.stitch_textures(mesh, uv, image, settings)
    assert np.ptp(found[atlas.inside], axis=0).max() < 0.05


def seams_of(lights, size=50):
    """Steps along all seams of a ring of charts, seen from both sides, and their charts."""
    one = np.repeat(np.arange(len(lights)), size)
    other = np.repeat(np.roll(np.arange(len(lights)), -1), size)
    charts = np.concatenate([np.stack([one, other]), np.stack([other, one])], axis=1).T
    return lights[charts[:, 0]], lights[charts[:, 1]], charts


def how_designed(one, two, charts):
    return design.how_designed((one, two), (one, two), np.zeros(len(one)), charts)


def test_one_light_a_chart_is_told_from_designed_colors():
    lights = np.random.default_rng(3).uniform(0.6, 1.35, (12, 1))
    one, two, charts = seams_of(lights)
    assert how_designed(one, two, charts) < 0.05
    # Few shades, which many charts share.
    assert how_designed(*seams_of(np.where(np.arange(12) < 9, 0.8, 0.4)[:, None])) > 0.95
    # A border that runs along a half of each seam.
    half = np.arange(len(one)) % 50 < 25
    one[half], two[half] = 0.8, 0.8
    assert how_designed(one, two, charts) > 0.95
    # One factor explains any two charts.
    assert how_designed(*seams_of(lights[:2])) < 0.05


def test_the_lights_of_charts_are_those_that_explain_the_steps():
    rng = np.random.default_rng(4)
    one, other = np.triu_indices(9, 1)
    lengths, lights = rng.integers(1, 90, len(one)), rng.standard_normal((9, 2))
    lights -= lights.mean(axis=0)
    sums = (lights[one] - lights[other]) * lengths[:, None]
    found = design._lights(one, other, lengths, sums, 9)
    assert np.abs(found - found.mean(axis=0) - lights).max() < 1e-3


def test_steps_that_change_along_a_seam_stay():
    # Both sides show the same stripes, but with more than twice the contrast on one.
    vertices, faces = grid(2, 1)
    column = vertices[:, 0].astype(int)
    mesh = core.TriangleMesh(vertices * [40.0, 80.0, 1.0], faces)
    right = column[faces].min(axis=1)[:, None]
    uv = np.stack([4 + 50 * right + 40 * (column[faces] - right), 8 + 80 * vertices[faces][..., 1]],
                  axis=-1) / 100  # fmt: skip
    stripes = np.cos(np.arange(100) / 8.0)[:, None]
    inside = core.TextureAtlas(mesh, uv, size=(100, 100)).inside
    settings = core.StitchSettings(even_out="difference")
    changes = []
    for contrast in (0.15, 0.4):
        image = np.where(np.arange(100) < 49, 0.5 + contrast * stripes, 0.45 + 0.15 * stripes)
        image = image[..., None].astype(np.float32)
        found = core.stitch_textures(mesh, uv, image, settings)
        changes.append(np.abs(found - image)[inside].mean())
    assert changes[1] < 0.1 * changes[0]


def test_plain_colors_stay_more_the_farther_apart_they_are_without_jumps():
    moved = []
    for size in np.linspace(0.1, 1.6, 31):
        logs = size * np.array([[1.0, 0.0, -1.0], [-0.6, 1.0, 0.0], [0.0, -1.0, 0.7], [0, 0, 0]])
        mesh, uv, image, atlas = of_colors(0.4 * np.exp(0.5 * logs))
        auto, everything = (
            core.stitch_textures(mesh, uv, image, core.StitchSettings(seams=seams))
            for seams in ("auto", "continue")
        )
        change = [np.abs(each - image)[atlas.inside].mean() for each in (auto, everything)]
        moved.append(change[0] / change[1])
    assert moved[0] > 0.99
    assert moved[-1] < 0.1
    assert (np.diff(moved) < 0.02).all()
    assert np.diff(moved).min() > -0.4


@pytest.mark.parametrize("kind", [with_steps, with_factors])
def test_one_material_in_many_lights_becomes_one(kind):
    blocks = Blocks(strokes(96, 0), 0.4)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    broken = kind(mesh, blocks, blocks.texture())
    auto, all_of_them = (
        core.stitch_textures(mesh, blocks.uv, broken, core.StitchSettings(seams=seams))
        for seams in ("auto", "continue")
    )
    moved = [np.abs(each - broken).mean() for each in (auto, all_of_them)]
    assert np.abs(auto - all_of_them).mean() < 0.03 * moved[1]
    assert 0.97 < moved[0] / moved[1] < 1.03


def test_how_far_sides_agree_grows_without_jumps():
    # The same detail on both sides, and more and more of another one.
    mesh, uv, other, atlas = of_materials()
    blocks = Blocks(strokes(96, 0), 0.4)
    same = with_steps(mesh, blocks, blocks.texture())
    moved = []
    for share in np.linspace(0.0, 1.0, 9):
        image = ((1 - share) * same + share * other).astype(np.float32)
        auto, everything = (
            core.stitch_textures(mesh, uv, image, core.StitchSettings(seams=seams))
            for seams in ("auto", "continue")
        )
        change = [np.abs(each - image)[atlas.inside].mean() for each in (auto, everything)]
        moved.append(change[0] / change[1])
    assert moved[0] == 1
    assert moved[-1] < 0.1
    assert (np.diff(moved) < 0.02).all()
    assert np.diff(moved).min() > -0.5


YELLOW, WHITE = (1.0, 0.85, 0.0), (1.0, 1.0, 1.0)


def of_strip(width, size=48):
    """A yellow and a white square with a strip between them, a chart of few or no texels."""
    vertices, faces = grid(3, 1)
    column = vertices[:, 0].astype(int)
    surface = np.array([0.0, 20.0, 21.0, 41.0])[column]
    mesh = core.TriangleMesh(
        np.stack([surface, 20.0 * vertices[:, 1], 0.0 * surface], axis=-1), faces
    )
    of_face = column[faces].min(axis=1)  # 0: yellow, 1: the strip, 2: white
    left = np.array([2.3, 23.6, 25.3])[of_face][:, None]
    wide = np.array([20.0, width, 20.0])[of_face][:, None]
    uv = np.stack(
        [left + wide * (column[faces] - of_face[:, None]), 3.2 + 20.0 * vertices[faces][..., 1]],
        axis=-1,
    )
    image = np.empty((size, size, 3), np.float32)
    image[:, :25], image[:, 25:] = YELLOW, WHITE
    return mesh, uv / size, image


@pytest.mark.parametrize("even_out", ["auto", "brightness", "difference"])
@pytest.mark.parametrize("width", [0.3, 0.7, 1.5])
def test_colors_stay_beside_charts_of_no_or_few_texels(width, even_out):
    # In such charts there is no detail to compare, and some pieces are near no texel at all.
    mesh, uv, image = of_strip(width)
    inside = core.TextureAtlas(mesh, uv, size=image.shape[:2]).inside
    settings = core.StitchSettings(even_out=even_out)
    found = core.stitch_textures(mesh, uv, image, settings)
    assert np.abs(found - image)[inside].max() < 1e-5


def of_tube(colors, around=12, size=64):
    """A tube with one chart, which meets itself where its first and last colors do."""
    flat, faces = grid(around, 2)
    angle = 2 * np.pi * flat[:, 0] / around
    places = 10.0 * np.stack([np.cos(angle), np.sin(angle), flat[:, 1]], axis=-1)
    kept, index = core.weld(np.round(places, 9))
    mesh = core.TriangleMesh(places[kept], index[faces])
    uv = flat[faces][..., :2] / [around, 2] * 0.8 + 0.1
    across = ((np.arange(size) + 0.5) / size - 0.1) / 0.8
    rows = [
        np.interp(across, np.linspace(0, 1, len(colors)), each) for each in np.transpose(colors)
    ]
    return mesh, uv, np.tile(np.transpose(rows), (size, 1, 1)).astype(np.float32)


def test_a_chart_that_meets_itself_in_another_color_stays():
    red, blue = (0.7, 0.15, 0.1), (0.15, 0.3, 0.7)
    changes = []
    for colors in ([red, blue], [red, tuple(1.15 * c for c in red)]):
        mesh, uv, image = of_tube(colors)
        inside = core.TextureAtlas(mesh, uv, size=image.shape[:2]).inside
        changes.append(np.abs(core.stitch_textures(mesh, uv, image) - image)[inside].max())
    assert changes[0] < 0.01 < 0.03 < changes[1]


@pytest.mark.parametrize("even_out", ["brightness", "difference"])
def test_values_stay_between_black_and_white_or_in_the_range_of_the_images(even_out):
    blocks, mesh, image = of_square(64)
    chart = inside_of(mesh, blocks).masks().chart
    light = np.random.default_rng(4).uniform(0.5, 1.0, chart.max() + 1)
    spots = np.random.default_rng(5).random(image.shape[:2] + (1,))
    image = np.where(spots < 0.1, 0.0, np.where(spots > 0.9, 1.0, light[chart][..., None] * image))
    settings = core.StitchSettings(radius=1e3, even_out=even_out, seams="continue")
    for scale in (1.0, 4.0):
        given = (scale * image).astype(np.float32)
        found = core.stitch_textures(mesh, blocks.uv, given, settings)
        assert found.min() >= 0
        assert found.max() <= scale
        assert np.abs(found - given).max() > 0.05 * scale


def test_where_a_step_stays_the_gutter_continues_the_chart_beside_it():
    mesh, uv, image, atlas = of_colors([[0.7, 0.15, 0.1], [0.15, 0.3, 0.7], [0.85, 0.75, 0.2]])
    found = core.stitch_textures(mesh, uv, image, core.StitchSettings(gutter=3))
    near = binary_dilation(atlas.inside, iterations=2) & ~atlas.inside
    colors = found[near]
    beside = (
        np.abs(colors[:, None] - np.unique(image[atlas.inside], axis=0)).max(axis=2).min(axis=1)
    )
    nearest = distance_transform_edt(~atlas.inside, return_indices=True, return_distances=False)
    own = image[tuple(nearest[:, near])]
    assert beside.max() < 0.02
    assert (np.abs(colors - own).max(axis=1) < 0.02).mean() > 0.95


def unwrapped(vertices, faces):
    """A chart for each of the six sides of a box."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    axis = np.abs(normals).argmax(axis=1)
    is_front = normals[np.arange(len(axis)), axis] > 0
    places = (corners - vertices.min(axis=0)) / np.ptp(vertices, axis=0).max()
    across = np.stack([(axis + 1) % 3, (axis + 2) % 3], axis=1)
    uv = 0.28 * np.take_along_axis(places, across[:, None], axis=2) + 0.02
    return uv + np.stack([axis / 3, 0.5 * ~is_front], axis=1)[:, None]


def test_charts_far_smaller_than_a_texel_stop_nothing():
    box, sides = cube(3)
    sheet, faces = grid(6, 6)
    sheet[:, 2] = 0.3 * np.sin(sheet[:, 0]) + 0.2 * np.cos(1.3 * sheet[:, 1])
    charts, more = unwrapped(sheet, faces), unwrapped(box, sides)
    image = np.random.default_rng(3).random((24, 32))
    for size in 10.0 ** -np.arange(1.0, 4.5, 0.25):
        vertices = np.r_[sheet, 0.01 * size * box + 3]
        mesh = core.TriangleMesh(vertices, np.r_[faces, sides + len(sheet)])
        uv = np.r_[charts, 0.9 + 0.1 * size * more]
        assert np.isfinite(core.stitch_textures(mesh, uv, image)).all()


def test_charts_smaller_than_all_texels_are_named():
    mesh, uv = plain(8)
    with pytest.raises(core.InvalidUV, match="No chart covers the middle of a texel"):
        core.stitch_textures(mesh, uv * 0.01, [np.ones((4, 4))])
