# SPDX-License-Identifier: GPL-3.0-or-later
import numpy as np
import pytest
import scipy.sparse
from mesh_matrices import divergence, gradient_matrix, stiffness_matrix
from shapes import cube, grid, icosphere, rotation
from shock_filter import core
from shock_filter.core.mesh import calculus


@pytest.fixture(scope="module")
def bent():
    """A jittered sheet, bent and turned, with a border."""
    vertices, faces = grid(9, 8, jitter=0.3)
    vertices[:, 2] = 0.1 * vertices[:, 0] ** 2 - np.sin(vertices[:, 1])
    return core.TriangleMesh(vertices @ rotation().T * 3.7, faces)


def test_gradient_of_a_linear_field_is_exact():
    vertices, faces = grid(9, 8, jitter=0.3)
    turn = rotation(1)
    mesh = core.TriangleMesh(vertices @ turn.T, faces)
    slopes = np.array([[2.0, -1.0, 0], [0.5, 3.0, 0]])
    found = calculus.gradient(mesh, vertices @ slopes.T)
    # Lengths are in mean edge lengths.
    assert np.allclose(found, slopes @ turn.T * mesh.mean_edge_length)


def test_stiffness_is_the_gradients_square(bent):
    rng = np.random.default_rng(0)
    values = rng.normal(size=(bent.vertex_count, 2))
    stiffness = stiffness_matrix(bent)
    assert abs(stiffness - stiffness.T).max() < 1e-12
    gradient = gradient_matrix(bent)
    of_faces = (gradient @ values).reshape(-1, 3, 2).transpose(0, 2, 1)
    assert np.allclose(of_faces, calculus.gradient(bent, values))
    areas = scipy.sparse.diags(np.repeat(bent.areas, 3))
    assert abs(stiffness - gradient.T @ areas @ gradient).max() < 1e-12


def test_mass_adds_up_to_the_area(bent):
    assert calculus.lumped_mass(bent).sum() == pytest.approx(bent.areas.sum())


def test_vertex_averages_agree_with_brute_force(bent):
    values = np.random.default_rng(1).normal(size=(bent.face_count, 3))
    found = calculus.average_to_vertices(bent, values)
    for v in range(0, bent.vertex_count, 7):
        around = (bent.faces == v).any(axis=1)
        expected = np.average(values[around], axis=0, weights=bent.areas[around])
        assert np.allclose(found[v], expected)


def test_smoothing_agrees_with_brute_force(bent):
    values = np.random.default_rng(2).normal(size=(bent.vertex_count, 2))
    expected = values
    for _ in range(3):
        new = np.empty_like(values)
        for v in range(bent.vertex_count):
            ring = sorted(set(bent.faces[(bent.faces == v).any(axis=1)].ravel()) - {v})
            offsets = (bent.vertices[ring] - bent.vertices[v]) / bent.mean_edge_length
            weights = np.exp(-(offsets**2).sum(axis=1))
            new[v] = (expected[v] + weights @ expected[ring]) / (1 + weights.sum())
        expected = new
    before = values.copy()
    assert np.allclose(calculus.smooth_vertices(bent, values, 3), expected)
    assert np.array_equal(values, before)
    assert calculus.smooth_vertices(bent, values, 0) is values


@pytest.mark.parametrize("channels", [1, 2, 3, 5, 6, 12])
def test_channels_are_smoothed_and_averaged_each_for_itself(bent, channels):
    rng = np.random.default_rng(3)
    values = rng.normal(size=(bent.vertex_count, channels))
    alone = [calculus.smooth_vertices(bent, one.reshape(-1, 1), 2) for one in values.T]
    assert np.array_equal(calculus.smooth_vertices(bent, values, 2), np.hstack(alone))
    values = rng.normal(size=(bent.face_count, channels))
    alone = [calculus.average_to_vertices(bent, one.reshape(-1, 1)) for one in values.T]
    assert np.array_equal(calculus.average_to_vertices(bent, values), np.hstack(alone))


@pytest.mark.parametrize("channels", [1, 2])
def test_a_signal_that_is_mostly_0_is_smoothed_alike(channels):
    mesh = core.TriangleMesh(*icosphere(4))
    sparse = np.zeros((mesh.vertex_count, channels))
    sparse[mesh.vertices[:, 2] > 0.9, -1] = 1.0
    found = calculus.smooth_vertices(mesh, sparse, 5)
    assert found[:, -1].any()
    assert (found[mesh.vertices[:, 2] < 0.4] == 0).all()  # 5 rings are narrower
    # Smoothing leaves constants alone; this signal is nowhere 0, so all vertices are computed.
    raised = calculus.smooth_vertices(mesh, sparse + 1.0, 5) - 1.0
    assert np.allclose(found, raised, atol=1e-13)


def test_rows_are_not_zero_if_any_value_is_not():
    values = np.array([[0.0, -0.0, 0.0], [0.0, 0.0, 1e-300], [np.nan, 0.0, 0.0]])
    assert calculus.nonzero_rows(values).tolist() == [False, True, True]


def test_needles_are_weakened_as_a_whole():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1e-8, 0], [0.5, -1, 0]])
    mesh = core.TriangleMesh(vertices, [[0, 1, 2], [1, 0, 3]])
    weights = calculus.cotangents(mesh)
    assert abs(weights).max() <= 500
    # Still a semidefinite form: what keeps the linear solve possible.
    a, b, c = weights[0]
    assert a * b + b * c + c * a >= 0
    assert max(a + b, b + c, c + a) > 0


@pytest.mark.parametrize(
    ("signal", "words"),
    [
        (np.zeros(3), "shape"),
        (np.full(162, np.nan), "NaN"),
        (np.full(162, "x"), "numbers"),
        (np.zeros((162, 0)), "shape"),
        (np.zeros((162, 2, 2)), "shape"),
    ],
)
def test_bad_signals_are_refused(signal, words):
    with pytest.raises(core.InvalidSignal, match=words):
        core.flow_field(core.TriangleMesh(*icosphere(2)), signal)


def test_calculus_on_a_closed_cube_sums_to_zero():
    mesh = core.TriangleMesh(*cube(3))
    field = np.random.default_rng(3).normal(size=(mesh.face_count, 3))
    assert divergence(mesh, field).sum() == pytest.approx(0)


def test_rows_of_a_group_are_averaged_and_others_stay():
    corners = np.array([0, 1, 2, 0, 2, 3], dtype=np.int32)  # two triangles of a square
    values = np.arange(18, dtype=np.float32).reshape(6, 3)
    out = np.full((5, 3), -1, dtype=np.float32)
    calculus.group_means(corners, values, out)
    np.testing.assert_array_equal(out[0], (values[0] + values[3]) / 2)
    np.testing.assert_array_equal(out[1], values[1])
    np.testing.assert_array_equal(out[2], (values[2] + values[4]) / 2)
    np.testing.assert_array_equal(out[3], values[5])
    np.testing.assert_array_equal(out[4], [-1, -1, -1])
