# SPDX-License-Identifier: GPL-3.0-or-later
import math
from dataclasses import replace

import numpy as np
import pytest
from atlases import Blocks, apart, sample
from scipy.ndimage import gaussian_filter
from shapes import grid, icosphere, rotation
from shock_filter import core
from shock_filter.core import registry
from shock_filter.core.host.inputs import Denoising, HostImage, TexturedFaces, TexturedSurface
from shock_filter.core.host.textures import filter_texture
from shock_filter.core.registry import FILTERS, TEXTURE


def photo(size=128, seed=0, sigma=1.5):
    """Soft blotches with edges, in [0, 1]: (size, size, 3) float32."""
    noise = np.random.default_rng(seed).normal(size=(size, size, 3))
    blotches = np.sign(gaussian_filter(noise, (4, 4, 0), mode="nearest"))
    soft = gaussian_filter(blotches, (sigma, sigma, 0), mode="nearest")
    return (0.5 + 0.4 * soft).astype(np.float32)


def points_on(size, count=40000, rim=2.0, seed=1):
    return rim + (size - 2 * rim) * np.random.default_rng(seed).random((count, 2))


def rms(difference):
    return float(np.sqrt(np.mean(np.square(difference))))


def flat_square(cells=4, rotate=None):
    """A square with texture coordinates 0 to 1 in one chart."""
    vertices, faces = grid(cells, cells)
    uv = vertices[faces][..., :2] / cells
    return core.TriangleMesh(vertices if rotate is None else vertices @ rotate.T, faces), uv


SETTINGS = [
    {},
    {"channels": "independent"},
    {"channels": "luminance"},
    {"sampling": "nearest"},
    {"smoothing_passes": 0},
    {"smoothing_passes": 3},
    {"time": math.inf},
]


@pytest.mark.parametrize("settings", SETTINGS)
def test_one_flat_chart_is_an_image(settings):
    image = photo(96)[:64]
    vertices, faces = grid(4, 4)
    mesh = core.TriangleMesh(vertices * (1.5, 1.0, 1.0) @ rotation().T + 7.0, faces)
    settings = {"time": 64.0, "alpha": "none"} | settings
    out = core.sharpen_texture(
        mesh, vertices[faces][..., :2] / 4, image, core.TextureSettings(**settings)
    )
    expected = core.sharpen_image(image, core.ImageSettings(**settings))
    assert rms(expected - image) > 0.005
    different = np.abs(out - expected).max(axis=-1) > 1e-3
    assert different.mean() < 2e-3  # flow-lines that decide at a pixel


@pytest.mark.parametrize("time", [4.0, 64.0, 1024.0])
def test_charts_whose_texels_line_up_do_not_show(time):
    picture = photo(128)
    blocks = Blocks(picture)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    out = core.sharpen_texture(
        mesh, blocks.uv, blocks.texture(0.0), core.TextureSettings(time=time)
    )
    expected = core.sharpen_image(picture, core.ImageSettings(time=time))
    y, x = np.mgrid[1:127, 1:127] + 0.5  # the rim is where seams meet the mesh's border
    found = blocks.read(out, np.stack([x, y], axis=-1))
    wrong = np.abs(found - expected[1:127, 1:127]).max(axis=-1) > 2e-3
    assert wrong.mean() < 1e-3


@pytest.mark.parametrize(("time", "bound"), [(4.0, 1.1), (64.0, 1.3), (1024.0, 2.5)])
def test_a_plane_cut_elsewhere_differs_by_the_resampling_only(time, bound):
    # In charts turned by odd angles the input is resampled, and the result read from other
    # texels: the bound is what that costs the input or the sharp result, whichever is more. At
    # long times it takes more, as where edges come to stand depends on the texels that saw them.
    # Seams must add nothing.
    picture = photo(128)
    points = points_on(128)
    blocks = Blocks(picture, angle=0.3)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    texture = blocks.texture(0.0)
    out = core.sharpen_texture(mesh, blocks.uv, texture, core.TextureSettings(time=time))
    expected = core.sharpen_image(picture, core.ImageSettings(time=time))
    resampling = 0.0
    for exact in (picture, expected):
        resampled = Blocks(exact, angle=0.3).texture(0.0)
        base = core.dilate_texture(mesh, blocks.uv, resampled)
        cost = rms(blocks.read(base, points) - sample(exact, points / 128))
        resampling = max(resampling, cost)
    error = blocks.read(out, points) - sample(expected, points / 128)
    assert 1e-3 < resampling < 0.02
    assert rms(error) < bound * resampling
    away = np.minimum(points % 32, 32 - points % 32).min(axis=1)
    assert rms(error[away < 2]) < 1.2 * rms(error[away > 4])


def cylinder(around=24, along=6, texels=96):
    """A tube and its two unwrappings: one seam; and three charts, cut and turned elsewhere."""
    radius = texels / (2 * math.pi)
    angle = 2 * math.pi * np.arange(around) / around
    height = np.arange(along + 1) * texels / around
    vertices = np.array(
        [(radius * np.cos(a), radius * np.sin(a), h) for h in height for a in angle]
    )
    i, j = np.meshgrid(np.arange(around), np.arange(along), indexing="ij")
    i, j = i.ravel(), j.ravel()
    corners = np.array([(0, 0), (1, 0), (1, 1)]), np.array([(0, 0), (1, 1), (0, 1)])
    places = np.concatenate(
        [np.stack([i, j], -1)[:, None] + np.array(c)[None] for c in corners]
    )  # (m, 3, 2): steps around and along
    faces = places[..., 1] * around + places[..., 0] % around
    return core.TriangleMesh(vertices, faces), places * texels / around, np.tile(i, 2)


def test_a_cylinder_cut_elsewhere_has_the_same_texture():
    texels = 96
    mesh, places, column = cylinder(texels=texels)
    rows = int(places[..., 1].max())
    ring = np.concatenate([photo(texels, seed=3)] * 3, axis=1)
    ring = gaussian_filter(ring, (0, 2, 0), mode="wrap")[:rows, texels : 2 * texels]
    ring = np.ascontiguousarray(ring)
    one = places / (texels, rows)
    settings = core.TextureSettings(time=64.0)
    first = core.sharpen_texture(mesh, one, ring, settings)
    # Three charts, one of them turned by a right angle, in an image of their own.
    size = 160
    third = column // 8
    local = places - np.stack([third * texels // 3, 0 * third], -1)[:, None]
    turned = np.stack([rows - local[..., 1], local[..., 0]], -1)
    spots = np.array([(20, 20), (80, 20), (20, 100)])
    moved = np.where(third[:, None, None] == 1, turned, local) + spots[third][:, None]
    other = np.zeros((size, size, 3), dtype=np.float32)
    for n, (x, y) in enumerate(spots):
        part = ring[:, n * texels // 3 : (n + 1) * texels // 3]
        part = part.transpose(1, 0, 2)[:, ::-1] if n == 1 else part
        other[y : y + part.shape[0], x : x + part.shape[1]] = part
    second = core.sharpen_texture(mesh, moved / size, other, settings)
    faces = np.random.default_rng(5).integers(0, mesh.face_count, 20000)
    weights = np.random.default_rng(6).dirichlet(np.ones(3), 20000)[..., None]
    at = (places[faces] * weights).sum(axis=1)
    inner = (at[:, 1] > 2) & (at[:, 1] < rows - 2)
    a = sample(first, (one[faces] * weights).sum(axis=1))[inner]
    b = sample(second, (moved[faces] / size * weights).sum(axis=1))[inner]
    before = sample(ring, (one[faces] * weights).sum(axis=1))[inner]
    seam = np.minimum(at[inner, 0] % 32, 32 - at[inner, 0] % 32) < 2
    assert rms(a - before) > 0.01
    assert rms(a[~seam] - b[~seam]) < 1e-3
    assert rms(a[seam] - b[seam]) < 5e-3  # reads texels around charts


def test_a_surface_whose_faces_all_lie_apart_has_no_seams():
    # Each triangle is a chart of its own: nothing but seams.
    vertices, faces = icosphere(2, radius=8.0)
    mesh = core.TriangleMesh(vertices, faces)
    uv, size = apart(mesh, texels_per_length=6.0)
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    assert atlas.report.charts == mesh.face_count
    places = atlas.bake(mesh.vertices[mesh.faces])
    waves = np.sin(3.0 * places[..., :1] + 0.5) * np.sin(3.0 * places[..., 1:2] + 1.0)
    texture = np.where(atlas.inside[..., None], 0.5 + 0.4 * waves, 0.0).astype(np.float32)
    out = core.sharpen_texture(mesh, uv, texture, core.TextureSettings(time=256.0), atlas=atlas)
    # Steeper, in range, and along every edge both faces agree.
    assert 0.1 - 1e-3 <= out[atlas.inside].min() <= out[atlas.inside].max() <= 0.9 + 1e-3
    before = np.abs(texture - 0.5)[atlas.inside].mean()
    assert np.abs(out - 0.5)[atlas.inside].mean() > 1.05 * before
    given = seam_jump(mesh, uv, core.dilate_texture(mesh, uv, texture))
    assert seam_jump(mesh, uv, out) < 2.0 * given < 0.02
    flat = core.sharpen_image(texture, core.ImageSettings(time=256.0))
    assert seam_jump(mesh, uv, flat) > 0.03


def test_whole_numbers_meet_better_at_seams_than_rounded_fractions():
    # Where a texture is nearly even, texels around charts may leave its range by one whole number.
    mesh = core.TriangleMesh(*icosphere(2, radius=8.0))
    uv, size = apart(mesh, texels_per_length=6.0)
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    at = 0.3 * atlas.bake(mesh.vertices[mesh.faces])
    waves = np.sin(at[..., :1] + 0.5) * np.sin(at[..., 1:2] + 1.0) * [1.6, 4.0, 8.0]
    image = np.rint(np.where(atlas.inside[..., None], 128 + waves, 0))
    settings = core.DilateSettings(seams="continue")
    whole, exact = (
        core.dilate_texture(mesh, uv, given, settings, atlas=atlas).astype(np.float64)
        for given in (image.astype(np.uint8), image / 255)
    )
    rounded = np.rint(255 * exact)
    assert 0 < np.abs(whole - rounded).max() <= 1
    jumps = [rms(np.subtract(*both_sides(mesh, uv, each))) for each in (whole, rounded)]
    assert jumps[0] < 0.98 * jumps[1]


def seam_jump(mesh, uv, image):
    """Mean difference of linear samples on both sides of all inner edges."""
    one, other = both_sides(mesh, uv, image)
    return np.abs(one - other).mean()


def both_sides(mesh, uv, image):
    """Linear samples along all inner edges, as the faces on their two sides show them."""
    half = np.flatnonzero(mesh.twins.ravel() > np.arange(3 * mesh.face_count))
    twin = mesh.twins.ravel()[half]
    share = np.linspace(0.05, 0.95, 9)[:, None, None]
    sides = []
    for edge, t in ((half, share), (twin, 1 - share)):
        a, b = uv[edge // 3, edge % 3], uv[edge // 3, (edge % 3 + 1) % 3]
        sides.append(sample(image, a + t * (b - a)))
    return sides


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
@pytest.mark.parametrize("channels", [None, 1, 2, 3, 4])
def test_zero_time_returns_the_input_bit_for_bit_and_a_zero_mask_the_charts(dtype, channels):
    mesh, uv = flat_square()
    uv = 0.1 + 0.7 * uv
    rng = np.random.default_rng(0)
    shape = (33, 40) if channels is None else (33, 40, channels)
    white = 1 if np.dtype(dtype).kind == "f" else np.iinfo(dtype).max
    image = (rng.random(shape) * white).astype(dtype)
    before = image.copy()
    out = core.sharpen_texture(mesh, uv, image, core.TextureSettings(time=0))
    assert np.array_equal(out, image)
    assert out.dtype == dtype
    inside = core.TextureAtlas(mesh, uv, size=(33, 40)).inside
    out = core.sharpen_texture(mesh, uv, image, mask=np.zeros((33, 40)))
    assert np.array_equal(out[inside], image[inside])
    dilated = core.dilate_texture(mesh, uv, image)
    assert np.array_equal(dilated[inside], image[inside])
    assert not np.array_equal(dilated[~inside], image[~inside])
    assert np.array_equal(image, before)
    still = core.sharpen_texture(mesh, uv, image, core.TextureSettings(amount=0.0))
    assert np.array_equal(still, image)
    moved = core.sharpen_texture(mesh, uv, image, core.TextureSettings(time=16.0))
    assert not np.array_equal(moved[inside], image[inside])


def test_a_mask_mixes():
    image = photo(64)
    mesh, uv = flat_square()
    mask = np.zeros((64, 64))
    mask[:, 32:] = 0.25
    settings = core.TextureSettings(time=64.0)
    full = core.sharpen_texture(mesh, uv, image, settings)
    out = core.sharpen_texture(mesh, uv, image, settings, mask=mask)
    assert np.array_equal(out[:, :32], image[:, :32])
    assert np.allclose(out[:, 32:], image[:, 32:] + 0.25 * (full - image)[:, 32:], atol=1e-6)


def test_opacity_stays_and_transparent_texels_lend_no_color():
    blocks = Blocks(photo(64))
    color = blocks.texture(0.0)
    alpha = (gaussian_filter(np.random.default_rng(2).random(color.shape[:2]), 3) > 0.5) * 1.0
    image = np.concatenate([color, alpha[..., None]], axis=-1).astype(np.float32)
    image[alpha == 0, :3] = 9.0
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    inside = core.TextureAtlas(mesh, blocks.uv, size=color.shape[:2]).inside
    out = core.sharpen_texture(mesh, blocks.uv, image, core.TextureSettings(time=64.0))
    assert np.array_equal(out[inside][:, 3], image[inside][:, 3])
    assert out[inside & (alpha == 1)][:, :3].max() <= color.max() + 1e-5


def test_colors_of_a_clear_texture_reach_the_gutter():
    blocks = Blocks(photo(64))
    image = np.full((*blocks.texture(0.0).shape[:2], 4), 0.5, dtype=np.float32)
    image[..., 3] = 0.0
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    settings = core.TextureSettings(time=16.0, background="nearest")
    out = core.sharpen_texture(mesh, blocks.uv, image, settings)
    assert np.allclose(out[..., :3], 0.5, atol=1e-6)
    assert (out[..., 3] == 0).all()


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_values_stay_in_range(dtype):
    scale = 1 if dtype == np.float32 else 255
    blocks = Blocks((photo(64) * scale).astype(dtype), angle=0.4)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    texture = blocks.texture(0)
    inside = core.TextureAtlas(mesh, blocks.uv, size=texture.shape[:2]).inside
    out = core.sharpen_texture(mesh, blocks.uv, texture, core.TextureSettings(time=256.0))
    for c in range(3):
        low, high = texture[inside][:, c].min(), texture[inside][:, c].max()
        assert low <= out[inside][:, c].min()
        assert out[inside][:, c].max() <= high
        around = out[inside | (out != texture).any(axis=-1)][:, c]
        assert low <= around.min() + 1e-6 * scale
        assert around.max() <= high + 1e-6 * scale
    flat = np.full_like(texture, texture[inside][0])
    assert np.allclose(core.sharpen_texture(mesh, blocks.uv, flat), flat, rtol=1e-5)


def test_the_metric_of_the_surface_counts():
    # A texture that is squeezed to half its width: flow-lines are as long on the surface.
    wide = photo(128)
    narrow = 0.5 * (wide[:, ::2] + wide[:, 1::2])
    mesh, uv = flat_square()
    settings = core.TextureSettings(time=256.0, smoothing_passes=0)
    a = core.sharpen_texture(mesh, uv, wide, settings)
    b = core.sharpen_texture(
        mesh, uv, narrow, core.TextureSettings(time=128.0**2 / 128, smoothing_passes=0)
    )
    change = 0.5 * (a[:, ::2] + a[:, 1::2]) - narrow
    stretched = (
        core.sharpen_image(narrow, core.ImageSettings(time=128.0, smoothing_passes=0)) - narrow
    )
    true = np.corrcoef(change.ravel(), (b - narrow).ravel())[0, 1]
    naive = np.corrcoef(change.ravel(), stretched.ravel())[0, 1]
    assert true > naive + 0.02


def test_results_do_not_depend_on_place_turn_and_scale_of_the_mesh():
    blocks = Blocks(photo(64), angle=0.4)
    texture = blocks.texture(0)
    settings = core.TextureSettings(time=64.0)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    out = core.sharpen_texture(mesh, blocks.uv, texture, settings)
    inside = core.TextureAtlas(mesh, blocks.uv, size=texture.shape[:2]).inside
    moved = 17.0 * blocks.vertices @ rotation(3).T + (5.0, -9.0, 3.0)
    again = core.sharpen_texture(
        core.TriangleMesh(moved, blocks.faces), blocks.uv, texture, settings
    )
    assert np.abs(out - again).max(axis=-1).mean() < 1e-4
    order = np.random.default_rng(0).permutation(len(blocks.faces))
    mixed = core.sharpen_texture(
        core.TriangleMesh(blocks.vertices, blocks.faces[order]), blocks.uv[order], texture, settings
    )
    assert np.abs(out - mixed)[inside].max(axis=-1).mean() < 1e-4
    turned = core.TriangleMesh(blocks.vertices, blocks.faces[:, ::-1])  # the other side out
    mirrored = core.sharpen_texture(turned, blocks.uv[:, ::-1], texture, settings)
    assert np.abs(out - mirrored)[inside].max(axis=-1).mean() < 1e-4


def test_faces_wound_against_the_rest_keep_their_coordinates():
    blocks = Blocks(photo(64))
    texture = blocks.texture(0)
    faces, uv = blocks.faces.copy(), blocks.uv.copy()
    faces[5:20], uv[5:20] = faces[5:20, ::-1], uv[5:20, ::-1]
    out = core.sharpen_texture(core.TriangleMesh(blocks.vertices, faces), uv, texture)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    expected = core.sharpen_texture(mesh, blocks.uv, texture)
    inside = core.TextureAtlas(mesh, blocks.uv, size=texture.shape[:2]).inside
    assert np.abs(out - expected)[inside].max(axis=-1).mean() < 1e-4


def test_normals_turn_across_seams_and_stay_unit_vectors():
    rng = np.random.default_rng(4)
    bumps = gaussian_filter(rng.normal(size=(128, 128, 2)), (3, 3, 0), mode="nearest") * 4
    n = np.concatenate([bumps, np.ones((128, 128, 1))], axis=-1)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    blocks = Blocks((0.5 + 0.5 * n).astype(np.float32))
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)

    def turned(image, back):
        # From the plane's axes to each chart's, or back; every chart of its own.
        out = image.copy()
        y, x = np.mgrid[: blocks.width, : blocks.width] + 0.5
        pitch = blocks.width // 4
        number = (x // pitch + 4 * (y // pitch)).astype(int)
        turn = np.array(blocks.turns)[number]
        turn = turn.transpose(0, 1, 3, 2) if back else turn
        out[..., :2] = 0.5 + np.einsum("yxij,yxj->yxi", turn, image[..., :2] - 0.5)
        return out

    plain = blocks.texture(0.5)
    inside = core.TextureAtlas(mesh, blocks.uv, size=plain.shape[:2]).inside
    settings = {"time": 64.0, "gutter": 0}
    out = core.sharpen_texture(
        mesh,
        blocks.uv,
        turned(plain, back=False),
        core.TextureSettings(content="normals", **settings),
    )
    lengths = np.linalg.norm(2 * out[inside] - 1, axis=-1)
    assert np.allclose(lengths, 1.0, atol=1e-5)
    values = core.sharpen_texture(mesh, blocks.uv, plain, core.TextureSettings(**settings))
    expected = 2 * values[inside] - 1
    expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
    found = 2 * turned(out, back=True)[inside] - 1
    assert rms(2 * values[inside] - 2 * plain[inside]) > 0.005
    assert np.mean(np.abs(found - expected).max(axis=-1) > 5e-3) < 2e-3


def test_texels_beyond_a_seam_hold_what_lies_there():
    picture = photo(64)
    blocks = Blocks(picture, angle=0.35)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    texture = blocks.texture(9.0)
    out = core.dilate_texture(mesh, blocks.uv, texture, core.DilateSettings(gutter=4))
    y, x = np.mgrid[: blocks.width, : blocks.width] + 0.5
    for b, (turn, centre, place) in enumerate(
        zip(blocks.turns, blocks.centres, blocks.places, strict=True)
    ):
        there = (np.stack([x, y], axis=-1) - place) @ turn + centre
        away = np.abs(there - centre) - blocks.block / 2
        distance = np.linalg.norm(np.maximum(away, 0.0), axis=-1)
        around = (distance > 0) & (distance < 4)
        if b in (5, 6, 9, 10):
            error = np.abs(out[around] - sample(picture, there[around] / 64))
            assert error.mean() < 0.01
            assert np.abs(texture[around] - sample(picture, there[around] / 64)).mean() > 0.2
    far = (out == texture).all(axis=-1)
    assert 0.3 < far.mean() < 0.95
    filled = core.dilate_texture(
        mesh, blocks.uv, texture, core.DilateSettings(gutter=4, background="nearest")
    )
    assert filled.max() < 2.0


def test_a_texture_that_leaves_the_image_repeats():
    image = photo(64)
    mesh, uv = flat_square()
    settings = core.TextureSettings(time=64.0)
    out = core.sharpen_texture(mesh, uv, image, settings)
    moved = core.sharpen_texture(mesh, uv + (3.0, -2.0), image, settings)
    assert np.allclose(out, moved, atol=1e-5)
    report = core.TextureAtlas(mesh, uv + (3.0, -2.0), size=(64, 64)).report
    assert len(report.outside) == 0
    assert report.sentences() == []
    half = core.sharpen_texture(mesh, uv + (0.5, 0.0), np.roll(image, 32, axis=1), settings)
    assert np.allclose(out, np.roll(half, -32, axis=1), atol=1e-4)
    assert len(core.TextureAtlas(mesh, uv + (0.5, 0.0), size=(64, 64)).report.outside) > 0


def test_a_texture_that_is_folded_has_a_seam_at_the_fold():
    # Both halves of a square show the same texels, mirrored; corners meet at the fold.
    half = photo(64)[:, :32]
    image = np.full((80, 48, 3), 5.0, dtype=np.float32)
    image[8:72, 8:40] = half
    vertices, faces = grid(4, 4)
    mesh = core.TriangleMesh(vertices, faces)
    places = 16 * vertices[faces][..., :2]
    uv = (np.abs(places - (32, 0)) + 8) / (48, 80)
    assert core.TextureAtlas(mesh, uv, size=(80, 48)).report.charts == 2
    filled = core.dilate_texture(mesh, uv, image, core.DilateSettings(gutter=4))
    assert np.abs(filled[9:71, 4:8] - half[1:63, 3::-1]).max() < 1e-3
    out = core.sharpen_texture(mesh, uv, image, core.TextureSettings(time=64.0))
    whole = np.concatenate([half[:, ::-1], half], axis=1)
    expected = core.sharpen_image(whole, core.ImageSettings(time=64.0))[:, 32:]
    assert np.abs(expected - half).max() > 0.05
    assert np.mean(np.abs(out[8:72, 8:40] - expected).max(axis=-1) > 2e-3) < 2e-3


def test_a_sliver_at_a_seam_does_not_read_far_beyond_it():
    # The left chart ends with a strip that is 8 wide and has a quarter of a texel: one texel
    # beyond the seam is 32 away. All is dark up to 5 beyond the seam.
    across = np.array([0.0, 24.0, 32.0, 64.0])
    vertices, faces = grid(3, 1)
    vertices = np.stack([across[vertices[:, 0].astype(int)], 64 * vertices[:, 1]], axis=-1)
    mesh = core.TriangleMesh(np.pad(vertices, ((0, 0), (0, 1))), faces)
    corners = vertices[faces]
    left = corners.mean(axis=1)[:, :1] < 32
    x = np.where(left, np.interp(corners[..., 0], across[:3], (8, 32, 32.25)), corners[..., 0] + 16)
    image = np.full((80, 96, 3), 0.1, dtype=np.float32)
    image[:, 48 + 5 :] = 0.9
    out = core.sharpen_texture(mesh, np.stack([x / 96, (corners[..., 1] + 8) / 80], axis=-1), image)
    assert out[8:72, 8:33].max() < 0.11


def test_cancelling_and_progress():
    blocks = Blocks(photo(64))
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    texture = blocks.texture(0)
    fractions = []
    core.sharpen_texture(
        mesh, blocks.uv, texture, progress=lambda f, m: fractions.append(f) or True
    )
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    for stop in (0.0, 0.3, 0.6):
        with pytest.raises(core.Cancelled):
            core.sharpen_texture(mesh, blocks.uv, texture, progress=lambda f, m, s=stop: f < s)


def on_host(blocks, opacity="STRAIGHT"):
    """What a host program keeps of them."""
    pixels = np.ones((blocks.width, blocks.width, 4), dtype=np.float32)
    pixels[..., :3] = blocks.texture(0)
    faces = TexturedFaces(blocks.vertices, blocks.faces, blocks.uv, None)
    return TexturedSurface(faces, HostImage(pixels, opacity, False, 0), None)


@pytest.mark.parametrize("opacity", ["STRAIGHT", "NONE"])
def test_any_filter_of_textures_may_be_followed_by_sharpening(monkeypatch, request, opacity):
    rows = [
        registry.Filter(**vars(row) | {"then": "sharpen_texture" * (row.kind is TEXTURE)})
        for row in FILTERS
    ]
    monkeypatch.setattr(registry, "FILTERS", rows)
    registry.find.cache_clear()
    request.addfinalizer(registry.find.cache_clear)
    surface = on_host(Blocks(photo(32)), opacity)
    settings = core.DilateSettings(gutter=2)
    told = []
    dilated = filter_texture(
        surface, "dilate_texture", settings, lambda f, m: told.append(m) or True
    )
    assert "Filling the gutter" in told
    assert not [message for message in told if "Sharpening" in message]
    between = replace(surface, picture=replace(surface.picture, pixels=dilated.recolored.colors))
    following = core.TextureSettings(time=4.0, gutter=2)
    sharp = filter_texture(between, "sharpen_texture", following)
    assert (sharp.recolored.colors != dilated.recolored.colors).any()
    both = filter_texture(surface, "dilate_texture", Denoising(settings, 4.0))
    np.testing.assert_array_equal(both.recolored.colors, sharp.recolored.colors)
    masked = replace(surface, mask=np.zeros(surface.picture.pixels.shape[:2]))
    kept = filter_texture(masked, "sharpen_texture", Denoising(core.TextureSettings(time=1.0), 4.0))
    inside = (
        core.TextureAtlas(
            core.TriangleMesh(surface.faces.positions, surface.faces.triangles),
            surface.faces.uv,
            size=masked.mask.shape,
        )
        .masks()
        .face
        >= 0
    )
    np.testing.assert_array_equal(kept.recolored.colors[inside], surface.picture.pixels[inside])


def test_what_is_kept_of_a_tried_picture_is_not_taken_for_another_at_its_address():
    surface = on_host(Blocks(photo(32)), opacity="CHANNEL_PACKED")
    grays = np.full(surface.picture.pixels.shape[:2], 1.0)
    surface = replace(surface, is_tried=True, grays=grays)
    pixels = surface.picture.pixels

    def tried(picture, gain):
        settings = core.FilterSettings(gain=gain)
        result = filter_texture(replace(surface, picture=picture), "filter_texture", settings)
        return result.recolored.colors

    def copied(values):
        return HostImage(values, "CHANNEL_PACKED", False, 0)

    one = copied(pixels)
    tried(one, 2.0), tried(one, 3.0)  # the second takes another solution
    tried(copied(pixels[::-1].copy()), 2.0)
    address = id(one)
    del one
    pictures = [copied(0.5 * pixels)]
    while id(pictures[-1]) != address and len(pictures) < 5000:
        pictures.append(copied(0.5 * pixels))
    tried(pictures[-1], 2.0)
    fresh = replace(surface, faces=replace(surface.faces), picture=pictures[-1], is_tried=False)
    direct = filter_texture(fresh, "filter_texture", core.FilterSettings(gain=3.0))
    np.testing.assert_allclose(tried(pictures[-1], 3.0), direct.recolored.colors, atol=1e-3)


def test_the_bar_of_a_hosts_texture_does_not_jump():
    surface = on_host(Blocks(photo(64)))
    told = []
    settings = core.TextureSettings()
    filter_texture(surface, "sharpen_texture", settings, lambda f, m: told.append((f, m)) or True)
    first = {message: fraction for fraction, message in reversed(told)}
    assert first["Finding charts"] < 0.05
    assert 0.25 < first["Computing the flow"] < 0.6
    assert 0.4 < first["Tracing flow-lines"] < 0.9
    assert first["Filling the gutter"] > 0.8
    assert told[-1][0] == 1.0


def test_bad_images_and_atlases_are_named():
    mesh, uv = flat_square()
    image = photo(32)
    broken = image.copy()
    broken[3, 4] = np.nan
    with pytest.raises(core.InvalidSignal, match="NaN"):
        core.sharpen_texture(mesh, uv, broken)
    with pytest.raises(core.InvalidSignal, match="shape"):
        core.sharpen_texture(mesh, uv, image[0, 0])
    with pytest.raises(core.InvalidSignal, match="mask"):
        core.sharpen_texture(mesh, uv, image, mask=np.ones((3, 3)))
    with pytest.raises(core.InvalidSignal, match="atlas is for"):
        core.sharpen_texture(mesh, uv, image, atlas=core.TextureAtlas(mesh, uv, size=(16, 16)))
    with pytest.raises(core.InvalidSignal, match="three channels"):
        core.sharpen_texture(mesh, uv, image[..., :2], core.TextureSettings(content="normals"))


def test_a_chart_around_the_rim_of_the_image_has_its_whole_gutter():
    image = photo(64)
    image[10:54, 10:54] += 5.0  # what is not filled stays far away
    mesh, uv = flat_square()
    uv = 0.2 + 0.5 * uv
    middle = core.dilate_texture(mesh, uv, image, core.DilateSettings(gutter=8))
    rolled = np.roll(image, (32, 32), axis=(0, 1))
    around = core.dilate_texture(mesh, uv + 0.5, rolled, core.DilateSettings(gutter=8))
    assert (middle != image).any(axis=-1).sum() > 500
    assert np.allclose(np.roll(around, (-32, -32), axis=(0, 1)), middle, atol=1e-5)


def test_normals_are_unit_vectors_under_a_mask_and_in_the_gutter():
    blocks = Blocks(photo(64), angle=0.3)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    texture = blocks.texture(0.0)
    atlas = core.TextureAtlas(mesh, blocks.uv, size=texture.shape[:2])
    lengths = np.linalg.norm(texture - 0.5, axis=-1, keepdims=True)
    texture = (0.5 + 0.5 * (texture - 0.5) / lengths).astype(np.float32)
    settings = core.TextureSettings(time=64.0, content="normals", gutter=4)
    mask = np.full(texture.shape[:2], 0.5)
    out = core.sharpen_texture(mesh, blocks.uv, texture, settings, mask=mask, atlas=atlas)
    changed = (out != texture).any(axis=-1)
    assert (changed & ~atlas.inside).sum() > 1000
    assert np.allclose(np.linalg.norm(2 * out[changed] - 1, axis=-1), 1.0, atol=1e-4)
    for channels in ("luminance", "independent"):
        wrong = core.TextureSettings(content="normals", channels=channels)
        with pytest.raises(core.InvalidSignal, match="coupled"):
            core.sharpen_texture(mesh, blocks.uv, texture, wrong)


@pytest.mark.parametrize("code", [">u2", ">f4", ">f8"])
def test_images_of_the_other_byte_order_are_taken(code):
    mesh, uv = flat_square()
    image = (photo(32) * (60000 if code == ">u2" else 1)).astype(code)
    plain = image.astype(image.dtype.newbyteorder("="))
    expected = core.sharpen_texture(mesh, uv, plain)
    assert np.array_equal(core.sharpen_texture(mesh, uv, image), expected)
    assert np.array_equal(core.sharpen_image(image), core.sharpen_image(plain))


def test_opacity_beyond_its_range_counts_as_none_or_all():
    mesh, uv = flat_square()
    image = np.concatenate([photo(48), np.ones((48, 48, 1))], axis=-1).astype(np.float32)
    image[:, 20:, 3] = -1e-3
    image[:20, :, 3] = 7.0
    out = core.sharpen_texture(mesh, uv, image, core.TextureSettings(time=100.0))
    assert np.array_equal(out[..., 3], image[..., 3])
    assert image[..., :3].min() <= out[..., :3].min()
    assert out[..., :3].max() <= image[..., :3].max()


def test_values_too_large_for_single_precision_are_named():
    mesh, uv = flat_square()
    with pytest.raises(core.InvalidSignal, match="beyond"):
        core.sharpen_texture(mesh, uv, np.full((8, 8, 3), 1e200))
