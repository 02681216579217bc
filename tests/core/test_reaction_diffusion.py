# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of patterns that react and diffuse in textures."""

import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.linalg
from atlases import sample
from scipy.spatial import cKDTree
from scipy.special import j0
from shapes import icosphere
from shock_filter import core
from shock_filter.core.base import parallel
from shock_filter.core.elements.matrices import TextureSpace
from shock_filter.core.elements.surface_values import painted_values
from shock_filter.core.texture import patterns as rd
from surface_spaces import in_full, square
from test_geodesic_distance import plain
from test_texture_space import LAYOUTS


def start_of(atlas, wave=9.0):
    """Both substances in waves over the surface, the same however it is cut."""
    x, y, z = np.moveaxis(atlas.bake(atlas.mesh.vertices[atlas.mesh.faces]), -1, 0)
    v = 0.2 + 0.2 * np.sin(x / wave) * np.cos((y + z) / wave)
    return np.stack([1.0 - 1.5 * v, v], axis=-1)


def react(values, feed, kill):
    u, v = values.T.astype(np.float64)
    return np.stack([u - u * v * v + feed * (1 - u), v + u * v * v - (feed + kill) * v], axis=1)


@pytest.mark.parametrize("layout", ["turned charts", "another density", "stretched"])
@pytest.mark.parametrize("scale", [10.0, 60.0])
def test_a_step_is_that_of_a_direct_solve(layout, scale):
    charts, angle, change = LAYOUTS[layout]
    mesh, uv, size = square(48, charts, angle, change)
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    space, start = TextureSpace(atlas), start_of(atlas)
    settings = core.ReactionSettings(steps=1, scale=scale)
    image = core.reaction_diffusion(
        mesh, uv, size=(size, size), settings=settings, start=start, atlas=atlas
    )
    stiffness, used = in_full(space, 0.0)
    masses = in_full(space, 1.0)[0].sum(axis=1).A1
    before = painted_values(space, start.astype(np.float32))[used]
    wanted = react(before, settings.feed, settings.kill)
    for k, diffusion in enumerate(rd._DIFFUSION):
        matrix = scipy.sparse.diags(masses) + diffusion * (scale / rd._SCALE) ** 2 * stiffness
        wanted[:, k] = scipy.sparse.linalg.spsolve(matrix.tocsc(), masses * wanted[:, k])
    found = atlas.gather(image).reshape(-1, 2)
    inside = used[used < space.labels.size]
    within = atlas.sheet.nodes.reshape(-1)[inside] >= 0
    off = found[inside[within]] - wanted[: len(inside)][within]
    assert np.abs(off).max() < 3e-4
    assert np.abs(wanted - before).max() > 30 * np.abs(off).max()


def test_patterns_begin_at_the_same_places_on_faces_that_are_turned_over():
    settings = core.ReactionSettings(steps=0, scale=10)
    mesh, uv, size = square(48, False)
    faces, turned = mesh.faces.copy(), uv.copy()
    for corners in (faces, turned):
        corners[::3] = corners[::3, [0, 2, 1]]  # the mesh turns them back
    other = core.TriangleMesh(mesh.vertices, faces)
    assert other.flipped.any()
    one = core.reaction_diffusion(mesh, uv, settings, size=(size, size))
    found = core.reaction_diffusion(other, turned, settings, size=(size, size))
    assert one[..., 1].max() > 0.2
    assert np.allclose(found, one, atol=1e-5)


def test_patterns_do_not_know_where_the_surface_is_cut():
    settings = core.ReactionSettings(steps=300, scale=10)
    places = np.random.default_rng(0).random((4000, 3))
    found = []
    for charts in (False, True):
        mesh, uv, size = square(96, charts)
        image = core.reaction_diffusion(
            mesh, uv, size=(size, size), settings=settings, start=start_at(mesh, uv, size)
        )
        found.append(at_places(mesh, uv, image, places))
    one, other = found
    assert one.std() > 0.05
    assert one.mean() == pytest.approx(other.mean(), rel=0.05)
    assert one.std() == pytest.approx(other.std(), rel=0.05)
    assert np.corrcoef(one, other)[0, 1] > 0.95


def six_charts(mesh, turn):
    """Cut a ball into the sides of a cube that is turned, and lie turned in the texture."""
    corners = mesh.vertices[mesh.faces] @ turn
    middles = corners.mean(axis=1)
    axis = np.abs(middles).argmax(axis=1)
    behind = np.take_along_axis(middles, axis[:, None], 1)[:, 0] < 0
    order = (axis[:, None] + np.arange(3)) % 3
    depth, across, up = np.moveaxis(np.take_along_axis(corners, order[:, None], 2), -1, 0)
    flat = 4 / np.pi * np.arctan(np.stack([across, up], axis=-1) / np.abs(depth)[..., None])
    flat[behind, :, 0] *= -1
    side = 2 * axis + behind
    angles = 0.5 * side
    turns = np.array([[np.cos(angles), -np.sin(angles)], [np.sin(angles), np.cos(angles)]])
    flat = np.einsum("xyf,fky->fkx", turns, flat)
    return (np.stack([side % 3, side // 3], axis=-1)[:, None] + 0.5 + 0.3 * flat) / 3


def statistics(mesh, uv, size, length, **settings):
    """Mean, deviation and wavelength of a pattern, by random points of the surface."""
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    settings = core.ReactionSettings(scale=length / atlas.texel_size, **settings)
    image = core.reaction_diffusion(mesh, uv, size=(size, size), settings=settings, atlas=atlas)
    random = np.random.default_rng(0)
    corners = mesh.vertices[mesh.faces]
    areas = np.linalg.norm(np.cross(*np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 0)), axis=1)
    faces = random.choice(len(areas), 4000, p=areas / areas.sum())
    shares = random.dirichlet([1, 1, 1], 4000)
    points = np.einsum("pk,pkx->px", shares, corners[faces])
    values = sample(image, np.einsum("pk,pkx->px", shares, uv[faces]))[:, 1]
    apart = values - values.mean()
    one, other = cKDTree(points).query_pairs(4 * length, output_type="ndarray").T
    distances = np.linalg.norm(points[one] - points[other], axis=1)
    # The power of each wavelength, by the correlation of pairs.
    waves = np.linspace(0.5, 2.0, 151) * length
    products, ends = np.histogram(distances, 80, (0, 4 * length), weights=apart[one] * apart[other])
    middles = 0.5 * (ends[1:] + ends[:-1])
    tapered = products * np.cos(0.5 * np.pi * middles / ends[-1]) ** 2
    power = j0(2 * np.pi * middles / waves[:, None]) @ tapered
    return values.mean(), values.std(), waves[np.argmax(power)]


@pytest.mark.parametrize(("feed", "kill"), [(0.037, 0.06), (0.029, 0.057)])
def test_two_cuts_of_a_ball_have_patterns_of_one_kind(feed, kill):
    mesh = core.TriangleMesh(*icosphere(2))
    turned = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    words = {"length": 0.4, "steps": 400, "feed": feed, "kill": kill}
    one = statistics(mesh, six_charts(mesh, np.eye(3)), 160, **words)
    other = statistics(mesh, six_charts(mesh, turned), 144, **words)
    assert one[1] > 0.08
    assert (np.abs(np.divide(one, other) - 1) < [0.06, 0.04, 0.04]).all(), (one, other)
    coarser = statistics(mesh, six_charts(mesh, turned), 144, **{**words, "length": 0.5})
    assert coarser[2] > 1.1 * one[2]


def start_at(mesh, uv, size):
    return start_of(core.TextureAtlas(mesh, uv, size=(size, size)), 5.0)


def at_places(mesh, uv, image, places):
    """The second substance at places of a flat square, in shares of its sides."""
    side = mesh.vertices.max()
    x, y = side * places[:, 0], side * places[:, 1]
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces][..., :2], 1, 0)
    value = np.full(len(x), np.nan)
    for n in range(len(x)):
        p = np.array([x[n], y[n]])
        sides = np.stack([b - a, c - a], axis=2)
        second, third = np.linalg.solve(sides, (p - a)[..., None])[..., 0].T
        face = int(np.argmax(np.minimum(np.minimum(second, third), 1 - second - third)))
        shares = np.array([1 - second[face] - third[face], second[face], third[face]])
        value[n] = sample(image, (shares @ uv[face])[None, None])[0, 0, 1]
    return value


@pytest.mark.parametrize("layout", LAYOUTS)
def test_values_stay_in_their_range(layout):
    charts, angle, change = LAYOUTS[layout]
    mesh, uv, size = square(48, charts, angle, change)
    space = TextureSpace(core.TextureAtlas(mesh, uv, size=(size, size)))
    settings = core.ReactionSettings(steps=150, scale=10)
    values = painted_values(space, rd._spots(space.atlas, settings))
    rd._grow(space, values, settings)
    assert values[:, 1].max() > 0.2
    assert values.min() > -1e-3 and values.max() < 1 + 1e-3


def test_no_steps_return_the_start():
    mesh, uv = plain(32)
    start = np.random.default_rng(0).random((32, 32, 2))
    start[..., 0] *= 1 - start[..., 1]
    image = core.reaction_diffusion(
        mesh, uv, size=(32, 32), settings=core.ReactionSettings(steps=0), start=start
    )
    assert np.allclose(image, start, atol=1e-6)


def test_a_result_goes_on_growing():
    mesh, uv = plain(48)
    size = (48, 48)
    whole = core.reaction_diffusion(mesh, uv, size=size, settings=core.ReactionSettings(steps=40))
    half = core.reaction_diffusion(mesh, uv, size=size, settings=core.ReactionSettings(steps=20))
    again = core.reaction_diffusion(
        mesh, uv, size=size, settings=core.ReactionSettings(steps=20), start=half
    )
    assert np.abs(whole - half).max() > 0.05
    assert np.abs(whole - again).max() < 2e-3


def test_rates_vary_the_scale():
    mesh, uv = plain(64)
    size = (64, 64)
    start = start_at(mesh, uv, 64)
    twice = core.ReactionSettings(steps=30, scale=20)
    one = core.reaction_diffusion(mesh, uv, size=size, settings=twice, start=start)
    settings = core.ReactionSettings(steps=30, scale=10)
    other = core.reaction_diffusion(
        mesh, uv, size=size, settings=settings, start=start, rates=np.full(size, 2.0)
    )
    assert np.abs(one - other).max() < 1e-3
    rates = np.where(np.arange(64) < 32, 2.0, 1.0) * np.ones((64, 1))
    mixed = core.reaction_diffusion(
        mesh, uv, size=size, settings=settings, start=start, rates=rates
    )
    plainly = core.reaction_diffusion(mesh, uv, size=size, settings=settings, start=start)
    assert np.abs(mixed - one)[:, :16].max() < 0.02
    assert np.abs(mixed - plainly)[:, 48:].max() < 0.02


@pytest.mark.parametrize("at", ["faces", "vertices"])
def test_patterns_are_longer_along_directions(at):
    mesh, uv = plain(64)
    y, x = np.mgrid[:64, :64] - 31.5
    start = np.zeros((64, 64, 2))
    start[..., 1] = np.exp(-(x**2 + y**2) / 16)
    count = mesh.face_count if at == "faces" else mesh.vertex_count
    directions = np.tile([1.0, 1.0, 0.0], (count, 1))

    def spread(stretch):
        # How much wider the second substance becomes, where nothing reacts with it.
        settings = core.ReactionSettings(steps=100, feed=0, kill=0, scale=10, stretch=stretch)
        v = core.reaction_diffusion(
            mesh,
            uv,
            size=(64, 64),
            settings=settings,
            start=start,
            rates=None,
            directions=directions,
        )[..., 1]
        assert v.sum() == pytest.approx(start.sum(), rel=1e-3)
        return np.array([((v - start[..., 1]) * (x + k * y) ** 2).sum() for k in (1, -1)])

    along, across = spread(2.0)
    assert along / across == pytest.approx(4, rel=0.05)
    along, across = spread(1.0)
    assert along / across == pytest.approx(1, rel=0.01)


def test_seeds_give_other_patterns_of_one_kind():
    mesh, uv = plain(48)
    images = [
        core.reaction_diffusion(
            mesh, uv, size=(48, 48), settings=core.ReactionSettings(steps=10, seed=seed)
        )
        for seed in (0, 0, 1)
    ]
    assert np.array_equal(images[0], images[1])
    assert np.abs(images[0] - images[2]).max() > 0.1


def test_results_are_the_same_on_one_core_and_two(monkeypatch):
    mesh, uv, size = square(48)
    images = []
    for count in (1, 2):
        monkeypatch.setattr(parallel, "thread_count", lambda count=count: count)
        settings = core.ReactionSettings(steps=5)
        images.append(core.reaction_diffusion(mesh, uv, size=(size, size), settings=settings))
    assert np.array_equal(*images)


@pytest.mark.parametrize("size", [(1, 1), (2, 3), (9, 1)])
def test_tiny_images_give_finite_results(size):
    mesh, uv = plain(8)
    image = core.reaction_diffusion(mesh, uv, size=size, settings=core.ReactionSettings(steps=3))
    assert image.shape == (*size, 2) and image.dtype == np.float32
    assert np.isfinite(image).all()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"start": np.zeros((8, 8))}, "start has the shape"),
        ({"start": np.full((8, 8, 2), 2.0)}, "start leaves"),
        ({"start": np.full((8, 8, 2), np.nan)}, "start holds NaN"),
        ({"rates": np.ones((4, 8))}, "rates have the shape"),
        ({"rates": np.full((8, 8), -1.0)}, "rates leave"),
        ({"rates": np.full((8, 8), np.inf)}, "rates hold NaN"),
        ({"directions": np.ones((3, 3))}, "directions have the shape"),
    ],
)
def test_what_does_not_fit_is_named(given, words):
    mesh, uv = plain(8)
    with pytest.raises(core.InvalidSignal, match=words):
        core.reaction_diffusion(
            mesh, uv, size=(8, 8), settings=core.ReactionSettings(steps=1), **given
        )


@pytest.mark.parametrize("size", [(-1, 4), (2.5, 4), (0, 4), (10**9, 10**9), 8, "88", None])
def test_sizes_that_no_image_has_are_named(size):
    with pytest.raises(core.InvalidSettings, match="rows"):
        core.reaction_diffusion(*plain(8), size=size)
    with pytest.raises(core.InvalidSettings, match="rows"):
        core.advect_on_surface(*plain(8), np.ones((2, 3)), size=size)


def test_cancelled_runs_raise():
    mesh, uv = plain(32)
    for most in (0, 3, 30, 100):
        told = []

        def ask(fraction, message, most=most, told=told):
            told.append(fraction)
            return len(told) <= most

        with pytest.raises(core.Cancelled):
            core.reaction_diffusion(mesh, uv, size=(32, 32), progress=ask)
        assert len(told) == most + 1
        assert told == sorted(told)
