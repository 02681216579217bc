# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening of creases only: parts out of a remesh, and what must stay as it is."""

import re

import numpy as np
import pytest
from remeshed import surface_net, turned_box
from shapes import cube, fan, grid, icosphere
from shock_filter import core
from shock_filter.core.base import parallel
from shock_filter.core.base.findings import gathering
from shock_filter.core.mesh.calculus import gradient, smooth_vertices
from shock_filter.core.mixture.network import load
from shock_filter.core.shape.candidates import DEFINITION, TOLD, TOLD_FIRST
from shock_filter.core.shape.creases import WEIGHTS, find_targets
from shock_filter.core.shape.fit import displacement
from shock_filter.core.shape.sides import consistent_normals

PAPER = core.GeometrySettings.of_paper()
PULL = 0.3

EXPECTED = [
    [-0.0138101, -0.0270497, -0.2780186],
    [0.0332673, 0.0113281, -0.0181381],
    [0.0088333, -0.0495664, -0.0309033],
    [0.0027377, 0.0316797, 0.0256709],
    [-0.0414173, -0.0149073, -0.0158949],
]


def angles_to(normals, areas, axes):
    """Mean angle in degrees to the nearest of the axes, either way, weighted by areas."""
    cosines = np.abs(normals @ axes.T).max(axis=1)
    return float(np.average(np.degrees(np.arccos(np.clip(cosines, -1, 1))), weights=areas))


@pytest.fixture(scope="module")
def box():
    vertices, faces, axes = turned_box()
    return core.TriangleMesh(vertices, faces), axes


def test_a_remeshed_box_gets_its_sides_back(box):
    mesh, axes = box
    sharp = mesh.moved_to(core.sharpen_geometry(mesh))
    paper = mesh.moved_to(core.sharpen_geometry(mesh, PAPER))
    found = angles_to(sharp.normals, sharp.areas, axes)
    before = angles_to(mesh.normals, mesh.areas, axes)
    assert before > 4.0
    assert found < 0.2 * before
    assert found < 0.3 * angles_to(paper.normals, paper.areas, axes)


@pytest.mark.parametrize(
    ("count", "graded"), [(20, 0.0), (40, 0.0), (80, 0.0), (40, 0.5), (80, 0.5), (80, 0.8)]
)
def test_fine_and_uneven_remeshes_come_out_alike(count, graded):
    vertices, faces, axes = turned_box(count, graded=graded)
    mesh = core.TriangleMesh(vertices, faces)
    sharp = mesh.moved_to(core.sharpen_geometry(mesh))
    before = angles_to(mesh.normals, mesh.areas, axes)
    # The rest lies along the creases, whose share of the faces falls with their size.
    assert angles_to(sharp.normals, sharp.areas, axes) < 0.18 * before


def test_its_corners_come_back(box):
    mesh, axes = box
    sharp = core.sharpen_geometry(mesh)
    corners = (np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
               * (1.0, 0.7, 0.5)) @ axes  # fmt: skip
    away = np.linalg.norm(corners[:, None] - sharp, axis=-1).min(axis=1) / mesh.mean_edge_length
    before = np.linalg.norm(corners[:, None] - mesh.vertices, axis=-1).min(axis=1)
    assert away.mean() < 0.55 * before.mean() / mesh.mean_edge_length


def holed_box(count):
    """A turned box with a round hole, remeshed by a surface net."""
    line = np.linspace(-1.6, 1.6, count)
    points = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1)
    _, _, axes = turned_box(5)
    places = points @ axes.T
    box = (np.abs(places) - np.array([1.0, 0.7, 0.5])).max(axis=-1)
    hole = 0.35 - np.linalg.norm(places[..., :2], axis=-1)
    return core.TriangleMesh(*surface_net(np.maximum(box, hole), line[1] - line[0]))


def folded_edges(mesh, degrees=150.0):
    """Pairs of faces whose normals are farther apart than that."""
    here, there = np.arange(3 * mesh.face_count), mesh.twins.reshape(-1)
    pairs = np.stack([here, there], axis=1)[there >= 0] // 3
    cosines = (mesh.normals[pairs[:, 0]] * mesh.normals[pairs[:, 1]]).sum(axis=1)
    return {tuple(pair) for pair in pairs[cosines < np.cos(np.radians(degrees))].tolist()}


@pytest.mark.parametrize("count", [36, 44, 48])
@pytest.mark.parametrize(
    "more",
    [{}, {"time": 4096.0, "screening_radius": 1000.0}, {"max_displacement": 0.3}, {"amount": 0.5}],
)
def test_no_faces_are_folded_onto_each_other(count, more):
    mesh = holed_box(count)
    sharp = mesh.moved_to(core.sharpen_geometry(mesh, core.GeometrySettings(**more)))
    assert folded_edges(sharp) <= folded_edges(mesh)
    if "max_displacement" in more:
        assert abs(sharp.vertices - mesh.vertices).max() <= 0.3 * mesh.mean_edge_length
    if more.keys() & {"max_displacement", "amount"}:
        return
    targets = core.sharpen_normals(mesh, core.GeometrySettings(**more))
    after, before = ((m.normals * targets).sum(axis=1) for m in (sharp, mesh))
    assert (after > np.minimum(0.0, before - 0.05)).all()


@pytest.mark.parametrize("count", [36, 48])
def test_one_step_folds_no_faces_at_creases(count):
    mesh = holed_box(count)
    rough = mesh.vertices + np.random.default_rng(5).normal(scale=0.002, size=mesh.vertices.shape)
    for current in (mesh, mesh.moved_to(rough)):
        sharp = current.moved_to(core.sharpen_geometry(current, core.GeometrySettings(fit_steps=1)))
        assert not np.array_equal(sharp.vertices, current.vertices)
        assert folded_edges(sharp) <= folded_edges(current)


def test_no_face_becomes_much_thinner_than_the_thinnest_before():
    vertices, faces, _ = turned_box(60)
    mesh = core.TriangleMesh(vertices, faces)
    sharp = mesh.moved_to(core.sharpen_geometry(mesh))
    assert thinnest(sharp) >= 0.4 * thinnest(mesh)


def thinnest(mesh):
    corners = mesh.scaled_vertices[mesh.faces]
    edges = corners - np.roll(corners, 1, axis=1)
    return (mesh.areas / (edges**2).sum(axis=(1, 2))).min()


@pytest.mark.parametrize("shape", [icosphere(4), cube(12)], ids=["sphere", "cube"])
def test_what_is_smooth_or_sharp_stays_bit_for_bit(shape):
    mesh = core.TriangleMesh(*shape)
    assert not find_targets(mesh, core.GeometrySettings()).shares.any()
    assert (core.sharpen_geometry(mesh) == mesh.vertices).all()


def test_a_part_that_is_half_sharp_already_is_sharpened_in_the_other_half():
    vertices, faces = cube(20)
    mesh = core.TriangleMesh(vertices, faces)
    soft = smooth_vertices(mesh, mesh.vertices, 3)
    right = vertices[:, 0] > vertices[:, 0].mean()
    half = mesh.moved_to(np.where(right[:, None], soft, vertices))
    moved = np.linalg.norm(core.sharpen_geometry(half) - half.vertices, axis=1)
    assert moved[right].max() > 0.5 * half.mean_edge_length
    assert moved[vertices[:, 0] < -5].max() < 0.01 * half.mean_edge_length


def test_the_few_soft_edges_of_a_sharp_part_are_sharpened():
    vertices, faces = cube(20)
    mesh = core.TriangleMesh(vertices, faces)
    x, y, _ = (vertices - vertices.mean(axis=0)).T
    near = (x > 4) & (y > -3)
    soft = smooth_vertices(mesh, mesh.vertices, 3)
    part = mesh.moved_to(np.where(near[:, None], soft, vertices))
    moved = np.linalg.norm(core.sharpen_geometry(part) - part.vertices, axis=1)
    assert moved[near].max() > 0.5 * part.mean_edge_length
    assert moved[(x < 0) & (y < 0)].max() < 0.01 * part.mean_edge_length


def rounded_box(radius, count=60):
    """A remeshed box whose edges are fillets, with a radius in voxels."""
    line = np.linspace(-1.6, 1.6, count)
    spacing = line[1] - line[0]
    _, _, axes = turned_box(5)
    points = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1)
    beyond = np.abs(points @ axes.T) - np.array([1.0, 0.7, 0.5]) + radius * spacing
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    distances = outside + np.minimum(beyond.max(axis=-1), 0.0) - radius * spacing
    return core.TriangleMesh(*surface_net(distances, spacing))


@pytest.mark.parametrize(
    ("radius", "widest", "moves"),
    [(0, 1, True), (2, 0, True), (2, 1, False), (2, 4, True), (3, 1, False), (6, 0, False)],
)
def test_roundings_wider_than_asked_for_stay(radius, widest, moves):
    mesh = rounded_box(radius)
    settings = core.GeometrySettings(widest_fillet=widest)
    moved = np.linalg.norm(core.sharpen_geometry(mesh, settings) - mesh.vertices, axis=1)
    share = (moved > 0.1 * mesh.mean_edge_length).mean()
    assert share > 0.1 if moves else share < 0.01


def with_a_ball(mesh):
    """The mesh, and a smooth ball some way off as another part."""
    ball, faces = icosphere(4)
    return core.TriangleMesh(
        np.concatenate([mesh.vertices, ball + 5.0]),
        np.concatenate([mesh.faces, faces + mesh.vertex_count]),
    )


def test_each_part_counts_by_itself(box):
    mesh, _ = box
    both = with_a_ball(mesh)
    moved = core.sharpen_geometry(both) - both.vertices
    assert abs(moved[: mesh.vertex_count]).max() > 0.1 * mesh.mean_edge_length
    assert not moved[mesh.vertex_count :].any()


def test_turning_the_part_changes_hardly_anything_and_scaling_it_nothing(box):
    mesh, axes = box
    sharp = core.sharpen_geometry(mesh)
    scaled = core.TriangleMesh(10.0 * mesh.vertices + 3.0, mesh.faces)
    away = abs(core.sharpen_geometry(scaled) - (10.0 * sharp + 3.0))
    assert away.max() < 1e-5 * scaled.mean_edge_length
    # What lies around is averaged over cells along the axes.
    turned = core.TriangleMesh(mesh.vertices @ axes, mesh.faces)
    away = np.linalg.norm(core.sharpen_geometry(turned) - sharp @ axes, axis=1)
    assert away.max() < 0.25 * mesh.mean_edge_length
    assert away.mean() < 0.005 * mesh.mean_edge_length


@pytest.mark.parametrize("axis", range(3))
def test_a_mirrored_part_gets_the_mirrored_result_bit_for_bit_nearly(box, axis):
    mesh, _ = box
    signs = np.where(np.arange(3) == axis, -1.0, 1.0)
    mirrored = core.TriangleMesh(mesh.vertices * signs, mesh.faces[:, ::-1])
    away = abs(core.sharpen_geometry(mirrored) - core.sharpen_geometry(mesh) * signs)
    assert away.max() < 1e-3 * mesh.mean_edge_length


def cylinder(count):
    """A surface net of a cylinder that stands upright in the grid, and so is its own mirror."""
    line = np.linspace(-1.6, 1.6, count)
    x, y, z = np.meshgrid(line, line, line, indexing="ij")
    return surface_net(np.maximum(np.hypot(x, y) - 0.8, abs(z) - 0.7), line[1] - line[0])


SHAPES = {
    "box": lambda: core.TriangleMesh(*turned_box()[:2]),
    "graded": lambda: core.TriangleMesh(*turned_box(40, graded=0.5)[:2]),
    "hole": lambda: holed_box(44),
    "cylinder": lambda: core.TriangleMesh(*cylinder(44)),
}


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
@pytest.mark.parametrize("seed", [1, 2])
def test_the_order_of_vertices_faces_and_corners_changes_nothing(shape, seed):
    mesh = shape()
    rng = np.random.default_rng(seed)
    order = rng.permutation(mesh.vertex_count)
    faces = np.argsort(order)[mesh.faces][rng.permutation(mesh.face_count)]
    corners = (rng.integers(0, 3, len(faces))[:, None] + np.arange(3)) % 3
    shuffled = core.TriangleMesh(mesh.vertices[order], np.take_along_axis(faces, corners, axis=1))
    away = abs(core.sharpen_geometry(shuffled) - core.sharpen_geometry(mesh)[order])
    assert away.max() < 1e-7 * mesh.mean_edge_length


def test_a_masked_run_says_what_it_found_of_creases(box):
    mesh, _ = box
    with gathering() as findings:
        core.sharpen_geometry(mesh, mask=(mesh.vertices[:, 0] > 0).astype(float))
    assert any("Closed creases" in str(finding) for finding in findings)


def test_parts_that_the_mask_leaves_out_are_not_spoken_of(box):
    mesh, _ = box
    both = with_a_ball(mesh)
    on_ball = np.arange(both.vertex_count) >= mesh.vertex_count
    said = []
    for mask in (on_ball, ~on_ball, 0 * on_ball):
        with gathering() as findings:
            core.sharpen_geometry(both, mask=mask.astype(float))
        said.append(" ".join(str(finding) for finding in findings))
    assert said[0].startswith("No creases to close were found")
    assert said[1].startswith("Closed creases")
    assert said[2] == ""


def test_more_steps_are_as_exact_as_one_where_nothing_turns():
    mesh = core.TriangleMesh(*icosphere(3))
    rng = np.random.default_rng(0)
    tilt = rng.normal(scale=0.002, size=mesh.normals.shape)
    normals = mesh.normals + tilt
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    settings = core.FitSettings(screening_radius=50.0)
    one, _ = displacement(mesh, normals, settings, None, 1)
    many, _ = displacement(mesh, normals, settings, None, 13)
    np.testing.assert_array_equal(many, one)


def test_more_steps_elsewhere_leave_no_place_solved_loosely(box):
    mesh, _ = box
    both = with_a_ball(mesh)
    on_ball = slice(mesh.vertex_count, None)
    tilt = 0.008 * np.sin(3.0 * both.vertices[both.faces].mean(axis=1)[:, [1, 2, 0]])
    normals = both.normals + tilt
    normals[: mesh.face_count] = core.sharpen_normals(mesh)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    settings = core.FitSettings(screening_radius=50.0)
    moved, _ = displacement(both, normals, settings, None, 13)
    alone = np.zeros_like(normals)  # 0 asks for no turn, so that the tolerance is the ball's
    alone[mesh.face_count :] = normals[mesh.face_count :]
    expected, _ = displacement(both, alone, settings, None, 1)
    away = np.linalg.norm((moved - expected)[on_ball])
    assert away < 0.05 * np.linalg.norm(expected[on_ball])


def test_neutral_values_give_the_filter_of_the_paper(box):
    mesh, _ = box
    neutral = core.GeometrySettings(
        where="everywhere", align_passes=0, fit_steps=1, crease_freedom=0.0
    )
    assert neutral == PAPER
    # The paper's: normals at the ends of flow-lines, then the screened refit, solved once.
    fit = core.FitSettings(screening_radius=PAPER.screening_radius)
    expected = core.fit_to_normals(mesh, core.sharpen_normals(mesh, PAPER), fit)
    assert abs(core.sharpen_geometry(mesh, neutral) - expected).max() < 1e-9
    assert abs(expected - core.sharpen_geometry(mesh)).max() > 0.1 * mesh.mean_edge_length


def test_other_settings_may_be_said_beside_those_of_the_paper():
    settings = core.GeometrySettings.of_paper(time=16, fit_steps=5)
    assert settings == core.GeometrySettings(
        time=16, where="everywhere", align_passes=0, fit_steps=5, crease_freedom=0.0
    )


def test_each_step_comes_nearer_to_the_normals(box):
    mesh, _ = box
    normals = core.sharpen_normals(mesh)

    def energy(steps):
        settings = core.GeometrySettings(fit_steps=steps, screening_radius=1e3, crease_freedom=0.0)
        moved = core.sharpen_geometry(mesh, settings)
        along = np.einsum("mdx,md->mx", gradient(mesh, moved / mesh.mean_edge_length), normals)
        return float((mesh.areas * (along**2).sum(axis=1)).sum())

    found = [energy(steps) for steps in (1, 2, 4)]
    assert found == sorted(found, reverse=True)
    assert max(found[-1], energy(13)) < 0.3 * found[0]  # what would fold goes back at the end


def test_masked_vertices_stay_bit_for_bit(box):
    mesh, _ = box
    mask = (mesh.vertices[:, 0] > 0).astype(float)
    sharp = core.sharpen_geometry(mesh, mask=mask)
    assert (sharp[mask == 0] == mesh.vertices[mask == 0]).all()
    assert (sharp[mask == 1] != mesh.vertices[mask == 1]).any()


def naive_sides(mesh, normals, zone, pull):
    touching = [set() for _ in range(mesh.vertex_count)]
    for f, face in enumerate(mesh.faces):
        for v in face:
            touching[v].add(f)
    around = [set().union(*(touching[v] for v in face)) for face in mesh.faces]
    means, uneven = [], []
    for patch in around:
        total = sum(mesh.areas[g] * normals[g] for g in patch)
        length = np.linalg.norm(total)
        means.append(total / length)
        uneven.append(1 - length / sum(mesh.areas[g] for g in patch))
    out = normals.copy()
    for f in np.flatnonzero(zone):
        costs = {g: uneven[g] + pull * (1 - normals[f] @ means[g]) for g in around[f]}
        out[f] = means[min(costs, key=costs.get)]
    return out


def test_faces_take_the_side_that_a_plain_search_finds(box):
    mesh, _ = box
    zone = mesh.vertices[mesh.faces[:, 0], 2] > 0
    found = consistent_normals(mesh, mesh.normals, zone, 1)
    expected = naive_sides(mesh, mesh.normals, zone, PULL)
    assert (found[~zone] == mesh.normals[~zone]).all()
    same = abs(found - expected).max(axis=1) < 1e-9
    assert same.mean() > 0.995  # equal costs may be broken otherwise
    assert (abs(found - mesh.normals).max(axis=1) > 0.1).any()


@pytest.mark.parametrize("count", [6, 2000])
def test_hubs_and_flat_parts_are_finite(count):
    mesh = core.TriangleMesh(*fan(count))
    assert np.isfinite(core.sharpen_geometry(mesh)).all()


def turned_by(mesh, positions):
    """Mean angle in degrees between the normals before and after."""
    cosines = (mesh.normals * mesh.moved_to(positions).normals).sum(axis=1)
    return np.degrees(np.arccos(np.clip(cosines, -1, 1))).mean()


def test_flying_points_of_a_scan_are_not_taken_for_creases():
    vertices, faces = icosphere(6)
    mesh = core.TriangleMesh(vertices, faces)
    random = np.random.default_rng(3)
    off = random.normal(size=(mesh.vertex_count, 1)) * (
        random.random((mesh.vertex_count, 1)) < 0.02
    )
    rough = mesh.moved_to(vertices * (1.0 + 0.2 * mesh.mean_edge_length * off))
    assert turned_by(rough, core.sharpen_geometry(rough)) < 1.0


def test_facets_of_denoised_relief_are_no_creases():
    ball, faces = icosphere(5)
    waves = 0.05 * np.sin(5 * ball).sum(axis=1) + 0.02 * np.sin(13 * ball).sum(axis=1)
    steps = 0.15 * (abs(ball[:, 0]) < 0.08) * (ball[:, 2] > 0)
    statue = core.TriangleMesh(ball * (1 + waves + steps)[:, None], faces)
    along = np.random.default_rng(0).normal(size=(len(ball), 1)) * ball
    noisy = statue.moved_to(statue.vertices + 0.3 * statue.mean_edge_length * along)
    denoised = noisy.moved_to(core.denoise_geometry(noisy))
    sharp = denoised.moved_to(core.sharpen_geometry(denoised))

    def off(mesh):
        cosines = np.clip((mesh.normals * statue.normals).sum(axis=1), -1, 1)
        return np.degrees(np.arccos(cosines)).mean()

    assert off(sharp) < 1.06 * off(denoised)


def said(mesh, **settings):
    """What the filter finds out, for reports."""
    with gathering() as found:
        core.sharpen_geometry(mesh, core.GeometrySettings(**settings))
    return " ".join(map(str, found))


def test_a_surface_without_creases_says_what_to_try():
    mesh = core.TriangleMesh(*icosphere(4))
    assert said(mesh).startswith("No creases to close were found")
    assert "set Where to Everywhere" in said(mesh)
    assert said(mesh, where="everywhere") == ""


def screw(around=240, along=120):
    """A bolt whose thread is rounded, (along its axis, turn by turn): vertices and faces."""
    angle, height = np.meshgrid(
        np.linspace(0.0, 2.0 * np.pi, around, endpoint=False),
        np.linspace(0.0, 3.0, along),
        indexing="ij",
    )
    wave = 0.8 * np.sin(2.0 * np.pi * height / 0.6 - angle)
    radius = 2.0 + 0.5 / np.pi * np.arcsin(wave)
    places = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1)
    number = np.arange(around * along).reshape(around, along)
    following = np.roll(number, -1, axis=0)
    a, b, c, d = number[:, :-1], following[:, :-1], following[:, 1:], number[:, 1:]
    halves = [np.stack(half, axis=-1).reshape(-1, 3) for half in ((a, b, c), (a, c, d))]
    return places.reshape(-1, 3), np.concatenate(halves)


def test_threads_close_from_the_radius_that_is_said():
    mesh = core.TriangleMesh(*screw())
    closed = core.sharpen_geometry(mesh, core.GeometrySettings(widest_fillet=2.5))
    assert (closed != mesh.vertices).any(axis=1).mean() > 0.7
    found = said(mesh, widest_fillet=2.5)
    assert "rounded over a radius of up to 2.2 edge lengths" in found
    assert "To keep threads and fillets, set Widest Fillet below that." in found
    kept = core.GeometrySettings(widest_fillet=1.0)
    assert (core.sharpen_geometry(mesh, kept) == mesh.vertices).all()
    assert said(mesh, widest_fillet=1.0).endswith("more widely than Widest Fillet, and stay.")


def test_no_rounding_is_said_to_have_closed_that_is_wider_than_widest_fillet(box):
    mesh, _ = box
    for widest in (0.5, 1.0, 2.0):
        (told,) = re.findall(r"a radius of up to (\S+) edge", said(mesh, widest_fillet=widest))
        assert float(told) <= widest


def test_the_shipped_networks_belong_to_the_code_and_give_the_same_everywhere(box):
    networks = load(WEIGHTS, DEFINITION)
    assert networks["mixture"].weights[0].shape[0] == TOLD
    assert networks["gate"].weights[0].shape[0] == len(TOLD_FIRST)
    assert networks["mixture"].version >= 1 and len(networks["mixture"].made_of) == 16
    mesh, _ = box
    chosen = [0, 100, 300, 600, 900]
    sharp = (core.sharpen_geometry(mesh) - mesh.vertices)[chosen] / mesh.mean_edge_length
    assert sharp == pytest.approx(np.array(EXPECTED), abs=1e-5)


def test_an_amount_of_0_returns_the_input_bit_for_bit_and_half_of_it_half(box):
    mesh, _ = box
    still = core.sharpen_geometry(mesh, core.GeometrySettings(amount=0.0))
    assert np.array_equal(still, mesh.vertices)
    whole = core.sharpen_geometry(mesh) - mesh.vertices
    half = core.sharpen_geometry(mesh, core.GeometrySettings(amount=0.5)) - mesh.vertices
    assert np.isclose(half, 0.5 * whole, atol=1e-9).all(axis=1).mean() > 0.95


def test_a_fillet_that_stays_closes_when_asked_for_and_at_any_size_of_cells():
    for count in (40, 60, 90):
        mesh = rounded_box(3, count)
        auto, given = (
            np.linalg.norm(core.sharpen_geometry(mesh, settings) - mesh.vertices, axis=1)
            for settings in (core.GeometrySettings(), core.GeometrySettings(widest_fillet=4.0))
        )
        assert given.max() > 0.5 * mesh.mean_edge_length
        assert given.sum() > auto.sum()


def test_a_box_under_a_bumpy_ball_closes_whatever_the_relief():
    line = np.linspace(-1.6, 1.6, 70)
    points = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1)
    _, _, axes = turned_box(5)
    places = points @ axes.T
    low = (np.abs(places + [0, 0, 0.5]) - np.array([0.9, 0.7, 0.35])).max(axis=-1)
    length = np.linalg.norm(places - [0, 0, 0.4], axis=-1)
    way = (places - [0, 0, 0.4]) / length[..., None]
    for relief in (0.05, 0.15, 0.3):
        bumps = relief * np.sin(7.0 * way + 0.5).prod(axis=-1)
        whole = np.minimum(low, 0.8 * (length - 0.6 - bumps))
        mesh = core.TriangleMesh(*surface_net(whole, line[1] - line[0]))
        sharp = mesh.moved_to(core.sharpen_geometry(mesh))
        centres = mesh.vertices[mesh.faces].mean(axis=1) - 1.6
        on_box = (centres @ axes.T)[:, 2] < -0.55
        before, after = (angles_to(m.normals[on_box], m.areas[on_box], axes)
                         for m in (mesh, sharp))  # fmt: skip
        assert before > 2.0
        assert after < 0.75


@pytest.mark.parametrize("wave", [4, 6, 10])
def test_relief_of_an_even_sheet_stays(wave):
    vertices, faces = grid(60, 60)
    vertices = vertices * [59, 59, 1] / np.maximum(np.ptp(vertices, axis=0), 1e-9)
    at = 2 * np.pi / wave * vertices[:, :2]
    egg_box = np.sin(at).sum(axis=1)
    knurls = 2 * np.sin(at @ [[0.8, 0.6], [0.6, -0.8]]).prod(axis=1)
    for relief in (egg_box, knurls):
        mesh = core.TriangleMesh(vertices + 0.03 * wave * relief[:, None] * [0, 0, 1], faces)
        moved = mesh.moved_to(core.sharpen_geometry(mesh))
        cosines = (mesh.normals * moved.normals).sum(axis=1)
        assert np.degrees(np.arccos(np.clip(cosines, -1, 1))).mean() < 1.0


def test_a_pyramid_of_six_faces_stays():
    """The networks were trained on meshes of at least 24 faces."""
    corners = [[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0], [0, 0, 1.5]]
    faces = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [0, 3, 2], [0, 2, 1]]
    for scale in (1.0, 0.4, 2.0):
        mesh = core.TriangleMesh(np.array(corners) * [1, 1, scale], faces)
        assert np.array_equal(core.sharpen_geometry(mesh), mesh.vertices)


def test_targets_are_told_face_by_face(box):
    mesh, axes = box
    creases = find_targets(mesh, core.GeometrySettings())
    assert np.allclose(np.linalg.norm(creases.normals, axis=1), 1.0)
    still = creases.shares == 0
    assert (creases.normals[still] == mesh.normals[still]).all()
    assert ((creases.shares >= 0) & (creases.shares <= 1)).all()
    turned = (creases.normals * mesh.normals).sum(axis=1) < np.cos(np.radians(15.0))
    assert creases.sided[turned].mean() > 0.7
    before = angles_to(mesh.normals, mesh.areas, axes)
    assert angles_to(creases.normals, mesh.areas, axes) < 0.4 * before


def test_the_number_of_threads_changes_no_bit(monkeypatch):
    vertices, faces, _ = turned_box(40)
    found = []
    for threads in (1, None):
        monkeypatch.setattr(parallel, "most_threads", threads)
        found.append(core.sharpen_geometry(core.TriangleMesh(vertices, faces)))
    assert np.array_equal(*found)
