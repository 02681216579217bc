# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of enlarging textures: charts see across their seams."""

import numpy as np
import pytest
from atlases import Blocks
from scipy.ndimage import minimum_filter
from shock_filter import core
from shock_filter.core.repair.smoothest import share_of_first
from shock_filter.core.texture.texels import Texture


def waves(n, channels=3):
    y, x = (np.mgrid[:n, :n] + 0.5) / n * np.pi
    values = [np.cos((4 + c) * x) * np.cos((6 - c) * y) for c in range(channels)]
    return (0.5 + 0.3 * np.stack(values, axis=-1)).astype(np.float32)


def jumps(blocks, image):
    """How far values differ that stand on both sides of the seams along one axis."""
    along = np.linspace(4, 60, 200)
    off = []
    for place in (16.0, 32.0, 48.0):
        one, other = (
            blocks.read(image, np.stack([np.full(200, place + shift), along], axis=-1))
            for shift in (-1e-6, 1e-6)
        )
        off.append(np.abs(one - other))
    return float(np.mean(off))


@pytest.mark.parametrize("angle", [None, 0.4])
def test_seams_jump_less_than_if_the_image_alone_is_enlarged(angle):
    blocks = Blocks(waves(64), angle)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    image = blocks.texture()
    result = core.enlarge_texture(mesh, blocks.uv, image, core.EnlargeSettings(factor=2))
    alone = core.sharpen_image(image, core.ImageSettings(enlarge=2))
    assert result.shape == (2 * len(image), 2 * len(image), 3)
    assert jumps(blocks, result) < jumps(blocks, image) + 1 / 255
    assert jumps(blocks, result) < 0.5 * jumps(blocks, alone)


def test_it_comes_near_to_the_truth_inside_charts():
    blocks = Blocks(waves(64), 0.4)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    result = core.enlarge_texture(mesh, blocks.uv, blocks.texture(), core.EnlargeSettings(factor=2))
    points = np.random.default_rng(0).uniform(2, 62, size=(3000, 2))
    wanted = 0.5 + 0.3 * np.cos(4 * points[:, 0] / 64 * np.pi) * np.cos(
        6 * points[:, 1] / 64 * np.pi
    )
    off = blocks.read(result, points)[:, 0] - wanted
    assert np.sqrt(np.mean(off**2)) < 0.01


def test_types_stay_and_wrong_factors_are_refused():
    blocks = Blocks(waves(32))
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    image = np.uint8(255 * blocks.texture())
    assert (
        core.enlarge_texture(mesh, blocks.uv, image[..., 0], core.EnlargeSettings(factor=3)).dtype
        == np.uint8
    )
    inside = core.TextureAtlas(mesh, blocks.uv, size=image.shape[:2]).inside
    same = core.enlarge_texture(mesh, blocks.uv, image, core.EnlargeSettings(factor=1))
    assert (same[inside] == image[inside]).all()
    for factor in (0, 9, 1.5):
        with pytest.raises(core.InvalidSettings):
            core.enlarge_texture(mesh, blocks.uv, image, core.EnlargeSettings(factor=factor))


def test_normals_keep_unit_length():
    blocks = Blocks(waves(48), 0.4)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    normals = blocks.texture() - 0.5
    normals[..., 2] = 0.6
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    settings = core.EnlargeSettings(content="normals")
    found = core.enlarge_texture(mesh, blocks.uv, 0.5 + 0.5 * normals, settings)
    inside = core.TextureAtlas(mesh, blocks.uv, size=found.shape[:2]).inside
    lengths = np.linalg.norm(2 * found - 1, axis=2)[inside]
    assert np.abs(lengths - 1).max() < 1e-4


def decibels(found, wanted):
    return -10 * np.log10(np.mean((found - wanted) ** 2))


def test_background_that_was_mixed_into_rims_leaves_no_dark_lines():
    blocks = Blocks(waves(128), 0.4)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    fine = blocks.texture()
    n = len(fine)
    given = fine.reshape(n // 2, 2, n // 2, 2, 3).mean(axis=(1, 3))
    result = core.enlarge_texture(mesh, blocks.uv, given, core.EnlargeSettings(factor=2))
    alone = core.sharpen_image(given, core.ImageSettings(enlarge=2))
    inside = core.TextureAtlas(mesh, blocks.uv, size=(n, n)).inside
    of_alone = decibels(alone[inside], fine[inside])
    assert decibels(result[inside], fine[inside]) > of_alone - 0.2
    assert jumps(blocks, result) < jumps(blocks, given)


def test_clean_rims_are_enlarged_with_what_is_across_the_seams():
    blocks = Blocks(waves(128), 0.4)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    fine = blocks.texture()
    given = Blocks(waves(64), 0.4)
    given.width = blocks.width // 2  # the same layout, half as fine
    given.places = [place / 2 for place in blocks.places]
    image = given.texture()
    result = core.enlarge_texture(mesh, blocks.uv, image, core.EnlargeSettings(factor=2))
    alone = core.sharpen_image(image, core.ImageSettings(enlarge=2))
    inside = core.TextureAtlas(mesh, blocks.uv, size=fine.shape[:2]).inside
    of_alone = decibels(alone[inside], fine[inside])
    assert decibels(result[inside], fine[inside]) > of_alone + 6


def test_a_noisy_background_is_no_more_painted_than_a_plain_one():
    blocks = Blocks(waves(64), 0.4)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    atlas = core.TextureAtlas(mesh, blocks.uv, size=blocks.texture().shape[:2])
    around = ~atlas.inside[..., None]
    plain = np.where(around, np.float32(0.1), blocks.texture())
    noise = 1e-3 * np.random.default_rng(0).normal(size=plain.shape).astype(np.float32)
    one, other = (
        core.enlarge_texture(mesh, blocks.uv, image, core.EnlargeSettings(factor=2))
        for image in (plain, plain + around * noise)
    )
    assert np.abs(one - other).max() < 0.01


def test_the_picture_without_a_fault_at_the_rims_is_taken():
    blocks = Blocks(waves(128), 0.4)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    image = blocks.texture()
    atlas = core.TextureAtlas(mesh, blocks.uv, size=image.shape[:2])
    rims = atlas.inside & ~minimum_filter(atlas.inside, size=3)
    dark = np.where(rims[..., None], 0.5 * image, image)
    texture = Texture(atlas, image)
    of_first = share_of_first(texture, image, dark)
    of_dark = share_of_first(texture, dark, image)
    assert np.quantile(of_first[rims], 0.05) > 0.95
    assert np.abs(of_first + of_dark - 1)[atlas.inside].max() < 1e-5
    far = minimum_filter(atlas.inside, size=11)
    assert far.any()
    assert (of_first[far] == 0.5).all()
    assert (of_first[~atlas.inside] == 0).all()
