# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of geodesic distance in textures."""

import numpy as np
import pytest
from atlases import Blocks, apart
from shapes import grid, icosphere
from shock_filter import core
from shock_filter.core.base.findings import gathering
from shock_filter.core.elements import fronts
from surface_spaces import square
from test_texture_space import LAYOUTS


def places_of(atlas):
    """Where in space each texel lies: (h, w, 3)."""
    return atlas.bake(atlas.mesh.vertices[atlas.mesh.faces])


def nearest(mesh, place):
    return int(np.argmin(np.linalg.norm(mesh.vertices - place, axis=1)))


def plain(n=32):
    vertices, faces = grid(1, 1)
    return core.TriangleMesh(vertices * n, faces), vertices[faces][..., :2]


def wavy(n=64):
    """A curved sheet in 4 x 4 turned charts and in one: mesh, uv and size of both."""
    blocks = Blocks(np.zeros((n, n, 1)), 0.4)
    vertices = blocks.vertices.copy()
    x, y = vertices[:, 0] / n * 2 * np.pi, vertices[:, 1] / n * 2 * np.pi
    vertices[:, 2] = 0.1 * n * np.sin(x) * np.cos(y)
    mesh = core.TriangleMesh(vertices, blocks.faces)
    whole = (vertices[mesh.faces][..., :2] + n / 2) / (2 * n)
    return mesh, [(blocks.uv, blocks.width), (whole, 2 * n)]


def ball(subdivisions, texels):
    """A ball of radius 1 each of whose faces is a chart; so many texels to the unit."""
    mesh = core.TriangleMesh(*icosphere(subdivisions))
    return mesh, *apart(mesh, texels_per_length=texels)


def tube(sides=12, rings=6):
    """An open tube of flat sides, round about 1: vertices, faces and corners unrolled."""
    vertices, faces = grid(sides, rings)
    around = vertices[:, 0] % sides
    angle = 2 * np.pi * around / sides
    number = (around * (rings + 1) + vertices[:, 1]).astype(int)
    placed = np.empty((sides * (rings + 1), 3))
    placed[number] = np.stack([np.cos(angle), np.sin(angle), vertices[:, 1] * 0.5], axis=1)
    side = 2 * np.sin(np.pi / sides)
    return placed, number[faces], vertices[faces][..., :2] * [side, 0.5], side * sides


@pytest.mark.parametrize("layout", LAYOUTS)
def test_on_a_plane_the_distance_is_exact_however_it_is_cut(layout):
    charts, angle, change = LAYOUTS[layout]
    mesh, uv, size = square(64, charts, angle, change)
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    vertex = nearest(mesh, [23, 31, 0])
    distance = core.geodesic_distance(mesh, uv, size=(size, size), vertices=[vertex], atlas=atlas)
    expected = np.linalg.norm(places_of(atlas) - mesh.vertices[vertex], axis=-1)
    error = np.abs(distance - expected)[atlas.inside]
    assert error.max() < (1e-4 if layout != "charts of a third of a texel" else 0.01)
    there = core.vertex_distance(mesh, vertices=[vertex])
    expected = np.linalg.norm(mesh.vertices - mesh.vertices[vertex], axis=1)
    assert np.abs(there - expected).max() < 1e-4


def test_on_a_ball_the_error_is_small_and_falls_with_the_resolution():
    errors = []
    for subdivisions, texels in ((3, 20.0), (4, 40.0)):
        mesh, uv, size = ball(subdivisions, texels)
        atlas = core.TextureAtlas(mesh, uv, size=(size, size))
        distance = core.geodesic_distance(mesh, uv, size=(size, size), vertices=[5], atlas=atlas)
        places = places_of(atlas)[atlas.inside]
        cosines = places @ mesh.vertices[5] / np.linalg.norm(places, axis=1)
        expected = np.arccos(np.clip(cosines, -1, 1))
        error = np.abs(distance[atlas.inside] - expected)
        far = expected > 2.5
        near = (expected > 0.2) & (expected < 0.5)
        assert error[far].mean() / expected[far].mean() < 0.02
        assert error[near].mean() / expected[near].mean() < 0.02
        errors.append(error.mean() / expected.mean())
    assert errors[1] < min(0.6 * errors[0], 0.004)


def test_around_a_tube_the_shorter_way_counts():
    vertices, faces, flat, girth = tube()
    mesh = core.TriangleMesh(vertices, faces)
    uv = 0.1 + 0.8 * flat / girth
    atlas = core.TextureAtlas(mesh, uv, size=(160, 160))
    distance = core.geodesic_distance(mesh, uv, size=(160, 160), vertices=[0], atlas=atlas)
    unrolled = atlas.bake(flat)
    across = np.minimum(unrolled[..., 0], girth - unrolled[..., 0])
    expected = np.hypot(across, unrolled[..., 1])
    assert np.abs(distance - expected)[atlas.inside].max() < 1e-3 * girth


def test_texels_and_vertices_agree_however_the_surface_is_cut():
    mesh, layouts = wavy()
    found = core.vertex_distance(mesh, vertices=[17])
    for uv, size in layouts:
        atlas = core.TextureAtlas(mesh, uv, size=(size, size))
        distance = core.geodesic_distance(mesh, uv, size=(size, size), vertices=[17], atlas=atlas)
        error = np.abs(distance - atlas.bake(found[mesh.faces]))[atlas.inside]
        assert error.mean() < 0.005 * found.max()  # most of it is of what lies between vertices


def test_at_vertices_points_and_lines_are_exact_on_a_plane_whatever_the_triangles():
    mesh = core.TriangleMesh(*grid(12, 9, jitter=0.3))
    x, y = mesh.vertices[:, :2].T
    found = core.vertex_distance(mesh, vertices=[40])
    np.testing.assert_allclose(found, np.hypot(x - x[40], y - y[40]), atol=1e-4)
    left = np.flatnonzero(x == x.min())
    left = left[np.argsort(y[left])]
    found = core.vertex_distance(mesh, edges=np.stack([left[:-1], left[1:]], axis=1))
    np.testing.assert_allclose(found, x - x.min(), atol=1e-4)
    sides = np.minimum(np.minimum(x - x.min(), x.max() - x), np.minimum(y - y.min(), y.max() - y))
    found = core.vertex_distance(mesh, core.DistanceSettings(source="border"))
    assert np.abs(found - sides).mean() < 0.05  # an edge is too long where two fronts meet


def test_sheared_strips_of_thin_faces_are_all_reached():
    # Rows of points, each turned by 1.4 steps: long faces of which no two share a plane.
    around, rows = np.arange(69), np.arange(26)
    angle = 2 * np.pi * (around - 1.4 * rows[:, None]) / 69
    height = np.broadcast_to(0.024 * rows[:, None], angle.shape)
    vertices = np.stack([np.cos(angle), np.sin(angle), height], axis=-1).reshape(-1, 3)
    a = (69 * rows[:-1, None] + around).reshape(-1)
    b = (69 * rows[:-1, None] + (around + 1) % 69).reshape(-1)
    faces = np.concatenate([np.stack([a, b, a + 69], 1), np.stack([b, b + 69, a + 69], 1)])
    mesh = core.TriangleMesh(vertices, faces)
    found = core.vertex_distance(mesh, vertices=[0])
    assert np.isfinite(found).all()
    # The surface is close to a round tube of radius 1.
    turn = np.abs((angle.reshape(-1) + np.pi) % (2 * np.pi) - np.pi)
    exact = np.hypot(turn, vertices[:, 2])
    assert found == pytest.approx(exact, rel=0.1, abs=0.4)
    assert np.abs(found - exact).mean() < 0.1


def test_at_the_vertices_of_a_ball_the_error_falls_with_the_edges():
    errors = []
    for subdivisions in (3, 4):
        mesh = core.TriangleMesh(*icosphere(subdivisions))
        expected = np.arccos(np.clip(mesh.vertices @ mesh.vertices[0], -1, 1))
        found = core.vertex_distance(mesh, vertices=[0])
        errors.append(np.abs(found - expected).mean() / expected.mean())
    assert errors[1] < min(0.55 * errors[0], 0.004)


def steep_cone(sides=24, rows=12, height=8.0):
    """A cone around Z: mesh, and each vertex's place from above."""
    angles = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rings = np.linspace(0.05, 1.0, rows)[:, None, None] * ring
    flat = np.concatenate([[[0.0, 0.0]], rings.reshape(-1, 2)])
    k = np.arange(sides)
    faces = [np.stack([0 * k, 1 + k, 1 + (k + 1) % sides], axis=1)]
    for row in range(rows - 1):
        a, b = 1 + sides * row + k, 1 + sides * row + (k + 1) % sides
        faces += [np.stack([a, a + sides, b + sides], 1), np.stack([a, b + sides, b], 1)]
    height = height * (1.0 - np.linalg.norm(flat, axis=1))
    return core.TriangleMesh(np.column_stack([flat, height]), np.concatenate(faces)), flat


@pytest.mark.parametrize("power", [1.0, 3.0])
def test_on_a_steep_cone_the_straight_way_to_the_tip_is_exact(power):
    # Seen from above, texels are eight times as long upwards as across; and with `power` the tip
    # is a single texel.
    mesh, flat = steep_cone()
    far = np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9)
    uv = (0.5 + 0.45 * flat * far ** (power - 1.0))[mesh.faces]
    found = core.vertex_distance(mesh, vertices=[1 + 24 * 11])
    line = [0, *(1 + 24 * np.arange(12))]
    straight = np.linalg.norm(mesh.vertices[line] - mesh.vertices[line[-1]], axis=1)
    assert np.abs(found[line] - straight).max() < 1e-5 * straight.max()
    atlas = core.TextureAtlas(mesh, uv, size=(96, 96))
    texels = core.geodesic_distance(mesh, uv, size=(96, 96), vertices=[1 + 24 * 11], atlas=atlas)
    error = np.abs(texels - atlas.bake(found[mesh.faces]))[atlas.inside]
    assert error.mean() < 5e-3 * straight.max()


def test_there_and_back_are_as_long():
    mesh, _ = wavy()
    for a, b in ((0, 80), (12, 44), (30, 75)):
        ways = [
            core.vertex_distance(mesh, vertices=[one])[other] for one, other in ((a, b), (b, a))
        ]
        assert abs(ways[0] - ways[1]) < 0.005 * ways[0]


def test_distance_is_that_of_the_nearest_source():
    mesh, layouts = wavy()
    uv, size = layouts[0]
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    given = [{"vertices": [3]}, {"points": ([40], [[0.2, 0.3, 0.5]])}]
    apart_ = [
        core.geodesic_distance(mesh, uv, size=(size, size), atlas=atlas, **one) for one in given
    ]
    both = core.geodesic_distance(mesh, uv, size=(size, size), atlas=atlas, **given[0], **given[1])
    inside = atlas.inside
    assert np.abs(both - np.minimum(*apart_))[inside].max() < 0.02 * both[inside].max()


def test_a_point_counts_from_where_it_lies():
    mesh, uv = plain()
    shares = np.array([0.2, 0.3, 0.5])
    atlas = core.TextureAtlas(mesh, uv, size=(32, 32))
    for face in (0, 1):
        distance = core.geodesic_distance(mesh, uv, size=(32, 32), points=([face], [shares]))
        place = shares @ mesh.vertices[mesh.faces[face]]
        expected = np.linalg.norm(places_of(atlas) - place, axis=-1)
        assert np.abs(distance - expected).max() < 1e-4


def test_points_keep_to_the_given_corners_where_a_face_was_turned():
    vertices = np.array([[0.0, 0, 0], [16, 0, 0], [16, 16, 0], [0, 16, 0]])
    faces = np.array([[0, 1, 2], [0, 3, 2]])
    mesh = core.TriangleMesh(vertices, faces)
    assert mesh.flipped.any()
    for face in (0, 1):
        shares = np.array([0.1, 0.3, 0.6])
        place = shares @ vertices[faces[face]]
        found = core.vertex_distance(mesh, points=([face], [shares]))
        assert np.abs(found - np.linalg.norm(vertices - place, axis=1)).max() < 1e-4


def test_edges_and_borders_are_lines():
    mesh, uv, size = square(64)
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    places, inside = places_of(atlas), atlas.inside
    side = np.flatnonzero(mesh.vertices[:, 0] == 0)
    side = side[np.argsort(mesh.vertices[side, 1])]
    pairs = np.stack([side[:-1], side[1:]], axis=1)
    distance = core.geodesic_distance(mesh, uv, size=(size, size), edges=pairs, atlas=atlas)
    assert np.abs(distance - places[..., 0])[inside].max() < 1e-3
    settings = core.DistanceSettings(source="border")
    distance = core.geodesic_distance(mesh, uv, size=(size, size), settings=settings, atlas=atlas)
    expected = np.minimum(places[..., :2], 64 - places[..., :2]).min(axis=-1)
    assert np.abs(distance - expected)[inside].max() < 0.02


def test_along_a_line_that_leans_a_little_the_front_is_straight():
    # Lines are cut from texel to texel: beside each joint, a texel's nearest point lies on one part
    # and hardly beyond the end of the other, from which the front would be round.
    leaning = 1e-3
    for sign in (-1, 1):
        for high in (8.1, 15.9):
            ends = high - sign * 12 * leaning, high + sign * 12 * leaning
            vertices = np.array([[0, 0], [24, 0], [24, ends[1]], [24, 24], [0, 24], [0, ends[0]]])
            faces = np.array([[0, 1, 2], [0, 2, 5], [5, 2, 3], [5, 3, 4]])
            mesh = core.TriangleMesh(np.pad(vertices, ((0, 0), (0, 1))), faces)
            uv = vertices[faces] / 24
            found = core.geodesic_distance(mesh, uv, size=(24, 24), edges=[[5, 2]])
            y, x = np.mgrid[:24, :24] + 0.5
            expected = np.abs(y - high - sign * leaning * (x - 12)) / np.hypot(1, leaning)
            assert np.abs(found - expected)[:, 1:-1].max() < 1e-3


def test_seams_are_the_borders_of_charts():
    mesh, uv, size = square(64)
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    settings = core.DistanceSettings(source="seams")
    distance = core.geodesic_distance(mesh, uv, size=(size, size), settings=settings, atlas=atlas)
    within = places_of(atlas)[..., :2] % 16.0
    expected = np.minimum(within, 16 - within).min(axis=-1)
    assert np.abs(distance - expected)[atlas.inside].max() < 1e-3


def test_painted_texels_are_sources():
    mesh, uv = plain()
    image = np.zeros((32, 32))
    image[:, :8] = 1.0
    image[0, 0] = 0.2
    distance = core.geodesic_distance(mesh, uv, size=(32, 32), image=image)
    expected = np.maximum(np.arange(32) - 7.0, 0.0)
    assert np.abs(distance[1:] - expected).max() < 1e-4
    image[:] = 0.0
    image[9, 20] = 0.5
    distance = core.geodesic_distance(mesh, uv, size=(32, 32), image=image)
    y, x = np.mgrid[:32, :32]
    assert np.abs(distance - np.hypot(y - 9, x - 20)).max() < 1e-4


def test_what_no_way_leads_to_is_infinite():
    vertices, faces = grid(1, 1)
    two = np.concatenate([vertices, vertices + [2, 0, 0]])
    mesh = core.TriangleMesh(two, np.concatenate([faces, faces + 4]))
    flat = two[mesh.faces][..., :2] / 4 + [0.1, 0.3]
    atlas = core.TextureAtlas(mesh, flat, size=(40, 40))
    distance = core.geodesic_distance(mesh, flat, size=(40, 40), vertices=[0])
    far = atlas.inside & (places_of(atlas)[..., 0] > 1.5)
    assert np.isinf(distance[far]).all() and np.isfinite(distance[atlas.inside & ~far]).all()
    assert not np.isnan(distance).any()
    assert np.isinf(core.vertex_distance(mesh, vertices=[0])[4:]).all()
    for look in ("gradient", "lines"):
        settings = core.DistanceSettings(look=look, smoothing=2.0)
        shown = core.geodesic_distance(mesh, flat, size=(40, 40), vertices=[0], settings=settings)
        assert (shown[far] == 0).all() and np.ptp(shown[atlas.inside & ~far]) > 0.5


def test_gradients_and_lines_are_made_of_the_distance():
    mesh, uv = plain()
    distance = core.geodesic_distance(mesh, uv, size=(32, 32), vertices=[0])

    def shown(**settings):
        settings = core.DistanceSettings(**settings)
        return core.geodesic_distance(mesh, uv, size=(32, 32), vertices=[0], settings=settings)

    width = 10.0
    assert np.allclose(shown(look="gradient", width=width), np.clip(1 - distance / width, 0, 1))
    assert np.allclose(shown(look="gradient"), 1 - distance / distance.max())
    lines = 0.5 + 0.5 * np.cos(2 * np.pi * distance / width)
    assert np.allclose(shown(look="lines", width=width), lines, atol=1e-5)
    lines = 0.5 + 0.5 * np.cos(20 * np.pi * distance / distance.max())
    assert np.allclose(shown(look="lines"), lines, atol=1e-4)


def told_width(run, mesh, **given):
    with gathering() as found:
        shown = run(mesh, settings=core.DistanceSettings(look="gradient"), **given)
    return float(found[-1].values["width"]), shown


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e4])
def test_masks_along_edges_are_narrow_and_grow_with_the_model(scale):
    vertices, faces = grid(20, 20)
    mesh = core.TriangleMesh(scale * vertices, faces)
    edge = np.stack([np.arange(20), np.arange(1, 21)], axis=1)  # along one side
    width, shown = told_width(core.vertex_distance, mesh, edges=edge)
    distance = core.vertex_distance(mesh, edges=edge)
    assert 0 < width < 0.3 * distance.max()
    assert np.isclose(width / scale, told_width(core.vertex_distance, grid_mesh(), edges=edge)[0])
    assert np.allclose(shown, np.clip(1 - distance / width, 0, 1))
    whole, _ = told_width(core.vertex_distance, mesh, vertices=np.unique(edge), edges=edge)
    assert np.isclose(whole, distance.max())


def grid_mesh():
    return core.TriangleMesh(*grid(20, 20))


def test_masks_along_edges_narrow_where_edges_are_close():
    mesh = grid_mesh()
    row = np.stack([np.arange(20), np.arange(1, 21)], axis=1)
    widths = [
        told_width(core.vertex_distance, mesh, edges=np.concatenate(lines))[0]
        for lines in ([row], [row, row + 21 * 10], [row + 21 * n for n in range(0, 21, 4)])
    ]
    assert widths[0] > widths[1] > widths[2] > 0


def test_masks_along_edges_are_no_narrower_than_texels_show():
    mesh, uv = plain()
    edges = [mesh.faces[0][:2]]
    fine, _ = told_width(core.geodesic_distance, mesh, uv=uv, size=(256, 256), edges=edges)
    coarse, _ = told_width(core.geodesic_distance, mesh, uv=uv, size=(8, 8), edges=edges)
    assert fine < coarse


def test_smoothing_rounds_ridges_and_keeps_the_mean():
    mesh, uv = plain()
    settings = core.DistanceSettings(source="border")
    sharp = core.geodesic_distance(mesh, uv, size=(32, 32), settings=settings)
    settings = core.DistanceSettings(source="border", smoothing=3.0)
    smooth = core.geodesic_distance(mesh, uv, size=(32, 32), settings=settings)
    bend = [np.abs(np.diff(rows[16], 2)).max() for rows in (sharp, smooth)]
    assert bend[1] < 0.3 * bend[0]
    assert smooth.mean() == pytest.approx(sharp.mean(), rel=0.02)


def test_the_gutter_continues_across_seams():
    mesh, layouts = wavy()
    uv, size = layouts[0]
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    distance = core.geodesic_distance(mesh, uv, size=(size, size), vertices=[0], atlas=atlas)
    near = atlas.masks().active & ~atlas.inside
    assert np.abs(np.diff(distance, axis=1))[(near[:, 1:] & atlas.inside[:, :-1])].max() < 3.0
    assert (distance[near] > 0).mean() > 0.99


def test_tiny_images_and_charts_of_a_texel():
    mesh, uv = plain()
    for size in ((1, 1), (2, 3), (1, 16)):
        distance = core.geodesic_distance(mesh, uv, size=size, vertices=[0])
        assert distance.shape == size and np.isfinite(distance).all()
    mesh, uv, size = ball(1, 1.0)
    found = core.geodesic_distance(mesh, uv, size=(size, size), vertices=[0])
    assert found.shape == (size, size) and np.isfinite(found).all()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "No source"),
        ({"vertices": []}, "No source"),
        ({"vertices": [4]}, "no vertex 4"),
        ({"vertices": [-1]}, "no vertex -1"),
        ({"vertices": [0.5]}, "whole numbers"),
        ({"points": [0]}, "no pair"),
        ({"points": ([2], [[1, 0, 0]])}, "no face 2"),
        ({"points": ([0], [[1, 0]])}, "give \\(1, 3\\)"),
        ({"points": ([0], [[2, -1, 0]])}, "outside its face"),
        ({"points": ([0], [[np.nan, 1, 0]])}, "outside its face"),
        ({"edges": [[0, 1, 2]]}, "\\(k, 2\\)"),
        ({"edges": [[1, 2]]}, "No edge joins"),
        ({"image": np.zeros((8, 9))}, "\\(8, 8\\)"),
        ({"image": np.full((8, 8), np.nan)}, "NaN"),
        ({"image": np.zeros((8, 8))}, "No source"),
    ],
)
def test_wrong_sources_are_named(given, message):
    mesh, uv = plain()
    with pytest.raises(core.InvalidSignal, match=message):
        core.geodesic_distance(mesh, uv, size=(8, 8), **given)


def test_other_wrong_input_is_named():
    mesh, uv = plain()
    with pytest.raises(core.InvalidSettings, match="rows and columns"):
        core.geodesic_distance(mesh, uv, size=8, vertices=[0])
    for size in ((0, 8), (-1, 4), (2.5, 4), (8, 1 << 30), (8, 10**30), (True, 8), ("8", "8")):
        with pytest.raises(core.InvalidSettings, match="whole number from 1 to 32768"):
            core.geodesic_distance(mesh, uv, size=size, vertices=[0])
    with pytest.raises(core.InvalidSettings, match="a mesh alone has none"):
        core.vertex_distance(mesh, core.DistanceSettings(source="seams"))
    with pytest.raises(core.InvalidSignal, match="No source"):
        core.vertex_distance(mesh)
    with pytest.raises(core.InvalidSignal, match="make an atlas"):
        atlas = core.TextureAtlas(mesh, uv, size=(9, 8))
        core.geodesic_distance(mesh, uv, size=(8, 8), vertices=[0], atlas=atlas)
    closed = core.TriangleMesh(*icosphere(1))
    uv, size = apart(closed)
    with pytest.raises(core.InvalidSignal, match="no border"):
        settings = core.DistanceSettings(source="border")
        core.geodesic_distance(closed, uv, size=(size, size), settings=settings)


def test_a_run_can_be_cancelled_at_any_time():
    mesh, uv, size = square(64)
    calls = []

    def note(*call):
        calls.append(call)
        return True

    core.geodesic_distance(mesh, uv, size=(size, size), vertices=[0], progress=note)
    assert calls == sorted(calls, key=lambda call: call[0]) and calls[-1][0] == 1.0
    for last in np.linspace(0, 0.7 * len(calls), 7).astype(int):
        left = iter(range(last))
        with pytest.raises(core.Cancelled):
            core.geodesic_distance(
                mesh, uv, size=(size, size), vertices=[0],
                progress=lambda *_, left=left: next(left, None) is not None,
            )  # fmt: skip


@pytest.mark.parametrize("smoothing", [1e-310, 1e-30, 1e-9])
def test_tiny_smoothing_smooths_nothing(smoothing):
    mesh, uv = plain()
    settings = core.DistanceSettings(smoothing=smoothing)
    found = core.geodesic_distance(mesh, uv, size=(32, 32), vertices=[0], settings=settings)
    expected = core.geodesic_distance(mesh, uv, size=(32, 32), vertices=[0])
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("is_enough", [False, True])
def test_a_distance_that_is_not_final_is_told(monkeypatch, is_enough):
    mesh, uv = plain()
    monkeypatch.setattr(fronts, "_ROUND", 50)
    monkeypatch.setattr(fronts, "_MOST_VISITS", 100 if is_enough else 0)
    with gathering() as findings:
        core.geodesic_distance(mesh, uv, size=(32, 32), vertices=[0])
    said = [str(finding) for finding in findings]
    assert len(said) == (not is_enough)
    if not is_enough:
        assert said[0].startswith("Places whose distance may be too large: ")
        assert int(said[0].split(": ")[1].rstrip(".")) > 0


def test_a_gradient_without_end_is_0_where_nothing_leads():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    mesh = core.TriangleMesh(np.r_[square, square + [3, 0, 0]], np.r_[faces, faces + 4])
    settings = core.DistanceSettings(look="gradient", width=np.inf)
    found = core.vertex_distance(mesh, settings, vertices=[0])
    np.testing.assert_array_equal(found, [1, 1, 1, 1, 0, 0, 0, 0])
