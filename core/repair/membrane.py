# SPDX-License-Identifier: GPL-3.0-or-later
"""Smooth functions on the surface that continue known values: membranes and thin plates."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas.sheet import NOTHING, ROWS
from ..base.parallel import kernel, run
from ..base.progress import aside, phase
from ..elements.matrices import TextureSpace
from ..elements.multigrid import SheetSolver
from ..elements.sheet_matrix import SheetMatrix
from ..errors import InvalidSignal, SolverError
from ..mesh.nearest import nearest_point, point_tree
from ..mesh.triangle_mesh import Ints
from ..sparse.matrix import Sparse, applied, row_sums, rows_of
from .missing import widened

Singles = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]

_TOLERANCE = 1e-4
"""Residual of the membrane relative to its right-hand side."""

_FROM_GUESS = 5e-4
"""The same with an initial guess, whose residual is the right-hand side: the error is 2e-4."""

_LINKS = 3
"""Points along seams are unknowns too, up to this number of couplings away from missing texels."""

_ALONE = 1e-3
"""Screening of nodes that are not unknowns, whose solution is 0."""

_SOFT = 16.0
"""Distance, in texels, over which the nearest colors of parts without known texels are averaged."""

_SAMPLE = 1 << 18
"""Number of known texels, about, among which the nearest is searched."""

_SOLVE = 3e-2
"""Residual of the solves in the preconditioner of a thin plate."""

_ENOUGH = 5e-3
"""Residual of a thin plate relative to its right-hand side."""

_MOST_STEPS = 40

_LEAST_MASS = 1e-3


class Holes:
    """The missing values of a function on the surface.

    Parameters
    ----------
    space : TextureSpace
    missing : (rows, columns) bool
        Nodes of the sheet.

    Attributes
    ----------
    known : (n,) bool
        Nodes with given values.
    unknown : (n,) bool
        Unknowns: missing nodes, and points along seams near these.
    adrift : (n,) bool
        Unknowns in connected parts of the surface without known values.

    Raises
    ------
    InvalidSignal
        If no value is known.
    """

    def __init__(self, space: TextureSpace, missing: Bools) -> None:
        self._space = space
        inside = space.labels >= 0
        nodes = missing.size
        self.known = np.zeros(space.size, dtype=np.bool_)
        self.known[:nodes] = (inside & ~missing).reshape(-1)
        if not self.known.any():
            raise InvalidSignal(
                "Nothing is known of any texel of the surface, so that nothing can be filled; make"
                " some of them opaque, or leave some out of the mask."
            )
        components = space.components
        sourced = np.zeros(int(components.max(initial=0)) + 1, dtype=np.bool_)
        with aside("Measuring texels"):
            run(_mark_parts, len(components), components, self.known, sourced)
        lost = missing & inside
        self._tolerance = _TOLERANCE
        kept = widened(lost, 1) & inside
        self.whole = space.matrix(1.0, lumped=True, where=kept)
        self.unknown = np.zeros(space.size, dtype=np.bool_)
        self.unknown[:nodes] = lost.reshape(-1)
        self._add_points()
        self.adrift = np.zeros(space.size, dtype=np.bool_)
        if not sourced.all():
            self.adrift = self.unknown & ~sourced[np.maximum(components, 0)]
        self._matrix = self._reduced(kept)

    def _add_points(self) -> None:
        # Adds points along seams near missing nodes, one coupling after the other.
        nodes = self.whole.labels.size
        of, to = self._links()
        near = self.unknown.copy()
        for _ in range(_LINKS):
            near[of[near[to]]] = True
        near[:nodes] = False
        self.unknown |= near

    def _links(self) -> tuple[Ints, Ints]:
        # The pairs of unknowns that are coupled along seams, in both orders.
        seam, sparse = self.whole.seam, self._couplings()
        return seam[rows_of(sparse)], seam[sparse.columns]

    def _couplings(self) -> Sparse:
        # The part of the matrix along seams, in its own numbering.
        whole = self.whole
        return Sparse(whole.start, whole.columns_, whole.values, 2 * (len(whole.seam),))

    def _reduced(self, kept: Bools) -> SheetMatrix:
        # The equations of the unknowns. Other nodes in `kept` are needed by the stencil, and get
        # separate equations with the solution 0; all others are left out, which saves most of the
        # time.
        whole, unknown = self.whole, self.unknown
        nodes = whole.labels.size
        stencil = np.zeros(whole.stencil.shape, dtype=np.float32)
        labels = np.full(whole.labels.shape, np.int32(NOTHING))
        screen = np.zeros(len(unknown), dtype=np.float32)
        with aside("Assembling"):
            run(_keep_unknowns, len(kept), whole, unknown, kept, stencil, labels, screen,
                chunk=ROWS)  # fmt: skip
        mine, rows = unknown[whole.seam], rows_of(self._couplings())
        both = mine[rows] & mine[whole.columns_]
        one = mine[rows] & ~mine[whole.columns_]
        screen[whole.seam] -= np.bincount(rows[one], whole.values[one], len(mine))
        points = screen[nodes:]
        alone = np.float32(_ALONE) * np.maximum(whole.screen[nodes:], np.float32(1.0))
        np.copyto(points, alone, where=~unknown[nodes:])
        soft = np.flatnonzero(self.adrift)
        screen[soft] += whole.screen[soft] / np.float32(_SOFT**2)
        stays = np.ones(len(whole.seam), dtype=np.bool_)
        is_node = whole.seam < nodes
        stays[is_node] = kept.reshape(-1)[whole.seam[is_node]]
        counts = np.bincount(rows[both], minlength=len(stays))[stays]
        start = np.concatenate([[0], np.cumsum(counts)]).astype(whole.start.dtype)
        number = (np.cumsum(stays) - 1).astype(whole.columns_.dtype)
        return SheetMatrix(
            stencil,
            labels,
            screen,
            whole.seam[stays],
            start,
            number[whole.columns_[both]],
            whole.values[both],
        )

    def start(self, values: Singles, guess: Singles | None) -> None:
        """Set the unknowns to initial values, in place: (n, c), from a guess at nodes if given."""
        nodes = self.whole.labels.size
        missing = self.unknown[:nodes]
        self._tolerance = _TOLERANCE if guess is None else _FROM_GUESS
        if guess is None:
            mean = values[: nodes : max(nodes // _SAMPLE, 1)]
            mean = mean[self.known[: nodes : max(nodes // _SAMPLE, 1)]]
            values[:nodes][missing] = mean.mean(axis=0) if len(mean) else 0.0
        else:
            values[:nodes][missing] = guess[missing]
        self._start_points(values)
        if self.adrift.any():
            values[self.adrift] = self._nearest(values)

    def _start_points(self, values: Singles) -> None:
        # Points along seams take the mean of the texels that they are coupled with.
        nodes = self.whole.labels.size
        of, to = self._links()
        useful = (of >= nodes) & (to < nodes)
        of, to = of[useful] - nodes, to[useful]
        shares = np.abs(self.whole.values[useful])
        count = len(values) - nodes
        total = np.bincount(of, shares, count)
        # Points that are coupled with no texel take the mean of all.
        for c in range(values.shape[1]):
            sums = np.bincount(of, shares * values[to, c], count)
            mean = sums.sum() / max(total.sum(), 1e-30)
            values[nodes:, c] = np.where(total > 0, sums / np.maximum(total, 1e-30), mean)

    def _nearest(self, values: Singles) -> Singles:
        # For parts of the surface without known values, the nearest known values in space.
        space, atlas, mesh = self._space, self._space.atlas, self._space.atlas.mesh
        places = atlas.gather(atlas.bake(mesh.own_corners(mesh.vertices[mesh.faces])))
        flat = places.reshape(-1, 3).astype(np.float64)
        known = np.flatnonzero(self.known[: len(flat)])
        known = known[:: -(-len(known) // _SAMPLE)]
        lost = np.flatnonzero(self.adrift)
        nodes = lost[lost < len(flat)]
        found = np.empty((len(lost), values.shape[1]), dtype=np.float32)
        found[:] = values[known].mean(axis=0, dtype=np.float64)
        if len(nodes):
            _, numbers = nearest_point(point_tree(flat[known]), flat[nodes])
            found[: len(nodes)] = values[known[numbers]]
            # Points along seams take the mean of their part, which the solver corrects.
            parts = space.components
            rest = lost[len(nodes) :]
            count = int(parts.max(initial=0)) + 1
            sizes = np.bincount(parts[nodes], minlength=count)
            for c in range(values.shape[1]):
                sums = np.bincount(parts[nodes], found[: len(nodes), c], count)
                of_part = sums / np.maximum(sizes, 1)
                has = sizes[parts[rest]] > 0
                found[len(nodes) :, c][has] = of_part[parts[rest[has]]]
        return found

    def membrane(self, values: Singles, message: str) -> SheetSolver:
        """Fill the missing values by a harmonic function, in place: (n, c)."""
        solver = SheetSolver(self._matrix)
        rhs = np.zeros(values.shape, dtype=np.float32)
        shape = self.whole.labels.shape
        with aside(message):
            run(_pull, shape[0], self.whole.stencil, self.unknown, values, rhs, chunk=ROWS)
        seam = self.whole.seam
        there = values[seam].astype(np.float64)
        sparse = self._couplings()
        pulls = applied(sparse, there) - row_sums(sparse)[:, None] * there
        mine = self.unknown[seam]
        rhs[seam[mine]] -= pulls[mine]
        change = np.zeros(values.shape, dtype=np.float32)
        solver.solve(rhs, change, self._tolerance, message=message)
        with aside(message):
            run(_add_where, len(values), self.unknown, change, values)
        return solver

    def plate(self, values: Singles, solver: SheetSolver, message: str) -> None:
        """Fill the missing values by a biharmonic function, from a harmonic one, in place.

        Conjugate gradients for ``K W K``, where K is the stiffness, and W the inverse of the masses
        but 0 where the surface ends; preconditioned by ``S M S`` for approximate solves S.
        """
        space = self._space
        free = self.unknown & ~self.adrift
        masses = np.maximum(self.whole.screen, _LEAST_MASS)[:, None]
        weights = 1.0 / masses
        weights[space.cut_cells.unknowns[_at_ends(space)]] = 0.0

        def bend(x: Singles) -> Singles:
            result = space.apply_stiffness(weights * space.apply_stiffness(x))
            result[~free] = 0.0
            return result

        def precondition(r: Singles) -> Singles:
            first, second = np.zeros_like(r), np.zeros_like(r)
            solver.solve(r, first, _SOLVE, message=message)
            first[~free] = 0.0
            solver.solve(first * masses, second, _SOLVE, message=message)
            second[~free] = 0.0
            return second

        residual = -bend(values)
        size = float(np.linalg.norm(residual))
        if size == 0:
            return
        along = np.zeros_like(values)
        before, old = 0.0, residual
        for step in range(_MOST_STEPS):
            with phase(step / _MOST_STEPS, (step + 1) / _MOST_STEPS, message):
                z = precondition(residual)
                now = _dot(z, residual)
                # Flexible: the solves are not the same linear map each time.
                share = 0.0 if before == 0 else max(0.0, (now - _dot(z, old)) / before)
                along = z + np.float32(share) * along
                bent = bend(along)
                energy = _dot(along, bent)
                if not energy > 0:
                    break
                factor = np.float32(_dot(along, residual) / energy)
                values += factor * along
                old, before = residual, now
                residual = residual - factor * bent
                if float(np.linalg.norm(residual)) <= _ENOUGH * size:
                    break
        if not np.isfinite(values).all():
            raise SolverError("The thin plate has no solution; fill by the membrane.")


@kernel
def _mark_parts(start, stop, parts, known, sourced):
    for i in range(start, stop):
        if known[i]:
            sourced[parts[i]] = True


@kernel
def _keep_unknowns(start, stop, whole, unknown, kept, stencil, labels, screen):
    # Couplings with known nodes are part of the diagonal.
    columns = kept.shape[1]
    for y in range(start, stop):
        for x in range(columns):
            if not kept[y, x]:
                continue
            i = y * columns + x
            labels[y, x] = whole.labels[y, x]
            if not unknown[i]:
                screen[i] = np.float32(_ALONE) * max(whole.screen[i], np.float32(1.0))
                continue
            own = 0.0
            for k in range(4):
                step = 1 if k == 0 else columns + k - 2
                right = 1 if k == 0 else k - 2
                value = whole.stencil[k, y, x]
                if unknown[i + step]:
                    stencil[k, y, x] = value
                else:
                    own -= value
                if not unknown[i - step]:
                    own -= whole.stencil[k, y - (k > 0), x - right]
            screen[i] = own


@kernel
def _pull(start, stop, stencil, unknown, values, rhs):
    # The stiffness times the values, from differences, at the unknown nodes and with another sign.
    columns = stencil.shape[2]
    for y in range(start, stop):
        for x in range(columns):
            i = y * columns + x
            if not unknown[i]:
                continue
            for k in range(4):
                step = 1 if k == 0 else columns + k - 2
                right = 1 if k == 0 else k - 2
                ahead = stencil[k, y, x]
                behind = stencil[k, y - (k > 0), x - right]
                for c in range(values.shape[1]):
                    value = values[i, c]
                    rhs[i, c] -= ahead * (values[i + step, c] - value)
                    rhs[i, c] -= behind * (values[i - step, c] - value)


@kernel
def _add_where(start, stop, where, change, values):
    for i in range(start, stop):
        if where[i]:
            for c in range(values.shape[1]):
                values[i, c] += change[i, c]


def _at_ends(space: TextureSpace) -> Bools:
    # Which free points lie where the surface ends: (s,). A side of a piece that no other piece
    # has, and that no line of the lattice holds, lies there.
    cut = space.cut_cells
    pieces = cut.pieces
    last = np.zeros(len(pieces.points), dtype=np.bool_)
    last[pieces.start[1:] - 1] = True
    following = np.arange(1, len(last) + 1)
    following[last] = pieces.start[:-1]
    one, other = pieces.points, pieces.points[following]
    apart = np.abs(pieces.places - pieces.places[following])
    line = pieces.places % 1.0
    beside = (np.minimum(line, 1 - line) < 1e-9) & (apart < 1e-9)
    keys = np.minimum(one, other) * len(cut.kinds) + np.maximum(one, other)
    _, where, counts = np.unique(keys, return_inverse=True, return_counts=True)
    alone = (counts[where.reshape(-1)] == 1) & ~beside.any(axis=1) & (one != other)
    ends = np.zeros(len(cut.kinds), dtype=np.bool_)
    ends[one[alone]] = True
    ends[other[alone]] = True
    return ends[cut.free]


def _dot(a: Singles, b: Singles) -> float:
    return float(np.einsum("ij,ij->", a, b, dtype=np.float64))
