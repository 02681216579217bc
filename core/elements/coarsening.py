# SPDX-License-Identifier: GPL-3.0-or-later
"""Galerkin coarsening: the matrix of every second node in both directions.

Coarse unknowns are the nodes at even rows and columns. A node with all of its coarse parents is
interpolated bilinearly from them, so stencils stay stencils. The others, beside seams, are averages
of their neighbors weighted by couplings, and their couplings join the seam part.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas.sheet import ROWS
from ..base.parallel import kernel, run
from ..base.progress import ask
from ..mesh.triangle_mesh import Floats, Ints
from ..sparse.matrix import (
    added,
    couplings_of,
    diagonal_matrix,
    from_triples,
    product,
    row_sums,
    transposed,
)
from .sheet_matrix import LOOSE, NONE, BlockRows, SheetMatrix

_KEPT = 4
"""Most coarse nodes that an unknown is interpolated from."""

_SWEEPS = 1
"""Rounds of averaging after all unknowns have parents: more save no iterations."""

_CANDIDATES = 64


def coarsened(
    matrix: SheetMatrix, kinds: npt.NDArray[np.uint8], rows: BlockRows, number: Ints
) -> SheetMatrix:
    """Make the matrix of the next level, from the results of `kinds_of` and `block_rows`."""
    shape = kinds.shape[0] // 2 + 1, kinds.shape[1] // 2 + 1
    labels = np.full(shape, -1, dtype=np.int32)
    even = matrix.labels[::2, ::2]
    labels[: even.shape[0], : even.shape[1]] = even
    parents, shares = _interpolation(kinds, rows, number, shape[1])
    stencil = np.zeros((4, *shape), dtype=np.float32)
    screen = np.zeros(shape)
    run(_coarsen_stencil, shape[0], matrix.stencil, kinds, stencil, chunk=ROWS)
    run(_coarsen_screen, shape[0], matrix.screen, kinds, screen, chunk=ROWS)
    loose = _loose(kinds, rows)
    held = parents[loose] >= 0
    added = (shares[loose] * rows.screen[loose, None])[held]
    screen = screen.reshape(-1)
    screen += np.bincount(parents[loose][held], added, len(screen))
    ask()
    seam, start, columns, values = _coarsen_seam(
        matrix, kinds, rows, number, loose, parents, shares
    )
    return SheetMatrix(stencil, labels, screen, seam, start, columns, values)


def _loose(kinds: npt.NDArray[np.uint8], rows: BlockRows) -> npt.NDArray[np.bool_]:
    # Which unknowns of the block lack coarse parents.
    loose = np.ones(len(rows.unknowns), dtype=bool)
    nodes = rows.unknowns[rows.unknowns < kinds.size]
    loose[: len(nodes)] = kinds.reshape(-1)[nodes] == LOOSE
    return loose


def _interpolation(
    kinds: npt.NDArray[np.uint8], rows: BlockRows, number: Ints, coarse_columns: int
) -> tuple[Ints, Floats]:
    # Coarse numbers and weights for each unknown of the block, padded with -1 and 0.
    size = len(rows.unknowns)
    parents = np.full((size, _KEPT), -1, dtype=np.int32)
    shares = np.zeros((size, _KEPT))
    loose = _loose(kinds, rows)
    bound = np.flatnonzero(~loose)
    run(_inherit, len(bound), bound, rows.unknowns, kinds.shape[1], coarse_columns, parents, shares)
    free = np.flatnonzero(loose)
    after, weights = parents.copy(), shares.copy()
    given = rows, number, kinds.shape[1], coarse_columns
    empty, before = free, -1
    while len(empty) not in (0, before):  # unknowns connected to no coarse node stay empty
        before = len(empty)
        run(_average, before, empty, *given, parents, shares, after, weights)
        parents[empty], shares[empty] = after[empty], weights[empty]
        empty = empty[parents[empty, 0] < 0]
    for _ in range(_SWEEPS):
        run(_average, len(free), free, *given, parents, shares, after, weights)
        parents, after, shares, weights = after, parents, weights, shares
    return parents, shares


def _coarsen_seam(
    matrix: SheetMatrix,
    kinds: npt.NDArray[np.uint8],
    rows: BlockRows,
    number: Ints,
    loose: npt.NDArray[np.bool_],
    parents: Ints,
    shares: Floats,
) -> tuple[Ints, Ints, Ints, Floats]:
    # The couplings of the seam part, and those of the stencil that involve a loose node.
    size = len(rows.unknowns)
    seam = number[matrix.seam]
    of = np.repeat(np.arange(size), np.diff(rows.start))
    to = number[rows.columns]
    from_seam = np.zeros(len(of), dtype=bool)
    offset = np.arange(len(of)) - rows.start[of]
    count = np.zeros(size, dtype=np.int64)
    count[seam] = np.diff(matrix.start)
    from_seam = offset < count[of]
    moved = from_seam | loose[of] | (loose[to] & (to >= 0))
    of, to, columns, values = of[moved], to[moved], rows.columns[moved], rows.values[moved]
    # Regular neighbors of loose nodes are numbered after the block's unknowns.
    outside = to < 0
    others, place = np.unique(columns[outside], return_inverse=True)
    to[outside] = size + place
    of, to = np.concatenate([of, to[outside]]), np.concatenate([to, of[outside]])
    values = np.concatenate([values, values[outside]])
    their_parents = np.full((len(others), _KEPT), -1, dtype=np.int32)
    their_shares = np.zeros((len(others), _KEPT))
    coarse_columns = matrix.labels.shape[1] // 2 + 1
    run(_inherit, len(others), np.arange(len(others)), others, kinds.shape[1], coarse_columns,
        their_parents, their_shares)  # fmt: skip
    parents, shares = (
        np.concatenate([parents, their_parents]),
        np.concatenate([shares, their_shares]),
    )
    used = np.zeros(len(parents), dtype=bool)
    used[of] = True
    held = (parents >= 0) & used[:, None]
    coarse, place = np.unique(parents[held], return_inverse=True)
    n = len(parents)
    prolongation = from_triples(np.nonzero(held)[0], place, shares[held], (n, len(coarse)))
    ask()
    couplings = from_triples(of, to, values, (n, n))
    couplings = added(couplings, diagonal_matrix(row_sums(couplings)), -1.0)
    ask()
    coarser = product(transposed(prolongation), product(couplings, prolongation))
    start, columns, values, _ = couplings_of(coarser)
    return coarse.astype(np.int32), start, columns, values


@kernel
def _put_parents(number, columns, coarse_columns, parents, shares):
    # The bilinear interpolation of a node; returns the number of parents.
    y, x = divmod(number, columns)
    count = 0
    share = (0.5 if y & 1 else 1.0) * (0.5 if x & 1 else 1.0)
    for v in range(y >> 1, (y >> 1) + 1 + (y & 1)):
        for u in range(x >> 1, (x >> 1) + 1 + (x & 1)):
            parents[count] = v * coarse_columns + u
            shares[count] = share
            count += 1
    return count


@kernel
def _inherit(start, stop, which, unknowns, columns, coarse_columns, parents, shares):
    for k in range(start, stop):
        p = which[k]
        _put_parents(unknowns[p], columns, coarse_columns, parents[p], shares[p])


@kernel
def _average(
    start, stop, which, rows, number, columns, coarse_columns, parents, shares, after, weights
):
    # The weighted mean of the neighbors' interpolations; only the largest weights are kept.
    found = np.empty(_CANDIDATES, dtype=np.int32)
    total = np.empty(_CANDIDATES)
    beside = np.empty(4, dtype=np.int32)
    part = np.empty(4)
    for k in range(start, stop):
        p = which[k]
        count = 0
        for sign in (-1.0, 1.0):  # couplings of the wrong sign only if there are no others
            for e in range(rows.start[p], rows.start[p + 1]):
                value = sign * rows.values[e]
                if value <= 0:
                    continue
                q = number[rows.columns[e]]
                if q >= 0:
                    count = _gather(parents[q], shares[q], value, found, total, count)
                else:
                    most = _put_parents(rows.columns[e], columns, coarse_columns, beside, part)
                    count = _gather(beside[:most], part, value, found, total, count)
            if count > 0:
                break
        taken = min(count, after.shape[1])
        whole = 0.0
        for m in range(taken):
            best = m
            for place in range(m + 1, count):
                if total[place] > total[best]:
                    best = place
            total[m], total[best] = total[best], total[m]
            found[m], found[best] = found[best], found[m]
            whole += total[m]
        for m in range(after.shape[1]):
            after[p, m] = found[m] if m < taken else -1
            weights[p, m] = total[m] / whole if m < taken else 0.0


@kernel
def _gather(parents, shares, value, found, total, count):
    for m in range(len(parents)):
        if parents[m] < 0:
            break
        place = 0
        while place < count and found[place] != parents[m]:
            place += 1
        if place == _CANDIDATES:
            continue
        if place == count:
            found[place] = parents[m]
            total[place] = 0.0
            count += 1
        total[place] += value * shares[m]
    return count


@kernel
def _kept(kinds, y, x, v, u, value):
    # A coupling, or 0 if it belongs to the seam part.
    return value if kinds[y, x] != LOOSE and kinds[v, u] != LOOSE else np.float32(0)


@kernel
def _in_cell(stencil, kinds, y, x):
    # The couplings that those inside a coarse cell with the middle (y, x) contribute to the pairs
    # of its corners: upper, lower, left, right, falling, rising.
    top = stencil[2, y - 1, x]
    low = stencil[2, y, x]
    left = stencil[0, y, x - 1]
    right = stencil[0, y, x]
    a = stencil[3, y - 1, x - 1]
    b = stencil[1, y - 1, x + 1]
    c = stencil[1, y, x]
    d = stencil[3, y, x]
    top_left = stencil[1, y - 1, x]
    top_right = stencil[3, y - 1, x]
    low_left = stencil[3, y, x - 1]
    low_right = stencil[1, y, x + 1]
    plain = True
    for v in range(y - 1, y + 2):
        for u in range(x - 1, x + 2):
            plain &= kinds[v, u] != LOOSE
    if not plain:
        top = _kept(kinds, y, x, y - 1, x, top)
        low = _kept(kinds, y, x, y + 1, x, low)
        left = _kept(kinds, y, x, y, x - 1, left)
        right = _kept(kinds, y, x, y, x + 1, right)
        a = _kept(kinds, y, x, y - 1, x - 1, a)
        b = _kept(kinds, y, x, y - 1, x + 1, b)
        c = _kept(kinds, y, x, y + 1, x - 1, c)
        d = _kept(kinds, y, x, y + 1, x + 1, d)
        top_left = _kept(kinds, y - 1, x, y, x - 1, top_left)
        top_right = _kept(kinds, y - 1, x, y, x + 1, top_right)
        low_left = _kept(kinds, y + 1, x, y, x - 1, low_left)
        low_right = _kept(kinds, y + 1, x, y, x + 1, low_right)
    part = np.float32(1 / 16)
    quarter = np.float32(0.25)
    upright = top + low
    flat = left + right
    upper = part * (flat - upright + 3 * (a + b) - c - d)
    lower = part * (flat - upright + 3 * (c + d) - a - b)
    on_left = part * (upright - flat + 3 * (a + c) - b - d)
    on_right = part * (upright - flat + 3 * (b + d) - a - c)
    falling = part * (upright + flat + 3 * (a + d) - b - c) + quarter * (top_right + low_left)
    rising = part * (upright + flat + 3 * (b + c) - a - d) + quarter * (top_left + low_right)
    return upper, lower, on_left, on_right, falling, rising


@kernel
def _holds_any(kinds, y, x):
    # Whether a column has an unknown within two rows.
    found = False
    if x < kinds.shape[1]:
        for row in range(max(y - 2, 0), min(y + 3, kinds.shape[0])):
            found |= kinds[row, x] != NONE
    return found


@kernel
def _coarsen_stencil(start, stop, stencil, kinds, coarse):
    # In differences: a coupling a of i with j adds -a (P_iI - P_jI) (P_iJ - P_jJ) to I and J.
    rows, columns = kinds.shape
    quarter = np.float32(0.25)
    for row in range(start, stop):
        y = 2 * row
        right_before = np.float32(0)
        rising_before = np.float32(0)
        held = _holds_any(kinds, y, 0)
        for column in range(coarse.shape[2]):
            x = 2 * column
            on_left = held
            held = _holds_any(kinds, y, x + 2)
            ends_here = right_before == 0 and rising_before == 0
            if ends_here and not (on_left or held or _holds_any(kinds, y, x + 1)):
                continue
            lower = upper = left = right = falling = rising = np.float32(0)
            if x + 1 < columns - 1:
                if 0 < y < rows:
                    _, lower, _, _, _, _ = _in_cell(stencil, kinds, y - 1, x + 1)
                    lower += quarter * _kept(kinds, y, x, y, x + 1, stencil[0, y, x])
                    lower += quarter * _kept(kinds, y, x + 1, y, x + 2, stencil[0, y, x + 1])
                if y + 1 < rows - 1:
                    upper, _, left, right, falling, rising = _in_cell(stencil, kinds, y + 1, x + 1)
            if y + 1 < rows - 1 and 0 < x < columns:
                left += quarter * _kept(kinds, y, x, y + 1, x, stencil[2, y, x])
                left += quarter * _kept(kinds, y + 1, x, y + 2, x, stencil[2, y + 1, x])
            coarse[0, row, column] = lower + upper
            coarse[1, row, column] = rising_before
            coarse[2, row, column] = left + right_before
            coarse[3, row, column] = falling
            right_before, rising_before = right, rising


@kernel
def _coarsen_screen(start, stop, screen, kinds, coarse):
    rows, columns = kinds.shape
    for row in range(start, stop):
        for column in range(coarse.shape[1]):
            total = 0.0
            for y in range(max(2 * row - 1, 0), min(2 * row + 2, rows)):
                for x in range(max(2 * column - 1, 0), min(2 * column + 2, columns)):
                    if kinds[y, x] == NONE or kinds[y, x] == LOOSE:
                        continue
                    share = (0.5 if y & 1 else 1.0) * (0.5 if x & 1 else 1.0)
                    total += share * screen[y * columns + x]
            coarse[row, column] = total


@kernel
def restrict(start, stop, stencil, screen, runs, b, x, coarse):
    """Restrict the residual of the regular nodes to the coarse nodes of some rows: (c, n)."""
    rows, columns = stencil.shape[1:]
    coarse_columns = columns // 2 + 1
    half = np.float32(0.5)
    above = np.zeros((x.shape[0], columns), dtype=np.float32)
    here = np.zeros_like(above)
    below = np.zeros_like(above)
    sums = np.zeros(columns + 2, dtype=np.float32)
    if start > 0:
        _subtract_row(2 * start - 1, stencil, screen, runs, b, x, above)
    for row in range(start, stop):
        y = 2 * row
        here[:] = 0
        below[:] = 0
        if y < rows:
            _subtract_row(y, stencil, screen, runs, b, x, here)
        if y + 1 < rows:
            _subtract_row(y + 1, stencil, screen, runs, b, x, below)
        first, last = columns, 0
        for v in range(max(y - 1, 0), min(y + 2, rows)):
            if runs.start[v] < runs.start[v + 1]:
                first = min(first, runs.columns[runs.start[v], 0])
                last = max(last, runs.columns[runs.start[v + 1] - 1, 1])
        if first > last:
            above, below = below, above
            continue
        low = first >> 1
        n = (last >> 1) + 1 - low
        for j in range(x.shape[0]):
            one, two, three = above[j], here[j], below[j]
            for u in range(columns):
                sums[u + 1] = two[u] + half * (one[u] + three[u])
            part = sums[2 * low : 2 * low + 2 * n + 1]
            out = coarse[j, row * coarse_columns + low : row * coarse_columns + low + n]
            for u in range(n):
                out[u] = part[2 * u + 1] + half * (part[2 * u] + part[2 * u + 2])
        above, below = below, above


@kernel
def _subtract_row(y, stencil, screen, runs, b, x, out):
    # The residual of a row's regular nodes in all channels; see `multiply_row`.
    columns = stencil.shape[2]
    for k in range(runs.start[y], runs.start[y + 1]):
        first, last = runs.columns[k]
        i = y * columns + first
        n = last - first
        level = stencil[0, y, first - 1 : last]
        a = stencil[3, y - 1, first - 1 : last - 1]
        d = stencil[1, y, first:last]
        e = stencil[2, y, first:last]
        f = stencil[3, y, first:last]
        g = stencil[2, y - 1, first:last]
        h = stencil[1, y - 1, first + 1 : last + 1]
        rest = screen[i : i + n]
        for j in range(x.shape[0]):
            here = x[j, i - 1 : i + n + 1]
            upper = x[j, i - columns - 1 : i - columns + n + 1]
            lower = x[j, i + columns - 1 : i + columns + n + 1]
            rhs = b[j, i : i + n]
            row = out[j, first:last]
            for u in range(n):
                value = here[u + 1]
                total = rhs[u] - np.float32(rest[u]) * value
                total -= level[u] * (here[u] - value) + level[u + 1] * (here[u + 2] - value)
                total -= a[u] * (upper[u] - value) + g[u] * (upper[u + 1] - value)
                total -= h[u] * (upper[u + 2] - value) + d[u] * (lower[u] - value)
                row[u] = total - e[u] * (lower[u + 1] - value) - f[u] * (lower[u + 2] - value)


@kernel
def prolong(start, stop, runs, coarse, fine, columns):
    """Prolongate the coarse solution and add it to the regular nodes of some rows: (c, n)."""
    coarse_columns = columns // 2 + 1
    half = np.float32(0.5)
    mean = np.empty(coarse_columns, dtype=np.float32)
    for y in range(start, stop):
        i = (y >> 1) * coarse_columns
        k = i + (y & 1) * coarse_columns
        for j in range(fine.shape[0]):
            row = fine[j, y * columns : (y + 1) * columns]
            one = coarse[j, i : i + coarse_columns]
            two = coarse[j, k : k + coarse_columns]
            for r in range(runs.start[y], runs.start[y + 1]):
                first, last = runs.columns[r]
                low = first >> 1
                n = (last >> 1) + 1 - low
                part = mean[:n]
                a, b = one[low : low + n], two[low : low + n]
                for u in range(n):
                    part[u] = half * (a[u] + b[u])
                skip = first & 1
                even = row[first + skip : last]
                for u in range((last - first - skip + 1) >> 1):
                    even[2 * u] += part[u + skip]
                odd = row[first + 1 - skip : last]
                for u in range((last - first - 1 + skip + 1) >> 1):
                    odd[2 * u] += half * (part[u] + part[u + 1])
