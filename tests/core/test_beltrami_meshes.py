# SPDX-License-Identifier: GPL-3.0-or-later
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from shapes import angles, cube, fan, grid, icosphere, rotation, shuffled, subdivide
from shock_filter import core
from shock_filter.core import settings as settings_module
from shock_filter.core.base.findings import gathering
from shock_filter.core.beltrami import mesh_smoothing
from shock_filter.core.mesh.calculus import average_to_vertices, lumped_mass
from shock_filter.core.mesh.geodesics import (
    ALL,
    Stencils,
    face_steps,
    march,
    new_front,
    new_search,
    search,
    stencils,
)
from shock_filter.core.shape.noise import noise_of_normals


def kernel_of_paper(**settings):
    return core.BeltramiGeometrySettings(method="beltrami", **settings)


def noisy(vertices, faces, amount, seed=0):
    """A mesh whose vertices moved along its normals, by so many mean edge lengths."""
    mesh = core.TriangleMesh(vertices, faces)
    steps = np.random.default_rng(seed).normal(size=(len(vertices), 1))
    along = average_to_vertices(mesh, mesh.normals)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return core.TriangleMesh(vertices + amount * mesh.mean_edge_length * steps * along, faces)


def distances_from(mesh, source, embedding=None, limit=np.inf):
    """Distances from one vertex, by the march that the filters use: (n,)."""
    points = mesh.scaled_vertices if embedding is None else embedding
    front = new_front(mesh.vertex_count)
    reached = front.reached[: march(source, 1, limit, ALL, stencils(mesh, points), front)]
    found = np.full(mesh.vertex_count, np.inf)
    found[reached] = np.sqrt(front.squares[reached])
    return found


def errors(mesh, source, exact, near=np.inf):
    """Mean edge length, and the largest and mean error in the mesh's unit up to `near`."""
    found = distances_from(mesh, source) * mesh.mean_edge_length
    error = abs(found - exact)[exact < near]
    return mesh.mean_edge_length, error.max(), error.mean()


def orders(series):
    sizes, *kinds = np.array(series).T
    return [np.log(e[:-1] / e[1:]) / np.log(sizes[:-1] / sizes[1:]) for e in kinds]


def wedge_on_cone(n, jitter):
    """A square sheet rolled onto a cone, without changing lengths; returns the sheet, too."""
    sheet, faces = grid(n, n, jitter=jitter)
    sheet /= n
    radius, turn = np.hypot(*sheet[:, :2].T), 2.5 * np.arctan2(sheet[:, 1], sheet[:, 0])
    height = np.sqrt(1 - 1 / 2.5**2)
    points = [np.cos(turn) / 2.5, np.sin(turn) / 2.5, np.full_like(turn, height)]
    return np.stack(points, axis=1) * radius[:, None], faces, sheet


def graph_distances(points, faces, source, on_edge=9):
    """Dijkstra through points on the edges, all joined within each face."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, number = np.unique(edges, axis=0, return_inverse=True)
    share = (np.arange(on_edge)[:, None] + 1) / (on_edge + 1)
    between = points[unique[:, :1]] * (1 - share) + points[unique[:, 1:]] * share
    every = np.concatenate([points, between.reshape(-1, points.shape[1])])
    places = len(points) + number.reshape(-1, 3, 1) * on_edge + np.arange(on_edge)
    nodes = np.concatenate([faces, places.reshape(len(faces), -1)], axis=1)
    i, j = np.triu_indices(nodes.shape[1], 1)
    pairs = np.unique(np.sort(np.stack([nodes[:, i], nodes[:, j]], -1).reshape(-1, 2)), axis=0)
    a, b = pairs.T
    lengths = np.linalg.norm(every[a] - every[b], axis=1)
    graph = csr_matrix((lengths, (a, b)), shape=(len(every), len(every)))
    return dijkstra(graph, directed=False, indices=source)[: len(points)]


@pytest.mark.parametrize("shear", [0.0, 0.5, 1.0])
def test_distances_on_regular_sheets_are_exact(shear):
    # Sheared sheets have nothing but obtuse triangles.
    vertices, faces = grid(20, 20)
    vertices[:, 0] += shear * vertices[:, 1]
    mesh = core.TriangleMesh(vertices, faces)
    source = 21 * 10 + 10
    exact = np.linalg.norm(vertices - vertices[source], axis=1)
    near = exact < 6
    assert near.sum() > 80
    found = distances_from(mesh, source) * mesh.mean_edge_length
    assert abs(found - exact)[near].max() < 1e-5


def test_distances_converge_on_obtuse_sheets():
    vertices, faces = grid(6, 6, jitter=0.45, seed=2)
    vertices *= [3.0, 1.0, 1.0]
    sides = vertices[faces] - np.roll(vertices[faces], -1, axis=1)
    squares = (sides**2).sum(axis=2)
    assert (2 * squares.max(axis=1) > squares.sum(axis=1)).mean() > 0.6
    series = []
    for _ in range(5):
        exact = np.linalg.norm(vertices - vertices[24], axis=1)
        series.append(errors(core.TriangleMesh(vertices, faces), 24, exact))
        vertices, faces = subdivide(vertices, faces)
    largest, mean = orders(series)
    assert largest.min() > 0.9
    assert mean.min() > 0.9


def test_distances_converge_on_a_sphere():
    series = []
    for level in range(2, 6):
        vertices, faces = icosphere(level)
        exact = np.arccos(np.clip(vertices @ vertices[0], -1, 1))
        series.append(errors(core.TriangleMesh(vertices, faces), 0, exact))
    largest, mean = orders(series)
    assert largest.min() > 0.8  # at the opposite pole, where all ways meet
    assert mean.min() > 0.95
    assert series[-1][1] < 0.025


@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_distances_converge_on_a_cone(jitter):
    series = []
    for n in (8, 16, 32, 64):
        vertices, faces, sheet = wedge_on_cone(n, jitter)
        source = (n // 2) * (n + 1) + n // 4
        exact = np.linalg.norm(sheet - sheet[source], axis=1)
        series.append(errors(core.TriangleMesh(vertices, faces), source, exact))
    largest, mean = orders(series)
    assert largest.min() > 0.9
    assert mean.min() > 1.5


@pytest.mark.parametrize("roughness", [0.0, 0.3, 1.0])
def test_distances_agree_with_a_dense_graph(roughness):
    # On an irregular sheet painted with noise: rough in five dimensions, a third of it obtuse.
    vertices, faces = grid(12, 12, jitter=0.4, seed=2)
    mesh = core.TriangleMesh(vertices, faces)
    paint = np.random.default_rng(0).normal(size=(len(vertices), 2))
    embedding = np.concatenate([mesh.scaled_vertices, roughness * paint], axis=1)
    for source in (84, 40, 0):
        exact = graph_distances(embedding, mesh.faces, source)
        found = distances_from(mesh, source, embedding)
        relative = abs(found - exact)[exact > 0] / exact[exact > 0]
        assert relative.mean() < 0.025
        assert relative[exact[exact > 0] < 4].mean() < 0.01
        assert relative.max() < 0.15


def test_the_march_stops_at_its_limit():
    mesh = core.TriangleMesh(*icosphere(4))
    everything = distances_from(mesh, 5)
    near = distances_from(mesh, 5, limit=4.0)
    assert np.array_equal(near[everything <= 4], everything[everything <= 4])
    assert np.isinf(near[everything > 4]).all()
    assert 20 < np.isfinite(near).sum() < 100


def face_distances(mesh, points, source):
    """Exact distances from centre to centre, over edges."""
    a, b = mesh.twins.reshape(-1) // 3, np.repeat(np.arange(mesh.face_count), 3)
    lengths = np.linalg.norm(points[a] - points[b], axis=1)
    whole = csr_matrix((lengths, (a, b)), shape=(mesh.face_count, mesh.face_count))
    return dijkstra(whole, indices=source)


def face_stencils(mesh, points):
    """The graph of the faces, for the march: straight ways from centre to centre."""
    face, k = np.nonzero(mesh.twins >= 0)
    other = mesh.twins[face, k] // 3
    start = np.concatenate([[0], np.cumsum(np.bincount(face, minlength=mesh.face_count))])
    shapes = np.zeros((len(face), 3), np.float32)
    shapes[:, 1] = np.linalg.norm(points[face] - points[other], axis=1)
    return Stencils(start, other.astype(np.int32), face.astype(np.int32), shapes)


def test_a_front_is_used_again_from_march_to_march():
    mesh = core.TriangleMesh(*icosphere(3))
    centres = mesh.scaled_vertices[mesh.faces].mean(axis=1)
    graph = face_stencils(mesh, centres)
    front = new_front(mesh.face_count)
    for turn, source in enumerate((7, 1000, 7, 300), start=1):
        count = march(source, turn, 5.0, ALL, graph, front)
        reached, squares = front.reached[:count], front.squares
        exact = face_distances(mesh, centres, source)
        assert set(reached) == set(np.flatnonzero(exact <= 5.0))
        assert np.allclose(np.sqrt(squares[reached]), exact[reached], rtol=1e-6)
        assert (np.diff(squares[reached]) >= 0).all()


@pytest.mark.parametrize("limit", [4.0, 30.0])
def test_searches_find_the_shortest_ways_over_rough_faces(limit):
    mesh = core.TriangleMesh(*icosphere(3))
    centres = mesh.scaled_vertices[mesh.faces].mean(axis=1)
    rough = np.random.default_rng(0).normal(size=centres.shape)
    steps = face_steps(mesh, centres, rough, 0.5)
    reached, left = new_search(mesh.face_count)
    points = np.concatenate([centres, 0.5 * rough], axis=1)
    repeated = False
    for source in (7, 1000, 7):
        count = search(source, limit, ALL, *steps, reached, left)
        exact = face_distances(mesh, points, source)
        assert set(reached[:count]) == set(np.flatnonzero(exact < limit))
        assert np.allclose(limit - left, np.minimum(exact, limit), atol=1e-5)
        repeated |= count > len(set(reached[:count]))
        left[reached[:count]] = 0.0
        assert (left == 0).all()
    assert repeated or limit < 5  # shorter ways come later, far away
    assert search(7, limit, 5, *steps, reached, left) == 5


def test_faces_are_averaged_as_on_a_graph_of_them():
    mesh = noisy(*cube(6), 0.2)
    centres = mesh.scaled_vertices[mesh.faces].mean(axis=1)
    settings = kernel_of_paper(time=2.0)
    found = mesh_smoothing.smooth_faces(mesh, centres, mesh.normals, 3.0, mesh.normals, settings)
    embedding = np.concatenate([centres, 3.0 * mesh.normals], axis=1)
    graph = face_stencils(mesh, embedding)
    means = mesh_smoothing.smooth_graph(graph, mesh.areas, mesh.normals, settings, mesh.has_hubs)
    expected = means / np.linalg.norm(means, axis=1, keepdims=True)
    assert np.allclose(found, expected, atol=1e-4)
    assert abs(found - mesh.normals).max() > 0.1


def test_weights_decay_as_the_exponential_does():
    x = np.array([0.0, -1e-3, -0.5, -2.0, -5.0])
    found = np.array([mesh_smoothing.decay(value) for value in x])
    assert found[0] == 1.0
    assert np.allclose(found, np.exp(x), rtol=2e-4)
    for far in (-40.0, -1e3, -np.inf):
        assert 0 <= mesh_smoothing.decay(far) < 1e-12


def test_corners_that_are_not_split_are_counted(caplog):
    # A flat corner above a long strip, all of whose vertices lie to the left or right of it.
    rows = 40
    sides = [[x, -0.1 * y, 0.0] for y in range(rows) for x in (-1.0, 1.0)]
    faces = [[0, 1, 2]]
    for i in range(1, 2 * rows - 2, 2):
        faces += [[i, i + 2, i + 1], [i + 1, i + 2, i + 3]]
    mesh = core.TriangleMesh([[0.0, 0.01, 0.0], *sides], faces)
    with caplog.at_level("INFO"):
        distances_from(mesh, 0)
    assert "1 obtuse corners are not split" in caplog.text


def dense_means(mesh, embedding, values, time, threshold=0.01):
    """The kernel as a full matrix of straight distances."""
    steps = embedding[:, None] - embedding[None]
    squares = (steps**2).sum(axis=2)
    weights = np.exp(-squares / (4 * time)) * lumped_mass(mesh)
    weights[squares > -4 * time * np.log(threshold)] = 0
    return weights @ values / weights.sum(axis=1, keepdims=True)


def test_a_flat_sheet_gets_a_gaussian_weighted_by_area(monkeypatch):
    monkeypatch.setattr(settings_module, "CUTOFF", 1e-4)
    vertices, faces = grid(14, 14, jitter=0.2)
    vertices[:, 0] = vertices[:, 0] ** 1.5 / 3  # samples crowd on one side
    mesh = core.TriangleMesh(vertices, faces)
    values = np.random.default_rng(1).random((len(vertices), 2))
    settings = core.BeltramiMeshSettings(time=1.0, beta=0.0)
    out = core.beltrami_vertex_signal(mesh, values, settings)
    expected = dense_means(mesh, mesh.scaled_vertices, values, 1.0, 1e-4)
    assert abs(out - expected).max() < 0.01
    assert abs(out - expected).mean() < 5e-4
    assert abs(values - expected).mean() > 0.2


def test_geodesics_do_not_cross_a_gap_that_straight_ones_do():
    # A bright line one edge wide between two parts of the same gray.
    mesh = core.TriangleMesh(*grid(20, 20))
    side = np.sign(mesh.vertices[:, 0] - 10)
    values = np.where(side == 0, 1.0, 0.01 * side)
    settings = core.BeltramiMeshSettings(time=1.0, beta=5.0)
    kept = core.beltrami_vertex_signal(mesh, values, settings)
    assert abs(kept[side > 0] - 0.01).max() < 1e-9
    embedding = np.column_stack([mesh.scaled_vertices, 5.0 * values])
    assert dense_means(mesh, embedding, values, 1.0)[side > 0].min() < 0.008


def test_noise_goes_and_a_step_stays():
    mesh = core.TriangleMesh(*grid(30, 30, jitter=0.2))
    right = mesh.vertices[:, 0] > 15.2
    noise = np.random.default_rng(3).normal(scale=0.03, size=mesh.vertex_count)
    settings = core.BeltramiMeshSettings(time=2.0, beta=10.0, iterations=2)
    out = core.beltrami_vertex_signal(mesh, right + noise, settings)
    for side in (right, ~right):
        assert out[side].var() < noise[side].var() / 4
    clean = core.beltrami_vertex_signal(mesh, right.astype(float), settings)
    assert abs(clean - right).max() < 1e-3


def test_work_at_a_hub_grows_with_its_faces_and_not_with_their_square():
    # What one vertex adds to others shows how many means it takes part in.
    mesh = core.TriangleMesh(*fan(20_000))
    one = np.zeros(mesh.vertex_count)
    one[7] = 1.0
    asked = []
    settings = core.BeltramiMeshSettings(beta=0.0)
    out = core.beltrami_vertex_signal(
        mesh, one, settings, progress=lambda *_: asked.append(1) or True
    )
    assert 100 < np.count_nonzero(out) < 1000
    assert len(asked) > 30


@pytest.mark.parametrize("height", [0.0, 1.0])
def test_large_fans_are_denoised_in_few_iterations(height, caplog):
    vertices, faces = fan(20_000, 1e-4)
    clean, _ = fan(20_000)
    vertices[0, 2] = clean[0, 2] = height
    with caplog.at_level("INFO"):
        out = core.denoise_geometry(core.TriangleMesh(vertices, faces), kernel_of_paper())
    iterations = [record.args[0] for record in caplog.records if "Refit" in record.message]
    assert len(iterations) == 3
    assert max(iterations) < 150
    before, after = (p[1:, 2] + height * np.hypot(*p[1:, :2].T) for p in (vertices, out))
    assert np.diff(after).std() < 0.05 * np.diff(before).std()  # across the surface
    assert abs(out - clean).max() < 1.5e-3


def test_faces_at_a_hub_are_filtered():
    mesh = core.TriangleMesh(*fan(2000, 0.02))
    values = np.random.default_rng(1).random((mesh.vertex_count, 2))
    places, signals = all_filters(mesh, values)
    for out in (*places, *signals):
        assert np.isfinite(out).all()
    assert signals[1].std(axis=0).max() < 0.5 * values.std()


def test_a_mean_at_a_hub_is_close_to_that_over_all():
    mesh, whole = (core.TriangleMesh(*fan(1000, 0.02)) for _ in range(2))
    assert mesh.has_hubs
    whole.has_hubs = False
    noise = np.random.default_rng(1).normal(size=mesh.vertex_count)
    signal = 0.5 + 0.3 * mesh.vertices[:, 0] + 0.05 * noise
    near, far = (core.beltrami_vertex_signal(m, signal) for m in (mesh, whole))
    assert (near != far).any()
    assert abs(near - far).max() < 0.02
    assert abs(signal - far).mean() > 0.1


def test_ordinary_vertices_are_no_hubs():
    assert not core.TriangleMesh(*fan(100)).has_hubs
    assert core.TriangleMesh(*fan(101)).has_hubs


def test_constants_stay_bit_for_bit():
    mesh = noisy(*icosphere(3), 0.2)
    values = np.full((mesh.vertex_count, 3), [0.1, 0.7, 1 / 3])
    settings = core.BeltramiMeshSettings(iterations=3)
    assert np.array_equal(core.beltrami_vertex_signal(mesh, values, settings), values)
    assert np.array_equal(core.beltrami_joint(mesh, values, settings)[1], values)
    corners = values[mesh.faces]
    assert np.array_equal(core.beltrami_corner_signal(mesh, corners, settings), corners)


def test_corners_that_agree_are_filtered_as_vertices():
    vertices, faces = icosphere(3)
    faces[::7] = faces[::7, [0, 2, 1]]  # wound the other way
    mesh = core.TriangleMesh(vertices, faces)
    values = np.random.default_rng(0).random((mesh.vertex_count, 3)).astype(np.float32)
    out = core.beltrami_corner_signal(mesh, values[faces])
    assert out.dtype == np.float32
    assert np.allclose(out, core.beltrami_vertex_signal(mesh, values)[faces], atol=1e-6)


def test_nothing_crosses_where_corners_differ():
    mesh = core.TriangleMesh(*grid(16, 16))
    left = mesh.vertices[mesh.faces, 0].mean(axis=1) < 8
    noise = np.random.default_rng(0).random(mesh.vertex_count)[mesh.faces]
    corners = np.where(left[:, None], 0.3 * noise, 0.35 + 0.3 * noise)
    settings = core.BeltramiMeshSettings(time=4.0, beta=0.0)
    out = core.beltrami_corner_signal(mesh, corners, settings)
    assert out[left].max() < 0.3
    assert out[~left].min() > 0.35
    assert out[left].std() < 0.3 * corners[left].std()


def test_positions_of_a_plane_stay_in_it():
    mesh = core.TriangleMesh(*grid(12, 12, jitter=0.3))
    settings = kernel_of_paper(filtered="positions", iterations=1)
    out = core.denoise_geometry(mesh, settings)
    assert (out[:, 2] == 0).all()
    inner = (abs(mesh.vertices[:, :2] - 6) < 3).all(axis=1)
    assert abs(out - mesh.vertices)[inner].max() < 0.5
    rough = noisy(*grid(12, 12), 0.2)
    assert core.denoise_geometry(rough, settings)[:, 2].var() < rough.vertices[:, 2].var() / 6


def test_mesh_and_signal_are_filtered_together():
    # A rough sheet with a step in height where the paint has one.
    sheet, faces = grid(24, 24)
    clean = sheet[:, 0] > 12.5
    rng = np.random.default_rng(5)
    height = clean + rng.normal(scale=0.1, size=len(sheet))
    paint = clean + rng.normal(scale=0.03, size=len(sheet))
    sheet[:, 2] = height
    mesh = core.TriangleMesh(sheet, faces)
    settings = core.BeltramiMeshSettings(time=0.7, beta=8.0)
    positions, values = core.beltrami_joint(mesh, paint, settings)
    assert values.shape == paint.shape
    for side in (clean, ~clean):
        assert positions[side, 2].var() < height[side].var() / 4
        assert values[side].var() < paint[side].var() / 4
    unpainted = kernel_of_paper(filtered="positions", time=0.7, iterations=1)
    alone = core.denoise_geometry(mesh, unpainted)
    edge = abs(sheet[:, 0] - 12.5) < 1
    lost = [abs(z - clean)[edge].mean() for z in (positions[:, 2], alone[:, 2])]
    assert lost[0] < 0.3 * lost[1]


@pytest.mark.parametrize("amount", [0.1, 0.2, 0.3])
def test_one_setting_cleans_light_and_strong_noise_and_keeps_creases(amount):
    vertices, faces = cube(16)
    clean, mesh = core.TriangleMesh(vertices, faces), noisy(vertices, faces, amount)
    out = core.TriangleMesh(core.denoise_geometry(mesh, kernel_of_paper()), faces)
    before = angles(mesh.normals, clean.normals)
    after = angles(out.normals, clean.normals)
    assert after.mean() < 0.25 * before.mean()
    # Faces along the edges of the cube point as their sides do.
    distance = 8 - np.sort(abs(vertices[faces].mean(axis=1)), axis=1)[:, 1]
    assert after[distance < 0.7].mean() < 0.4 * before[distance < 0.7].mean()
    lengths = np.linalg.norm(out.vertices - vertices, axis=1)
    assert np.sqrt((lengths**2).mean()) < 0.75 * amount * mesh.mean_edge_length


def test_filtering_positions_rounds_creases():
    vertices, faces = cube(16)
    clean, mesh = core.TriangleMesh(vertices, faces), noisy(vertices, faces, 0.2)
    error = {}
    for filtered in ("normals", "positions"):
        out = core.denoise_geometry(mesh, kernel_of_paper(filtered=filtered))
        error[filtered] = angles(core.TriangleMesh(out, faces).normals, clean.normals).mean()
    assert error["normals"] < 0.5 * error["positions"]


@pytest.mark.parametrize("shape", [cube(8), icosphere(4)])
def test_clean_meshes_hardly_change(shape):
    mesh = core.TriangleMesh(*shape)
    moved = np.linalg.norm(core.denoise_geometry(mesh, kernel_of_paper()) - mesh.vertices, axis=1)
    assert moved.max() < 0.02 * mesh.mean_edge_length


def test_faint_relief_on_a_clean_mesh_stays():
    # Grooves of 20 degrees, which strong noise would hide, beside a smooth part.
    vertices, faces = grid(40, 20)
    vertices[:, 2] = 0.35 * abs(np.minimum(vertices[:, 0], 13) % 4 - 2)
    mesh = core.TriangleMesh(vertices, faces)
    moved = np.linalg.norm(core.denoise_geometry(mesh, kernel_of_paper()) - vertices, axis=1)
    assert moved.max() < 0.01 * mesh.mean_edge_length


def test_noise_of_normals_grows_with_the_noise():
    assert noise_of_normals(core.TriangleMesh(*cube(16))) < 1e-3
    levels = [noise_of_normals(noisy(*cube(16), amount)) for amount in (0.05, 0.1, 0.2)]
    assert levels[1] == pytest.approx(2 * levels[0], rel=0.1)
    assert levels[2] == pytest.approx(2 * levels[1], rel=0.2)
    single = core.TriangleMesh(np.eye(3), [[0, 1, 2]])
    assert noise_of_normals(single) < 1


def test_the_papers_name_means_the_kernel():
    mesh = noisy(*cube(8), 0.1)
    settings = core.BeltramiGeometrySettings(time=0.8)
    kernel = core.denoise_geometry(mesh, replace(settings, method="beltrami"))
    assert np.array_equal(core.beltrami_mesh(mesh, settings), kernel)
    assert not np.array_equal(core.denoise_geometry(mesh, settings), kernel)


def test_settings_that_do_not_count_are_told():
    mesh = noisy(*cube(8), 0.1)

    def said(**settings):
        with gathering() as findings:
            core.denoise_geometry(mesh, core.BeltramiGeometrySettings(**settings))
        return [str(finding) for finding in findings]

    assert said(time=0.8) == [
        "With Method: Automatic only Strength, Bump Size and Keep Creases count; for other"
        " settings choose Beltrami."
    ]
    assert said(strength=0.5) == said(method="beltrami", time=0.8) == []


def all_filters(mesh, values, **settings):
    """Positions of both kinds, joint positions, and signals, in one list."""
    signal = core.BeltramiMeshSettings(**settings)
    joint = core.beltrami_joint(mesh, values, signal)
    kinds = [
        core.denoise_geometry(mesh, kernel_of_paper(filtered=filtered, **settings))
        for filtered in ("normals", "positions")
    ]
    return [*kinds, joint[0]], [joint[1], core.beltrami_vertex_signal(mesh, values, signal)]


def test_filters_move_scale_and_reorder_with_the_mesh():
    mesh = noisy(*cube(8), 0.1)
    values = np.random.default_rng(0).random((mesh.vertex_count, 2))
    places, signals = all_filters(mesh, values)
    size = mesh.mean_edge_length
    turn, shift = rotation(4), np.array([30.0, -20.0, 7.0])
    moved = core.TriangleMesh(40.0 * mesh.vertices @ turn.T + shift, mesh.faces)
    for old, new in zip(places, all_filters(moved, values)[0], strict=True):
        assert np.allclose((new - shift) @ turn / 40.0, old, atol=2e-3 * size)
    for old, new in zip(signals, all_filters(moved, values)[1], strict=True):
        assert np.allclose(new, old, atol=1e-6)
    vertices, faces, v, _ = shuffled(mesh.vertices, mesh.faces)
    mixed = np.empty_like(values)
    mixed[v] = values
    other = all_filters(core.TriangleMesh(vertices, faces), mixed)
    for old, new in zip(places, other[0], strict=True):
        assert np.allclose(new[v], old, atol=2e-3 * size)
    for old, new in zip(signals, other[1], strict=True):
        assert np.allclose(new[v], old, atol=1e-6)


def test_zero_time_returns_the_input_bit_for_bit():
    mesh = noisy(*cube(6), 0.2)
    values = np.random.default_rng(0).random(mesh.vertex_count).astype(np.float32)
    places, signals = all_filters(mesh, values, time=0)
    for out in places:
        assert np.array_equal(out, mesh.vertices)
        assert out is not mesh.vertices
    for out in signals:
        assert out.dtype == np.float32
        assert np.array_equal(out, values)


def test_masks_keep_bit_for_bit_and_mix():
    mesh = noisy(*cube(8), 0.2)
    values = np.random.default_rng(0).random((mesh.vertex_count, 2))
    mask = (mesh.vertices[:, 0] > 0).astype(float)
    kept = mask == 0
    for filtered in ("normals", "positions"):
        settings = kernel_of_paper(filtered=filtered)
        out = core.denoise_geometry(mesh, settings, mask=mask)
        assert np.array_equal(out[kept], mesh.vertices[kept])
        assert np.linalg.norm(out - mesh.vertices, axis=1)[~kept].mean() > 0.05
    full = core.beltrami_joint(mesh, values)
    out = core.beltrami_joint(mesh, values, mask=mask)
    for new, old, filtered in zip(out, (mesh.vertices, values), full, strict=True):
        assert np.array_equal(new[kept], old[kept])
        assert np.allclose(new[~kept], filtered[~kept], atol=1e-12)
    half = core.beltrami_vertex_signal(mesh, values, mask=np.full(len(values), 0.5))
    assert np.allclose(half, 0.5 * (values + core.beltrami_vertex_signal(mesh, values)))
    once = kernel_of_paper(repeat=1)
    moves = [
        np.linalg.norm(core.denoise_geometry(mesh, once, mask=m) - mesh.vertices, axis=1).mean()
        for m in (np.full(len(values), 0.5), None)
    ]
    assert 0.4 < moves[0] / moves[1] < 0.8
    corners = core.beltrami_corner_signal(mesh, values[mesh.faces], mask=mask)
    at_kept = kept[mesh.faces]
    assert np.array_equal(corners[at_kept], values[mesh.faces][at_kept])
    assert not np.array_equal(corners[~at_kept], values[mesh.faces][~at_kept])


def test_inputs_are_never_modified():
    mesh = noisy(*cube(4), 0.2)
    values = np.random.default_rng(0).random((mesh.vertex_count, 2))
    before, painted = mesh.vertices.copy(), values.copy()
    all_filters(mesh, values)
    assert np.array_equal(mesh.vertices, before)
    assert np.array_equal(values, painted)


def test_meshes_with_faults_are_filtered():
    # Two sheets joined along an edge by a third (not a surface there), a zero-area face, one
    # with a repeated vertex, two corners at the same place, a loose vertex far away.
    sheet, faces = grid(6, 6)
    rng = np.random.default_rng(0)
    wall = sheet[:, [0, 2, 1]] + [0, 3, 0]
    vertices = np.concatenate([sheet, wall, [[2, 3, 0], [900, 900, 900]]])
    vertices[: 2 * len(sheet)] += rng.normal(scale=0.05, size=(2 * len(sheet), 3))
    first = len(sheet)
    extra = [[14, 15, 14], [14, 21, 28], [2 * first, 17, 24]]
    faces = np.concatenate([faces, faces + first, extra])
    _, index = np.unique(np.round(vertices), axis=0, return_inverse=True)
    faces = index.reshape(-1)[faces]
    joined = np.empty((index.max() + 1, 3))
    joined[index.reshape(-1)] = vertices
    mesh = core.TriangleMesh(joined, faces)
    loose = np.flatnonzero(np.bincount(faces.reshape(-1), minlength=len(joined)) == 0)
    assert len(loose) == 1
    assert (mesh.areas == 0).sum() >= 2
    assert (mesh.twins < 0).sum() > 24
    values = rng.random((len(joined), 2))
    places, signals = all_filters(mesh, values)
    for new, old in [*((p, joined) for p in places), *((s, values) for s in signals)]:
        assert np.isfinite(new).all()
        assert np.array_equal(new[loose], old[loose])
        assert not np.array_equal(new, old)
    for out in signals:
        assert out.min() >= values.min()
        assert out.max() <= values.max()


def test_components_do_not_mix():
    vertices, faces = grid(8, 8)
    mesh = core.TriangleMesh(
        np.concatenate([vertices, vertices + [0, 0, 0.01]]),
        np.concatenate([faces, faces + len(vertices)]),
    )
    values = np.repeat([0.0, 1.0], len(vertices))
    settings = core.BeltramiMeshSettings(beta=0.0)
    assert np.array_equal(core.beltrami_vertex_signal(mesh, values, settings), values)


@pytest.mark.parametrize("scale", [1e-30, 1e20, 1e30])
def test_values_of_any_size_stay_finite(scale):
    mesh = core.TriangleMesh(*grid(6, 6))
    values = scale * np.random.default_rng(0).random(mesh.vertex_count)
    out = core.beltrami_vertex_signal(mesh, values)
    assert np.isfinite(out).all()
    assert values.min() <= out.min() <= out.max() <= values.max()


@pytest.mark.parametrize(
    "apply",
    [
        lambda mesh, values, ask: core.beltrami_vertex_signal(mesh, values, progress=ask),
        lambda mesh, values, ask: core.beltrami_corner_signal(
            mesh, values[mesh.faces], progress=ask
        ),
        lambda mesh, values, ask: core.beltrami_joint(mesh, values, progress=ask),
        lambda mesh, values, ask: core.denoise_geometry(mesh, progress=ask),
        lambda mesh, values, ask: core.denoise_geometry(mesh, kernel_of_paper(), progress=ask),
    ],
)
def test_progress_rises_and_cancels(apply):
    mesh = noisy(*cube(10), 0.2)
    values = np.random.default_rng(0).random((mesh.vertex_count, 1))
    seen = []

    def ask(fraction, message):
        seen.append(fraction)
        return True

    apply(mesh, values, ask)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    assert len(seen) > 2
    with pytest.raises(core.Cancelled):
        apply(mesh, values, lambda fraction, message: fraction < 0.3)


def test_bad_input_is_refused_with_a_name():
    mesh = core.TriangleMesh(*cube(3))
    values = np.zeros((mesh.vertex_count, 2))
    with pytest.raises(core.InvalidSignal, match="shape"):
        core.beltrami_vertex_signal(mesh, values[1:])
    with pytest.raises(core.InvalidSignal, match="NaN"):
        core.beltrami_vertex_signal(mesh, np.where(values == 0, np.nan, 0))
    with pytest.raises(core.InvalidSignal, match="type"):
        core.beltrami_vertex_signal(mesh, values.astype(int))
    with pytest.raises(core.InvalidSignal, match="NaN"):
        core.beltrami_joint(mesh, np.where(values == 0, np.nan, 0))
    with pytest.raises(core.InvalidSignal, match="shape"):
        core.beltrami_corner_signal(mesh, values)
    with pytest.raises(core.InvalidSignal, match="0 to 1"):
        core.denoise_geometry(mesh, mask=np.full(mesh.vertex_count, 2.0))
    for bad in ({"time": -1}, {"time": np.nan}, {"beta": -1}, {"iterations": 0},
                {"filtered": "faces"}):  # fmt: skip
        with pytest.raises(core.InvalidSettings, match=next(iter(bad))):
            core.BeltramiGeometrySettings(**bad)


def test_the_text_of_filtered_positions_names_the_settings_that_count():
    mesh = noisy(*subdivide(*cube()), 0.1)
    settings = kernel_of_paper(filtered="positions")
    before, found = core.denoise_geometry(mesh, settings), set()
    described = settings_module.describe(core.BeltramiGeometrySettings)
    for name in described.keys() - {"method", "filtered"}:
        value = getattr(settings, name)
        value = value + 1 if isinstance(value, int) else value / 2 + 0.1
        other = replace(settings, **{name: value})
        if (core.denoise_geometry(mesh, other) != before).any():
            found.add(name)
    text = described["filtered"][2].choices["positions"]
    listed = text.rpartition("Only ")[2].removesuffix(" matter then").lower()
    assert set(listed.replace(" and ", ", ").split(", ")) == found
