# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of curvature at vertices and in textures, against surfaces whose curvature is known."""

from pathlib import Path

import numpy as np
import pytest
from shapes import cube, icosphere, rotation
from shock_filter import core
from shock_filter.core.errors import ShockError
from shock_filter.core.files.fields import field_pixels
from surface_patches import SURFACES, laid_out, patch

KINDS = ["regular", "random", "stretched"]
SIZES = {"regular": 60, "random": 64, "stretched": 24}


def within(square, margin=0.15):
    return ((square > margin) & (square < 1 - margin)).all(axis=-1)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SURFACES)
def test_curvatures_of_known_surfaces(name, kind):
    mesh, square = patch(SURFACES[name], kind, SIZES[kind])
    points = np.zeros((mesh.vertex_count, 2))
    points[mesh.faces] = square
    known, found = SURFACES[name](points), core.curvature(mesh)
    inside = within(points)
    for one, other in ((found.mean, known.mean), (found.gaussian, known.gaussian)):
        # Of what is constant, the part is that of its value, or of the mean curvature's square.
        scale = max(np.ptp(other), np.abs(other).max()) or known.mean.max() ** 2
        assert np.abs(one - other)[inside].max() < 0.03 * scale


@pytest.mark.parametrize("kind", KINDS)
def test_the_error_falls_at_least_with_the_power_three_halves(kind):
    errors = []
    for n in (12, 24, 48):
        mesh, square = patch(SURFACES["torus"], kind, n)
        points = np.zeros((mesh.vertex_count, 2))
        points[mesh.faces] = square
        error = core.curvature(mesh).mean - SURFACES["torus"](points).mean
        errors.append(np.abs(error[within(points, 0.25)]).max())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert orders.mean() > 1.5


@pytest.mark.parametrize("layout", ["whole", "quarters", "faces"])
@pytest.mark.parametrize("kind", KINDS)
def test_maps_show_neither_triangles_nor_seams(kind, layout):
    name = "torus"
    is_thin = layout == "faces" and kind == "stretched"
    mesh, square = patch(SURFACES[name], kind, 16 if is_thin else SIZES[kind])
    uv, size = laid_out(mesh, square, layout, 1600 if is_thin else 384)
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    image = core.curvature_map(mesh, uv, size=(size, size), atlas=atlas)
    places = atlas.bake(square)
    known = SURFACES[name](places.reshape(-1, 2)).mean.reshape(size, size)
    inside = atlas.inside & within(places)
    assert np.ptp(known[inside]) > 1
    assert np.abs(image - known)[inside].max() < 0.03 * np.ptp(known[inside])


def test_directions_run_round_a_cylinder_and_vanish_on_a_sphere():
    mesh, square = patch(SURFACES["cylinder"], "random", 30)
    uv, size = laid_out(mesh, square, "quarters", 128)
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    vectors = core.curvature_directions(mesh, uv, size=(size, size), atlas=atlas)
    angle = 2 * atlas.bake(square)[..., 0] - 1
    around = np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], axis=-1)
    inside = atlas.inside & within(atlas.bake(square))
    assert np.abs((vectors * around).sum(axis=-1))[inside].min() > 0.98
    ball, square = patch(SURFACES["sphere"], "random", 30)
    uv, size = laid_out(ball, square, "whole", 64)
    vectors = core.curvature_directions(ball, uv, size=(size, size))
    assert np.linalg.norm(vectors[16:48, 16:48], axis=-1).max() < 0.05
    found = core.curvature(mesh).directions
    assert np.allclose(np.linalg.norm(found, axis=2), 1)
    assert np.abs((found[:, 0] * found[:, 1]).sum(axis=1)).max() < 1e-6


def test_faces_of_a_cube_are_flat_up_to_its_edges():
    mesh = core.TriangleMesh(*cube(10))
    away = np.sort(np.abs(mesh.vertices), axis=1)
    beside = away[:, 1] < away[:, 2] - 1e-9  # on no edge
    found = core.curvature(mesh).principal
    assert np.abs(found[beside]).max() < 0.05 * found.max()
    edge = (away[:, 0] < 0.6 * away[:, 2]) & ~beside
    assert found[edge, 1].min() > 0.5 / mesh.mean_edge_length / 2.5
    assert np.abs(found[edge, 0]).max() < 0.1 * found[edge, 1].max()


def test_scale_turn_and_winding():
    vertices, faces = icosphere(3)
    vertices = vertices * [1.0, 0.8, 1.3]
    found = core.curvature(core.TriangleMesh(vertices, faces))
    turned = core.curvature(core.TriangleMesh(3 * vertices @ rotation() + 5, faces))
    assert np.allclose(3 * turned.principal, found.principal, rtol=1e-4, atol=1e-6)
    flipped = core.curvature(core.TriangleMesh(vertices, faces[:, ::-1]))
    assert np.allclose(-flipped.principal[:, ::-1], found.principal, atol=1e-4)


def test_a_larger_radius_evens_out_noise():
    vertices, faces = icosphere(4)
    noisy = vertices + np.random.default_rng(0).normal(size=vertices.shape) * 1e-3
    mesh = core.TriangleMesh(noisy, faces)
    spread = [core.curvature(mesh, radius=radius).mean.std() for radius in (0.0, 0.4)]
    assert spread[1] < 0.2 * spread[0]
    assert abs(core.curvature(mesh, radius=0.4).mean.mean() - 1) < 0.04


def test_grays_and_sides():
    mesh, square = patch(SURFACES["saddle"], "regular", 24)
    uv, size = laid_out(mesh, square, "whole", 96)
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))

    def drawn(**given):
        settings = core.CurvatureSettings(gutter=1, **given)
        return core.curvature_map(mesh, uv, settings, size=(size, size), atlas=atlas)

    mean, gray = drawn(), drawn(look="gray", white=4.0)
    inside = atlas.inside
    assert np.allclose(gray[inside], np.clip(0.5 + mean[inside] / 8, 0, 1), atol=1e-6)
    assert not gray[0, 0] and not mean[0, 0]
    wide = core.CurvatureSettings(look="gray", white=4.0)
    beside = core.curvature_map(mesh, uv, wide, size=(size, size), atlas=atlas)[2, 40]
    assert beside == pytest.approx(gray[6, 40], abs=0.05)  # the gutter goes on in gray
    convex, cavity = drawn(kind="convex"), drawn(kind="cavity")
    assert convex.min() >= 0 and cavity.min() >= 0
    assert np.allclose((convex - cavity)[inside], 2 * mean[inside], atol=0.02)
    white = drawn(look="gray", kind="convex")[inside]
    assert 0.01 < (white > 0.999).mean() < 0.03


def test_planes_loose_vertices_and_bad_radii():
    vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [7, 7, 7]]
    mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    assert np.allclose(core.curvature(mesh).principal, 0)
    uv = mesh.vertices[mesh.faces][..., :2]
    settings = core.CurvatureSettings(look="gray")
    assert np.allclose(core.curvature_map(mesh, uv, settings, size=(8, 8)), 0.5)
    for radius in (-1, np.nan, np.inf, "far", True):
        with pytest.raises(core.InvalidSettings, match="radius"):
            core.curvature(mesh, radius=radius)
    with pytest.raises(core.Cancelled):
        core.curvature(mesh, progress=lambda *_: False)
    with pytest.raises(core.Cancelled):
        core.curvature_map(mesh, uv, size=(8, 8), progress=lambda *_: False)


def test_the_smallest_white_gives_numbers():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    settings = core.CurvatureSettings(look="gray", white=1e-46)
    mesh, uv = core.TriangleMesh(square, faces), square[faces][..., :2]
    assert np.isfinite(core.curvature_map(mesh, uv, settings, size=(8, 8))).all()


def test_pictures_refuse_negative_values_of_meshes_in_small_units():
    inside = np.array([[True, True, False]])
    values = np.array([[-0.004, 0.5, -9.0]], np.float32)
    with pytest.raises(ShockError, match=r"reach from -0\.004 to 0\.5, and \.png files"):
        field_pixels(values, inside, Path("a.png"), np.uint8)
    values[0, 0] = -0.001  # rounded to 0
    assert field_pixels(values, inside, Path("a.png"), np.uint8).tolist() == [[0, 128, 0]]
    assert field_pixels(values, inside, Path("a.tif"), np.uint8) is values
