# SPDX-License-Identifier: GPL-3.0-or-later
import numpy as np
import pytest
import scipy.sparse.linalg
from mesh_matrices import divergence, mass_matrix, stiffness_matrix
from shapes import angles, cube, fan, grid, icosphere
from shock_filter import core
from shock_filter.core.base.progress import reporting
from shock_filter.core.linear import cg
from shock_filter.core.linear.cg import solve
from shock_filter.core.linear.system import LinearSystem
from shock_filter.core.mesh import calculus
from shock_filter.core.shape import fit


@pytest.fixture(scope="module")
def softened():
    """A cube whose edges are rounded by smoothing, and the sharp one."""
    sharp = core.TriangleMesh(*cube(16))
    return core.TriangleMesh(calculus.smooth_vertices(sharp, sharp.vertices, 3), sharp.faces), sharp


@pytest.mark.parametrize("settings", [{}, {"screening_radius": 100.0}])
def test_own_normals_leave_the_surface(softened, settings):
    mesh, _ = softened
    for normals in (mesh.normals, -mesh.normals, np.zeros_like(mesh.normals)):
        out = core.fit_to_normals(mesh, normals, core.FitSettings(**settings))
        assert abs(out - mesh.vertices).max() < 1e-9 * np.ptp(mesh.vertices)


def test_true_normals_bring_the_true_faces_back(softened):
    # A projection of gradients instead of coordinates passes the test above and fails here.
    mesh, sharp = softened
    before = angles(mesh.normals, sharp.normals).mean()
    out = core.fit_to_normals(mesh, sharp.normals, core.FitSettings(screening_radius=30.0))
    after = angles(core.TriangleMesh(out, mesh.faces).normals, sharp.normals).mean()
    assert before > 6
    assert after < before / 6


def test_fit_agrees_with_a_dense_least_squares_solve(monkeypatch):
    monkeypatch.setattr(fit, "TOLERANCE", 1e-10)
    vertices, faces = grid(5, 5, jitter=0.3)
    vertices[:, 2] = np.sin(vertices[:, 0])
    mesh = core.TriangleMesh(vertices, faces)
    rng = np.random.default_rng(0)
    normals = mesh.normals + 0.2 * rng.normal(size=mesh.normals.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # eps |c - c0|^2 + |grad c - w|^2 with w = G - N (N^T G), as dense least squares; the
    # gradient as a matrix, column by column.
    n, radius = mesh.vertex_count, 4.0
    gradient = np.stack([calculus.gradient(mesh, e)[:, 0] for e in np.eye(n)], axis=-1)
    of_coordinates = np.einsum("fxv,vj->fjx", gradient, mesh.scaled_vertices)
    w = of_coordinates - np.einsum("fj,fk,fkx->fjx", normals, normals, of_coordinates)
    root = np.sqrt(mesh.areas)
    rows = [(root[:, None, None] * gradient).reshape(-1, n)]
    right = [(root[:, None, None] * np.moveaxis(w, 1, 2)).reshape(-1, 3)]
    stay = np.sqrt(calculus.lumped_mass(mesh)) / radius
    rows.append(np.diag(stay))
    right.append(stay[:, None] * mesh.scaled_vertices)
    expected = np.linalg.lstsq(np.vstack(rows), np.vstack(right), rcond=None)[0]
    expected = (expected - mesh.scaled_vertices) * mesh.mean_edge_length
    out = core.fit_to_normals(mesh, normals, core.FitSettings(screening_radius=radius))
    assert np.linalg.norm(expected) > 0.5
    assert np.allclose(out - vertices, expected, atol=1e-8)


def test_masked_vertices_stay_bit_for_bit_and_weights_grade(softened):
    mesh, sharp = softened
    mask = np.clip(mesh.vertices[:, 0] / 4, 0, 1)
    out = core.fit_to_normals(mesh, sharp.normals, mask=mask)
    still = mask == 0
    assert np.array_equal(out[still], mesh.vertices[still])
    moved = np.linalg.norm(out - mesh.vertices, axis=1)
    assert moved[mask == 1].max() > 0.2
    assert moved[(mask > 0) & (mask < 0.3)].max() < moved[mask == 1].max()


@pytest.mark.parametrize(
    ("normals", "words"),
    [
        (np.zeros((5, 3)), "shape"),
        (np.ones((320, 3)), "unit"),
        (np.full((320, 3), np.nan), "NaN"),
        (np.ones((320, 2)), "components"),
    ],
)
def test_bad_normals_are_refused(normals, words):
    with pytest.raises(core.InvalidSignal, match=words):
        core.fit_to_normals(core.TriangleMesh(*icosphere(2)), normals)


def refit_system(mesh, screen):
    """What the refit solves, and the same as a scipy matrix with rows of fixed unknowns gone."""
    fixed = screen == 0
    weights = calculus.stiffness_weights(mesh, calculus.cotangents(mesh), screen)
    free = scipy.sparse.diags((~fixed).astype(float))
    matrix = free @ (stiffness_matrix(mesh) + scipy.sparse.diags(screen)) @ free
    matrix = matrix + scipy.sparse.diags(fixed.astype(float))
    return LinearSystem(*weights[:3], screen, weights[3], fixed), matrix.tocsr()


def system(radius, fixed=False):
    mesh = core.TriangleMesh(*icosphere(4))
    screen = calculus.lumped_mass(mesh) / radius**2
    if fixed:
        screen[::7] = 0
    rhs = np.random.default_rng(1).normal(size=(mesh.vertex_count, 3))
    rhs[screen == 0] = 0
    return *refit_system(mesh, screen), rhs


@pytest.mark.parametrize("multigrid", [False, True])
@pytest.mark.parametrize("fixed", [False, True])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-9])
def test_solves_agree_with_a_direct_solver(multigrid, fixed, tolerance):
    equations, full, rhs = system(20.0, fixed)
    x, report = solve(equations, rhs, tolerance, multigrid=multigrid)
    roots = np.sqrt(full.diagonal())[:, None]
    true = np.linalg.norm((rhs - full @ x) / roots) / np.linalg.norm(rhs / roots)
    assert true == pytest.approx(report.residual, rel=1e-3)
    assert true <= tolerance
    expected = scipy.sparse.linalg.spsolve(full.tocsc(), rhs)
    assert np.linalg.norm(x - expected) < 300 * tolerance * np.linalg.norm(expected)
    assert (x[equations.fixed] == 0).all()


def test_multigrid_needs_few_iterations_where_the_diagonal_needs_many():
    equations, _, rhs = system(1e4)
    rhs -= rhs.mean(axis=0)
    _, slow = solve(equations, rhs, 1e-6, multigrid=False)
    _, fast = solve(equations, rhs, 1e-6, multigrid=True)
    assert fast.iterations < 17
    assert fast.iterations < slow.iterations / 4


def test_a_solve_that_does_not_get_there_is_an_error(monkeypatch):
    equations, full, rhs = system(100.0)
    with monkeypatch.context() as patch, pytest.raises(core.SolverError, match="after 2 iter"):
        patch.setattr(cg, "LIMIT", 2)
        solve(equations, rhs, 1e-8, multigrid=True)
    with pytest.raises(core.SolverError, match="finite"):
        solve(equations, np.full_like(rhs, np.nan), 1e-3, multigrid=False)
    diagonal = scipy.sparse.diags(full.diagonal())
    indefinite = LinearSystem.from_csr(3 * full - 2 * diagonal)
    with pytest.raises(core.SolverError, match="stopped at"):
        solve(indefinite, rhs, 1e-3, multigrid=False)


def test_multigrid_takes_over_where_the_diagonal_gives_up(monkeypatch):
    equations, _, rhs = system(50.0)
    expected, _ = solve(equations, rhs, 1e-6, multigrid=True)
    monkeypatch.setattr(cg, "PATIENCE", 10)
    x, report = solve(equations, rhs, 1e-6, multigrid=False)
    assert report.multigrid
    assert report.residual <= 1e-6
    assert np.allclose(x, expected, atol=1e-3 * abs(expected).max())


@pytest.mark.parametrize("share", [0.2, 0.5, 0.95])
def test_multigrid_with_many_fixed_unknowns_stays_small(share):
    mesh = core.TriangleMesh(*icosphere(5))
    screen = calculus.lumped_mass(mesh) / 30.0**2
    screen[np.random.default_rng(0).random(len(screen)) < share] = 0
    rhs = np.ones((mesh.vertex_count, 3)) * (screen > 0)[:, None]
    equations, full = refit_system(mesh, screen)
    x, report = solve(equations, rhs, 1e-6, multigrid=True)
    coarsest = equations.hierarchy._inverse
    assert coarsest is None or len(coarsest) <= 400
    assert report.iterations < 60
    assert np.allclose(full @ x, rhs, atol=1e-3)


def many(vertices, faces, count):
    """Copies of a mesh, side by side."""
    shifts = 5 * np.stack([np.arange(count), 0 * np.arange(count), 0 * np.arange(count)], 1)
    everywhere = (vertices[None] + shifts[:, None]).reshape(-1, 3)
    numbers = faces[None] + len(vertices) * np.arange(count)[:, None, None]
    return core.TriangleMesh(everywhere, numbers.reshape(-1, 3))


def test_multigrid_with_many_components():
    mesh = many(*cube(2), 2000)
    equations, _ = refit_system(mesh, calculus.lumped_mass(mesh) / 100.0**2)
    rhs = np.random.default_rng(0).normal(size=(mesh.vertex_count, 3))
    _, report = solve(equations, rhs, 1e-6, multigrid=True)
    assert report.iterations < 60


def test_triangles_that_next_to_nothing_holds_are_turned_without_a_warning():
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0.3, 0.8, 0]]), np.array([[0, 1, 2]])
    mesh = many(*triangle, 1352)
    normal = np.array([0.1, 0.2, 1.0]) / np.linalg.norm([0.1, 0.2, 1.0])
    out = core.fit_to_normals(
        mesh, np.tile(normal, (1352, 1)), core.FitSettings(screening_radius=1e6)
    )
    turned = core.TriangleMesh(out, mesh.faces).normals
    assert np.degrees(np.arccos(turned @ normal)).max() < 1


@pytest.mark.parametrize("sides", [1000, 4000])
def test_fans_of_needles_are_solved(sides):
    around = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)
    vertices = np.vstack([ring, [[0, 0, 2.0], [0, 0, 0]]])
    i, j = np.arange(sides), (np.arange(sides) + 1) % sides
    faces = np.vstack([np.stack([i, j, 0 * i + sides], 1), np.stack([j, i, 0 * i + sides + 1], 1)])
    mesh = core.TriangleMesh(vertices, faces)
    out = core.sharpen_geometry(mesh, core.GeometrySettings.of_paper())
    assert np.isfinite(out).all()
    assert np.linalg.norm(out - vertices, axis=1).max() < 0.5


@pytest.mark.parametrize("sides", [2000, 20_000])
@pytest.mark.parametrize("height", [0.0, 1.0])
def test_multigrid_solves_fans_of_needles_in_few_iterations(sides, height):
    # The slowest errors are the smooth ones around the rim, where the hub hardly holds anything.
    vertices, faces = fan(sides)
    mesh = core.TriangleMesh(
        vertices + [[0, 0, height]] * (np.arange(sides + 1) == 0)[:, None], faces
    )
    equations, full = refit_system(mesh, calculus.lumped_mass(mesh) / 5.0**2)
    around = np.arange(sides + 1) * 2 * np.pi / sides
    expected = np.column_stack([np.cos(around), np.sin(3 * around), 0 * around])
    x, report = solve(equations, full @ expected, 1e-6, multigrid=True)
    assert report.iterations < 30
    assert abs(x - expected).max() < 1e-3


def test_multigrid_with_many_hubs():
    mesh = many(*fan(150), 200)
    equations, _ = refit_system(mesh, calculus.lumped_mass(mesh) / 100.0**2)
    rhs = np.random.default_rng(0).normal(size=(mesh.vertex_count, 3))
    _, report = solve(equations, rhs, 1e-6, multigrid=True)
    assert report.iterations < 60


def test_needles_are_as_weak_on_the_right_side_as_in_the_matrix():
    # A fan of needles beyond the bound turns as far as one of wider faces.
    tilted = np.array([0.3, 0.0, 1.0]) / np.hypot(0.3, 1.0)
    moves = []
    for sides in (1000, 30_000):
        mesh = core.TriangleMesh(*fan(sides))
        radius = (mesh.areas.sum() / 1e-3) ** 0.5
        settings = core.FitSettings(screening_radius=radius)
        out = core.fit_to_normals(mesh, np.tile(tilted, (sides, 1)), settings)
        moves.append(abs(out - mesh.vertices).max())
    assert moves[1] == pytest.approx(moves[0], rel=0.02)


def test_a_right_side_of_zero_needs_no_iterations():
    equations, _, rhs = system(5.0)
    x, report = solve(equations, 0 * rhs, 1e-3, multigrid=True)
    assert not x.any()
    assert report.iterations == 0


def test_a_column_of_zeros_stays_zero():
    equations, _, rhs = system(5.0)
    rhs[:, 1] = 0
    for multigrid in (False, True):
        x, _ = solve(equations, rhs, 1e-6, multigrid=multigrid)
        assert not x[:, 1].any()
        assert np.isfinite(x).all()


def test_the_advice_on_meshes_stands_under_an_error_of_the_refit(softened, monkeypatch):
    mesh, sharp = softened
    monkeypatch.setattr(fit, "TOLERANCE", 1e-30)
    with pytest.raises(core.SolverError, match=r"is needed\). Repair needle-like faces") as caught:
        core.fit_to_normals(mesh, sharp.normals)
    assert set(caught.value.values) == {"relative", "iterations", "tolerance"}


@pytest.mark.parametrize("multigrid", [False, True])
@pytest.mark.parametrize("columns", [1, 2, 3, 5])
def test_any_number_of_columns(columns, multigrid):
    equations, full, _ = system(20.0, fixed=True)
    rhs = np.random.default_rng(2).normal(size=(len(equations.fixed), columns))
    rhs[equations.fixed] = 0
    x, report = solve(equations, rhs, 1e-8, multigrid=multigrid)
    expected = scipy.sparse.linalg.spsolve(full.tocsc(), rhs).reshape(x.shape)
    assert np.allclose(x, expected, atol=1e-6)
    assert report.residual <= 1e-8
    if columns == 1:
        assert np.array_equal(solve(equations, rhs[:, 0], 1e-8, multigrid=multigrid)[0], x[:, 0])


def test_a_random_definite_matrix_agrees_with_a_dense_solve():
    rng = np.random.default_rng(3)
    factor = np.where(rng.random((60, 60)) < 0.1, rng.normal(size=(60, 60)), 0.0)
    dense = factor @ factor.T + np.eye(60)
    rhs = rng.normal(size=(60, 2))
    x, _ = solve(LinearSystem.from_csr(scipy.sparse.csr_matrix(dense)), rhs, 1e-10)
    assert np.allclose(x, np.linalg.solve(dense, rhs), atol=1e-7)


@pytest.mark.parametrize("multigrid", [False, True])
def test_poisson_with_two_pinned_unknowns(multigrid):
    mesh = core.TriangleMesh(*icosphere(3))
    stiffness = stiffness_matrix(mesh)
    fixed = np.zeros(mesh.vertex_count, dtype=bool)
    fixed[[5, 300]] = True
    known = np.zeros((mesh.vertex_count, 1))
    known[[5, 300], 0] = -1.0, 2.0
    equations = LinearSystem.from_csr(stiffness, fixed)
    missing = equations.residual(known, 0 * known)
    step, report = solve(equations, missing, 1e-9, multigrid=multigrid)
    x = known + step
    inner = ~fixed
    expected = known.copy()
    part = stiffness.toarray()[inner]
    expected[inner] = np.linalg.solve(part[:, inner], -part[:, fixed] @ known[fixed])
    assert np.allclose(x, expected, atol=1e-6)
    assert (x[fixed] == known[fixed]).all()
    assert report.residual <= 1e-9


@pytest.mark.parametrize("multigrid", [False, True])
def test_what_leaves_constants_alone_is_solved_up_to_them(multigrid):
    mesh = many(*icosphere(2), 3)
    stiffness = stiffness_matrix(mesh)
    equations = LinearSystem.from_csr(stiffness)
    parts = np.repeat(np.arange(3), mesh.vertex_count // 3)
    expected = np.random.default_rng(4).normal(size=(mesh.vertex_count, 2))
    for part in range(3):
        expected[parts == part] -= expected[parts == part].mean(axis=0)
    x, _ = solve(equations, stiffness @ expected, 1e-9, multigrid=multigrid)
    for part in range(3):
        x[parts == part] -= x[parts == part].mean(axis=0)
    assert np.allclose(x, expected, atol=1e-6)
    with pytest.raises(core.SolverError, match="stopped at"):
        solve(equations, 1.0 + stiffness @ expected, 1e-9, multigrid=multigrid)


def test_rounding_of_row_sums_is_no_screen():
    # A screen of 1e-16 would hold constants, and blow a right-hand side up that has a mean.
    random = np.random.default_rng(3)
    weights = scipy.sparse.random(40, 40, 0.2, random_state=random)
    weights = weights + weights.T
    weights.setdiag(0)
    sums = np.asarray(weights.sum(axis=1)).reshape(-1)
    assert (sums[weights.getnnz(axis=1) == 0] == 0).all()
    sums[sums == 0] = 1.0
    laplacian = scipy.sparse.diags(sums) - weights
    screen = LinearSystem.from_csr(laplacian).screen
    joined = weights.getnnz(axis=1) > 0
    assert joined.sum() > 20
    assert (screen[joined] == 0).all()


def test_mask_weights_next_to_0_hold_as_0_does(softened):
    mesh, _ = softened
    mask = np.where(mesh.vertices[:, 0] > 0, 1.0, 1e-7)
    targets = np.roll(mesh.normals, 1, axis=1)
    found = core.fit_to_normals(mesh, targets, core.FitSettings(screening_radius=5.0), mask=mask)
    np.testing.assert_array_equal(found[mask < 1], mesh.vertices[mask < 1])
    assert (found[mask == 1] != mesh.vertices[mask == 1]).any()


def test_a_matrix_that_cannot_be_solved_is_refused():
    for matrix, words in (
        ([[1.0, 2.0], [0.0, 1.0]], "symmetric"),
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], "square"),
        ([[np.nan, 0.0], [0.0, 1.0]], "finite"),
        ([[1.0, 0.0], [0.0, 0.0]], "Row 1"),
    ):
        with pytest.raises(core.SolverError, match=words):
            LinearSystem.from_csr(scipy.sparse.csr_matrix(matrix))


@pytest.mark.parametrize("columns", [1, 2, 3])
@pytest.mark.parametrize("precise", [False, True])
def test_one_thread_alone_gives_the_bits_of_several(monkeypatch, columns, precise):
    mesh = core.TriangleMesh(*grid(120, 110, jitter=0.2))  # 13 chunks
    matrix = LinearSystem.from_csr(mass_matrix(mesh) + 400.0 * stiffness_matrix(mesh))
    rhs = np.random.default_rng(1).normal(size=(mesh.vertex_count, columns))
    alone, of_one = solve(matrix, rhs, 1e-7, precise=precise)
    monkeypatch.setattr(cg, "ALONE", 0)
    shared, of_several = solve(matrix, rhs, 1e-7, precise=precise)
    assert of_one == of_several
    assert of_one.iterations > 2 * cg._AT_ONCE
    np.testing.assert_array_equal(alone, shared)


def test_one_thread_alone_notices_what_is_not_positive_definite(monkeypatch):
    monkeypatch.setattr(cg, "PATIENCE", 50)
    monkeypatch.setattr(cg, "LIMIT", 0)
    matrix = scipy.sparse.csr_matrix([[1.0, 2.0], [2.0, 1.0]])
    with pytest.raises(core.SolverError, match="stopped at"):
        solve(LinearSystem.from_csr(matrix), np.array([1.0, -1.0]), 1e-9)


@pytest.mark.parametrize("shape", ["sphere", "plane"])
def test_the_heat_method_measures_distances(shape):
    # Crane, Weischedel, Wardetzky 2013: heat for a short time, normalise its gradient, integrate.
    vertices, faces = icosphere(4) if shape == "sphere" else grid(40, 40, jitter=0.2)
    mesh = core.TriangleMesh(vertices, faces)
    source = 0 if shape == "sphere" else int(np.argmin(abs(vertices - [20, 20, 0]).sum(axis=1)))
    stiffness, mass = stiffness_matrix(mesh), mass_matrix(mesh)
    spot = np.zeros(mesh.vertex_count)
    spot[source] = 1.0
    heat, _ = solve(LinearSystem.from_csr(mass + 4.0 * stiffness), spot, 1e-12)
    away = -calculus.gradient(mesh, heat)
    away /= np.linalg.norm(away, axis=2, keepdims=True)
    sources = divergence(mesh, away[:, 0])
    distance, _ = solve(LinearSystem.from_csr(stiffness, spot > 0), -sources[:, None], 1e-8)
    distance = distance[:, 0] * mesh.mean_edge_length
    if shape == "sphere":
        expected = np.arccos(np.clip(vertices @ vertices[source], -1, 1))
    else:
        expected = np.linalg.norm(vertices - vertices[source], axis=1)
    assert abs(distance - expected).max() < 0.05 * expected.max()


def test_progress_of_a_solve_rises():
    seen = []
    equations, _, rhs = system(30.0)
    for multigrid in (True, False):
        seen.clear()
        with reporting(lambda fraction, message: seen.append((fraction, message))):
            solve(equations, rhs, 1e-4, multigrid=multigrid, message="Solving it")
        fractions = [fraction for fraction, _ in seen]
        assert fractions == sorted(fractions)
        assert len({fraction for fraction, message in seen if message == "Solving it"}) > 5


def test_the_local_refit_is_that_of_the_whole_mesh_and_leaves_what_is_far_bit_for_bit():
    # A long roof with one soft ridge.
    n = 90
    x, y = np.divmod(np.arange(n * n, dtype=float), n)
    a = np.flatnonzero((x < n - 1) & (y < n - 1))
    faces = np.stack([[a, a + n, a + 1], [a + 1, a + n, a + n + 1]]).swapaxes(1, 2).reshape(-1, 3)
    sharp = core.TriangleMesh(np.stack([x, y, -abs(x - 45)], axis=1), faces)
    soft = sharp.moved_to(calculus.smooth_vertices(sharp, sharp.vertices, 2))
    inside = (soft.vertices[:, 1] > 2) & (soft.vertices[:, 1] < n - 3)
    near = (abs(x - 45) < 5)[faces].all(axis=1) & inside[faces].all(axis=1)
    normals = np.where(near[:, None], sharp.normals, soft.normals)
    settings = core.FitSettings(screening_radius=5.0)
    mask = np.clip(y / 20, 0, 1)
    for given in (None, mask):
        whole, _ = fit.displacement(soft, normals, settings, given, 13, 0.95)
        local = fit.local_displacement(soft, normals, settings, given, 13, 0.95)
        moves = np.linalg.norm(whole, axis=1)
        assert np.linalg.norm(whole - local, axis=1).max() < 0.02 * moves.max()
        far = abs(x - 45) > 5 + 3 * 5 + 3
        assert far.sum() > 0.4 * len(x)
        assert (local[far] == 0).all()
