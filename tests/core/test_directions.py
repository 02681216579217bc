# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of directions on meshes: principal curvature, gradients, axes, and their tensors."""

import numpy as np
import pytest
from shapes import grid, icosphere, rotation
from shock_filter import core
from shock_filter.core.advection.surface import checked_vectors
from shock_filter.core.mesh.directions import at_corners, face_tensors
from shock_filter.core.texture.along_directions import checked_directions


def bent_sheet(n=16, radius=10.0, saddle=False):
    """A sheet bent around the Y axis; or a saddle, less bent the other way."""
    vertices, faces = grid(n, n, jitter=0.15)
    x, y = vertices[:, 0] - n / 2, vertices[:, 1] - n / 2
    if saddle:
        vertices[:, 2] = x * x / 20 - y * y / 60
    else:
        vertices[:, 0] = radius * np.sin(x / radius)
        vertices[:, 2] = radius * np.cos(x / radius)
    return vertices, faces


def inner(vertices, n=16, off=4):
    index = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    return index[off:-off, off:-off].reshape(-1)


def test_a_cylinder_bends_least_along_and_most_around():
    vertices, faces = bent_sheet()
    turn = rotation()
    mesh = core.TriangleMesh(vertices @ turn.T, faces)
    chosen = inner(vertices)
    along = core.principal_directions(mesh)[chosen] @ turn
    around = core.principal_directions(mesh, which="most")[chosen] @ turn
    assert (np.abs(along[:, 1]) > 0.99 * np.linalg.norm(along, axis=1)).all()
    assert np.linalg.norm(along, axis=1).min() > 0.7
    assert (np.abs(around[:, 1]) < 0.1).all() and np.abs((along * around).sum(axis=1)).max() < 1e-9


def test_a_saddle_bends_least_where_it_is_flatter():
    vertices, faces = bent_sheet(saddle=True)
    for sign in (1, -1):
        mesh = core.TriangleMesh(vertices * [1, 1, sign], faces)
        found = core.principal_directions(mesh)[inner(vertices, off=6)]
        assert (np.abs(found[:, 1]) > 0.9 * np.linalg.norm(found, axis=1)).all()


def test_planes_and_balls_have_no_direction():
    flat = core.TriangleMesh(*grid(4, 4))
    assert np.abs(core.principal_directions(flat)).max() < 1e-6
    ball = core.principal_directions(core.TriangleMesh(*icosphere(3)))
    assert np.linalg.norm(ball, axis=1).max() < 0.1


def test_gradients_point_uphill_and_turned_ones_along():
    vertices, faces = grid(5, 4, jitter=0.2)
    mesh = core.TriangleMesh(vertices, faces)
    signal = vertices[:, 0] * 3 + vertices[:, 1] * 4
    for given in (signal, signal[faces], 1e-30 * signal + 7e-30, 1e200 * signal):
        assert np.allclose(core.gradient_directions(mesh, given), [0.6, 0.8, 0])
    along = core.gradient_directions(mesh, signal, turned=True)
    assert np.allclose(np.abs(along), [0.8, 0.6, 0])
    assert (core.gradient_directions(mesh, np.full(len(vertices), 3.0)) == 0).all()
    signal[0] = np.inf
    assert np.isfinite(core.gradient_directions(mesh, signal)).all()


def test_axes_lie_in_the_faces():
    mesh = core.TriangleMesh(*icosphere(2))
    along = core.axis_directions(mesh, [0, 0, 5.0])
    around = core.axis_directions(mesh, [0, 0, 5.0], turned=True)
    for found in (along, around):
        assert np.abs((found * mesh.normals).sum(axis=1)).max() < 1e-12
        assert np.allclose(np.linalg.norm(found, axis=1), 1)
    assert np.abs(around[:, 2]).max() < 1e-12 and (along[:, 2] > 0).all()
    upright = core.TriangleMesh(*grid(1, 1))
    assert (core.axis_directions(upright, [0, 0, 1]) == 0).all()


def test_signs_do_not_matter_to_tensors():
    mesh = core.TriangleMesh(*icosphere(1))
    rng = np.random.default_rng(0)
    vectors = rng.normal(size=(mesh.vertex_count, 3))
    signs = rng.choice([-1.0, 1.0], size=(mesh.vertex_count, 1))
    here, there = (at_corners(mesh, each, None, "field has") for each in (vectors, signs * vectors))
    assert np.allclose(face_tensors(mesh, here), face_tensors(mesh, there))


def band(count=16, unused=0):
    """A closed band, one quad high: as many faces as vertices, but for unused ones."""
    angles = 2 * np.pi * np.arange(count) / count
    ring = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1) * count / 2 / np.pi
    vertices = np.concatenate([ring, ring + [0, 0, 1], np.zeros((unused, 3))])
    a = np.arange(count)
    b = (a + 1) % count
    faces = np.concatenate([np.stack([a, b, b + count], 1), np.stack([a, b + count, a + count], 1)])
    across = np.stack([a, a + 1, a + 1], 1) / count, np.stack([a, a + 1, a], 1) / count
    up = np.array([[0, 0, 1], [0, 1, 1]])
    uv = np.concatenate([np.stack([u, np.broadcast_to(v, u.shape)], -1)
                         for u, v in zip(across, up, strict=True)])  # fmt: skip
    return core.TriangleMesh(vertices, faces), 0.05 + 0.9 * uv


def draw_streaks(mesh, uv, vectors, at=None):
    return core.surface_line_convolution(mesh, uv, size=(24, 64), directions=vectors, at=at)


def draw_noise(mesh, uv, vectors, at=None):
    return core.advect_on_surface(mesh, uv, vectors, size=(24, 64), at=at)


def draw_pattern(mesh, uv, vectors, at=None):
    return core.reaction_diffusion(mesh, uv, size=(24, 64), directions=vectors, at=at)


@pytest.mark.parametrize("draw", [draw_streaks, draw_noise, draw_pattern])
def test_where_vectors_are_is_asked_for_and_checked(draw):
    mesh, uv = band()
    assert mesh.vertex_count == mesh.face_count
    vectors = np.random.default_rng(0).normal(size=(mesh.face_count, 3))
    with pytest.raises(core.InvalidSignal, match="at='faces' or at='vertices'"):
        draw(mesh, uv, vectors)
    for at in ("corners", np.array(["faces", "faces"]), np.zeros(0), 3):
        with pytest.raises(core.InvalidSettings, match="choose one of: faces, vertices"):
            draw(mesh, uv, vectors, at)
    more, _ = band(unused=1)
    with pytest.raises(core.InvalidSignal, match=r"give \(33, 3\)"):
        draw(more, uv, vectors, "vertices")


@pytest.mark.parametrize("draw", [draw_streaks, draw_pattern])
def test_where_vectors_are_is_checked_without_any(draw):
    with pytest.raises(core.InvalidSettings, match="choose one of: faces, vertices"):
        draw(*band(), None, "nonsense")


@pytest.mark.parametrize("checked", [checked_directions, checked_vectors])
def test_vectors_at_faces_and_at_vertices_are_told_apart(checked):
    mesh, _ = band()
    vectors = np.random.default_rng(0).normal(size=(mesh.face_count, 3))
    more, _ = band(unused=1)
    at_vertices = np.concatenate([vectors, np.zeros((1, 3))])
    found = checked(mesh, vectors, "vertices")
    np.testing.assert_array_equal(found, checked(more, at_vertices, None))
    found = checked(mesh, vectors, "faces")
    np.testing.assert_array_equal(found, checked(more, vectors, None))


def test_wrong_input_is_named():
    mesh = core.TriangleMesh(*grid(1, 1))
    with pytest.raises(core.InvalidSettings, match="least, most"):
        core.principal_directions(mesh, which="longest")
    for passes in (2.5, -1, np.nan, "2", None, 10**30):
        with pytest.raises(core.InvalidSettings, match="whole number from 0 to 100000"):
            core.principal_directions(mesh, passes=passes)
    with pytest.raises(core.InvalidSignal, match="give \\(4,\\) or \\(2, 3\\)"):
        core.gradient_directions(mesh, np.zeros(3))
    for axis in ([0, 1], [0, 0, np.nan], ["a", "b", "c"]):
        with pytest.raises(core.InvalidSignal, match="three numbers"):
            core.axis_directions(mesh, axis)
    with pytest.raises(core.InvalidSignal, match="no length"):
        core.axis_directions(mesh, [0, 0, 0])
    with pytest.raises(core.Cancelled):
        core.principal_directions(mesh, progress=lambda *_: False)


def test_turning_faces_over_changes_no_direction():
    vertices, faces = icosphere(2)
    rng = np.random.default_rng(0)
    turned = faces.copy()
    some = rng.random(len(faces)) < 0.3
    turned[some] = turned[some][:, ::-1]
    corners = vertices @ [1.0, 2.0, 3.0]
    jumps = rng.normal(size=(len(faces), 3))  # each face has a slope of its own
    wanted = core.gradient_directions(core.TriangleMesh(vertices, faces), corners[faces] + jumps)
    jumps[some] = jumps[some][:, ::-1]
    found = core.gradient_directions(core.TriangleMesh(vertices, turned), corners[turned] + jumps)
    np.testing.assert_allclose(found, wanted, atol=1e-12)
    vertices, faces = bent_sheet()
    turned = faces.copy()
    turned[::3] = turned[::3, ::-1]
    for find in (
        core.principal_directions,
        lambda mesh: core.axis_directions(mesh, [1, 2, 3]),
        lambda mesh: core.axis_directions(mesh, [1, 2, 3], turned=True),
    ):
        one, other = (find(core.TriangleMesh(vertices, each)) for each in (faces, turned))
        np.testing.assert_allclose(other, one, atol=1e-6)


def test_where_a_saddle_bends_alike_both_ways_there_is_no_direction():
    vertices, faces = grid(16, 16)
    x, y = vertices[:, 0] - 8, vertices[:, 1] - 8
    vertices[:, 2] = (x * x - y * y) / 40
    found = np.linalg.norm(core.principal_directions(core.TriangleMesh(vertices, faces)), axis=1)
    assert found[inner(vertices, off=7)].max() < 0.1


def test_directions_of_the_largest_numbers_are_finite():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    mesh = core.TriangleMesh(square, [[0, 1, 2], [0, 2, 3]])
    found = core.axis_directions(mesh, np.array([-128, 0, 0], np.int8))
    np.testing.assert_allclose(found, [[-1, 0, 0], [-1, 0, 0]], atol=1e-12)
    found = core.gradient_directions(mesh, [1.7e308, -1.7e308, 0, 0])
    small = core.gradient_directions(mesh, [1.7, -1.7, 0, 0])
    np.testing.assert_allclose(found, small, atol=1e-12)
