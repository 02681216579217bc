# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of normal maps between tangent and object space."""

from dataclasses import replace

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
    atlas = core.TextureAtlas(mesh, blocks.uv, size=(blocks.width, blocks.width))
    given = waves(mesh, atlas)
    tangent = core.tangent_normals(mesh, blocks.uv, given, atlas=atlas)
    back = core.object_normals(mesh, blocks.uv, tangent, atlas=atlas)
    assert np.abs(back - given)[atlas.inside].max() < 1e-5
    assert np.abs(tangent - given)[atlas.inside].max() > 0.1


@pytest.mark.parametrize("angle", [None, 0.4])
def test_a_straight_map_is_the_shading_of_the_mesh(angle):
    mesh, blocks = curved(angle=angle)
    size = blocks.width
    atlas = core.TextureAtlas(mesh, blocks.uv, size=(size, size))
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
        inside = core.TextureAtlas(mesh, uv, size=(16, 16)).inside
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
        atlas = core.TextureAtlas(mesh, uv, size=(size, size))
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
    atlas = core.TextureAtlas(mesh, blocks.uv, size=(size, size))
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
    atlas = core.TextureAtlas(mesh, blocks.uv, size=(size, size))
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
    atlas = core.TextureAtlas(mesh, blocks.uv, size=(blocks.width, blocks.width))
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


SOFT = {"gain": 0.0, "radius": 6.0, "seams": "continue"}


def at_random(mesh, atlas, count=4000):
    """Points of faces, half of them on seams: faces and shares of their corners."""
    random = np.random.default_rng(0)
    shares = np.zeros((2 * count, 3))
    seams = atlas.charts.borders[mesh.twins.reshape(-1)[atlas.charts.borders] >= 0]
    edges, along = random.choice(seams, count), random.random(count)
    shares[np.arange(count), edges % 3] = 1 - along
    shares[np.arange(count), (edges + 1) % 3] = along
    shares[count:] = random.dirichlet([1, 1, 1], count)
    return np.concatenate([edges // 3, random.integers(0, mesh.face_count, count)]), shares


def at_points(values, faces, shares):
    return np.einsum("pk,pkx->px", shares, values[faces])


def rendered(mesh, uv, image, faces, shares):
    """The normals that a renderer sees in a tangent-space map, as colors."""
    frames = tangent_frames(mesh, uv)
    texels = 2 * sample(image, at_points(uv, faces, shares)) - 1
    normals = at_points(frames.normals, faces, shares)
    tangents = at_points(frames.tangents, faces, shares)
    across = frames.signs[faces, None] * np.cross(normals, tangents)
    axes = np.stack([tangents, across, normals], axis=1)
    return 0.5 + 0.5 * unit(np.einsum("pk,pkx->px", texels[:, :3], axes))


@pytest.mark.parametrize("angle", [None, 0.4])
@pytest.mark.parametrize("gain", [0.0, 2.0])
def test_filtered_tangent_maps_are_lit_as_filtered_object_maps(angle, gain):
    mesh, blocks = curved(angle=angle)
    uv, size = blocks.uv, blocks.width
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    in_space = waves(mesh, atlas)
    tangent = core.tangent_normals(mesh, uv, in_space, atlas=atlas)
    faces, shares = at_random(mesh, atlas)
    lights = unit(np.random.default_rng(1).normal(size=(5, 3)))

    def filtered(image, content):
        settings = core.FilterSettings(**{**SOFT, "gain": gain}, content=content)
        return core.filter_texture(mesh, uv, image, settings, atlas=atlas)

    smooth = filtered(in_space, "object_normals")
    expected = sample(smooth, at_points(uv, faces, shares))
    found = rendered(mesh, uv, filtered(tangent, "normals"), faces, shares)
    assert np.quantile(degrees(found, expected), 0.99) < 0.5
    shades = [np.maximum((2 * each - 1) @ lights.T, 0) for each in (found, unit_colors(expected))]
    assert np.abs(shades[0] - shades[1]).max() < 0.02
    careless = rendered(mesh, uv, filtered(tangent, "values"), faces, shares)
    assert np.quantile(degrees(careless, expected), 0.9) > 5
    for image in (smooth, filtered(tangent, "normals")):
        lengths = np.linalg.norm(2 * image - 1, axis=-1)
        assert np.abs(lengths[atlas.inside] - 1).max() < 1e-5


def unit_colors(colors):
    return 0.5 + 0.5 * unit(2 * colors - 1)


def test_stitched_tangent_maps_are_lit_as_stitched_object_maps():
    mesh, blocks = curved()
    uv, size = blocks.uv, blocks.width
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    # Each chart leans another way, as scans do that were made one by one.
    lean = np.random.default_rng(2).normal(size=(16, 3))[atlas.charts.labels] * 0.2
    leaning = 2 * waves(mesh, atlas) - 1 + atlas.bake(np.repeat(lean[:, None], 3, axis=1))
    in_space = np.where(atlas.inside[..., None], 0.5 + 0.5 * unit(leaning), 0.5)
    extend = core.DilateSettings(seams="extend")
    tangent = core.tangent_normals(mesh, uv, in_space, settings=extend, atlas=atlas)
    faces, shares = at_random(mesh, atlas)

    def stitched(image, content):
        settings = core.StitchSettings(radius=300.0, content=content)
        return core.stitch_textures(mesh, uv, [image, image], settings, atlas=atlas)

    expected = sample(stitched(in_space, "object_normals"), at_points(uv, faces, shares))
    found = rendered(mesh, uv, stitched(tangent, "normals"), faces, shares)
    assert np.quantile(degrees(found, expected), 0.99) < 0.5
    assert degrees(rendered(mesh, uv, tangent, faces, shares), found).mean() > 3


def test_green_that_points_down_is_the_same_upside_down():
    mesh, blocks = curved()
    uv, size = blocks.uv, blocks.width
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    up = core.tangent_normals(mesh, uv, waves(mesh, atlas), atlas=atlas)
    down = up * [1, -1, 1] + [0, 1, 0]
    found = [
        core.filter_texture(
            mesh, uv, image, core.FilterSettings(**SOFT, content=content), atlas=atlas
        )
        for image, content in ((up, "normals"), (down, "normals_y_down"), (down, "normals"))
    ]
    turned = found[1] * [1, -1, 1] + [0, 1, 0]
    near = atlas.masks().active
    assert np.abs(turned - found[0])[near].max() < 1e-4
    assert np.abs(found[2] * [1, -1, 1] + [0, 1, 0] - found[0])[near].max() > 0.1


@pytest.mark.parametrize("content", ["normals", "normals_y_down", "object_normals"])
def test_a_gain_of_1_and_a_mask_of_0_keep_normals(content):
    mesh, blocks = curved(32)
    uv, size = blocks.uv, blocks.width
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    image = np.rint(255 * waves(mesh, atlas)).astype(np.uint8)
    image[atlas.inside] += np.uint8(3)  # of no unit length
    settings = core.FilterSettings(**SOFT, content=content)
    same = core.filter_texture(mesh, uv, image, replace(settings, gain=1.0), atlas=atlas)
    assert (same == image).all()
    mask = np.zeros(image.shape[:2])
    mask[:, : size // 2] = 1.0
    for function, chosen in (
        (core.filter_texture, settings),
        (core.stitch_textures, core.StitchSettings(content=content)),
    ):
        half = function(mesh, uv, image, settings=chosen, mask=mask, atlas=atlas)
        kept = (mask == 0) & atlas.inside
        assert (half == image)[kept].all() and (half != image)[atlas.inside & ~kept].any()


def test_painted_gains_and_opacity_go_with_normals():
    mesh, blocks = curved(32)
    uv, size = blocks.uv, blocks.width
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    normals = core.tangent_normals(mesh, uv, waves(mesh, atlas), atlas=atlas)
    gains = np.zeros((size, size))
    settings = core.FilterSettings(**SOFT, content="normals")
    smooth = core.filter_texture(mesh, uv, normals, settings, atlas=atlas)
    painted = core.filter_texture(mesh, uv, normals, settings, gain=gains, atlas=atlas)
    assert np.quantile(degrees(smooth, painted)[atlas.inside], 0.999) < 0.2
    image = np.concatenate([normals, np.ones((size, size, 1))], axis=2)
    image[: size // 3, :, 3] = 0.0
    found = core.filter_texture(mesh, uv, image, settings, atlas=atlas)
    assert np.isfinite(found).all() and (found[..., 3] == image[..., 3])[atlas.inside].all()
    lengths = np.linalg.norm(2 * found[atlas.inside, :3] - 1, axis=-1)
    assert np.abs(lengths - 1).max() < 1e-5
    none = np.full_like(normals, 0.5)
    assert np.isfinite(core.filter_texture(mesh, uv, none, settings, atlas=atlas)).all()


def test_normals_of_the_shading_may_be_given():
    mesh, blocks = curved(32)
    uv, size = blocks.uv, blocks.width
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    faceted = np.repeat(mesh.normals[:, None], 3, axis=1)
    in_space = waves(mesh, atlas)
    settings = core.FilterSettings(**SOFT, content="normals")
    expected = core.filter_texture(
        mesh, uv, in_space, replace(settings, content="object_normals"), atlas=atlas
    )
    tangent = core.tangent_normals(mesh, uv, in_space, normals=faceted, atlas=atlas)
    found = core.filter_texture(mesh, uv, tangent, settings, normals=faceted, atlas=atlas)
    back = core.object_normals(mesh, uv, found, normals=faceted, atlas=atlas)
    assert degrees(back, expected)[atlas.inside].max() < 0.05


@pytest.mark.parametrize("name, settings", [
    ("filter_texture", core.FilterSettings(gain=1.0, content="normals")),
    ("stitch_textures", core.StitchSettings(content="object_normals")),
])  # fmt: skip
def test_normals_want_three_channels(name, settings):
    vertices, faces = grid(1, 1)
    mesh, uv = core.TriangleMesh(vertices, faces), vertices[faces][..., :2]
    with pytest.raises(core.InvalidSignal, match="three channels"):
        getattr(core, name)(mesh, uv, np.zeros((8, 8)), settings)
    other = replace(settings, radius=50.0)
    if name == "filter_texture":
        other = replace(other, gain=0.0)
    with pytest.raises(core.InvalidSignal, match="give \\(2, 3, 3\\)"):
        getattr(core, name)(mesh, uv, flat_map(8), other, normals=np.zeros((1, 3)))


def test_normals_of_faces_wound_backwards_are_given_in_their_own_order():
    mesh, blocks = curved(angle=0.4)
    size = blocks.width
    normals = smooth_normals(mesh) + 0.1 * np.random.default_rng(2).normal(size=(3, 3))
    expected = core.object_normals(mesh, blocks.uv, flat_map(size), normals=normals)
    back = np.arange(mesh.face_count) % 3 == 0
    faces, uv, given = (
        np.where(back.reshape(-1, *[1] * (each.ndim - 1)), each[:, ::-1], each)
        for each in (mesh.faces, blocks.uv, normals)
    )
    mixed = core.TriangleMesh(mesh.vertices, faces)
    assert mixed.flipped.any()
    found = core.object_normals(mixed, uv, flat_map(size), normals=given)
    away = np.abs(found - expected).max(axis=-1)
    assert (away < 1e-5).mean() > 0.98  # some texels beside seams are those of another face
