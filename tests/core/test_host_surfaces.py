# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces of host programs: welded, mirrored, laid out in tiles, and their sharp edges."""

import numpy as np
import pytest
from shapes import cube, grid
from shock_filter.core.host.edge_marks import face_normals, sharp_edges
from shock_filter.core.host.inputs import Surface
from shock_filter.core.host.mosaic import Mosaic
from shock_filter.core.host.symmetry import mirror_pairs, symmetrise
from shock_filter.core.host.welding import welded


def surface(vertices, faces, mask=None):
    return Surface(
        positions=vertices.astype(np.float32),
        triangles=faces.astype(np.int32),
        mask=mask,
        to_world=np.identity(3),
    )


def test_of_welded_vertices_the_most_protected_counts():
    vertices, faces = grid(2, 2)
    twice = np.concatenate([vertices, vertices])
    both = np.concatenate([faces, faces + len(vertices)])
    first, second = np.random.default_rng(0).random((2, len(vertices)))
    for one, other in ((first, second), (second, first)):
        joined = welded(surface(twice, both, np.concatenate([one, other])), True)
        assert joined.mask.tolist() == np.minimum(first, second).tolist()
    apart = welded(surface(twice, both, np.concatenate([first, second])), False)
    assert apart.mask.tolist() == [*first, *second]


def test_vertices_with_other_masks_are_no_mirrored_pair():
    vertices, faces = cube(2)
    mask = np.ones(len(vertices))
    pairs = mirror_pairs(vertices, faces, mask, 0)
    mirrored = vertices * [-1, 1, 1]
    assert (vertices[pairs] == mirrored).all()
    side = vertices[:, 0] > 0
    mask[side] = 0.5
    found = mirror_pairs(vertices, faces, mask, 0)
    assert (found[vertices[:, 0] != 0] == -1).all()
    assert (found[vertices[:, 0] == 0] == np.flatnonzero(vertices[:, 0] == 0)).all()
    moves = np.random.default_rng(0).normal(size=vertices.shape)
    kept = symmetrise(moves, found, 0)
    assert (kept[vertices[:, 0] != 0] == moves[vertices[:, 0] != 0]).all()


def test_triangles_beyond_the_last_tile_of_a_row_lie_in_none():
    mosaic = Mosaic.of({1001: (4, 6), 1002: (4, 4), 1011: (8, 8)}, margin=1)
    corner = np.array([[0.1, 0.1], [0.9, 0.1], [0.1, 0.9]])
    tiles = np.array([(0, 0), (1, 0), (0, 1), (10, 0), (9, 0), (-1, 0), (0, 2)])
    placed, inside = mosaic.place(corner + tiles[:, None])
    assert inside.tolist() == [True, True, True, False, False, False, False]
    for number, found in zip((1001, 1002, 1011), placed, strict=False):
        row, column, height, width = mosaic.places[number]
        texels = found * [mosaic.width, mosaic.height] - [column, row]
        assert texels == pytest.approx(corner * [width, height])


def test_faces_without_area_have_no_sharp_edges():
    # Two squares at a right angle, and between one of them and a third one a face without area.
    positions = np.array(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [2, 0, 0], [2, 1, 0]]
    )
    corners = np.array([0, 1, 2, 3, 0, 1, 5, 4, 1, 1, 2, 2, 1, 6, 7, 2])
    starts = np.array([0, 4, 8, 12])
    edges = np.array([0, 1, 2, 3, 0, 4, 5, 6, 7, 1, 8, 9, 10, 11, 12, 9])
    normals = face_normals(positions.astype(np.float32), corners, starts)
    assert (normals[2] == 0).all()
    sharp = sharp_edges(normals, starts, edges, 13, np.radians(30))
    assert np.flatnonzero(sharp).tolist() == [0]
    assert not sharp_edges(normals, starts, edges, 13, np.radians(100)).any()
