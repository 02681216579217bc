# SPDX-License-Identifier: GPL-3.0-or-later
"""Normal maps from tangent space to object space and back.

In object space, normals are ordinary vectors: the filters work on them across seams, whatever the
orientation of the charts.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.normal_frames import NormalFrames
from ..base.checks import LARGEST, Floats, as_array, by_keyword, checked_image
from ..base.progress import ProgressCallback, phase, reporting
from ..errors import InvalidSignal
from ..mesh.triangle_mesh import TriangleMesh, check_mesh
from ..settings import DilateSettings, given_or_default
from .texels import Texture, check_channels, checked_atlas, gathered, written


@by_keyword
def object_normals(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    image: npt.ArrayLike,
    settings: DilateSettings | None = None,
    *,
    normals: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
) -> npt.NDArray:
    """Turn a tangent-space normal map into an object-space one.

    The result has no steps at seams. It can be filtered like any texture, for example by
    `filter_texture` or `stitch_textures`, and converted back by `tangent_normals`.

    Parameters
    ----------
    mesh, uv, progress, atlas
        As in `sharpen_texture`.
    image : (h, w, 3) or (h, w, 4) array of uint8, uint16, float32 or float64
        Normals as colors, row 0 at v = 0. Green grows with v, as in Blender and OpenGL. A fourth
        channel stays.
    normals : (m, 3, 3) array of float, optional
        The mesh's shading normals at the corners of its faces. Default: smooth normals.
    settings : DilateSettings, optional
        Settings of the gutter.

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
    return _converted(True, mesh, uv, image, normals, settings, progress, atlas)


@by_keyword
def tangent_normals(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    image: npt.ArrayLike,
    settings: DilateSettings | None = None,
    *,
    normals: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
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
    return _converted(False, mesh, uv, image, normals, settings, progress, atlas)


def checked_normals(mesh: TriangleMesh, normals: npt.ArrayLike | None) -> Floats | None:
    """Return normals at the corners of a mesh's faces as unit vectors; raises `InvalidSignal`."""
    check_mesh(mesh)
    if normals is None:
        return None
    given = as_array(normals, "normals")
    if given.shape != (mesh.face_count, 3, 3) or given.dtype.kind not in "fiu":
        raise InvalidSignal(
            f"The normals have the shape {given.shape}; give ({mesh.face_count}, 3, 3) numbers."
        )
    vectors = given.astype(np.float64)
    largest = np.abs(vectors).max(axis=2, keepdims=True)
    if not np.isfinite(largest).all() or not largest.all():
        raise InvalidSignal("A normal is NaN, infinite or zero; give unit vectors.")
    vectors /= largest
    return mesh.own_corners(vectors / np.linalg.norm(vectors, axis=2, keepdims=True))


def _converted(
    to_object: bool,
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    image: npt.ArrayLike,
    normals: npt.ArrayLike | None,
    settings: DilateSettings | None,
    progress: ProgressCallback | None,
    atlas: TextureAtlas | None,
) -> npt.NDArray:
    pixels = checked_image(image, LARGEST)
    check_channels(pixels)
    given = checked_normals(mesh, normals)
    settings = given_or_default(settings, DilateSettings)
    with reporting(progress):
        with phase(0.0, 0.6, "Finding texels"):
            texture = Texture(checked_atlas(atlas, mesh, uv, pixels), pixels)
            frames = NormalFrames(texture.atlas, given)
        with phase(0.6, 0.8, "Turning normals"):
            if to_object:
                texture, values = gathered(texture._replace(frames=frames), settings)
                texture = texture._replace(frames=None)
            else:
                texture, values = gathered(texture, settings)
                texture = texture._replace(frames=frames)
        with phase(0.8, 1.0, "Filling the gutter"):
            return written(texture._replace(unit=True, made=True), values, settings, None)
