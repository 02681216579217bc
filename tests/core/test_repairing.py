# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of repairing textures: each step does its own, and nothing where nothing is to do."""

import numpy as np
import pytest
from atlases import Blocks
from scipy.ndimage import gaussian_filter, minimum_filter
from shock_filter import core
from shock_filter.core.repair.noticeable import (
    against_contrast,
    among_small,
    beside_detail,
    beside_seams,
)
from shock_filter.core.repair.repairing import _blur
from shock_filter.core.texture.texels import Texture

KEEP = {"blocks": 0, "denoise": 0, "fill": "nothing", "stitch": "nothing", "sharpen": 0}


def smooth(n=48):
    y, x = (np.mgrid[:n, :n] + 0.5) / n * np.pi
    values = [np.cos(2 * x + c) * np.cos(3 * y - c) for c in range(3)]
    return (0.5 + 0.3 * np.stack(values, axis=-1)).astype(np.float32)


@pytest.fixture(scope="module")
def model():
    blocks = Blocks(smooth(), 0.4)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    image = np.rint(255 * blocks.texture()).astype(np.uint8)
    atlas = core.TextureAtlas(mesh, blocks.uv, size=image.shape[:2])
    image = core.dilate_texture(mesh, blocks.uv, image, atlas=atlas)
    return mesh, blocks.uv, image, atlas


def around(mesh, atlas, share):
    """Texels of faces around a place, by a share of the way through the mesh."""
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    low, high = middles.min(axis=0), middles.max(axis=0)
    far = np.linalg.norm(middles - (low + share * (high - low)), axis=1)
    faces = atlas.masks().face
    return (far < 0.15 * (high - low).max())[faces] & (faces >= 0)


def off(atlas, found, image):
    return float(np.abs(found.astype(float) - image)[atlas.inside].mean())


def test_what_needs_nothing_stays_bit_for_bit_in_its_charts(model):
    mesh, uv, image, atlas = model
    settings = core.RepairSettings(stitch="nothing")
    result = core.repair_texture(mesh, uv, image, settings, atlas=atlas)
    assert (result[atlas.inside] == image[atlas.inside]).all()
    result = core.repair_texture(mesh, uv, image, atlas=atlas)
    assert (result != image).any(axis=2)[atlas.inside].mean() < 0.02  # texels at seams
    result = core.repair_texture(mesh, uv, image, core.RepairSettings(**KEEP), atlas=atlas)
    assert (result[atlas.inside] == image[atlas.inside]).all()


def test_unseen_faces_are_filled_and_noise_goes(model):
    mesh, uv, image, atlas = model
    rng = np.random.default_rng(0)
    spoiled = np.clip(image + rng.normal(0, 8, image.shape), 0, 255).round().astype(np.uint8)
    spoiled[around(mesh, atlas, 0.5)] = 0
    before = off(atlas, spoiled, image)
    calm = core.repair_texture(mesh, uv, spoiled, core.RepairSettings(**KEEP | {"denoise": 1}))
    full = core.repair_texture(mesh, uv, spoiled, core.RepairSettings(sharpen=0))
    assert off(atlas, full, image) < off(atlas, calm, image) < before


def test_only_what_the_colors_lack_is_filled_in_other_maps(model):
    mesh, uv, image, atlas = model
    hole, meant = around(mesh, atlas, 0.3), around(mesh, atlas, 0.8)
    color, rough = image.copy(), np.full(image.shape[:2], 200, dtype=np.uint8)
    color[hole] = 0
    rough[hole | meant] = 0
    settings = core.RepairSettings(**KEEP | {"fill": "auto"})
    _, found = core.repair_textures(mesh, uv, [color, rough], settings)
    assert (found[meant & atlas.inside] == 0).all()
    assert (found[hole & atlas.inside] > 190).all()


def test_maps_of_other_sizes_and_normals_are_enlarged_together(model):
    mesh, uv, image, _ = model
    flat = np.zeros((24, 24, 3), dtype=np.uint8)
    flat[:] = 128, 128, 255
    settings = core.RepairSettings(enlarge=2)
    found = core.repair_textures(mesh, uv, [image, flat], settings, contents=["values", "normals"])
    assert [len(each) for each in found] == [2 * len(image), 48]
    assert (np.abs(found[1].astype(int) - (128, 128, 255)) <= 1).all()


def test_values_whose_squares_overflow_are_refused_by_their_name(model):
    mesh, uv, image, _ = model
    large = image.astype(np.float32) * np.float32(1e17)
    with pytest.raises(core.InvalidSignal, match="holds values beyond 1e\\+15; scale or clip them"):
        core.repair_texture(mesh, uv, large)
    with pytest.raises(core.InvalidSignal, match="holds values beyond 1e\\+15; scale or clip them"):
        core.repair_textures(mesh, uv, [image, large])


def test_contents_must_be_as_many_as_images(model):
    mesh, uv, image, _ = model
    with pytest.raises(core.InvalidSignal, match="give one of each"):
        core.repair_textures(mesh, uv, [image], contents=["values", "normals"])


def test_what_is_black_all_over_is_meant(model):
    mesh, uv, image, atlas = model
    black = np.zeros(image.shape[:2], dtype=np.uint8)
    assert (core.repair_texture(mesh, uv, black, atlas=atlas) == 0).all()


@pytest.mark.parametrize(("share", "is_filled"), [(0.3, True), (0.7, False)])
def test_texels_can_be_missing_up_to_a_half(model, share, is_filled):
    mesh, uv, image, atlas = model
    rows = np.arange(len(image))[:, None] < share * len(image)
    opacity = np.where(np.broadcast_to(rows, image.shape[:2]), 0, 255).astype(np.uint8)
    image = np.dstack([image, opacity])  # decals in a material that does not show opacity
    settings = core.RepairSettings(**{**KEEP, "fill": "auto"})
    result = core.repair_texture(mesh, uv, image, settings, atlas=atlas)
    hidden = atlas.inside & (opacity == 0)
    assert bool((result[..., 3][hidden] == 255).any()) == is_filled


def test_a_run_can_be_cancelled(model):
    mesh, uv, image, _ = model
    with pytest.raises(core.Cancelled):
        core.repair_texture(mesh, uv, image, progress=lambda fraction, _: fraction < 0.3)


@pytest.mark.parametrize("kind", ["uint8", "uint16", "float32", "float64"])
def test_stitching_keeps_the_bits_of_texels_away_from_seams(model, kind):
    mesh, uv, image, atlas = model
    noise = np.random.default_rng(1).normal(0, 0.02, image.shape)
    values = np.clip(image / 255 + noise, 0, 1)
    spoiled = values.astype(kind)
    if kind[0] == "u":
        spoiled = np.rint(values * np.iinfo(kind).max).astype(kind)
    settings = core.RepairSettings(**KEEP | {"stitch": "seams"})
    result = core.repair_texture(mesh, uv, spoiled, settings, atlas=atlas)
    assert result.dtype == spoiled.dtype
    same = (result == spoiled).all(axis=2)
    far = minimum_filter(atlas.inside, size=9)
    assert far.any()
    assert same[far].all()
    assert not same[atlas.inside].all()


def test_normals_have_unit_length_after_stitching(model):
    mesh, uv, image, atlas = model
    normals = np.random.default_rng(2).normal(0, 0.15, image.shape) + (0, 0, 1)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    settings = core.RepairSettings(**KEEP | {"stitch": "seams"}, content="normals")
    result = core.repair_texture(mesh, uv, normals / 2 + 0.5, settings, atlas=atlas)
    lengths = np.linalg.norm(2 * result - 1, axis=2)[atlas.inside]
    assert (result != normals / 2 + 0.5)[atlas.inside].any()
    assert np.abs(lengths - 1).max() < 1e-5


def test_opacity_stays_where_only_unseen_faces_are_filled(model):
    mesh, uv, image, atlas = model
    hole, cut = around(mesh, atlas, 0.3), around(mesh, atlas, 0.8)
    opacity = np.where(cut, 0, np.where(hole, 90, 255)).astype(np.uint8)
    picture = np.dstack([image, opacity])
    picture[hole | cut, :3] = 0
    settings = core.RepairSettings(**KEEP | {"fill": "unseen"})
    result = core.repair_texture(mesh, uv, picture, settings, atlas=atlas)
    assert (result[..., 3] == opacity)[atlas.inside].all()
    assert (result[hole & atlas.inside, :3] > 0).any(axis=1).all()


def test_the_background_around_charts_does_not_decide_about_sharpening(model):
    _, _, image, atlas = model
    soft = gaussian_filter(np.where(atlas.inside, image[..., 0], 0).astype(float), 1.2)
    flat = np.where(atlas.inside, 120, np.rint(soft)).astype(np.uint8)
    settings = core.RepairSettings()
    assert _blur(atlas, flat, settings) == 0


def test_borders_that_blocks_made_wide_need_less_sharpening():
    mesh = core.TriangleMesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    atlas = core.TextureAtlas(mesh, mesh.vertices[mesh.faces][..., :2], size=(128, 128))
    y, x = np.mgrid[:128, :128]
    soft = np.rint(gaussian_filter(200.0 * ((y // 16 + x // 16) % 2), 1.0)).astype(np.uint8)
    settings = core.RepairSettings()
    assert 0 <= _blur(atlas, soft, settings, unblocked=True) < _blur(atlas, soft, settings) <= 1


def decibels(found, wanted, where):
    difference = found[where].astype(float) - wanted[where]
    return -10 * np.log10(max(np.mean(difference**2), 1e-9) / 255**2)


def square():
    mesh = core.TriangleMesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    return mesh, mesh.vertices[mesh.faces][..., :2]


def test_small_changes_by_sharpening_are_left():
    y, x = np.mgrid[:128, :128]
    levels = []
    for length in (38.0, 54.0, 70.0):
        u, v = 2 * np.pi * x / length, 2 * np.pi * y / length
        levels.append(np.sin(u) * np.cos(v) + np.sin(v) * 0.5 + 0.6 * np.cos(u))
    level = np.stack(levels, axis=-1)
    soft = np.rint(127.5 + 100 * np.tanh(level / 0.35)).astype(np.uint8)
    mesh, uv = square()
    whole = np.ones((128, 128), dtype=bool)
    found = core.repair_texture(mesh, uv, soft)
    alone = core.sharpen_texture(mesh, uv, soft)
    assert decibels(found, soft, whole) > decibels(alone, soft, whole) + 6


def test_a_change_counts_by_its_share_of_the_contrast():
    inside = np.ones((32, 32), dtype=bool)
    values = np.zeros((32, 32, 1), dtype=np.float32)
    values[:, 16:] = 1.0
    change = np.zeros_like(values)
    change[:, 15:17] = 1.0
    shares = [against_contrast(inside, values, a * change)[16, 15] for a in (0.0, 0.02, 0.2)]
    assert shares[0] == 0
    assert shares[1] < 0.1
    assert shares[2] > 0.9
    # Faint borders need as large a share.
    again = against_contrast(inside, 0.1 * values, np.float32(0.02) * change)[16, 15]
    assert abs(again - shares[2]) < 1e-3


def test_a_step_at_a_seam_counts_by_how_it_stands_out_from_detail(model):
    _, _, image, atlas = model
    noise = np.random.default_rng(3).normal(0, 25, image.shape)
    fine = np.clip(image + noise, 0, 255).astype(np.uint8)
    change = np.full(image.shape, 0.02, dtype=np.float32)
    smooth_part, fine_part = (
        beside_detail(Texture(atlas, pixels), change)[atlas.inside] for pixels in (image, fine)
    )
    assert np.median(smooth_part) > 0.8
    assert np.median(fine_part) < 0.1


def test_small_changes_among_large_ones_are_left():
    inside = np.ones((48, 48), dtype=bool)
    change = np.zeros((48, 48, 3), dtype=np.float32)
    change[:, 24] = 0.01
    change[24:, 24] = 0.2
    change[40, 24] = 0.01
    shares = among_small(inside, change, 0.05)
    assert shares[8, 24] > 0.99  # alone
    assert shares[40, 24] < 0.05
    assert shares[34, 24] < 0.01  # large itself
    change[:] = 0.05
    np.testing.assert_allclose(among_small(inside, change, 0.05), 0.5, atol=1e-3)


def test_dark_rims_of_charts_are_not_sharpened(model):
    _, _, image, atlas = model
    inside = atlas.inside[..., None]
    dark = gaussian_filter(np.where(inside, image, 0).astype(float), (1, 1, 0)).astype(np.uint8)
    sound, spoiled = (beside_seams(Texture(atlas, each)) for each in (image, dark))
    deep = minimum_filter(atlas.inside, 9)
    assert (sound[deep] == 1).all() and (spoiled[deep] == 1).all()
    rims = atlas.inside & ~minimum_filter(atlas.inside, 3)
    assert np.median(sound[rims]) > 0.6
    assert np.median(spoiled[rims]) < 0.2


def test_charts_in_another_light_become_one_where_stitching_everywhere():
    # At seams alone, steps that are seen stay: they may lie between materials.
    blocks = Blocks(smooth(64), 0.4)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    image = blocks.texture()
    atlas = core.TextureAtlas(mesh, blocks.uv, size=image.shape[:2])
    chart, inside = atlas.masks().chart, atlas.inside
    steps = 0.15 * np.random.default_rng(0).uniform(-1, 1, chart.max() + 1).astype(np.float32)
    broken = image + np.where(chart >= 0, steps[chart], np.float32(0.0))[..., None]

    def spread(pixels):
        return float(np.std((pixels - image)[inside].mean(axis=1)))

    found = {
        where: core.repair_texture(
            mesh, blocks.uv, broken, core.RepairSettings(**{**KEEP, "stitch": where}), atlas=atlas
        )
        for where in ("everywhere", "seams")
    }
    assert spread(found["everywhere"]) < 0.5 * spread(broken)
    assert spread(found["seams"]) > 0.9 * spread(broken)
