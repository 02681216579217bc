# SPDX-License-Identifier: GPL-3.0-or-later
"""The short-time Beltrami kernel on textures, across seams."""

import numpy as np
import pytest
from atlases import Blocks, apart, sample
from scipy.ndimage import gaussian_filter
from shapes import grid, icosphere, rotation
from shock_filter import core
from shock_filter.core import settings
from shock_filter.core.beltrami import texel_smoothing


def photo(height=96, width=96, seed=0, noise=0.08):
    """Blotches with edges, in [0, 1], and noise: both (height, width, 3) float32."""
    rng = np.random.default_rng(seed)
    blotches = np.sign(gaussian_filter(rng.normal(size=(height, width, 3)), (5, 5, 0)))
    clean = 0.5 + 0.3 * gaussian_filter(blotches, (0.7, 0.7, 0))
    return clean.astype(np.float32), noise * rng.normal(size=clean.shape).astype(np.float32)


def smooth(mesh, uv, image, mask=None, **settings):
    return core.beltrami_texture(
        mesh, uv, image, core.BeltramiTextureSettings(**{"beta": 7.0} | settings), mask=mask
    )


def smooth_image(image, **settings):
    return core.beltrami_image(image, core.BeltramiSettings(**{"beta": 7.0} | settings))


def rms(difference):
    return float(np.sqrt(np.mean(np.square(difference))))


def square(cells=4, turn=None, size=1.0):
    """A square with texture coordinates 0 to 1 in one chart."""
    vertices, faces = grid(cells, cells)
    uv = vertices[faces][..., :2] / cells
    return core.TriangleMesh(size * (vertices if turn is None else vertices @ turn.T), faces), uv


def points_on(size, count=20000, seed=1):
    """Points of a plane, away from its rim, and how far they are from the seams of `Blocks`."""
    points = 3.0 + (size - 6.0) * np.random.default_rng(seed).random((count, 2))
    block = size // 4
    return points, np.minimum(points % block, block - points % block).min(axis=1)


@pytest.mark.parametrize(
    "settings",
    [{}, {"beta": 0.0}, {"time": 4.0, "iterations": 1}],
)
def test_one_flat_chart_is_an_image(settings):
    clean, noise = photo(64)
    image = clean + noise
    vertices, faces = grid(4, 4)
    mesh = core.TriangleMesh(vertices * (1.5, 1.0, 1.0) @ rotation().T + 7.0, faces)
    out = smooth(mesh, vertices[faces][..., :2] / 4, image, **settings)
    assert np.abs(out - smooth_image(image, **settings)).max() < 1e-5
    assert rms(out - image) > 0.03


def test_charts_whose_texels_line_up_do_not_show():
    clean, noise = photo(96)
    blocks = Blocks(clean + noise)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    out = smooth(mesh, blocks.uv, blocks.texture())
    y, x = np.mgrid[:96, :96] + 0.5
    inner = slice(1, -1), slice(1, -1)  # the rim is where seams meet the mesh's border
    found = blocks.read(out, np.stack([x, y], axis=-1))
    assert np.abs(found - smooth_image(clean + noise))[inner].max() < 5e-3
    assert rms((found - smooth_image(clean + noise))[inner]) < 3e-4


def test_noise_falls_beside_the_seams_of_turned_charts_as_inside():
    clean, _ = photo(128)
    blocks = Blocks(clean, angle=0.3)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    texture = blocks.texture()
    noise = 0.08 * np.random.default_rng(2).normal(size=texture.shape).astype(np.float32)
    points, away = points_on(128)
    truth = sample(clean, points / 128)
    resampled = core.dilate_texture(mesh, blocks.uv, texture)
    cost = blocks.read(resampled, points) - truth

    def errors(image):
        error = blocks.read(image, points) - truth - cost
        return rms(error[away < 1]), rms(error[away > 5])

    out = smooth(mesh, blocks.uv, texture + noise)
    at_seams, inside = errors(out)
    assert inside < 0.035
    assert at_seams < 1.1 * inside
    flat = smooth_image(texture + noise)
    at_seams, inside = errors(core.dilate_texture(mesh, blocks.uv, flat))
    assert at_seams > 1.2 * inside  # so the test can fail


def test_both_sides_of_a_seam_show_one_value():
    clean, _ = photo(128)
    blocks = Blocks(clean, angle=0.3)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    texture = blocks.texture()
    noise = 0.08 * np.random.default_rng(2).normal(size=texture.shape).astype(np.float32)
    out = smooth(mesh, blocks.uv, texture + noise)
    along = 3.0 + 90.0 * np.random.default_rng(3).random(4000)

    def jump(image, place):
        points = [np.stack([np.full_like(along, place + d), along], -1) for d in (-0.01, 0.01)]
        return rms(blocks.read(image, points[0]) - blocks.read(image, points[1]))

    inside = jump(out, 16.0)
    steps = rms(np.diff(smooth_image(clean), axis=1))
    assert inside < jump(out, 32.0) < 0.35 * steps
    assert jump(smooth_image(texture + noise), 32.0) > steps


def test_where_all_faces_lie_apart_noise_falls_as_much():
    vertices, faces = icosphere(2, radius=8.0)
    mesh = core.TriangleMesh(vertices, faces)
    uv, size = apart(mesh, texels_per_length=6.0)
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    waves = np.sin(atlas.bake(mesh.vertices[mesh.faces])[..., :1])
    clean = 0.5 + 0.3 * waves
    noise = 0.08 * np.random.default_rng(0).normal(size=clean.shape)
    settings = core.BeltramiTextureSettings(beta=5.0)
    out = core.beltrami_texture(mesh, uv, clean + noise, settings, atlas=atlas)
    still = core.beltrami_texture(mesh, uv, clean, settings, atlas=atlas)
    assert rms((out - still)[atlas.inside]) < 0.3 * 0.08
    assert rms((still - clean)[atlas.inside]) < 0.01


def test_closed_seams_keep_charts_apart():
    clean, noise = photo(64, 64)
    image = 0.5 + 0.2 * (clean - 0.5) + noise
    blocks = Blocks(image)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    out = smooth(mesh, blocks.uv, blocks.texture(), seams="extend")
    across = smooth(mesh, blocks.uv, blocks.texture(), seams="continue")
    x, y = np.meshgrid(*2 * [np.arange(16) + 0.5])
    for b in (0, 5, 10):
        row, column = divmod(b, 4)
        alone = smooth_image(image[16 * row :, 16 * column :][:16, :16].copy())
        points = np.stack([x + 16 * column, y + 16 * row], axis=-1)
        assert np.abs(blocks.read(out, points) - alone).max() < 1e-4
        assert rms(blocks.read(across, points) - alone) > 5e-3


def test_materials_that_meet_at_a_seam_do_not_mix():
    vertices, faces = grid(8, 8)
    uv = 0.5 * vertices[faces][..., :2] / 8.0
    right = vertices[faces][..., 0].mean(axis=1) > 4
    uv[right] += (0.2, 0.4)
    mesh = core.TriangleMesh(vertices, faces)
    atlas = core.TextureAtlas(mesh, uv, size=(128, 128))
    image = np.where(atlas.masks().chart == atlas.charts.labels[np.argmax(right)], 0.34, 0.3)
    noisy = image + 0.01 * np.random.default_rng(0).normal(size=image.shape)
    by_itself = smooth(mesh, uv, noisy)
    mixed = smooth(mesh, uv, noisy, seams="continue")
    assert np.abs(by_itself - image)[atlas.inside].max() < 0.012
    assert np.abs(mixed - image)[atlas.inside].max() > 0.018


def test_nothing_comes_from_beyond_the_end_of_the_surface():
    # A narrow strip beyond a seam: kernels reach over its far border, where nothing is.
    vertices, faces = grid(10, 10)
    corners = vertices[faces][..., :2]
    strip = corners[..., 0].mean(axis=1) > 9
    uv = (corners + (0.5, 0.5)) / 16.0
    uv[strip] += (0.25, 0.0)
    ramp, _ = photo(40, 40, seed=3)
    image = np.zeros((64, 64, 3), dtype=np.float32)
    image[2:42, 2:38] = ramp[:, :36]
    image[2:42, 54:58] = ramp[:, 36:]
    out = smooth(core.TriangleMesh(vertices, faces), uv, image, time=4.0, seams="continue")
    expected = smooth_image(ramp, time=4.0)
    assert np.abs(out[2:42, 2:38] - expected[:, :36])[1:-1].max() < 1e-4
    assert np.abs(out[2:42, 54:58] - expected[:, 36:])[1:-1].max() < 1e-4


def test_mirrored_halves_share_their_texels():
    # The halves of a square meet at a fold of the texture: it goes on as its own mirror image.
    vertices, faces = grid(8, 8)
    uv = vertices[faces][..., :2] / 8.0
    right = vertices[faces][..., 0].mean(axis=1) > 4
    uv[right, :, 0] = 1.0 - uv[right, :, 0]
    uv[..., 0] += 0.25
    clean, noise = photo(64, 32)
    image = np.zeros((64, 64, 3), dtype=np.float32)
    image[:, 16:48] = clean + noise
    out = smooth(core.TriangleMesh(vertices, faces), uv, image)
    both = np.concatenate([clean + noise, (clean + noise)[:, ::-1]], axis=1)
    assert np.abs(out[:, 16:48] - smooth_image(both)[:, :32]).max() < 1e-3


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
@pytest.mark.parametrize("channels", [None, 1, 2, 3, 4, 5])
def test_zero_time_returns_the_input_bit_for_bit_and_a_zero_mask_the_charts(dtype, channels):
    mesh, uv = square()
    uv = 0.1 + 0.7 * uv
    shape = (33, 40) if channels is None else (33, 40, channels)
    white = 1 if np.dtype(dtype).kind == "f" else np.iinfo(dtype).max
    image = (np.random.default_rng(0).random(shape) * white).astype(dtype)
    before = image.copy()
    out = smooth(mesh, uv, image, time=0)
    assert np.array_equal(out, image)
    assert out.dtype == dtype
    inside = core.TextureAtlas(mesh, uv, size=(33, 40)).inside
    out = smooth(mesh, uv, image, np.zeros((33, 40)))
    assert np.array_equal(out[inside], image[inside])
    assert np.array_equal(image, before)
    out = smooth(mesh, uv, image, beta=1.0)
    assert not np.array_equal(out[inside], image[inside])
    assert out.dtype == dtype
    low, high = image[inside].min(axis=0), image[inside].max(axis=0)
    assert (low <= out[inside]).all()
    assert (out[inside] <= high).all()


def test_a_mask_mixes():
    clean, noise = photo(64, 64)
    image = clean + noise
    mesh, uv = square()
    mask = np.zeros((64, 64))
    mask[:, 32:] = 0.25
    full = smooth(mesh, uv, image, iterations=3)
    out = smooth(mesh, uv, image, mask, iterations=3)
    assert np.array_equal(out[:, :32], image[:, :32])
    assert np.allclose(out[:, 32:], image[:, 32:] + 0.25 * (full - image)[:, 32:], atol=1e-6)


def test_opacity_stays_and_transparent_texels_lend_no_color():
    clean, noise = photo(64, 64)
    blocks = Blocks(clean + noise, angle=0.3)
    color = blocks.texture()
    alpha = (gaussian_filter(np.random.default_rng(2).random(color.shape[:2]), 3) > 0.5) * 1.0
    image = np.concatenate([color, alpha[..., None]], axis=-1).astype(np.float32)
    image[alpha == 0, :3] = 9.0
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    inside = core.TextureAtlas(mesh, blocks.uv, size=color.shape[:2]).inside
    out = smooth(mesh, blocks.uv, image)
    assert np.array_equal(out[inside][:, 3], image[inside][:, 3])
    assert out[inside & (alpha == 1)][:, :3].max() <= color.max() + 1e-5
    flat, uv = square()
    part = image[:64, :64]
    assert np.abs(smooth(flat, uv, part) - smooth_image(part)).max() < 1e-4


def test_normals_turn_across_seams_and_stay_unit_vectors():
    slope = np.array([0.3, -0.2])
    blocks = Blocks(np.zeros((64, 64, 3), dtype=np.float32), angle=0.4)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    atlas = core.TextureAtlas(mesh, blocks.uv, size=(blocks.width, blocks.width))
    texture = np.full((blocks.width, blocks.width, 3), 0.5, dtype=np.float32)
    texture[..., 2] = 0.5 + 0.5 * np.sqrt(1 - slope @ slope)
    block = blocks._number(atlas.bake(blocks.vertices[blocks.faces])[..., :2])
    texture[..., :2] += 0.5 * np.einsum("bij,j->bi", np.array(blocks.turns), slope)[block]
    out = smooth(mesh, blocks.uv, texture, beta=0.0, content="normals")
    inside = atlas.inside
    assert np.abs(out - texture)[inside].max() < 1e-5
    as_colors = smooth(mesh, blocks.uv, texture, beta=0.0, seams="continue")
    assert np.abs(as_colors - texture)[inside].max() > 0.05
    noisy = texture + 0.03 * np.random.default_rng(0).normal(size=texture.shape)
    out = smooth(mesh, blocks.uv, noisy, content="normals")
    assert np.allclose(np.linalg.norm(2 * out[inside] - 1, axis=1), 1.0, atol=1e-5)
    assert rms((out - texture)[inside]) < 0.015
    with pytest.raises(core.InvalidSignal, match="three channels"):
        smooth(mesh, blocks.uv, texture[..., 0], content="normals")


def test_distances_are_those_on_the_surface(monkeypatch):
    monkeypatch.setattr(settings, "CUTOFF", 1e-4)
    # A texture that is squeezed to half its width reaches half as many texels across.
    mesh, uv = square()
    point = np.zeros((64, 32), dtype=np.float32)
    point[32, 16] = 1.0
    out = smooth(mesh, uv, point, beta=0.0, time=8.0, iterations=1)
    down, across = np.mgrid[:64, :32] - np.array([32, 16])[:, None, None]
    variances = [(out * d * d).sum() / out.sum() for d in (down, across)]
    # A texel is sqrt(2) high and sqrt(1/2) wide, or the other way round, in mean texel sizes.
    assert np.allclose(variances, [32.0, 8.0], rtol=0.05)


def test_results_do_not_depend_on_tiles_nor_on_place_turn_and_scale(monkeypatch):
    clean, noise = photo(64, 64)
    blocks = Blocks(clean + noise, angle=0.4)
    texture = blocks.texture()
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    out = smooth(mesh, blocks.uv, texture)
    monkeypatch.setattr(texel_smoothing, "_TILE", 17)
    assert np.abs(smooth(mesh, blocks.uv, texture) - out).max() < 1e-5
    moved = 17.0 * blocks.vertices @ rotation(3).T + (5.0, -9.0, 3.0)
    again = smooth(core.TriangleMesh(moved, blocks.faces), blocks.uv, texture)
    assert rms(again - out) < 1e-4


def test_where_texels_are_small_kernels_are_cut_off_alike_in_all_tiles(monkeypatch):
    # One half of the texture has texels 36 times smaller than the other.
    vertices, faces = grid(8, 8)
    vertices = vertices.astype(float)
    vertices[:, 0] = np.where(vertices[:, 0] > 4, 4 + 36 * (vertices[:, 0] - 4), vertices[:, 0])
    uv = grid(8, 8)[0][faces][..., :2] / 8.0
    mesh = core.TriangleMesh(vertices, faces)
    clean, noise = photo(48, 48)
    out = smooth(mesh, uv, clean + noise)
    monkeypatch.setattr(texel_smoothing, "_TILE", 17)
    assert np.abs(smooth(mesh, uv, clean + noise) - out).max() < 1e-4
    assert np.isfinite(out).all()


def test_progress_is_told_and_cancels():
    mesh, uv = square()
    image = photo(64, 64)[0]
    told = []
    core.beltrami_texture(mesh, uv, image, progress=lambda part, _: told.append(part) or True)
    assert told == sorted(told)
    assert len(told) > 10
    assert told[-1] == 1.0
    with pytest.raises(core.Cancelled):
        core.beltrami_texture(mesh, uv, image, progress=lambda part, _: part < 0.5)


def test_bad_input_is_named():
    mesh, uv = square()
    image = np.zeros((8, 8), dtype=np.float32)
    with pytest.raises(core.InvalidSignal, match="NaN"):
        smooth(mesh, uv, image + np.nan)
    with pytest.raises(core.InvalidSignal, match="mask"):
        smooth(mesh, uv, image, np.zeros((4, 4)))
    with pytest.raises(core.InvalidUV):
        smooth(mesh, np.full_like(uv, np.nan), image)
    with pytest.raises(core.InvalidSignal, match="atlas"):
        core.beltrami_texture(mesh, uv, image, atlas=core.TextureAtlas(mesh, uv, size=(9, 8)))
    bright = np.where(np.arange(8) < 4, 1e30, -1e30) * np.ones((8, 1))
    assert np.isfinite(smooth(mesh, uv, bright)).all()


def test_noise_is_measured_inside_charts():
    clean, noise = photo(64, 64, noise=0.03)
    mesh, uv = square()
    image = np.random.default_rng(3).random((128, 128, 3)).astype(np.float32)
    image[:64, :64] = clean + noise
    out = core.beltrami_texture(mesh, uv / 2, image)[:64, :64]
    assert rms(out - clean) < 0.7 * rms(noise)
