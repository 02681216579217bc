# SPDX-License-Identifier: GPL-3.0-or-later
"""Candidate normals of faces near creases, and the features by which a network weighs them.

Not in the papers. A face has nine candidates: its own normal; the mean normal around it, after 0, 2
and 8 smoothing passes; the advected normal for two flow times; and its own normal and both advected
ones after `sides` has assigned the face to one side of the crease. The features are the distances
between all pairs of candidates, how far smoothing would move the surface and in which direction,
and means of such measures around the face, at three scales.

A smaller network, the gate, sees only the features that need no more than the first six candidates.
It decides which faces may turn at all; the last three candidates are computed for these alone.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.progress import ask, phase
from ..base.vectors import dot, edge
from ..flow.potential import bending
from ..mesh.adjacency import distinct
from ..mesh.calculus import average_to_vertices, make_unit_or, mean_normals, smooth_vertices
from ..mesh.triangle_mesh import Floats, TriangleMesh
from ..mixture.cells import MeansAround
from ..mixture.choice import pair_count, tell_pairs
from ..mixture.network import Network, Singles, digest
from ..settings import GeometrySettings
from .advected import advected_normals
from .sides import consistent_normals, grown

CANDIDATES = 9
TAKES_SIDES = 6
"""The candidates from this index on belong to one side of the crease; see `sides`."""

LONGER = 8.0
"""Time of the second flow, over that of the first."""

_STILL_COSINE = np.cos(np.radians(5.0))
"""Cosine of 5 degrees. A face keeps its normal if within two rings neither a flow nor the mean
after 2 passes turns a face by more. A gate scores only the faces that turn by more; then faces
within one ring of those it passes may turn too."""

_PASSES = 2, 8
"""Smoothing passes of the second and third mean, and of the heights."""

_CHANGES = (0, 1), (1, 2), (2, 3), (0, 4), (4, 5), (3, 4), (3, 5)
"""Pairs of candidates, by index, whose distances are averaged around a face."""

_ALIKE = 4e-4, 1e-2
"""Squared distances d0^2 between unit normals: neighbours at distance d count as similar by
exp(-(d / d0)^2)."""

_CELLS = 5.0, 14.0
"""Sizes of the grid cells in which measures are averaged, in mean edge lengths."""

_GATE_BLOCK = 1 << 15
"""Number of faces that the gate scores in one call, to save memory."""

_AROUND = len(_CHANGES) + len(_ALIKE) + 3
"""Number of averaged measures: also the turn across edges, the shape of faces, and the height."""

_BESIDE_PAIRS = 2 * len(_PASSES) + _AROUND * (1 + len(_CELLS))

TOLD = pair_count(CANDIDATES) + _BESIDE_PAIRS
"""Number of features of a face."""

TOLD_FIRST = [
    *(number for number, pair in enumerate(combinations(range(CANDIDATES), 2))
      if max(pair) < TAKES_SIDES),
    *range(pair_count(CANDIDATES), TOLD),
]  # fmt: skip
"""Indices of the features that the gate sees."""

DEFINITION = digest("creases 4", repr((
    CANDIDATES, TAKES_SIDES, LONGER, round(float(_STILL_COSINE), 9), _PASSES, _CHANGES, _ALIKE,
    _CELLS, _AROUND,
)))  # fmt: skip
"""Digest of what the features mean. When a change of the code changes them, raise the number in the
first text."""


class Candidates(NamedTuple):
    """Candidates of the faces that may turn.

    Attributes
    ----------
    rows : (k,) int
        Indices of these faces.
    normals : (k, 9, 3) float32
        The candidates; the first one is the face's own normal.
    told : (k, TOLD) float32
        The features.
    turn, wide_turn : (n,) float64
        RMS turn of the normals around each vertex, in radians, over 2 and 8 smoothing passes.
    """

    rows: npt.NDArray[np.intp]
    normals: Singles
    told: Singles
    turn: Floats
    wide_turn: Floats


def flow_key(settings: GeometrySettings) -> tuple[Any, ...]:
    """Return the settings that the candidates depend on."""
    return (settings.time, settings.smoothing_passes, settings.mollify_passes,
            settings.feature_threshold, settings.sampling, settings.align_passes)  # fmt: skip


def find_candidates(
    mesh: TriangleMesh, settings: GeometrySettings, gate: Network | None
) -> Candidates:
    """Find the candidates of the faces that the gate lets pass; without one, of all that may turn.

    The settings in `flow_key` are used.
    """
    message = "Finding creases"
    with phase(0.0, 0.2, message):
        near, far = _smoothed(mesh)
    signal, _ = bending(mesh, settings.smoothing_passes)
    everywhere = np.empty((mesh.face_count, TAKES_SIDES, 3), dtype=np.float32)
    with phase(0.2, 0.6, message):
        flows = []
        for number, factor in enumerate((1.0, LONGER)):
            with phase(0.5 * number, 0.5 * number + 0.5, message):
                flowing = replace(settings, time=factor * settings.time)
                flows.append(advected_normals(mesh, flowing))
    turned = np.empty(mesh.face_count, dtype=np.bool_)
    with phase(0.6, 0.65, message):
        run(_gather, mesh.face_count, mesh.faces, mesh.normals, mesh.areas, signal, near, far,
            *flows, _STILL_COSINE, everywhere, turned)  # fmt: skip
    with phase(0.65, 0.8, message):
        turn, wide_turn = _turn(near), _turn(far)
        heights = _heights(mesh, signal, near, far)
        del near, far  # before more memory is needed
        surroundings = _Surroundings(mesh, everywhere, heights)
        if gate is not None:
            rows = np.flatnonzero(turned)
            for begin in range(0, len(rows), _GATE_BLOCK):
                some = rows[begin : begin + _GATE_BLOCK]
                turned[some] = _passed(gate, everywhere[some], surroundings.told(some))
            turned = grown(mesh, turned)
        else:
            turned = grown(mesh, grown(mesh, turned))
        zone = turned & (mesh.areas > 0)
        rows = np.flatnonzero(zone)
        beside = surroundings.told(rows)
        del surroundings
    with phase(0.8, 0.85, message):
        normals = np.empty((len(rows), CANDIDATES, 3), dtype=np.float32)
        normals[:, :TAKES_SIDES] = everywhere[rows]
        del everywhere
        ask()
        told = np.empty((len(rows), TOLD), dtype=np.float32)
        told[:, pair_count(CANDIDATES) :] = beside
    if len(rows):
        with phase(0.85, 1.0, message):
            for number, each in enumerate((mesh.normals, *flows)):
                with phase(number / 3, (number + 1) / 3, message):
                    sides = consistent_normals(mesh, each, zone, settings.align_passes)
                normals[:, TAKES_SIDES + number] = sides[rows]
        tell_pairs(normals, told)
    return Candidates(rows, normals, told, turn, wide_turn)


def _passed(gate: Network, candidates: Singles, beside: Singles) -> npt.NDArray[np.bool_]:
    first = pair_count(TAKES_SIDES)
    told = np.empty((len(candidates), first + beside.shape[1]), dtype=np.float32)
    tell_pairs(candidates, told)
    told[:, first:] = beside
    return gate.scores(told)[:, 0] > 0


def _smoothed(mesh: TriangleMesh) -> tuple[Floats, Floats]:
    # Normals and positions at the vertices after both numbers of smoothing passes: (n, 6) each.
    both = np.concatenate([mean_normals(mesh), mesh.scaled_vertices], axis=1)
    first, second = _PASSES
    with phase(0.0, 0.3, "Finding creases"):
        near = smooth_vertices(mesh, both, first)
    with phase(0.3, 1.0, "Finding creases"):
        return near, smooth_vertices(mesh, near, second - first)


def _turn(means: Floats) -> Floats:
    # The RMS turn: the more unit normals differ, the shorter is their mean.
    out = np.empty(len(means))
    run(_shortness, len(means), means, out)
    return out


def _is_inside_out(mesh: TriangleMesh) -> bool:
    # The signed volume is negative by more than the holes of the mesh can account for.
    volume, open_area = 0.0, 0.0
    for x, normal in enumerate(mesh.normals.T):
        directed = mesh.areas * normal
        places = mesh.scaled_vertices[:, x]
        places = places - places.mean()
        middle = places[mesh.faces[:, 0]] + places[mesh.faces[:, 1]] + places[mesh.faces[:, 2]]
        volume += float(directed @ middle) / 9.0
        open_area += abs(float(directed.sum())) * float(np.abs(places).max(initial=0.0))
    return volume < -open_area


def _heights(mesh: TriangleMesh, signal: Floats, near: Floats, far: Floats) -> Floats:
    # How far smoothing moves each vertex outwards, after both numbers of passes: (n, 2).
    heights = np.empty((mesh.vertex_count, len(_PASSES)))
    run(_measure_heights, mesh.vertex_count, mesh.scaled_vertices, signal, near, far, heights)
    if _is_inside_out(mesh):
        heights *= -1.0
    return heights


class _Surroundings:
    # The features other than pair distances.

    def __init__(self, mesh: TriangleMesh, everywhere: Singles, heights: Floats) -> None:
        self._mesh = mesh
        self._heights = heights
        changes = np.empty((mesh.face_count, _AROUND))
        run(_measure_changes, mesh.face_count, mesh.scaled_vertices, mesh.faces, mesh.normals,
            mesh.areas, mesh.twins, everywhere, np.array(_CHANGES), np.array(_ALIKE),
            changes)  # fmt: skip
        around = average_to_vertices(mesh, changes)
        del changes
        around[:, -1] = self._heights[:, -1] ** 2
        for _ in range(2):  # one pass at a time needs less memory
            around = smooth_vertices(mesh, around, 1)
        run(_to_logarithms, len(around), around)
        self._around = around
        self._number = np.empty(mesh.vertex_count, dtype=np.int32)
        used = np.diff(mesh.corners[0]) > 0
        self._cells: list[MeansAround] = []
        self._place: npt.NDArray | None = None
        places, values = mesh.scaled_vertices, around
        if not used.all():  # vertices without faces do not count
            places, values, self._place = places[used], values[used], np.cumsum(used) - 1
        self._grids = places, values

    def told(self, rows: npt.NDArray[np.intp]) -> Singles:
        told = np.empty((len(rows), _BESIDE_PAIRS), dtype=np.float32)
        if len(rows) == 0:
            return told
        mesh = self._mesh
        if not self._cells:
            self._cells = [MeansAround(*self._grids, size) for size in _CELLS]
        faces = mesh.faces[rows]
        vertices = distinct(faces, mesh.vertex_count)
        self._number[vertices] = np.arange(len(vertices), dtype=np.int32)
        place = vertices if self._place is None else self._place[vertices]
        measures = np.empty((len(vertices), _AROUND * (1 + len(_CELLS))), dtype=np.float32)
        measures[:, :_AROUND] = self._around[vertices]
        for k, cells in enumerate(self._cells, 1):
            measures[:, k * _AROUND : (k + 1) * _AROUND] = cells.at(place)
        run(_tell_around, len(rows), self._number[faces], self._heights[vertices], measures,
            told)  # fmt: skip
        return told


@kernel
def _shortness(start, stop, means, out):
    for v in range(start, stop):
        out[v] = np.sqrt(max(2.0 * (1.0 - np.sqrt(dot(means[v], means[v]))), 0.0))


@kernel
def _mean_to(faces, f, values, own, out):
    # The unit mean of a face's corners; its own normal if that is zero.
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    for x in range(3):
        out[x] = values[a, x] + values[b, x] + values[c, x]
    make_unit_or(out, own)


@kernel
def _gather(
    start, stop, faces, normals, areas, signal, near, far, short, long, still, everywhere, turned
):
    # The first six candidates, and whether a flow or the near mean turns the face clearly.
    mean = np.empty(3)
    for f in range(start, stop):
        own, out = normals[f], everywhere[f]
        for x in range(3):
            out[0, x], out[4, x], out[5, x] = own[x], short[f, x], long[f, x]
        _mean_to(faces, f, signal, own, mean)
        out[1, 0], out[1, 1], out[1, 2] = mean[0], mean[1], mean[2]
        _mean_to(faces, f, far, own, mean)
        out[3, 0], out[3, 1], out[3, 2] = mean[0], mean[1], mean[2]
        _mean_to(faces, f, near, own, mean)
        out[2, 0], out[2, 1], out[2, 2] = mean[0], mean[1], mean[2]
        least = min(dot(own, short[f]), dot(own, long[f]), dot(own, mean))
        turned[f] = least < still and areas[f] > 0


@kernel
def _measure_heights(start, stop, places, signal, near, far, heights):
    # The distance by which smoothing moves each vertex along its normal, in mean edge lengths.
    for v in range(start, stop):
        n = signal[v]
        length = max(np.sqrt(dot(n, n)), 1e-12)
        one = two = 0.0
        for x in range(3):
            one += n[x] * (places[v, x] - near[v, 3 + x])
            two += n[x] * (places[v, x] - far[v, 3 + x])
        heights[v, 0], heights[v, 1] = one / length, two / length


@kernel
def _measure_changes(
    start, stop, places, faces, normals, areas, twins, everywhere, pairs, alike, changes
):
    # Squared distances between candidates; the share of neighbours with similar normals, and the
    # mean squared turn to them; the face's shape, 1 if it is equilateral.
    for f in range(start, stop):
        c = 0
        for p in range(len(pairs)):
            square = 0.0
            for x in range(3):
                d = float(everywhere[f, pairs[p, 0], x]) - float(everywhere[f, pairs[p, 1], x])
                square += d * d
            changes[f, c] = min(square, 1.0)
            c += 1
        first = c
        for i in range(len(alike) + 1):
            changes[f, first + i] = 0.0
        total = 0.0
        for k in range(3):
            square = 0.0
            if twins[f, k] >= 0:
                g = twins[f, k] // 3
                for x in range(3):
                    square += (normals[f, x] - normals[g, x]) ** 2
            for i in range(len(alike)):
                changes[f, first + i] += np.exp(-square / alike[i]) / 3.0
            total += square / 3.0
        changes[f, first + len(alike)] = min(total, 1.0)
        squares = 0.0
        for k in range(3):
            e = edge(places, faces[f, k], faces[f, (k + 1) % 3])
            squares += dot(e, e)
        changes[f, first + len(alike) + 2] = 0.0
        changes[f, first + len(alike) + 1] = 6.928203230275509 * areas[f] / max(squares, 1e-300)


@kernel
def _to_logarithms(start, stop, values):
    for v in range(start, stop):
        for i in range(values.shape[1]):
            values[v, i] = 0.5 * np.log(max(values[v, i], 0.0) + 1e-5) + 2.0


@kernel
def _tell_around(start, stop, faces, heights, measures, told):
    # Averages the measures over the corners of each face.
    for r in range(start, stop):
        a, b, c = faces[r, 0], faces[r, 1], faces[r, 2]
        begin = 2 * heights.shape[1]
        for i in range(heights.shape[1]):
            height = (abs(heights[a, i]) + abs(heights[b, i]) + abs(heights[c, i])) / 3.0
            told[r, i] = np.log(height + 0.005) + 3.0
            height = (heights[a, i] + heights[b, i] + heights[c, i]) / (3.0 * (height + 0.005))
            told[r, heights.shape[1] + i] = height  # from -1, concave, to 1, convex
        for i in range(measures.shape[1]):
            total = np.float64(measures[a, i]) + measures[b, i] + measures[c, i]
            told[r, begin + i] = total / 3.0  # double precision: the order of corners is no matter
