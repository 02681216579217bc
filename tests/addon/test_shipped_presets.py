# SPDX-License-Identifier: GPL-3.0-or-later
"""The presets that come with the extension do what their reasons say, on shapes made by code."""

import bpy
import numpy as np
import pytest
import shapes
from remeshed import turned_box
from scipy.ndimage import gaussian_filter
from shock_filter import core
from shock_filter.core import registry
from shock_filter.core.settings import (
    BeltramiGeometrySettings,
    BeltramiMeshSettings,
    BeltramiSettings,
)
from shock_filter.shock_addon.modes import find
from shock_filter.shock_addon.operators.properties import settings_from

DEFAULT = None


def use(mode, name):
    """Choose a preset, or the defaults, and return the scene's settings of the mode."""
    settings = getattr(bpy.context.scene.shock_filter, mode)
    for known in find(mode).names:
        settings.property_unset(known)
    if name is not DEFAULT:
        assert bpy.ops.shock_filter.use_preset(mode=mode, name=name) == {"FINISHED"}
    return settings


def noisy(points, amount, seed=0):
    return points + np.random.default_rng(seed).normal(scale=amount, size=points.shape)


def normals(vertices, faces):
    a, b, c = vertices[faces].swapaxes(0, 1)
    found = np.cross(b - a, c - a)
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def error(vertices, faces, true):
    """Return the mean angle to the true normals, in degrees."""
    cosines = (normals(vertices, faces) * normals(true, faces)).sum(axis=1)
    return np.degrees(np.arccos(np.clip(cosines, -1, 1))).mean()


def sharpened(name, vertices, faces):
    settings = settings_from(core.GeometrySettings, use("geometry", name))
    return core.sharpen_geometry(core.TriangleMesh(vertices, faces), settings)


def denoised(name, vertices, faces):
    settings = use("denoise", name)
    time = settings.sharpen_time if settings.then_sharpen else None
    kernel = settings_from(BeltramiGeometrySettings, settings)
    denoise = registry.find("denoise_geometry").function(time)
    return denoise(core.TriangleMesh(vertices, faces), settings=kernel)


@pytest.mark.parametrize("passes", [3, 6, 12])
def test_subtle_geometry_moves_less_far(passes):
    rounded, faces = shapes.soft_cube(20, passes)
    moves = [abs(sharpened(name, rounded, faces) - rounded).mean() for name in ("Subtle", DEFAULT)]
    assert 0 < moves[0] < 0.9 * moves[1]


def test_crisp_cad_edges_brings_wide_roundings_closer_to_the_creases():
    box, faces = shapes.cube(20)
    rounded = shapes.smoothed(box, faces, 12)
    crisp, default = (
        error(sharpened(name, rounded, faces), faces, box) for name in ("Crisp CAD Edges", DEFAULT)
    )
    assert crisp < 0.8 * default
    assert crisp < 0.6 * error(rounded, faces, box)


def test_remeshed_hard_surface_brings_sides_nearer_than_the_default():
    vertices, faces, axes = turned_box(40)

    def away(name):
        points = sharpened(name, vertices, faces)
        cosines = abs(normals(points, faces) @ axes.T).max(axis=1)
        return np.degrees(np.arccos(np.clip(cosines, -1, 1))).mean()

    assert away("Remeshed Hard Surface") < 0.9 * away(DEFAULT)
    assert away(DEFAULT) < 0.5 * away("As in the Paper")


def test_as_in_the_paper_moves_what_the_default_leaves():
    box, faces = shapes.cube(12)
    assert (sharpened(DEFAULT, box, faces) == box).all()
    mesh = core.TriangleMesh(box, faces)
    expected = core.sharpen_geometry(mesh, core.GeometrySettings.of_paper())
    assert (sharpened("As in the Paper", box, faces) == expected).all()
    assert abs(expected - box).max() > 0.1 * mesh.mean_edge_length


def test_carved_facets_flattens_a_sphere_into_facets():
    ball, faces = shapes.icosphere(4)
    ball = noisy(ball, 0.002)

    def flat(points):
        """Return which part of the edges bends by less than a quarter of the mean."""
        around = normals(points, faces)
        twins = core.TriangleMesh(points, faces).twins.reshape(-1) // 3
        cosines = (around.repeat(3, axis=0) * around[twins]).sum(axis=1)
        bends = np.arccos(np.clip(cosines, -1, 1))
        return (bends < bends.mean() / 4).mean()

    assert flat(sharpened("Carved Facets", ball, faces)) > 2 * flat(sharpened(DEFAULT, ball, faces))


def test_a_noisy_cad_part_comes_out_cleaner():
    box, faces = shapes.cube(20)
    scan = noisy(box, 0.3)
    chosen, default = (error(denoised(n, scan, faces), faces, box)
                       for n in ("Noisy CAD Part", DEFAULT))  # fmt: skip
    assert chosen < 0.98 * default  # which leaves little to do


def test_the_kernel_of_the_paper_is_that_of_earlier_versions():
    box, faces = shapes.cube(12)
    scan = noisy(box, 0.1)
    kernel = BeltramiGeometrySettings(method="beltrami")
    expected = core.denoise_geometry(core.TriangleMesh(scan, faces), kernel)
    assert (denoised("As in the Paper", scan, faces) == expected).all()


def test_noisy_vertex_colors_leaves_half_the_noise():
    sheet, faces = shapes.grid(40, 40)
    clean = np.where(sheet[:, :1] < 20, [0.2, 0.4, 0.6], [0.8, 0.3, 0.1])
    mesh = core.TriangleMesh(sheet, faces)

    def left(name):
        settings = settings_from(BeltramiMeshSettings, use("denoise", name), "color_")
        found = core.beltrami_vertex_signal(mesh, noisy(clean, 0.05), settings)
        return abs(found - clean).mean()

    assert bpy.context.scene.shock_filter.denoise.target == "geometry"
    assert left("Noisy Vertex Colors") < 0.7 * left(DEFAULT)
    use("denoise", "Noisy Vertex Colors")
    assert bpy.context.scene.shock_filter.denoise.target == "colors"


def picture():
    """A cartoon: areas of one color each."""
    y, x = np.mgrid[:96, :96]
    areas = (x // 24 + 2 * (np.hypot(x - 48, y - 48) < 30) + (y // 40)) % 5
    return np.random.default_rng(3).uniform(size=(5, 3))[areas]


def distance(a, b):
    return abs(a - b).mean()


def flat(values):
    """Return which part of the neighbors look alike."""
    return (abs(np.diff(values, axis=0)).max(axis=-1) < 1 / 255).mean()


def filtered(name, image):
    return core.sharpen_image(image, settings_from(core.ImageSettings, use("image", name)))


def test_subtle_images_change_less():
    image = gaussian_filter(picture(), (1, 1, 0))
    assert (
        0 < distance(filtered("Subtle", image), image) < distance(filtered(DEFAULT, image), image)
    )


@pytest.mark.parametrize(
    ("name", "than", "width"),
    [("Blurred Photo", "Subtle", 1.5), ("Very Blurred Photo", "Subtle", 3.0)],
)
def test_blurred_images_come_closer_to_what_they_were(name, than, width):
    image = gaussian_filter(picture(), (width, width, 0))
    chosen, other = (distance(filtered(n, image), picture()) for n in (name, than))
    assert max(chosen, other) < 0.9 * distance(image, picture())


def test_painterly_images_are_flat():
    y, x = np.mgrid[:96, :96]
    image = np.stack([0.5 + 0.4 * np.sin(x / 7 + k) * np.cos(y / 9) for k in range(3)], axis=-1)
    assert flat(filtered("Painterly Steady State", image)) > 2 * flat(filtered(DEFAULT, image))


def denoised_image(name, image):
    settings = use("denoise_image", name)
    time = settings.sharpen_time if settings.then_sharpen else None
    kernel = settings_from(BeltramiSettings, settings)
    return registry.find("beltrami_image").function(time)(image, settings=kernel)


def test_flat_colors_are_flat():
    slope = 0.1 * np.sin(np.arange(64) / 9)[:, None, None]
    image = noisy(picture()[:64, :64] + slope, 0.02)
    assert flat(denoised_image("Flat Colors", image)) > 2 * flat(denoised_image(DEFAULT, image))


def colored(name, width):
    """Sharpen a border between two colors, narrow at one end and of this width at the other.

    Returns what lies at the other end: the input and the result.
    """
    sheet, faces = shapes.grid(40, 40)
    wide = sheet[:, 1:2] > 20
    step = 0.5 + 0.5 * np.tanh((sheet[:, :1] - 20) / np.where(wide, width, 1.0))
    values = step * [0.8, 0.3, 0.1] + (1 - step) * [0.2, 0.4, 0.6]
    settings = settings_from(core.ShockSettings, use("colors", name))
    result = core.sharpen_vertex_signal(core.TriangleMesh(sheet, faces), values, settings)
    return values[wide[:, 0]], result[wide[:, 0]]


def blended(values):
    """Return which part of the colors is neither the one nor the other."""
    part = (values[:, 0] - 0.2) / 0.6
    return ((part > 0.1) & (part < 0.9)).mean()


def test_subtle_colors_change_half():
    subtle, default = (distance(*colored(name, 2.0)) for name in ("Subtle", DEFAULT))
    assert subtle == pytest.approx(0.5 * default)


@pytest.mark.parametrize("name", ["Crisp Borders", "Painterly Steady State"])
def test_wide_borders_become_crisp(name):
    chosen, default = (blended(colored(n, 4.5)[1]) for n in (name, DEFAULT))
    assert chosen < 0.7 * default


def test_normal_maps_stay_unit_length():
    sheet, faces = shapes.grid(8, 8)
    uv = (sheet[:, :2] / 8)[faces]
    y, x = np.mgrid[:64, :64] / 64
    directions = np.stack([np.sin(20 * x) / 2, np.cos(15 * y) / 2, np.ones_like(x)], axis=-1)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    settings = settings_from(core.TextureSettings, use("texture", "Normal Map"))
    result = core.sharpen_texture(
        core.TriangleMesh(sheet, faces), uv, 0.5 + 0.5 * directions, settings
    )
    lengths = np.linalg.norm(2 * result - 1, axis=-1)
    np.testing.assert_allclose(lengths[4:-4, 4:-4], 1.0, atol=1e-6)
    assert settings.alpha == "none"
