# SPDX-License-Identifier: GPL-3.0-or-later
"""The learned denoiser: networks mix smoothed normals face by face, and the mesh is fitted to them.

Not in the papers. The candidates are the smoothed normals of `smoothings`. In each of three stages
a small network, trained on synthetic solids (`tools/training`), weighs them. Faces that hardly turn
stay as they are. At the end creases are sharpened as far as the noisy normals agree.
"""

from __future__ import annotations

from functools import cache, partial
from math import ceil
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..base.memo import kept
from ..base.parallel import blocks, kernel, run
from ..base.progress import phase
from ..base.vectors import cross, dot, edge
from ..errors import InvalidMesh, SolverError
from ..mesh.adjacency import within_rings
from ..mesh.calculus import (
    average_to_faces,
    average_to_vertices,
    blended_normals,
    faces_touching,
    greatest_to_faces,
    greatest_to_vertices,
    smooth_vertices,
)
from ..mesh.triangle_mesh import Floats, TriangleMesh, part_of
from ..mixture.choice import free_mixture
from ..mixture.network import Network, Singles, load
from ..settings import FitSettings, GeometrySettings
from .creases import find_targets
from .fit import LEAST_WEIGHT, displacement
from .folds import mended
from .noise import between, possible_noise
from .smoothings import (
    DEFINITION,
    Smoothings,
    average_around,
    even_out,
    first_smoothings,
    next_smoothings,
    with_creases,
    without_bumps,
)

WEIGHTS = Path(__file__).with_name("denoise.npz")

STAGES = "first", "next", "last"
"""Names of the networks, in the order of the stages."""

FITS = 3
"""Number of successive fits to the normals of the last stage; other stages have one."""

_FIT = FitSettings(screening_radius=5.0)

BUMP_REACH, BUMP_FITS = 2.0, 2
"""The fit that removes bumps: its screening radius grows by this factor times the bump size; and
the number of successive fits."""

_TURN_RAMP = 1.6, 3.0
"""Ramp in degrees, of the largest turn within two rings of a face: below the first value the face
keeps its normal, above the second it takes the new one."""

_BEGIN_RAMP, _END_RAMP, _UNDO_ROUNDS = (0.5, 1.5), (1.0, 2.0), 4
"""Ramps of a ratio: the squared distance from the target normals after a displacement, over that
before it. Below the first value a vertex keeps its displacement, above the second it loses all of
it. The first ramp is for what earlier stages have moved, before the fits of a stage; the second for
the result of these fits. A good fit leaves about 0.1; one at creases of noisy voxel surfaces leaves
up to 1 and is still better than the input. The test is repeated, at most this often, because
vertices that go back turn the faces beside them."""

_LEAST_DEVIATION = 3e-4
"""Squared distance between unit normals that counts as none: 1 degree."""

_NOT_FLIPPED, _FLIPPED = 0.4, -0.2
"""Ramp of the cosine between a face normal and its target: a face above the first value is not
turned over, one below the second is fully. A fit cannot turn such a face back, so the vertices
around it are smoothed before the fit."""

_SQUARE_TOLERANCE = 2e-3
"""Tolerance, for relative differences of squared lengths and for cosines, of the test whether two
squares are equal and perpendicular: far above the rounding of single precision, and far below any
noise."""

_STEP_SHARE = 0.15
"""A vertex lies fully on voxel steps if at least this share of its faces has a step up, and as many
a step down."""

_STEPPED_RAMP = 0.4, 0.55
"""Ramp of the mean of that measure within three rings: below the first value a vertex stays, above
the second it is smoothed fully."""

_STEP_COUNT_RAMP = 50, 200
"""The same ramp for the number of such vertices in the mesh: a few steps are part of the model."""

_FLIP_SMOOTHING = 4.0
"""Vertices are smoothed by this factor times the mean share of turned-over faces around them."""

_AGREEMENT_PASSES, _SHORTEST_MEAN = 16, 0.2
"""Smoothing passes of the means that tell how far noisy normals agree with sharper creases; such a
mean covers about 100 faces. And the least length of the mean noisy normal that is counted."""

_RIDGE = 0.04
"""Ridge penalty of that share, as a part of the mean squared noise: it stands for the expectation
that shares lie about 0, with a deviation of a third. A smaller one makes fillets of 2 to 4 edge
lengths crisper in strong noise along normals."""

_SHARPER_RAMP = 1.0, 1.2
"""The same ramp as `_END_RAMP` for the sharpening at the end, with the noisy normals as target."""

_RINGS, _LARGEST_PART = 24, 0.6
"""Vertices farther than this many rings from all faces that turn stay. With a mask, only the part
within this many rings of the chosen vertices is denoised, unless it has more than this share of all
vertices: then the whole mesh is."""

_BLOCK = 1 << 15
"""Number of faces that a network scores in one call."""

_MESSAGE = "Denoising"


@cache
def networks() -> list[Network]:
    """Load the networks that weigh the smoothed normals, one for each stage."""
    found = load(WEIGHTS, DEFINITION)
    return [found[name] for name in STAGES]


def learned_displacement(
    mesh: TriangleMesh,
    weights: Floats | None,
    strength: float = 1.0,
    nets: list[Network] | None = None,
    bump_size: float = 0.0,
    keep_creases: float = 0.5,
) -> Floats:
    """Find the displacement that removes noise: (n, 3), in the unit of `mesh.vertices`.

    Parameters
    ----------
    mesh : TriangleMesh
    weights : (n,) float64 or None
        Share of its displacement that each vertex takes. Vertices of weight 0 stay in place, and
        the rest is fitted to them.
    strength : float
        Factor of the displacement. The full displacement is cached with the mesh, so that another
        strength is fast.
    nets : list of Network, optional
        One for each stage; by default the shipped ones.
    bump_size : float
        Bumps up to this width, in mean edge lengths, are removed first.
    keep_creases : float
        Below 0.5 creases are rounded, above 0.5 they are sharpened.
    """
    given = networks() if nets is None else nets
    free = None if weights is None else (weights > LEAST_WEIGHT).astype(np.float64)
    ways = _Ways(given, bump_size, keep_creases)
    key = (free, bump_size, keep_creases, *map(id, given))
    with phase(0.0, 0.9, _MESSAGE):
        moved, normals = kept(mesh, "denoised", key, lambda: _denoised(mesh, free, ways))
    with phase(0.9, 1.0, _MESSAGE):
        moved = strength * moved
        if weights is None or free is None:
            return mended(mesh, normals, moved, None)
        return mended(mesh, normals, weights[:, None] * moved, free == 0)


class _Ways(NamedTuple):
    # The parameters of `learned_displacement` that all stages share.

    nets: list[Network]
    bump_size: float
    keep_creases: float


def _denoised(mesh: TriangleMesh, free: Floats | None, ways: _Ways) -> tuple[Floats, Floats]:
    # Returns the displacement and its target normals; `free` is 0 for vertices that stay, else 1.
    if free is None or free.all():
        return _in_stages(mesh, None, ways)
    rings = _RINGS + ceil(BUMP_REACH * ways.bump_size)
    near = within_rings(mesh.neighbours, free > 0, rings)
    if near.mean() > _LARGEST_PART:
        return _in_stages(mesh, free, ways)
    moved, normals = np.zeros((mesh.vertex_count, 3)), mesh.normals.copy()
    chosen = np.flatnonzero(faces_touching(mesh, near))
    if mesh.areas[chosen].any():
        part, index = part_of(mesh, chosen)
        moved[index], normals[chosen] = _in_stages(part, free[index], ways)
    return moved, normals


def _in_stages(mesh: TriangleMesh, weights: Floats | None, ways: _Ways) -> tuple[Floats, Floats]:
    even = _without_voxels(mesh)
    if even is None:
        return _level_in_stages(mesh, weights, ways)
    even = even if weights is None else weights[:, None] * even
    moved, normals = _level_in_stages(moved_to(mesh, even), weights, ways)
    return even + moved, normals


def _without_voxels(mesh: TriangleMesh) -> Floats | None:
    # The displacement that smooths the steps of voxel surfaces; None if the mesh has no such steps.
    steps = np.empty((mesh.face_count, 2))
    run(_find_steps, mesh.face_count, mesh.scaled_vertices, mesh.faces, mesh.twins, mesh.normals,
        _SQUARE_TOLERANCE, steps)  # fmt: skip
    if not steps.any(axis=0).all():
        return None
    beside = average_to_vertices(mesh, steps).min(axis=1, keepdims=True)
    beside = around = np.minimum(beside / _STEP_SHARE, 1.0)
    for _ in range(3):
        around = average_to_vertices(mesh, average_to_faces(mesh, around))
    share = 2.0 * average_to_vertices(mesh, average_to_faces(mesh, beside))
    share = np.minimum(share, 1.0) * between(around, _STEPPED_RAMP)
    share *= between(np.count_nonzero(share), _STEP_COUNT_RAMP)
    if not share.any():
        return None
    even = np.empty_like(mesh.vertices)
    run(even_out, mesh.vertex_count, *mesh.neighbours, mesh.vertices, even)
    return share * (even - mesh.vertices)


def _level_in_stages(
    mesh: TriangleMesh, weights: Floats | None, ways: _Ways
) -> tuple[Floats, Floats]:
    if ways.bump_size == 0:
        return _mixed_in_stages(mesh, weights, ways)
    with phase(0.0, 0.4, _MESSAGE):
        level = _without_bumps(mesh, weights, ways.bump_size)
    with phase(0.4, 1.0, _MESSAGE):
        moved, normals = _mixed_in_stages(moved_to(mesh, level), weights, ways)
    return level + moved, normals


def _without_bumps(mesh: TriangleMesh, weights: Floats | None, width: float) -> Floats:
    # The displacement that removes bumps. Its fit reaches farther than that for noise.
    with phase(0.0, 0.5, _MESSAGE):
        normals = _allowed(mesh, kept_still(mesh, without_bumps(mesh, width)), weights)
    with phase(0.5, 1.0, _MESSAGE):
        fit = FitSettings(screening_radius=_FIT.screening_radius + BUMP_REACH * width)
        return fitted(mesh, np.zeros((mesh.vertex_count, 3)), normals, weights, BUMP_FITS, fit)


def _mixed_in_stages(
    mesh: TriangleMesh, weights: Floats | None, ways: _Ways
) -> tuple[Floats, Floats]:
    state = _State(mesh, weights)
    ends = np.linspace(0.0, 1.0, len(ways.nets) + 1)
    for stage, network in enumerate(ways.nets):
        last = stage == len(ways.nets) - 1
        with phase(ends[stage], ends[stage + 1], _MESSAGE):
            with phase(0.0, 0.5, _MESSAGE):
                found = state.smoothed()
            with phase(0.5, 0.8, _MESSAGE):
                normals = mixed(network, mesh, found)
            del found
            with phase(0.8, 0.9 if last else 1.0, _MESSAGE):
                state.fit(normals, FITS if last else 1, ways.keep_creases if last else 0.5)
            if last:
                with phase(0.9, 1.0, _MESSAGE):
                    state.sharpen(ways.keep_creases)
        if not state.moved.any():
            break  # the mesh is clean, or no displacement brings normals nearer to their targets
    return _near_turns(mesh, state.moved, state.normals), state.normals


def _near_turns(mesh: TriangleMesh, moved: Floats, normals: Floats) -> Floats:
    # Far from all faces that turn, a fit only takes back most of what the stages before it moved.
    turned = (normals != mesh.normals).any(axis=1)
    if turned.all() or not moved.any():
        return moved
    near = np.zeros(mesh.vertex_count, bool)
    near[mesh.faces[turned]] = True
    return moved * within_rings(mesh.neighbours, near, _RINGS)[:, None]


def found_in_stage(mesh: TriangleMesh, nets: list[Network]) -> Smoothings:
    """Return the smoothed normals after the stages of some networks: inputs to train the next."""
    state = _State(mesh, None)
    found = state.smoothed()
    for network in nets:
        state.fit(mixed(network, mesh, found), 1)
        found = state.smoothed()
    return found


class _State:
    # What one stage hands to the next: the displacement so far, and the normals it was fitted to.

    def __init__(self, mesh: TriangleMesh, weights: Floats | None) -> None:
        self._mesh, self._weights = mesh, weights
        self.normals = mesh.normals
        self._around: Singles | None = None
        self.moved = np.zeros((mesh.vertex_count, 3))

    def smoothed(self) -> Smoothings:
        if self._around is None:
            found = first_smoothings(self._mesh)
            self._around = found.around
            return found
        current = moved_to(self._mesh, self.moved)
        return next_smoothings(current, self._mesh, self.normals, self._around)

    def fit(self, normals: Floats, fits: int, keep_creases: float = 0.5) -> None:
        mesh = self._mesh
        other = None if keep_creases == 0.5 else with_creases(mesh, normals, keep_creases)
        normals = _allowed(mesh, kept_still(mesh, normals, other), self._weights)
        begin = _nearer(mesh, self.moved, normals, _BEGIN_RAMP)
        moved = fitted(mesh, begin, normals, self._weights, fits)
        self.moved, self.normals = _nearer(mesh, moved, normals, _END_RAMP), normals

    def sharpen(self, keep_creases: float) -> None:
        # Sharpens creases, of the faces that turn, as far as the noisy normals agree.
        if keep_creases == 0 or not self.moved.any():
            return
        mesh = self._mesh
        current = moved_to(mesh, self.moved)
        sharp = find_targets(current, GeometrySettings()).normals
        share = min(2.0 * keep_creases, 1.0) * _agreement(current, sharp, mesh.normals)
        share = share if self._weights is None else share * self._weights
        normals = blended_normals(mesh, self.normals, sharp, share)
        still = (self.normals == mesh.normals).all(axis=1)
        normals[still] = mesh.normals[still]
        moved = fitted(mesh, self.moved, normals, self._weights)
        step = _nearer(current, moved - self.moved, mesh.normals, _SHARPER_RAMP)
        self.moved, self.normals = self.moved + step, normals


def _agreement(mesh: TriangleMesh, sharp: Floats, noisy: Floats) -> Floats:
    # The share, for each vertex, of the turn from the denoised to the sharpened normals that fits
    # the noisy ones best around it: least squares with a ridge penalty. Noise shortens the mean of
    # unit normals, so noisy ones are first divided by the length of their mean.
    denoised, turn = mesh.normals, sharp - mesh.normals
    noise = noisy - denoised
    pairs = (noisy, denoised), (noisy, turn), (turn, turn), (noise, noise)
    products = np.stack([np.einsum("fx,fx->f", *pair) for pair in pairs], axis=1)
    around = smooth_vertices(mesh, average_to_vertices(mesh, products), _AGREEMENT_PASSES)
    length, along, turn_square, noise_square = around.T
    fitting = along / np.maximum(length, _SHORTEST_MEAN) + 0.5 * turn_square
    share = fitting / np.maximum(turn_square + _RIDGE * noise_square, 1e-12)
    return np.clip(share, 0.0, 1.0)


def _allowed(mesh: TriangleMesh, normals: Floats, weights: Floats | None) -> Floats:
    # Blends from the mesh's own normals to others by the weights of the vertices.
    return normals if weights is None else blended_normals(mesh, mesh.normals, normals, weights)


def mixed(network: Network, mesh: TriangleMesh, found: Smoothings) -> Floats:
    """Mix the smoothed normals of each face by a network: unit vectors, (m, 3)."""
    normals = np.empty((mesh.face_count, 3))
    for block in blocks(mesh.face_count, _BLOCK):
        rows = np.arange(block.start, block.stop)
        candidates, told = found.told(mesh, rows)
        normals[block] = free_mixture(candidates, network.scores(told))
    return normals


def kept_still(mesh: TriangleMesh, normals: Floats, other: Floats | None = None) -> Floats:
    """Keep a face's own normal, bit for bit, where no face around it turns or noise is impossible.

    Other faces take `normals`, or `other` if given.
    """
    turned = np.empty(mesh.face_count)
    run(_measure_turns, mesh.face_count, mesh.normals, normals, _TURN_RAMP, turned)
    for _ in range(2):
        turned = greatest_to_faces(mesh, greatest_to_vertices(mesh, turned))
    turned *= kept(mesh, "possible noise", (), partial(possible_noise, mesh))
    out = np.empty_like(normals)
    wanted = normals if other is None else other
    run(_take, mesh.face_count, mesh.normals, wanted, turned, out)
    return out


def fitted(
    mesh: TriangleMesh,
    moved: Floats,
    normals: Floats,
    weights: Floats | None,
    fits: int = 1,
    settings: FitSettings = _FIT,
) -> Floats:
    """Fit a mesh to target normals, several times in turn, starting from a displacement: (n, 3).

    If a fit shrinks the mesh to a point, as may happen with few faces, or misses its tolerance, as
    may happen with needle-like faces, the one before is returned.

    Raises
    ------
    SolverError
        If the first fit of all misses its tolerance.
    """
    for fit in range(fits):
        with phase(fit / fits, (fit + 1) / fits, "Fitting the surface"):
            try:
                moved = _fitted_once(mesh, moved, normals, weights, settings)
            except InvalidMesh:
                return moved
            except SolverError:
                if not moved.any():
                    raise
                return moved
    return moved


def _fitted_once(
    mesh: TriangleMesh,
    moved: Floats,
    normals: Floats,
    weights: Floats | None,
    settings: FitSettings,
) -> Floats:
    current = moved_to(mesh, moved)
    even = _untangled(current, normals)
    if even is not None:
        even = even if weights is None else weights[:, None] * even
        moved = moved + even
        current = moved_to(mesh, moved)
    moved = moved + displacement(current, normals, settings, weights)[0]
    moved_to(mesh, moved)  # raises InvalidMesh if the mesh has shrunk to a point
    return moved


def _nearer(
    mesh: TriangleMesh, moved: Floats, normals: Floats, ramp: tuple[float, float]
) -> Floats:
    # Undoes a displacement where it leads away from the target normals: a fit may fail at long thin
    # faces and at close walls, and clean parts need none.
    for _ in range(_UNDO_ROUNDS):
        if not moved.any():
            break
        off = np.empty((mesh.face_count, 2), dtype=np.float32)
        run(_measure_off, mesh.face_count, mesh.scaled_vertices, moved / mesh.mean_edge_length,
            mesh.faces, mesh.normals, normals, off)  # fmt: skip
        around = average_around(mesh, off).astype(np.float64)
        own, new = average_around(mesh, average_to_faces(mesh, around)).T
        share = 1.0 - between(new / (own + _LEAST_DEVIATION), ramp)
        if (share == 1.0).all():
            break
        moved = share[:, None] * moved
    return moved


def moved_to(mesh: TriangleMesh, moved: Floats) -> TriangleMesh:
    """Return the displaced mesh; `mesh` itself if nothing moved."""
    return mesh.moved_to(mesh.vertices + moved) if moved.any() else mesh


def _untangled(mesh: TriangleMesh, normals: Floats) -> Floats | None:
    # The displacement that smooths vertices around turned-over faces; None if there are none.
    over = np.empty((mesh.face_count, 1))
    run(_measure_over, mesh.face_count, mesh.normals, normals, over)
    if not over.any():
        return None
    for _ in range(2):
        over = average_to_faces(mesh, average_to_vertices(mesh, over))
    share = np.minimum(_FLIP_SMOOTHING * average_to_vertices(mesh, over), 1.0)
    places = mesh.vertices
    for _ in range(2):
        even = np.empty_like(places)
        run(even_out, mesh.vertex_count, *mesh.neighbours, places, even)
        places = even
    return share * (places - mesh.vertices)


@kernel
def _half_of_square(places, faces, f, equal):
    # The squared side of the square that a face is half of; 0 if it is no such half.
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    u, v, w = edge(places, a, b), edge(places, b, c), edge(places, c, a)
    p, q, r = dot(u, u), dot(v, v), dot(w, w)
    most, least = max(p, q, r), min(p, q, r)
    other = p + q + r - most - least
    if other - least < equal * other and abs(most - 2.0 * other) < 2.0 * equal * other:
        return other
    return 0.0


@kernel
def _find_steps(start, stop, places, faces, twins, normals, equal, steps):
    # Whether an equal half of a square meets each face at a right angle: below it, and above it.
    for f in range(start, stop):
        steps[f, 0] = steps[f, 1] = 0.0
        own = _half_of_square(places, faces, f, equal)
        for k in range(3):
            if own == 0.0 or twins[f, k] < 0:
                continue
            g, side = twins[f, k] // 3, twins[f, k] % 3
            if abs(dot(normals[f], normals[g])) > equal:
                continue
            other = _half_of_square(places, faces, g, equal)
            if abs(other - own) < 2.0 * equal * own:
                away = edge(places, faces[f, k], faces[g, (side + 2) % 3])
                steps[f, 0 if dot(away, normals[f]) < 0 else 1] = 1.0


@kernel
def _measure_off(start, stop, places, moved, faces, given, wanted, off):
    # Squared distances to the target normals: before a displacement, and after it.
    for f in range(start, stop):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        one, two = edge(places, a, b), edge(places, a, c)
        u, v = edge(moved, a, b), edge(moved, a, c)
        n = cross(
            (one[0] + u[0], one[1] + u[1], one[2] + u[2]),
            (two[0] + v[0], two[1] + v[1], two[2] + v[2]),
        )
        length = max(np.sqrt(dot(n, n)), 1e-300)
        own = new = size = 0.0
        for x in range(3):
            own += (given[f, x] - wanted[f, x]) ** 2
            new += (n[x] / length - wanted[f, x]) ** 2
            size += given[f, x] ** 2
        known = 1.0 if size > 0.5 else 0.0  # a face without area has no normal
        off[f, 0], off[f, 1] = known * own, known * new


@kernel
def _measure_turns(start, stop, old, new, ends, turned):
    for f in range(start, stop):
        square = 0.0
        for x in range(3):
            square += (old[f, x] - new[f, x]) ** 2
        t = (np.degrees(np.sqrt(square)) - ends[0]) / (ends[1] - ends[0])
        turned[f] = min(max(t, 0.0), 1.0)


@kernel
def _take(start, stop, old, new, shares, out):
    for f in range(start, stop):
        s, length = shares[f], 0.0
        for x in range(3):
            out[f, x] = old[f, x] if s == 0 else new[f, x]
        if 0 < s < 1:
            for x in range(3):
                out[f, x] = old[f, x] + s * (new[f, x] - old[f, x])
                length += out[f, x] ** 2
            for x in range(3):
                out[f, x] /= max(np.sqrt(length), 1e-12)


@kernel
def _measure_over(start, stop, own, wanted, over):
    for f in range(start, stop):
        away = dot(own[f], wanted[f])
        over[f, 0] = min(max((_NOT_FLIPPED - away) / (_NOT_FLIPPED - _FLIPPED), 0.0), 1.0)
