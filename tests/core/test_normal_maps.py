# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of normal maps between tangent and object space."""

import numpy as np
import pytest
from atlases import Blocks, sample
from scipy.ndimage import binary_erosion
from shapes import grid
from shock_filter import core
from shock_filter.core.mesh.tangents import smooth_normals, tangent_frames


def curved(n=64, angle=0.4):
    """A curved sheet cut into 4 x 4 charts that are turned (and mirrored, without an angle)."""
    blocks = Blocks(np.zeros((n, n, 1)), angle)
    vertices = blocks.vertices.copy()
    x, y = 2 * np.pi * vertices[:, :2].T / n
    vertices[:, 2] = 0.05 * n * np.sin(x) * np.cos(y)
    return core.TriangleMesh(vertices, blocks.faces), blocks


def whole(mesh, n=64):
    """The same sheet in one chart."""
    return (mesh.vertices[mesh.faces][..., :2] + n / 2) / (2 * n)


def unit(vectors):
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def waves(mesh, atlas):
    """Unit normals in space with waves on them, as colors at each texel."""
    places = atlas.bake(mesh.vertices[mesh.faces])
    normals = atlas.bake(smooth_normals(mesh))
    waves = np.stack([np.sin(places[..., 0]), np.cos(0.7 * places[..., 1]), 0 * places[..., 0]], -1)
    flat = normals + 0.3 * waves + [0, 0, 1e-9]
    return np.where(atlas.inside[..., None], 0.5 + 0.5 * unit(flat), 0.5)


def degrees(one, other):
    cosines = (unit(2 * one - 1) * unit(2 * other - 1)).sum(axis=-1)
    return np.degrees(np.arccos(np.clip(cosines, -1, 1)))


def flat_map(size):
    return np.tile(np.array([0.5, 0.5, 1.0]), (size, size, 1))


@pytest.mark.parametrize("angle", [None, 0.4])
def test_there_and_back_is_the_same(angle):
    mesh, blocks = curved(angle=angle)
    atlas = core.TextureAtlas(mesh, blocks.uv, blocks.width, blocks.width)
    given = waves(mesh, atlas)
    tangent = core.tangent_normals(mesh, blocks.uv, given, atlas=atlas)
    back = core.object_normals(mesh, blocks.uv, tangent, atlas=atlas)
    assert np.abs(back - given)[atlas.inside].max() < 1e-5
    assert np.abs(tangent - given)[atlas.inside].max() > 0.1


@pytest.mark.parametrize("angle", [None, 0.4])
def test_a_straight_map_is_the_shading_of_the_mesh(angle):
    mesh, blocks = curved(angle=angle)
    size = blocks.width
    atlas = core.TextureAtlas(mesh, blocks.uv, size, size)
    found = core.object_normals(mesh, blocks.uv, flat_map(size), atlas=atlas)
    shading = 0.5 + 0.5 * unit(atlas.bake(smooth_normals(mesh)) + [0, 0, 1e-12])
    assert np.abs(found - shading)[atlas.inside].max() < 1e-5
    faces = np.repeat(mesh.normals[:, None], 3, axis=1)
    sharp = core.object_normals(mesh, blocks.uv, flat_map(size), normals=faces, atlas=atlas)
    expected = 0.5 + 0.5 * atlas.bake(faces)
    assert np.abs(sharp - expected)[atlas.inside].max() < 1e-5


def test_red_points_along_the_coordinates_and_green_up():
    vertices, faces = grid(1, 1)
    mesh = core.TriangleMesh(vertices, faces)
    for turn in ([[1, 0], [0, 1]], [[0, 1], [-1, 0]], [[-1, 0], [0, 1]], [[0.8, 0.6], [-0.6, 0.8]]):
        turn = np.array(turn, dtype=float)
        uv = 0.5 + 0.5 * (vertices[faces][..., :2] - 0.5) @ turn.T
        inside = core.TextureAtlas(mesh, uv, 16, 16).inside
        for axis in (0, 1):
            leaning = flat_map(16)
            leaning[..., axis], leaning[..., 2] = 0.8, 0.9
            found = 2 * core.object_normals(mesh, uv, leaning)[inside] - 1
            expected = [*(0.6 * turn[axis]), 0.8]
            assert np.abs(found - expected).max() < 1e-6


@pytest.mark.parametrize("angle", [None, 0.4])
def test_filtered_in_object_space_the_cut_does_not_show(angle):
    mesh, blocks = curved(angle=angle)
    settings = core.FilterSettings(gain=0.0, radius=6.0, seams="continue")
    found = []
    points = np.random.default_rng(0).uniform(2, 62, (2000, 2))
    for uv, size, places in (
        (blocks.uv, blocks.width, blocks.to_uv(points)),
        (whole(mesh), 128, (points + 32) / 128),
    ):
        atlas = core.TextureAtlas(mesh, uv, size, size)
        tangent = core.tangent_normals(mesh, uv, waves(mesh, atlas), atlas=atlas)
        normals = core.object_normals(mesh, uv, tangent, atlas=atlas)
        smooth = core.filter_texture(mesh, uv, normals, settings, atlas=atlas)
        tangent = core.tangent_normals(mesh, uv, smooth, atlas=atlas)
        shown = core.object_normals(mesh, uv, tangent, atlas=atlas)
        found.append(sample(shown, places))
        assert degrees(shown, waves(mesh, atlas))[atlas.inside].mean() > 5
    assert np.quantile(degrees(*found), 0.99) < 2


def test_tangent_maps_of_two_cuts_show_the_same_filtered_surface_only_in_object_space():
    mesh, blocks = curved()
    size = blocks.width
    atlas = core.TextureAtlas(mesh, blocks.uv, size, size)
    settings = core.FilterSettings(gain=0.0, radius=6.0, seams="continue")
    normals = waves(mesh, atlas)
    expected = core.filter_texture(mesh, blocks.uv, normals, settings, atlas=atlas)
    tangent = core.tangent_normals(mesh, blocks.uv, normals, atlas=atlas)
    careless = core.filter_texture(mesh, blocks.uv, tangent, settings, atlas=atlas)
    shown = core.object_normals(mesh, blocks.uv, careless, atlas=atlas)
    seams = atlas.inside & ~binary_erosion(atlas.inside, iterations=2)
    assert degrees(shown, expected)[seams].mean() > 2
    careful = core.tangent_normals(mesh, blocks.uv, expected, atlas=atlas)
    shown = core.object_normals(mesh, blocks.uv, careful, atlas=atlas)
    assert degrees(shown, expected)[seams].mean() < 0.01


def test_the_gutter_turns_with_its_chart():
    mesh, blocks = curved()
    size = blocks.width
    atlas = core.TextureAtlas(mesh, blocks.uv, size, size)
    tangent = core.tangent_normals(mesh, blocks.uv, waves(mesh, atlas), atlas=atlas)
    lengths = np.linalg.norm(2 * tangent - 1, axis=-1)
    near = atlas.masks().active & (lengths > 0)
    assert (
        np.abs(lengths[near] - 1).max() < 1e-5 and near.sum() > 0.999 * atlas.masks().active.sum()
    )
    steps = degrees(tangent[:, 1:], tangent[:, :-1])
    inner = atlas.inside[:, 1:] & atlas.inside[:, :-1]
    rim = near[:, 1:] & near[:, :-1] & ~inner
    assert np.quantile(steps[rim], 0.9) < 2 * np.quantile(steps[inner], 0.9)


def test_types_and_a_fourth_channel_stay():
    mesh, blocks = curved(32)
    atlas = core.TextureAtlas(mesh, blocks.uv, blocks.width, blocks.width)
    colors = np.rint(255 * waves(mesh, atlas)).astype(np.uint8)
    image = np.concatenate([colors, np.full((*colors.shape[:2], 1), 7, np.uint8)], axis=-1)
    found = core.tangent_normals(mesh, blocks.uv, image, atlas=atlas)
    assert found.dtype == np.uint8 and (found[atlas.inside, 3] == 7).all()
    back = core.object_normals(mesh, blocks.uv, found, atlas=atlas)
    assert degrees(back[..., :3] / 255, colors / 255)[atlas.inside].max() < 1.5


def test_frames_of_sides_that_are_mirrored_stay_apart():
    vertices, faces = grid(2, 1)
    mesh = core.TriangleMesh(vertices, faces)
    uv = np.abs(vertices[faces][..., :2] - [1, 0])
    frames = tangent_frames(mesh, uv)
    right = mesh.vertices[mesh.faces].mean(axis=1)[:, 0] > 1
    assert (frames.signs == np.where(right, 1, -1)).all()
    assert np.allclose(frames.tangents[..., 0], np.where(right, 1, -1)[:, None])


def test_faces_without_area_get_some_frame():
    vertices, faces = grid(1, 1)
    mesh = core.TriangleMesh(vertices, faces)
    frames = tangent_frames(mesh, np.zeros((2, 3, 2)))
    assert np.allclose(np.linalg.norm(frames.tangents, axis=-1), 1)
    assert np.abs((frames.tangents * frames.normals).sum(axis=-1)).max() < 1e-12
    image = flat_map(1)
    assert np.isfinite(core.object_normals(mesh, vertices[faces][..., :2], image)).all()
    black = np.full((4, 4, 3), 0.5)
    assert np.isfinite(core.tangent_normals(mesh, vertices[faces][..., :2], black)).all()


def test_wrong_input_is_named():
    vertices, faces = grid(1, 1)
    mesh, uv = core.TriangleMesh(vertices, faces), vertices[faces][..., :2]
    for image in (np.zeros((4, 4)), np.zeros((4, 4, 2))):
        with pytest.raises(core.InvalidSignal, match="three channels"):
            core.object_normals(mesh, uv, image)
    with pytest.raises(core.InvalidSignal, match="give \\(2, 3, 3\\)"):
        core.object_normals(mesh, uv, flat_map(4), normals=np.zeros((4, 3)))
    with pytest.raises(core.InvalidSignal, match="unit vectors"):
        core.tangent_normals(mesh, uv, flat_map(4), normals=np.zeros((2, 3, 3)))
    with pytest.raises(core.Cancelled):
        core.object_normals(mesh, uv, flat_map(4), progress=lambda *_: False)
