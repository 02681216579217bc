# SPDX-License-Identifier: GPL-3.0-or-later
"""Adjacency of the corners, half-edges and vertices of a triangle mesh.

A half-edge is numbered ``3 * face + k`` and runs from corner k of its face to corner
``(k + 1) % 3``; a corner has the number of the half-edge that leaves it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run, run_in_order
from ..base.progress import ask
from ..base.vectors import after

Ints = npt.NDArray[np.int32]

_FEW = 64
"""`distinct` sorts if there are fewer numbers than `count` divided by this, else it marks them."""


def count_sort(keys: Ints, count: int) -> tuple[Ints, Ints]:
    """Sort indices stably by their keys, all below `count`; returns (start, order).

    The indices with key k are ``order[start[k]:start[k + 1]]``.
    """
    start = np.zeros(count + 1, dtype=np.int32)
    run_in_order(_count_keys, len(keys), keys, start)
    np.cumsum(start, out=start)
    order = np.empty(len(keys), dtype=np.int32)
    run_in_order(_place_keys, len(keys), keys, start[:-1].copy(), order)
    return start, order


def wound_twins(
    faces: Ints, vertex_count: int
) -> tuple[Ints, npt.NDArray[np.bool_], tuple[Ints, Ints]]:
    """Pair half-edges, and flip faces that are wound against their neighbours, in place.

    Parameters
    ----------
    faces : (m, 3) int32
        Changed if the surface is orientable but not consistently wound; the majority of each
        connected part keeps its winding.
    vertex_count : int

    Returns
    -------
    twins : (m, 3) int32
        The opposite half-edge of each half-edge; -1 at borders, where more than two faces meet,
        and where the surface is not orientable.
    flipped : (m,) bool
        The faces that were flipped.
    corners : (n + 1,) int32, (3 m,) int32
        Corners at each vertex, from `count_sort`.
    """
    flipped = np.zeros(len(faces), dtype=bool)
    corners = count_sort(faces.reshape(-1), vertex_count)
    twins, consistent = _twins(faces, corners)
    if not consistent:
        _flip_faces(faces, twins.reshape(-1), flipped)
        ask()
        corners = count_sort(faces.reshape(-1), vertex_count)
        twins, _ = _twins(faces, corners)
        twins[twins < -1] = -1  # still inconsistent: not orientable, so a border
    return twins, flipped, corners


def _twins(faces: Ints, corners: tuple[Ints, Ints]) -> tuple[Ints, bool]:
    # Twins that run in the same direction get -2 - twin; then False is returned.
    twins = np.full(faces.shape, -1, dtype=np.int32)
    same = np.zeros(1, dtype=np.int64)
    run(_pair, len(corners[0]) - 1, faces, *corners, twins.reshape(-1), same)
    return twins, not same[0]


def rings(faces: Ints, twins: Ints, corners: tuple[Ints, Ints]) -> tuple[Ints, Ints]:
    """One-ring of each vertex, as in `TriangleMesh.neighbours`: (start, vertices)."""
    # One neighbour for each corner, and one for each half-edge that arrives along a border.
    count = len(corners[0]) - 1
    face, side = np.divmod(np.flatnonzero(twins < 0), 3)
    ask()
    arriving = np.bincount(faces[face, (side + 1) % 3], minlength=count)
    start = corners[0].copy()
    start[1:] += np.cumsum(arriving, dtype=np.int32)
    ring = np.empty(start[-1], dtype=np.int32)
    run(_fill_ring, count, faces, twins, *corners, start, ring)
    return start, ring


def faces_around(corners: tuple[Ints, Ints], vertices: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the faces that have some of the vertices, sorted; see `TriangleMesh.corners`."""
    start, order = corners
    counts = start[vertices + 1] - start[vertices]
    skipped = start[vertices] - (np.cumsum(counts) - counts)
    found = order[np.arange(counts.sum()) + np.repeat(skipped, counts)] // 3
    return distinct(found, len(order) // 3)


def within_rings(
    neighbours: tuple[Ints, Ints], chosen: npt.NDArray[np.bool_], rings: int
) -> npt.NDArray[np.bool_]:
    """Mark the vertices within a number of rings around marked ones: (n,) -> (n,).

    The cost is that of the vertices found, not of the mesh.
    """
    start, ring = neighbours
    found, queue = chosen.copy(), np.empty(len(chosen), dtype=np.int32)
    front = np.flatnonzero(chosen).astype(np.int32)
    end = np.zeros(1, dtype=np.int64)
    for _ in range(rings):
        begin = int(end[0])
        run_in_order(_spread, len(front), front, start, ring, found, queue, end)
        front = queue[begin : end[0]]
    return found


def distinct(numbers: npt.NDArray[Any], count: int) -> npt.NDArray[Any]:
    """Return the unique values of integers from 0 to `count` - 1, sorted."""
    if len(numbers.reshape(-1)) < count / _FEW:
        return np.unique(numbers)
    found = np.zeros(count, dtype=np.bool_)
    found[numbers] = True
    return np.flatnonzero(found).astype(numbers.dtype)


@kernel
def _spread(start, stop, front, ring_start, ring, found, queue, end):
    # Marks the neighbours of the front that are not yet found, and appends them to the queue.
    for i in range(start, stop):
        v = front[i]
        for k in range(ring_start[v], ring_start[v + 1]):
            u = ring[k]
            if not found[u]:
                found[u] = True
                queue[end[0]] = u
                end[0] += 1


@kernel
def _count_keys(start, stop, keys, counts):
    for i in range(start, stop):
        counts[keys[i] + 1] += 1


@kernel
def _place_keys(start, stop, keys, cursors, order):
    for i in range(start, stop):
        k = keys[i]
        order[cursors[k]] = i
        cursors[k] += 1


@kernel
def _pair(start, stop, faces, corner_start, corners, twins, same):
    # Around each vertex v, collect the half-edges between v and vertices of higher number.
    size = 64
    far = np.empty(size, np.int32)
    half = np.empty(size, np.int32)
    for v in range(start, stop):
        first, last = corner_start[v], corner_start[v + 1]
        if 2 * (last - first) > size:
            size = 2 * (last - first)
            far = np.empty(size, np.int32)
            half = np.empty(size, np.int32)
        count = 0
        for i in range(first, last):
            f = corners[i] // 3
            k = corners[i] - 3 * f
            back = after(after(k))
            ahead, behind = faces[f, after(k)], faces[f, back]
            if ahead == v or behind == v or ahead == behind:
                continue  # a face with a repeated vertex has no edges
            if ahead > v:
                far[count] = ahead
                half[count] = 3 * f + k
                count += 1
            if behind > v:
                far[count] = behind
                half[count] = 3 * f + back
                count += 1
        if count > 64:
            order = np.argsort(far[:count], kind="mergesort")
            far[:count] = far[:count][order]
            half[:count] = half[:count][order]
        else:
            for i in range(1, count):
                w, h = far[i], half[i]
                j = i - 1
                while j >= 0 and far[j] > w:
                    far[j + 1] = far[j]
                    half[j + 1] = half[j]
                    j -= 1
                far[j + 1] = w
                half[j + 1] = h
        i = 0
        while i < count:
            j = i + 1
            while j < count and far[j] == far[i]:
                j += 1
            if j - i == 2:  # one face: a border; more than two: not manifold
                a, b = half[i], half[i + 1]
                if faces[a // 3, a % 3] != faces[b // 3, b % 3]:
                    twins[a] = b
                    twins[b] = a
                else:
                    twins[a] = -2 - b
                    twins[b] = -2 - a
                    same[0] = 1
            i = j


def connected_parts(neighbours: tuple[Ints, Ints]) -> tuple[Ints, int]:
    """Number the connected parts of a graph, given as ``TriangleMesh.neighbours``.

    Returns
    -------
    part : (n,) int32
        The part of each vertex; parts are ordered by their lowest vertices.
    count : int
    """
    vertices = len(neighbours[0]) - 1
    part, count = np.full(vertices, -1, dtype=np.int32), np.zeros(1, dtype=np.int32)
    run_in_order(_flood, vertices, *neighbours, part, count, np.empty(vertices, dtype=np.int32))
    return part, int(count[0])


@kernel
def _flood(start, stop, ring_start, ring, part, count, queue):
    for seed in range(start, stop):
        if part[seed] >= 0:
            continue
        part[seed] = count[0]
        queue[0] = seed
        head, tail = 0, 1
        while head < tail:
            v = queue[head]
            head += 1
            for i in range(ring_start[v], ring_start[v + 1]):
                u = ring[i]
                if part[u] < 0:
                    part[u] = count[0]
                    queue[tail] = u
                    tail += 1
        count[0] += 1


@kernel
def _flip_faces(faces, twins, flipped):
    # Flood each component from its lowest face; the majority keeps its winding.
    count = faces.shape[0]
    seen = np.zeros(count, np.bool_)
    queue = np.empty(count, np.int32)
    for seed in range(count):
        if seen[seed]:
            continue
        seen[seed] = True
        queue[0] = seed
        head, tail, flips = 0, 1, 0
        while head < tail:
            f = queue[head]
            head += 1
            for k in range(3):
                t = twins[3 * f + k]
                if t == -1:
                    continue
                against = t < -1
                if against:
                    t = -2 - t
                g = t // 3
                if not seen[g]:
                    seen[g] = True
                    flipped[g] = flipped[f] != against
                    flips += flipped[g]
                    queue[tail] = g
                    tail += 1
        if 2 * flips > tail:
            for i in range(tail):
                flipped[queue[i]] = not flipped[queue[i]]
    for f in range(count):
        if flipped[f]:
            faces[f, 1], faces[f, 2] = faces[f, 2], faces[f, 1]


@kernel
def _fill_ring(start, stop, faces, twins, corner_start, corners, ring_start, ring):
    for v in range(start, stop):
        place = ring_start[v]
        for i in range(corner_start[v], corner_start[v + 1]):
            f = corners[i] // 3
            k = corners[i] - 3 * f
            back = after(after(k))
            ring[place] = faces[f, after(k)]
            place += 1
            if twins[f, back] < 0:
                ring[place] = faces[f, back]
                place += 1
