# SPDX-License-Identifier: GPL-3.0-or-later
"""Curvatures of a surface at its vertices, from cubics fitted around them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..base.checks import Floats, by_keyword
from ..base.progress import ProgressCallback, ask, phase, reporting
from ..errors import InvalidSettings
from .jets import Frames, fitted, radii_of
from .triangle_mesh import TriangleMesh, check_mesh

_FINDING = "Finding curvature"

_LEAST = 1e-300


class Curvatures(NamedTuple):
    """Curvatures at the vertices of a mesh.

    Attributes
    ----------
    principal : (n, 2) float64
        The lesser and the greater principal curvature, in 1 / unit of the mesh. Convex shapes with
        outward normals have positive curvatures.
    directions : (n, 2, 3) float64
        Tangent unit vectors along which the surface bends with these curvatures, at right angles
        to each other. Their signs do not matter; where both curvatures are equal, the vectors are
        arbitrary.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> found = core.Curvatures(np.array([[1.0, 3.0]]), np.eye(3)[None, :2])
    >>> found.mean.tolist(), found.gaussian.tolist()
    ([2.0], [3.0])
    """

    principal: Floats
    directions: Floats

    @property
    def mean(self) -> Floats:
        """The mean curvature, half the sum of the principal ones: (n,)."""
        return 0.5 * self.principal.sum(axis=1)

    @property
    def gaussian(self) -> Floats:
        """The Gaussian curvature, the product of the principal ones: (n,)."""
        return self.principal.prod(axis=1)


@by_keyword
def curvature(
    mesh: TriangleMesh, *, radius: float = 0.0, progress: ProgressCallback | None = None
) -> Curvatures:
    """Compute principal curvatures and their directions at the vertices.

    Parameters
    ----------
    mesh : TriangleMesh
    radius : float
        Radius of the neighbourhood to which the surface is fitted, in units of the mesh. Larger
        ones even out noise and take longer, with its square. 0 is automatic: 2.5 times the length
        of the edges nearby. No radius is less than what reaches over the one-ring.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    Curvatures
        ``principal`` (n, 2), ``directions`` (n, 2, 3), ``mean`` and ``gaussian`` (n,), float64, in
        1 / unit of the mesh (Gaussian: its square). Convex is positive: 1 / r on a sphere of
        radius r, 0 on a plane. Vertices without faces have 0.

    Raises
    ------
    InvalidSettings
        If the radius is negative or no number.
    Cancelled
        If `progress` returned False.

    Notes
    -----
    A cubic height function is fitted around each vertex in the least-squares sense, after Cazals
    and Pouget (2005), "Estimating differential quantities using polynomial fitting of osculating
    jets"; the error falls with the square of the radius. Weights by distance, area and normals
    vary smoothly, so that triangles do not show, and each side of a crease keeps its own curvature.
    At a vertex on a crease both sides count, and the curvature is about the angle by the radius.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> x, y = np.meshgrid(np.linspace(-1, 1, 33), np.linspace(-1, 1, 33), indexing="ij")
    >>> vertices = np.stack([x, y, np.sqrt(4 - x * x)], axis=-1).reshape(-1, 3)
    >>> a = np.arange(32 * 33).reshape(32, 33)[:, :32].reshape(-1)
    >>> faces = np.concatenate([np.stack([a, a + 33, a + 34], 1), np.stack([a, a + 34, a + 1], 1)])
    >>> found = core.curvature(core.TriangleMesh(vertices, faces))
    >>> bool(np.allclose(found.principal[16 * 33 + 16], [0, 0.5], atol=1e-3))  # a cylinder
    True
    """
    check_mesh(mesh)
    radius = checked_radius(radius)
    with reporting(progress), phase(0.0, 1.0, _FINDING):
        return curvatures_of(mesh, Frames(mesh), radii_of(mesh, radius))


def curvatures_of(mesh: TriangleMesh, frames: Frames, radii: Floats) -> Curvatures:
    """Compute `curvature` with frames and radii that are known."""
    terms = fitted(mesh, frames, radii, np.zeros((mesh.vertex_count, 0)))[..., 0]
    ask()
    a, b = terms[:, 1], terms[:, 2]
    # Second derivatives of the height; it falls away from the normal where the shape is convex.
    c, d, e = -2.0 * terms[:, 3], -terms[:, 4], -2.0 * terms[:, 5]
    square = 1.0 + a * a + b * b
    mean = ((1 + b * b) * c - 2 * a * b * d + (1 + a * a) * e) / (2.0 * square**1.5)
    product = (c * e - d * d) / square**2
    half = np.sqrt(np.maximum(mean * mean - product, 0.0))
    principal = np.stack([mean - half, mean + half], axis=1)
    # Directions solve (II - k I) v = 0 with the second and the first fundamental form.
    length = np.sqrt(square)
    k = principal[:, 1]
    rows = np.stack(
        [
            np.stack([c / length - k * (1 + a * a), d / length - k * a * b], axis=1),
            np.stack([d / length - k * a * b, e / length - k * (1 + b * b)], axis=1),
        ],
        axis=1,
    )
    longer = (np.abs(rows[:, 1]).sum(axis=1) > np.abs(rows[:, 0]).sum(axis=1)).astype(np.intp)
    row = rows[np.arange(len(rows)), longer]
    u, v = -row[:, 1], row[:, 0]
    flat = np.hypot(u, v) <= _LEAST
    u = np.where(flat, 1.0, u)
    tangents = [frames.one + a[:, None] * frames.normal, frames.two + b[:, None] * frames.normal]
    most = _unit(u[:, None] * tangents[0] + v[:, None] * tangents[1])
    least = np.cross(_unit(np.cross(tangents[0], tangents[1])), most)
    return Curvatures(principal / mesh.mean_edge_length, np.stack([least, most], axis=1))


def checked_radius(radius: object) -> float:
    """Return a radius from 0, or raise `InvalidSettings`."""
    is_number = isinstance(radius, (int, float, np.integer, np.floating))
    if not is_number or isinstance(radius, bool) or not 0 <= radius < np.inf:  # type: ignore[operator]
        raise InvalidSettings(f"radius is {radius!r}; give a length, or 0 for an automatic one.")
    return float(radius)  # type: ignore[arg-type]


def _unit(vectors: Floats) -> Floats:
    scaled = vectors / np.maximum(np.abs(vectors).max(axis=1, keepdims=True), _LEAST)
    return scaled / np.maximum(np.linalg.norm(scaled, axis=1, keepdims=True), _LEAST)
