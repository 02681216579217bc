# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare our sparse matrices, graphs and searches with those of scipy.

``python benchmarks/sparse_matrices.py`` prints a table. The fastest of several runs counts; scipy's
k-d tree answers on all cores, too.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import common
import numpy as np
import scipy.ndimage
import scipy.sparse
import scipy.sparse.linalg
import scipy.spatial
from report import Page, table
from scipy.sparse import csgraph
from shock_filter import core
from shock_filter.core.elements.matrices import TextureSpace
from shock_filter.core.elements.sheet_matrix import BlockRows, block_rows, kinds_of
from shock_filter.core.grid.nearest import nearest_marked
from shock_filter.core.mesh.nearest import nearest_point, point_tree, points_within
from shock_filter.core.sparse import matrix as own
from shock_filter.core.sparse.components import connected_components
from shock_filter.core.sparse.factors import factored
from texture_models import ball

RUNS = 5
SIZE = 700
"""Nodes along the sides of grids."""

Case = tuple[str, Callable[[], Any], Callable[[], Any]]


def grid(height: int, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Return the triples of a screened Laplacian with six neighbors each, and its size."""
    number = np.arange(height * width).reshape(height, width)
    pairs = [
        (number[:, 1:], number[:, :-1]),
        (number[1:], number[:-1]),
        (number[1:, 1:], number[:-1, :-1]),
    ]
    one, other = (np.concatenate([pair[k].reshape(-1) for pair in pairs]) for k in (0, 1))
    diagonal = np.arange(number.size)
    rows = np.concatenate([one, other, diagonal])
    columns = np.concatenate([other, one, diagonal])
    values = np.concatenate([np.full(2 * len(one), -1.0), np.full(number.size, 6.5)])
    return rows, columns, values, number.size


def of_matrices() -> Iterator[Case]:
    """Cases of sums and products."""
    rows, columns, values, n = grid(SIZE, SIZE)
    order = np.random.default_rng(0).permutation(len(rows))
    mixed = rows[order], columns[order], values[order]
    ours = own.from_triples(rows, columns, values, (n, n))
    theirs = scipy.sparse.csr_array((values, (rows, columns)), shape=(n, n))
    x = np.random.default_rng(1).random((n, 3))
    size = f"{n / 1e3:.0f} thousand rows"
    yield (
        f"matrix of shuffled triples, {size}",
        lambda: own.from_triples(*mixed, (n, n)),
        lambda: scipy.sparse.csr_array((mixed[2], mixed[:2]), shape=(n, n)),
    )
    yield "transpose", lambda: own.transposed(ours), lambda: theirs.T.tocsr()
    yield "sum", lambda: own.added(ours, ours), lambda: theirs + theirs
    yield "product", lambda: own.product(ours, ours), lambda: theirs @ theirs
    yield "times three vectors", lambda: own.applied(ours, x), lambda: theirs @ x
    yield (
        f"components, {size}",
        lambda: connected_components(n, rows, columns),
        lambda: csgraph.connected_components(
            scipy.sparse.coo_array((values, (rows, columns)), (n, n)), directed=False
        ),
    )


def of_points() -> Iterator[Case]:
    """Cases of searches in space, and in an image."""
    random = np.random.default_rng(2)
    count = 300_000
    even = random.normal(size=(count, 3))
    even /= np.linalg.norm(even, axis=1)[:, None]
    uneven = even * np.exp(4.0 * random.normal(size=(count, 1)))
    for words, points in (("on a ball", even), ("spread unevenly", uneven)):
        places = points + 1e-4
        kept, theirs = point_tree(points), scipy.spatial.cKDTree(points)
        yield (
            f"tree of {count:,} points {words}",
            *_pair(
                lambda points=points: point_tree(points),
                lambda points=points: scipy.spatial.cKDTree(points, balanced_tree=False),
            ),
        )
        yield (
            f"nearest of points {words}",
            *_pair(
                lambda kept=kept, places=places: nearest_point(kept, places),
                lambda theirs=theirs, places=places: theirs.query(places, workers=-1),
            ),
        )
    kept, theirs = point_tree(even), scipy.spatial.cKDTree(even)
    yield (
        "all points within a distance",
        lambda: points_within(kept, even, 0.01),
        lambda: theirs.query_ball_point(even, 0.01, workers=-1),
    )
    marked = random.random((2048, 2048)) < 0.01
    yield (
        "nearest marked pixels, 2048 x 2048",
        lambda: nearest_marked(marked),
        lambda: scipy.ndimage.distance_transform_edt(
            ~marked, return_distances=False, return_indices=True
        ),
    )


def _pair(one: Callable[[], Any], other: Callable[[], Any]) -> Any:
    return one, other


def block(size: int) -> tuple[BlockRows, np.ndarray]:
    """Return the rows of the seams' block of a ball's texture, and the numbers of its unknowns."""
    model = ball(size)
    space = TextureSpace(core.TextureAtlas(model.mesh(), model.uv, size=(size, size)))
    matrix = space.matrix(1e-3)
    return block_rows(matrix, kinds_of(matrix, False))


def of_factors() -> Iterator[Case]:
    """Cases of factorisations: seams' blocks, strips and a square."""
    given = []
    for size in (512, 1024, 2048):
        rows, number = block(size)
        of = np.repeat(np.arange(len(rows.unknowns)), np.diff(rows.start))
        to = number[rows.columns]
        inner = to >= 0
        places = np.arange(len(rows.unknowns))
        triples = (
            np.concatenate([of[inner], places]),
            np.concatenate([to[inner], places]),
            np.concatenate([rows.values[inner], rows.diagonal]),
        )
        given.append((f"seams of a ball, {size} texels", *triples, len(places)))
    given.append(("strip of 3 x 100,000", *grid(3, 100_000)))
    given.append(("square of 200 x 200", *grid(200, 200)))
    for words, rows, columns, values, n in given:
        ours = own.from_triples(rows, columns, values, (n, n))
        theirs = scipy.sparse.csc_array((values, (rows, columns)), shape=(n, n))
        fill = len(factored(ours)[0].values) / (_splu(theirs).L.nnz - n)
        yield (
            f"factors, {words}: {n:,} rows, {fill:.2f} times the entries",
            *_pair(lambda ours=ours: factored(ours), lambda theirs=theirs: _splu(theirs)),
        )


def _splu(matrix: Any) -> Any:
    options = {"SymmetricMode": True}
    return scipy.sparse.linalg.splu(matrix, "MMD_AT_PLUS_A", 0.0, options=options)


def main() -> None:
    """Print the table, or write it into a page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", type=Path, help="Markdown page to write the table into")
    options = parser.parse_args()
    lines = []
    for cases in (of_matrices(), of_points(), of_factors()):
        for words, ours, theirs in cases:
            ours()  # compiles
            one, other = common.fastest(ours, RUNS), common.fastest(theirs, RUNS)
            lines.append([words, f"{1e3 * one:.0f}", f"{1e3 * other:.0f}", f"{one / other:.2f}"])
            print("; ".join(lines[-1]), flush=True)
    head = ["", "own, ms", "scipy, ms", "ratio"]
    Page(options.write).write("sparse", f"{common.machine()}\n\n{table(head, lines)}")


if __name__ == "__main__":
    main()
