# SPDX-License-Identifier: GPL-3.0-or-later
"""Crisp low poly: few faces, as closed as before, near the design, along its creases."""

import numpy as np
import parts
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from shapes import cube, shuffled
from shock_filter import core


def of(low):
    return core.TriangleMesh(low.vertices, low.faces)


def error(mesh, distance, count=20000):
    """Mean angle to the normals of the design, in degrees, over points of the surface."""
    rng = np.random.default_rng(0)
    face = rng.choice(mesh.face_count, count, p=mesh.areas / mesh.areas.sum())
    shares = rng.dirichlet((1.0, 1.0, 1.0), count)[..., None]
    points = (shares * mesh.vertices[mesh.faces[face]]).sum(axis=1)
    steps = 1e-4 * np.eye(3)
    normals = np.stack([distance(points + s) - distance(points - s) for s in steps], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-12
    cosines = np.clip((normals * mesh.normals[face]).sum(axis=1), -1, 1)
    return float(np.degrees(np.arccos(cosines)).mean())


def test_remeshed_cubes_become_twelve_triangles():
    distance, _ = parts.box((0.8, 0.8, 0.8))
    corners = 0.8 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    counts = []
    for seed in (None, 0, 1, 2, 3, 4):
        turn = np.eye(3) if seed is None else Rotation.random(random_state=seed).as_matrix()
        mesh = parts.remeshed(distance, 56, turn)
        low = core.crisp_low_poly(mesh)
        counts.append(len(low.faces))
        assert (of(low).twins >= 0).all()
        away = cKDTree(low.vertices).query(corners)[0] / mesh.mean_edge_length
        assert away.max() < (0.5 if counts[-1] == 12 else 1.5)
        assert error(of(low), distance) < 1.0
    # Where a remesh has cut a corner by more than an edge, it may stay cut.
    assert counts[0] == 12
    assert max(counts) <= 24
    assert counts.count(12) >= 5


@pytest.mark.parametrize("turn", [parts.TURN, np.eye(3)], ids=["turned", "upright"])
@pytest.mark.parametrize("name", ["box", "bracket", "cog", "filleted"])
def test_parts_keep_their_shape_with_few_faces(name, turn):
    distance, _ = getattr(parts, name)()
    mesh = parts.remeshed(distance, 80, turn)
    sharp = mesh.moved_to(core.sharpen_geometry(mesh))
    low = core.crisp_low_poly(mesh)
    assert len(low.faces) < 0.02 * mesh.face_count
    assert error(of(low), distance) < error(sharp, distance) + 0.2
    assert (of(low).twins >= 0).all()
    assert not of(low).flipped.any()
    assert (of(low).areas > 0).all()
    away = cKDTree(sharp.vertices).query(low.vertices)[0]
    assert away.max() < 1.0 * mesh.mean_edge_length


def fins(p):
    """The distance to wavy fins of two voxels on a plate."""
    x, y, z = abs(p[..., 0]), abs(p[..., 1]), abs(p[..., 2])
    plate = np.maximum(abs(p[..., 2] + 0.6) - 0.15, np.maximum(x, y) - 0.8)
    across = (p[..., 0] + 0.15 * np.sin(3.0 * p[..., 1]) + 0.125) % 0.25 - 0.125
    walls = np.maximum(abs(across) - 0.02, np.maximum(z - 0.6, np.maximum(x, y) - 0.75))
    return np.minimum(plate, walls)


def test_no_face_spans_a_gap():
    mesh = parts.remeshed(fins, 48, np.eye(3))
    sharp = mesh.moved_to(core.sharpen_geometry(mesh))
    low = of(core.crisp_low_poly(mesh))
    rng = np.random.default_rng(0)

    def points(mesh, count):
        face = rng.choice(mesh.face_count, count, p=mesh.areas / mesh.areas.sum())
        shares = rng.dirichlet((1.0, 1.0, 1.0), count)[..., None]
        return (shares * mesh.vertices[mesh.faces[face]]).sum(axis=1)

    away = cKDTree(points(sharp, 200_000)).query(points(low, 20_000))[0]
    assert away.max() < 1.5 * mesh.mean_edge_length
    assert low.face_count < 0.06 * mesh.face_count


@pytest.mark.parametrize("tolerance", [0.05, 0.25])
def test_vertices_of_the_sharpened_mesh_stay_near_the_faces(tolerance):
    mesh = parts.remeshed(parts.filleted()[0], 48, np.eye(3))
    sharp = core.sharpen_geometry(mesh)
    low = core.crisp_low_poly(mesh, tolerance=tolerance, turn=60.0)
    rng = np.random.default_rng(0)
    shares = rng.dirichlet((1.0, 1.0, 1.0), 20000)[:, None, :, None]
    points = (shares * low.vertices[low.faces]).sum(axis=2).reshape(-1, 3)
    away = cKDTree(points).query(sharp)[0]
    assert away.max() < (2 * tolerance + 0.1) * mesh.mean_edge_length


def plate(rim, thickness, count):
    """A toothed plate as a design program exports it: planes cut into faces with long edges."""
    angle = 2 * np.pi * np.arange(count) / count
    radius = np.where(np.arange(count) % 4 < 2, rim, 0.9 * rim)
    outline = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    outline = np.vstack([outline, [0.0, 0.0]])
    sides = [np.column_stack([outline, np.full(count + 1, z)]) for z in (0.0, thickness)]
    a = np.arange(count)
    b, top = (a + 1) % count, count + 1
    faces = [[b, a, a * 0 + count], [a + top, b + top, a * 0 + count + top],
             [a, b, b + top], [a, b + top, a + top]]  # fmt: skip
    return core.TriangleMesh(np.vstack(sides), np.stack(faces).swapaxes(1, 2).reshape(-1, 3))


def volume(mesh):
    return np.linalg.det(mesh.vertices[mesh.faces]).sum() / 6


def test_thin_parts_of_design_programs_keep_their_walls():
    corners, faces = cube(1)
    beam = core.TriangleMesh(corners * (10.0, 1.0, 0.2), faces)
    low = core.crisp_low_poly(beam)
    assert len(low.faces) == 12
    np.testing.assert_allclose(low.vertices, beam.vertices[low.vertex_source], atol=1e-9)
    thin = plate(10.0, 0.2, 120)
    low = core.crisp_low_poly(thin)
    assert len(low.faces) < thin.face_count
    assert (of(low).twins >= 0).all()
    assert volume(of(low)) == pytest.approx(volume(thin), rel=0.05)
    coarse = core.crisp_low_poly(thin, tolerance=10.0, turn=60.0)
    assert len(coarse.faces) < len(low.faces)  # a large tolerance still counts


def test_sheets_that_touch_at_an_edge_come_apart():
    vertices, faces = cube(4)
    step = np.array([4.0, 4.0, 0.0])
    both = np.concatenate([vertices, vertices + step])
    _, first, same = np.unique(both.round(6), axis=0, return_index=True, return_inverse=True)
    joined = same.reshape(-1)[np.concatenate([faces, faces + len(vertices)])]
    mesh = core.TriangleMesh(both[first], joined)
    assert (mesh.twins < 0).any()
    low = core.crisp_low_poly(mesh)
    assert (of(low).twins >= 0).all()
    assert (len(low.vertices), len(low.faces)) == (16, 24)


def test_sources_lie_where_the_new_vertices_and_faces_are():
    mesh = parts.remeshed(parts.bracket()[0], 56)
    low = core.crisp_low_poly(mesh)
    far = np.linalg.norm(low.vertices - mesh.vertices[low.vertex_source], axis=1)
    assert far.max() < 3.0 * mesh.mean_edge_length
    normals = of(low).normals * mesh.normals[low.face_source]
    assert np.median(normals.sum(axis=1)) > 0.9
    given = mesh.faces[low.corner_source // 3, low.corner_source % 3]
    np.testing.assert_array_equal(given, low.vertex_source[low.faces])


def test_corner_sources_keep_to_their_side_of_a_seam():
    vertices, faces = cube(8)
    mesh = core.TriangleMesh(vertices, faces)
    side = np.abs(mesh.normals).argmax(axis=1) * np.sign(mesh.normals.sum(axis=1))
    side[side == 0] = 5 * np.sign(mesh.normals.sum(axis=1))[side == 0]
    low = core.crisp_low_poly(mesh)
    assert len(low.faces) == 12
    wanted = np.repeat(side[low.face_source][:, None], 3, axis=1)
    np.testing.assert_array_equal(side[low.corner_source // 3], wanted)


def test_kept_edges_stay():
    vertices, faces = cube(8)
    across = np.flatnonzero((vertices[:, 2] == 4) & (vertices[:, 0] == 0))
    across = across[np.argsort(vertices[across, 1])]
    keep = np.stack([across[:-1], across[1:]], axis=1)
    low = core.crisp_low_poly(core.TriangleMesh(vertices, faces), keep=keep)
    assert len(low.vertices) == 10
    for end in ((0, -4, 4), (0, 4, 4)):
        assert np.linalg.norm(low.vertices - end, axis=1).min() < 0.2


def test_borders_stay_and_flat_sheets_become_two_triangles():
    x, y = np.divmod(np.arange(81.0), 9)
    a = np.flatnonzero((x < 8) & (y < 8))
    faces = np.stack([[a, a + 9, a + 1], [a + 1, a + 9, a + 10]]).swapaxes(1, 2).reshape(-1, 3)
    low = core.crisp_low_poly(core.TriangleMesh(np.stack([x, y, 0 * x], axis=1), faces))
    assert (len(low.vertices), len(low.faces)) == (4, 2)
    assert of(low).areas.sum() * of(low).mean_edge_length ** 2 == pytest.approx(64.0)


def test_winding_is_that_of_the_faces_given():
    vertices, faces = cube(6)
    for given, sign in ((faces, 1), (faces[:, ::-1], -1)):
        low = core.crisp_low_poly(core.TriangleMesh(vertices, given))
        a, b, c = low.vertices[low.faces].swapaxes(0, 1)
        assert (np.cross(a, b) * c).sum() / 6.0 == pytest.approx(sign * 6.0**3)


def test_the_order_of_vertices_and_faces_does_not_matter_much_and_runs_are_equal():
    mesh = parts.remeshed(parts.bracket()[0], 48)
    vertices, faces, _, _ = shuffled(mesh.vertices, mesh.faces)
    first, again = core.crisp_low_poly(mesh), core.crisp_low_poly(mesh)
    np.testing.assert_array_equal(first.vertices, again.vertices)
    np.testing.assert_array_equal(first.faces, again.faces)
    other = core.crisp_low_poly(core.TriangleMesh(vertices, faces))
    assert abs(len(other.faces) - len(first.faces)) < 0.15 * len(first.faces)


def test_wrong_dials_are_named():
    mesh = core.TriangleMesh(*cube(2))
    for name, value in (("tolerance", 0.0), ("turn", 90.0), ("angle", 1.0)):
        with pytest.raises(core.InvalidSettings, match=name):
            core.crisp_low_poly(mesh, **{name: value})
