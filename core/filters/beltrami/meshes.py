# SPDX-License-Identifier: GPL-3.0-or-later
"""The short-time Beltrami kernel on triangle meshes: painted signals, the surface, or both.

A signal I painted on a mesh makes a surface of its own, with the vertices at (X, beta I): X in
mean edge lengths, I in [0, 1]. Each value becomes the mean of the values around it, weighted by
``exp(-d^2 / 4 t)`` with d the geodesic distance on that surface (paper C, equations 20 to 22; the
constant H0 is what makes the weights sum to one).

The paper integrates over the surface and does not say what a vertex stands for: here, for a third
of the area around it on the mesh, so that crowded vertices do not count more.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ...base.checks import checked_mask, checked_signal, checked_type
from ...base.parallel import Progress, chunk_size, kernel, run
from ...base.progress import ProgressCallback
from ...mesh.calculus import average_to_faces, blended_normals, group_means, lumped_mass, make_unit
from ...mesh.geodesics import Stencils, face_stencils, march, march_scratch, stencils
from ...mesh.order import is_scattered, sorted_along_curve
from ...mesh.triangle_mesh import Floats, TriangleMesh, split_at_jumps
from ...settings import BeltramiGeometrySettings, BeltramiMeshSettings
from ..fit import displacement, moved_vertices
from ..signals import from_own_corners, like, to_own_corners

LEAST_NOISE, MOST_NOISE = 6e-4, 0.45
"""Bounds of what the normals of neighbouring faces differ by for noise."""

MOLLIFIED = 10.0
"""Normals that differ by this many times the noise hardly mollify each other: creases stay."""

_REACHED = 500_000
"""About how many vertices a chunk's marches reach: tenths of a second between cancel points."""


def beltrami_vertex_signal(
    mesh: TriangleMesh,
    signal: npt.ArrayLike,
    settings: BeltramiMeshSettings | None = None,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> npt.NDArray:
    """Denoise a signal given at the vertices of a mesh, such as vertex colors; edges stay.

    Parameters
    ----------
    mesh : TriangleMesh
    signal : (n,) or (n, d) array of float32 or float64
        Any number of channels, which are filtered together; `beta` is meant for values in
        [0, 1].
    settings : BeltramiMeshSettings, optional
    mask : (n,) array of float in [0, 1], optional
        1 filters fully, less mixes with the input, 0 keeps it bit for bit.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    array like `signal`
        Within the input's range. A time of 0 returns the input bit for bit.

    Raises
    ------
    InvalidSignal
        If signal or mask do not fit the mesh, or hold NaN or infinity.
    Cancelled
        If `progress` returned False.

    Notes
    -----
    Paper C, equations 20 to 22, of which only the components of the signal are filtered
    (equation 7). Lengths are in mean edge lengths; differs from the paper in weighing vertices by
    the area around them, which it leaves open.
    """
    given = checked_type(signal)
    values = checked_signal(given, mesh.vertex_count)
    weights = checked_mask(mask, mesh.vertex_count)
    settings = settings or BeltramiMeshSettings()
    if settings.time == 0:
        return given.copy()
    phases = Progress.of(progress)
    filtered = _painted(mesh, values, settings, phases)
    return like(given, values, filtered, weights, phases.part(1.0, 1.0, "Denoising"))


def beltrami_corner_signal(
    mesh: TriangleMesh,
    signal: npt.ArrayLike,
    settings: BeltramiMeshSettings | None = None,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> npt.NDArray:
    """Denoise a signal given at the corners of the faces of a mesh, such as corner colors.

    Where corners at a vertex differ, the signal jumps, and nothing crosses; elsewhere they are
    one, and stay one.

    Parameters
    ----------
    mesh : TriangleMesh
    signal : (m, 3) or (m, 3, d) array of float32 or float64
        Corners in the order of the faces that the mesh was made from.
    settings, progress
        As in `beltrami_vertex_signal`.
    mask : (n,) array of float in [0, 1], optional
        Weights of the vertices.

    Returns
    -------
    array like `signal`
        Within the input's range. A time of 0 returns the input bit for bit.

    Raises
    ------
    InvalidSignal, Cancelled
        As in `beltrami_vertex_signal`.

    Notes
    -----
    Paper C, as in `beltrami_vertex_signal`, on the surface that is cut open at the jumps.
    """
    given = checked_type(signal)
    own = to_own_corners(mesh, given)
    values = checked_signal(own, 3 * mesh.face_count)
    weights = checked_mask(mask, mesh.vertex_count)
    settings = settings or BeltramiMeshSettings()
    if settings.time == 0:
        return given.copy()
    phases = Progress.of(progress)
    cut, cut_values = split_at_jumps(mesh, values, phases)
    filtered = _painted(cut, cut_values, settings, phases)
    result = filtered[cut.own_corners(cut.faces).reshape(-1)]
    corner_weights = None if weights is None else weights[mesh.faces.reshape(-1)]
    mixed = like(own, values, result, corner_weights, phases.part(1.0, 1.0, "Denoising"))
    return from_own_corners(mesh, mixed, given)


def beltrami_joint(
    mesh: TriangleMesh,
    signal: npt.ArrayLike,
    settings: BeltramiMeshSettings | None = None,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> tuple[Floats, npt.NDArray]:
    """Denoise a mesh and the signal painted on it together (paper C, equation 22).

    Both are averaged with the same weights: edges of the signal keep the shape there, too.

    Parameters
    ----------
    mesh, signal, settings, mask, progress
        As in `beltrami_vertex_signal`.

    Returns
    -------
    positions : (n, 3) float64
        In the unit of `mesh.vertices`.
    signal : array like `signal`
        A time of 0 returns both bit for bit.

    Raises
    ------
    InvalidSignal, Cancelled
        As in `beltrami_vertex_signal`.
    """
    given = checked_type(signal)
    values = checked_signal(given, mesh.vertex_count)
    weights = checked_mask(mask, mesh.vertex_count)
    settings = settings or BeltramiMeshSettings()
    if settings.time == 0:
        return mesh.vertices.copy(), given.copy()
    phases = Progress.of(progress)
    moved, filtered = _jointly(mesh, values, settings, settings.beta, phases)
    positions = moved_vertices(mesh, _weighed(moved, weights))
    last = phases.part(1.0, 1.0, "Denoising")
    return positions, like(given, values, filtered, weights, last)


def beltrami_joint_corners(
    mesh: TriangleMesh,
    signal: npt.ArrayLike,
    settings: BeltramiMeshSettings | None = None,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> tuple[Floats, npt.NDArray]:
    """Denoise a mesh and the signal at its corners together (paper C, equation 22).

    Where corners at a vertex differ, nothing crosses, as in `beltrami_corner_signal`; the vertex
    moves as the mean of its sides does, so that the mesh does not crack open.

    Parameters
    ----------
    mesh, signal, settings, mask, progress
        As in `beltrami_corner_signal`.

    Returns
    -------
    positions : (n, 3) float64
        In the unit of `mesh.vertices`.
    signal : array like `signal`

    Raises
    ------
    InvalidSignal, Cancelled
        As in `beltrami_corner_signal`.
    """
    given = checked_type(signal)
    values = checked_signal(to_own_corners(mesh, given), 3 * mesh.face_count)
    weights = checked_mask(mask, mesh.vertex_count)
    phases = Progress.of(progress)
    cut, cut_values = split_at_jumps(mesh, values, phases)
    corners = cut.own_corners(cut.faces).reshape(-1)
    vertex = np.empty(cut.vertex_count, dtype=np.intp)
    vertex[corners] = mesh.faces.reshape(-1)
    points, filtered = beltrami_joint(
        cut, cut_values, settings, None if weights is None else weights[vertex], progress
    )
    moved = np.zeros_like(mesh.vertices)
    group_means(vertex, points - cut.vertices, moved, phases.part(1.0, 1.0, "Denoising"))
    positions = moved_vertices(mesh, moved)
    after = np.where(filtered[corners] == values, values, filtered[corners])  # the sign of 0 too
    return positions, from_own_corners(mesh, after.astype(given.dtype), given)


def beltrami_mesh(
    mesh: TriangleMesh,
    settings: BeltramiGeometrySettings | None = None,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> Floats:
    """Denoise a mesh; creases stay.

    Parameters
    ----------
    mesh : TriangleMesh
    settings : BeltramiGeometrySettings, optional
    mask : (n,) array of float in [0, 1], optional
        1 filters fully, less filters less, 0 leaves the vertex in place bit for bit.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    (n, 3) float64
        New positions in the unit of `mesh.vertices`. A time of 0 returns the old ones bit for
        bit.

    Raises
    ------
    InvalidSignal
        If the mask does not fit the mesh or leaves [0, 1].
    SolverError
        If the refit's linear system cannot be solved.
    Cancelled
        If `progress` returned False.

    Notes
    -----
    Paper C filters the positions, which rounds creases with the noise. Beyond the paper, the
    kernel is applied to the normals of the faces, a signal that is painted on the mesh and jumps
    at creases, and the positions are fitted to them (see `fit_to_normals`). Two neighbouring
    faces are as far apart as their centres at (X, beta N), and distances run from face to face.
    N is mollified before distances are measured, since the noise of single faces would hide the
    creases; what is averaged are the normals themselves. And `beta` is divided by the noise that
    the normals have, so that one setting serves for light noise and strong noise, and a clean
    mesh hardly changes.
    """
    settings = settings or BeltramiGeometrySettings()
    weights = checked_mask(mask, mesh.vertex_count)
    if settings.time == 0:
        return mesh.vertices.copy()
    phases = Progress.of(progress)
    if is_scattered(mesh):
        ordered, order, _ = sorted_along_curve(mesh, phases)
        moved = np.empty_like(mesh.vertices)
        ordered_weights = None if weights is None else weights[order]
        moved[order] = _displaced(ordered, settings, ordered_weights, phases)
    else:
        moved = _displaced(mesh, settings, weights, phases)
    phases.update(1.0)
    return moved_vertices(mesh, moved)


def _displaced(
    mesh: TriangleMesh,
    settings: BeltramiGeometrySettings,
    weights: Floats | None,
    progress: Progress = Progress(None),
) -> Floats:
    if settings.filtered == "positions":
        moved, _ = _jointly(mesh, np.zeros((mesh.vertex_count, 0)), settings, 0.0, progress)
        return _weighed(moved, weights)
    moved, current = np.zeros((0, 3)), mesh
    noise = noise_of_normals(mesh, progress.part(0.0, 0.0, "Denoising"))
    for turn in range(settings.repeat):
        part = progress.part(turn / settings.repeat, (turn + 1) / settings.repeat, "Denoising")
        normals = _filtered_normals(current, settings, noise, part.part(0.0, 0.7, "Denoising"))
        if weights is not None:
            normals = blended_normals(
                mesh, current.normals, normals, weights, part.part(0.7, 0.7, "Denoising")
            )
        step, _ = displacement(
            current, normals, settings, weights, part.part(0.7, 1.0, "Fitting the surface")
        )
        moved = step if turn == 0 else moved + step
        if turn + 1 < settings.repeat:
            current = mesh.displaced(moved)
    return moved


def noise_of_normals(mesh: TriangleMesh, progress: Progress | None = None) -> float:
    """How much the normals of neighbouring faces differ where the surface is calm.

    The lower quartile over all edges: creases and relief have little say. Between bounds, so
    that a clean mesh is not all noise, and a right angle never is.
    """
    steps = np.empty(3 * mesh.face_count)
    run(_normal_steps, mesh.face_count, mesh.twins, mesh.areas, mesh.normals, steps,
        progress=progress)  # fmt: skip
    steps = steps[steps >= 0]
    if not len(steps):
        return MOST_NOISE
    quartile = float(np.quantile(steps, 0.25, overwrite_input=True))
    return min(max(quartile, LEAST_NOISE), MOST_NOISE)


def _filtered_normals(
    mesh: TriangleMesh,
    settings: BeltramiGeometrySettings,
    noise: float,
    progress: Progress = Progress(None),
) -> Floats:
    still = progress.part(0.0, 0.0, "Denoising")
    embedding = np.empty((mesh.face_count, 6))
    embedding[:, :3] = average_to_faces(mesh, mesh.scaled_vertices, still)
    normals = mesh.normals
    for turn in range(settings.iterations):
        part = _iteration(settings, turn, progress)
        still = part.part(0.0, 0.0, "Denoising")
        guide = normals
        for _ in range(settings.mollify_passes):
            smooth = np.empty_like(guide)
            run(_mollify, mesh.face_count, mesh.faces, *mesh.corners, mesh.areas, guide,
                MOLLIFIED * noise, smooth, progress=still)  # fmt: skip
            guide = smooth
        np.multiply(guide, settings.beta / noise, out=embedding[:, 3:])
        still.update(0.0)
        graph = face_stencils(mesh, embedding, still)
        normals = _averaged(graph, embedding, mesh.areas, normals, settings, part)
        run(_make_unit, mesh.face_count, normals, progress=part.part(1.0, 1.0, "Denoising"))
    return normals


def _painted(
    mesh: TriangleMesh,
    values: Floats,
    settings: BeltramiMeshSettings,
    progress: Progress = Progress(None),
) -> Floats:
    # The signal alone is filtered; the mesh is as it was given. Means keep to the range of the
    # input but for rounding.
    mass = lumped_mass(mesh, progress.part(0.0, 0.0, "Denoising"))
    low, high = values.min(axis=0), values.max(axis=0)
    for turn in range(settings.iterations):
        part = _iteration(settings, turn, progress)
        embedding = np.concatenate([mesh.scaled_vertices, settings.beta * values], axis=1)
        graph = stencils(mesh, embedding, part.part(0.0, 0.0, "Denoising"))
        means = _averaged(graph, embedding, mass, values, settings, part)
        values = np.clip(means, low, high)
    progress.update(1.0)
    return values


def _jointly(
    mesh: TriangleMesh,
    values: Floats,
    settings: BeltramiMeshSettings,
    beta: float,
    progress: Progress = Progress(None),
) -> tuple[Floats, Floats]:
    # Mesh and signal are filtered; returns the displacement in the mesh's unit, and the signal.
    # Lengths and areas stay those of the given mesh: only so are the iterations alike.
    points, mass = mesh.scaled_vertices, lumped_mass(mesh, progress.part(0.0, 0.0, "Denoising"))
    low, high = values.min(axis=0), values.max(axis=0)
    for turn in range(settings.iterations):
        part = _iteration(settings, turn, progress)
        embedding = np.concatenate([points, beta * values], axis=1)
        graph = stencils(mesh, embedding, part.part(0.0, 0.0, "Denoising"))
        both = np.concatenate([points, values], axis=1)
        points, means = np.split(_averaged(graph, embedding, mass, both, settings, part), [3], 1)
        values = np.clip(means, low, high)
    progress.update(1.0)
    return (points - mesh.scaled_vertices) * mesh.mean_edge_length, values


def _iteration(
    settings: BeltramiMeshSettings, turn: int, progress: Progress = Progress(None)
) -> Progress:
    count = settings.iterations
    return progress.part(turn / count, (turn + 1) / count, "Denoising")


def _averaged(
    graph: Stencils,
    embedding: Floats,
    mass: Floats,
    values: Floats,
    settings: BeltramiMeshSettings,
    progress: Progress = Progress(None),
) -> Floats:
    # Apply the kernel once; the embedding's first three coordinates are the place in space.
    count = len(mass)
    limit = math.sqrt(-4.0 * settings.time * math.log(settings.threshold))
    around = min(2.0 * math.pi * limit**2 + 1.0, count)
    chunk = min(max(int(_REACHED / around), 1), chunk_size(count))
    out = np.empty_like(values)
    if settings.distance == "geodesic":
        run(_geodesic_means, count, settings.time, limit, graph, mass, values, out,
            progress=progress, chunk=chunk)  # fmt: skip
    else:
        run(_euclidean_means, count, settings.time, limit, graph.start, graph.targets, embedding,
            mass, values, out, progress=progress, chunk=chunk)  # fmt: skip
    return out


def _weighed(moved: Floats, weights: Floats | None) -> Floats:
    return moved if weights is None else weights[:, None] * moved


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
def _make_unit(start, stop, vectors):
    for f in range(start, stop):
        make_unit(vectors[f])


@kernel
def _mollify(start, stop, faces, corner_start, corners, areas, normals, spread, out):
    # Means over the faces that share a vertex, those of similar normals; all for zero-area faces.
    for f in range(start, stop):
        out[f] = 0.0
        for k in range(3):
            v = faces[f, k]
            for i in range(corner_start[v], corner_start[v + 1]):
                g = corners[i] // 3
                square = 0.0
                for x in range(3):
                    square += (normals[f, x] - normals[g, x]) ** 2
                weight = areas[g]
                if areas[f] > 0:
                    weight *= np.exp(-0.5 * square / (spread * spread))
                for x in range(3):
                    out[f, x] += weight * normals[g, x]
        make_unit(out[f])


@kernel
def _geodesic_means(start, stop, time, limit, graph, mass, values, out):
    scratch = march_scratch(mass.shape[0])
    reached, squares = scratch[0], scratch[1]
    for v in range(start, stop):
        if mass[v] == 0:
            out[v] = values[v]
            continue
        count = march(v, v - start + 1, limit, graph, *scratch)
        out[v] = 0.0
        total = 0.0
        for i in range(count):
            w = reached[i]
            weight = mass[w] * np.exp(-squares[w] / (4 * time))
            total += weight
            for j in range(values.shape[1]):
                out[v, j] += weight * values[w, j]
        for j in range(values.shape[1]):
            out[v, j] /= total


@kernel
def _euclidean_means(start, stop, time, limit, row_start, ring, embedding, mass, values, out):
    # All that is connected within the limit in space counts; a bilateral filter.
    count = mass.shape[0]
    found = np.empty(count, np.int32)
    stamps = np.full(count, -1, np.int32)
    for v in range(start, stop):
        if mass[v] == 0:
            out[v] = values[v]
            continue
        out[v] = 0.0
        total = 0.0
        found[0] = v
        stamps[v] = v
        seen, size = 0, 1
        while seen < size:
            w = found[seen]
            seen += 1
            square = 0.0
            for j in range(embedding.shape[1]):
                square += (embedding[w, j] - embedding[v, j]) ** 2
            if square <= limit * limit:
                weight = mass[w] * np.exp(-square / (4 * time))
                total += weight
                for j in range(values.shape[1]):
                    out[v, j] += weight * values[w, j]
            for i in range(row_start[w], row_start[w + 1]):
                u = ring[i]
                if stamps[u] == v:
                    continue
                stamps[u] = v
                square = 0.0
                for j in range(3):
                    square += (embedding[u, j] - embedding[v, j]) ** 2
                if square <= limit * limit:
                    found[size] = u
                    size += 1
        for j in range(values.shape[1]):
            out[v, j] /= total
