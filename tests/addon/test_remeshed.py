# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts out of Blender's voxel remesh, as training imitates it and as sharpening mends it."""

import numpy as np
import pytest
from blender_parts import NOTCH, notched
from distances import box, cut
from mathutils import Euler
from meshings import EXTENT, renormalized, sampled, surface_nets
from scipy.spatial import cKDTree
from shock_filter import core

TURN = Euler((0.3, 0.5, 0.2))


@pytest.mark.parametrize("turn", [Euler((0, 0, 0)), TURN])
def test_voxels_of_training_are_those_of_blender(turn):
    voxel, cells = 3 / 32, 33
    notch = cut(box((0, 0, 0), (1, 0.7, 0.5)), box((1, 0, 0.5), (0.5, 2, 0.3)))
    back = np.array(turn.to_matrix())
    distances = sampled(lambda p: notch(p @ back), cells)
    part = notched(turn, voxel)
    off = {}
    for name, d in (("renormalized", renormalized(distances, voxel)), ("not", distances)):
        places, _ = surface_nets(d)
        apart, _ = cKDTree(part.vertices).query(places * voxel - EXTENT)
        off[name] = np.quantile(apart / voxel, 0.97)
    assert off["renormalized"] < 2e-3  # of a voxel, but where a cell holds two sheets
    assert off["not"] > 2e-2


def error_at(part, vertices, turn, place, voxel):
    """Mean degrees within two voxels of an edge along y, by x and z, of parts that were turned."""
    middle = part.vertices[part.faces].mean(axis=1) @ np.array(turn.to_matrix())
    near = np.hypot(middle[:, 0] - place[0], middle[:, 2] - place[1]) < 2 * voxel
    near &= abs(middle[:, 1]) < 0.7 - 3 * voxel
    degrees, areas = part.errors(vertices)
    return np.average(degrees[near], weights=areas[near])


@pytest.mark.parametrize("voxel", [0.06, 0.04])
def test_concave_edges_close_as_convex_ones_do(voxel):
    part = notched(TURN, voxel)
    result = core.sharpen_geometry(core.TriangleMesh(part.vertices, part.faces))
    for place in NOTCH.values():
        assert error_at(part, part.vertices, TURN, place, voxel) > 10
        assert error_at(part, result, TURN, place, voxel) < 2
