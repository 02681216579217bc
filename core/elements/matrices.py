# SPDX-License-Identifier: GPL-3.0-or-later
"""Finite elements on the texels of a surface: mass and stiffness across seams (paper B, section 5).

The unknowns are the values of the texels whose centers lie in charts, and those of points along
the seams, which both sides share (see `cut`). Functions are bilinear in cells that no chart outline
touches, as linear sampling shows them; in pieces of the other cells they are linear on each
triangle of a fan around the piece's middle, where the value is the mean of the corners' values. So
they are continuous across seams, and reproduce constants exactly, and linear functions where the
surface is flat.

Paper B uses the exterior texels of both sides as unknowns, and quadratic elements on a
triangulation of the cut cells. Here texels outside charts are no unknowns, as only their sums
would matter.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..atlas.atlas import TextureAtlas
from ..atlas.sheet import NOTHING, ROWS, faces_by_rows, span
from ..base.checks import Floats
from ..base.parallel import kernel, run
from ..base.progress import aside, ask
from ..base.vectors import after
from ..mesh.triangle_mesh import Ints
from ..sparse.components import connected_components
from ..sparse.matrix import Sparse, applied, couplings_of, from_triples, product, transposed
from .cut import NODE, CutCells, find_cut_cells, tempered_jacobians
from .sheet_matrix import SheetMatrix

_LEAST_MASS = 1e-12
"""Least mass of an unknown, so that each has an equation even if only slivers surround it."""

_LITTLE = 1e-9
"""Smallest share of a cell that a face must cover to count there; less is rounding."""

_CHUNKS = 16
"""Number of chunks in which all texels are summed, the same on every machine."""

_Single = npt.NDArray[np.float32]


class CellWeights(NamedTuple):
    """Weights of the cells, (rows, columns) float32, and of the pieces, (p,) float64."""

    cells: _Single
    pieces: Floats


class TextureSpace:
    """The function space on the surface that the texels of an atlas span.

    Its vectors are (n, c): first the sheet's nodes row by row, then the points along seams. Rows
    that are not unknowns stay 0.

    Parameters
    ----------
    atlas : TextureAtlas
    jump : float
        Where lengths change by more than this from face to face, in mean texel sizes over a texel,
        faces are also separated within cells.

    Attributes
    ----------
    size : int
        Length of vectors.
    labels : (rows, columns) int32
        The chart of each node that is an unknown; `NOTHING` at all others.
    cells : (rows, columns, 4) float32
        Integrals over each uncut cell of sqrt(det h) h^-1 (entries 11, 12 and 22, axis 1 the rows)
        and of sqrt(det h), in mean texel sizes.
    fans : (v, 4) float64
        For each corner of the pieces, the triangle with the next corner and the middle: half the
        cotangents opposite the sides corner-next, corner-middle and next-middle; its area.
    cut_cells : CutCells
    """

    def __init__(self, atlas: TextureAtlas, jump: float = np.inf) -> None:
        self.atlas = atlas
        jacobians = tempered_jacobians(atlas.metric)
        self.cut_cells = find_cut_cells(atlas, jacobians, jump)
        self.size = atlas.sheet.nodes.size + int(
            np.count_nonzero(self.cut_cells.unknowns >= atlas.sheet.nodes.size)
        )
        with aside("Measuring texels"):
            self.labels, self.cells = _measure_cells(atlas, jacobians, self.cut_cells)
            pieces = self.cut_cells.pieces
            self.fans = np.zeros((len(pieces.points), 4))
            run(_measure_fans, len(pieces.faces), pieces, self.fans)

    @property
    def area(self) -> float:
        """Area of the surface, in mean texel sizes squared."""
        return float(self.cells[..., 3].sum(dtype=np.float64) + self.fans[:, 3].sum())

    @cached_property
    def alike(self) -> CellWeights:
        """Weights of 1."""
        pieces = len(self.cut_cells.pieces.faces)
        return CellWeights(np.ones(self.labels.shape, dtype=np.float32), np.ones(pieces))

    def means(self, values: _Single) -> CellWeights:
        """Weight cells and pieces by the mean of their corners' values (n,)."""
        cells = np.zeros(self.labels.shape, dtype=np.float32)
        run(_mean_in_cells, len(cells), self.cells, values, cells, chunk=ROWS)
        at_corners, start = self.at_corners(values[:, None])[:, 0], self.cut_cells.pieces.start
        return CellWeights(cells, _reduced(np.add, at_corners, start) / np.diff(start))

    def least(self, values: _Single) -> CellWeights:
        """Weight cells and pieces by the minimum of the values (n,) at nodes inside their chart.

        A piece whose cell has no node inside is weighted by the minimum of its corners.
        """
        nodes, pieces = self.atlas.sheet.nodes, self.cut_cells.pieces
        cells = np.zeros(self.labels.shape, dtype=np.float32)
        run(_least_in_cells, len(cells), self.cells, values, cells, chunk=ROWS)
        on_pieces = _reduced(np.minimum, self.at_corners(values[:, None])[:, 0], pieces.start)
        run(_least_in_pieces, len(on_pieces), pieces.cells, nodes, values, on_pieces)
        return CellWeights(cells, on_pieces)

    def weighted(self, weights: CellWeights, only_mass: bool = False) -> TextureSpace:
        """Return the space with weighted cells and pieces; `only_mass` keeps the stiffness."""
        other = copy(self)
        first = 3 if only_mass else 0
        other.cells, other.fans = self.cells.copy(), self.fans.copy()
        other.cells[..., first:] *= weights.cells[..., None]
        repeats = np.diff(self.cut_cells.pieces.start)
        other.fans[:, first:] *= np.repeat(weights.pieces, repeats)[:, None]
        return other

    def diffusing(self, tensors: Floats) -> TextureSpace:
        """Return the space with an anisotropic stiffness; the mass stays.

        Parameters
        ----------
        tensors : (m, 3) float64
            Diffusion tensors, symmetric and positive definite, in the frame of each face: entries
            11, 12 and 22. The identity 1, 0, 1 changes nothing.
        """
        other = copy(self)
        jacobians = tempered_jacobians(self.atlas.metric)
        with aside("Measuring texels"):
            integrals = _integrals(jacobians, tensors)
            other.cells, _ = _integrated(self.atlas, integrals, self.cut_cells.cut)
            pieces = self.cut_cells.pieces
            # In the frame scaled by the tensor's inverse root, diffusion is isotropic.
            roots, areas = _inverse_roots(tensors)
            piece = np.repeat(pieces.faces, np.diff(pieces.start))
            frame = np.einsum("vij,vj->vi", roots[piece], pieces.frame)
            other.fans = np.zeros_like(self.fans)
            run(_measure_fans, len(pieces.faces), pieces._replace(frame=frame), other.fans)
            other.fans[:, :3] *= areas[piece, None]
            other.fans[:, 3] = self.fans[:, 3]
        return other

    def mean_metrics(self) -> _Single:
        """The metric h (entries 11, 12 and 22, axis 1 the rows) of uncut cells, and their area."""
        jacobians = tempered_jacobians(self.atlas.metric)
        with aside("Measuring texels"):
            metrics = np.einsum("fki,fkj->fij", jacobians, jacobians)
            areas = np.abs(np.linalg.det(jacobians))
            parts = [metrics[:, 0, 0], metrics[:, 0, 1], metrics[:, 1, 1], areas]
            return _integrated(self.atlas, np.stack(parts, axis=1), self.cut_cells.cut)[0]

    @cached_property
    def components(self) -> Ints:
        """The connected part of the surface of each unknown: (n,), -1 elsewhere."""
        charts, cut = self.atlas.charts, self.cut_cells
        pieces = cut.pieces
        own = np.repeat(charts.labels[pieces.faces], np.diff(pieces.start))
        count, points = len(charts.boxes), len(cut.kinds)
        _, parts = connected_components(count + points, own, count + pieces.points)
        found = np.full(self.size, NOTHING, dtype=np.int32)
        with aside("Measuring texels"):
            run(_name_parts, self.labels.size, self.labels.reshape(-1), parts, found)
        found[cut.unknowns] = parts[count + cut.free]
        return found

    def without_means(
        self, values: _Single, weights: npt.NDArray[np.floating], result: _Single
    ) -> None:
        """Subtract the weighted mean (n,) of each column, separately on each connected part.

        `result` may be `values`.
        """
        parts = self.components
        chunk = -(-len(values) // _CHUNKS)
        count = int(parts.max(initial=0)) + 1
        by_chunk = np.zeros((_CHUNKS, count, values.shape[1] + 1))
        with aside("Comparing texels"):
            run(_add_weighted, len(values), chunk, parts, weights, values, by_chunk, chunk=chunk)
            sums = by_chunk.sum(axis=0)
            means = sums[:, :-1] / np.where(sums[:, -1:] > 0, sums[:, -1:], 1.0)
            run(_subtract_means, len(values), parts, means, values, result)

    def matrix(
        self, screen: float, lumped: bool = False, where: npt.NDArray[np.bool_] | None = None
    ) -> SheetMatrix:
        """Assemble stiffness plus `screen` times mass, which is diagonal if `lumped`.

        The couplings of nodes outside `where` (rows, columns) with later ones are left out.
        """
        rows, columns = self.labels.shape
        stencil = np.zeros((4, rows, columns), dtype=np.float32)
        screens = np.zeros(self.size, dtype=np.float32)
        some = np.zeros((0, 0), dtype=np.bool_) if where is None else where
        with aside("Assembling"):
            run(_assemble_cells, rows, self.cells, screen, lumped, some, stencil, screens,
                chunk=ROWS)  # fmt: skip
        ask()
        seam, masses = self._assemble_pieces(0.0 if lumped else screen)
        unknowns = self.cut_cells.unknowns
        screens[unknowns] += (screen * masses).astype(np.float32)
        return SheetMatrix(
            stencil, self.labels, screens, unknowns, seam.start, seam.columns, seam.values
        )

    def _assemble_pieces(self, screen: float) -> tuple[Sparse, Floats]:
        # The couplings of seam unknowns, and their masses.
        pieces, interpolation = self.cut_cells.pieces, self.cut_cells.interpolation
        sizes = np.diff(pieces.start)
        first = np.concatenate([[0], np.cumsum(sizes * sizes)])
        i, j = np.empty(first[-1], dtype=np.int32), np.empty(first[-1], dtype=np.int32)
        entries, masses = np.empty(first[-1]), np.zeros(len(pieces.points))
        with aside("Assembling"):
            run(_assemble_fans, len(sizes), pieces, self.fans, first, screen, i, j, entries, masses)
        count = interpolation.shape[0]
        local = from_triples(i, j, entries, (count, count))
        ask()
        matrix = product(self._to_free, product(local, interpolation))
        ask()
        at_points = np.bincount(pieces.points, weights=masses, minlength=count)
        at_free = applied(self._to_free, at_points.astype(np.float64))
        return couplings_of(matrix), np.maximum(at_free, _LEAST_MASS)

    @cached_property
    def _to_free(self) -> Sparse:
        # Adds up values of all points at the free ones.
        return transposed(self.cut_cells.interpolation)

    def at_corners(self, values: _Single) -> Floats:
        """Evaluate vectors (n, c) at the corners of the pieces: (v, c)."""
        cut = self.cut_cells
        return applied(cut.interpolation, values[cut.unknowns])[cut.pieces.points]

    def apply_stiffness(
        self, values: _Single, weights: CellWeights | None = None, corners: Floats | None = None
    ) -> _Single:
        """Multiply by the stiffness, with weighted cells and pieces.

        Parameters
        ----------
        values : (n, c) float32
        weights : CellWeights, optional
        corners : (v, c) float64, optional
            Values at the corners of the pieces, if they differ between the sides of seams.
        """
        weights = self.alike if weights is None else weights
        result = np.zeros_like(values)
        with aside("Comparing texels"):
            run(_apply_stiffness, len(self.cells), self.cells, weights.cells, values, result,
                chunk=ROWS)  # fmt: skip
        cut = self.cut_cells
        given = self.at_corners(values) if corners is None else corners
        found = np.zeros_like(given)
        with aside("Comparing texels"):
            run(_apply_fan_stiffness, len(cut.pieces.faces), cut.pieces.start, self.fans,
                weights.pieces, given, found)  # fmt: skip
        at_points = self._sum_at_points(found)
        result[cut.unknowns] += applied(self._to_free, at_points).astype(np.float32)
        return result

    def _sum_at_points(self, at_corners: Floats) -> Floats:
        pieces, count = self.cut_cells.pieces, self.cut_cells.interpolation.shape[0]
        columns = [np.bincount(pieces.points, column, count) for column in at_corners.T]
        return np.stack(columns, axis=1)


def _reduced(of: np.ufunc, at_corners: Floats, start: npt.NDArray[np.int64]) -> Floats:
    return of.reduceat(at_corners, start[:-1]) if len(start) > 1 else np.zeros(0)


def _measure_cells(
    atlas: TextureAtlas, jacobians: Floats, cut_cells: CutCells
) -> tuple[npt.NDArray[np.int32], _Single]:
    # The labels of the nodes, and the integrals over uncut cells.
    shape = atlas.sheet.nodes.shape
    cells, faces = _integrated(atlas, _integrals(jacobians), cut_cells.cut)
    labels = np.full(shape, NOTHING, dtype=np.int32)
    run(_label_nodes, shape[0], faces, atlas.charts.labels, labels, chunk=ROWS)
    pieces = cut_cells.pieces
    own = np.flatnonzero(cut_cells.kinds[pieces.points] == NODE)
    piece = np.repeat(np.arange(len(pieces.faces)), np.diff(pieces.start))[own]
    y, x = np.round(pieces.places[own]).astype(np.int64).T
    labels[y, x] = atlas.charts.labels[pieces.faces[piece]]
    return labels, cells


def _integrals(jacobians: Floats, tensors: Floats | None = None) -> Floats:
    # Integrals over a cell within each face: see `TextureSpace.cells`.
    areas = np.abs(np.linalg.det(jacobians))
    (a, b), (c, d) = np.moveaxis(jacobians, 0, -1)
    p, q, r = (1.0, 0.0, 1.0) if tensors is None else tensors.T
    with np.errstate(all="ignore"):
        # sqrt(det h) J^-1 D J^-T, where the inverse is the adjoint over the determinant.
        integrals = np.stack(
            [
                (d * d * p - 2.0 * d * b * q + b * b * r) / areas,
                (-d * c * p + (d * a + b * c) * q - a * b * r) / areas,
                (c * c * p - 2.0 * c * a * q + a * a * r) / areas,
                areas,
            ],
            axis=1,
        )
    integrals[~(areas > 0)] = 0.0
    return integrals


def _integrated(
    atlas: TextureAtlas, integrals: Floats, cut: npt.NDArray[np.bool_]
) -> tuple[_Single, npt.NDArray[np.int32]]:
    # Integrals over uncut cells, and a face of each cell.
    shape = atlas.sheet.nodes.shape
    cells = np.zeros((*shape, 4), dtype=np.float32)
    faces = np.full(shape, NOTHING, dtype=np.int32)
    by_rows = faces_by_rows(atlas.sheet.points, shape[0])
    run(_integrate_cells, shape[0], atlas.sheet.points, by_rows, integrals, cut, faces, cells,
        chunk=ROWS)  # fmt: skip
    return cells, faces


def _inverse_roots(tensors: Floats) -> tuple[npt.NDArray[np.float64], Floats]:
    # D^(-1/2) of each face, and the root of det D.
    a, b, c = tensors.T
    det = np.sqrt(a * c - b * b)
    # The root of a 2x2 matrix is the matrix plus the root of its determinant, scaled.
    scale = det * np.sqrt(a + c + 2.0 * det)
    roots = np.stack([c + det, -b, -b, a + det], axis=1).reshape(-1, 2, 2)
    return roots / scale[:, None, None], det


@kernel
def _add_cover(column, height, middle, parts, covers):
    # Part of an edge within a cell: the area to its right, in this cell and in all cells that
    # follow.
    parts[column] += height * (1.0 - (middle - column))
    covers[column + 1] += height


@kernel
def _add_edge(triangle, k, row, left, parts, covers):
    # The part of an edge within a row of cells, with columns counted from `left`.
    m = after(k)
    ay, ax = triangle[k, 0] - row, triangle[k, 1] - left
    by, bx = triangle[m, 0] - row, triangle[m, 1] - left
    if ay == by or max(ay, by) <= 0.0 or min(ay, by) >= 1.0:
        return
    most = parts.shape[0] - 1.0
    slope = (bx - ax) / (by - ay)
    y, end_y = min(max(ay, 0.0), 1.0), min(max(by, 0.0), 1.0)
    x = min(max(ax + slope * (y - ay), 0.0), most)
    end_x = min(max(bx + slope * (end_y - by), 0.0), most)
    column, last = int(x), int(end_x)
    step = 1 if last > column else -1
    steepness = (end_y - y) / (end_x - x) if last != column else 0.0
    first_y, first_x = y, x
    while column != last:
        next_x = column + 1.0 if step > 0 else float(column)
        next_y = first_y + (next_x - first_x) * steepness
        _add_cover(column, next_y - y, 0.5 * (x + next_x), parts, covers)
        y, x = next_y, next_x
        column += step
    _add_cover(column, end_y - y, 0.5 * (x + end_x), parts, covers)


@kernel
def _integrate_cells(start, stop, points, by_rows, integrals, cut, faces, cells):
    parts, covers = np.zeros(cut.shape[1] + 2), np.zeros(cut.shape[1] + 3)
    bands, listed, in_rows = by_rows
    chunk = start // ROWS
    for f in in_rows[listed[chunk] : listed[chunk + 1]]:
        triangle = points[f]
        if integrals[f, 3] == 0:
            continue
        whole = integrals[f]
        for row in range(max(bands[f, 0], start), min(bands[f, 1] + 1, stop)):
            first, last = span(triangle, row, row + 1)
            if last < first:
                continue
            left, right = int(np.floor(first)), int(np.floor(last))
            count = right - left + 1
            parts[: count + 1] = 0.0
            covers[: count + 2] = 0.0
            for k in range(3):
                _add_edge(triangle, k, row, left, parts[: count + 1], covers)
            cover = 0.0
            for n in range(count):
                cover += covers[n]
                share = abs(cover + parts[n])
                if share > _LITTLE and not cut[row, left + n]:
                    faces[row, left + n] = f
                    for m in range(4):
                        cells[row, left + n, m] += share * whole[m]


@kernel
def _name_parts(start, stop, labels, parts, found):
    for i in range(start, stop):
        if labels[i] != NOTHING:
            found[i] = parts[labels[i]]


@kernel
def _label_nodes(start, stop, faces, charts, labels):
    for y in range(max(start, 1), stop):
        for x in range(1, labels.shape[1]):
            for n in range(4):
                face = faces[y - (n >> 1), x - (n & 1)]
                if face >= 0:
                    labels[y, x] = charts[face]


@kernel
def _measure_fans(start, stop, pieces, fans):
    frame = pieces.frame
    for piece in range(start, stop):
        first, last = pieces.start[piece], pieces.start[piece + 1]
        mx, my = 0.0, 0.0
        for n in range(first, last):
            mx += frame[n, 0] / (last - first)
            my += frame[n, 1] / (last - first)
        for n in range(first, last):
            m = n + 1 if n + 1 < last else first
            ax, ay = frame[n, 0] - mx, frame[n, 1] - my
            bx, by = frame[m, 0] - mx, frame[m, 1] - my
            double = abs(ax * by - ay * bx)
            fans[n, 3] = 0.5 * double
            if double < 1e-18:
                continue
            # Half the cotangent at a corner: inner product of its sides over 4 times the area.
            fans[n, 0] = 0.5 * (ax * bx + ay * by) / double
            fans[n, 1] = 0.5 * (bx * (bx - ax) + by * (by - ay)) / double
            fans[n, 2] = 0.5 * (ax * (ax - bx) + ay * (ay - by)) / double


@kernel
def _mean_in_cells(start, stop, cells, values, out):
    columns = cells.shape[1]
    for y in range(start, stop):
        for x in range(columns):
            if cells[y, x, 3] > 0:
                top = y * columns + x
                low = top + columns
                total = values[top] + values[top + 1] + values[low] + values[low + 1]
                out[y, x] = 0.25 * total


@kernel
def _least_in_cells(start, stop, cells, values, out):
    columns = cells.shape[1]
    for y in range(start, stop):
        for x in range(columns):
            if cells[y, x, 3] > 0:
                top = y * columns + x
                low = top + columns
                above = min(values[top], values[top + 1])
                out[y, x] = min(above, min(values[low], values[low + 1]))


@kernel
def _least_in_pieces(start, stop, cells, nodes, values, out):
    columns = nodes.shape[1]
    for piece in range(start, stop):
        if cells[piece] < 0:
            continue
        least = np.inf
        row, column = divmod(cells[piece], columns)
        for y in range(row, row + 2):
            for x in range(column, column + 2):
                if nodes[y, x] >= 0:
                    least = min(least, values[y * columns + x])
        if least < np.inf:
            out[piece] = least


@kernel
def _assemble_cells(start, stop, cells, screen, lumped, where, stencil, screens):
    columns = cells.shape[1]
    shared = 0.0 if lumped else screen
    for y in range(max(start, 1), stop):
        for x in range(1, columns):
            # Cells above left, above right, below left and below right of the node.
            a, b, c, d = cells[y - 1, x - 1], cells[y - 1, x], cells[y, x - 1], cells[y, x]
            area = a[3] + b[3] + c[3] + d[3]
            if area == 0:
                continue
            screens[y * columns + x] = 0.25 * screen * area
            if where.size > 0 and not where[y, x]:
                continue
            stencil[0, y, x] = (b[0] + d[0]) / 6 - (b[2] + d[2]) / 3 + shared * (b[3] + d[3]) / 18
            stencil[2, y, x] = (c[2] + d[2]) / 6 - (c[0] + d[0]) / 3 + shared * (c[3] + d[3]) / 18
            stencil[1, y, x] = -(c[0] + c[2]) / 6 + c[1] / 2 + shared * c[3] / 36
            stencil[3, y, x] = -(d[0] + d[2]) / 6 - d[1] / 2 + shared * d[3] / 36


@kernel
def _assemble_fans(start, stop, pieces, fans, first, screen, rows, columns, entries, masses):
    for piece in range(start, stop):
        low, high = pieces.start[piece], pieces.start[piece + 1]
        n = high - low
        out = entries[first[piece] : first[piece + 1]].reshape(n, n)
        out[:] = 0.0
        # The middle's value is the mean of the corners: distribute its couplings equally.
        centre = np.zeros(n)
        total = 0.0
        total_mass = 0.0
        for i in range(n):
            j = i + 1 if i + 1 < n else 0
            w, p, q, area = fans[low + i]
            mass = screen * area / 12
            out[i, i] += w + p + 2 * mass
            out[j, j] += w + q + 2 * mass
            out[i, j] += mass - w
            out[j, i] += mass - w
            centre[i] += mass - p
            centre[j] += mass - q
            total += p + q + 2 * mass
            masses[low + i] += area / 3
            masses[low + j] += area / 3
            total_mass += area / 3
        for i in range(n):
            masses[low + i] += total_mass / n
            for j in range(n):
                out[i, j] += (centre[i] + centre[j]) / n + total / (n * n)
                rows[first[piece] + i * n + j] = pieces.points[low + i]
                columns[first[piece] + i * n + j] = pieces.points[low + j]


@kernel
def _add_weighted(start, stop, chunk, parts, weights, values, sums):
    last = values.shape[1]
    total = np.zeros(last + 1)
    part = -1
    for i in range(start, stop):
        if parts[i] < 0:
            continue
        if parts[i] != part:
            if part >= 0:
                sums[start // chunk, part] += total
            part = parts[i]
            total[:] = 0.0
        weight = np.float64(weights[i])
        total[last] += weight
        for c in range(last):
            total[c] += weight * values[i, c]
    if part >= 0:
        sums[start // chunk, part] += total


@kernel
def _subtract_means(start, stop, parts, means, values, out):
    for i in range(start, stop):
        for c in range(values.shape[1]):
            mean = means[parts[i], c] if parts[i] >= 0 else 0.0
            out[i, c] = values[i, c] - mean


@kernel
def _apply_stiffness(start, stop, cells, weights, values, out):
    # Writes the sums at nodes of rows start .. stop - 1. Channels are separated row by row, so
    # that the loops along rows become vector instructions.
    rows, columns = weights.shape
    third, sixth, quarter = np.float32(1 / 3), np.float32(1 / 6), np.float32(0.25)
    given = np.zeros((2, values.shape[1], columns), dtype=np.float32)
    found = np.zeros_like(given)
    parts = np.zeros((3, columns), dtype=np.float32)
    behind = np.zeros((2, columns), dtype=np.float32)
    first = max(start - 1, 0)
    _take_row(values, first, given[first & 1])
    for y in range(first, min(stop, rows - 1)):
        upper, lower = given[y & 1], given[(y + 1) & 1]
        sums, next_sums = found[y & 1], found[(y + 1) & 1]
        _take_row(values, y + 1, lower)
        row, share = cells[y], weights[y]
        for k in range(3):
            part = parts[k]
            for x in range(columns):
                part[x] = share[x] * row[x, k]
        rr, rc, cc = parts[0], parts[1], parts[2]
        on_upper, on_lower = behind[0], behind[1]
        for j in range(values.shape[1]):
            a, d = upper[j], lower[j]
            own, its = sums[j], next_sums[j]
            for x in range(columns - 1):
                left, right = d[x] - a[x], d[x + 1] - a[x + 1]
                above, below = a[x + 1] - a[x], d[x + 1] - d[x]
                on_left = rr[x] * (third * left + sixth * right)
                on_top = cc[x] * (third * above + sixth * below)
                mixed = quarter * rc[x] * (above + below)
                other = quarter * rc[x] * (left + right)
                own[x] -= on_left + on_top + mixed + other
                on_right = rr[x] * (sixth * left + third * right)
                on_upper[x] = on_top - on_right + other - mixed
            for x in range(columns - 1):
                left, right = d[x] - a[x], d[x + 1] - a[x + 1]
                above, below = a[x + 1] - a[x], d[x + 1] - d[x]
                on_low = cc[x] * (sixth * above + third * below)
                mixed = quarter * rc[x] * (above + below)
                other = quarter * rc[x] * (left + right)
                its[x] = rr[x] * (third * left + sixth * right) - on_low + mixed - other
                on_right = rr[x] * (sixth * left + third * right)
                on_lower[x] = on_right + on_low + mixed + other
            _add_behind(on_upper, own)
            _add_behind(on_lower, its)
        if y >= start:
            _put_row(sums, y, out)


@kernel
def _take_row(values, y, out):
    columns = out.shape[1]
    for j in range(out.shape[0]):
        part = values[y * columns : (y + 1) * columns, j]
        row = out[j]
        for x in range(columns):
            row[x] = part[x]


@kernel
def _put_row(sums, y, out):
    columns = sums.shape[1]
    for j in range(sums.shape[0]):
        part = out[y * columns : (y + 1) * columns, j]
        row = sums[j]
        for x in range(columns):
            part[x] = row[x]


@kernel
def _add_behind(values, out):
    # The contributions of cells to the nodes on their right.
    row = out[1:]
    for x in range(len(row)):
        row[x] += values[x]


@kernel
def _apply_fan_stiffness(start, stop, starts, fans, weights, values, out):
    for piece in range(start, stop):
        low, high = starts[piece], starts[piece + 1]
        for c in range(values.shape[1]):
            middle = values[low:high, c].mean()
            centre = 0.0
            for i in range(low, high):
                j = i + 1 if i + 1 < high else low
                along = fans[i, 0] * (values[i, c] - values[j, c])
                here = fans[i, 1] * (values[i, c] - middle)
                there = fans[i, 2] * (values[j, c] - middle)
                out[i, c] += along + here
                out[j, c] += there - along
                centre -= here + there
            for i in range(low, high):
                out[i, c] = weights[piece] * (out[i, c] + centre / (high - low))
