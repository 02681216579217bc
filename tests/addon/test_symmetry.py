# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's mirror option: a symmetric mesh stays symmetric."""

import bpy
import numpy as np
from shock_filter.core.host.symmetry import mirror_pairs, symmetrise
from shock_filter.shock_addon.data.mesh.meshes import read_positions, write_positions

sharpen = bpy.ops.shock_filter.sharpen_geometry


def symmetric_head():
    """Suzanne with bitwise symmetric vertices, and each vertex's partner across x = 0."""
    bpy.ops.mesh.primitive_monkey_add()
    head = bpy.context.object
    head.modifiers.new("Subdivision", "SUBSURF").levels = 1
    bpy.ops.object.modifier_apply(modifier="Subdivision")
    positions = read_positions(head.data)
    mirrored = positions * np.float32([-1, 1, 1])
    distances = np.linalg.norm(positions[:, None] - mirrored[None], axis=2)
    partner = distances.argmin(axis=0)
    assert (partner[partner] == np.arange(len(partner))).all()
    positions = 0.5 * (positions + mirrored[partner])
    write_positions(head.data, positions)
    head.data.update()
    return head, partner


def asymmetry(positions, partner):
    return np.abs(positions - (positions * np.float32([-1, 1, 1]))[partner]).max()


def test_a_symmetric_mesh_stays_symmetric():
    head, partner = symmetric_head()
    before = read_positions(head.data)
    on_plane = partner == np.arange(len(partner))
    assert on_plane.sum() > 20
    head.data.use_mirror_x = True
    sharpen(where="everywhere", time=256.0)
    after = read_positions(head.data)
    assert (after != before).any(axis=1).mean() > 0.5
    assert asymmetry(after, partner) == 0.0
    assert (after[on_plane, 0] == 0.0).all()


def test_without_the_option_nothing_is_paired():
    head, partner = symmetric_head()
    sharpen(where="everywhere", time=256.0)
    assert asymmetry(read_positions(head.data), partner) > 0.0


def test_an_asymmetric_mask_is_respected():
    head, _ = symmetric_head()
    before = read_positions(head.data)
    head.data.use_mirror_x = True
    right = np.flatnonzero(before[:, 0] > 1e-6)
    head.vertex_groups.new(name="Right").add(right.tolist(), 1.0, "REPLACE")
    sharpen(where="everywhere", vertex_group="Right")
    moved = np.flatnonzero((read_positions(head.data) != before).any(axis=1))
    assert len(moved) > 0
    assert set(moved) <= set(right)


def test_all_three_axes(rounded_box):
    box = rounded_box()
    mesh = box.data
    mesh.use_mirror_x = mesh.use_mirror_y = mesh.use_mirror_z = True
    sharpen()
    after = read_positions(mesh)
    for axis in range(3):
        mirrored = after.copy()
        mirrored[:, axis] *= -1
        nearest = np.abs(after[:, None] - mirrored[None]).max(axis=2).min(axis=1)
        assert nearest.max() < 2e-6


def test_pairs_by_hand():
    points = np.array([[1.0, 0, 0], [-1.001, 0, 0], [0, 1, 0], [2, 1, 0]])
    triangles = np.array([[0, 1, 2], [1, 2, 3]])
    assert mirror_pairs(points, triangles, None, 0).tolist() == [1, 0, 2, -1]
    mask = np.array([1.0, 0.5, 1.0, 1.0])
    assert mirror_pairs(points, triangles, mask, 0).tolist() == [-1, -1, 2, -1]


def test_moves_are_averaged_by_hand():
    moves = np.array([[1.0, 2, 3], [3.0, 4, 5], [1.0, 1, 1], [7.0, 7, 7]])
    result = symmetrise(moves, np.array([1, 0, 2, -1]), 0)
    np.testing.assert_array_equal(result, [[-1, 3, 4], [1, 3, 4], [0, 1, 1], [7, 7, 7]])
