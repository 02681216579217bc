# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of filling textures: what is missing follows from what is around it on the surface."""

import io

import numpy as np
import pytest
from atlases import Blocks
from PIL import Image
from scipy import ndimage
from shapes import grid, icosphere
from shock_filter import core
from shock_filter.core.repair.missing import unseen_in_compressed, unseen_texels, widened
from shock_filter.core.repair.quarters import enlarged, reduced


def linear(x, y):
    return np.stack([np.full_like(x, 0.5), 0.2 + 0.6 * x, 0.8 * y + 0.1 * x], axis=-1)


def plane(n, angle, function=linear):
    """A plane cut into charts, its texture by a function of places, and holes over its seams."""
    blocks = Blocks(np.zeros((n, n, 3), np.float32), angle)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    atlas = core.TextureAtlas(mesh, blocks.uv, size=(blocks.width, blocks.width))
    x, y = np.moveaxis(atlas.bake(mesh.vertices[mesh.faces])[..., :2] / n, -1, 0)
    image = function(x, y).astype(np.float32)
    centers = np.array([(0.5, 0.5), (0.25, 0.5), (0.75, 0.3)])
    hole = np.zeros(x.shape, dtype=bool)
    for center in centers:
        hole |= np.hypot(x - center[0], y - center[1]) < 0.13
    return blocks, mesh, atlas, image, hole & atlas.inside


@pytest.mark.parametrize("surface", ["membrane", "thin_plate"])
@pytest.mark.parametrize("angle", [None, 0.4])
def test_linear_functions_come_back_across_seams(surface, angle):
    blocks, mesh, atlas, image, hole = plane(64, angle)
    broken = np.where(hole[..., None], np.float32(0.9), image)
    settings = core.FillSettings(surface=surface)
    result = core.fill_texture(mesh, blocks.uv, broken, settings, missing=hole, atlas=atlas)
    assert hole.sum() > 500
    assert np.abs(result - image)[hole].max() < 1e-3
    known = atlas.inside & ~hole
    assert (result[known] == broken[known]).all()


def test_a_thin_plate_continues_slopes_that_a_membrane_loses():
    blocks, mesh, atlas, image, hole = plane(
        64, 0.4, lambda x, y: np.stack([x * x + y * y, x**2, x * y], axis=-1)
    )
    errors = {}
    for surface in ("membrane", "thin_plate"):
        settings = core.FillSettings(surface=surface)
        result = core.fill_texture(mesh, blocks.uv, image, settings, missing=hole, atlas=atlas)
        errors[surface] = np.abs(result - image)[hole].max()
    assert errors["membrane"] > 0.01
    assert errors["thin_plate"] < 0.1 * errors["membrane"]


def test_the_result_does_not_depend_on_where_the_seams_are():
    def waves(x, y):
        return np.stack([0.5 + 0.4 * np.sin(5 * x) * np.cos(4 * y)] * 3, axis=-1)

    found, gone = [], []
    points = np.random.default_rng(0).uniform(2, 126, size=(4000, 2))
    for angle in (None, 0.4, 0.9):
        blocks, mesh, atlas, image, hole = plane(128, angle, waves)
        result = core.fill_texture(mesh, blocks.uv, image, missing=hole, atlas=atlas)
        found.append(blocks.read(result, points)[:, 0])
        gone.append(blocks.read(hole[..., None].astype(np.float32), points)[:, 0])
    # Where a hole ends, turned charts have other texels missing.
    rim = (np.max(gone, axis=0) > 0.01) & (np.min(gone, axis=0) < 0.99)
    for one, other in ((0, 1), (1, 2)):
        away = np.abs(found[one] - found[other])
        assert away[~rim].max() < 0.5 / 255
        assert away.max() < 1 / 255


def ball(size=96):
    """A ball whose charts are its octants."""
    vertices, faces = icosphere(3)
    centers = vertices[faces].mean(axis=1)
    chart = (centers > 0) @ [1, 2, 4]
    corners = vertices[faces]
    flat = np.einsum("fkx,fxy->fky", corners, _axes(centers))
    uv = (flat + 1.0) / 2.2
    uv = (uv + np.stack([chart % 3, chart // 3], axis=-1)[:, None]) / 3.0
    mesh = core.TriangleMesh(vertices, faces)
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    return mesh, uv, atlas


def _axes(centers):
    # Two axes across each octant's diagonal.
    normal = np.where(centers > 0, 1.0, -1.0) / np.sqrt(3.0)
    first = np.cross(normal, [0.3, 0.2, 1.0])
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([first, np.cross(normal, first)], axis=-1)


def test_a_chart_without_any_known_texel_takes_colors_from_across_its_seams():
    mesh, uv, atlas = ball()
    chart = atlas.masks().chart
    image = np.full((96, 96, 3), [0.2, 0.5, 0.7])
    missing = chart == 3
    image[missing] = 0.0
    result = core.fill_texture(mesh, uv, image, missing=missing)
    assert missing.sum() > 100
    assert np.abs(result[missing] - [0.2, 0.5, 0.7]).max() < 2e-3


def test_values_stay_in_the_range_around_a_hole():
    mesh, uv, atlas = ball()
    rng = np.random.default_rng(0)
    image = rng.uniform(0.25, 0.75, (96, 96, 3)).astype(np.float32)
    missing = (rng.random((96, 96)) < 0.4) & atlas.inside
    image[missing] = 7.0
    result = core.fill_texture(mesh, uv, image, missing=missing)
    assert result[missing].min() > 0.25 - 1e-3
    assert result[missing].max() < 0.75 + 1e-3


def test_filled_light_is_not_below_0_and_filled_opacity_stays_opacity():
    mesh, uv, atlas = ball()
    rng = np.random.default_rng(0)
    image = 1e4 * rng.random((96, 96, 4)) ** 8
    image[..., 3] = np.hypot(*np.mgrid[-48:48, -48:48]) < 20
    missing = (rng.random((96, 96)) < 0.4) & atlas.inside
    for surface in ("membrane", "thin_plate"):
        settings = core.FillSettings(surface=surface, grain=1.0)
        result = core.fill_texture(mesh, uv, image, settings, missing=missing)
        assert result.min() == 0
        assert result[..., 3].max() == 1
        np.testing.assert_array_equal(
            result[~missing & atlas.inside], image[~missing & atlas.inside]
        )
        signed = core.fill_texture(mesh, uv, image[..., :3] - 1e3, settings, missing=missing)
        assert signed[missing].min() < -1e3  # such as heights


def test_parts_of_which_nothing_is_known_take_the_nearest_colors():
    vertices, faces = grid(4, 4)
    both = np.concatenate([vertices, vertices + [0.0, 0.0, 0.1], vertices + [0.0, 0.0, 5.0]])
    count = len(vertices)
    mesh = core.TriangleMesh(both, np.concatenate([faces, faces + count, faces + 2 * count]))
    one = vertices[faces][..., :2] / (3.5 * vertices.max())
    uv = np.concatenate([one, one + [1 / 3, 0.0], one + [2 / 3, 0.0]])
    atlas = core.TextureAtlas(mesh, uv, size=(96, 96))
    chart = atlas.masks().chart
    image = np.zeros((96, 96, 3), np.float32)
    image[chart == 0], image[chart == 2] = 0.25, 0.75
    result = core.fill_texture(mesh, uv, image, missing=chart == 1)
    assert np.abs(result[chart == 1] - 0.25).max() < 1e-3


def test_transparent_texels_are_found_and_become_opaque():
    mesh, uv, atlas = ball()
    image = np.full((96, 96, 4), 200, np.uint8)
    image[..., 3] = 255
    hole = np.zeros((96, 96), dtype=bool)
    hole[10:20, 8:20] = True
    image[hole] = 0
    assert (core.find_missing(mesh, uv, image) == (hole & atlas.inside)).all()
    result = core.fill_texture(mesh, uv, image)
    assert (result[hole & atlas.inside] == [200, 200, 200, 255]).all()


@pytest.mark.parametrize("quality", [50, 85])
def test_black_faces_are_found_in_compressed_pictures_and_black_eyes_are_not(quality):
    mesh, uv, atlas = ball(512)
    face = atlas.masks().face
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    places = atlas.bake(mesh.vertices[mesh.faces])
    colors = 140 + 60 * np.sin(4 * places + [0.0, 1.0, 2.0])
    unseen = middles[:, 2] > 0.85
    hole = (face >= 0) & unseen[np.maximum(face, 0)]
    eye = np.zeros_like(hole)
    for center in ([0.7, 0.6, -0.4], [-0.7, 0.6, -0.4], [0.1, -0.9, -0.4]):
        eye |= ((places - center) ** 2).sum(axis=-1) < 0.17**2
    eye &= atlas.inside
    for black in (hole | eye, eye):
        spoiled = np.where(black[..., None], 0, colors).astype(np.uint8)
        file = io.BytesIO()
        Image.fromarray(spoiled).save(file, "JPEG", quality=quality)
        image = np.asarray(Image.open(file))
        found = core.find_missing(mesh, uv, image, atlas=atlas)
        assert (found == (unseen_in_compressed(atlas, image) | unseen_texels(atlas, image))).all()
        assert not (found & ~widened(hole, 6)).any()
        if black is eye:
            assert not found.any()
        else:
            assert found[hole].mean() > 0.95


def test_black_faces_are_found_and_painted_black_is_not():
    mesh, uv, atlas = ball(192)
    face = atlas.masks().face
    rng = np.random.default_rng(0)
    image = rng.integers(60, 200, (192, 192, 3)).astype(np.uint8)
    unseen = mesh.vertices[mesh.faces].mean(axis=1)[:, 2] > 0.7
    black = (face >= 0) & unseen[np.maximum(face, 0)]
    y, x = np.mgrid[:192, :192]
    painted = (np.hypot(y - 40, x - 30) < 11) & ~black
    assert (painted & atlas.inside).sum() > 200
    image[black], image[painted] = 0, 0
    assert (unseen_texels(atlas, image) == black).all()
    result = core.fill_texture(mesh, uv, image)
    assert result[black].min() > 55 and (result[painted & atlas.inside] == 0).all()


def test_a_color_may_stand_for_what_is_missing():
    mesh, uv, atlas = ball()
    image = np.full((96, 96, 3), 90, np.uint8)
    image[10:20, 8:20] = [255, 0, 255]
    result = core.fill_texture(mesh, uv, image, missing=[255, 0, 255])
    assert (result[atlas.inside] == 90).all()
    with pytest.raises(core.InvalidSignal, match="as many as the image"):
        core.fill_texture(mesh, uv, image, missing=[255, 0])


def test_where_nothing_is_missing_the_image_stays_bit_for_bit():
    mesh, uv, _ = ball()
    image = np.random.default_rng(0).integers(9, 256, (96, 96, 3)).astype(np.uint8)
    for given in ({}, {"missing": np.zeros((96, 96))}):
        result = core.fill_texture(mesh, uv, image, **given)
        assert (result == image).all() and result is not image


def test_a_soft_mask_mixes():
    mesh, uv, atlas = ball()
    image = np.full((96, 96), 0.6, np.float32)
    mask = np.zeros((96, 96))
    mask[10:20, 8:20] = 0.5
    image[mask > 0] = 0.2
    result = core.fill_texture(mesh, uv, image, missing=mask)
    assert np.abs(result[(mask > 0) & atlas.inside] - 0.4).max() < 1e-3


def test_normals_are_filled_as_vectors():
    blocks, mesh, _, _, hole = plane(64, 0.4)
    flat = np.broadcast_to(np.float32([0.5, 0.5, 1.0]), (*hole.shape, 3)).copy()
    flat[hole] = 0.1
    settings = core.FillSettings(content="normals")
    result = core.fill_texture(mesh, blocks.uv, flat, settings, missing=hole)
    assert np.abs(result[hole] - [0.5, 0.5, 1.0]).max() < 1e-3


def test_large_textures_begin_with_smaller_ones():
    vertices, faces = grid(4, 4)
    mesh = core.TriangleMesh(vertices, faces)
    uv = vertices[faces][..., :2] / vertices.max()
    x = np.broadcast_to(np.linspace(0.0, 1.0, 512), (512, 512))
    image = np.stack([x, x.T, 0.5 + 0 * x], axis=-1).astype(np.float32)
    hole = np.hypot(x - 0.4, x.T - 0.6) < 0.3
    result = core.fill_texture(mesh, uv, image, missing=hole)
    assert np.abs(result - image)[hole].max() < 5e-3


@pytest.mark.parametrize("dtype", [np.uint8, np.float64])
def test_reading_a_reduced_ramp_gives_the_ramp_and_what_is_unknown_does_not_count(dtype):
    *_, atlas = ball()
    ramp = np.broadcast_to(2.0 * np.arange(96)[:, None, None], (96, 96, 2))
    image = ramp.astype(dtype)
    known = np.ones((96, 96), dtype=bool)
    image[:4, :4], known[:4, :4] = 250, False
    image[8:12, ::2], known[8:12, ::2] = 250, False
    means, lacking = reduced(image, known)
    assert lacking.sum() == 1 and lacking[0, 0] and (means[0, 0] == 0).all()
    white = 255.0 if dtype == np.uint8 else 1.0
    middles = np.broadcast_to(ramp[1::4, 1::4] + 1.0, means.shape)
    np.testing.assert_allclose(white * means[1:], middles[1:], rtol=1e-5)
    where = atlas.inside.copy()
    where[:6] = where[-2:] = False
    found = enlarged(means, atlas, where).reshape(-1, 2)[atlas.owners]
    np.testing.assert_allclose(white * found[where], ramp[where], rtol=1e-4)


def test_what_cannot_be_filled_is_refused():
    mesh, uv, _ = ball()
    image = np.zeros((96, 96, 3))
    with pytest.raises(core.InvalidSignal, match="Nothing is known"):
        core.fill_texture(mesh, uv, image, missing=np.ones((96, 96)))
    with pytest.raises(core.InvalidSignal, match="shape"):
        core.fill_texture(mesh, uv, image, missing=np.ones((9, 9)))


def grainy(strength, softness):
    """A ramp with grain of three channels, for `plane`."""
    noise = np.random.default_rng(5).normal(size=(300, 300, 3))
    noise = ndimage.gaussian_filter(noise, (softness, softness, 0))
    noise *= strength / noise.std()

    def values(x, y):
        ramp = 0.5 + 0.3 * (x - 0.5)[..., None]
        return ramp + noise[np.int32(299 * y.clip(0, 1)), np.int32(299 * x.clip(0, 1))]

    return values


def detail(image):
    return image - ndimage.uniform_filter(image, (5, 5, 0))


@pytest.mark.parametrize("softness", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("angle", [None, 0.4])
def test_grain_is_as_that_around(angle, softness):
    blocks, mesh, atlas, image, hole = plane(96, angle, grainy(0.05, softness))
    inner = ndimage.binary_erosion(hole, iterations=3)
    found = []
    for grain in (0.0, 0.5, 1.0):
        settings = core.FillSettings(grain=grain)
        result = core.fill_texture(mesh, blocks.uv, image, settings, missing=hole, atlas=atlas)
        known = atlas.inside & ~hole
        assert (result[known] == image[known]).all()
        found.append(detail(result)[inner].std())
    truth = detail(image)[inner].std()
    assert found[0] < 0.02 * truth
    assert found[1] == pytest.approx(0.5 * truth, rel=0.15)
    assert found[2] == pytest.approx(truth, rel=0.15)


def test_grain_differs_from_place_to_place_and_borders_are_none():
    def half(x, y):
        noise = 0.05 * np.random.default_rng(1).normal(size=(*x.shape, 3))
        flat = np.where((x + 0.3 * y < 0.6)[..., None], 0.25, 0.75)
        return flat + noise * (y > 0.5)[..., None]

    blocks, mesh, atlas, image, _ = plane(96, None, half)
    y = atlas.bake(mesh.vertices[mesh.faces])[..., 1] / 96
    strip = atlas.inside & ((np.abs(y - 0.2) < 0.06) | (np.abs(y - 0.8) < 0.06))
    settings = core.FillSettings(grain=1.0)
    result = core.fill_texture(mesh, blocks.uv, image, settings, missing=strip, atlas=atlas)
    smooth = core.fill_texture(mesh, blocks.uv, image, missing=strip, atlas=atlas)
    added = (result - smooth)[strip & (y < 0.5)], (result - smooth)[strip & (y > 0.5)]
    assert np.abs(added[0]).max() < 0.03 > 10 * np.abs(added[0]).mean()  # a border is there
    assert added[1].std() == pytest.approx(0.05, rel=0.25)


def test_grain_leaves_opacity_and_constants():
    blocks, mesh, atlas, image, hole = plane(64, 0.4, grainy(0.05, 0.0))
    opacity = np.where(np.random.default_rng(2).random(hole.shape) < 0.5, 0.7, 0.8)
    both = np.concatenate([image, opacity[..., None]], axis=-1).astype(np.float32)
    settings = core.FillSettings(grain=1.0, find="auto")
    grain, none = (
        core.fill_texture(mesh, blocks.uv, both, each, missing=hole, atlas=atlas)
        for each in (settings, core.FillSettings())
    )
    np.testing.assert_allclose(grain[..., 3], none[..., 3], atol=5e-3)  # of the solves
    constant = np.full_like(image, 0.3)
    result = core.fill_texture(mesh, blocks.uv, constant, settings, missing=hole, atlas=atlas)
    assert np.abs(result[atlas.inside] - 0.3).max() < 1e-5


def test_grain_of_charts_of_single_texels_is_finite():
    one = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    vertices, faces = np.concatenate([one, one + 3.0]), [[0, 1, 2], [3, 4, 5]]
    corner = np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]])
    uv = np.array([corner + 0.17, corner + 0.67])
    mesh = core.TriangleMesh(vertices, faces)
    image = np.random.default_rng(0).random((8, 8, 3)).astype(np.float32)
    missing = np.zeros((8, 8))
    missing[:4, :4] = 1.0
    result = core.fill_texture(mesh, uv, image, core.FillSettings(grain=1.0), missing=missing)
    assert np.isfinite(result).all()


def test_a_missing_color_may_be_far_above_1():
    image = np.tile(np.linspace(0.2, 0.9, 16), (16, 1)).astype(np.float32)
    image[4:8, 4:8] = 1000.1
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    mesh, uv = core.TriangleMesh(square, faces), square[faces][..., :2]
    assert core.fill_texture(mesh, uv, image, missing=[1000.1]).max() < 1
