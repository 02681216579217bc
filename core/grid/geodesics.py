# SPDX-License-Identifier: GPL-3.0-or-later
"""Geodesic distances on images and other grids of points, by fast marching from one pixel.

A grid of points in space is a surface: an image's pixels at (x, y, beta I), or the points of a
parametric manifold with beta I as further coordinates. Each pixel has eight neighbours; it forms
a triangle with each two of them that touch, through which its distance is updated. Triangles are
given by their side lengths in space, so their angles are those of the metric.

References
----------
A. Spira, R. Kimmel: An Efficient Solution to the Eikonal Equation on Parametric Manifolds, 2004:
fast marching on a grid with a metric, and the splitting of obtuse triangles. M. Novotni, R. Klein:
Computing Geodesic Distances on Triangular Meshes, 2002: circular fronts.

Cells are the pixels of a band of rows with a frame of one cell around them, numbered row by row.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel

# The neighbours of a pixel, clockwise from the right: even ones along the axes, odd diagonal.
_DOWN = np.array([0, 1, 1, 1, 0, -1, -1, -1])
_RIGHT = np.array([1, 1, 0, -1, -1, -1, 0, 1])

_STENCIL = 40  # numbers per cell: eight lengths to neighbours, four for each of eight triangles
MOST_SPLITS = 16
"""Most parts of a split obtuse triangle; with more needed, distances through it are too long."""

FARTHEST_SPLIT = MOST_SPLITS + 1
"""Largest distance in pixels, along each axis, of the corners of these parts."""

MEASURED = np.float32(-1.0)
"""As `spacing`: the guide is measured in units that differ from place to place."""

_CELL = 0xFFFFFFFF  # masking tells the compiler that an index is not negative


class Band(NamedTuple):
    """The surface in a band of rows, as `march` needs it."""

    offsets: npt.NDArray[np.int64]  # from a cell to its eight neighbours
    stencils: npt.NDArray[np.float32]  # per cell: see `_fill_stencils`
    ends: npt.NDArray[np.int64]  # ends of each cell's links: the paths through split triangles
    targets: npt.NDArray[np.int32]  # per link: see `_list_splits`
    links: npt.NDArray[np.float32]
    unsplit: int  # obtuse triangles that needed more parts than `MOST_SPLITS`


class BandFront(NamedTuple):
    """Working memory and result of `march`, per cell of a band."""

    final: npt.NDArray[np.float32]  # squared distances, infinite where the front has not been
    tentative: npt.NDArray[np.float32]  # negative where the front has been or must not go
    queue: npt.NDArray[np.int64]
    reached: npt.NDArray[np.int32]


@kernel
def _fill_stencils(guide, spacing, first, last, squares, obtuse, stencils):
    """Measure the triangles around all pixels of the rows ``first <= y < last``.

    Parameters
    ----------
    guide : (h, w, k) float32
        The coordinates of the points, without x and y if these are the pixel's.
    spacing : float32
        See `chord`.
    first, last : int
    squares : (cells, 4) float32
        Receives squared lengths to the right, lower right, lower and lower left; NaN where there
        is no such neighbour.
    obtuse : (cells,) uint8
        Receives a bit for each triangle that is obtuse at the pixel.
    stencils : (cells, _STENCIL) float32
        Receives the lengths and triangles. A triangle has its side away from the pixel at y = 0
        with the axis neighbour at x = 0: half of the side, half of its inverse, and x and y of the
        pixel.
    """
    columns = guide.shape[1]
    width = columns + 2
    squares[:] = np.nan
    obtuse[:] = 0
    for y in range(first, last):
        for x in range(columns):
            for k in range(4):
                down, right = y + _DOWN[k], x + _RIGHT[k]
                if down < last and 0 <= right < columns:
                    cell = (y - first + 1) * width + x + 1
                    squares[cell, k] = chord(guide, spacing, y, x, down, right)
    for y in range(first, last):
        for x in range(columns):
            cell = (y - first + 1) * width + x + 1
            spokes = stencils[cell]
            for k in range(8):
                spokes[k] = _square(squares, width, cell, k)
            for j in range(8):
                axis, diagonal = _sides(j)
                side = _opposite(squares, width, cell, j)
                if spokes[axis] + spokes[diagonal] < side:
                    obtuse[cell] |= 1 << j
                place = 8 + 4 * j
                _place_triangle(spokes[axis], spokes[diagonal], side, spokes[place : place + 4])
            for k in range(8):
                spokes[k] = _root(spokes[k])


@kernel
def chord(guide, spacing, y, x, down, right):
    """Compute the squared Euclidean distance of two pixels in space.

    Parameters
    ----------
    guide : (h, w, k) float32
        The coordinates of the points.
    spacing : float32
        Squared distance of pixels along the axes in the plane of the image; 0 if `guide` holds
        all coordinates; `MEASURED` if its last four are a position in space and the local factor
        of lengths in space.
    y, x, down, right : int
        Rows and columns of the two pixels.
    """
    total = np.float32(0.0)
    count = guide.shape[2]
    if spacing < 0:
        count -= 4
        for c in range(count, count + 3):
            step = guide[down, right, c] - guide[y, x, c]
            total += step * step
        total *= guide[y, x, count + 3] * guide[down, right, count + 3]
    else:
        total = spacing * np.float32((down - y) * (down - y) + (right - x) * (right - x))
    for c in range(count):
        step = guide[down, right, c] - guide[y, x, c]
        total += step * step
    return total


@kernel
def _sides(j):
    # The axis neighbour and the diagonal neighbour of triangle j.
    return (j + 1) & 6, j | 1


@kernel
def _square(squares, width, cell, k):
    # The squared length from a cell to its neighbour in direction k.
    if k < 4:
        return squares[cell, k]
    return squares[cell + _DOWN[k] * width + _RIGHT[k], k - 4]


@kernel
def _opposite(squares, width, cell, j):
    # The squared length of the side of triangle j away from the cell.
    axis = (j + 1) & 6
    corner = cell + _DOWN[axis] * width + _RIGHT[axis]
    quarter = 2 if j & 1 == 0 else 6  # a quarter turn from the axis to the diagonal's side
    return _square(squares, width, corner, (axis + quarter) & 7)


@kernel
def _place_triangle(near, far, side, placed):
    # From squared lengths: pixel to the corner at x = 0, pixel to the other corner, the side.
    length = _root(side)
    half = np.float32(0.5)
    along = half * (near + side - far) / length
    placed[0] = half * length
    placed[1] = half / length
    placed[2] = along
    placed[3] = _root(max(near - along * along, np.float32(0.0)))


@kernel
def _list_splits(guide, spacing, limit, first, last, squares, obtuse, cursors, targets, links):
    """List, for each cell, the links that lead from it through parts of obtuse triangles.

    Parameters
    ----------
    guide, spacing, first, last, squares, obtuse
        As in `_fill_stencils`.
    limit : float32
        Squared distance beyond which nothing is needed.
    cursors : (cells,) int64
        The place of each cell's next link; advanced by the number of its links.
    targets : (links, 2) int32
        The cell a link leads to, and the third cell of the triangle. If empty, links are only
        counted.
    links : (links, 5) float32
        The link's length, and the triangle as in `_fill_stencils`, this cell at x = 0.

    Returns
    -------
    int
        Number of triangles that needed more parts than `MOST_SPLITS`.
    """
    unsplit = 0
    columns = guide.shape[1]
    width = columns + 2
    corners = np.empty((MOST_SPLITS, 4), np.int64)
    lengths = np.empty((MOST_SPLITS, 3), np.float32)
    for y in range(first, last):
        for x in range(columns):
            cell = (y - first + 1) * width + x + 1
            for j in range(8):
                if (obtuse[cell] >> j) & 1 == 0:
                    continue
                count, full = _split(guide, spacing, limit, first, last, squares, y, x, j,
                                     corners, lengths)  # fmt: skip
                unsplit += full
                for i in range(count):
                    near = _cell(y + corners[i, 0], x + corners[i, 1], first, last, width)
                    far = _cell(y + corners[i, 2], x + corners[i, 3], first, last, width)
                    for swapped in range(2):
                        start, other = (far, near) if swapped else (near, far)
                        place = cursors[start]
                        cursors[start] += 1
                        if targets.size == 0:
                            continue
                        targets[place, 0] = cell
                        targets[place, 1] = other
                        link = links[place]
                        link[0] = _root(lengths[i, swapped])
                        _place_triangle(
                            lengths[i, swapped], lengths[i, 1 - swapped], lengths[i, 2], link[1:]
                        )
    return unsplit


@kernel
def _cell(y, x, first, last, width):
    # Cell 0 is in the frame, which no front enters. It represents all cells beyond the band, so
    # that bands of other rows have the same distances.
    return (y - first + 1) * width + x + 1 if first <= y < last else 0


@kernel
def _split(guide, spacing, limit, first, last, squares, y, x, j, corners, lengths):
    # Splits triangle j, obtuse at the pixel, by unfolding the triangles beyond it (Kimmel and
    # Sethian): the sum of two corners' offsets is the next point between them. Returns the number
    # of parts, or 0 if it cannot be split, and whether more parts would be needed. The parts'
    # corners are at offsets `corners`; `lengths` are squared: to the first corner, to the second,
    # and between them.
    width = guide.shape[1] + 2
    cell = (y - first + 1) * width + x + 1
    axis, diagonal = _sides(j)
    near = _square(squares, width, cell, axis)
    far = _square(squares, width, cell, diagonal)
    side = _opposite(squares, width, cell, j)
    corners[0, 0], corners[0, 1] = _DOWN[axis], _RIGHT[axis]
    corners[0, 2], corners[0, 3] = _DOWN[diagonal], _RIGHT[diagonal]
    lengths[0, 0], lengths[0, 1], lengths[0, 2] = near, far, side
    half = np.float32(0.5)
    count = 1
    full = False
    i = 0
    while i < count:
        near, far, side = lengths[i]
        down = y + corners[i, 0] + corners[i, 2]
        right = x + corners[i, 1] + corners[i, 3]
        acute = near + far >= side
        outside = down < 0 or down >= guide.shape[0] or right < 0 or right >= guide.shape[1]
        outside |= max(abs(down - y), abs(right - x)) > FARTHEST_SPLIT
        if acute or outside:
            i += 1
            continue
        # The side lies along x; the pixel is above it, the new corner below.
        to_near = chord(guide, spacing, down, right, y + corners[i, 0], x + corners[i, 1])
        to_far = chord(guide, spacing, down, right, y + corners[i, 2], x + corners[i, 3])
        length = _root(side)
        along = half * (near + side - far) / length
        height = _root(max(near - along * along, np.float32(0.0)))
        beyond = half * (to_near + side - to_far) / length
        depth = _root(max(to_near - beyond * beyond, np.float32(0.0)))
        cross = along * depth + beyond * height
        across = beyond - along
        square = across * across + (height + depth) * (height + depth)
        if not 0 < cross < length * (height + depth) or height * height > limit:
            i += 1
            continue
        if count == MOST_SPLITS:
            full = True
            break
        corners[count, 0], corners[count, 1] = down - y, right - x
        corners[count, 2], corners[count, 3] = corners[i, 2], corners[i, 3]
        lengths[count, 0], lengths[count, 1], lengths[count, 2] = square, far, to_far
        corners[i, 2], corners[i, 3] = down - y, right - x
        lengths[i, 1], lengths[i, 2] = square, to_near
        count += 1
    return count if count > 1 else 0, full


@kernel
def open_band(guide, spacing, limit, first, last):
    """Prepare for marching in the rows ``first <= y < last``.

    Parameters
    ----------
    guide : (h, w, k) float32
        The coordinates of the points, without x and y if these are the pixel's.
    spacing : float32
        See `chord`.
    limit : float32
        The largest squared distance of the marches.
    first, last : int

    Returns
    -------
    band : Band
    front : BandFront
        All values are infinite, but `tentative` is negative in the frame.
    """
    columns = guide.shape[1]
    width = columns + 2
    cells = (last - first + 2) * width
    squares = np.empty((cells, 4), np.float32)
    obtuse = np.empty(cells, np.uint8)
    stencils = np.empty((cells, _STENCIL), np.float32)
    _fill_stencils(guide, spacing, first, last, squares, obtuse, stencils)
    ends = np.zeros(cells + 1, np.int64)
    for _ in range(2):  # count, then fill
        targets = np.empty((ends[cells], 2), np.int32)
        links = np.empty((ends[cells], 5), np.float32)
        cursors = ends[:-1].copy()
        unsplit = _list_splits(guide, spacing, limit, first, last, squares, obtuse, cursors,
                               targets, links)  # fmt: skip
        ends[1:] = np.cumsum(cursors - ends[:-1])
    final = np.full(cells, np.inf, np.float32)
    tentative = np.full(cells, -1.0, np.float32)
    for row in range(1, last - first + 1):
        tentative[row * width + 1 : row * width + 1 + columns] = np.inf
    # Each path into a cell puts it into the queue at most once.
    queue = np.empty(8 * cells + ends[cells] + 1, np.int64)
    band = Band(_DOWN * width + _RIGHT, stencils, ends, targets, links, unsplit)
    return band, BandFront(final, tentative, queue, np.empty(cells, np.int32))


@kernel
def march(source, limit, band, front):
    """Find the cells within the squared distance `limit` of a cell, nearest first.

    Parameters
    ----------
    source : int
    limit : float32
    band, front : Band, BandFront
        From `open_band`. For cells that are reached, ``final`` becomes the squared distance and
        ``tentative`` negative. The front does not enter cells where it is negative already.

    Returns
    -------
    int
        Number of cells written to ``reached``.
    """
    offsets, stencils, ends, targets, links, _ = band
    final, tentative, queue, reached = front
    infinite = np.float32(np.inf)
    count = 0
    queue[0] = source
    head, tail = 0, 1
    while head < tail:
        entry = queue[head]
        head += 1
        cell = entry & _CELL
        if tentative[cell] < 0:
            continue  # reached by a shorter path before
        square = np.int32(entry >> 32).view(np.float32)
        final[cell] = square
        tentative[cell] = np.float32(-1.0)
        reached[count] = cell
        count += 1
        distance = _root(square)
        # Each triangle here has an axis neighbour as a corner.
        before = final[(cell + offsets[6]) & _CELL]
        here = final[(cell + offsets[0]) & _CELL]
        for k in range(0, 8, 2):
            after = final[(cell + offsets[(k + 2) & 7]) & _CELL]
            to = (cell + offsets[k]) & _CELL
            if tentative[to] >= 0:
                path = distance + stencils[cell, k]
                best = path * path
                if before < infinite:
                    best = min(best, _through(stencils, to, 8 + 4 * (k ^ 4), square, before))
                if after < infinite:
                    best = min(best, _through(stencils, to, 8 + 4 * ((k + 3) & 7), square, after))
                tail = _offer(to, best, limit, tentative, queue, head, tail)
            to = (cell + offsets[k + 1]) & _CELL
            if tentative[to] >= 0:
                path = distance + stencils[cell, k + 1]
                best = path * path
                if here < infinite:
                    best = min(best, _through(stencils, to, 8 + 4 * ((k + 5) & 7), here, square))
                if after < infinite:
                    best = min(best, _through(stencils, to, 8 + 4 * (k ^ 4), after, square))
                tail = _offer(to, best, limit, tentative, queue, head, tail)
            before, here = here, after
        for e in range(ends[cell], ends[cell + 1]):
            to = targets[e, 0] & _CELL
            if tentative[to] >= 0:
                path = distance + links[e, 0]
                best = path * path
                other = final[targets[e, 1] & _CELL]
                if other < infinite:
                    best = min(best, _through(links, e, 1, square, other))
                tail = _offer(to, best, limit, tentative, queue, head, tail)
    return count


@kernel
def _through(triangles, row, place, near, far):
    # The squared distance of a pixel through a triangle, stored from a place in a row on, given
    # the squared distances of the other corners; infinite if the straight line misses the side.
    # The front is a circle around a point in the triangle's plane. No branches: they cost more.
    half = triangles[row, place]
    x, y = triangles[row, place + 2], triangles[row, place + 3]
    middle = half + (near - far) * triangles[row, place + 1]
    depth = _root(near - middle * middle)  # NaN fails both comparisons
    down = y + depth
    cross = middle * y + x * depth
    across = x - middle
    inside = (cross >= np.float32(0.0)) & (cross <= np.float32(2.0) * half * down)
    return across * across + down * down if inside else np.float32(np.inf)


@kernel
def _root(square):
    # A power compiles to one instruction, where numba's square root calls a function.
    return square ** np.float32(0.5)


@kernel
def _offer(cell, square, limit, tentative, queue, head, tail):
    # Inserts a cell into the sorted entries ``head <= i < tail`` if this path is shorter; it mostly
    # belongs near their end. Returns the new tail.
    if not (square < tentative[cell] and square <= limit):
        return tail
    tentative[cell] = square
    # The bits of nonnegative floats sort like the floats.
    entry = (np.int64(np.float32(square).view(np.int32)) << 32) | cell
    place = tail
    while place > head and queue[(place - 1) & _CELL] > entry:
        queue[place] = queue[(place - 1) & _CELL]
        place -= 1
    queue[place] = entry
    return tail + 1
