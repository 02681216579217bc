# SPDX-License-Identifier: GPL-3.0-or-later
"""What random input has found, in the smallest form."""

import numpy as np
import pytest
from checks import Watch
from shapes import grid
from shock_filter import core
from shock_filter.core.registry import find
from shock_filter.core.shape import denoising as meshes
from shock_filter.core.shape.denoising import beltrami_joint_corners
from shock_filter.core.then_sharpen import sharpen_both, then_sharpen


@pytest.fixture
def wings():
    """Three faces at an edge and their colors, of which the third differs there."""
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0.5, 0, 1]]
    mesh = core.TriangleMesh(np.array(vertices, float), [[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    colors = np.arange(5.0)[mesh.faces]
    colors[2, :2] = 7.0
    return mesh, colors


@pytest.mark.parametrize(
    "filtered",
    [
        lambda mesh, colors: core.sharpen_corner_signal(
            mesh, colors, core.ShockSettings(time=1e-9)
        ),
        lambda mesh, colors: core.beltrami_corner_signal(
            mesh, colors, core.BeltramiMeshSettings(time=1e-9)
        ),
        lambda mesh, colors: beltrami_joint_corners(
            mesh, colors, core.BeltramiMeshSettings(time=1e-9)
        )[1],
    ],
)
def test_corners_keep_their_places_where_cutting_turns_a_face(wings, filtered):
    mesh, colors = wings
    assert not mesh.flipped.any()  # all at an edge of three faces, which is a border
    assert np.allclose(filtered(mesh, colors), colors, atol=0.01)  # read near the corners


def test_a_joint_time_of_zero_keeps_the_sign_of_zero(wings):
    mesh, colors = wings
    colors[0, 0] = -0.0
    _, result = beltrami_joint_corners(mesh, colors, core.BeltramiMeshSettings(time=0.0))
    assert result.tobytes() == colors.tobytes()


def test_values_whose_squares_overflow_are_refused(wings):
    mesh, _ = wings
    for function in (core.sharpen_vertex_signal, core.beltrami_vertex_signal, core.flow_field):
        with pytest.raises(core.InvalidSignal, match="beyond 1e\\+30"):
            function(mesh, np.full(5, -1e31))


def test_ragged_lists_are_refused(wings):
    mesh, _ = wings
    ragged = [[1.0], [1.0, 2.0]]
    image = np.zeros((2, 2))
    for function in (
        lambda: core.sharpen_vertex_signal(mesh, ragged),
        lambda: core.sharpen_image(ragged),
        lambda: core.sharpen_image(image, mask=ragged),
        lambda: core.beltrami_manifold(image, ragged),
        lambda: core.osher_rudin_image(ragged, steps=1),
    ):
        with pytest.raises(core.InvalidSignal, match="not made of numbers"):
            function()


def test_opacity_beyond_one_does_not_overflow():
    image = np.full((4, 4, 4), 1e38, np.float32)
    result = core.beltrami_image(image, core.BeltramiSettings(beta=1.0))
    assert (result == image).all()


def test_a_tiny_time_changes_nothing():
    image = np.random.default_rng(0).random((5, 5, 3))
    result = core.beltrami_image(image, core.BeltramiSettings(time=1e-300))
    assert np.allclose(result, image)


@pytest.mark.parametrize("function", [core.sharpen_image, core.beltrami_image])
def test_a_mask_keeps_the_sign_of_zero(function):
    image = np.full((3, 3, 2), -0.0)
    result = function(image, mask=np.full((3, 3), 0.5))
    assert result.tobytes() == image.tobytes()


def test_a_mesh_that_denoising_draws_to_a_point_is_not_sharpened(wings):
    mesh, colors = wings
    long = {"time": 1e6, "iterations": 9}
    settings = core.BeltramiGeometrySettings(method="beltrami", filtered="positions", **long)
    positions = find("denoise_geometry").function(16.0)(mesh, settings=settings)
    assert np.ptp(positions, axis=0).max() < 1e-6
    joint = core.BeltramiMeshSettings(beta=0.0, **long)
    both = then_sharpen(beltrami_joint_corners, sharpen_both, core.ShockSettings(time=16.0))
    positions, result = both(mesh, np.full_like(colors, 0.5), settings=joint)
    assert np.ptp(positions, axis=0).max() < 1e-6
    assert (result == 0.5).all()


def test_a_mesh_that_denoising_draws_to_a_line_is_not_sharpened(wings, monkeypatch):
    mesh, colors = wings
    line = mesh.vertices * (1.0, 0.0, 0.0)
    original = meshes.moved_vertices
    monkeypatch.setattr(
        meshes,
        "moved_vertices",
        lambda given, moved: line if given is mesh else original(given, moved),
    )
    both = then_sharpen(beltrami_joint_corners, sharpen_both, core.ShockSettings(time=16.0))
    positions, _ = both(mesh, colors)
    assert (positions == line).all()


@pytest.mark.parametrize("radius", [5.0, 1e6])
def test_own_normals_leave_needles_in_place(radius):
    random = np.random.default_rng(0)
    vertices = random.normal(size=(30, 3)) * [1e-5, 1.0, 1e5]
    mesh = core.TriangleMesh(vertices, random.integers(0, 30, size=(40, 3)))
    own = np.where(mesh.flipped[:, None], -mesh.normals, mesh.normals)
    fitted = core.fit_to_normals(mesh, own, core.FitSettings(screening_radius=radius))
    np.testing.assert_array_equal(fitted, mesh.vertices)


def test_a_mesh_does_not_mix_up_signs_of_zero():
    mesh = core.TriangleMesh(np.eye(3), [[0, 1, 2]])
    for signal in (np.zeros((1, 3)), -np.zeros((1, 3))):
        result = core.sharpen_corner_signal(mesh, signal, core.ShockSettings(time=1.0))
        np.testing.assert_array_equal(np.signbit(result), np.signbit(signal))


def test_progress_does_not_fall_where_a_mesh_has_several_chunks():
    mesh = core.TriangleMesh(*grid(50, 50, jitter=0.3))
    watch = Watch()
    settings = core.BeltramiMeshSettings(time=0.1)
    beltrami_joint_corners(mesh, np.zeros((mesh.face_count, 3)), settings, progress=watch)
    assert watch.seen[-1] == 1.0
