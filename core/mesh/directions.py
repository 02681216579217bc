# SPDX-License-Identifier: GPL-3.0-or-later
"""Line fields on a mesh, for example for streaks: directions whose sign does not matter.

They are averaged as tensors d d^T, which are equal for d and -d.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import Floats, as_array, by_keyword, checked_count, checked_flag, checked_word
from ..base.progress import ProgressCallback, ask, phase, reporting
from ..errors import InvalidSettings, InvalidSignal
from .calculus import average_to_vertices, gradient, mean_normals, smooth_vertices, unit_vectors
from .triangle_mesh import TriangleMesh, check_mesh

_LITTLE = 1e-12

PLACES = ("faces", "vertices")
"""Where vectors can be."""

_MOST_PASSES = 100_000


@by_keyword
def principal_directions(
    mesh: TriangleMesh,
    *,
    which: str = "least",
    passes: int = 8,
    progress: ProgressCallback | None = None,
) -> Floats:
    """Find the directions in which a surface bends least or most.

    Parameters
    ----------
    mesh : TriangleMesh
    which : {"least", "most"}
        "least" runs along a limb, "most" around it.
    passes : int
        Smoothing passes of the curvature: 0 keeps all detail, 50 only large shapes.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    (n, 3) float64
        Tangent vectors at the vertices. The length is the anisotropy of the curvature: 1 on a
        cylinder, 0 on a plane or a sphere, where it is equal in all directions.

    Raises
    ------
    InvalidSettings
        If `which` is another word, or `passes` is not a whole number from 0 to 100,000.
    Cancelled
        If `progress` returned False.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> x, y = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9), indexing="ij")
    >>> vertices = np.stack([x, y, np.sqrt(2 - x * x)], axis=-1).reshape(-1, 3)
    >>> a = np.arange(72).reshape(8, 9)[:, :8].reshape(-1)
    >>> faces = np.concatenate([np.stack([a, a + 9, a + 10], 1), np.stack([a, a + 10, a + 1], 1)])
    >>> directions = core.principal_directions(core.TriangleMesh(vertices, faces))
    >>> bool(abs(directions[40, 1]) > 0.9)
    True
    """
    check_mesh(mesh)
    checked_word(which, "which", ("least", "most"))
    passes = checked_count(passes, "passes", most=_MOST_PASSES)
    with reporting(progress), phase(0.0, 1.0, "Finding directions"):
        one, two, a, b, c = _curvature_tensors(mesh, passes)
        ask()
        # The principal curvature of larger magnitude has the sign of the mean curvature.
        angle = 0.5 * np.arctan2(2.0 * b, a - c)
        angle += 0.5 * np.pi * ((a + c < 0) != (which == "least"))
        apart, mean = np.hypot(a - c, 2.0 * b), np.abs(a + c)
        largest = 0.5 * (apart + mean)
        clear = np.minimum(apart, mean) / np.maximum(largest, _LITTLE)
        return clear[:, None] * (np.cos(angle)[:, None] * one + np.sin(angle)[:, None] * two)


@by_keyword
def gradient_directions(
    mesh: TriangleMesh, signal: npt.ArrayLike, *, turned: bool = False
) -> Floats:
    """Find the direction in which a signal rises in each face, or that of its level lines.

    Parameters
    ----------
    mesh : TriangleMesh
    signal : (n,) or (m, 3) array of float
        At the vertices, or at the corners of the faces that the mesh was made from.
    turned : bool
        Rotate by a right angle: along level lines.

    Returns
    -------
    (m, 3) float64
        Unit vectors, 0 where the signal is constant or not finite, as a distance is where no path
        leads.

    Raises
    ------
    InvalidSignal
        If the signal does not fit the mesh.

    Examples
    --------
    >>> from shock_filter import core
    >>> mesh = core.TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> core.gradient_directions(mesh, [0, 2, 0]).round(3).tolist()
    [[1.0, 0.0, -0.0]]
    """
    check_mesh(mesh)
    values = as_array(signal, "signal")
    if values.dtype.kind not in "biuf" or values.shape not in (
        (mesh.vertex_count,),
        (mesh.face_count, 3),
    ):
        raise InvalidSignal(
            f"The signal has the shape {values.shape}; give ({mesh.vertex_count},) or"
            f" ({mesh.face_count}, 3) numbers."
        )
    corners = values[mesh.faces] if values.ndim == 1 else mesh.own_corners(values)
    corners = corners.astype(np.float64)
    corners[~np.isfinite(corners).all(axis=1)] = 0.0
    corners = 0.5 * corners - 0.5 * corners[:, :1]  # which is finite
    corners /= np.maximum(np.abs(corners).max(axis=1, keepdims=True), 1e-300)
    places = mesh.scaled_vertices[mesh.faces]
    sides = np.roll(places, 1, axis=1) - np.roll(places, -1, axis=1)
    along = np.einsum("fk,fkx->fx", corners, sides)  # along level lines
    return unit_vectors(along if checked_flag(turned, "turned") else np.cross(mesh.normals, along))


@by_keyword
def axis_directions(mesh: TriangleMesh, axis: npt.ArrayLike, *, turned: bool = False) -> Floats:
    """Project a direction in space onto each face, optionally rotated by a right angle.

    Parameters
    ----------
    mesh : TriangleMesh
    axis : (3,) array of float
    turned : bool
        Rotate by a right angle: around the axis.

    Returns
    -------
    (m, 3) float64
        Unit vectors, 0 where the axis is perpendicular to the face.

    Raises
    ------
    InvalidSignal
        If the axis is not three finite numbers, or all are 0.

    Examples
    --------
    >>> from shock_filter import core
    >>> mesh = core.TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> core.axis_directions(mesh, [1, 0, 1], turned=True).tolist()
    [[0.0, 1.0, 0.0]]
    """
    check_mesh(mesh)
    given = as_array(axis, "axis")
    if given.shape != (3,) or given.dtype.kind not in "iuf" or not np.isfinite(given).all():
        raise InvalidSignal(f"The axis is {axis!r}; give three numbers.")
    if not given.any():
        raise InvalidSignal("The axis has no length; give another one.")
    wanted = given.astype(np.float64)
    wanted /= np.abs(wanted).max()
    around = np.cross(mesh.normals, wanted)
    return unit_vectors(
        around if checked_flag(turned, "turned") else np.cross(around, mesh.normals)
    )


def named_directions(mesh: TriangleMesh, way: str) -> tuple[Floats, str]:
    """Find the directions of a name in `registry.WAYS`.

    Returns
    -------
    (n, 3) or (m, 3) float64
    {"vertices", "faces"}
        Where the directions are.

    Raises
    ------
    InvalidSettings
        If there is no such word.
    """
    if way in ("flat", "bending"):
        which = "least" if way == "flat" else "most"
        return principal_directions(mesh, which=which), "vertices"
    if way.removeprefix("around_") not in ("x", "y", "z"):
        raise InvalidSettings(f"There is no way {way!r}; give one such as flat, x or around_z.")
    axis = np.eye(3)["xyz".index(way[-1])]
    return axis_directions(mesh, axis, turned=way.startswith("around_")), "faces"


def at_corners(mesh: TriangleMesh, vectors: Floats, at: str | None, what: str) -> Floats:
    """Return vectors of faces or vertices as vectors at the corners of faces.

    Parameters
    ----------
    mesh : TriangleMesh
    vectors : (m, 3) or (n, 3) float64
    at : {"faces", "vertices"} or None
        Where the vectors are; with None their number tells.
    what : str
        Subject and verb of messages about their shape, such as "field has".

    Returns
    -------
    (m, 1, 3) or (m, 3, 3) float64
        One vector for all corners of a face, or one for each.

    Raises
    ------
    InvalidSettings
        If `at` is another word.
    InvalidSignal
        If their number does not fit, or fits both and `at` is None.
    """
    check_mesh(mesh)
    counts = {"faces": mesh.face_count, "vertices": mesh.vertex_count}
    if at is not None:
        checked_word(at, "at", PLACES)
    fitting = [
        place
        for place, count in counts.items()
        if at in (None, place) and vectors.shape == (count, 3)
    ]
    if not fitting:
        wanted = " or ".join(f"({counts[place]}, 3)" for place in ([at] if at else counts))
        raise InvalidSignal(f"The {what} the shape {vectors.shape}; give {wanted}.")
    if len(fitting) > 1:
        raise InvalidSignal(
            "The mesh has as many faces as vertices, and vectors can be at either; say which by"
            " at='faces' or at='vertices'."
        )
    return vectors[:, None] if fitting == ["faces"] else vectors[mesh.faces]


def face_tensors(mesh: TriangleMesh, directions: Floats) -> Floats:
    """Average directions as tensors in the frame of each face.

    Parameters
    ----------
    mesh : TriangleMesh
    directions : (m, k, 3) float64
        At the corners, as `at_corners` returns them.

    Returns
    -------
    (m, 3) float64
        The entries 11, 12 and 22 of the symmetric tensor: axis 1 runs along the edge from corner 0
        to corner 1, axis 2 towards corner 2.
    """
    corners = mesh.vertices[mesh.faces]
    one = unit_vectors(corners[:, 1] - corners[:, 0])
    two = np.cross(mesh.normals, one)
    tensors = np.zeros((mesh.face_count, 3))
    for given in directions.swapaxes(0, 1):
        u, v = _dots(given, one), _dots(given, two)
        tensors += np.stack([u * u, u * v, v * v], axis=1) / directions.shape[1]
    return tensors


def _curvature_tensors(
    mesh: TriangleMesh, passes: int
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    # Two tangents at each vertex, and the entries 11, 12 and 22 of the smoothed shape operator in
    # their frame, per mean edge length.
    normals = unit_vectors(mean_normals(mesh))
    # The shape operator of each face, in its plane.
    change = _tangential(mesh.normals, gradient(mesh, normals))
    ask()
    rows = 0.5 * (change + change.transpose(0, 2, 1)).reshape(-1, 9)
    rows = smooth_vertices(mesh, average_to_vertices(mesh, rows), passes)
    one, two = _frames(normals)
    return one, two, *_in_frames(one, two, rows.reshape(-1, 3, 3))


def _dots(one: Floats, other: Floats) -> Floats:
    return np.einsum("ix,ix->i", one, other)


def _tangential(normals: Floats, change: Floats) -> Floats:
    # Removes the normal components on both sides of matrices (k, 3, 3).
    keep = np.eye(3) - normals[:, :, None] * normals[:, None]
    return keep @ change @ keep


def _frames(normals: Floats) -> tuple[Floats, Floats]:
    # Two unit vectors at right angles to each other and to the normal.
    off = np.zeros_like(normals)
    off[np.arange(len(normals)), np.argmin(np.abs(normals), axis=1)] = 1.0
    one = unit_vectors(np.cross(normals, off))
    return one, np.cross(normals, one)


def _in_frames(one: Floats, two: Floats, tensors: Floats) -> tuple[Floats, Floats, Floats]:
    first, second = np.einsum("ixy,iy->ix", tensors, one), np.einsum("ixy,iy->ix", tensors, two)
    return _dots(one, first), _dots(one, second), _dots(two, second)
