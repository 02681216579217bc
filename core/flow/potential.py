# SPDX-License-Identifier: GPL-3.0-or-later
"""The potential and the flow field of a signal (paper A, sections 3.2, 3.3 and Appendix A)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import by_keyword, checked_signal
from ..base.memo import kept
from ..base.parallel import kernel, run
from ..base.progress import ProgressCallback, aside, phase, reporting
from ..base.vectors import dot, edge
from ..mesh.calculus import average_to_vertices, gradient, mean_normals, smooth_vertices
from ..mesh.triangle_mesh import Floats, TriangleMesh, check_mesh
from ..settings import ShockSettings, given_or_default


@by_keyword
def flow_field(
    mesh: TriangleMesh,
    signal: npt.ArrayLike,
    settings: ShockSettings | None = None,
    *,
    progress: ProgressCallback | None = None,
) -> tuple[Floats, Floats]:
    """Compute the flow that pulls a signal's values together.

    The potential is P = sum over channels of the squared gradient; the flow is half its
    gradient and points towards the edges of the signal.

    Parameters
    ----------
    mesh : TriangleMesh
    signal : (n,) or (n, d) array of float
        Values at the vertices; all channels share one flow.
    settings : ShockSettings, optional
        Only `smoothing_passes` is used; 0 disables smoothing.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    potential : (n,) float64
        P at the vertices, in squared signal units per squared mean edge length.
    flow : (m, 3) float64
        u at the faces, a tangent vector in mean edge lengths per unit of time.

    Raises
    ------
    InvalidSignal
        If the signal does not fit the mesh or is not finite.
    Cancelled
        If `progress` returned False.

    Notes
    -----
    u = grad(P) / 2 as in section 3.2; Appendix A leaves out the half, which only scales time.

    Examples
    --------
    Along a soft step, P is largest in the middle, and the flow points there:

    >>> import numpy as np
    >>> from shock_filter import core
    >>> x, y = np.mgrid[:9, :9]
    >>> vertices = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    >>> first = (9 * x + y)[:-1, :-1].reshape(-1, 1)
    >>> faces = np.concatenate([first + [0, 9, 10], first + [0, 10, 1]])
    >>> mesh = core.TriangleMesh(vertices, faces)
    >>> colors = 1 / (1 + np.exp(4.0 - vertices[:, :1]))
    >>> potential, flow = core.flow_field(mesh, colors)
    >>> potential.shape, flow.shape
    ((81,), (128, 3))
    >>> int(vertices[potential.argmax(), 0])
    4
    """
    check_mesh(mesh)
    settings = given_or_default(settings, ShockSettings)
    with reporting(progress):
        values = checked_signal(signal, mesh.vertex_count)
        with phase(0.0, 0.9, "Computing the flow"):
            potential = flow_potential(mesh, values, settings.smoothing_passes)
        with phase(0.9, 1.0, "Computing the flow"):
            return potential, flow_from_potential(mesh, potential)


def flow_from_potential(mesh: TriangleMesh, potential: Floats) -> Floats:
    """Compute the flow u, half the potential's gradient: (n,) -> (m, 3)."""
    flow = gradient(mesh, potential)[:, 0]
    flow *= 0.5
    return flow


def flow_potential(mesh: TriangleMesh, signal: Floats, passes: int) -> Floats:
    """Compute the potential P, smoothed before and after: (n, d) -> (n,)."""
    message = "Computing the flow"
    with phase(0.0, 0.5, message):
        smooth = smooth_vertices(mesh, signal, passes)
    energy = np.empty((mesh.face_count, 1))
    with phase(0.5, 0.6, message):
        run(_energy, mesh.face_count, mesh.scaled_vertices, mesh.faces, mesh.areas, smooth, energy)
    with phase(0.6, 0.7, message):
        potential = average_to_vertices(mesh, energy)
    with phase(0.7, 1.0, message):
        return smooth_vertices(mesh, potential, passes).reshape(-1)


def bending(mesh: TriangleMesh, passes: int) -> tuple[Floats, Floats]:
    """Vertex averages of the normals, (n, 3), and their potential, (n,); kept for the next run."""

    def compute() -> tuple[Floats, Floats]:
        with phase(0.0, 0.2, "Computing the flow"):
            signal = mean_normals(mesh)
        with phase(0.2, 1.0, "Computing the flow"):
            return signal, flow_potential(mesh, signal, passes)

    return kept(mesh, "bending", (passes,), compute)


def above_surroundings(
    mesh: TriangleMesh,
    potential: Floats,
    threshold: float,
    time: float,
) -> Floats:
    """Keep the part of a potential that stands out from its surroundings.

    Not in the paper, which facets gently curved surfaces with coarse triangles: there the flow
    follows the noise of the mesh. With s = sqrt(P), this returns max(0, s - threshold b)^2, where
    b is the level around a vertex: the morphological opening of s over a few rings, which removes
    peaks and ridges and keeps plateaus, smoothed. Flow-lines end where s falls to threshold times
    that level.

    Parameters
    ----------
    mesh : TriangleMesh
    potential : (n,) float64
    threshold : float
        0 returns the potential unchanged.
    time : float
        Flow time. The width of the features that it can pull together grows with its fourth root
        (P falls with the square of the width, and the flow is its gradient); so does the number of
        rings, from 2 at times up to 256 to 8 at most.

    Returns
    -------
    (n,) float64
    """
    if threshold == 0:
        return potential
    rings = round(min(max(time**0.25 / 2, 2.0), 8.0))
    strength = np.sqrt(potential)
    level = opening(mesh, strength, rings)
    with phase(1.0, 1.0, "Finding features"):
        level = smooth_vertices(mesh, level.reshape(-1, 1), 2).reshape(-1)
    return np.maximum(strength - threshold * level, 0.0) ** 2


def opening(mesh: TriangleMesh, values: Floats, rings: int) -> Floats:
    """Morphological opening of vertex values: removes ridges narrower than 2 * rings."""
    return dilation(mesh, -dilation(mesh, -values, rings), rings)


def dilation(mesh: TriangleMesh, values: Floats, rings: int) -> Floats:
    """Maximum within a number of rings around each vertex: (n,) -> (n,)."""
    message = "Finding features"
    with aside(message):
        start, ring = mesh.neighbours
    ring = ring.view(np.uint32)  # spares a test for negative indices
    for step in range(rings):
        out = np.empty_like(values)
        with phase(step / rings, (step + 1) / rings, message):
            run(_ring_maximum, mesh.vertex_count, start, ring, values, out)
        values = out
    return values


@kernel
def _ring_maximum(start, stop, ring_start, ring, values, out):
    # The maximum of a vertex and its one-ring.
    for v in range(start, stop):
        greatest = values[v]
        for i in range(ring_start[v], ring_start[v + 1]):
            greatest = max(greatest, values[ring[i]])
        out[v] = greatest


@kernel
def _energy(start, stop, vertices, faces, areas, values, energy):
    for f in range(start, stop):
        energy[f, 0] = squared_gradient(f, vertices, faces, areas, values)


@kernel
def squared_gradient(f, vertices, faces, areas, values):
    """Sum of the squared gradients of all channels in a face."""
    # From differences along two edges and their metric.
    total = 0.0
    if areas[f] > 0:
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        u, v = edge(vertices, a, b), edge(vertices, a, c)
        uu, uv, vv = dot(u, u), dot(u, v), dot(v, v)
        for j in range(values.shape[1]):
            p = values[b, j] - values[a, j]
            q = values[c, j] - values[a, j]
            total += p * p * vv - 2 * p * q * uv + q * q * uu
        total /= 4 * areas[f] * areas[f]
    return max(total, 0.0)
