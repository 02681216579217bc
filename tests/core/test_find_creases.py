# SPDX-License-Identifier: GPL-3.0-or-later
"""Creases as lines: against those of the design, along cuts, over rotation and order."""

import numpy as np
import parts
import pytest
from scipy.spatial import cKDTree
from shapes import cube, grid, icosphere, rotation, shuffled
from shock_filter import core
from shock_filter.core.mesh import order
from shock_filter.core.mesh.calculus import smooth_vertices
from shock_filter.core.mesh.edges import half_edges_between
from shock_filter.core.shape import low_poly
from shock_filter.core.shape.crease_lines import closing_creases

CRISP = "closes", "sharp"
MADE = {"box": parts.box, "bracket": parts.bracket, "cog": parts.cog, "fillets": parts.filleted}


def crisp(lines):
    return [line for line in lines if line.state in CRISP]


def edges(lines):
    return np.concatenate([np.zeros((0, 2), dtype=int), *(line.edges for line in lines)])


def points_on(mesh, lines):
    begin, end = mesh.vertices[edges(lines).T]
    return (begin[:, None] + np.linspace(0, 1, 5)[:, None] * (end - begin)[:, None]).reshape(-1, 3)


def loose_ends(lines):
    return int((np.bincount(edges(lines).reshape(-1)) == 1).sum())


def shares(mesh, lines, creases, reach=1.5):
    """Precision and recall: what of the lines lies at creases, and what of these at the lines."""
    found, reach = points_on(mesh, lines), reach * mesh.mean_edge_length
    precision = (cKDTree(creases).query(found)[0] < reach).mean()
    return precision, (cKDTree(found).query(creases)[0] < reach).mean()


@pytest.mark.parametrize("turn", [parts.TURN, np.eye(3)], ids=["turned", "upright"])
@pytest.mark.parametrize("name", MADE)
def test_lines_lie_at_the_creases_of_the_design_and_only_there(name, turn):
    distance, creases = MADE[name]()
    mesh = parts.remeshed(distance, 72, turn)
    lines = crisp(core.find_creases(mesh))
    precision, recall = shares(mesh, lines, creases)
    assert precision > 0.95
    assert recall > 0.95
    assert loose_ends(lines) <= 6


@pytest.mark.parametrize("name", ["box", "bracket", "cog"])
def test_the_result_of_sharpening_has_the_same_lines_and_they_are_sharp(name):
    distance, creases = MADE[name]()
    mesh = parts.remeshed(distance, 56)
    sharp = mesh.moved_to(core.sharpen_geometry(mesh))
    lines = crisp(core.find_creases(sharp))
    precision, recall = shares(sharp, lines, creases, reach=0.75)
    assert precision > 0.95
    assert recall > 0.95
    count = sum(len(line.edges) for line in lines)
    already = [line for line in lines if line.state == "sharp"]
    assert sum(len(line.edges) for line in already) > 0.75 * count
    assert np.median([line.strength for line in already]) == pytest.approx(90, abs=2)


def test_lines_of_a_turned_tower_hardly_end_anywhere():
    mesh = parts.remeshed(parts.rook(), 64)
    lines = crisp(core.find_creases(mesh))
    assert sum(len(line.edges) for line in lines) > 600
    assert loose_ends(lines) <= 10


def test_a_box_has_lines_that_say_what_they_are():
    mesh = parts.remeshed(parts.box()[0], 48)
    lines = [line for line in core.find_creases(mesh) if len(line.vertices) > 12]
    assert 12 <= len(lines) <= 13  # a strip along an edge that nearly lies in the grid parts it
    for line in lines:
        assert line.state == "closes"
        assert line.is_convex
        assert not line.is_loop
        assert line.strength == pytest.approx(90, abs=12)
        assert 0.0 <= line.width < 1.5
        assert line.sureness > 0.85


def test_rims_of_holes_are_loops_and_inner_corners_are_concave():
    distance, _ = parts.bracket()
    lines = crisp(core.find_creases(parts.remeshed(distance, 56)))
    assert sum(line.is_loop for line in lines) >= 1
    concave = sum(len(line.edges) for line in lines if not line.is_convex)
    assert 0.05 < concave / len(edges(lines)) < 0.2


def test_sharp_creases_beside_soft_ones_are_found_too():
    vertices, faces = cube(20)
    mesh = core.TriangleMesh(vertices, faces)
    soft = smooth_vertices(mesh, mesh.vertices, 3)
    right = vertices[:, 0] > vertices[:, 0].mean()
    half = mesh.moved_to(np.where(right[:, None], soft, vertices))
    lines = crisp(core.find_creases(half))
    assert {line.state for line in lines} == {"closes", "sharp"}
    on_cube = (np.abs(vertices - vertices.mean(axis=0)) == 10).sum(axis=1) >= 2
    found = np.unique(edges(lines))
    assert np.isin(np.flatnonzero(on_cube), found).mean() > 0.93
    assert on_cube[found].mean() > 0.9


def test_a_wider_fillet_closes_when_it_may_and_else_says_that_it_is_one():
    distance, _ = parts.filleted(0.14)
    mesh = parts.remeshed(distance, 64)
    narrow = core.find_creases(mesh, core.GeometrySettings(widest_fillet=1.0))
    wide = core.find_creases(mesh, core.GeometrySettings(widest_fillet=4.0))
    fillets = [line for line in narrow if line.state == "fillet"]
    assert fillets
    assert all(line.width > 1.0 for line in fillets)
    assert not [line for line in wide if line.state == "fillet"]
    assert len(edges(crisp(wide))) > len(edges(crisp(narrow)))


def test_crisp_meshes_of_few_faces_have_all_their_creases():
    lines = core.find_creases(core.TriangleMesh(*cube(4)))
    assert len(lines) == 12
    assert len(edges(lines)) == 48
    assert {line.state for line in lines} == {"sharp"}


@pytest.mark.parametrize("height", [2.0, 1.0, 0.1])
def test_thin_plates_have_the_creases_of_both_sides(height):
    vertices, faces = cube(1)
    plate = core.TriangleMesh(vertices * (10.0, 10.0, height), faces)
    lines = core.find_creases(plate)
    assert len(lines) == 12
    assert {line.state for line in lines} == {"sharp"}
    assert [round(line.strength) for line in lines] == [90] * 12


def test_rims_of_thin_rings_are_all_found():
    # As design programs export it: two faces for each step around, on each of the four sides.
    height = 0.05
    around, steps = np.linspace(0, 2 * np.pi, 97)[:-1], np.arange(96)
    corners = [(5.0, 0.0), (5.0, height), (3.0, height), (3.0, 0.0)]
    circle = np.stack([np.cos(around), np.sin(around)], axis=1)
    vertices = np.concatenate([np.c_[r * circle, np.full(96, z)] for r, z in corners])
    faces = []
    for side in range(4):
        a, b = 96 * side + steps, 96 * ((side + 1) % 4) + steps
        c, d = 96 * side + (steps + 1) % 96, 96 * ((side + 1) % 4) + (steps + 1) % 96
        faces += [np.stack([a, c, d], axis=1), np.stack([a, d, b], axis=1)]
    lines = core.find_creases(core.TriangleMesh(vertices, np.concatenate(faces)))
    assert [len(line.edges) for line in lines] == [96] * 4
    assert all(line.is_loop and line.is_convex for line in lines)


def test_round_shapes_have_none():
    assert core.find_creases(core.TriangleMesh(*icosphere(4))) == []


def test_turning_and_scaling_change_no_line():
    mesh = parts.remeshed(parts.bracket()[0], 48)
    turned = core.TriangleMesh(7.0 * mesh.vertices @ rotation(3).T, mesh.faces)
    here, there = (edges(core.find_creases(m)) for m in (mesh, turned))
    pairs = [{tuple(sorted(pair)) for pair in each.tolist()} for each in (here, there)]
    assert len(pairs[0] ^ pairs[1]) <= 0.02 * len(pairs[0])


def test_the_order_of_vertices_and_faces_changes_hardly_a_line():
    mesh = parts.remeshed(parts.bracket()[0], 48)
    vertices, faces, places, _ = shuffled(mesh.vertices, mesh.faces)
    here = places[edges(core.find_creases(mesh))]
    there = edges(core.find_creases(core.TriangleMesh(vertices, faces)))
    pairs = [{tuple(sorted(pair)) for pair in each.tolist()} for each in (here, there)]
    assert len(pairs[0] ^ pairs[1]) <= 0.02 * len(pairs[0])


def test_large_meshes_in_random_order_give_their_own_vertices(monkeypatch):
    monkeypatch.setattr(order, "_SMALL", 10_000)
    mesh = parts.remeshed(parts.box()[0], 72)
    vertices, faces, _, _ = shuffled(mesh.vertices, mesh.faces)
    there = core.TriangleMesh(vertices, faces)
    assert order.is_scattered(there)
    _, creases = parts.box()
    assert min(shares(there, crisp(core.find_creases(there)), creases)) > 0.995


def test_higher_angles_leave_weaker_creases_out():
    mesh = parts.remeshed(parts.box()[0], 48)
    assert crisp(core.find_creases(mesh, angle=60))
    assert not crisp(core.find_creases(mesh, angle=120))
    with pytest.raises(core.InvalidSettings, match="5 to 170"):
        core.find_creases(mesh, angle=0)


@pytest.mark.parametrize("in_order", [True, False])
def test_those_that_close_are_found_alone(in_order):
    mesh = parts.remeshed(parts.filleted()[0], 72)
    if not in_order:
        mesh = core.TriangleMesh(*shuffled(mesh.vertices, mesh.faces)[:2])
    lines = core.find_creases(mesh, angle=10.0)
    alone = closing_creases(mesh, core.GeometrySettings(), 10.0)
    wanted = [line.vertices.tolist() for line in crisp(lines)]
    assert 0 < len(wanted) < len(lines)
    assert [line.vertices.tolist() for line in alone] == wanted


def test_edges_of_large_meshes_are_found():
    # From 46,341 vertices on, the product of two of their numbers needs more than 32 bits.
    vertices, faces = grid(219, 219)
    mesh = core.TriangleMesh(vertices, faces)
    assert mesh.vertex_count > 46341
    rng = np.random.default_rng(0)
    half = rng.random(faces.shape) < 0.3
    begin, end = (mesh.faces[:, k][half] for k in ((0, 1, 2), (1, 2, 0)))
    pairs = np.concatenate([np.stack([end, begin], axis=1), [[0, 48000]]]).astype(np.int64)
    wanted = half.copy()
    twins = mesh.twins[half]
    wanted.reshape(-1)[twins[twins >= 0]] = True
    found, joined = half_edges_between(mesh, pairs)
    assert (found == wanted).all()
    assert joined[:-1].all() and not joined[-1]


def test_held_edges_of_large_meshes_are_counted():
    faces = np.array([[99999, 99998, 5], [5, 99998, 60000]], dtype=np.int32)
    held = np.array([[True, False, True], [False, True, False]])
    degrees = low_poly._lines_at(faces, held, 100000)
    assert np.flatnonzero(degrees).tolist() == [5, 60000, 99998, 99999]
    assert degrees[[5, 60000, 99998, 99999]].tolist() == [1, 1, 2, 2]
