# SPDX-License-Identifier: GPL-3.0-or-later
"""Candidates for the denoised normal of each face, and the features by which a network weighs them.

Not in the papers. No filter is best for all noise: those that keep creases keep terraces too, and
those that flatten wide bumps flatten relief. So the normals are smoothed in many ways: by plain
means, by means of similar normals, by means guided by the most uniform patches, and by umbrella
smoothing of the vertices, which copes with turned-over faces. The features are the distances
between all pairs of candidates, and means of such distances around the face, at three scales.
Angles alone cannot tell noise from relief; the height of what smoothing removes, relative to the
edge length, can.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import floor
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.progress import ask, phase
from ..base.vectors import TIE_BREAKER, cross, dot, edge
from ..mesh.adjacency import Ints
from ..mesh.calculus import average_to_faces
from ..mesh.triangle_mesh import HUB, Floats, TriangleMesh
from ..mixture.cells import MeansAround
from ..mixture.choice import logarithm, pair_count, tell_pairs
from ..mixture.network import Singles, digest

FIRST, NEXT = 21, 12
"""Number of candidates in the first stage, and in later stages."""

_PLAIN, _NEXT_PLAIN = (1, 3, 8, 20), (1, 4, 10)
"""Numbers of passes of the plain mean, each of which gives a candidate: first and later stages."""

GIVEN = 1 + len(_NEXT_PLAIN)
"""Index of the input mesh's normals among the candidates of later stages."""

_ALIKE, _NEXT_ALIKE = ((0.2, (3, 10)), (0.4, (3, 8))), ((0.12, (2, 8)), (0.3, (4, 12)))
"""Means of similar normals: the standard deviation of the Gaussian weight, as a distance between
unit normals, and the numbers of passes."""

_BY_MEANS = 0.25, 8
"""The same, with the plain means after 3 passes as guide in place of the normals themselves."""

_GUIDED, _NEXT_GUIDED, _GUIDED_PASSES, _PATCH_INTERVAL = 0.3, 0.2, (4, 12), 4
"""Means guided by the most uniform patches: standard deviations in the first and in later stages,
numbers of passes, and after how many passes the patches are found again."""

_UMBRELLA = 1, 2, 4, 8, 24, 60
"""Numbers of umbrella passes over the vertices."""

_ALIKE_AFTER_ONE, _GUIDED_AFTER_TWO = (0.2, (3, 10)), 0.25
"""Candidates that combine both: means of similar normals after one umbrella pass, as in `_ALIKE`,
and guided means after two, as `_GUIDED`."""

_BANDS = (0, 2), (2, 8), (8, 24), (24, 60)
"""Pairs of numbers of umbrella passes: the height that the passes between them remove is a
feature."""

_CHANGES = ((0, 1), (1, 2), (2, 3), (3, 4), (0, 6), (6, 8), (8, 4), (10, 11), (11, 8), (9, 0),
            (0, 12), (12, 13), (13, 14), (16, 18), (14, 19), (19, 20))  # fmt: skip
_NEXT_CHANGES = (0, 1), (1, 2), (0, 4), (0, 5), (0, 7), (7, 9), (10, 11)
"""Pairs of candidates, by index, whose distances are averaged around a face."""

_SIMILAR = 0.02, 0.1
"""Distances d0 between unit normals: neighbours at distance d count as similar by
exp(-(d / d0)^2)."""

_NEAR, _WIDE, _CELLS = 3, 20, 12.0
"""The three scales of the features: averaging passes for the near and the wide one, and the size of
grid cells, in mean edge lengths, for the one of the region."""

_FACE_MEASURES = len(_SIMILAR) + 4
_AROUND, _NEXT_AROUND = len(_CHANGES) + _FACE_MEASURES + len(_BANDS), len(_NEXT_CHANGES)

TOLD = pair_count(FIRST) + 3 * _AROUND
NEXT_TOLD = pair_count(NEXT) + 3 * (_AROUND + _NEXT_AROUND)
"""Number of features of a face: first stage, and later stages."""

DEFINITION = digest("smoothings 1", repr((_PLAIN, _NEXT_PLAIN, _ALIKE, _NEXT_ALIKE, _BY_MEANS,
    _GUIDED, _NEXT_GUIDED, _GUIDED_PASSES, _PATCH_INTERVAL, _UMBRELLA, _ALIKE_AFTER_ONE,
    _GUIDED_AFTER_TWO, _BANDS, _CHANGES, _NEXT_CHANGES, _SIMILAR, _NEAR, _WIDE,
    _CELLS)))  # fmt: skip
"""Digest of what the features mean. When a change of the code changes them, raise the number in the
first text."""

_MOST_AROUND = 60
"""Most faces around a face that are averaged."""

_SHRUNK = 1e-9
"""Umbrella passes that shrink the mesh to this share of its area have no effect."""

_PULL, _ROUNDING = np.float32(0.3), np.float32(1e-6)
"""As in `sides`, but in single precision."""

_BUMP_PASSES, _WIDTH_POWER, _FURTHER_FACTOR = 2.0, 1.5, 2.0
"""Averaging passes for bumps of width w, in mean edge lengths, are the first number times w to the
power of the second. Diffusion would need the power 2, but would remove more relief. Then as many
passes follow times the third; they count where there is no relief."""

_BUMP_SPREAD = 0.35
"""Standard deviation of the guided mean's Gaussian weight, as a distance between unit normals."""

_LEFTOVER = 0.1
"""On bumps, the squared turn by the further passes, over that by the first ones."""

_BUMP_REGION = 4.0
"""Size of the grid cells in which squared turns are averaged, over the width of bumps."""

_PASSES_OF_CREASES, _CRISP_SPREAD = 4, 0.15
"""Passes that round or sharpen creases; and, to sharpen, the standard deviation of the guided
mean's Gaussian weight."""

_MESSAGE = "Denoising"


class Smoothings(NamedTuple):
    """Smoothed normals of the faces, and the features around them.

    Attributes
    ----------
    normals : (m, k, 3) float32
        k candidates for each face. The first one is the normal that the stage starts from.
    around : (n, c) float32
        Features of the vertices: logarithms of averaged measures.
    """

    normals: Singles
    around: Singles

    def told(self, mesh: TriangleMesh, rows: npt.NDArray[np.integer]) -> tuple[Singles, Singles]:
        """Return the candidates of some faces, and their features."""
        normals = self.normals[rows]
        first = pair_count(normals.shape[1])
        told = np.empty((len(rows), first + self.around.shape[1]), dtype=np.float32)
        tell_pairs(normals, told)
        run(_tell_around, len(rows), rows, mesh.faces, self.around, first, told)
        return normals, told


def first_smoothings(mesh: TriangleMesh) -> Smoothings:
    """Compute the candidates and features of the first stage."""
    found = np.empty((mesh.face_count, FIRST, 3), dtype=np.float32)
    with phase(0.0, 0.1, _MESSAGE):
        faces = _Faces(mesh)
        field = _field(mesh, mesh.scaled_vertices)
    into = _Kept(found)
    with phase(0.1, 0.5, _MESSAGE):
        into.keep(field)
        plain = faces.means(field, None, 0.0, _PLAIN, into)
        for spread, counts in _ALIKE:
            faces.alike(field, spread, counts, into)
        spread, count = _BY_MEANS
        faces.means(field, plain[1], spread, (count,), into)
        del plain
        faces.guided(field, _GUIDED, into)
    heights = np.empty((mesh.vertex_count, len(_BANDS)), dtype=np.float32)
    with phase(0.5, 0.8, _MESSAGE):
        states = _umbrella_states(mesh, heights)
        one, two, four, eight, most = (next(states) for _ in range(5))
        for each in (one, two, four):
            into.keep(each)
        faces.alike(one, *_ALIKE_AFTER_ONE, into)
        faces.guided(two, _GUIDED_AFTER_TWO, into)
        into.keep(eight)
        into.keep(most)
        next(states)
    with phase(0.8, 1.0, _MESSAGE):
        signal = np.empty((mesh.face_count, len(_CHANGES) + _FACE_MEASURES), dtype=np.float32)
        run(_measure_changes, mesh.face_count, found, np.array(_CHANGES), signal)
        run(_measure_faces, mesh.face_count, mesh.scaled_vertices, mesh.faces, mesh.twins, field,
            np.array(_SIMILAR), signal[:, len(_CHANGES) :])  # fmt: skip
        return Smoothings(found, _around(mesh, signal, heights))


def next_smoothings(
    mesh: TriangleMesh, original: TriangleMesh, normals: Floats, around: Singles
) -> Smoothings:
    """Compute the candidates and features of a later stage.

    Parameters
    ----------
    mesh : TriangleMesh
        The mesh after the fit to `normals`.
    original : TriangleMesh
        The mesh before all stages.
    normals : (m, 3) float64
        Unit vectors that the stage before has found.
    around : (n, c) float32
        Features of the first stage.
    """
    found = np.empty((mesh.face_count, NEXT, 3), dtype=np.float32)
    faces, into = _Faces(mesh), _Kept(found)
    own = _field(mesh, mesh.scaled_vertices)
    field = own.copy()
    field[:, :3] = normals
    with phase(0.0, 0.7, _MESSAGE):
        into.keep(field)
        faces.means(field, None, 0.0, _NEXT_PLAIN, into)
        into.keep(original.normals.astype(np.float32))
        into.keep(own)
        for spread, counts in _NEXT_ALIKE:
            faces.alike(field, spread, counts, into)
        faces.guided(field, _NEXT_GUIDED, into)
    with phase(0.7, 1.0, _MESSAGE):
        signal = np.empty((mesh.face_count, len(_NEXT_CHANGES)), dtype=np.float32)
        run(_measure_changes, mesh.face_count, found, np.array(_NEXT_CHANGES), signal)
        new = _around(mesh, signal, np.empty((mesh.vertex_count, 0), dtype=np.float32))
        both = np.empty((len(new), new.shape[1] + around.shape[1]), dtype=np.float32)
        both[:, : new.shape[1]] = new
        ask()
        both[:, new.shape[1] :] = around
        return Smoothings(found, both)


def without_bumps(mesh: TriangleMesh, width: float) -> Floats:
    """Remove bumps up to a width, in mean edge lengths, from the normals, but keep creases.

    The normals are averaged over the width of the bumps, guided by the most uniform patches, and
    then by further passes. For bumps of that width, these passes change a known share of what the
    first ones changed. Where they change more, they remove relief: then the result of the first
    passes is mixed in, by the weight of a Wiener filter.
    """
    passes = _BUMP_PASSES * width**_WIDTH_POWER
    faces, field = _Faces(mesh), _field(mesh, mesh.scaled_vertices)
    with phase(0.0, 1.0 / (1.0 + _FURTHER_FACTOR), _MESSAGE):
        near = faces.levelled(field, _BUMP_SPREAD, passes)
    with phase(1.0 / (1.0 + _FURTHER_FACTOR), 1.0, _MESSAGE):
        far = faces.levelled(near, _BUMP_SPREAD, _FURTHER_FACTOR * passes)
    turns = np.stack([_squares(field, near), _squares(near, far)], axis=1)
    first, further = _regional(mesh, turns, _BUMP_REGION * max(width, 1.0)).T
    relief = np.maximum(1.0 - _LEFTOVER * first / np.maximum(further, 1e-12), 0.0)
    return _between(far, near, relief[:, None])[:, :3].astype(np.float64)


def with_creases(mesh: TriangleMesh, normals: Floats, keep: float) -> Floats:
    """Round creases of the normals, for `keep` below 0.5, or sharpen them, above 0.5: (m, 3)."""
    faces, field = _Faces(mesh), _field(mesh, mesh.scaled_vertices)
    field[:, :3] = normals
    guide = None if keep < 0.5 else faces.even(field)
    other = _averaged(faces, field, guide, _CRISP_SPREAD, _PASSES_OF_CREASES)
    return _between(field, other, abs(2.0 * keep - 1.0))[:, :3].astype(np.float64)


def average_around(mesh: TriangleMesh, values: npt.NDArray[np.floating]) -> Singles:
    """Average face values around each vertex, without area weights: (m, d) -> (n, d)."""
    out = np.empty((mesh.vertex_count, values.shape[1]), dtype=np.float32)
    singles = values.astype(np.float32, copy=False)
    run(_average_to_vertices, mesh.vertex_count, *mesh.corners, singles, out)
    return out


def _averaged(
    faces: _Faces, field: Singles, guide: Singles | None, spread: float, passes: float
) -> Singles:
    # The number of passes may be fractional, so that the result depends on it continuously.
    whole = floor(passes)
    for _ in range(whole):
        ask()
        field = faces.mean(field, guide, spread)
    if passes > whole:
        field = _between(field, faces.mean(field, guide, spread), passes - whole)
    return field


def _between(one: Singles, other: Singles, share: float | Floats) -> Singles:
    mean = one + np.asarray(share, dtype=np.float32) * (other - one)
    length = np.linalg.norm(mean[:, :3], axis=1, keepdims=True)
    mean[:, :3] /= np.maximum(length, np.float32(1e-12))
    return mean


def _squares(one: Singles, other: Singles) -> Singles:
    return ((one[:, :3] - other[:, :3]) ** 2).sum(axis=1)


def _regional(mesh: TriangleMesh, signal: Singles, size: float) -> Floats:
    # Averages face values over grid cells; their size is in mean edge lengths.
    values = average_around(mesh, signal)
    used = np.flatnonzero(np.diff(mesh.corners[0]) > 0)
    out = np.zeros(values.shape)
    cells = MeansAround(mesh.scaled_vertices[used], values[used].astype(np.float64), size)
    out[used] = cells.at(np.arange(len(used)))
    return average_to_faces(mesh, out)


class _Kept:
    # Stores the candidates in turn.

    def __init__(self, found: Singles) -> None:
        self._found, self._next = found, 0

    def keep(self, field: Singles) -> None:
        run(_put, len(field), field, self._next, self._found)
        self._next += 1
        ask()


class _Faces:
    """Averages over the faces that share a vertex with each face.

    A field, (m, 4) float32, holds the normal and the area of each face, side by side in memory.
    Indices are unsigned, because numba checks signed ones at each access for negative values.
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        count = np.empty(mesh.face_count, dtype=np.int32)
        start = np.zeros(mesh.face_count + 1, dtype=np.int64)
        none = np.empty(0, dtype=np.uint32)
        run(_find_around, mesh.face_count, mesh.faces, *mesh.corners, start, none, count)
        np.cumsum(count, out=start[1:])
        self.around = np.empty(start[-1], dtype=np.uint32)
        run(_find_around, mesh.face_count, mesh.faces, *mesh.corners, start, self.around, count)
        self.start = start.view(np.uint64)

    def means(
        self,
        field: Singles,
        guide: Singles | None,
        spread: float,
        counts: tuple[int, ...],
        into: _Kept,
        own: bool = False,
    ) -> list[Singles]:
        kept = []
        for before, count in pairwise((0, *counts)):
            for _ in range(count - before):
                field = self.mean(field, field if own else guide, spread)
            into.keep(field)
            kept.append(field)
        return kept

    def alike(self, field: Singles, spread: float, counts: tuple[int, ...], into: _Kept) -> None:
        self.means(field, None, spread, counts, into, own=True)

    def guided(self, field: Singles, spread: float, into: _Kept) -> None:
        done = 0
        while done < _GUIDED_PASSES[-1]:
            guide = self.even(field)
            for _ in range(_PATCH_INTERVAL):
                field = self.mean(field, guide, spread)
            done += _PATCH_INTERVAL
            if done in _GUIDED_PASSES:
                into.keep(field)

    def levelled(self, field: Singles, spread: float, passes: float) -> Singles:
        """Average a field as `guided` does, by any number of passes, also a fractional one."""
        done = 0
        while done < passes:
            left = min(passes - done, _PATCH_INTERVAL)
            field = _averaged(self, field, self.even(field), spread, left)
            done += _PATCH_INTERVAL
        return field

    def mean(self, field: Singles, guide: Singles | None, spread: float) -> Singles:
        """Average a field once; with a guide, by a Gaussian weight of the guide's distances."""
        out = np.empty_like(field)
        if guide is None:
            run(_average, len(field), self.start, self.around, field, out)
        else:
            rate = np.float32(-0.5 / 16 / spread**2)
            run(_average_alike, len(field), self.start, self.around, field, guide, rate, out)
        return out

    def even(self, field: Singles) -> Singles:
        """Find, as guide of each face, the mean normal of the most uniform patch around it."""
        patches, out = np.empty_like(field), np.empty_like(field)
        run(_average_patches, len(field), self.start, self.around, field, patches)
        run(_choose_patches, len(field), self.start, self.around, field, patches, out)
        return out


def _field(mesh: TriangleMesh, places: Floats) -> Singles:
    """Return the normals and areas of the faces for given vertex positions."""
    field = np.empty((mesh.face_count, 4), dtype=np.float32)
    run(_measure_field, mesh.face_count, places, mesh.faces, field)
    return field


def _umbrella_states(mesh: TriangleMesh, heights: Singles) -> Iterator[Singles]:
    # Yields the field after each number of `_UMBRELLA` passes; fills in the heights of `_BANDS`.
    start, ring = mesh.neighbours
    lengths = np.empty(mesh.vertex_count)
    run(_measure_lengths, mesh.vertex_count, mesh.scaled_vertices, start, ring, lengths)
    places, upper, done, band = mesh.scaled_vertices, mesh.scaled_vertices, 0, 0
    field = _field(mesh, places)
    least = _SHRUNK * float(field[:, 3].sum(dtype=np.float64))
    for count in _UMBRELLA:
        new = places
        for _ in range(count - done):
            new, old = np.empty_like(places), new
            run(even_out, mesh.vertex_count, start, ring, old, new)
        done = count
        smooth = _field(mesh, new)
        if smooth[:, 3].sum(dtype=np.float64) > least:
            places, field = new, smooth
        if band < len(_BANDS) and count == _BANDS[band][1]:
            run(_measure_heights, mesh.vertex_count, *mesh.corners, upper, places, field, lengths,
                band, heights)  # fmt: skip
            upper, band = places, band + 1
        yield field


def _around(mesh: TriangleMesh, signal: Singles, more: Singles) -> Singles:
    # Averages measures of faces, and more of vertices, at three scales, as logarithms: near, in the
    # region, and in between.
    first, count = signal.shape[1], signal.shape[1] + more.shape[1]
    values = np.empty((mesh.vertex_count, count), dtype=np.float32)
    run(_average_to_vertices, mesh.vertex_count, *mesh.corners, signal, values)
    if count > first:
        values[:, first:] = more
    start, ring = mesh.neighbours
    values = _spread(start, ring, values, _NEAR)
    run(_take_logarithms, len(values), values)
    out = np.empty((mesh.vertex_count, 3 * count), dtype=np.float32)
    out[:, :count] = values
    used = np.flatnonzero(np.diff(mesh.corners[0]) > 0)
    ask()
    chosen = values[used].astype(np.float64)
    ask()
    cells = MeansAround(mesh.scaled_vertices[used], chosen, _CELLS)
    del chosen
    out[:, count : 2 * count] = values
    out[used, count : 2 * count] = cells.at(np.arange(len(used)))
    del cells
    out[:, 2 * count :] = _spread(start, ring, values, _WIDE)
    ask()
    return out


def _spread(start: Ints, ring: Ints, values: Singles, passes: int) -> Singles:
    for _ in range(passes):
        out = np.empty_like(values)
        run(_average_ring, len(values), start, ring, values, out)
        values = out
    return values


@kernel
def _take_logarithms(start, stop, values):
    for v in range(start, stop):
        for i in range(values.shape[1]):
            positive = max(values[v, i], np.float32(0)) + np.float32(1e-5)
            values[v, i] = np.float32(0.5) * logarithm(positive) + np.float32(2)


@kernel
def _put(start, stop, field, place, found):
    for f in range(start, stop):
        for x in range(3):
            found[f, place, x] = field[f, x]


@kernel
def _find_around(start, stop, faces, corner_start, corners, begin, around, count):
    # Lists the faces around each face; with an empty `around`, only counts them.
    for f in range(start, stop):
        found = 0
        for k in range(3):
            first, last = corner_start[faces[f, k]], corner_start[faces[f, k] + 1]
            for i in range(first, last, 1 + (last - first - 1) // HUB):
                g = corners[i] // 3
                new = g != f and found < _MOST_AROUND
                for j in range(k):
                    u = faces[f, j]
                    new = new and faces[g, 0] != u and faces[g, 1] != u and faces[g, 2] != u
                if new:
                    if len(around) > 0:
                        around[begin[f] + found] = g
                    found += 1
        count[f] = found


@kernel
def _measure_field(start, stop, places, faces, field):
    for f in range(start, stop):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        x, y, z = cross(edge(places, a, b), edge(places, a, c))
        length = np.sqrt(x * x + y * y + z * z)
        field[f, 3] = 0.5 * length
        if length > 1e-12:
            field[f, 0], field[f, 1], field[f, 2] = x / length, y / length, z / length
        else:
            field[f, 0], field[f, 1], field[f, 2] = 0.0, 0.0, 0.0


@kernel
def _set_unit(out, x, y, z, area):
    length = max(np.sqrt(x * x + y * y + z * z), np.float32(1e-12))
    out[0], out[1], out[2], out[3] = x / length, y / length, z / length, area


@kernel
def _average(start, stop, begin, around, field, out):
    for f in range(start, stop):
        w = max(field[f, 3], np.float32(1e-6))
        x, y, z = w * field[f, 0], w * field[f, 1], w * field[f, 2]
        for i in range(begin[f], begin[f + 1]):
            g = field[around[i]]
            x += g[3] * g[0]
            y += g[3] * g[1]
            z += g[3] * g[2]
        _set_unit(out[f], x, y, z, field[f, 3])


@kernel
def _average_alike(start, stop, begin, around, field, guide, rate, out):
    # Weights by the similarity of guides; (1 + x / 16)^16 approximates exp(x).
    for f in range(start, stop):
        gx, gy, gz = guide[f, 0], guide[f, 1], guide[f, 2]
        w = max(field[f, 3], np.float32(1e-6))
        x, y, z = w * field[f, 0], w * field[f, 1], w * field[f, 2]
        for i in range(begin[f], begin[f + 1]):
            g = around[i]
            dx, dy, dz = guide[g, 0] - gx, guide[g, 1] - gy, guide[g, 2] - gz
            w = np.float32(1) + rate * (dx * dx + dy * dy + dz * dz)
            w = max(w, np.float32(0))
            w *= w
            w *= w
            w *= w
            w = w * w * field[g, 3]
            x += w * field[g, 0]
            y += w * field[g, 1]
            z += w * field[g, 2]
        _set_unit(out[f], x, y, z, field[f, 3])


@kernel
def _average_patches(start, stop, begin, around, field, patches):
    # The mean normal of a face and those around it; in place of the area, how much these differ.
    for f in range(start, stop):
        w = field[f, 3]
        x, y, z, total = w * field[f, 0], w * field[f, 1], w * field[f, 2], w
        for i in range(begin[f], begin[f + 1]):
            g = field[around[i]]
            x += g[3] * g[0]
            y += g[3] * g[1]
            z += g[3] * g[2]
            total += g[3]
        length = np.sqrt(x * x + y * y + z * z)
        if length > np.float32(1e-6) * total:
            _set_unit(patches[f], x, y, z, np.float32(1) - length / total)
        else:
            _set_unit(patches[f], field[f, 0], field[f, 1], field[f, 2], np.float32(1))


@kernel
def _cost(own, patch):
    cosine = own[0] * patch[0] + own[1] * patch[1] + own[2] * patch[2]
    return patch[3] + _PULL * (np.float32(1) - cosine)


@kernel
def _choose_patches(start, stop, begin, around, field, patches, out):
    # Among costs that are equal up to rounding, a fixed direction decides, not the order of faces.
    costs = np.empty(_MOST_AROUND, np.float32)
    for f in range(start, stop):
        own, first = field[f], begin[f]
        cost = least = _cost(own, patches[f])
        for i in range(first, begin[f + 1]):
            costs[i - first] = _cost(own, patches[around[i]])
            least = min(least, costs[i - first])
        choice, most = np.uint32(f), -2.0
        if cost <= least + _ROUNDING:
            most = dot(TIE_BREAKER, patches[f])
        for i in range(first, begin[f + 1]):
            if costs[i - first] <= least + _ROUNDING:
                side = dot(TIE_BREAKER, patches[around[i]])
                if side > most:
                    choice, most = around[i], side
        out[f] = patches[choice]


@kernel
def even_out(start, stop, ring_start, ring, places, out):
    for v in range(start, stop):
        x, y, z = places[v, 0], places[v, 1], places[v, 2]
        for i in range(ring_start[v], ring_start[v + 1]):
            x += places[ring[i], 0]
            y += places[ring[i], 1]
            z += places[ring[i], 2]
        n = ring_start[v + 1] - ring_start[v] + 1
        out[v, 0], out[v, 1], out[v, 2] = x / n, y / n, z / n


@kernel
def _measure_lengths(start, stop, places, ring_start, ring, lengths):
    for v in range(start, stop):
        total = 0.0
        for i in range(ring_start[v], ring_start[v + 1]):
            e = edge(places, v, ring[i])
            total += np.sqrt(dot(e, e))
        lengths[v] = total / max(ring_start[v + 1] - ring_start[v], 1)


@kernel
def _measure_heights(
    start, stop, corner_start, corners, upper, lower, field, lengths, column, heights
):
    # The squared ratio of how far the passes moved a vertex along its normal to its edge length.
    for v in range(start, stop):
        a = b = c = 0.0
        for i in range(corner_start[v], corner_start[v + 1]):
            f = corners[i] // 3
            a += field[f, 3] * field[f, 0]
            b += field[f, 3] * field[f, 1]
            c += field[f, 3] * field[f, 2]
        x, y, z = upper[v, 0] - lower[v, 0], upper[v, 1] - lower[v, 1], upper[v, 2] - lower[v, 2]
        d = a * x + b * y + c * z
        square = d * d / max((a * a + b * b + c * c) * lengths[v] ** 2, 1e-30)
        heights[v, column] = min(square, 100.0)


@kernel
def _measure_changes(start, stop, normals, pairs, signal):
    for f in range(start, stop):
        for c in range(len(pairs)):
            one, other = normals[f, pairs[c, 0]], normals[f, pairs[c, 1]]
            square = np.float32(0)
            for x in range(3):
                square += (one[x] - other[x]) ** 2
            signal[f, c] = min(square, np.float32(1))


@kernel
def _measure_faces(start, stop, places, faces, twins, field, level, signal):
    # The share of neighbours with similar normals, and the mean squared turn to them: terraces are
    # flat with rare large steps. Then differences in size, edge length, and thinness.
    for f in range(start, stop):
        for i in range(len(level)):
            signal[f, i] = 0.0
        mean = uneven = squares = fourths = 0.0
        for k in range(3):
            g = f if twins[f, k] < 0 else twins[f, k] // 3
            square = 0.0
            for x in range(3):
                square += (field[f, x] - field[g, x]) ** 2
            for i in range(len(level)):
                signal[f, i] += np.exp(-square / level[i] ** 2) / 3.0
            mean += square / 3.0
            uneven += np.log((field[f, 3] + 1e-3) / (field[g, 3] + 1e-3)) ** 2 / 30.0
            e = edge(places, faces[f, k], faces[f, (k + 1) % 3])
            squares += dot(e, e)
            fourths += dot(e, e) ** 2
        c = len(level)
        signal[f, c] = min(mean, 1.0)
        signal[f, c + 1] = min(uneven, 1.0)
        signal[f, c + 2] = min(squares / 3.0, 100.0)
        flat = max(squares * squares - 2.0 * fourths, 0.0) / max(squares * squares, 1e-300)
        signal[f, c + 3] = 1.0 - min(np.sqrt(3.0 * flat), 1.0)


@kernel
def _average_to_vertices(start, stop, corner_start, corners, signal, values):
    for v in range(start, stop):
        out = values[v]
        for x in range(signal.shape[1]):
            out[x] = 0.0
        for i in range(corner_start[v], corner_start[v + 1]):
            row = signal[corners[i] // 3]
            for x in range(signal.shape[1]):
                out[x] += row[x]
        n = np.float32(max(corner_start[v + 1] - corner_start[v], 1))
        for x in range(signal.shape[1]):
            out[x] /= n


@kernel
def _average_ring(start, stop, ring_start, ring, values, out):
    # One third of a vertex's own value plus two thirds of its neighbours' mean.
    for v in range(start, stop):
        count = ring_start[v + 1] - ring_start[v]
        row = out[v]
        for x in range(values.shape[1]):
            row[x] = 0.0
        for i in range(ring_start[v], ring_start[v + 1]):
            other = values[ring[i]]
            for x in range(values.shape[1]):
                row[x] += other[x]
        share = np.float32(2.0 / 3.0 / count) if count > 0 else np.float32(0)
        own = np.float32(1.0 / 3.0) if count > 0 else np.float32(1)
        for x in range(values.shape[1]):
            row[x] = share * row[x] + own * values[v, x]


@kernel
def _tell_around(start, stop, rows, faces, around, first, told):
    third = np.float32(1.0 / 3.0)
    for r in range(start, stop):
        f = rows[r]
        a, b, c = around[faces[f, 0]], around[faces[f, 1]], around[faces[f, 2]]
        for i in range(around.shape[1]):
            told[r, first + i] = (a[i] + b[i] + c[i]) * third
