# SPDX-License-Identifier: GPL-3.0-or-later
"""Textures are sharpened by the learned recipe as images are, and seams do not show."""

import math

import numpy as np
import pytest
from atlases import Blocks
from scipy import ndimage
from shapes import grid, icosphere, rotation
from shock_filter import core
from shock_filter.core.atlas.cell_means import COARSE, FINE, CellMeans, _squares, _walk
from shock_filter.core.atlas.ghosts import (
    fill_ghosts,
    fill_planes,
    find_reads,
    nearest_nodes,
)
from shock_filter.core.base.findings import gathering
from shock_filter.core.color.learned.planes import Planes
from shock_filter.core.grid.channels import Channels
from shock_filter.core.sparse.matrix import row_sums
from shock_filter.core.texture.texel_planes import Surface, TexelPlanes
from test_textures_by_width import flat_square, painted, rms


def spoiled(size=128, sigma=1.5, seed=3):
    """Shapes with some texture, blurred: (size, size, 3) float32."""
    noise = np.random.default_rng(seed).normal(size=(size, size, 1))
    texture = ndimage.gaussian_filter(noise, (1.5, 1.5, 0))
    sharp = painted(size, 0.4, seed) + 0.05 * texture / texture.std()
    return ndimage.gaussian_filter(sharp, (sigma, sigma, 0)).astype(np.float32)


def cut(picture, angle=None):
    """A picture on a square in 16 charts: mesh, blocks, and its texture."""
    blocks = Blocks(picture, angle)
    return core.TriangleMesh(blocks.vertices, blocks.faces), blocks


def test_one_flat_chart_is_an_image():
    image = spoiled()
    mesh, uv = flat_square()
    out = core.sharpen_texture(mesh, uv, image)
    expected = core.sharpen_image(image)
    change = rms(expected - image)
    assert change > 0.01
    # Smoothing is by steps of a texel, so that networks are told numbers that differ a little.
    assert rms(out - expected) < 0.25 * change


@pytest.mark.parametrize("angle", [None, 0.3])
def test_seams_do_not_show(angle):
    picture = spoiled()
    mesh, blocks = cut(picture, angle)
    given = blocks.texture(0.0)
    out = core.sharpen_texture(mesh, blocks.uv, given)
    whole, uv = flat_square()
    expected = core.sharpen_texture(whole, uv, picture)
    y, x = np.mgrid[2:126, 2:126] + 0.5
    points = np.stack([x, y], axis=-1)
    change = rms(expected - picture)
    assert change > 0.01
    error = np.abs(blocks.read(out, points) - expected[2:126, 2:126]).max(axis=-1)
    resampled = np.abs(blocks.read(given, points) - picture[2:126, 2:126]).max(axis=-1)
    assert np.sqrt(np.mean(error**2)) < 0.3 * change + 2 * np.sqrt(np.mean(resampled**2))
    # Texels beside seams are no worse than those in the middles of charts.
    away = np.abs((points + 16) % 32 - 16).min(axis=-1)
    beside, middle = error[away < 2], error[away > 8]
    assert np.sqrt(np.mean(beside**2)) < 2.0 * np.sqrt(np.mean(middle**2))


def test_steps_at_seams_do_not_tell_that_all_is_sharp():
    picture = ndimage.gaussian_filter(painted(256, 0.4, 3), (2.5, 2.5, 0)).astype(np.float32)
    y, x = np.mgrid[:256, :256]
    negative = ((y // 64 + x // 64) % 2 == 1)[..., None]
    mesh, blocks = cut(np.where(negative, 1 - picture, picture))
    given = blocks.texture(0.0)
    out = core.sharpen_texture(mesh, blocks.uv, given)
    whole, uv = flat_square()
    expected = core.sharpen_texture(whole, uv, picture)
    middle = (np.abs((np.stack([x, y]) + 0.5 + 32) % 64 - 32).min(axis=0) > 12)[..., None]
    points = np.stack([x, y], axis=-1) + 0.5
    change = (blocks.read(out, points) - blocks.read(given, points)) * middle
    wanted = (expected - picture) * middle
    assert rms(wanted) > 0.01
    assert rms(np.where(negative, -1, 1) * change - wanted) < 0.25 * rms(wanted)


def test_nothing_leaves_the_local_range():
    image = spoiled()
    mesh, uv = flat_square()
    out = core.sharpen_texture(mesh, uv, image)
    low = ndimage.minimum_filter(image, (15, 15, 1))
    high = ndimage.maximum_filter(image, (15, 15, 1))
    assert (out >= low - 1e-6).all()
    assert (out <= high + 1e-6).all()


@pytest.mark.parametrize("angle", [0.3, 0.7, 1.1])
@pytest.mark.parametrize("value", [0.37, 0.1, 1000.37])
def test_constants_stay(angle, value):
    color = np.float32(value) * np.array([1.0, 0.7, 0.31], np.float32)
    mesh, blocks = cut(np.tile(color, (64, 64, 1)), angle)
    given = np.tile(color, (blocks.width, blocks.width, 1))
    out = core.sharpen_texture(mesh, blocks.uv, given)
    inside = core.TextureAtlas(mesh, blocks.uv, size=given.shape[:2]).inside
    np.testing.assert_array_equal(out[inside], given[inside])


def test_the_gutter_changes_nothing_beside_opacity():
    color = spoiled()
    opacity = np.ones((128, 128, 1), np.float32)
    opacity[30:60, 30:70] = 0
    mesh, blocks = cut(np.concatenate([color, opacity], axis=2), 0.3)
    inside = core.TextureAtlas(mesh, blocks.uv, size=(blocks.width, blocks.width)).inside
    settings = core.TextureSettings(seams="continue")
    one, two = (
        core.sharpen_texture(mesh, blocks.uv, blocks.texture(gutter), settings)[inside]
        for gutter in (0.0, [1e6, 1e6, 1e6, 1.0])
    )
    seen = one[:, 3] == 1
    np.testing.assert_array_equal(one[seen], two[seen])


def test_values_that_overflow_are_refused():
    mesh, uv = flat_square()
    with pytest.raises(core.InvalidSignal, match=r"1e\+15"):
        core.sharpen_texture(mesh, uv, 1e17 * spoiled())


def test_scaled_and_shifted_values_give_scaled_and_shifted_results():
    image = spoiled()
    mesh, uv = flat_square()
    out = core.sharpen_texture(mesh, uv, image)
    other = core.sharpen_texture(mesh, uv, 0.25 + 0.5 * image)
    assert rms(other - (0.25 + 0.5 * out)) < 2e-4


def test_a_turned_mesh_of_another_size_gives_the_same():
    image = spoiled()
    mesh, uv = flat_square()
    other = core.TriangleMesh(mesh.vertices @ rotation().T * 37.0 + 5.0, mesh.faces)
    one, two = core.sharpen_texture(mesh, uv, image), core.sharpen_texture(other, uv, image)
    assert rms(one - two) < 1e-3


def test_charts_of_any_scale_close_alike():
    # The same texels, on a square that is larger in space than another one beside it.
    image = spoiled(128)
    wide = np.concatenate([image, image], axis=1)
    vertices, faces = grid(4, 4)
    uv = vertices[faces][..., :2] / 4
    vertices = np.concatenate([vertices, 1.7 * vertices + (10.0, 0.0, 0.0)])
    faces = np.concatenate([faces, faces + len(vertices) // 2])
    uv = np.concatenate([uv * (0.5, 1.0), uv * (0.5, 1.0) + (0.5, 0.0)])
    out = core.sharpen_texture(core.TriangleMesh(vertices, faces), uv, wide)
    inner = slice(8, -8)
    one, two = out[inner, 8:120], out[inner, 136:248]
    assert rms(one - two) < 0.1 * rms(one - image[inner, inner])


def test_a_given_width_counts():
    image = spoiled(sigma=1.5)
    mesh, uv = flat_square()
    narrow, wide = (
        core.sharpen_texture(mesh, uv, image, core.TextureSettings(width=width))
        for width in (1.0, 8.0)
    )
    assert rms(wide - image) > 1.1 * rms(narrow - image)


@pytest.mark.parametrize("seed", [0, 1])
def test_transparent_texels_lend_no_color(seed):
    color = spoiled(seed=seed)
    opacity = np.zeros((128, 128, 1), np.float32)
    opacity[:, 40:] = 1.0
    image = np.concatenate([color, opacity], axis=2)
    other = image.copy()
    other[:, :40, :3] = 7.0
    mesh, uv = flat_square()
    first, second = (core.sharpen_texture(mesh, uv, each) for each in (image, other))
    np.testing.assert_array_equal(first[:, 40:], second[:, 40:])
    assert (first[:, 40:] != image[:, 40:]).any()
    assert np.isfinite(second).all()


def test_transparent_textures_on_charts_of_any_scale_stay_without_warnings():
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    mesh = core.TriangleMesh(np.concatenate([square, 8 * square + 2]), [*faces, *faces + 4])
    uv = np.concatenate([0.8 * square, 0.1 * square + 0.85])[mesh.faces, :2]
    image = np.zeros((64, 64, 4), np.float32)
    np.testing.assert_array_equal(core.sharpen_texture(mesh, uv, image), image)


def test_masks_keep_bits_and_amount_mixes():
    image = spoiled()
    mesh, uv = flat_square()
    full = core.sharpen_texture(mesh, uv, image)
    mask = np.zeros((128, 128))
    mask[:, 64:] = 1.0
    part = core.sharpen_texture(mesh, uv, image, mask=mask)
    np.testing.assert_array_equal(part[:, :64], image[:, :64])
    np.testing.assert_array_equal(part[:, 66:], full[:, 66:])
    half = core.sharpen_texture(mesh, uv, image, core.TextureSettings(amount=0.5))
    np.testing.assert_allclose(half, (image + full) / 2, atol=1e-5)


def test_walks_that_cross_a_seam_at_a_slant_end(caplog):
    mesh, blocks = cut(spoiled(sigma=3.0))
    settings = core.TextureSettings(time=math.inf)
    core.sharpen_texture(mesh, blocks.uv, blocks.texture(0.0), settings)
    assert not caplog.records


def test_progress_grows_and_cancels():
    mesh, blocks = cut(spoiled())
    seen = []
    core.sharpen_texture(
        mesh, blocks.uv, blocks.texture(0.0), progress=lambda done, text: seen.append(done) or True
    )
    assert seen == sorted(seen)
    assert len(seen) > 50
    for most in (0.1, 0.5, 0.8):
        with pytest.raises(core.Cancelled):
            core.sharpen_texture(
                mesh,
                blocks.uv,
                blocks.texture(0.0),
                progress=lambda done, _, most=most: done < most,
            )


# -------------------------------------------------------------------------------- planes of a sheet


@pytest.fixture(scope="module")
def surface():
    mesh, blocks = cut(spoiled(64), 0.3)
    atlas = core.TextureAtlas(mesh, blocks.uv, size=(blocks.width, blocks.width))
    return Surface(atlas)


def test_planes_are_filled_as_interleaved_values(surface):
    sheet, sources = surface.atlas.sheet, surface.atlas.sources
    values = np.random.default_rng(0).random((*sheet.nodes.shape, 3)).astype(np.float32)
    planes = np.ascontiguousarray(np.moveaxis(values, 2, 0))
    fill_ghosts(sheet, sources, values)
    fill_planes(find_reads(sheet, sources), planes)
    np.testing.assert_array_equal(np.moveaxis(planes, 0, 2), values)


def test_smoothing_in_a_flat_chart_is_that_of_an_image():
    mesh, uv = flat_square()
    image = spoiled()
    surface = Surface(core.TextureAtlas(mesh, uv, size=(128, 128)))
    values = surface.atlas.gather(image)
    channels = Channels(0, 3, -1, np.empty(0, np.float32))
    planes = TexelPlanes.of_texels(surface, values, channels)
    found = planes.smoothed((0.6, 1.6, 4.5), 0, len(values))[..., 1:-1, 1:-1]
    wanted = Planes.of(image, channels).smoothed((0.6, 1.6, 4.5), 0, 128)
    assert np.abs(found - wanted).max() < 0.02 * np.ptp(image)


def test_ranges_in_a_flat_chart_are_those_of_an_image():
    mesh, uv = flat_square()
    image = spoiled()
    surface = Surface(core.TextureAtlas(mesh, uv, size=(128, 128)))
    values = surface.atlas.gather(image)
    channels = Channels(0, 3, -1, np.empty(0, np.float32))
    planes = TexelPlanes.of_texels(surface, values, channels)
    for found, wanted in zip(
        planes.ranges((1, 2, 7), 0, len(values)),
        Planes.of(image, channels).ranges((1, 2, 7), 0, 128),
        strict=True,
    ):
        np.testing.assert_array_equal(found[..., 1:-1, 1:-1], wanted)


# ------------------------------------------------------------------------------- wide surroundings


@pytest.mark.parametrize("side", [FINE, COARSE])
def test_squares_hold_each_node_once_and_belong_to_a_chart(surface, side):
    atlas = surface.atlas
    squares = _squares(atlas.sheet, atlas.charts.labels, side)
    nodes = atlas.sheet.nodes
    inside = nodes >= 0
    assert (squares.owners[~inside] == -1).all()
    labels = atlas.charts.labels[nodes[inside]]
    np.testing.assert_array_equal(squares.labels[squares.owners[inside]], labels)
    y, x = np.nonzero(inside)
    place = y // side * -(-nodes.shape[1] // side) + x // side
    pairs = np.unique(np.stack([place, labels]), axis=1)
    assert pairs.shape[1] == (squares.counts > 0).sum()
    assert squares.counts.sum() == inside.sum()
    nearest = nearest_nodes(atlas.sheet, atlas.sources)
    walk = _walk(squares, atlas.sheet, nearest)
    np.testing.assert_allclose(row_sums(walk), 1.0, atol=1e-5)


def test_means_of_a_constant_are_it_everywhere(surface):
    means = CellMeans(surface.atlas)
    rows, columns = surface.inside.shape
    given = means.means(np.full((2, rows, columns), 0.3, np.float32))
    for wide in (means.smoothed(given), means.of_region(given)):
        read = means.rows(wide, 0, rows)
        np.testing.assert_allclose(read[:, surface.inside], 0.3, rtol=1e-5)


def test_means_follow_the_surface_over_seams():
    # Beside a bright half, means fall off as those of an image in one piece do.
    size = 256
    y, x = np.mgrid[:size, :size]
    picture = np.repeat(np.float32(x > 150)[..., None], 3, axis=2)
    mesh, blocks = cut(picture, 0.3)
    texture = blocks.texture(0.0)
    atlas = core.TextureAtlas(mesh, blocks.uv, size=texture.shape[:2])
    surface = Surface(atlas)
    bright = atlas.gather(texture)[None, ..., 0]
    means = CellMeans(atlas)
    points = np.stack([x, y], axis=-1)[8:-8, 8:-8] + 0.5
    for method, sigma, most in ((means.smoothed, 8.0, 0.08), (means.of_region, 32.0, 0.12)):
        read = np.moveaxis(means.rows(method(means.means(bright)), 0, len(surface.inside)), 0, 2)
        image = np.zeros((*texture.shape[:2], 1), np.float32)
        owners = atlas.owners
        image[atlas.inside] = read.reshape(-1, 1)[owners[atlas.inside]]
        image = core.dilate_texture(mesh, blocks.uv, image, atlas=atlas)
        found = blocks.read(image, points)[..., 0]
        wanted = ndimage.gaussian_filter(picture[..., 0], sigma, mode="mirror")[8:-8, 8:-8]
        assert np.abs(found - wanted).max() < most
        # Steps at seams are at most those from one square to the next.
        assert np.abs(np.diff(found, axis=1)).max() < 0.08


def test_a_closed_surface_of_many_charts_gets_through():
    ball = icosphere(3)
    mesh = core.TriangleMesh(*ball)
    count = mesh.face_count
    side = math.ceil(math.sqrt(count))
    row, column = np.divmod(np.arange(count), side)
    corner = np.stack([column, row], axis=1)[:, None] + np.array(
        [[0.1, 0.1], [0.9, 0.1], [0.1, 0.9]]
    )
    image = np.random.default_rng(4).random((256, 256, 3)).astype(np.float32)
    out = core.sharpen_texture(mesh, corner / side, image)
    assert np.isfinite(out).all()
    assert out.min() >= image.min()
    assert out.max() <= image.max()


def test_a_soft_decal_gets_a_crisp_outline_across_seams():
    y, x = np.mgrid[:128, :128] + 0.5
    truth = np.clip(40.5 - np.hypot(y - 64, x - 64), 0, 1)  # across the seams of 16 charts
    opacity = ndimage.gaussian_filter(truth, 2.2)
    picture = np.dstack([np.full((128, 128, 3), 0.6), opacity]).astype(np.float32)
    mesh, blocks = cut(picture)
    given = blocks.texture(0.0)
    inside = core.TextureAtlas(mesh, blocks.uv, size=given.shape[:2]).inside
    out = core.sharpen_texture(mesh, blocks.uv, given)
    hidden = inside & (given[..., 3] == 0)
    np.testing.assert_array_equal(out[hidden], given[hidden])
    np.testing.assert_allclose(out[inside][:, :3], 0.6, atol=1e-6)
    soft = lambda alpha: ((alpha > 0.03) & (alpha < 0.97)).mean()  # noqa: E731
    true, before, after = map(soft, (truth, given[inside][:, 3], out[inside][:, 3]))
    assert after - true < 0.15 * (before - true)


def test_the_report_of_opacity_is_about_what_was_mixed():
    color = spoiled()
    opacity = ndimage.gaussian_filter(1.0 * (color[..., :1] > color.mean()), (1.5, 1.5, 0))
    image = np.concatenate([color, opacity], axis=2).astype(np.float32)
    mesh, uv = flat_square()
    for mask, is_told in ((np.zeros((128, 128)), False), (np.ones((128, 128)), True)):
        with gathering() as findings:
            core.sharpen_texture(mesh, uv, image, mask=mask)
        assert ("Opacity was sharpened, too." in map(str, findings)) == is_told
