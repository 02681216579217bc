# SPDX-License-Identifier: GPL-3.0-or-later
"""Multigrid on a sheet: against a direct solve, and on the smallest and oddest of charts."""

import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.linalg
from shock_filter.core import SolverError
from shock_filter.core.base import parallel
from shock_filter.core.base.progress import reporting
from shock_filter.core.elements import multigrid, seam_block
from shock_filter.core.elements.coarsening import coarsened
from shock_filter.core.elements.multigrid import SheetSolver
from shock_filter.core.elements.sheet_matrix import SheetMatrix, block_rows, kinds_of, without_held
from shock_filter.core.errors import Cancelled

CORNERS = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
SIGNS = 2 * CORNERS - 1


def cell_matrices(stretch, angle, alpha):
    """Bilinear stiffness plus `alpha` times mass of cells with a metric: (k, 4, 4)."""
    c, s = np.cos(angle), np.sin(angle)
    rows, columns = stretch * c * c + s * s / stretch, stretch * s * s + c * c / stretch
    across = (stretch - 1 / stretch) * c * s
    same = (CORNERS[:, None] == CORNERS) / 3 + (CORNERS[:, None] != CORNERS) / 6
    upright = np.outer(SIGNS[:, 0], SIGNS[:, 0]) * same[..., 1]
    flat = np.outer(SIGNS[:, 1], SIGNS[:, 1]) * same[..., 0]
    mixed = (np.outer(SIGNS[:, 0], SIGNS[:, 1]) + np.outer(SIGNS[:, 1], SIGNS[:, 0])) / 4
    stiffness = rows[:, None, None] * upright + columns[:, None, None] * flat
    return stiffness + across[:, None, None] * mixed + alpha * same.prod(axis=-1)


def sheet(labels, alpha=0.01, most=3.0, points=True, seed=0):
    """Make the matrix of charts that `labels` (rows, columns) draws, joined along their ends."""
    random = np.random.default_rng(seed)
    labels = np.pad(np.asarray(labels, dtype=np.int32), 1, constant_values=-1)
    rows, columns = labels.shape
    quads = np.stack([labels[:-1, :-1], labels[:-1, 1:], labels[1:, :-1], labels[1:, 1:]])
    y, x = np.nonzero((quads[0] >= 0) & (quads == quads[0]).all(axis=0))
    nodes = (y[:, None] + CORNERS[:, 0]) * columns + x[:, None] + CORNERS[:, 1]
    stretch = np.exp(random.uniform(0, np.log(most), len(y)))
    local = cell_matrices(stretch, random.uniform(0, np.pi, len(y)), alpha)
    stencil = np.zeros((4, rows, columns))
    for k, (i, j) in enumerate([(0, 1), (1, 2), (0, 2), (0, 3)]):
        np.add.at(stencil[k].reshape(-1), nodes[:, i], local[:, i, j])
    for k, (i, j) in [(0, (2, 3)), (2, (1, 3))]:
        np.add.at(stencil[k].reshape(-1), nodes[:, i], local[:, i, j])
    screen = np.zeros(rows * columns)
    np.add.at(screen, nodes, np.full((len(y), 4), alpha / 4))
    screen[labels.reshape(-1) >= 0] += 0.1 * alpha
    # Ends of charts: nodes that are not corners of four cells. Each is coupled with the next and
    # with a point on a seam; the points form a chain, which thus joins all charts.
    around = np.bincount(nodes.reshape(-1), minlength=rows * columns)
    ends = np.flatnonzero((labels.reshape(-1) >= 0) & (around < 4))
    ends = ends[np.lexsort((ends, labels.reshape(-1)[ends]))]
    count = len(ends) // 2 if points else 0
    size = rows * columns + count
    seam = np.concatenate([np.sort(ends), np.arange(rows * columns, size)]).astype(np.int32)
    number = np.zeros(size, dtype=int)
    number[seam] = np.arange(len(seam))
    same = labels.reshape(-1)[ends[1:]] == labels.reshape(-1)[ends[:-1]]
    pairs = [np.stack([ends[:-1], ends[1:]], axis=1)[same]]
    if count:
        place = np.arange(count) + rows * columns
        both = random.permutation(len(ends))
        pairs += [np.stack([place, ends[both[:count]]], axis=1)]
        pairs += [np.stack([place, ends[both[count : 2 * count]]], axis=1)]
        pairs += [np.stack([place[:-1], place[1:]], axis=1)]
    pairs = number[np.concatenate(pairs)]
    weights = -np.exp(random.uniform(-2, 2, len(pairs)))
    part = scipy.sparse.csr_matrix((weights, (pairs[:, 0], pairs[:, 1])), shape=(len(seam),) * 2)
    part = (part + part.T).tocsr()
    part.sort_indices()
    screen = np.concatenate([screen, np.full(count, alpha)])
    return SheetMatrix(stencil.astype(np.float32), labels, screen, seam,
                       part.indptr.astype(np.int32), part.indices.astype(np.int32),
                       part.data)  # fmt: skip


def assembled(matrix):
    """The same as a scipy matrix over all n numbers, and which of them are unknowns."""
    rows, columns = matrix.labels.shape
    n = len(matrix.screen)
    shape = (len(matrix.seam),) * 2
    seam = scipy.sparse.csr_matrix((matrix.values, matrix.columns_, matrix.start), shape).tocoo()
    places, others, values = [matrix.seam[seam.row]], [matrix.seam[seam.col]], [seam.data]
    for part, (dy, dx) in zip(matrix.stencil, [(0, 1), (1, -1), (1, 0), (1, 1)], strict=True):
        y, x = np.nonzero(part)
        i, j = y * columns + x, (y + dy) * columns + x + dx
        places += [i, j]
        others += [j, i]
        values += [part[y, x], part[y, x]]
    entries = np.concatenate(places), np.concatenate(others)
    off = scipy.sparse.csr_matrix((np.concatenate(values).astype(float), entries), shape=(n, n))
    unknowns = np.concatenate([matrix.labels.reshape(-1) >= 0, np.ones(n - rows * columns, bool)])
    diagonal = matrix.screen - off.sum(axis=1).A1
    return (off + scipy.sparse.diags(np.where(unknowns, diagonal, 1.0))).tocsr(), unknowns


def two_charts(height=60, width=50):
    """Two charts with ragged ends, next to each other."""
    y, x = np.mgrid[:height, :width]
    labels = np.full((height, width), -1)
    labels[np.hypot(y - height / 2, x - width / 4) < width / 4.5] = 0
    labels[abs(y - height / 2) + abs(x - 3 * width / 4) < width / 4.2] = 1
    return labels


def random_values(matrix, channels=3, seed=1):
    _, unknowns = assembled(matrix)
    values = np.random.default_rng(seed).standard_normal((len(matrix.screen), channels))
    return (values * unknowns[:, None]).astype(np.float32)


def solved(matrix, rhs, tolerance=1e-6):
    x = np.zeros_like(rhs)
    report = SheetSolver(matrix).solve(rhs, x, tolerance)
    return x, report


def directly(matrix, rhs):
    whole, unknowns = assembled(matrix)
    solution = scipy.sparse.linalg.spsolve(whole.tocsc(), rhs * unknowns[:, None].astype(float))
    return solution.reshape(rhs.shape)


@pytest.fixture
def small(monkeypatch):
    """Coarsen small sheets, too."""
    monkeypatch.setattr(multigrid, "DIRECT", 20)


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("most", [1.0, 30.0])
def test_the_solution_is_that_of_a_direct_solve(small, channels, most):
    matrix = sheet(two_charts(), most=most)
    assert (matrix.stencil > 0).any() == (most > 1)
    rhs = random_values(matrix, channels)
    x, report = solved(matrix, rhs)
    expected = directly(matrix, rhs)
    assert abs(x - expected).max() <= 1e-4 * abs(expected).max()
    assert report.iterations <= 16
    assert report.residual <= 1e-5  # or what single precision reaches


@pytest.mark.parametrize("alpha", [1e-10, 1e-4, 1e4])
def test_any_fidelity_is_solved_for(small, alpha):
    matrix = sheet(two_charts(), alpha=alpha)
    whole, unknowns = assembled(matrix)
    wanted = random_values(matrix)
    wanted -= wanted[unknowns].mean(axis=0) * unknowns[:, None]
    x, _ = solved(matrix, (whole @ wanted).astype(np.float32), 1e-5)
    off = (x - wanted)[unknowns]
    if alpha < 1e-9:  # next to nothing holds the constant
        off -= off.mean(axis=0)
    assert abs(off).max() < 0.02 * abs(wanted).max()


def test_constants_stay_though_couplings_are_large():
    matrix = sheet(two_charts(), alpha=1e-6)
    matrix = matrix._replace(values=1e6 * matrix.values)
    _, unknowns = assembled(matrix)
    x = unknowns[:, None] * np.float32([0.1, 0.7, 0.9])
    out = np.zeros_like(x)
    SheetSolver(matrix).apply(x, out)
    np.testing.assert_allclose(out, (matrix.screen * unknowns)[:, None] * x, rtol=1e-6)


def test_the_product_is_that_of_the_assembled_matrix(small):
    matrix = sheet(two_charts(), most=20.0)
    whole, unknowns = assembled(matrix)
    x = random_values(matrix)
    out = np.full_like(x, 7.0)
    SheetSolver(matrix).apply(x, out)
    expected = (whole @ x)[unknowns]
    assert abs(out[unknowns] - expected).max() <= 1e-5 * abs(expected).max()
    assert (out[~unknowns] == 7).all()


def test_the_coarse_matrix_is_the_galerkin_product():
    # On a function that the coarse nodes hold, and that is 0 where the chart ends.
    matrix = sheet(np.zeros((41, 37)), most=4.0, points=False)
    kinds = kinds_of(matrix, False)
    coarse = coarsened(matrix, kinds, *block_rows(matrix, kinds))

    def energy(level, step):
        y, x = step * np.indices(level.labels.shape).reshape(2, -1)
        bump = np.clip(1 - abs(y - 20) / 8, 0, 1) * np.clip(1 - abs(x - 18) / 8, 0, 1)
        whole, _ = assembled(level._replace(screen=np.zeros_like(level.screen)))
        return bump @ (whole @ bump)

    assert energy(coarse, 2) == pytest.approx(energy(matrix, 1), rel=1e-5)
    assert coarse.screen.sum() == pytest.approx(matrix.screen.sum())


def test_constants_cost_nothing_on_coarse_levels():
    matrix = sheet(two_charts())
    for _ in range(3):
        kinds = kinds_of(matrix, False)
        before = matrix.screen[assembled(matrix)[1]].sum()
        matrix = coarsened(matrix, kinds, *block_rows(matrix, kinds))
        whole, unknowns = assembled(matrix)
        ones = unknowns.astype(float)
        np.testing.assert_allclose((whole @ ones)[unknowns], matrix.screen[unknowns], atol=1e-9)
        assert matrix.screen[unknowns].sum() == pytest.approx(before)
        assert abs(whole - whole.T).max() < 1e-6
        assert (matrix.screen[~unknowns] == 0).all()


def test_the_cycle_is_symmetric_and_positive(small):
    matrix = sheet(two_charts(), most=10.0)
    solver = SheetSolver(matrix)
    one, two = (np.ascontiguousarray(random_values(matrix, seed=seed).T) for seed in (2, 3))
    from_one, from_two = np.empty_like(one), np.empty_like(one)
    solver.cycle(one, from_one)
    solver.cycle(two, from_two)
    assert np.vdot(two, from_one) == pytest.approx(np.vdot(one, from_two), rel=1e-4)
    assert np.vdot(one, from_one) > 0


def test_results_are_the_same_on_any_number_of_threads(small, monkeypatch):
    monkeypatch.setattr(multigrid, "NODES", 1000)
    matrix = sheet(two_charts(200, 160))
    rhs = random_values(matrix)
    results = []
    for threads in (1, 2, 4):
        monkeypatch.setattr(parallel, "thread_count", lambda count=threads: count)
        results.append(solved(matrix, rhs)[0])
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(results[0], results[2])


def test_a_second_solve_is_as_good_as_the_first(small):
    matrix = sheet(two_charts())
    solver = SheetSolver(matrix)
    for channels in (3, 1, 3):
        rhs = random_values(matrix, channels, seed=channels)
        x = np.zeros_like(rhs)
        first = solver.solve(rhs, x)
        assert solver.solve(rhs, x).iterations == 0
        other = np.zeros_like(rhs)
        assert solver.solve(rhs, other) == first
        np.testing.assert_array_equal(x, other)


ODD = {
    "one node": np.zeros((1, 1)),
    "two nodes": np.zeros((1, 2)),
    "one node wide": np.zeros((500, 1)),
    "two nodes wide": np.zeros((2, 500)),
    "a diagonal": np.where(np.eye(60), 0, -1),
    "specks": np.where(np.indices((30, 30)).sum(axis=0) % 3, -1, np.arange(900).reshape(30, 30)),
    "small charts": np.arange(1600).reshape(40, 40) // 3,
    "at odd places": np.where((np.indices((31, 31)) % 2 == 0).all(axis=0), 0, -1),
    "even size": np.zeros((48, 48)),
}


@pytest.mark.parametrize("name", ODD)
@pytest.mark.parametrize("points", [True, False])
def test_charts_of_any_shape_are_solved_for(small, name, points):
    matrix = sheet(ODD[name], points=points)
    rhs = random_values(matrix)
    x, report = solved(matrix, rhs)
    expected = directly(matrix, rhs)
    assert abs(x - expected).max() <= 1e-4 * abs(expected).max()
    assert report.iterations <= 20


@pytest.mark.parametrize("name", ["two charts", "small charts", "two nodes wide"])
@pytest.mark.parametrize("share", [0.1, 0.9, 1.0])
def test_nodes_that_are_held_are_taken_out(small, name, share):
    matrix = sheet({**ODD, "two charts": two_charts()}[name])
    held = np.random.default_rng(3).random(matrix.labels.shape) < share
    smaller = without_held(matrix, held)
    whole, unknowns = assembled(matrix)
    left = unknowns.copy()
    left[: held.size] &= ~held.reshape(-1)
    rest, its = assembled(smaller)
    np.testing.assert_array_equal(its, left)
    error = abs(rest - whole)[left][:, left]
    assert error.max() <= 1e-5 * whole.diagonal().max()
    rhs = random_values(matrix)
    x, _ = solved(smaller, rhs)
    expected = scipy.sparse.linalg.spsolve(whole[left][:, left].tocsc(), rhs[left].astype(float))
    assert abs(x[left] - expected).max() <= 1e-4 * abs(expected).max()
    assert (x[~left] == 0).all()


def test_a_block_too_large_to_factor_is_solved_for(small, monkeypatch):
    monkeypatch.setattr(seam_block, "MOST", 50)
    for labels in (two_charts(), ODD["small charts"]):
        matrix = sheet(labels)
        rhs = random_values(matrix)
        x, report = solved(matrix, rhs)
        expected = directly(matrix, rhs)
        assert abs(x - expected).max() <= 1e-4 * abs(expected).max()
        assert report.iterations <= 60


def test_no_unknowns_have_the_empty_solution():
    matrix = sheet(np.full((3, 3), -1))
    x, report = solved(matrix, np.zeros((25, 3), dtype=np.float32))
    assert (x == 0).all()
    assert report.iterations == 0


def test_a_zero_right_hand_side_gives_zero():
    matrix = sheet(two_charts())
    x = random_values(matrix)
    SheetSolver(matrix).solve(np.zeros_like(x), x)
    assert (x == 0).all()


def test_a_right_hand_side_that_is_not_finite_is_refused():
    matrix = sheet(two_charts())
    rhs = random_values(matrix)
    rhs[matrix.seam[3]] = np.nan
    with pytest.raises(SolverError, match="not finite"):
        solved(matrix, rhs)


def test_an_indefinite_matrix_is_refused(small):
    matrix = sheet(two_charts())
    with pytest.raises(SolverError, match="not positive definite"):
        SheetSolver(matrix._replace(screen=matrix.screen - 100))
    with pytest.raises(SolverError, match="not positive definite"):
        SheetSolver(matrix._replace(screen=matrix.screen * np.nan))
    with pytest.raises(SolverError, match=r"stopped at|not positive definite"):
        solved(matrix._replace(screen=matrix.screen - 0.02), random_values(matrix))


def test_too_few_iterations_are_an_error(small, monkeypatch):
    matrix = sheet(two_charts(), most=30.0)
    rhs = random_values(matrix)
    x = np.zeros_like(rhs)
    with monkeypatch.context() as few, pytest.raises(SolverError, match="after 2 iterations"):
        few.setattr(multigrid, "LIMIT", 2)
        SheetSolver(matrix).solve(rhs, x, 1e-6)
    again = SheetSolver(matrix).solve(rhs, x, 1e-6)
    assert again.iterations < SheetSolver(matrix).solve(rhs, np.zeros_like(x), 1e-6).iterations


def test_what_is_no_unknown_may_not_be_coupled():
    matrix = sheet(two_charts())
    for place in (matrix.seam[0], np.flatnonzero(matrix.stencil[3].reshape(-1))[0]):
        labels = matrix.labels.copy()
        labels.reshape(-1)[place] = -1
        with pytest.raises(ValueError, match="coupled"):
            SheetSolver(matrix._replace(labels=labels))
    labels = matrix.labels.copy()
    labels[0, 3] = 0
    with pytest.raises(ValueError, match="first and last row"):
        SheetSolver(matrix._replace(labels=labels))


@pytest.mark.parametrize("answers", [1, 5, 40])
def test_a_run_can_be_cancelled(small, answers):
    matrix = sheet(two_charts())
    rhs = random_values(matrix)
    asked = []

    def progress(fraction, message):
        asked.append(fraction)
        return len(asked) < answers

    with pytest.raises(Cancelled), reporting(progress):
        solved(matrix, rhs)
    assert len(asked) == answers
