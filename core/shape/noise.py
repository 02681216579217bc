# SPDX-License-Identifier: GPL-3.0-or-later
"""The noise of face normals, and the short-time Beltrami kernel that smooths them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..base.parallel import kernel, run
from ..base.progress import aside, ask, phase
from ..beltrami.mesh_smoothing import decay, smooth_faces
from ..mesh.calculus import average_to_faces, make_unit
from ..mesh.triangle_mesh import HUB, Floats, TriangleMesh
from ..settings import BeltramiGeometrySettings
from .sides import consistent_normals

LEAST_NOISE, MOST_NOISE = 6e-4, 0.45
"""Bounds of what the normals of neighbouring faces differ by for noise."""

MOLLIFIED = 10.0
"""Normals that differ by this many times the noise hardly mollify each other: creases stay."""


_SEEDS = 2000
"""Faces around which the noise is compared at several distances."""

_RINGS = 1, 2, 6
_MOST_AROUND = 1024
"""Most faces that are looked at around one."""

_SPREAD = 0.25
"""In scans, normals that are this far apart count by exp(-1/2)."""

_LOOSE, _STRICT = 4.0, 0.5
"""On relief, so many times that: in the first steps, and in those that follow."""

_SPIKE, _UNLIKE = 0.3, 0.5
"""A face on relief is a spike if those that are about _UNLIKE from it make up less than _SPIKE."""

_SPIKE_PASSES = 2
"""How often spikes are levelled, which may be some faces wide."""

_BETA = 0.9
"""The `beta` that these are for."""

# Thresholds for the kind of noise, chosen on virtual scans; see `benchmarks/scans.py`. Noise makes
# up at least the share _SHARE of the differences of normals over two rings. For relief without
# noise, the ratio of the squared differences over one ring and over two is below _CLEAN, or lower
# if there is little relief. Smoothing leaves much of relief and little of noise (_LEFT). After one
# pass it leaves less of white noise, which differs from vertex to vertex, than of the noise of
# scans (_WHITE). If most of the rest lies in few creases (_CREASED), the surface between them is
# calm. Squared differences over two rings above _WILD come from no scanner, and smoothing leaves
# more of them than of weaker noise.
_SHARE, _CLEAN, _LOWER = 0.5, 0.45, 0.8
_WILD = 0.4
_LEFT = 0.39, 0.32
_WHITE = 0.185
_CREASED = 0.081, 0.075

_CALM_FROM = 1 / 6
"""Below this `calm`, a scan is treated as relief."""


class Noise(NamedTuple):
    """The noise of a mesh's normals.

    Attributes
    ----------
    size : float
        How much the normals of neighbouring faces differ where the surface is calm. Between
        bounds, so that a clean mesh is not all noise, and a right angle never is.
    of_scan : bool
        Whether it is like that of scans, whose bumps are wider than a face, or lies on relief that
        is as strong as the noise.
    calm : float
        If so, whether the surface below is calm, as that of machine parts is between their
        creases, 1, or relief, 0.
    """

    size: float
    of_scan: bool = False
    calm: float = 0.0


def noise_of_normals(mesh: TriangleMesh) -> Noise:
    """Measure the noise of the normals of a mesh's faces.

    Its size is the lower quartile over all edges: creases and relief have little say.
    """
    steps = _steps_of(mesh, mesh.normals)
    if not len(steps):
        return Noise(MOST_NOISE)
    quartile, typical = np.quantile(steps, (0.25, 0.5))
    size = min(max(float(quartile), LEAST_NOISE), MOST_NOISE)
    rings = _over_rings(mesh, mesh.normals)
    if not _may_be_scan(rings):
        return Noise(size)
    smooth = _means(mesh, mesh.normals, 3, 2.0 * _SPREAD)
    few, many = np.quantile(_steps_of(mesh, smooth), (0.2, 0.95))
    smooth = _means(mesh, smooth, 3, 2.0 * _SPREAD)
    left = float(np.sqrt(_over_rings(mesh, smooth)[1] / rings[1]))
    calm = float(np.interp(left, _LEFT[::-1], (1.0, 0.0)))
    if calm > 0.5:
        blurred = _steps_of(mesh, _means(mesh, mesh.normals, 1, np.inf))
        if np.quantile(blurred, 0.2) < _WHITE * typical:
            return Noise(size)
    creased = float(np.interp(few, np.multiply(many, _CREASED[::-1]), (1.0, 0.0)))
    return Noise(size, True, max(calm, creased))


def _may_be_scan(rings: Floats) -> bool:
    # Squared differences over k rings are those of the noise, which are all there from the bumps'
    # width on, plus k^2 times those of the bending surface.
    one, two, six = rings
    bend = max((six - two) / (_RINGS[2] ** 2 - _RINGS[1] ** 2), 0.0)
    noise = two - _RINGS[1] ** 2 * bend
    if not noise > _SHARE * two or two > _WILD:
        return False
    return bool((one - bend) / noise + _LOWER * (noise / two - 0.75) > _CLEAN)


def _over_rings(mesh: TriangleMesh, normals: Floats) -> Floats:
    # Medians of squared differences of normals over some numbers of rings.
    count = min(_SEEDS, mesh.face_count)
    seeds = np.linspace(0, mesh.face_count - 1, count).astype(np.int32)
    found = np.empty((count, len(_RINGS)))
    run(_differences, count, mesh.faces, *mesh.corners, mesh.areas, normals, seeds, found,
        chunk=_SEEDS // 8)  # fmt: skip
    found = found[np.isfinite(found).all(axis=1)]
    return np.median(found, axis=0) if len(found) else np.zeros(len(_RINGS))


def _steps_of(mesh: TriangleMesh, normals: Floats) -> Floats:
    # How far normals are apart, edge by edge.
    steps = np.empty(3 * mesh.face_count)
    run(_normal_steps, mesh.face_count, mesh.twins, mesh.areas, normals, steps)
    return steps[steps >= 0]


def repeats(settings: BeltramiGeometrySettings, noise: Noise) -> int:
    """How often the filter is applied: on scans of relief by a third of what the settings say."""
    if not noise.of_scan:
        return settings.repeat
    return max(round(max(noise.calm, 1 / 3) * settings.repeat), 1)


def smoothed_normals(
    mesh: TriangleMesh, settings: BeltramiGeometrySettings, noise: Noise
) -> Floats:
    """Smooth the normals of the faces, `noise` being what `noise_of_normals` says: (m, 3)."""
    if noise.of_scan:
        return _smoothed_scan(mesh, settings, noise)
    with aside("Denoising"):
        centres = average_to_faces(mesh, mesh.scaled_vertices)
    normals, beta = mesh.normals, settings.beta / noise.size
    count = settings.iterations
    for iteration in range(count):
        with phase(iteration / count, (iteration + 1) / count, "Denoising"):
            with aside("Denoising"):
                guide = _means(mesh, normals, settings.mollify_passes, MOLLIFIED * noise.size)
            ask()
            normals = smooth_faces(mesh, centres, guide, beta, normals, settings)
    return normals


def _smoothed_scan(mesh: TriangleMesh, settings: BeltramiGeometrySettings, noise: Noise) -> Floats:
    # Steps of the kernel so short that they reach the faces around only.
    spread = _SPREAD * _BETA / max(settings.beta, 1e-6)
    if noise.calm < _CALM_FROM:
        return _smoothed_relief(mesh, settings, spread)
    everywhere = np.ones(mesh.face_count, dtype=np.bool_)
    normals = mesh.normals
    count = settings.iterations
    for iteration in range(count):
        with phase(iteration / count, (iteration + 1) / count, "Denoising"):
            # Distances are those between the normals of even patches: creases become straight.
            with phase(0.0, 0.5, "Denoising"):
                guide = consistent_normals(mesh, normals, everywhere, 1)
            with phase(0.5, 1.0, "Denoising"):
                for _ in range(max(round(4 * settings.time), 1)):
                    normals = _mean(mesh, normals, guide, spread)
    return normals


def _smoothed_relief(
    mesh: TriangleMesh, settings: BeltramiGeometrySettings, spread: float
) -> Floats:
    # What is left after the first steps is smoothed where it bends little.
    # Spikes would hold out against it: few normals around are like theirs.
    passes, normals = max(round(2 * settings.time), 1), mesh.normals
    with phase(0.0, 0.1, "Denoising"):
        for _ in range(_SPIKE_PASSES):
            normals = _without_spikes(mesh, normals)
    with phase(0.1, 0.3, "Denoising"):
        normals = _means(mesh, normals, passes, _LOOSE * spread)
    with phase(0.3, 1.0, "Denoising"):
        return _means(mesh, normals, passes * settings.iterations, _STRICT * spread)


def _without_spikes(mesh: TriangleMesh, normals: Floats) -> Floats:
    level, (start, corners) = np.empty_like(normals), mesh.corners
    run(_level_spikes, mesh.face_count, mesh.faces, start, corners.view(np.uint32), mesh.areas,
        normals, level)  # fmt: skip
    return level


def _means(mesh: TriangleMesh, normals: Floats, passes: int, spread: float) -> Floats:
    for _ in range(passes):
        normals = _mean(mesh, normals, normals, spread)
    return normals


def _mean(mesh: TriangleMesh, normals: Floats, guide: Floats, spread: float) -> Floats:
    smooth, (start, corners) = np.empty_like(normals), mesh.corners
    run(_average, mesh.face_count, mesh.faces, start, corners.view(np.uint32), mesh.areas, normals,
        guide, spread, smooth)  # fmt: skip
    return smooth


@kernel
def _differences(start, stop, faces, corner_start, corners, areas, normals, seeds, found):
    # Around each seed, the median squared difference of its normal to those some rings away, a ring
    # being all faces that share a vertex with the last; NaN where there are none.
    seen = np.full(faces.shape[0], -1, np.int32)
    passed = np.full(corner_start.shape[0], -1, np.int32)
    queue = np.empty(_MOST_AROUND, np.int32)
    squares = np.empty(_MOST_AROUND)
    for s in range(start, stop):
        seed = seeds[s]
        found[s] = np.nan
        if areas[seed] == 0:
            continue
        seen[seed] = s
        queue[0] = seed
        first, last, column = 0, 1, 0
        for ring in range(1, _RINGS[2] + 1):
            end = last
            for i in range(first, end):
                for k in range(3):
                    v = faces[queue[i], k]
                    if passed[v] == s:
                        continue
                    passed[v] = s
                    stride = 1 + (corner_start[v + 1] - corner_start[v] - 1) // HUB
                    for j in range(corner_start[v], corner_start[v + 1], stride):
                        g = corners[j] // 3
                        if seen[g] != s and last < _MOST_AROUND:
                            seen[g] = s
                            queue[last] = g
                            last += 1
            first = end
            if ring == _RINGS[column]:
                count = 0
                for i in range(first, last):
                    g = queue[i]
                    if areas[g] > 0:
                        square = 0.0
                        for x in range(3):
                            square += (normals[seed, x] - normals[g, x]) ** 2
                        squares[count] = square
                        count += 1
                if count > 0:
                    found[s, column] = np.median(squares[:count])
                column += 1


@kernel
def _normal_steps(start, stop, twins, areas, normals, steps):
    # How far the normals across each edge are apart; -1 for borders and the second half-edge.
    for f in range(start, stop):
        for k in range(3):
            g = twins[f, k] // 3
            steps[3 * f + k] = -1.0
            if f < g and areas[f] > 0 and areas[g] > 0:
                square = 0.0
                for x in range(3):
                    square += (normals[f, x] - normals[g, x]) ** 2
                steps[3 * f + k] = np.sqrt(square)


@kernel
def _average(start, stop, faces, corner_start, corners, areas, normals, guide, spread, out):
    # Means over the faces that share a vertex, those of similar guides; all for zero-area faces.
    # At a hub some stand for all. Corners are unsigned, which makes dividing them faster.
    rate = -0.5 / (spread * spread)
    for f in range(start, stop):
        gx, gy, gz = guide[f, 0], guide[f, 1], guide[f, 2]
        x = y = z = 0.0
        like = rate if areas[f] > 0 else 0.0
        for k in range(3):
            v = faces[f, k]
            count = corner_start[v + 1] - corner_start[v]
            stride = 1 if count <= HUB else 1 + count // HUB
            for i in range(corner_start[v], corner_start[v + 1], stride):
                g = corners[i] // np.uint32(3)
                dx, dy, dz = guide[g, 0] - gx, guide[g, 1] - gy, guide[g, 2] - gz
                weight = stride * areas[g] * decay(like * (dx * dx + dy * dy + dz * dz))
                x += weight * normals[g, 0]
                y += weight * normals[g, 1]
                z += weight * normals[g, 2]
        out[f, 0], out[f, 1], out[f, 2] = x, y, z
        make_unit(out[f])


@kernel
def _level_spikes(start, stop, faces, corner_start, corners, areas, normals, out):
    # The mean of the faces that share a vertex, where too few of them are alike. At a hub some
    # stand for all.
    rate = -0.5 / (_UNLIKE * _UNLIKE)
    for f in range(start, stop):
        out[f] = normals[f]
        x = y = z = alike = total = 0.0
        for k in range(3):
            v = faces[f, k]
            count = corner_start[v + 1] - corner_start[v]
            stride = 1 if count <= HUB else 1 + count // HUB
            for i in range(corner_start[v], corner_start[v + 1], stride):
                g = corners[i] // np.uint32(3)
                if g == f:
                    continue
                dx, dy, dz = normals[g, 0], normals[g, 1], normals[g, 2]
                square = (dx - normals[f, 0]) ** 2
                square += (dy - normals[f, 1]) ** 2 + (dz - normals[f, 2]) ** 2
                total += areas[g]
                alike += areas[g] * decay(rate * square)
                x += areas[g] * dx
                y += areas[g] * dy
                z += areas[g] * dz
        length = np.sqrt(x * x + y * y + z * z)
        if areas[f] > 0 and alike < _SPIKE * total and length > 1e-12 * total:
            out[f, 0], out[f, 1], out[f, 2] = x / length, y / length, z / length
