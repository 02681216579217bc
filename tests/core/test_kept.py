# SPDX-License-Identifier: GPL-3.0-or-later
"""What stays with a mesh for the next run on it never changes a result."""

from dataclasses import replace

import numpy as np
import pytest
import shapes
from shock_filter import core
from shock_filter.core.base.memo import equal, kept
from shock_filter.core.mesh import order

SETTINGS = core.GeometrySettings(time=64.0)


@pytest.fixture
def box():
    vertices, faces = shapes.soft_cube(12)
    return vertices / 6, faces


def test_a_result_is_made_once_for_a_key(box):
    mesh = core.TriangleMesh(*box)
    made = []

    def make():
        made.append(len(made))
        return made[-1]

    weights = np.ones(3)
    assert kept(mesh, "thing", (1.0, weights), make) == 0
    assert kept(mesh, "thing", (1.0, np.ones(3)), make) == 0
    weights[0] = 0.5  # the caller's array is not the key
    assert kept(mesh, "thing", (1.0, np.ones(3)), make) == 0
    assert kept(mesh, "thing", (1.0, weights), make) == 1
    assert kept(mesh, "other", (1.0, weights), make) == 2
    assert kept(core.TriangleMesh(*box), "thing", (1.0, weights), make) == 3


def test_what_fails_is_not_kept(box):
    mesh = core.TriangleMesh(*box)

    def fail():
        raise core.Cancelled("no")

    with pytest.raises(core.Cancelled):
        kept(mesh, "thing", (), fail)
    assert kept(mesh, "thing", (), lambda: 5) == 5


def test_keys_differ_by_type_shape_and_bits():
    ones = np.ones(3)
    assert equal((ones, None, 2), (np.ones(3), None, 2))
    assert not equal((ones,), (np.ones(3, dtype=np.float32),))
    assert not equal((ones,), (np.ones((3, 1)),))
    assert not equal((ones,), (None,))
    assert not equal((ones,), (ones, None))
    assert not equal((np.array([0.0]),), (np.array([-0.0]),))


def variations(count):
    half = np.linspace(0.0, 1.0, count)
    yield SETTINGS, None
    yield core.GeometrySettings.of_paper(time=64.0), None
    yield replace(SETTINGS, time=900.0), None
    yield replace(SETTINGS, screening_radius=20.0), None
    yield replace(SETTINGS, screening_radius=100.0), None  # with multigrid
    yield replace(SETTINGS, screening_radius=100.0, time=9.0), None
    yield SETTINGS, half
    yield SETTINGS, half[::-1].copy()
    yield replace(SETTINGS, repeat=2, smoothing_passes=3), half
    yield SETTINGS, None


def test_reusing_a_mesh_changes_no_bit(box):
    mesh = core.TriangleMesh(*box)
    for settings, mask in variations(len(box[0])):
        fresh = core.sharpen_geometry(core.TriangleMesh(*box), settings, mask=mask)
        again = core.sharpen_geometry(mesh, settings, mask=mask)
        assert fresh.tobytes() == again.tobytes() != mesh.vertices.tobytes()


def test_reusing_a_scattered_mesh_changes_no_bit(box, monkeypatch):
    monkeypatch.setattr(order, "_SMALL", 0)
    monkeypatch.setattr(order, "_BLOCK", 1)
    random = np.random.default_rng(3)
    rank = random.permutation(len(box[0]))
    vertices = np.empty_like(box[0])
    vertices[rank] = box[0]
    scattered = vertices, random.permutation(rank[box[1]])
    mesh = core.TriangleMesh(*scattered)
    assert order.is_scattered(mesh)
    for settings, mask in variations(len(vertices)):
        fresh = core.sharpen_geometry(core.TriangleMesh(*scattered), settings, mask=mask)
        again = core.sharpen_geometry(mesh, settings, mask=mask)
        assert fresh.tobytes() == again.tobytes() != mesh.vertices.tobytes()


def test_reusing_a_mesh_for_corner_colors_changes_no_bit(box):
    mesh = core.TriangleMesh(*box)
    colors = np.where(box[0][box[1]] > 0.2, 0.9, 0.1)
    jumps = colors.copy()
    jumps[::2] = 0.5
    for values in (colors, jumps, colors):
        for time in (4.0, 64.0):
            settings = core.ShockSettings(time=time)
            fresh = core.sharpen_corner_signal(core.TriangleMesh(*box), values, settings)
            again = core.sharpen_corner_signal(mesh, values, settings)
            assert fresh.tobytes() == again.tobytes()


def test_geometry_flow_is_the_flow_that_sharpening_follows(box):
    mesh = core.TriangleMesh(*box)
    averages = np.zeros_like(mesh.vertices)
    for corner in range(3):
        np.add.at(averages, mesh.faces[:, corner], mesh.areas[:, None] * mesh.normals)
    weights = np.zeros(len(averages))
    np.add.at(weights, mesh.faces, np.repeat(mesh.areas[:, None], 3, axis=1))
    averages /= weights[:, None]
    plain = core.GeometrySettings(feature_threshold=0.0, smoothing_passes=2)
    potential, flow = core.geometry_flow(mesh, plain)
    expected = core.flow_field(mesh, averages, core.ShockSettings(smoothing_passes=2))
    np.testing.assert_allclose(potential, expected[0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(flow, expected[1], rtol=1e-9, atol=1e-9)
    above, _ = core.geometry_flow(mesh, replace(plain, feature_threshold=1.0))
    assert (above <= potential + 1e-12).all()
    assert above.sum() < 0.9 * potential.sum()


def test_geometry_flow_can_be_cancelled(box):
    with pytest.raises(core.Cancelled):
        core.geometry_flow(core.TriangleMesh(*box), progress=lambda *_: False)
