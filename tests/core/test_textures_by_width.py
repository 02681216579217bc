# SPDX-License-Identifier: GPL-3.0-or-later
"""Textures are sharpened by width as images are, and seams do not show."""

import numpy as np
import pytest
from atlases import Blocks
from scipy.ndimage import gaussian_filter
from shapes import grid, rotation
from shock_filter import core
from shock_filter.core.base.findings import gathering


def painted(size=128, sigma=1.5, seed=0):
    """Blotches of a few colors with soft borders, in [0, 1]: (size, size, 3) float32."""
    noise = np.random.default_rng(seed).normal(size=(size, size, 3))
    blotches = np.sign(gaussian_filter(noise, (8, 8, 0), mode="nearest"))
    return (0.5 + 0.3 * gaussian_filter(blotches, (sigma, sigma, 0))).astype(np.float32)


def flat_square():
    vertices, faces = grid(4, 4)
    mesh = core.TriangleMesh(vertices @ rotation().T, faces)
    return mesh, vertices[faces][..., :2] / 4


def rms(difference):
    return float(np.sqrt(np.mean(np.square(difference))))


@pytest.mark.parametrize("settings", [
    {"what": "drawing", "width": 4.0},
    {"what": "photo", "width": 4.0},
    {"what": "drawing", "width": 4.0, "channels": "luminance"},
    {"what": "photo", "width": 10.0, "channels": "independent"},
    {"what": "drawing"},
])  # fmt: skip
def test_one_flat_chart_is_an_image(settings):
    image = painted()
    mesh, uv = flat_square()
    out = core.sharpen_texture(mesh, uv, image, core.TextureSettings(alpha="none", **settings))
    expected = core.sharpen_image(image, core.ImageSettings(alpha="none", **settings))
    inner = slice(16, -16)  # smoothing treats rims in another way
    change = rms(expected[inner, inner] - image[inner, inner])
    assert change > 0.01
    assert rms(out[inner, inner] - expected[inner, inner]) < 0.25 * change


@pytest.mark.parametrize("what", ["drawing", "photo"])
def test_charts_whose_texels_line_up_do_not_show(what):
    picture = painted()
    blocks = Blocks(picture)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    settings = {"what": what, "width": 4.0}
    out = core.sharpen_texture(
        mesh, blocks.uv, blocks.texture(0.0), core.TextureSettings(**settings)
    )
    whole, uv = flat_square()
    expected = core.sharpen_texture(whole, uv, picture, core.TextureSettings(**settings))
    y, x = np.mgrid[12:116, 12:116] + 0.5
    seen = blocks.read(out, np.stack([x, y], axis=-1))
    difference = np.abs(seen - expected[12:116, 12:116]).max(axis=-1)
    assert np.median(difference) < 1e-3
    assert (difference > 0.05).mean() < 0.01


def test_the_surroundings_of_charts_are_no_borders():
    image = painted()
    mesh, uv = flat_square()
    small = np.zeros((256, 256, 3), np.float32)
    small[64:192, 64:192] = image
    with gathering() as found:
        core.sharpen_texture(mesh, 0.25 + uv / 2, small)
    with gathering() as wanted:
        core.sharpen_image(image)
    assert found[0].values["width"] == pytest.approx(wanted[0].values["width"], rel=0.05)
    assert str(found[0]).startswith("Borders")


def test_amount_and_masks_mix():
    image = painted()
    mesh, uv = flat_square()
    settings = {"what": "drawing", "width": 4.0}
    full = core.sharpen_texture(mesh, uv, image, core.TextureSettings(**settings))
    half = core.sharpen_texture(mesh, uv, image, core.TextureSettings(amount=0.5, **settings))
    inner = slice(8, -8)
    wanted = (image + full)[inner, inner] / 2
    np.testing.assert_allclose(half[inner, inner], wanted, atol=1e-3)
    mask = np.full((128, 128), 0.5)
    masked = core.sharpen_texture(
        mesh, uv, image, core.TextureSettings(amount=0.5, **settings), mask=mask
    )
    wanted = (0.75 * image + 0.25 * full)[inner, inner]
    np.testing.assert_allclose(masked[inner, inner], wanted, atol=1e-3)


def test_normals_turn_and_stay_unit_length():
    height = gaussian_filter(np.random.default_rng(1).normal(size=(128, 128)), 6)
    down, across = np.gradient(np.tanh(height / height.std() * 3))
    normals = np.stack([-4 * across, -4 * down, np.ones_like(down)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    image = (0.5 + 0.5 * gaussian_filter(normals, (1.5, 1.5, 0))).astype(np.float32)
    mesh, uv = flat_square()
    settings = core.TextureSettings(content="normals", width=5.0)
    out = 2.0 * core.sharpen_texture(mesh, uv, image, settings) - 1.0
    np.testing.assert_allclose(np.linalg.norm(out[8:-8, 8:-8], axis=-1), 1.0, atol=1e-3)
    assert rms(out - (2.0 * image - 1.0)) > 0.01


@pytest.mark.parametrize("what", ["drawing", "photo"])
def test_transparent_texels_lend_no_color(what):
    color = painted()
    opacity = np.zeros((128, 128, 1), np.float32)
    opacity[:, 40:] = 1.0
    image = np.concatenate([color, opacity], axis=2)
    other = image.copy()
    other[:, :40, :3] = 7.0
    mesh, uv = flat_square()
    settings = core.TextureSettings(what=what, width=5.0)
    first, second = (core.sharpen_texture(mesh, uv, each, settings) for each in (image, other))
    np.testing.assert_allclose(first[:, 40:], second[:, 40:], atol=1e-4)
    assert np.isfinite(second).all()
