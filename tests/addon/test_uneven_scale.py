# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects whose scale differs between axes: lengths are measured where triangles are even."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix
from shock_filter.shock_addon.data.mesh.creases import read_creases
from shock_filter.shock_addon.data.mesh.geometry import read_geometry
from shock_filter.shock_addon.data.mesh.low_poly import read_cut
from shock_filter.shock_addon.data.mesh.meshes import (
    read_positions,
    scale_in_world,
    write_positions,
)

sharpen = bpy.ops.shock_filter.sharpen_geometry

TURN = Euler((0.3, 0.5, 0.2)).to_matrix().to_4x4()
SHEAR = Matrix(((1, 0, 1, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)))
MATRICES = {
    "flat": Matrix.Diagonal((1.0, 1.0, 0.3, 1.0)),
    "half": Matrix.Diagonal((1.0, 1.0, 0.5, 1.0)),
    "long": Matrix.Diagonal((1.0, 1.0, 4.0, 1.0)),
    "shear": SHEAR,
}

each_matrix = pytest.mark.parametrize("matrix", MATRICES.values(), ids=MATRICES)


@pytest.fixture
def remesh():
    """Return a function that adds a turned block with a step, remeshed; or a copy of its mesh."""
    made = []

    def add():
        if made:
            obj = bpy.data.objects.new("Copy", made[0].copy())
            bpy.context.collection.objects.link(obj)
            return obj
        corners = np.float32([(-1, -1), (1, -1), (1, 0), (0, 0), (0, 1), (-1, 1)])
        points = [(*corner, height) for height in (-0.5, 0.5) for corner in corners.tolist()]
        sides = [(i, (i + 1) % 6, (i + 1) % 6 + 6, i + 6) for i in range(6)]
        mesh = bpy.data.meshes.new("Block")
        mesh.from_pydata(points, [], [(5, 4, 3, 2, 1, 0), (6, 7, 8, 9, 10, 11), *sides])
        mesh.transform(TURN)
        obj = bpy.data.objects.new("Block", mesh)
        bpy.context.collection.objects.link(obj)
        bpy.context.view_layer.objects.active = obj
        mesh.remesh_voxel_size = 0.09
        assert bpy.ops.object.voxel_remesh() == {"FINISHED"}
        made.append(obj.data.copy())
        return obj

    return add


def place(obj, matrix):
    """Give it a matrix that may contain shear, by its parent's."""
    parent = bpy.data.objects.new("Parent", None)
    bpy.context.collection.objects.link(parent)
    obj.parent, obj.matrix_parent_inverse = parent, matrix


def made_in_the_scene(obj, matrix):
    """Give it a matrix, after which its shape is what it was without."""
    points = read_positions(obj.data).astype(np.float64)
    inverse = np.linalg.inv(np.array(matrix.to_3x3()))
    write_positions(obj.data, (points @ inverse.T).astype(np.float32))
    place(obj, matrix)


def scaled_beside(remesh, select):
    """Add the same remesh twice, select both, and scale the second."""
    plain, own = remesh(), remesh()
    place(own, MATRICES["flat"])
    bpy.context.view_layer.update()
    select(plain, own)
    return plain, own


def in_scene(obj):
    matrix = np.array(obj.matrix_world.to_3x3())
    return read_positions(obj.data) @ matrix.T


@each_matrix
def test_both_kinds_at_once_become_what_they_become_without_scale(remesh, select, matrix):
    plain, own, scene = remesh(), remesh(), remesh()
    place(own, matrix)
    made_in_the_scene(scene, matrix)
    bpy.context.view_layer.update()
    start = read_positions(plain.data)
    select(plain, own, scene)
    assert sharpen() == {"FINISHED"}
    wanted = read_positions(plain.data)
    assert np.abs(wanted - start).max() > 0.02
    np.testing.assert_allclose(read_positions(own.data), wanted, atol=1e-3)
    np.testing.assert_allclose(in_scene(scene), wanted, atol=1e-3)


@each_matrix
def test_all_tools_measure_in_the_same_space_in_lengths_of_the_scene(remesh, matrix):
    obj = remesh()
    place(obj, matrix)
    bpy.context.view_layer.update()
    where = {"vertex_group": "", "invert_mask": False, "selected_only": False}
    run = SimpleNamespace(
        **where, output="MESH", custom_normals="KEEP", mark_sharp=False, sharp_angle=0.0
    )
    _, shape = read_geometry(obj, "OBJECT", run)
    _, creases = read_creases(obj, "OBJECT", SimpleNamespace(**where), 0.5)
    _, cut = read_cut(obj, "OBJECT", None)
    for other in (creases, cut):
        np.testing.assert_array_equal(shape.to_world, other.to_world)

    def mean_edge(points):
        corners = points[shape.triangles]
        return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean()

    measured = mean_edge(shape.into_world(shape.positions)) * scale_in_world(obj)
    assert measured == pytest.approx(mean_edge(in_scene(obj)), rel=1e-4)


@pytest.mark.parametrize("method", ["automatic", "beltrami"])
def test_denoising_goes_the_same_way(remesh, select, method):
    plain, own = remesh(), remesh()
    noise = np.random.default_rng(0).normal(scale=0.02, size=read_positions(own.data).shape)
    for obj in (plain, own):
        write_positions(obj.data, (read_positions(obj.data) + noise).astype(np.float32))
    place(own, MATRICES["flat"])
    bpy.context.view_layer.update()
    start = read_positions(plain.data)
    select(plain, own)
    assert bpy.ops.shock_filter.denoise(method=method) == {"FINISHED"}
    assert np.abs(read_positions(plain.data) - start).max() > 0.01
    np.testing.assert_allclose(read_positions(own.data), read_positions(plain.data), atol=1e-3)


def test_the_marks_of_creases_do_not_depend_on_scale(remesh, select):
    plain, own = scaled_beside(remesh, select)
    assert bpy.ops.shock_filter.mark_creases() == {"FINISHED"}
    marks = []
    for obj in (plain, own):
        marked = np.empty(len(obj.data.edges), dtype=bool)
        obj.data.attributes["sharp_edge"].data.foreach_get("value", marked)
        marks.append(marked)
    assert marks[0].sum() > 100
    np.testing.assert_array_equal(*marks)


def test_a_low_poly_does_not_depend_on_scale(remesh, select):
    plain, own = scaled_beside(remesh, select)
    assert bpy.ops.shock_filter.crisp_low_poly() == {"FINISHED"}
    made = {obj.name: obj.data for obj in bpy.context.selected_objects}
    first, second = made[f"{plain.name} low poly"], made[f"{own.name} low poly"]
    assert len(first.polygons) == len(second.polygons) < 400
    np.testing.assert_allclose(read_positions(first), read_positions(second), atol=1e-3)
