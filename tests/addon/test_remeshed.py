# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts out of Blender's remesh, as training imitates it, as sharpening and denoising mend it."""

import bpy
import numpy as np
import pytest
from blender_parts import NOTCH, Part, apply, arrays, notched
from distances import box, cut
from mathutils import Euler
from meshings import EXTENT, RAISED, preserved, renormalized, sampled, surface_nets
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


@pytest.mark.parametrize("turn", [Euler((0, 0, 0)), TURN])
def test_preserved_volumes_of_training_are_those_of_blender(turn):
    voxel, cells = 3 / 32, 33
    back = np.array(turn.to_matrix())
    solid = lambda p: box((0, 0, 0), (1, 0.7, 0.5))(p @ back)  # noqa: E731
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.mesh.primitive_cube_add(size=2, scale=(1.0, 0.7, 0.5), rotation=turn)
    bpy.ops.object.transform_apply()
    mesh = bpy.context.object.data
    mesh.remesh_voxel_size, mesh.use_remesh_preserve_volume = voxel, True
    assert bpy.ops.object.voxel_remesh() == {"FINISHED"}
    vertices, _ = arrays(bpy.context.object.data)
    places, faces = surface_nets(renormalized(sampled(solid, cells), voxel) - RAISED * voxel)
    places = places * voxel - EXTENT
    off = {}
    for name, moved in (("preserved", preserved(solid, places, faces, voxel)), ("not", places)):
        apart, _ = cKDTree(vertices).query(moved)
        off[name] = np.quantile(apart / voxel, 0.97)
    assert off["preserved"] < 0.04  # of a voxel; Blender takes normals of quads, which are bent
    assert off["not"] > 0.1


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


def test_a_box_of_blocks_becomes_flat_sides():
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.mesh.primitive_cube_add(size=2, scale=(1.0, 0.7, 0.5), rotation=TURN)
    bpy.ops.object.transform_apply()
    obj = bpy.context.object
    design = arrays(obj.data)
    modifier = obj.modifiers.new("Remesh", "REMESH")
    modifier.mode, modifier.octree_depth = "BLOCKS", 6
    apply(obj)
    part = Part(*arrays(obj.data), design)
    assert bpy.ops.shock_filter.denoise() == {"FINISHED"}
    result, _ = arrays(obj.data)
    before, after = (
        np.average(degrees, weights=areas)
        for degrees, areas in map(part.errors, (part.vertices, result))
    )
    assert before > 25
    assert after < 0.2 * before
