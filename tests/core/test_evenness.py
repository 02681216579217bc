# SPDX-License-Identifier: GPL-3.0-or-later
"""Where lengths of unevenly scaled surfaces are measured."""

import numpy as np
import pytest
from shapes import grid
from shock_filter.core.mesh.evenness import even_lengths

TURN = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]


def squares(cells=30):
    """Six sheets that look to all sides, turned off the axes: even triangles."""
    vertices, faces = grid(cells, cells)
    flat = vertices - vertices.mean(axis=0)
    sides = [np.roll(flat, shift, axis=1) for shift in range(3)]
    count = len(flat)
    points = np.concatenate(sides) @ TURN.T
    return points, np.concatenate([faces + number * count for number in range(3)]).astype(np.int32)


def uneven(name):
    shear = np.identity(3)
    shear[0, 2] = 1.0
    matrix = {
        "flat": np.diag([1.0, 1.0, 0.2]),
        "half": np.diag([1.0, 1.0, 0.5]),
        "long": np.diag([1.0, 1.0, 5.0]),
        "two axes": np.diag([0.4, 0.4, 1.0]),
        "shear": shear,
        "turned child": np.diag([1.0, 1.0, 0.3]) @ TURN,
    }[name]
    return matrix / np.linalg.norm(matrix, 2)


def mean_edge(points, faces):
    corners = points[faces]
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean()


NAMES = pytest.mark.parametrize(
    "name", ["flat", "half", "long", "two axes", "shear", "turned child"]
)


@NAMES
def test_what_is_even_in_its_own_space_is_measured_there(name):
    points, faces = squares()
    matrix = uneven(name)
    chosen = even_lengths(points.astype(np.float32), faces, matrix)
    np.testing.assert_array_equal(chosen, chosen[0, 0] * np.identity(3))
    scene, own = mean_edge(points @ matrix.T, faces), mean_edge(points @ chosen.T, faces)
    assert own == pytest.approx(scene, rel=1e-5)


@NAMES
def test_what_is_even_in_the_scaled_shape_is_measured_there(name):
    points, faces = squares()
    matrix = uneven(name)
    own = np.linalg.solve(matrix, points.T).T.astype(np.float32)
    assert even_lengths(own, faces, matrix) is matrix


def test_the_scaled_shape_counts_where_there_is_no_difference():
    points, faces = squares()
    matrix = np.diag([1.0, 1.0, 0.99])
    assert even_lengths(points.astype(np.float32), faces, matrix) is matrix


def test_even_scales_and_what_is_no_number_change_nothing():
    points, faces = squares(4)
    points = points.astype(np.float32)
    for matrix in (np.identity(3), uneven("flat")):
        for wrong in (np.nan, np.inf):
            points[5] = wrong
            assert even_lengths(points, faces, matrix) is matrix
    assert even_lengths(np.zeros_like(points), faces, uneven("flat")).shape == (3, 3)


def test_of_large_meshes_some_faces_say_it():
    points, faces = squares(300)
    chosen = even_lengths(points.astype(np.float32), faces, uneven("flat"))
    scene, own = mean_edge(points @ uneven("flat").T, faces), mean_edge(points @ chosen.T, faces)
    assert own == pytest.approx(scene, rel=0.01)
