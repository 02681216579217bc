# SPDX-License-Identifier: GPL-3.0-or-later
"""Own sparse matrices, graphs and searches, beside those of scipy."""

import time

import numpy as np
import pytest
import scipy.ndimage
import scipy.sparse
import scipy.sparse.linalg
import scipy.spatial
from scipy.sparse import csgraph
from shock_filter.core.base.progress import Cancelled, reporting
from shock_filter.core.grid.nearest import nearest_marked
from shock_filter.core.mesh.nearest import nearest_point, point_tree, points_within
from shock_filter.core.sparse import matrix as own
from shock_filter.core.sparse.components import connected_components
from shock_filter.core.sparse.factors import factored
from shock_filter.core.sparse.ordering import TooDense, minimum_degree


@pytest.mark.parametrize(
    ("count", "links"), [(0, 0), (1, 0), (1, 3), (40, 0), (40, 15), (40, 40), (4000, 3000)]
)
def test_components_and_their_order_are_those_of_scipy(count, links):
    one, other = np.random.default_rng(links).integers(0, max(count, 1), (2, links))
    found, labels = connected_components(count, one, other)
    if count == 0:
        assert found == 0 and len(labels) == 0
        return
    graph = scipy.sparse.coo_array((np.ones(links), (one, other)), (count, count))
    expected, their_labels = csgraph.connected_components(graph, directed=False)
    assert found == expected
    np.testing.assert_array_equal(labels, their_labels)


def test_a_long_path_is_one_component():
    steps = np.arange(99_999)
    assert connected_components(100_000, steps + 1, steps)[0] == 1
    assert connected_components(100_000, steps[::-1], steps[::-1] + 1)[0] == 1


@pytest.mark.parametrize("share", [0.0, 0.002, 0.05, 0.5, 1.0])
@pytest.mark.parametrize("shape", [(1, 1), (1, 90), (90, 1), (67, 83)])
def test_the_nearest_marked_pixels_are_those_of_scipy(shape, share):
    marked = np.random.default_rng(5).random(shape) < share
    found = nearest_marked(marked)
    if not marked.any():
        assert (found == -1).all()
        return
    indices = scipy.ndimage.distance_transform_edt(
        ~marked, return_distances=False, return_indices=True
    )
    np.testing.assert_array_equal(found, np.ravel_multi_index(tuple(indices), shape))


def clouds():
    random = np.random.default_rng(11)
    even = random.random((700, 3))
    return {
        "one": even[:1],
        "few": even[:7],
        "even": even,
        "uneven": np.concatenate([1e-6 * even, even[:30], 1e5 * even[:9]]),
        "in a plane": even * [1.0, 1.0, 0.0],
        "in a grid": np.stack(np.meshgrid(*3 * [np.arange(8.0)]), axis=-1).reshape(-1, 3),
        "in one place": np.zeros((500, 3)),
        "each twice": np.repeat(even, 2, axis=0),
    }


def places_beside(points):
    random = np.random.default_rng(12)
    near = points[random.integers(0, len(points), 200)]
    return np.concatenate([near, near + 0.5, random.normal(size=(100, 3))])


@pytest.mark.parametrize("name", clouds())
def test_the_nearest_point_is_the_lowest_of_the_nearest(name):
    points = clouds()[name]
    places = places_beside(points)
    distances, numbers = nearest_point(point_tree(points), places)
    squares = ((points - places[:, None]) ** 2).sum(axis=2)
    np.testing.assert_array_equal(numbers, np.argmin(squares, axis=1))
    np.testing.assert_allclose(distances, scipy.spatial.cKDTree(points).query(places)[0], 1e-14)


def test_points_out_of_reach_are_not_found():
    tree = point_tree(clouds()["even"])
    places = np.array([[0.5, 0.5, 0.5], [3.0, 0.5, 0.5], [50.0, 0.5, 0.5]])
    distances, numbers = nearest_point(tree, places, 2.5)
    assert (numbers >= 0).tolist() == np.isfinite(distances).tolist() == [True, True, False]
    assert nearest_point(point_tree(np.zeros((0, 3))), places)[1].tolist() == [-1, -1, -1]
    assert len(nearest_point(tree, places[:0])[0]) == 0


def test_many_points_in_one_place_are_found_quickly():
    points = np.zeros((100_000, 3))
    # If each looked at all others, that would be 1e10 steps.
    assert not nearest_point(point_tree(points), points)[1].any()


def bad_order(count):
    """Numbers of which the ends and the middle tell little: each choice would part off two."""
    place = np.arange(count)
    values = np.full(count, count)
    for low in range(0, count // 2, 2):
        values[place[[low, -1]]] = low, low + 1
        place[[low + 1, -1]] = place[[-1, low + 1]]
    return values


def test_no_order_of_points_takes_much_longer_than_others():
    times = []
    for values in (np.random.default_rng(1).permutation(200_000), bad_order(200_000)):
        points = np.zeros((len(values), 3))
        points[:, 1] = values
        point_tree(points[:99])
        start = time.process_time()
        tree = point_tree(points)
        times.append(time.process_time() - start)
        distances, numbers = nearest_point(tree, points[::1000])
        assert not distances.any() and (points[numbers] == points[::1000]).all()
    # If each choice parted off two, that would be 1e10 steps: a hundred times as long.
    assert times[1] < 10 * times[0]


def test_a_tree_of_points_asks_whether_to_go_on():
    asked = []
    with pytest.raises(Cancelled), reporting(lambda *_: asked.append(1) or len(asked) < 4):
        point_tree(np.random.default_rng(2).random((10_000, 3)))
    assert len(asked) == 4


@pytest.mark.parametrize("distance", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("name", clouds())
def test_the_points_within_a_distance_are_those_of_scipy(name, distance):
    points = clouds()[name]
    places = places_beside(points)
    start, numbers = points_within(point_tree(points), places, distance)
    expected = scipy.spatial.cKDTree(points).query_ball_point(places, distance)
    for i, near in enumerate(expected):
        assert sorted(numbers[start[i] : start[i + 1]].tolist()) == sorted(near)


SHAPES = [(0, 0, 0), (1, 1, 1), (3, 5, 0), (40, 30, 25), (3000, 2000, 2500)]
"""Rows, columns and columns of the other factor."""


def triples(rows, columns, seed, per_row=3.0):
    random = np.random.default_rng(seed)
    count = int(per_row * rows) if columns else 0
    values = random.integers(-8, 9, count) / 8  # some of them 0, and sums that come to 0
    of, to = (random.integers(0, max(size, 1), count) for size in (rows, columns))
    return of, to, values


def both(rows, columns, seed):
    """Return one matrix as ours and as scipy's."""
    of, to, values = triples(rows, columns, seed)
    theirs = scipy.sparse.coo_array((values, (of, to)), (rows, columns)).tocsr()
    return own.from_triples(of, to, values, (rows, columns)), theirs


def assert_same(ours, theirs):
    """Compare entry by entry, in their order."""
    assert ours.shape == theirs.shape
    assert ours.start.dtype == ours.columns.dtype == np.int32
    np.testing.assert_array_equal(ours.start, theirs.indptr)
    np.testing.assert_array_equal(ours.columns, theirs.indices)
    np.testing.assert_array_equal(ours.values, theirs.data)


@pytest.mark.parametrize(("rows", "columns", "others"), SHAPES)
def test_matrices_are_those_of_scipy_bit_by_bit(rows, columns, others):
    a, their_a = both(rows, columns, 0)
    b, their_b = both(columns, others, 1)
    c, their_c = both(rows, columns, 2)
    assert_same(a, their_a)
    assert_same(own.transposed(a), their_a.T.tocsr())
    assert_same(own.product(a, b), their_a @ their_b)
    assert_same(own.in_order(own.product(a, b)), (their_a @ their_b).sorted_indices())
    assert_same(own.added(a, c, -2.0), their_a + -2.0 * their_c)
    unsorted = own.product(own.diagonal_matrix(np.ones(rows)), c)
    theirs = scipy.sparse.diags_array(np.ones(rows)).tocsr() @ their_c
    assert_same(own.added(a, unsorted, -1.0), their_a - theirs)
    chosen = np.arange(0, rows, 2)[::-1]
    assert_same(own.with_rows(a, chosen), their_a[chosen])
    assert_same(own.absolute(a), abs(their_a))


@pytest.mark.parametrize("precision", [np.float32, np.float64])
@pytest.mark.parametrize(("rows", "columns", "others"), SHAPES)
def test_products_with_vectors_are_those_of_scipy(rows, columns, others, precision):
    a, theirs = both(rows, columns, 0)
    a, theirs = a._replace(values=a.values.astype(precision)), theirs.astype(precision)
    x = np.random.default_rng(3).normal(size=(columns, others)).astype(precision)
    np.testing.assert_array_equal(own.applied(a, x), theirs @ x)
    if others:
        np.testing.assert_array_equal(own.applied(a, x[:, 0]), theirs @ x[:, 0])
    assert own.applied(a, x).dtype == precision
    np.testing.assert_array_equal(own.row_sums(a), theirs.sum(axis=1))


def test_parts_of_square_matrices():
    a, theirs = both(300, 300, 4)
    a, theirs = own.product(a, a), theirs @ theirs
    np.testing.assert_array_equal(own.diagonal_of(a), theirs.diagonal())
    off = own.couplings_of(a)
    theirs.setdiag(0.0)
    theirs.eliminate_zeros()
    assert_same(off, theirs.sorted_indices())
    assert_same(own.with_entries(off, off.values > 1), theirs.multiply(theirs > 1).tocsr())


def test_repeated_entries_add_up_in_their_order():
    values = np.array([1e16, 1.0, -1e16, 5.0])
    ours = own.from_triples(np.zeros(4, int), np.array([2, 2, 2, 1]), values, (1, 3))
    assert ours.columns.tolist() == [1, 2] and ours.values.tolist() == [5.0, 0.0]


def test_products_do_not_depend_on_the_number_of_threads(monkeypatch):
    a, _ = both(20_000, 20_000, 5)
    expected = own.product(a, a)
    monkeypatch.setattr("shock_filter.core.base.parallel.most_threads", 1)
    for ours, theirs in zip(expected[:3], own.product(a, a)[:3], strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_a_product_can_be_cancelled():
    a, _ = both(20_000, 20_000, 5)
    asked = []
    with pytest.raises(Cancelled), reporting(lambda *_: asked.append(0) or len(asked) < 3):
        own.product(a, a)


def laplacian(count, one, other, screen=0.1):
    """Return that of a graph as ours and as scipy's."""
    weights = np.random.default_rng(6).uniform(0.5, 2.0, len(one))
    one, other = np.concatenate([one, other]), np.concatenate([other, one])
    weights = np.concatenate([weights, weights])
    diagonal = np.bincount(one, weights, count) + screen
    of, to = (np.concatenate([ends, np.arange(count)]) for ends in (one, other))
    given = np.concatenate([-weights, diagonal])
    theirs = scipy.sparse.csc_array((given, (of, to)), shape=(count, count))
    return own.from_triples(of, to, given, (count, count)), theirs


def graphs():
    random = np.random.default_rng(7)
    path = np.arange(1999)
    number = np.arange(4 * 600).reshape(4, 600)
    apart = [(path[:30], path[:30] + 1), (path[40:60], path[40:60] + 1)]
    return {
        "nothing": (0, path[:0], path[:0]),
        "one": (1, path[:0], path[:0]),
        "no links": (50, path[:0], path[:0]),
        "path": (2000, path, path + 1),
        "loop": (1999, path, (path + 1) % 1999),
        "star": (2000, np.zeros(1999, int), path + 1),
        "tree": (2000, path + 1, random.integers(0, path + 1)),
        "all to all": (40, *np.triu_indices(40, 1)),
        "parts": (70, *np.concatenate(apart, axis=1)),
        "strip": (
            number.size,
            np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()]),
            np.concatenate([number[:, 1:].ravel(), number[1:].ravel()]),
        ),
        "random": (300, *random.integers(0, 300, (2, 900))),
    }


@pytest.mark.parametrize("name", graphs())
def test_factors_multiply_to_the_matrix_and_solve(name):
    count, one, other = graphs()[name]
    matrix, theirs = laplacian(count, one, other)
    factors, place = factored(matrix)
    assert sorted(place.tolist()) == list(range(count))
    assert (factors.diagonal > 0).all()
    lower = scipy.sparse.csc_array((factors.values, factors.below, factors.start), (count, count))
    assert lower.has_canonical_format
    lower = lower.toarray() + np.eye(count)
    found = (lower * factors.diagonal) @ lower.T
    expected = np.zeros((count, count))
    expected[np.ix_(place, place)] = theirs.toarray()
    np.testing.assert_allclose(found, expected, atol=1e-13 * max(count, 1))


@pytest.mark.parametrize("name", ["path", "star", "tree"])
def test_trees_have_no_fill(name):
    count, one, other = graphs()[name]
    assert minimum_degree(laplacian(count, one, other)[0]).counts.sum() == count - 1


@pytest.mark.parametrize("name", ["loop", "strip", "random", "all to all"])
def test_factors_are_about_as_sparse_as_those_of_scipy(name):
    matrix, theirs = laplacian(*graphs()[name])
    options = {"SymmetricMode": True}
    factors = scipy.sparse.linalg.splu(theirs, "MMD_AT_PLUS_A", 0.0, options=options)
    most = 1.1 * (factors.L.nnz - matrix.shape[0])
    assert minimum_degree(matrix).counts.sum() <= most


def test_a_factor_of_too_many_entries_is_refused_before_it_is_computed():
    matrix, _ = laplacian(*graphs()["random"])
    entries = int(minimum_degree(matrix).counts.sum())
    assert len(factored(matrix, entries)[0].values) == entries
    with pytest.raises(TooDense, match="more than"):
        factored(matrix, entries - 1)


def test_subtrees_follow_one_another():
    _, parents, counts = minimum_degree(laplacian(*graphs()["strip"])[0])
    assert (parents[:-1] > np.arange(len(parents) - 1)).all() and parents[-1] == -1
    sizes = np.ones(len(parents), int)
    for i, parent in enumerate(parents[:-1]):
        sizes[parent] += sizes[i]
    first = np.arange(len(parents)) - sizes + 1  # of the subtree, if these are contiguous
    assert (first[parents[:-1]] <= first[:-1]).all()
    assert ((counts > 0) == (parents >= 0)).all()


def test_what_is_not_positive_definite_has_no_positive_factors():
    count, one, other = graphs()["strip"]
    for screen in (-0.5, np.nan):
        factors, _ = factored(laplacian(count, one, other, screen)[0])
        assert not (factors.diagonal > 0).all()


def test_zeros_on_one_side_only_do_no_harm():
    matrix, _ = laplacian(*graphs()["strip"])
    lopsided = (own.rows_of(matrix) == 7) & (matrix.columns == 8)
    lopsided |= (own.rows_of(matrix) == 80) & (matrix.columns == 79)
    zeros = matrix._replace(values=np.where(lopsided, 0.0, matrix.values))
    for given in (zeros, own.with_entries(matrix, ~lopsided)):
        spoilt = [np.full(100_000, np.nan) for _ in range(30)]  # what new arrays may hold
        del spoilt
        factors, _ = factored(given)
        assert (abs(factors.values) < 10).all()
