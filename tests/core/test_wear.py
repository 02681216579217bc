# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of masks of worn edges, dirt and dust."""

import numpy as np
import pytest
from shock_filter import core
from surface_patches import SURFACES, laid_out, patch

SIZE = 64, 64


def profile(*points):
    """A strip along y with this profile in x and z, in one chart."""
    points = np.array(points, dtype=float)
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    vertices, texture = [], []
    for (x, z), s in zip(points, along / along[-1], strict=True):
        vertices += [[x, 0, z], [x, 4, z]]
        texture += [[s, 0], [s, 1]]
    a = 2 * np.arange(len(points) - 1)[:, None]
    faces = np.concatenate([a + [0, 2, 3], a + [0, 3, 1]])
    return core.TriangleMesh(vertices, faces), np.array(texture)[faces]


def across(image):
    return image[SIZE[0] // 2]


def even(**given):
    return core.WearSettings(breakup=0, rays=256, **given)


def test_only_convex_edges_are_worn_and_sharp_ones_more():
    # Up, a right angle, flat, 45 degrees down, then a groove up again.
    mesh, uv = profile((0, -2), (0, 0), (2, 0), (3.4, -1.4), (4.8, 0))
    image = across(core.wear(mesh, uv, even(width=0.6), size=SIZE))
    lengths = np.cumsum([2, 2, np.hypot(1.4, 1.4), np.hypot(1.4, 1.4)])
    place = lambda s: int(s / lengths[-1] * SIZE[1])  # noqa: E731
    sharp, blunt, groove = (image[place(s) - 1 : place(s) + 2].max() for s in lengths[:3])
    assert sharp > 0.8 > blunt > 0.2
    assert groove < 0.01
    assert image[place(2.7)] < 0.01 > image[place(3.0)]  # between edges
    assert (np.diff(image[place(2.0) + 1 : place(2.6) + 1]) < 0).all()  # fades


def test_a_blunt_foot_is_not_worn_though_it_is_shaded_smoothly():
    mesh, uv = profile((-4, 0), (0, 0), (3.3, 2.2))
    image = core.wear(mesh, uv, even(width=0.6), size=SIZE)
    assert image.max() < 0.001


def test_opposite_sides_of_a_thin_wall_are_no_edges():
    vertices, faces = plates(0.02)
    values = core.vertex_wear(core.TriangleMesh(vertices, faces), even(width=0.2))
    middle = (np.abs(vertices[:, :2]) < 0.5).all(axis=1)
    assert values[middle].max() < 1e-6


def plates(thick):
    """Two squares that face away from each other."""
    steps = np.linspace(-1, 1, 21)
    x, y = np.meshgrid(steps, steps, indexing="ij")
    top = np.stack([x, y, np.full_like(x, thick / 2)], axis=-1).reshape(-1, 3)
    a = np.arange(420).reshape(20, 21)[:, :20].reshape(-1)
    faces = np.concatenate([np.stack([a, a + 21, a + 22], 1), np.stack([a, a + 22, a + 1], 1)])
    return np.concatenate([top, top * [1, 1, -1]]), np.concatenate([faces, faces[:, ::-1] + 441])


def test_dirt_gathers_in_grooves_and_dust_on_top():
    mesh, uv = profile((0, -2), (0, 0), (2, 0), (2, -2), (6, -2))
    dirt = across(core.wear(mesh, uv, even(kind="dirt", width=1.0), size=SIZE))
    dust = across(core.wear(mesh, uv, even(kind="dust"), size=SIZE))
    place = lambda s: int(s / 10 * SIZE[1])  # noqa: E731
    assert dirt[place(6.0)] > 0.4
    assert dirt[place(3.0)] < 0.01 and dirt[place(9.0)] < 0.01
    assert dust[place(3.0)] > 0.9 and dust[place(1.0)] < 0.01
    assert dust[place(6.2)] < dust[place(9.5)]  # the wall shelters


def test_noise_breaks_it_up_and_has_no_seams():
    mesh, square = patch(SURFACES["torus"], "regular", 24)
    uv, size = laid_out(mesh, square, "quarters", 96)
    settings = core.WearSettings(kind="dust", rays=64)
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    image = core.wear(mesh, uv, settings, size=(size, size), atlas=atlas)
    calm = core.wear(mesh, uv, settings.changed(breakup=0), size=(size, size), atlas=atlas)
    other = core.wear(mesh, uv, settings.changed(seed=1), size=(size, size), atlas=atlas)
    inside = atlas.inside
    assert (image <= calm + 0.01)[inside].all()
    assert np.abs(image - other)[inside].mean() > 0.02
    assert not core.wear(mesh, uv, settings.changed(amount=0), size=(size, size)).any()


def test_marked_edges_alone_are_worn():
    mesh, uv = profile((0, -2), (0, 0), (2, 0), (2, -2))
    marked = across(core.wear(mesh, uv, even(width=0.5), size=SIZE, edges=[[2, 3]]))
    assert marked[:32].max() > 0.8
    assert marked[32:].max() < 0.01
    with pytest.raises(core.InvalidSignal):
        core.wear(mesh, uv, size=SIZE, edges=[[0, 99]])
