# SPDX-License-Identifier: GPL-3.0-or-later
"""Normal maps from tangent space to object space and back.

In object space, normals are vectors like others: what filters and stitches textures across seams
does so with normals, whichever way the charts lie.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.sheet import ROWS, shares_of_corners
from ..base.checks import Floats, as_array, checked_image
from ..base.parallel import kernel, run
from ..base.progress import ProgressCallback, phase, reporting
from ..errors import InvalidSignal
from ..mesh.tangents import tangent_frames
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import DilateSettings
from .texels import Texture, checked_atlas, gathered, written


def object_normals(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    image: npt.ArrayLike,
    normals: npt.ArrayLike | None = None,
    settings: DilateSettings | None = None,
    progress: ProgressCallback | None = None,
    *,
    atlas: TextureAtlas | None = None,
) -> npt.NDArray:
    """Turn a tangent-space normal map into an object-space one.

    Filtered there as any texture, for example by `filter_texture` or `stitch_textures`, and
    turned back by `tangent_normals`, it has no steps at seams.

    Parameters
    ----------
    mesh, uv, progress, atlas
        As in `sharpen_texture`.
    image : (h, w, 3) or (h, w, 4) array of uint8, uint16, float32 or float64
        Normals as colors, row 0 at v = 0. Green grows with v, as in Blender and OpenGL. A fourth
        channel stays.
    normals : (m, 3, 3) array of float, optional
        The mesh's normals at the corners of its faces, as it is shaded. Left out, smooth ones.
    settings : DilateSettings, optional
        Of the gutter.

    Returns
    -------
    array like `image`
        Unit vectors as colors: 0.5 plus half the component.

    Raises
    ------
    InvalidUV, Cancelled
        As in `sharpen_texture`.
    InvalidSignal
        If image or normals do not fit.

    Notes
    -----
    The frames are those of MikkTSpace (Mikkelsen 2008), which Blender bakes and shades with.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = mesh.vertices[mesh.faces][..., 1:]
    >>> straight = np.tile([0.5, 0.5, 1.0], (4, 4, 1))
    >>> core.object_normals(mesh, uv, straight)[2, 2].round(6).tolist()
    [1.0, 0.5, 0.5]
    """
    return _converted(_to_object, mesh, uv, image, normals, settings, progress, atlas)


def tangent_normals(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    image: npt.ArrayLike,
    normals: npt.ArrayLike | None = None,
    settings: DilateSettings | None = None,
    progress: ProgressCallback | None = None,
    *,
    atlas: TextureAtlas | None = None,
) -> npt.NDArray:
    """Turn an object-space normal map into a tangent-space one; the inverse of `object_normals`.

    Parameters
    ----------
    mesh, uv, image, normals, settings, progress, atlas
        As in `object_normals`. The vectors need not be of unit length.

    Returns
    -------
    array like `image`
        Unit vectors as colors.

    Raises
    ------
    InvalidUV, InvalidSignal, Cancelled
        As in `object_normals`.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = mesh.vertices[mesh.faces][..., 1:]
    >>> along_x = np.tile([1.0, 0.5, 0.5], (4, 4, 1))
    >>> core.tangent_normals(mesh, uv, along_x)[2, 2].round(6).tolist()
    [0.5, 0.5, 1.0]
    """
    return _converted(_to_tangent, mesh, uv, image, normals, settings, progress, atlas)


def _converted(
    convert: Callable[..., None],
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    image: npt.ArrayLike,
    normals: npt.ArrayLike | None,
    settings: DilateSettings | None,
    progress: ProgressCallback | None,
    atlas: TextureAtlas | None,
) -> npt.NDArray:
    pixels = checked_image(image)
    if pixels.ndim != 3 or pixels.shape[2] not in (3, 4):
        raise InvalidSignal(
            f"The normal map has the shape {pixels.shape}; give three channels, or four."
        )
    given = _checked_normals(mesh, normals)
    settings = settings or DilateSettings()
    is_tangent = convert is _to_object
    with reporting(progress):
        with phase(0.0, 0.6, "Finding texels"):
            fitting = checked_atlas(atlas, mesh, uv, pixels)
            texture = Texture(fitting, pixels, normals=is_tangent)
            texture, values = gathered(texture, settings)
        with phase(0.6, 0.8, "Turning normals"):
            frames = tangent_frames(mesh, _corner_uv(fitting), given)
            sheet = fitting.sheet
            run(convert, len(values), sheet.nodes, sheet.points, frames, values, chunk=ROWS)
        with phase(0.8, 1.0, "Filling the gutter"):
            return written(texture._replace(normals=not is_tangent), values, settings, None)


def _corner_uv(atlas: TextureAtlas) -> Floats:
    # Coordinates as the charts have them, in texels: they are scaled, but not turned.
    row, column = np.moveaxis(atlas.charts.points, -1, 0)
    return np.stack([column / atlas.width, row / atlas.height], axis=-1)


def _checked_normals(mesh: TriangleMesh, normals: npt.ArrayLike | None) -> Floats | None:
    if normals is None:
        return None
    given = as_array(normals, "normals")
    if given.shape != (mesh.face_count, 3, 3) or given.dtype.kind not in "fiu":
        raise InvalidSignal(
            f"The normals have the shape {given.shape}; give ({mesh.face_count}, 3, 3) numbers."
        )
    length = np.linalg.norm(given.astype(np.float64), axis=2, keepdims=True)
    if not np.isfinite(length).all() or not length.all():
        raise InvalidSignal("A normal is NaN, infinite or zero; give unit vectors.")
    return mesh.own_corners(given / length)


@kernel
def _axes_at(points, frames, f, y, x, axes):
    # The rows become tangent, bitangent and normal, interpolated.
    shares = shares_of_corners(points, f, y, x)
    axes[:] = 0.0
    for k in range(3):
        for i in range(3):
            axes[0, i] += shares[k] * frames.tangents[f, k, i]
            axes[2, i] += shares[k] * frames.normals[f, k, i]
    _cross(axes[2], axes[0], axes[1])
    for i in range(3):
        axes[1, i] *= frames.signs[f]


@kernel
def _cross(u, v, out):
    out[0] = u[1] * v[2] - u[2] * v[1]
    out[1] = u[2] * v[0] - u[0] * v[2]
    out[2] = u[0] * v[1] - u[1] * v[0]


@kernel
def _store(vector, turned, color):
    # A unit vector as a color; one of no length stays what it was.
    length = np.sqrt(turned[0] ** 2 + turned[1] ** 2 + turned[2] ** 2)
    if not length > 1e-12:
        turned[:] = vector
        length = max(np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2), 1e-12)
    for i in range(3):
        color[i] = 0.5 + 0.5 * turned[i] / length


@kernel
def _to_object(start, stop, nodes, points, frames, values):
    axes, vector, turned = np.empty((3, 3)), np.empty(3), np.empty(3)
    for y in range(start, stop):
        for x in range(nodes.shape[1]):
            if nodes[y, x] < 0:
                continue
            _axes_at(points, frames, nodes[y, x], y, x, axes)
            for i in range(3):
                vector[i] = 2.0 * values[y, x, i] - 1.0
            for i in range(3):
                turned[i] = vector[0] * axes[0, i] + vector[1] * axes[1, i] + vector[2] * axes[2, i]
            _store(vector, turned, values[y, x])


@kernel
def _to_tangent(start, stop, nodes, points, frames, values):
    axes, vector, turned = np.empty((3, 3)), np.empty(3), np.empty(3)
    across = np.empty((3, 3))
    for y in range(start, stop):
        for x in range(nodes.shape[1]):
            if nodes[y, x] < 0:
                continue
            _axes_at(points, frames, nodes[y, x], y, x, axes)
            for i in range(3):
                vector[i] = 2.0 * values[y, x, i] - 1.0
            # Cramer's rule, but for the determinant, whose sign alone counts.
            for k in range(3):
                _cross(axes[(k + 1) % 3], axes[(k + 2) % 3], across[k])
            det = axes[0, 0] * across[0, 0] + axes[0, 1] * across[0, 1] + axes[0, 2] * across[0, 2]
            sign = 1.0 if det >= 0 else -1.0
            for k in range(3):
                turned[k] = sign * (
                    across[k, 0] * vector[0] + across[k, 1] * vector[1] + across[k, 2] * vector[2]
                )
            _store(vector, turned, values[y, x])
