# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpens meshes: normals flow to the creases, and positions follow (paper A, 4.1)."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from ..base.checks import by_keyword, checked_mask
from ..base.findings import Finding, gathering, tell
from ..base.memo import kept
from ..base.progress import ProgressCallback, phase, reporting
from ..flow.potential import flow_from_potential
from ..mesh.order import in_good_order, is_scattered, sorted_along_curve
from ..mesh.triangle_mesh import Floats, TriangleMesh, check_mesh
from ..settings import GeometrySettings, given_or_default
from .advected import advected_normals, signal_and_potential
from .creases import find_targets, tell_creases
from .fit import LEAST_WEIGHT, moved_vertices, refitted
from .folds import mended, undone
from .results import tell_lost, without_drift, without_worse
from .sides import consistent_normals, turned_zone


@by_keyword
def sharpen_normals(
    mesh: TriangleMesh,
    settings: GeometrySettings | None = None,
    *,
    progress: ProgressCallback | None = None,
) -> Floats:
    """Sharpen the face normals of a mesh (paper A, section 4.1).

    Parameters
    ----------
    mesh : TriangleMesh
    settings : GeometrySettings, optional
        The settings of the refit, `amount`, `max_displacement` and `repeat` are not used.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    (m, 3) float64
        Unit normals, wound as the faces that the mesh was made from; zero for faces without area.
        With `where` "everywhere", a time of 0 returns the (mollified) normals up to rounding,
        except with linear sampling, which always smooths. With "creases", normals may turn even at
        a time of 0.

    Raises
    ------
    Cancelled
        If `progress` returned False.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> faces = [half for q in quads for half in (q[:3], [q[0], q[2], q[3]])]
    >>> cube = core.TriangleMesh(corners, faces)
    >>> normals = core.sharpen_normals(cube, core.GeometrySettings(time=1.0))
    >>> normals.shape, bool(np.allclose(np.linalg.norm(normals, axis=1), 1.0))
    ((12, 3), True)
    """
    check_mesh(mesh)
    settings = given_or_default(settings, GeometrySettings)
    with reporting(progress):
        if is_scattered(mesh):
            ordered, _, face_order = kept(mesh, "order", (), lambda: sorted_along_curve(mesh))
            sharpened = _sharpened(ordered, settings)
            sharpened[ordered.flipped] *= -1
            normals = np.empty_like(sharpened)
            normals[face_order] = sharpened
        else:
            normals = _sharpened(mesh, settings)
        normals[mesh.flipped] *= -1
    return normals


@by_keyword
def sharpen_geometry(
    mesh: TriangleMesh,
    settings: GeometrySettings | None = None,
    *,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> Floats:
    """Sharpen a mesh: advect its normals towards its creases and refit positions to them.

    Parameters
    ----------
    mesh : TriangleMesh
    settings : GeometrySettings, optional
    mask : (n,) array of float in [0, 1], optional
        1 sharpens fully, less sharpens less, 0 leaves the vertex in place bit for bit.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    (n, 3) float64
        New positions in the unit of `mesh.vertices`. An amount of 0 returns the old ones bit for
        bit, and so does a time of 0 (unless `mollify_passes` asks for smoother normals).

    Raises
    ------
    InvalidSignal
        If the mask does not fit the mesh or leaves [0, 1].
    InvalidMesh
        If repeating shrinks the mesh to a point or a line.
    SolverError
        If the refit's linear system cannot be solved.
    Cancelled
        If `progress` returned False.

    Notes
    -----
    Paper A, section 4.1. Beyond the paper: detail sampling (see `advect_faces`), the feature
    threshold (see `flow.potential.above_surroundings`), masks, repeating, the displacement limit,
    the screening radius in place of a fixed epsilon (see `fit_to_normals`), and, by default,
    creases only (see `shape.creases`), aligned (see `shape.sides`), further steps of the refit (see
    `shape.slide`) and the repair of folds (see `shape.folds`); `GeometrySettings.of_paper` leaves
    these four out.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> faces = [half for q in quads for half in (q[:3], [q[0], q[2], q[3]])]
    >>> cube = core.TriangleMesh(corners, faces)
    >>> core.sharpen_geometry(cube, core.GeometrySettings(time=16.0)).shape
    (8, 3)
    >>> still = core.sharpen_geometry(cube, core.GeometrySettings(time=0.0))
    >>> bool((still == corners).all())
    True
    """
    check_mesh(mesh)
    settings = given_or_default(settings, GeometrySettings)
    weights = checked_mask(mask, mesh.vertex_count)
    if settings.is_neutral:
        return mesh.vertices.copy()
    with reporting(progress):
        # The result for an amount of 1 is cached for other amounts, with its findings.
        key = replace(settings, amount=1.0), weights
        moved, findings = kept(mesh, "moved", key, lambda: _displacement(mesh, *key))
        for finding in findings:
            tell(finding.sentence, **finding.values)
        if settings.amount < 1:
            moved = settings.amount * moved
            if settings.where == "creases":
                undone(mesh, mesh.normals, moved)  # faces may fold halfway that are flat at the end
        with phase(1.0, 1.0, "Fitting the surface"):
            return moved_vertices(mesh, moved)


@by_keyword
def geometry_flow(
    mesh: TriangleMesh,
    settings: GeometrySettings | None = None,
    *,
    progress: ProgressCallback | None = None,
) -> tuple[Floats, Floats]:
    """Compute the flow along which `sharpen_geometry` moves the normals of a mesh.

    Parameters
    ----------
    mesh : TriangleMesh
    settings : GeometrySettings, optional
        Only `smoothing_passes`, `mollify_passes`, `feature_threshold` and `time` are used. The
        longer the time, the wider the surroundings that the threshold compares with.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    potential : (n,) float64
        At the vertices: the squared bending of the surface, in squared radians per squared mean
        edge length; with a feature threshold, only what exceeds that of the surroundings.
    flow : (m, 3) float64
        At the faces: half the gradient of the potential, a tangent vector in mean edge lengths per
        unit of time. Normals move along it, towards the creases.

    Raises
    ------
    Cancelled
        If `progress` returned False.

    See Also
    --------
    flow_field : The same for colors and other signals.

    Examples
    --------
    A flat triangle has nothing to flow to:

    >>> from shock_filter import core
    >>> mesh = core.TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> potential, flow = core.geometry_flow(mesh)
    >>> potential.tolist(), flow.tolist()
    ([0.0, 0.0, 0.0], [[0.0, 0.0, 0.0]])
    """
    check_mesh(mesh)
    settings = given_or_default(settings, GeometrySettings)
    with reporting(progress):
        with phase(0.0, 0.9, "Computing the flow"):
            _, _, potential = signal_and_potential(mesh, settings)
        with phase(0.9, 1.0, "Computing the flow"):
            return potential.copy(), flow_from_potential(mesh, potential)


def _displacement(
    mesh: TriangleMesh, settings: GeometrySettings, weights: Floats | None
) -> tuple[Floats, list[Finding]]:
    with gathering() as findings:
        moved = in_good_order(mesh, partial(_displace, settings), weights)
    return moved, findings


def _displace(settings: GeometrySettings, mesh: TriangleMesh, weights: Floats | None) -> Floats:
    def sharpen(current: TriangleMesh) -> Floats:
        return _sharpened(current, settings)

    if settings.where == "everywhere":
        with phase(0.0, 1.0, "Sharpening"):
            return refitted(mesh, sharpen, settings, weights, "Sharpening",
                            settings.max_displacement, settings.fit_steps,
                            settings.crease_freedom, settings.fit_steps > 1)  # fmt: skip
    with phase(0.0, 0.5, "Finding creases"):
        creases = find_targets(mesh, settings)
    if weights is None:
        tell_creases(mesh, creases, None)
    elif weights.any():
        tell_creases(mesh, creases, (weights[mesh.faces] > 0).any(axis=1))
    if not (creases.shares > 0).any():
        return np.zeros((mesh.vertex_count, 3))
    fixed = None if weights is None else weights <= LEAST_WEIGHT
    lost: list[Floats] = []

    def mend(current: TriangleMesh, targets: Floats, moved: Floats) -> Floats:
        moved = mended(current, targets, without_drift(current, moved, fixed), fixed)
        moved, gone = without_worse(current, targets, moved)
        lost.append(gone)
        return undone(current, targets, moved) if gone.any() else moved

    with phase(0.5, 1.0, "Sharpening"):
        moved = refitted(mesh, sharpen, settings, weights, "Sharpening", settings.max_displacement,
                         settings.fit_steps, settings.crease_freedom, mend=mend)  # fmt: skip
    tell_lost(mesh, lost[0])
    return moved


def _sharpened(mesh: TriangleMesh, settings: GeometrySettings) -> Floats:
    if settings.where == "everywhere":
        return _aligned(mesh, settings)
    with phase(0.0, 1.0, "Finding creases"):  # for the first repeat they are cached
        return find_targets(mesh, settings).normals.copy()


def _aligned(mesh: TriangleMesh, settings: GeometrySettings) -> Floats:
    # Advected normals; where they have turned, each face is assigned to one side of the crease.
    normals = advected_normals(mesh, settings)
    if settings.align_passes == 0:
        return normals
    zone = turned_zone(mesh, mesh.normals, normals)
    return consistent_normals(mesh, normals, zone, settings.align_passes)
