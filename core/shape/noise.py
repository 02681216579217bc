# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise of face normals: how large it is, where it is possible, and its Beltrami smoothing."""

from __future__ import annotations

from math import log

import numpy as np

from ..base.parallel import kernel, run
from ..base.progress import aside, ask, phase
from ..base.vectors import after, dot, edge
from ..beltrami.mesh_smoothing import decay, smooth_faces
from ..mesh.calculus import average_to_faces, make_unit
from ..mesh.triangle_mesh import HUB, Floats, TriangleMesh
from ..settings import BeltramiGeometrySettings
from ..sparse.components import connected_components
from .smoothings import average_around

LEAST_NOISE, MOST_NOISE = 6e-4, 0.45
"""Bounds of the noise, as a distance between unit normals of neighbouring faces."""

MOLLIFIED = 10.0
"""Standard deviation, in multiples of the noise, of the Gaussian weight in mollifying. Across a
crease normals differ by more, so that they hardly mollify each other."""

PLANE = 0.02, 0.06
"""Ramp in degrees between the normals of neighbouring faces: below the first value they are in one
plane, above the second they are not. This is more than the rounding of single precision, and far
below any visible noise."""

DESIGNED, UNEVEN, TILED = (0.6, 0.95), (0.35, 0.55), (0.03, 0.15)
"""Ramps by which a place counts as made by a design program, from not at all to fully: of the share
of faces with a neighbour in their plane, and of the standard deviation of the logarithms of edge
lengths, both within two rings. And the ramp of the share of tiles within four rings that rules it
out."""

EQUAL, MANY = 0.03, (300, 1000)
"""Greatest relative difference of area between tiles; and the ramp of the number of tiles in the
mesh from which they count: fewer may be part of the model."""

FINENESS, MOST_ALIKE = 1e-3, 64
"""Edges are equal if their lengths differ by less, in mean edge lengths; and the most faces with
the same edges among which a face may count as mirrored: voxel surfaces have many more."""

EVEN = 0.45, 0.6
"""Ramp of the standard deviation of the logarithms of edge lengths within four rings: below the
first value edges are even, as in remeshes, above the second they have many lengths. Where creases
of a remeshed part are sharpened, edges reach 0.5."""

MIRRORED, MODELLED = (0.7, 0.9), (20_000, 100_000)
"""Ramp of the share of faces with mirror images, within two rings: below the first value it does
not matter, above the second there is no noise. And the ramp of the number of faces of the mesh over
which this rule fades out: mirrored scans have more faces."""

FEW = 32, 128
"""Ramp of the number of faces of a connected component: up to the first it has no noise, from the
second on it may have. The ramp is linear in the logarithm."""


def possible_noise(mesh: TriangleMesh, remeshed: bool = False) -> Floats:
    """Estimate where faces may have noise: (m,), from 0 for surely none to 1.

    Not in the papers. Noise leaves hardly any two faces in one plane. So there is none where most
    faces have a neighbour in their plane and edges have many lengths. Voxel surfaces and the
    terraces of depth cameras also lie in planes, but consist of tiles: faces with two neighbours of
    the same area in their plane. Components of some dozens of faces are too small to tell noise
    from shape, so they count as free of it.

    Nor is there noise where faces have mirror images in the mesh, as in models built by mirroring
    one half. With `remeshed` this rule is left out, because remeshes have mirror images by chance.
    """
    told = _planes_and_lengths(mesh)
    near = _spread(mesh, _spread(mesh, told))
    tiled = _spread(mesh, _spread(mesh, near[:, 1:2]))[:, 0]
    in_planes = near[:, 0]
    uneven = _deviation(near[:, 2:])
    designed = between(in_planes, DESIGNED) * between(uneven, UNEVEN)
    if not remeshed:
        symmetric = _spread(mesh, _spread(mesh, mirrored_faces(mesh)))[:, 0]
        designed = np.maximum(designed, between(symmetric, MIRRORED))
    designed *= 1.0 - between(tiled, TILED) * between(told[:, 1].sum(), MANY)
    return (1.0 - designed) * size_ramp(mesh, FEW)


def size_ramp(mesh: TriangleMesh, ends: tuple[int, int]) -> Floats:
    """Ramp, on a logarithmic scale, of the number of faces of each face's component: (m,)."""
    a, b, c = mesh.faces.T
    _, part = connected_components(mesh.vertex_count, np.append(a, b), np.append(b, c))
    sizes = np.maximum(np.bincount(part[a], minlength=1), 1)  # 1 for loose vertices, not used
    return between(np.log(sizes), (log(ends[0]), log(ends[1])))[part[a]]


def even_edges(mesh: TriangleMesh) -> Floats:
    """Measure where edges are about equally long: (m,), from 0 for many lengths to 1.

    Remeshes and scans have even edges. Exports of design programs do not, wherever the surface has
    sides of different sizes.
    """
    near = _planes_and_lengths(mesh)[:, 2:]
    for _ in range(4):
        near = _spread(mesh, near)
    return 1.0 - between(_deviation(near), EVEN)


def _planes_and_lengths(mesh: TriangleMesh) -> Floats:
    told = np.empty((mesh.face_count, 4))
    run(_find_planes, mesh.face_count, mesh.scaled_vertices, mesh.faces, mesh.twins, mesh.areas,
        mesh.normals, np.radians(PLANE), EQUAL, told)  # fmt: skip
    return told


def _deviation(moments: Floats) -> Floats:
    # The standard deviation, from the mean and the mean of squares.
    mean, square = moments.T
    return np.sqrt(np.maximum(square - mean * mean, 0.0))


def mirrored_faces(mesh: TriangleMesh) -> Floats:
    """Find the faces that have a mirror image elsewhere: (m, 1), 0 or 1; less in large meshes.

    In a mesh with a plane of symmetry, the edge lengths of a face occur in its own cyclic order and
    in the opposite one in equally many faces. Height fields with steps, on square grids, also have
    many equal faces, but hardly ever as many of both orders.
    """
    m = mesh.face_count
    weight = 1.0 - between(log(max(m, 1)), (log(MODELLED[0]), log(MODELLED[1])))
    if weight == 0.0:
        return np.zeros((m, 1))
    corners = mesh.scaled_vertices[mesh.faces]
    lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    first = lengths.argmax(axis=1)
    turned = np.take_along_axis(lengths, (first[:, None] + np.arange(3)) % 3, axis=1)
    found = np.zeros(m, dtype=bool)
    for shift in (0.0, 0.5):  # lengths on both sides of a step are in one step of the other grid
        steps = np.minimum(turned / FINENESS + shift, 2.0**20).astype(np.int64)
        own = (steps[:, 0] << 42) + (steps[:, 1] << 21) + steps[:, 2]
        other = (steps[:, 0] << 42) + (steps[:, 2] << 21) + steps[:, 1]
        keys, counts = np.unique(own, return_counts=True)
        counts = np.append(counts, 0)
        alike = counts[np.searchsorted(keys, own)]
        at = np.searchsorted(keys, other)
        at[np.append(keys, -1)[at] != other] = len(keys)
        found |= (own != other) & (alike <= MOST_ALIKE) & (counts[at] == alike)
    return weight * found[:, None].astype(np.float64)


def _spread(mesh: TriangleMesh, values: Floats) -> Floats:
    # Averages over the faces around each face's vertices, without area weights.
    return average_to_faces(mesh, average_around(mesh, values).astype(np.float64))


def between(values: Floats | float, ends: tuple[float, float]) -> Floats:
    """Return a linear ramp from 0 at the first end to 1 at the second."""
    return np.clip((values - ends[0]) / (ends[1] - ends[0]), 0.0, 1.0)


def noise_of_normals(mesh: TriangleMesh) -> float:
    """Measure the noise: the distance between unit normals of neighbouring faces in smooth areas.

    It is the lower quartile over all edges, which creases and relief hardly affect. Bounds keep the
    tiny turns of a clean mesh from counting as features, and right angles from counting as noise.
    """
    steps = _steps_of(mesh, mesh.normals)
    if not len(steps):
        return MOST_NOISE
    return min(max(float(np.quantile(steps, 0.25)), LEAST_NOISE), MOST_NOISE)


def _steps_of(mesh: TriangleMesh, normals: Floats) -> Floats:
    # The distance between the normals at each edge.
    steps = np.empty(3 * mesh.face_count)
    run(_normal_steps, mesh.face_count, mesh.twins, mesh.areas, normals, steps)
    return steps[steps >= 0]


def smoothed_normals(
    mesh: TriangleMesh, settings: BeltramiGeometrySettings, noise: float
) -> Floats:
    """Smooth face normals by the Beltrami kernel; `noise` is from `noise_of_normals`: (m, 3)."""
    with aside("Denoising"):
        centres = average_to_faces(mesh, mesh.scaled_vertices)
    normals, beta = mesh.normals, settings.beta / noise
    count = settings.iterations
    for iteration in range(count):
        with phase(iteration / count, (iteration + 1) / count, "Denoising"):
            with aside("Denoising"):
                guide = _means(mesh, normals, settings.mollify_passes, MOLLIFIED * noise)
            ask()
            normals = smooth_faces(mesh, centres, guide, beta, normals, settings)
    return normals


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
def _normal_steps(start, stop, twins, areas, normals, steps):
    # The distance between the normals at each edge; -1 at borders and for the second half-edge.
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
def _find_planes(start, stop, places, faces, twins, areas, normals, ends, equal, told):
    # For each face: how surely a neighbour is in its plane; whether it is a tile; the mean of the
    # logarithms of its edge lengths, and of their squares.
    for f in range(start, stop):
        least, alike = 4.0, 0
        told[f, 2] = told[f, 3] = 0.0
        for k in range(3):
            e = edge(places, faces[f, k], faces[f, after(k)])
            length = 0.5 * np.log(max(dot(e, e), 1e-6))
            told[f, 2] += length / 3.0
            told[f, 3] += length * length / 3.0
            g = twins[f, k] // 3
            if twins[f, k] >= 0 and areas[f] > 0 and areas[g] > 0:
                square = 0.0
                for x in range(3):
                    square += (normals[f, x] - normals[g, x]) ** 2
                least = min(least, square)
                if square < ends[1] ** 2 and abs(areas[g] - areas[f]) < equal * areas[f]:
                    alike += 1
        t = (np.sqrt(least) - ends[0]) / (ends[1] - ends[0])
        told[f, 0] = 1.0 - min(max(t, 0.0), 1.0)
        told[f, 1] = 1.0 if alike > 1 else 0.0


@kernel
def _average(start, stop, faces, corner_start, corners, areas, normals, guide, spread, out):
    # Averages over the faces that share a vertex, weighted by the similarity of their guides; for
    # faces without area, over all. At vertices of very many faces, an evenly spread sample is used.
    # Corners are unsigned, which makes dividing them faster.
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
