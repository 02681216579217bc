# SPDX-License-Identifier: GPL-3.0-or-later
import numpy as np
import pytest
import scipy.sparse.linalg
from shapes import angles, cube, grid, icosphere
from shock_filter import core
from shock_filter.core.base.parallel import Progress
from shock_filter.core.filters import fit
from shock_filter.core.linear import cg as solve
from shock_filter.core.mesh import calculus


@pytest.fixture(scope="module")
def softened():
    """A cube whose edges are rounded by smoothing, and the sharp one."""
    sharp = core.TriangleMesh(*cube(16))
    return core.TriangleMesh(calculus.smooth_vertices(sharp, sharp.vertices, 3), sharp.faces), sharp


@pytest.mark.parametrize("settings", [{}, {"screening_radius": 100.0}, {"fidelity": 1.0}])
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


def test_fidelity_is_epsilon_at_unit_area(softened):
    mesh, sharp = softened
    radius = 6.0
    epsilon = mesh.areas.sum() / radius**2
    a = core.fit_to_normals(mesh, sharp.normals, core.FitSettings(screening_radius=radius))
    b = core.fit_to_normals(mesh, sharp.normals, core.FitSettings(fidelity=epsilon))
    assert np.allclose(a, b, atol=1e-6)


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


def system(radius, fixed=False):
    mesh = core.TriangleMesh(*icosphere(4))
    screen = calculus.lumped_mass(mesh) / radius**2
    if fixed:
        screen[::7] = 0
    right = np.random.default_rng(1).normal(size=(mesh.vertex_count, 3))
    right[screen == 0] = 0
    return fit.screened_stiffness(mesh, screen), right


@pytest.mark.parametrize("multigrid", [False, True])
@pytest.mark.parametrize("fixed", [False, True])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-9])
def test_solves_agree_with_a_direct_solver(multigrid, fixed, tolerance):
    matrix, right = system(20.0, fixed)
    x, report = solve.solve(matrix, right, tolerance, multigrid=multigrid)
    full = matrix.scipy()
    roots = np.sqrt(full.diagonal())[:, None]
    true = np.linalg.norm((right - full @ x) / roots) / np.linalg.norm(right / roots)
    assert true == pytest.approx(report.residual, rel=1e-3)
    assert true <= tolerance
    expected = scipy.sparse.linalg.spsolve(full.tocsc(), right)
    assert np.linalg.norm(x - expected) < 300 * tolerance * np.linalg.norm(expected)
    assert (x[matrix.screen == 0] == 0).all()


def test_multigrid_needs_few_iterations_where_the_diagonal_needs_many():
    matrix, right = system(1e4)
    right -= right.mean(axis=0)
    _, slow = solve.solve(matrix, right, 1e-6, multigrid=False)
    _, fast = solve.solve(matrix, right, 1e-6, multigrid=True)
    assert fast.iterations < 40
    assert fast.iterations < slow.iterations / 4


def test_a_solve_that_does_not_get_there_is_an_error():
    matrix, right = system(100.0)
    with pytest.raises(core.SolverError, match="after 2 iterations"):
        solve.solve(matrix, right, 1e-8, multigrid=True, limit=2)
    with pytest.raises(core.SolverError, match="finite"):
        solve.solve(matrix, np.full_like(right, np.nan), 1e-3, multigrid=False)
    indefinite = solve.ScreenedLaplacian(
        matrix.start, matrix.columns, 3 * matrix.weights, matrix.screen, matrix.diagonal
    )
    with pytest.raises(core.SolverError, match="stopped at"):
        solve.solve(indefinite, right, 1e-3, multigrid=False)


def test_multigrid_takes_over_where_the_diagonal_gives_up(monkeypatch):
    matrix, right = system(50.0)
    expected, _ = solve.solve(matrix, right, 1e-6, multigrid=True)
    monkeypatch.setattr(solve, "PATIENCE", 10)
    x, report = solve.solve(matrix, right, 1e-6, multigrid=False)
    assert report.multigrid
    assert report.residual <= 1e-6
    assert np.allclose(x, expected, atol=1e-3 * abs(expected).max())


@pytest.mark.parametrize("share", [0.2, 0.5, 0.95])
def test_multigrid_with_many_fixed_unknowns_stays_small(share):
    mesh = core.TriangleMesh(*icosphere(5))
    screen = calculus.lumped_mass(mesh) / 30.0**2
    screen[np.random.default_rng(0).random(len(screen)) < share] = 0
    right = np.ones((mesh.vertex_count, 3)) * (screen > 0)[:, None]
    matrix = fit.screened_stiffness(mesh, screen)
    hierarchies = []
    real = solve.Multigrid
    solve.Multigrid = lambda *a: hierarchies.append(real(*a)) or hierarchies[-1]
    try:
        x, report = solve.solve(matrix, right, 1e-6, multigrid=True)
    finally:
        solve.Multigrid = real
    assert hierarchies[0]._inverse is None or len(hierarchies[0]._inverse) <= 400
    assert report.iterations < 60
    assert np.allclose(matrix.scipy() @ x, right, atol=1e-3)


def test_multigrid_with_many_components():
    vertices, faces = cube(2)
    count = 2000
    shifts = 5 * np.stack([np.arange(count), 0 * np.arange(count), 0 * np.arange(count)], 1)
    everywhere = (vertices[None] + shifts[:, None]).reshape(-1, 3)
    faces = (faces[None] + len(vertices) * np.arange(count)[:, None, None]).reshape(-1, 3)
    mesh = core.TriangleMesh(everywhere, faces)
    matrix = fit.screened_stiffness(mesh, calculus.lumped_mass(mesh) / 100.0**2)
    right = np.random.default_rng(0).normal(size=(mesh.vertex_count, 3))
    _, report = solve.solve(matrix, right, 1e-6, multigrid=True)
    assert report.iterations < 60


@pytest.mark.parametrize("sides", [1000, 4000])
def test_fans_of_needles_are_solved(sides):
    around = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)
    vertices = np.vstack([ring, [[0, 0, 2.0], [0, 0, 0]]])
    i, j = np.arange(sides), (np.arange(sides) + 1) % sides
    faces = np.vstack([np.stack([i, j, 0 * i + sides], 1), np.stack([j, i, 0 * i + sides + 1], 1)])
    mesh = core.TriangleMesh(vertices, faces)
    out = core.sharpen_geometry(mesh)
    assert np.isfinite(out).all()
    assert np.linalg.norm(out - vertices, axis=1).max() < 0.5


def test_a_right_side_of_zero_needs_no_iterations():
    matrix, right = system(5.0)
    x, report = solve.solve(matrix, 0 * right, 1e-3, multigrid=True)
    assert not x.any()
    assert report.iterations == 0


def test_a_column_of_zeros_stays_zero():
    matrix, right = system(5.0)
    right[:, 1] = 0
    for multigrid in (False, True):
        x, _ = solve.solve(matrix, right, 1e-6, multigrid=multigrid)
        assert not x[:, 1].any()
        assert np.isfinite(x).all()


def test_progress_of_a_solve_rises():
    seen = []
    progress = Progress(lambda fraction, message: seen.append(fraction) or True)
    matrix, right = system(30.0)
    solve.solve(matrix, right, 1e-4, multigrid=True, progress=progress)
    solve.solve(matrix, right, 1e-4, multigrid=False, progress=progress)
    assert len(seen) > 20
    assert min(seen) >= 0 and max(seen) <= 1
