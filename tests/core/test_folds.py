# SPDX-License-Identifier: GPL-3.0-or-later
"""Folds that a refit makes are repaired, and what cannot be fitted goes back."""

import crease_examples
import numpy as np
import pytest
from parts import remeshed
from remeshed import turned_box
from shapes import cube, grid
from shock_filter import core
from shock_filter.core.base.findings import gathering
from shock_filter.core.shape.folds import FoldChecks, mended, undone
from shock_filter.core.shape.results import tell_lost, without_drift, without_worse


def folded(mesh, moved, degrees=150.0):
    """Half-edges across which faces are folded."""
    after = mesh.moved_to(mesh.vertices + moved)
    twins = mesh.twins.reshape(-1)
    pairs = np.stack([np.arange(len(twins)), twins], axis=1)[twins >= 0] // 3
    cosines = (after.normals[pairs[:, 0]] * after.normals[pairs[:, 1]]).sum(axis=1)
    return int((cosines < np.cos(np.radians(degrees))).sum())


@pytest.fixture(scope="module")
def box():
    return core.TriangleMesh(*turned_box(24)[:2])


def shaken(mesh, size, seed=0):
    """A displacement that folds a few places."""
    rng = np.random.default_rng(seed)
    moved = np.zeros(mesh.vertices.shape)
    chosen = rng.choice(mesh.vertex_count, 12, replace=False)
    moved[chosen] = rng.normal(size=(12, 3)) * size * mesh.mean_edge_length
    return moved


@pytest.mark.parametrize("repair", [lambda m, x: mended(m, m.normals, x, None),
                                    lambda m, x: undone(m, m.normals, x.copy())])  # fmt: skip
@pytest.mark.parametrize("seed", range(4))
def test_no_fold_is_left(box, repair, seed):
    moved = shaken(box, 1.2, seed)
    assert folded(box, moved) > 0
    assert folded(box, repair(box, moved)) == 0


def test_what_is_not_folded_keeps_every_bit(box):
    moved = shaken(box, 0.05)
    assert mended(box, box.normals, moved, None) is moved
    far = shaken(box, 1.2)
    assert np.array_equal(undone(box, box.normals, far.copy())[far.any(axis=1) == 0] != 0,
                          np.zeros((box.vertex_count - 12, 3), dtype=bool))  # fmt: skip


def test_vertices_that_are_held_do_not_move(box):
    moved = shaken(box, 1.2)
    fixed = ~moved.any(axis=1)
    out = mended(box, box.normals, moved, fixed)
    assert (out[fixed] == 0).all()
    assert folded(box, out) == 0


def test_a_fold_that_was_there_may_stay():
    vertices, faces = grid(12, 12)
    vertices[:, 2] = 0.0
    vertices[78] += [1.6, 0.0, 0.0]  # beyond its neighbour
    mesh = core.TriangleMesh(vertices, faces)
    still = np.zeros(vertices.shape)
    assert folded(mesh, still) > 0
    assert len(FoldChecks(mesh, mesh.normals).bad_faces(still, np.arange(mesh.face_count))) == 0


def test_three_faces_at_an_edge_are_compared_in_any_order():
    vertices = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0.5], [-1, 0.1, 0.5], [-1, -0.1, 0.5]])
    faces = np.array([[0, 1, 2], [1, 0, 3], [1, 0, 4]])
    moved = np.zeros(vertices.shape)
    moved[2] = [-1.9, 0.02, 0.0]
    found = []
    for order in ([0, 1, 2], [2, 0, 1], [1, 2, 0]):
        mesh = core.TriangleMesh(vertices, faces[order])
        bad = FoldChecks(mesh, mesh.normals).bad_faces(moved, np.arange(3))
        found.append(sorted(np.array(order)[bad].tolist()))
    assert found[0] == found[1] == found[2]


def test_places_that_do_not_come_nearer_go_back_and_are_told():
    mesh = core.TriangleMesh(*cube(24))
    x, _, z = (mesh.vertices - mesh.vertices.mean(axis=0)).T
    targets = mesh.normals.copy()
    top = mesh.normals[:, 2] > 0.9
    targets[top] = [0.6, 0.0, 0.8]  # what no move below gives
    moved = np.zeros(mesh.vertices.shape)
    rng = np.random.default_rng(0)
    moved[:, 2] = np.where((z > 11.9) & (abs(x) < 6), 0.3 * rng.normal(size=len(x)), 0.0)
    kept, lost = without_worse(mesh, targets, moved)
    assert abs(kept).max() < 0.1 * abs(moved).max()
    with gathering() as found:
        tell_lost(mesh, lost)
    assert [str(f) for f in found] == ["Places that stay, as no faces of this size fit them"
                                       " better: 1."]  # fmt: skip


def test_what_comes_nearer_keeps_every_bit(box):
    targets = core.sharpen_normals(box)
    moved = core.sharpen_geometry(box) - box.vertices
    kept, lost = without_worse(box, targets, moved)
    near = np.linalg.norm(kept - moved, axis=1) <= 1e-12
    assert near.mean() > 0.9
    assert lost.max() < 0.3


def lost_on_a_plate(thickness):
    plate, faces = grid(14, 14)
    plate[:, 2] = 0.0
    low = plate - [0.0, 0.0, thickness]
    mesh = core.TriangleMesh(
        np.concatenate([plate, low]), np.concatenate([faces, faces[:, ::-1] + len(plate)])
    )
    lost = np.zeros(mesh.vertex_count)
    lost[[90, 91, 20]] = 0.5
    with gathering() as found:
        tell_lost(mesh, lost)
    return found


def test_no_size_is_told_where_two_sides_touch():
    assert [str(each) for each in lost_on_a_plate(1e-8)] == [
        "Places that stay, as no faces of this size fit them better: 2."
    ]


def test_thin_places_are_told_with_the_size_that_would_do():
    found = lost_on_a_plate(1.2)
    assert str(found[0]).startswith("Places that are thinner than 2 edges and stay: 2. Remesh")
    assert 0.2 < found[0].values["size"] < 0.5


def test_faces_that_lose_their_area_get_it_back(box):
    # A vertex in the middle of an edge's line: no fold yet, but any rounding would make one.
    moved = np.zeros(box.vertices.shape)
    f = int(np.argmax(box.areas))
    a, b, c = box.faces[f]
    moved[a] = 0.5 * (box.vertices[b] + box.vertices[c]) - box.vertices[a]
    checks = FoldChecks(box, box.normals)
    assert f in checks.bad_faces(moved, np.arange(box.face_count))
    after = box.moved_to(box.vertices + mended(box, box.normals, moved, None))
    assert after.areas[f] > 0.02 * box.areas[f]


def test_thin_walls_have_no_new_folds_at_faces_that_lose_most_of_their_area():
    mesh = crease_examples.remeshed(50_000_002, cells=(30, 125)).mesh
    moved = core.sharpen_geometry(mesh) - mesh.vertices
    assert folded(mesh, np.zeros(moved.shape)) == 0
    assert moved.any()
    assert folded(mesh, moved) == 0


@pytest.mark.parametrize("seed", [3, 5])
def test_little_more_of_a_move_mends_little_more(box, seed):
    # The repair grows with the fold: no step where an angle passes a bound.
    moved = shaken(box, 1.0, seed)
    sizes = np.linspace(0.0, 0.6, 1201)
    ends = np.array([mended(box, box.normals, size * moved, None) for size in sizes])
    steps = np.linalg.norm(np.diff(ends, axis=0), axis=2).max(axis=1) / box.mean_edge_length
    assert steps.max() < 0.1


STEP = 3.0 / 47


def volume(mesh, places):
    a, b, c = np.moveaxis(places[mesh.faces], 1, 0)
    return abs((a * np.cross(b, c)).sum() / 6)


def plate(p):
    return (abs(p) - [0.9, 0.7, 0.65 * STEP]).max(axis=1)


def shell(p):
    return np.maximum(abs(np.linalg.norm(p, axis=1) - 0.95) - 0.65 * STEP, p[:, 2] - 0.4)


def strut(p):
    return np.maximum(np.hypot(p[:, 0], p[:, 1]) - STEP, abs(p[:, 2]) - 1.1)


@pytest.mark.parametrize("solid", [plate, shell, strut])
def test_thin_walls_and_struts_keep_their_volume(solid):
    mesh = remeshed(solid, 48)
    sharp = core.sharpen_geometry(mesh)
    assert volume(mesh, sharp) > 0.88 * volume(mesh, mesh.vertices)


def test_narrow_gaps_stay_open():
    gap = lambda p: -plate(p)  # noqa: E731
    mesh = remeshed(lambda p: np.maximum((abs(p) - [1.2, 1.0, 0.4]).max(axis=1), gap(p)), 48)
    inside = (abs(mesh.vertices @ np.eye(3)) < [1.0, 0.8, 2 * STEP]).all(axis=1)
    chosen = inside[mesh.faces].all(axis=1)
    assert chosen.sum() > 500
    hollow = core.TriangleMesh(mesh.vertices, mesh.faces[chosen])
    sharp = core.sharpen_geometry(mesh)
    assert volume(hollow, sharp) > 0.88 * volume(hollow, mesh.vertices)


def test_closing_creases_are_no_drift(box):
    moved = core.sharpen_geometry(box) - box.vertices
    assert np.array_equal(without_drift(box, moved), moved)
