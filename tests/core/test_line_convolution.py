# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of streaks in textures."""

import numpy as np
import pytest
from atlases import sample
from scipy.ndimage import gaussian_filter
from shapes import grid
from shock_filter import core
from shock_filter.core.elements.matrices import TextureSpace
from shock_filter.core.texture import streaks as line_convolution
from surface_spaces import positions, square
from test_geodesic_distance import plain, tube
from test_texture_space import LAYOUTS


def flow_angles(image, inside, rows=1.0):
    """Direction of the lines that a texture shows, from its columns' to its rows' direction.

    On a flat surface on which a step of one row is `rows` as long as that of one column.
    """
    sigma = np.array([1.5 / rows, 1.5]) * max(rows, 1.0)  # round on the surface
    values = np.where(inside, image, 0.5)
    y = gaussian_filter(values, sigma, order=(1, 0)) / rows
    x = gaussian_filter(values, sigma, order=(0, 1))
    within = gaussian_filter(inside.astype(float), 3 * sigma) > 0.999
    a, b, c = (gaussian_filter(p, 3 * sigma) for p in (x * x, x * y, y * y))
    return 0.5 * np.arctan2(2 * b, a - c)[within] + np.pi / 2


def wrapped(angle):
    """An angle between lines, in degrees from 0 to 90."""
    angle = np.abs(np.degrees(angle)) % 180
    return np.minimum(angle, 180 - angle)


@pytest.mark.parametrize("degrees", [0, 35, 90])
def test_streaks_lie_along_the_field(degrees):
    mesh, uv = plain(64)
    angle = np.radians(degrees)
    directions = core.axis_directions(mesh, [np.cos(angle), np.sin(angle), 0])
    image = core.surface_line_convolution(mesh, uv, size=(256, 256), directions=directions)
    found = flow_angles(image, np.ones_like(image, dtype=bool))
    assert wrapped(found - angle).mean() < 6
    assert abs(np.angle(np.exp(2j * (found - angle)).mean(), deg=True)) < 3


def test_streaks_lie_along_the_field_where_the_texture_is_stretched():
    mesh, uv = plain(64)
    uv = uv * [1.0, 0.4] + [0.0, 0.3]
    angle = np.radians(35)
    directions = core.axis_directions(mesh, [np.cos(angle), np.sin(angle), 0])
    atlas = core.TextureAtlas(mesh, uv, size=(256, 256))
    image = core.surface_line_convolution(
        mesh, uv, size=(256, 256), directions=directions, atlas=atlas
    )
    found = flow_angles(image, atlas.inside, 2.5)
    assert wrapped(found - angle).mean() < 6


def test_directions_at_vertices_are_those_at_faces_if_they_are_alike():
    mesh, uv = plain(32)
    vector = np.array([0.3, 1.0, 0.0])
    signs = np.array([[1.0], [-2.0], [3.0], [-1.0]])
    one = core.surface_line_convolution(mesh, uv, size=(32, 32), directions=np.tile(vector, (2, 1)))
    other = core.surface_line_convolution(mesh, uv, size=(32, 32), directions=signs * vector)
    assert np.allclose(one, other, atol=1e-4)


def jump_across_seams(mesh, uv, size, image):
    """Mean difference of what both sides of the seams show, of a flat layout by `square`."""
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    f, k = np.divmod(atlas.charts.borders, 3)
    twins = mesh.twins[f, k]
    f, k, twins = f[twins >= 0], k[twins >= 0], twins[twins >= 0]
    g, j = np.divmod(twins, 3)
    shares = np.linspace(0.1, 0.9, 9)[:, None, None]
    here = (1 - shares) * uv[f, k] + shares * uv[f, (k + 1) % 3]
    there = shares * uv[g, j] + (1 - shares) * uv[g, (j + 1) % 3]
    one, other = (sample(image[..., None], places)[..., 0] for places in (here, there))
    return np.abs(one - other).mean()


def test_seams_do_not_break_streaks():
    mesh, uv, size = square(64)
    directions = core.axis_directions(mesh, [1, 0.5, 0])
    settings = core.StreakSettings(length=12)
    image = core.surface_line_convolution(
        mesh, uv, size=(size, size), directions=directions, settings=settings
    )
    inside = core.TextureAtlas(mesh, uv, size=(size, size)).inside
    assert jump_across_seams(mesh, uv, size, image) < 0.1 * image[inside].std()


@pytest.mark.parametrize("layout", ["turned charts", "another density", "stretched"])
def test_values_have_their_mean_and_deviation(layout):
    charts, angle, change = LAYOUTS[layout]
    mesh, uv, size = square(64, charts, angle, change)
    directions = core.axis_directions(mesh, [0, 1, 0])
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    image = core.surface_line_convolution(
        mesh, uv, size=(size, size), directions=directions, atlas=atlas
    )
    values = image[atlas.inside]
    assert values.mean() == pytest.approx(0.5, abs=0.03)
    assert 0.12 < values.std() < 0.25
    assert image.min() >= 0 and image.max() <= 1


def test_noise_is_as_strong_beside_seams_and_in_denser_charts():
    mesh, uv, size = square(64)
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    directions = core.axis_directions(mesh, [1, 0.3, 0])
    near, far = [], []
    beside = atlas.masks().boundary & atlas.inside
    for seed in range(4):
        settings = core.StreakSettings(length=10, seed=seed)
        image = core.surface_line_convolution(
            mesh, uv, size=(size, size), directions=directions, settings=settings, atlas=atlas
        )
        near.append(image[beside])
        far.append(image[atlas.inside & ~beside])
    assert np.std(near) == pytest.approx(np.std(far), rel=0.15)

    half = uv.copy()
    half[mesh.vertices[mesh.faces][..., 0].mean(axis=1) < 32] *= 0.5
    atlas = core.TextureAtlas(mesh, half, size=(2 * size, 2 * size))
    x = atlas.bake(mesh.vertices[mesh.faces])[..., 0]
    sides = [atlas.inside & side for side in (x < 32, x >= 32)]
    found = []
    for seed in range(4):
        settings = core.StreakSettings(length=10, width=4, seed=seed)
        image = core.surface_line_convolution(
            mesh,
            half,
            size=(2 * size, 2 * size),
            directions=directions,
            settings=settings,
            atlas=atlas,
        )
        found.append([image[side].std() for side in sides])
    one, other = np.mean(found, axis=0)
    assert one == pytest.approx(other, rel=0.15)


def test_without_directions_they_follow_the_shape():
    vertices, faces, flat, girth = tube(sides=24, rings=12)
    mesh = core.TriangleMesh(vertices, faces)
    uv = 0.02 + 0.96 * flat / girth
    image = core.surface_line_convolution(mesh, uv, size=(160, 160))
    inside = core.TextureAtlas(mesh, uv, size=(160, 160)).inside
    found = flow_angles(image, inside)
    assert wrapped(found - np.pi / 2).mean() < 6


def test_where_there_is_no_direction_there_are_grains():
    mesh, uv = plain(64)
    image = core.surface_line_convolution(mesh, uv, size=(128, 128), directions=np.zeros((2, 3)))
    across, along = (np.abs(np.diff(image, axis=axis)).mean() for axis in (0, 1))
    assert across == pytest.approx(along, rel=0.1)


def test_seeds_give_other_streaks_and_the_same_again():
    mesh, uv = plain(32)

    def streaks(seed):
        settings = core.StreakSettings(seed=seed)
        directions = core.axis_directions(mesh, [1, 0, 0])
        return core.surface_line_convolution(
            mesh, uv, size=(64, 64), directions=directions, settings=settings
        )

    assert np.array_equal(streaks(0), streaks(0))
    assert abs(np.corrcoef(streaks(0).ravel(), streaks(1).ravel())[0, 1]) < 0.3


def test_no_contrast_is_gray():
    mesh, uv = plain(32)
    settings = core.StreakSettings(contrast=0.0)
    assert np.allclose(
        core.surface_line_convolution(mesh, uv, size=(16, 16), settings=settings), 0.5
    )


def test_tiny_images_and_loose_parts():
    mesh, uv = plain()
    for size in ((1, 1), (2, 3), (1, 9)):
        image = core.surface_line_convolution(
            mesh, uv, size=size, directions=np.tile([1.0, 0, 0], (2, 1))
        )
        assert image.shape == size and np.isfinite(image).all()
    vertices, faces = grid(1, 1)
    two = np.concatenate([vertices, vertices + [2, 0, 0]])
    mesh = core.TriangleMesh(two, np.concatenate([faces, faces + 4]))
    flat = two[mesh.faces][..., :2] / 4 + [0.1, 0.3]
    image = core.surface_line_convolution(mesh, flat, size=(64, 64), settings=None)
    assert np.isfinite(image).all()


@pytest.mark.parametrize("layout", ["charts of a third of a texel", "all mirrored"])
def test_odd_layouts_give_finite_values(layout):
    mesh, uv, size = square(64, *LAYOUTS[layout])
    image = core.surface_line_convolution(mesh, uv, size=(size, size))
    assert np.isfinite(image).all() and image.std() > 0


def test_wrong_input_is_named():
    mesh, uv = plain()
    with pytest.raises(core.InvalidSignal, match="give \\(2, 3\\) or \\(4, 3\\)"):
        core.surface_line_convolution(mesh, uv, size=(8, 8), directions=np.zeros((3, 3)))
    with pytest.raises(core.InvalidSignal, match="NaN"):
        core.surface_line_convolution(mesh, uv, size=(8, 8), directions=np.full((2, 3), np.nan))
    with pytest.raises(core.InvalidSettings, match="rows and columns"):
        core.surface_line_convolution(mesh, uv, size=8)
    for size in ((-1, 4), (2.5, 4), (10**9, 10**9)):
        with pytest.raises(core.InvalidSettings, match="whole number from 1 to 32768"):
            core.surface_line_convolution(mesh, uv, size=size)
    with pytest.raises(core.InvalidSettings):
        core.StreakSettings(length=0)


def test_a_run_can_be_cancelled_at_any_time():
    mesh, uv, size = square(32)
    calls = []

    def note(*call):
        calls.append(call)
        return True

    core.surface_line_convolution(mesh, uv, size=(size, size), progress=note)
    assert calls == sorted(calls, key=lambda call: call[0]) and calls[-1][0] == 1.0
    for last in np.linspace(0, 0.7 * len(calls), 6).astype(int):
        left = iter(range(last))
        with pytest.raises(core.Cancelled):
            core.surface_line_convolution(
                mesh,
                uv,
                size=(size, size),
                progress=lambda *_, left=left: next(left, None) is not None,
            )


def test_contrast_is_even_where_streaks_run_together():
    vertices, faces = grid(16, 16)
    mesh = core.TriangleMesh(vertices, faces)
    uv = mesh.vertices[mesh.faces][..., :2] / 16
    away = mesh.vertices + [0.5, 0.5, 0.0]
    settings = core.StreakSettings(length=100, width=1.5)
    image = core.surface_line_convolution(
        mesh, uv, size=(192, 192), directions=away, settings=settings
    )
    y, x = np.mgrid[:192, :192]
    far = np.hypot(x, y)
    rings = [(far > low) & (far < low + 16) for low in (16, 40, 80, 120)]
    found = np.array([image[ring].std() for ring in rings])
    assert found.min() > 0.7 * found.max()


def test_streaks_fade_where_the_surface_hardly_bends(monkeypatch):
    # Directions are as long as they are clear: those that are found fade, those given do not.
    mesh = core.TriangleMesh(*grid(4, 4))
    settings = core.StreakSettings()

    def stretch(length, given):
        field = np.tile([length, 0.0, 0.0], (mesh.vertex_count, 1))
        monkeypatch.setattr(line_convolution, "principal_directions", lambda mesh: field)
        found = line_convolution._tensors(mesh, field[mesh.faces] if given else None, settings)
        a, b, c = np.moveaxis(found, 1, 0)
        mean, half = (a + c) / 2, np.hypot((a - c) / 2, b)
        return np.log((mean + half) / (mean - half)).mean()

    full = stretch(1.0, False)
    assert stretch(0.05, False) == pytest.approx(0.1 * full, rel=0.01)
    assert stretch(0.05, True) == pytest.approx(full, rel=0.01)


def test_drifts_of_brightness_are_no_contrast():
    mesh, uv, size = square(96, False, 0.0)
    space = TextureSpace(core.TextureAtlas(mesh, uv, size=(size, size)))
    settings = core.StreakSettings(width=1.0)
    drift = positions(space)[:, :1]
    known = np.isfinite(drift)
    drift = np.nan_to_num((drift - np.nanmean(drift)) / np.nanstd(drift))
    noise = np.random.default_rng(4).normal(size=drift.shape) * known

    def slope(strength):
        values = (strength * drift + noise).astype(np.float32)
        line_convolution._even_out(space, settings, values)
        return abs(np.corrcoef(values[known], drift[known])[0, 1])

    assert slope(3.0) < 0.4  # 0.95 before
