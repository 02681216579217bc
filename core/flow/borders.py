# SPDX-License-Identifier: GPL-3.0-or-later
"""Borders in a signal on a mesh: their width, contrast and surroundings. Not in the papers.

All lengths are in mean edge lengths; neighbourhoods of a radius are that many rings of edges.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.memo import kept
from ..base.parallel import kernel, run
from ..base.progress import aside, phase
from ..base.vectors import after, dot, edge
from ..mesh.calculus import smooth_vertices
from ..mesh.triangle_mesh import Floats, TriangleMesh
from ..settings import WIDTH_OF_SIGMA
from .potential import dilation, flow_potential, squared_gradient

_SPREAD = 0.344
"""Variance along each axis of one smoothing pass, if all edges have the mean length."""

_CYCLES = 3
"""Rounds of a long smoothing: the kernel of a single one is a ring, not a Gaussian."""

_NEAR, _FAR = 2, 8
"""Smoothing passes after which slopes are compared: they differ less at wider borders."""

_ENDLESS = 1.005
"""Least ratio of the squared slopes: below it, they belong to a ramp of some 50 edges or more."""

_QUANTILE = 0.35
"""Quantile of the widths, weighted by contrast: many borders look wider than they are."""

_FEWEST = 8
"""Fewest borders from which a width can be measured."""

_LEAST = 0.08
"""Contrast of the faintest borders that count."""

_STRAY = 4.0
"""Least contrast of a border, in standard deviations of the noise."""

_SAMPLE = 100_000
"""Most half-edges at which noise is measured."""

_MEASURING = "Measuring borders"


class Borders(NamedTuple):
    """Measurements of the borders in a signal.

    Attributes
    ----------
    width : float
        Typical width, from 10 to 90 percent of the contrast; 0 if there are no borders.
    seen : int
        Number of places where it was measured.
    noise : float
        Standard deviation of the noise in each channel.
    """

    width: float
    seen: int
    noise: float


def borders_of(mesh: TriangleMesh, values: Floats) -> Borders:
    """Return the result of `measured`, kept with the mesh."""
    return kept(mesh, "borders", (values,), lambda: measured(mesh, values))


def measured(mesh: TriangleMesh, values: Floats) -> Borders:
    """Measure the width of the borders in a signal (n, d), and its noise.

    If a step is blurred by a Gaussian, smoothing lowers its slope more the sharper it was: with R
    the ratio of the squared slopes after 2 and 8 passes, the blur's variance is that of
    (8 - 2 R) / (R - 1) passes. R is read where the slope is greatest in its surroundings; if these
    are too few places, as on a border that gets steadily steeper along its length, where the slope
    is greatest across the border.
    """
    with phase(0.0, 0.3, _MEASURING):
        noise = noise_of(mesh, values)
        near = smooth_vertices(mesh, values, _NEAR)
    with phase(0.3, 0.7, _MEASURING):
        far = smooth_vertices(mesh, near, _FAR - _NEAR)
    with phase(0.7, 1.0, _MEASURING):
        steep = flow_potential(mesh, near, 0)
        spread = smooth_vertices(mesh, _spread(mesh), _NEAR)[:, 0]
        least = max(_LEAST, _STRAY * noise)
        most = float(np.linalg.norm(np.ptp(values, axis=0)))
        crests = np.flatnonzero((steep >= 0.999 * dilation(mesh, steep, 2)) & (steep > 0))
        widths, contrasts = _widths_at(mesh, crests, steep, far, spread, (least, most))
        if len(widths) < _FEWEST:
            across = np.zeros(mesh.vertex_count, dtype=np.bool_)
            run(_is_crest, mesh.vertex_count, mesh.scaled_vertices, *mesh.neighbours, near, steep,
                across)  # fmt: skip
            crests = np.flatnonzero(across)
            widths, contrasts = _widths_at(mesh, crests, steep, far, spread, (least, most))
        if len(widths) < _FEWEST:
            return Borders(0.0, 0, noise)
        order = np.argsort(widths)
        total = np.cumsum(contrasts[order])
        width = np.interp(_QUANTILE * total[-1], total, widths[order])
        return Borders(float(width), len(widths), noise)


def _widths_at(
    mesh: TriangleMesh,
    crests: npt.NDArray[np.integer],
    steep: Floats,
    far: Floats,
    spread: Floats,
    limits: tuple[float, float],
) -> tuple[Floats, Floats]:
    # Widths and contrasts of those maxima of the slope that are borders.
    gentle = np.empty(len(crests))
    run(_potential_at, len(crests), mesh.scaled_vertices, mesh.faces, mesh.areas, *mesh.corners,
        far, crests, gentle)  # fmt: skip
    are_borders = steep[crests] > _ENDLESS * gentle
    crests, gentle = crests[are_borders], gentle[are_borders]
    ratio = steep[crests] / np.maximum(gentle, 1e-300)
    passes = np.maximum((_FAR - _NEAR * ratio) / (ratio - 1.0), 0.0)
    contrasts = np.sqrt(2.0 * math.pi * spread[crests] * (passes + _NEAR) * steep[crests])
    # Slopes at needle-like faces are far too steep.
    contrasts = np.minimum(contrasts, limits[1])
    strong = contrasts > limits[0]
    widths = WIDTH_OF_SIGMA * np.sqrt(spread[crests] * np.maximum(passes - 0.5, 0.0))
    return widths[strong], contrasts[strong]


def noise_of(mesh: TriangleMesh, values: Floats) -> float:
    """Measure the standard deviation of the noise in the channels of a signal (n, d).

    Uses the distance of the values of two faces at an edge from lying in one plane; the quartile,
    not the median, as borders bend as well.
    """
    step = max(3 * mesh.face_count // _SAMPLE, 1)
    chosen = np.arange(0, 3 * mesh.face_count, step)
    bends = np.full((len(chosen), values.shape[1]), np.nan)
    run(_bend, len(chosen), mesh.scaled_vertices, mesh.faces, mesh.twins, mesh.areas, values,
        chosen, bends)  # fmt: skip
    bends = bends[~np.isnan(bends[:, 0])]
    if not len(bends):
        return 0.0
    quartiles = np.quantile(bends, 0.25, axis=0)
    return float(np.sqrt((quartiles**2).mean()) / 0.31864)


def _spread(mesh: TriangleMesh) -> Floats:
    out = np.empty((mesh.vertex_count, 1))
    run(_measure_spread, mesh.vertex_count, mesh.scaled_vertices, *mesh.neighbours,
        mesh.neighbour_weights, out)  # fmt: skip
    return out


def nearby_range(mesh: TriangleMesh, values: Floats, distance: float) -> tuple[Floats, Floats]:
    """Minimum and maximum of each channel within a distance: (n, d), (n, d)."""
    rings = max(round(distance), 1)
    with aside(_MEASURING):
        neighbours = mesh.neighbours
    low = high = values
    spare = None
    for step in range(rings):
        outs = spare or (np.empty_like(values), np.empty_like(values))
        with phase(step / rings, (step + 1) / rings, _MEASURING):
            run(_widen_range, mesh.vertex_count, *neighbours, low, high, *outs)
        spare = (low, high) if step else None  # the caller's array is never written to
        low, high = outs
    return low, high


def local_contrast(mesh: TriangleMesh, values: Floats, presmooth: float, reach: float) -> Floats:
    """Range of values within a reach of each vertex, all channels together: (n,).

    Parameters
    ----------
    mesh : TriangleMesh
    values : (n, d) float64
    presmooth : float
        Sigma of the smoothing before, which removes single outliers.
    reach : float
        Radius; the result is smoothed by half of it.
    """
    with phase(0.0, 0.2, _MEASURING):
        calm = diffused(mesh, values, presmooth)
    with phase(0.2, 0.8, _MEASURING):
        low, high = nearby_range(mesh, calm, reach)
        ranges = np.sqrt(((high - low) ** 2).sum(axis=1, keepdims=True))
    with phase(0.8, 1.0, _MEASURING):
        return diffused(mesh, ranges, 0.5 * reach).reshape(-1)


def diffused(mesh: TriangleMesh, values: Floats, sigma: float) -> Floats:
    """Smooth values (n, d) by about a Gaussian, in far fewer passes than its variance needs.

    Uses Legendre polynomials of a smoothing pass M, with as many terms as the root of twice the
    number of passes (Meyer, Balsara and Aslam, 2014: super-time-stepping for diffusion).
    """
    passes = sigma * sigma / _SPREAD
    cycles = max(min(math.ceil(passes), _CYCLES), 1)
    terms = max(math.ceil(math.sqrt(2.0 * passes / cycles + 0.25) - 0.5), 1)
    share = 2.0 * passes / cycles / (terms * terms + terms)
    total = cycles * terms
    newest = older = values
    for done in range(total):
        term = done % terms + 1
        if term == 1:
            older = newest
        with phase(done / total, (done + 1) / total, _MEASURING):
            out = smooth_vertices(mesh, newest, 1)
            run(_legendre, mesh.vertex_count, share, 2.0 - 1.0 / term, newest, older, out)
        older, newest = newest, out
    return newest


@kernel
def _is_crest(start, stop, vertices, ring_start, ring, values, steep, out):
    # A crest has no greater slope across the border within two edges: in directions within 45
    # degrees of the gradient, in which values differ by as much as the slope says.
    for v in range(start, stop):
        out[v] = steep[v] > 0
        for i in range(ring_start[v], ring_start[v + 1]):
            u = ring[i]
            for k in range(ring_start[u], ring_start[u + 1]):
                for w in (u, ring[k]):
                    if steep[v] >= 0.999 * steep[w]:
                        continue
                    e = edge(vertices, v, w)
                    change = 0.0
                    for j in range(values.shape[1]):
                        change += (values[w, j] - values[v, j]) ** 2
                    if change > 0.5 * steep[v] * dot(e, e):
                        out[v] = False


@kernel
def _potential_at(start, stop, vertices, faces, areas, corner_start, corners, values, chosen, out):
    # The `flow_potential` without smoothing, at some vertices.
    for i in range(start, stop):
        v = chosen[i]
        total, area = 0.0, 0.0
        for place in range(corner_start[v], corner_start[v + 1]):
            f = corners[place] // 3
            total += areas[f] * squared_gradient(f, vertices, faces, areas, values)
            area += areas[f]
        out[i] = total / area if area > 0 else 0.0


@kernel
def _measure_spread(start, stop, vertices, ring_start, ring, weights, out):
    # Variance along each axis of one smoothing pass.
    for v in range(start, stop):
        total, squares = 1.0, 0.0
        for i in range(ring_start[v], ring_start[v + 1]):
            e = edge(vertices, v, ring[i])
            total += weights[i]
            squares += weights[i] * dot(e, e)
        out[v, 0] = 0.5 * squares / total


@kernel
def _widen_range(start, stop, ring_start, ring, low, high, new_low, new_high):
    last = low.shape[1] - 1
    for v in range(start, stop):
        for first in range(0, last + 1, 3):  # three channels at a time, which is faster
            i, j, k = first, min(first + 1, last), min(first + 2, last)
            a, b, c = low[v, i], low[v, j], low[v, k]
            p, q, r = high[v, i], high[v, j], high[v, k]
            for place in range(ring_start[v], ring_start[v + 1]):
                u = ring[place]
                a, b, c = min(a, low[u, i]), min(b, low[u, j]), min(c, low[u, k])
                p, q, r = max(p, high[u, i]), max(q, high[u, j]), max(r, high[u, k])
            new_low[v, i], new_low[v, j], new_low[v, k] = a, b, c
            new_high[v, i], new_high[v, j], new_high[v, k] = p, q, r


@kernel
def _legendre(start, stop, share, factor, newest, older, out):
    # The next of the polynomials P_k(A), A = (1 - share) + share M, from the last two; `out`
    # contains M applied to the last one.
    for v in range(start, stop):
        for j in range(newest.shape[1]):
            value = newest[v, j] + share * (out[v, j] - newest[v, j])
            out[v, j] = factor * value - (factor - 1.0) * older[v, j]


@kernel
def _bend(start, stop, vertices, faces, twins, areas, values, chosen, bends):
    # Distance of the value across an edge from the plane through a face's values, in standard
    # deviations of the noise.
    for i in range(start, stop):
        f = chosen[i] // 3
        k = chosen[i] - 3 * f
        t = twins[f, k]
        g = t // 3
        if t < 0 or areas[f] == 0 or areas[g] == 0:
            continue
        a, b, c = faces[f, k], faces[f, after(k)], faces[f, after(after(k))]
        d = faces[g, after(after(t - 3 * g))]
        side = edge(vertices, a, b)
        square = dot(side, side)
        along = dot(side, edge(vertices, a, c)) / square
        beyond = dot(side, edge(vertices, a, d)) / square
        heights = areas[g] / areas[f]
        of_a = heights * (1.0 - along) + 1.0 - beyond
        of_b = heights * along + beyond
        size = np.sqrt(1.0 + heights * heights + of_a * of_a + of_b * of_b)
        for j in range(values.shape[1]):
            # Differences, so that constant values give exactly 0.
            bend = heights * (values[c, j] - values[a, j]) + values[d, j] - values[a, j]
            bend -= of_b * (values[b, j] - values[a, j])
            bends[i, j] = abs(bend) / size
