# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of the gradient-domain filter of textures."""

import numpy as np
import pytest
from atlases import Blocks, sample
from scipy.ndimage import gaussian_filter
from shapes import grid
from shock_filter import core
from shock_filter.core.texture.painted_gain import gains_of
from surface_spaces import square


def picture(n, channels=3):
    """Waves that end flat at the sides of a square."""
    y, x = (np.mgrid[:n, :n] + 0.5) / n * np.pi
    waves = [np.cos((2 + c) * x) * np.cos((5 - c) * y) + 0.3 * np.cos(20 * x) for c in range(4)]
    return (0.5 + 0.3 * np.stack(waves[:channels], axis=-1)).astype(np.float32)


def of_square(n, angle=0.4, channels=3, background=0.0):
    blocks = Blocks(picture(n, channels), angle)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    return blocks, mesh, blocks.texture(background)


def read(blocks, image, seed=0):
    points = np.random.default_rng(seed).uniform(2, blocks.size - 2, size=(4000, 2))
    return blocks.read(image, points)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
def test_a_gain_of_one_returns_the_input(dtype):
    mesh, uv, size = square(32)
    image = (np.random.default_rng(0).random((size, size, 3)) * 200).astype(dtype)
    settings = core.FilterSettings(gain=1.0)
    for gain in (None, 1.0, np.ones((size, size))):
        result = core.filter_texture(mesh, uv, image, settings, gain=gain)
        assert result.dtype == dtype
        assert (result == image).all()
    assert result is not image


@pytest.mark.parametrize("gain", [0.0, 0.5, 3.0])
def test_waves_change_as_their_length_says(gain):
    # On a square that ends freely, cosines are eigenfunctions of the Laplacian.
    n, radius = 64, 6.0
    vertices, faces = grid(1, 1)
    mesh = core.TriangleMesh(vertices * n, faces)
    uv = vertices[faces][..., :2]
    y, x = (np.mgrid[:n, :n] + 0.5) / n * np.pi
    wave = np.cos(4 * x) * np.cos(2 * y)
    image = 0.5 + 0.1 * wave
    settings = core.FilterSettings(gain=gain, radius=radius)
    result = core.filter_texture(mesh, uv, image, settings)
    square_of_number = (16 + 4) * (np.pi / n) ** 2
    share = (1 + gain * radius**2 * square_of_number) / (1 + radius**2 * square_of_number)
    inner = slice(4, -4), slice(4, -4)
    assert np.abs(result - (0.5 + 0.1 * share * wave))[inner].max() < 0.1 * 0.02 * abs(1 - share)


@pytest.mark.parametrize("gain", [0.0, 3.0])
def test_it_does_not_matter_where_a_texture_is_cut(gain):
    settings, results = core.FilterSettings(gain=gain, radius=8.0), []
    for angle in (None, 0.4):
        blocks, mesh, image = of_square(64, angle)
        results.append(read(blocks, core.filter_texture(mesh, blocks.uv, image, settings)))
        change = np.abs(results[-1] - read(blocks, image)).max()
    assert np.abs(results[1] - results[0]).max() < 0.1 * change
    assert np.sqrt(np.mean((results[1] - results[0]) ** 2)) < 0.015 * change


def test_both_sides_of_a_seam_agree():
    blocks, mesh, image = of_square(64)
    result = core.filter_texture(mesh, blocks.uv, image, core.FilterSettings(gain=3.0))
    along = np.random.default_rng(1).uniform(1, 63, size=1000)
    seam = np.stack([np.full(1000, 32.0), along], axis=1)
    off = np.array([1e-6, 0.0])
    jump = np.abs(blocks.read(result, seam - off) - blocks.read(result, seam + off))
    before = np.abs(blocks.read(image, seam - off) - blocks.read(image, seam + off))
    assert jump.max() < max(before.max(), 1e-3)


@pytest.mark.parametrize("background", [0.0, 1.0, 1e6, "noise"])
def test_what_lies_beside_the_charts_does_not_count(background):
    blocks, mesh, image = of_square(32)
    settings = core.FilterSettings(gain=2.0, radius=5.0)
    expected = core.filter_texture(mesh, blocks.uv, image, settings)
    inside = core.TextureAtlas(mesh, blocks.uv, size=(blocks.width, blocks.width)).inside
    noise = 100 * np.random.default_rng(0).random(image.shape)
    other = np.where(inside[..., None], image, noise if background == "noise" else background)
    result = core.filter_texture(mesh, blocks.uv, other.astype(np.float32), settings)
    assert (result[inside] == expected[inside]).all()


def test_constants_stay():
    blocks, mesh, image = of_square(32)
    flat = np.full_like(image, 0.3)
    result = core.filter_texture(mesh, blocks.uv, flat, core.FilterSettings(gain=5.0))
    assert np.abs(result - 0.3).max() < 1e-6


def test_painted_gains_act_where_they_are():
    n = 64
    vertices, faces = grid(1, 1)
    mesh = core.TriangleMesh(vertices * n, faces)
    uv = vertices[faces][..., :2]
    image = 0.5 + 0.2 * np.random.default_rng(0).random((n, n, 1)).astype(np.float32)
    settings = core.FilterSettings(radius=3.0)
    solver = core.TextureSolver(mesh, uv, image, settings)
    whole = solver.filtered(0.0)
    gain = np.ones((n, n))
    assert np.abs(solver.filtered(0.0 * gain) - whole).max() < 3e-3
    gain[:, :32] = 0.0
    half = solver.filtered(gain)
    assert np.abs(half - whole)[:, :20].max() < 0.02
    assert np.abs(half - image)[:, 50:].max() < 0.02
    assert np.abs(whole - image)[:, 50:].max() > 0.05
    assert np.abs(half - core.filter_texture(mesh, uv, image, settings, gain=gain)).max() < 3e-3


def test_a_kept_solver_gives_what_the_filter_gives():
    blocks, mesh, image = of_square(32)
    solver = core.TextureSolver(mesh, blocks.uv, image)
    for gain in (0.0, 3.0):
        expected = core.filter_texture(mesh, blocks.uv, image, core.FilterSettings(gain=gain))
        assert np.abs(solver.filtered(gain) - expected).max() < 1e-6


def test_a_mask_mixes_and_keeps():
    blocks, mesh, image = of_square(32)
    settings = core.FilterSettings(gain=3.0, radius=8.0)
    whole = core.filter_texture(mesh, blocks.uv, image, settings)
    mask = np.full(image.shape[:2], 0.5)
    mask[: len(mask) // 2] = 0.0
    result = core.filter_texture(mesh, blocks.uv, image, settings, mask=mask)
    inside = core.TextureAtlas(mesh, blocks.uv, size=(blocks.width, blocks.width)).inside
    kept, mixed = inside & (mask == 0), inside & (mask == 0.5)
    assert (result[kept] == image[kept]).all()
    assert np.allclose(result[mixed], 0.5 * (image + whole)[mixed], atol=1e-5)


def test_opacity_stays_and_transparent_texels_lend_no_color():
    blocks, mesh, image = of_square(64)
    opaque = np.ones((*image.shape[:2], 1), dtype=np.float32)
    opaque[:, : blocks.width // 3] = 0.0
    settings = core.FilterSettings(gain=0.0, radius=20.0)
    results = []
    for paint in (0.0, 50.0):
        colors = np.where(opaque > 0, image, paint)
        given = np.concatenate([colors, opaque], axis=2).astype(np.float32)
        results.append(core.filter_texture(mesh, blocks.uv, given, settings))
    inside = core.TextureAtlas(mesh, blocks.uv, size=(blocks.width, blocks.width)).inside
    assert (results[1][inside, 3:] == opaque[inside]).all()
    seen = inside & (opaque[..., 0] > 0)
    assert np.abs(results[1] - results[0])[seen].max() < 0.05
    assert np.isfinite(results).all()


def test_materials_beyond_a_seam_do_not_mix():
    blocks, mesh, image = of_square(64)
    dark = np.zeros_like(image)
    tile = blocks.width // 4
    dark[:, 2 * tile :] = 0.8
    settings = core.FilterSettings(gain=0.0, radius=100.0)
    inside = core.TextureAtlas(mesh, blocks.uv, size=(blocks.width, blocks.width)).inside
    auto = core.filter_texture(mesh, blocks.uv, dark, settings)
    assert np.abs(auto - dark)[inside].max() < 1e-5
    joined = core.FilterSettings(gain=0.0, radius=100.0, seams="continue")
    assert np.abs(core.filter_texture(mesh, blocks.uv, dark, joined) - dark)[inside].max() > 0.2


def test_results_are_the_same_on_one_core_and_two(monkeypatch):
    from shock_filter.core.base import parallel

    blocks, mesh, image = of_square(32)
    results = []
    for cores in (1, 2):
        monkeypatch.setattr(parallel, "thread_count", lambda cores=cores: cores)
        results.append(core.filter_texture(mesh, blocks.uv, image))
    assert (results[0] == results[1]).all()


@pytest.mark.parametrize(
    ("gain", "words"),
    [
        (np.ones((3, 4)), "shape"),
        (-1.0, "range 0 to 100"),
        (np.nan, "NaN"),
        ("a lot", "no numbers"),
        (1e9, "range"),
    ],
)
def test_wrong_gains_are_named(gain, words):
    mesh, uv, size = square(32)
    with pytest.raises(core.InvalidSignal, match=words):
        core.filter_texture(mesh, uv, np.zeros((size, size)), gain=gain)


def test_cancelled_runs_raise():
    mesh, uv, size = square(32)
    image = np.random.default_rng(0).random((size, size))
    for most in range(0, 40, 8):
        calls = []

        def ask(fraction, message, most=most, calls=calls):
            calls.append(fraction)
            return len(calls) <= most

        with pytest.raises(core.Cancelled):
            core.filter_texture(mesh, uv, image, progress=ask)
        assert calls == sorted(calls)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (2, 2, 1), (5, 3, 4)])
def test_tiny_images_give_finite_results(shape):
    vertices, faces = grid(1, 1)
    image = np.random.default_rng(0).random(shape)
    result = core.filter_texture(
        core.TriangleMesh(vertices, faces), vertices[faces][..., :2], image
    )
    assert result.shape == shape
    assert np.isfinite(result).all()


def test_a_sample_of_the_result_lies_where_the_mesh_shows_it():
    # The picture comes out of the layout as it went in, but for the change.
    blocks, mesh, image = of_square(64)
    settings = core.FilterSettings(gain=1.2, radius=4.0)
    result = core.filter_texture(mesh, blocks.uv, image, settings)
    points = np.random.default_rng(0).uniform(4, 60, size=(500, 2))
    assert np.abs(blocks.read(result, points) - sample(blocks.picture, points / 64)).max() < 0.1


@pytest.mark.parametrize("gain", [0.0, 4.0, "painted"])
def test_the_mean_over_the_surface_stays_exactly(gain):
    mesh = core.TriangleMesh(*grid(1, 1))
    uv = mesh.vertices[mesh.faces][..., :2]
    random = np.random.default_rng(0)
    image = gaussian_filter(random.random((64, 64)), 3.0)
    if gain == "painted":
        gain = 4.0 * (gaussian_filter(random.random((64, 64)), 6.0) > 0.5)
    result = core.filter_texture(mesh, uv, image, core.FilterSettings(radius=200.0), gain=gain)
    # Texels along the rim have cells beyond the outermost samples: inside they all count alike.
    change = result - image
    assert np.abs(change).max() > 0.01
    assert abs(change.mean()) < 1e-6


@pytest.mark.parametrize("gray", [127, 128])
def test_grays_beside_the_middle_gain_exactly_1_however_they_were_rounded(gray):
    near = np.float32(gray) / np.float32(255)
    values = [near, np.nextafter(near, np.float32(0)), np.nextafter(near, np.float32(1))]
    assert (gains_of(values, 1e4) == 1).all()


def test_nothing_is_added_on_the_whole_where_the_screen_hardly_holds_it():
    mesh, uv, size = square(64, True, 0.4)
    random = np.random.default_rng(2)
    image = random.random((size, size, 1))
    image = 8.0 * gaussian_filter(image, (9, 9, 0)) + 0.1 * image
    solver = core.TextureSolver(mesh, uv, image, core.FilterSettings(radius=2000.0))
    change = solver._of_unit
    masses = solver._masses.reshape(len(change), -1)[:, :1].astype(np.float64)
    assert np.abs(change).max() > 0.1
    assert abs((masses * change).sum() / masses.sum()) < 1e-7


def test_a_solver_keeps_the_texture_that_it_was_made_for():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    mesh, uv = core.TriangleMesh(corners, faces), corners[faces][..., :2] * 0.8 + 0.1
    image = np.tile(0.5 + 0.2 * np.sin(np.arange(32.0)), (32, 1))
    before = image.copy()
    solver = core.TextureSolver(mesh, uv, image)
    image[:] = 0
    np.testing.assert_array_equal(solver.filtered(1.0), before)
