# SPDX-License-Identifier: GPL-3.0-or-later
"""Screened Poisson refit of vertex positions to face normals (paper A, section 4.1)."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from ..base.checks import by_keyword, checked_mask, checked_signal
from ..base.memo import kept
from ..base.parallel import kernel, run
from ..base.progress import ProgressCallback, aside, phase, reporting
from ..base.vectors import after, dot, edge
from ..errors import InvalidSignal, SolverError
from ..linear.cg import SolveReport, solve
from ..linear.system import LinearSystem
from ..mesh.adjacency import within_rings
from ..mesh.calculus import (
    average_to_vertices,
    blended_normals,
    corners_of,
    cotangents,
    faces_touching,
    lumped_mass,
    needle_share,
    nonzero_rows,
    stiffness_weights,
)
from ..mesh.triangle_mesh import Floats, TriangleMesh, check_mesh, part_of
from ..settings import (
    BeltramiGeometrySettings,
    FitSettings,
    GeometrySettings,
    given_or_default,
)
from .slide import LOOSE, further_steps, near_turns, unfold

log = logging.getLogger(__name__)

TOLERANCE = 3e-3
"""Residual of the linear solve, relative to its right-hand side (see `SolveReport`)."""

LEAST_MOVE = 1e-6
"""Moves smaller than this, in mean edge lengths, become 0: they are rounding of the solver."""

ROUNDING = 4e-16
"""Sums smaller than this share of the sum of absolute terms count as 0."""

LEAST_WEIGHT = 1e-6
"""Mask weights up to this value count as 0."""

ADVICE = (
    "Repair needle-like faces and vertices with thousands of faces, or try a smaller radius of the"
    " fit."
)
"""What helps where the linear system cannot be solved."""

_TURN = np.radians(5.0)
"""Mean turn of the faces around a vertex at which its screening is reduced by half of `freedom`."""

_RADII = 3.0
"""Reach of a local refit around the faces that turn, in screening radii."""

_MOST_RINGS, _LARGEST_PART = 60, 0.8
"""If that is more than this number of rings, or if the local part has more than this share of all
vertices, the whole mesh is solved for."""

MULTIGRID_RADIUS = 80.0
"""Screening radius, in mean edge lengths, beyond which multigrid is used from the start."""


@by_keyword
def fit_to_normals(
    mesh: TriangleMesh,
    normals: npt.ArrayLike,
    settings: FitSettings | None = None,
    *,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> Floats:
    """Move vertices so that faces turn towards given normals.

    Parameters
    ----------
    mesh : TriangleMesh
    normals : (m, 3) array of float
        Unit target normals, wound as the faces that the mesh was made from. A face's own normal,
        its opposite or a zero vector asks for no change.
    settings : FitSettings, optional
        How far the surface may move as a whole.
    mask : (n,) array of float in [0, 1], optional
        1 moves freely, less moves less, 0 stays bit for bit.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    (n, 3) float64
        New positions in the unit of `mesh.vertices`.

    Raises
    ------
    InvalidSignal
        If normals or mask do not fit the mesh, are not finite, or normals are not unit vectors.
    SolverError
        If the linear system cannot be solved.
    Cancelled
        If `progress` returned False.

    Notes
    -----
    Minimises eps |c - c0|^2 + |grad c - w|^2, where w is grad c0 without its part along the
    target normal N. The projection acts on coordinates: with G the matrix whose rows are the
    gradients of the three coordinates, w = G - N (N^T G). Solved for the displacement, whose
    right-hand side -div(N (N^T G)) is exactly zero for a face's own normal.

    Examples
    --------
    A triangle is turned to face sideways, and its own normal leaves it as it is:

    >>> from shock_filter import core
    >>> mesh = core.TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> turned = core.fit_to_normals(mesh, [[0.6, 0.0, 0.8]], core.FitSettings(screening_radius=50))
    >>> core.TriangleMesh(turned, mesh.faces).normals.round(2).tolist()
    [[0.6, 0.0, 0.8]]
    >>> bool((core.fit_to_normals(mesh, mesh.normals) == mesh.vertices).all())
    True
    """
    check_mesh(mesh)
    settings = given_or_default(settings, FitSettings)
    with reporting(progress):
        targets = checked_signal(normals, mesh.face_count, "array of normals")
        if targets.shape[1] != 3:
            raise InvalidSignal(
                f"Normals have {targets.shape[1]} components; give ({mesh.face_count}, 3)."
            )
        lengths = np.linalg.norm(targets, axis=1)
        if not ((abs(lengths - 1) < 1e-3) | (lengths == 0)).all():
            raise InvalidSignal("Some normals are not unit vectors; divide them by their lengths.")
        weights = checked_mask(mask, mesh.vertex_count)
        moved, _ = displacement(mesh, targets, settings, weights)
        return moved_vertices(mesh, moved)


def moved_vertices(mesh: TriangleMesh, moved: Floats) -> Floats:
    """Add a displacement; coordinates that do not move keep every bit, even the sign of 0."""
    positions = np.empty_like(moved)
    run(_move, mesh.vertex_count, mesh.vertices, moved, positions)
    return positions


def displacement(
    mesh: TriangleMesh,
    normals: Floats,
    settings: FitSettings,
    mask: Floats | None,
    steps: int = 1,
    freedom: float = 0.0,
) -> tuple[Floats, SolveReport]:
    """Solve for the displacement (n, 3), in the unit of `mesh.vertices`; report on the solve.

    With more than one of the `steps`, vertices slide onto creases (see `slide`). `freedom` reduces
    the screening where faces turn: 0 keeps it, 1 removes it at large turns.
    """
    eps = settings.screening_radius**-2
    near = near_turns(mesh, normals) if steps > 1 else None
    if near is None or not near.any():
        near, steps = None, 1  # no step would follow
    try:
        with phase(0.0, 0.2, "Preparing the refit"):
            hold = _hold(mesh, normals, freedom)
            system = kept(
                mesh, "refit", (eps, mask, hold), lambda: _refit_system(mesh, eps, mask, hold)
            )
        rhs = np.zeros((mesh.vertex_count, 3))
        with phase(0.2, 0.3, "Preparing the refit"):
            run(_turning, mesh.vertex_count, mesh.scaled_vertices, mesh.faces, *mesh.corners,
                mesh.normals, mesh.areas, normals, system.fixed, rhs)  # fmt: skip
        multigrid = eps < 0.999 * MULTIGRID_RADIUS**-2
        with phase(0.3, 0.3 + 0.7 / steps, "Fitting the surface"):
            moved, report = solve(
                system,
                rhs,
                TOLERANCE if steps == 1 else LOOSE,
                multigrid=multigrid,
                precise=steps > 1,  # in which the order of vertices would grow from rounding
                message="Fitting the surface",
            )
        if near is not None:
            begin = 0.3 + 0.7 / steps
            far = np.flatnonzero(~near & ~system.fixed).astype(np.int32)
            with phase(begin, 0.9, "Fitting the surface"):
                moved = further_steps(mesh, system, normals, near, moved, steps)
            with phase(0.9, 1.0, "Fitting the surface"):
                _solve_far(system, rhs, far, moved, multigrid)
    except SolverError as error:
        raise SolverError(f"{error.sentence} {ADVICE}", **error.values) from error
    log.info("Refit: %d iterations%s, relative residual %.1e", report.iterations,
             " with multigrid" if report.multigrid else "", report.residual)  # fmt: skip
    with aside("Fitting the surface"):
        run(_to_lengths, mesh.vertex_count, mesh.mean_edge_length, moved)
    return moved, report


def local_displacement(
    mesh: TriangleMesh,
    normals: Floats,
    settings: FitSettings,
    mask: Floats | None,
    steps: int,
    freedom: float,
) -> Floats:
    """Return `displacement`, solved around the faces that are to turn; distant vertices stay.

    A displacement decays by a factor of e per screening radius; beyond `_RADII` of them it is 0.
    """
    rings = math.ceil(_RADII * settings.screening_radius)
    if rings > _MOST_RINGS:
        return displacement(mesh, normals, settings, mask, steps, freedom)[0]
    turned = nonzero_rows(normals != mesh.normals)
    near = within_rings(mesh.neighbours, corners_of(mesh, turned), rings)
    if near.mean() > _LARGEST_PART:
        return displacement(mesh, normals, settings, mask, steps, freedom)[0]
    moved = np.zeros((mesh.vertex_count, 3))
    if near.any():
        chosen = np.flatnonzero(faces_touching(mesh, near))
        part, index = part_of(mesh, chosen)
        free = near[index].astype(np.float64) if mask is None else near[index] * mask[index]
        moved[index], _ = displacement(part, normals[chosen], settings, free, steps, freedom)
    return moved


def _solve_far(
    system: LinearSystem,
    rhs: Floats,
    rows: npt.NDArray[np.int32],
    moved: Floats,
    multigrid: bool,
) -> None:
    # Finishes the loose solve of the first step at the vertices that take no further steps. This
    # comes last: with the first step's minimum beside them, flat sides would bend. Where the
    # residual only stems from the moves of other vertices, a loose solve is enough.
    if len(rows) == 0:
        return
    missing = system.residual(moved, rhs)[rows]
    given, left = float(np.linalg.norm(rhs[rows])), float(np.linalg.norm(missing))
    own = min(given / max(left, 1e-300), 1.0)
    change, _ = solve(
        system.part(rows),
        missing,
        own * TOLERANCE + (1.0 - own) * LOOSE,
        multigrid=multigrid,
        message="Fitting the surface",
    )
    moved[rows] += change


def refitted(
    mesh: TriangleMesh,
    new_normals: Callable[[TriangleMesh], Floats],
    settings: GeometrySettings | BeltramiGeometrySettings,
    weights: Floats | None,
    message: str,
    limit: float = 0.0,
    steps: int = 1,
    freedom: float = 0.0,
    unfolds: bool = False,
    mend: Callable[[TriangleMesh, Floats, Floats], Floats] | None = None,
) -> Floats:
    """Filter the normals of a mesh and fit its positions to them, `settings.repeat` times.

    Parameters
    ----------
    mesh : TriangleMesh
    new_normals : callable
        Returns the filtered normals of the mesh as moved so far: (m, 3).
    settings : GeometrySettings or BeltramiGeometrySettings
    weights : (n,) float64 or None
        1 filters fully, 0 leaves the vertex in place.
    message : str
        What is shown as progress while the normals are filtered.
    limit : float
        The farthest that a vertex may move in total, in mean edge lengths; 0 sets no limit.
    steps, freedom : int, float
        As `fit_steps` and `crease_freedom` in `GeometrySettings`.
    unfolds : bool
        Whether moves that fold faces onto each other are undone; with a limit they always are.
    mend : callable, optional
        Corrects each displacement: takes the mesh before it, the target normals and the
        displacement.

    Returns
    -------
    (n, 3) float64
        The displacement, in the unit of `mesh.vertices`.
    """
    moved, current = np.zeros((0, 3)), mesh
    for iteration in range(settings.repeat):
        with phase(iteration / settings.repeat, (iteration + 1) / settings.repeat, message):
            with phase(0.0, 0.6, message):
                normals = new_normals(current)
            if weights is not None:
                with aside(message):
                    normals = blended_normals(mesh, current.normals, normals, weights)
            last = 1.0 if mend is None else 0.9
            with phase(0.6, last, "Fitting the surface"):
                if mend is None:
                    step, _ = displacement(current, normals, settings, weights, steps, freedom)
                else:
                    step = local_displacement(current, normals, settings, weights, steps, freedom)
            if mend is not None:
                with phase(last, 1.0, "Fitting the surface"):
                    step = mend(current, normals, step)
        moved = step if iteration == 0 else moved + step
        if limit > 0:
            _limit(moved, limit * mesh.mean_edge_length)
        if limit > 0 or unfolds:
            unfold(mesh, moved)
        if iteration + 1 < settings.repeat:
            current = mesh.moved_to(mesh.vertices + moved)
    return moved


def _limit(moved: Floats, most: float) -> None:
    lengths = np.linalg.norm(moved, axis=1)
    far = lengths > most
    moved[far] *= (most / lengths[far])[:, None]


def _refit_system(
    mesh: TriangleMesh, eps: float, mask: Floats | None, hold: Floats | None
) -> LinearSystem:
    # Vertices without area, and those with mask 0, are fixed.
    with phase(0.0, 0.2, "Preparing the refit"):
        screen = eps * lumped_mass(mesh)
        if hold is not None:
            screen *= hold
    fixed = screen == 0
    if mask is not None:
        fixed |= mask <= LEAST_WEIGHT
        np.divide(screen, mask, out=screen, where=~fixed)
        screen[fixed] = 0.0
    with phase(0.2, 0.6, "Preparing the refit"):
        halves = cotangents(mesh)
    with phase(0.6, 1.0, "Preparing the refit"):
        start, columns, weights, diagonal = stiffness_weights(mesh, halves, screen)
    return LinearSystem(start, columns, weights, screen, diagonal, fixed)


def _hold(mesh: TriangleMesh, normals: Floats, freedom: float) -> Floats | None:
    # Factor of the screening at each vertex: smaller where faces are to turn by _TURN or more.
    if freedom == 0:
        return None
    angles = np.empty((mesh.face_count, 1))
    run(_angles, mesh.face_count, mesh.normals, normals, angles)
    hold = average_to_vertices(mesh, angles).reshape(-1)
    run(_held, mesh.vertex_count, freedom, hold)
    return hold


@kernel
def _angles(start, stop, one, other, angles):
    # Angles between two normals; 0 for a target of 0, which asks for no turn.
    for f in range(start, stop):
        cosine = dot(one[f], other[f])
        angles[f, 0] = np.arccos(min(max(cosine, -1.0), 1.0)) if cosine != 0 else 0.0


@kernel
def _held(start, stop, freedom, hold):
    # From mean angles to factors of the screening, in place.
    for v in range(start, stop):
        squared = (hold[v] / _TURN) ** 2
        hold[v] = 1.0 - freedom * squared / (1.0 + squared)


@kernel
def _to_lengths(start, stop, mean_edge_length, moves):
    # From mean edge lengths to the mesh's unit; moves that are only rounding become 0.
    for v in range(start, stop):
        if max(abs(moves[v, 0]), abs(moves[v, 1]), abs(moves[v, 2])) < LEAST_MOVE:
            moves[v] = 0.0
        for x in range(3):
            moves[v, x] *= mean_edge_length


@kernel
def _move(start, stop, vertices, moved, positions):
    for v in range(start, stop):
        for x in range(3):
            positions[v, x] = vertices[v, x]
            if moved[v, x] != 0:
                positions[v, x] += moved[v, x]


@kernel
def _turning(
    start, stop, vertices, faces, corner_start, corners, normals, areas, targets, fixed, rhs
):
    # The right-hand side: minus the integral of <grad(hat function), grad(N . x)> N over each face.
    # The gradient of a hat function times the area is half of normal x opposite edge. Needle-like
    # faces have less weight, as in the matrix.
    for v in range(start, stop):
        if fixed[v]:
            continue
        for i in range(corner_start[v], corner_start[v + 1]):
            f = corners[i] // 3
            k = corners[i] - 3 * f
            nx, ny, nz = normals[f, 0], normals[f, 1], normals[f, 2]
            ex, ey, ez = edge(vertices, faces[f, after(k)], faces[f, after(after(k))])
            tx, ty, tz = targets[f, 0], targets[f, 1], targets[f, 2]
            x1, x2, y1, y2, z1, z2 = ny * ez, nz * ey, nz * ex, nx * ez, nx * ey, ny * ex
            along = 0.5 * (tx * (x1 - x2) + ty * (y1 - y2) + tz * (z1 - z2))
            terms = abs(tx) * (abs(x1) + abs(x2)) + abs(ty) * (abs(y1) + abs(y2))
            terms += abs(tz) * (abs(z1) + abs(z2))
            if abs(along) <= ROUNDING * terms:
                continue  # the face's own normal, up to rounding
            u, w = (
                edge(vertices, faces[f, k], faces[f, after(k)]),
                edge(vertices, faces[f, after(after(k))], faces[f, k]),
            )
            along *= needle_share(u, (ex, ey, ez), w, areas[f])
            rhs[v, 0] -= along * tx
            rhs[v, 1] -= along * ty
            rhs[v, 2] -= along * tz
