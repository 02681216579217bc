# SPDX-License-Identifier: GPL-3.0-or-later
"""Occlusion, bent normals and thickness in a texture, by rays from its texels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..base.checks import by_keyword
from ..base.progress import ProgressCallback, reporting
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import OcclusionSettings, ThicknessSettings, given_or_default
from .traced import traced_image
from .tracing import Sites, checked_occluders, look_around, look_inside, scene_of

_Single = npt.NDArray[np.float32]


@by_keyword
def ambient_occlusion(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    settings: OcclusionSettings | None = None,
    *,
    size: tuple[int, int],
    occluders: Sequence[TriangleMesh] = (),
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
) -> _Single:
    """Draw ambient occlusion into a texture, across seams: the visible share of the sky.

    Parameters
    ----------
    mesh, uv, progress, atlas
        As in `sharpen_texture`.
    settings : OcclusionSettings, optional
    size : (int, int)
        Rows and columns of the image.
    occluders : sequence of TriangleMesh
        Other meshes in the same space that block rays.

    Returns
    -------
    (h, w) float32
        In [0, 1]: 1 where no ray is blocked, 0 where all are; directions are weighted by their
        cosine with the normal. The gutter around the charts is filled; the rest is 0.

    Raises
    ------
    InvalidUV, Cancelled
        As in `sharpen_texture`.
    InvalidSignal
        If an occluder is no mesh.
    InvalidSettings
        If the size cannot be used.

    Notes
    -----
    Rays leave each texel in directions of scrambled Sobol points, different for neighbours, and are
    intersected with triangles by a bounding volume hierarchy. Faces block rays on both sides.
    Normals are smooth across edges of less than 30 degrees, sharp across those of more than 60, and
    blended in between. Noise is smoothed along the surface, but not across edges, see
    `OcclusionSettings.smoothing`: around each place, values are fitted by position and normal
    within several radii, and both halves of the rays show which radius keeps the detail.

    The kernels are part of the core, because libraries for ray tracing have no wheels for some
    platforms of the extension.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]
    >>> floor = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> wall = core.TriangleMesh([[0, -99, 0], [0, 99, 0], [0, 0, 99]], [[0, 1, 2]])
    >>> uv = floor.vertices[floor.faces][..., :2] / 2
    >>> image = core.ambient_occlusion(floor, uv, size=(32, 32), occluders=[wall])
    >>> bool(np.isclose(image[16, 2], 0.5, atol=0.03))  # beside a high wall
    True
    """
    settings = given_or_default(settings, OcclusionSettings)
    others = checked_occluders(occluders)

    def seen(sites: Sites) -> _Single:
        scene = scene_of(mesh, others, settings.ground)
        return look_around(scene, sites, settings.rays, settings.distance)[0]

    with reporting(progress):
        image, _ = traced_image(mesh, uv, size, settings, atlas, seen)
        return np.clip(image[..., 0], 0.0, 1.0)


@by_keyword
def bent_normals(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    settings: OcclusionSettings | None = None,
    *,
    size: tuple[int, int],
    occluders: Sequence[TriangleMesh] = (),
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
) -> _Single:
    """Draw the mean direction of the visible sky into a texture, across seams.

    Parameters
    ----------
    mesh, uv, settings, size, occluders, progress, atlas
        As in `ambient_occlusion`.

    Returns
    -------
    (h, w, 3) float32
        Unit vectors in the mesh's own axes; the normal where nothing can be seen. The gutter
        around the charts is filled; the rest is 0.

    Raises
    ------
    InvalidUV, InvalidSignal, InvalidSettings, Cancelled
        As in `ambient_occlusion`.

    Examples
    --------
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]
    >>> floor = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> wall = core.TriangleMesh([[0, -99, 0], [0, 99, 0], [0, 0, 99]], [[0, 1, 2]])
    >>> uv = floor.vertices[floor.faces][..., :2] / 2
    >>> vectors = core.bent_normals(floor, uv, size=(32, 32), occluders=[wall])
    >>> bool(vectors[16, 2, 0] > 0.4)  # away from the wall
    True
    """
    settings = given_or_default(settings, OcclusionSettings)
    others = checked_occluders(occluders)

    def bent(sites: Sites) -> _Single:
        scene = scene_of(mesh, others, settings.ground)
        return look_around(scene, sites, settings.rays, settings.distance)[1]

    with reporting(progress):
        return _unit(traced_image(mesh, uv, size, settings, atlas, bent)[0])


@by_keyword
def thickness(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    settings: ThicknessSettings | None = None,
    *,
    size: tuple[int, int],
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
) -> _Single:
    """Draw the thickness of the body behind each place of a surface, across seams.

    Parameters
    ----------
    mesh, uv, progress, atlas
        As in `sharpen_texture`.
    settings : ThicknessSettings, optional
    size : (int, int)
        Rows and columns of the image.

    Returns
    -------
    (h, w) float32
        In units of the mesh; or grays in [0, 1], see `ThicknessSettings.look`. The gutter around
        the charts is filled; the rest is 0.

    Raises
    ------
    InvalidUV, InvalidSettings, Cancelled
        As in `ambient_occlusion`.

    Notes
    -----
    It is the mean depth below the surface at which rays into the body, in a cone of 60 degrees
    about the normal, leave it again; so it is exact on plates. Rays that leave nowhere, as under an
    open sheet, count with the largest distance.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> square = np.array([[0.0, 0, 0], [9, 0, 0], [9, 9, 0], [0, 9, 0]])
    >>> faces = [[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]]
    >>> plates = core.TriangleMesh(np.concatenate([square, square - [0, 0, 0.5]]), faces)
    >>> uv = plates.vertices[plates.faces][..., :2] / 18
    >>> uv[2:, :, 0] += 0.5
    >>> image = core.thickness(plates, uv, size=(32, 32))
    >>> bool(np.isclose(image[8, 8], 0.5, atol=1e-3))
    True
    """
    settings = given_or_default(settings, ThicknessSettings)

    def depths(sites: Sites) -> _Single:
        return look_inside(scene_of(mesh), sites, settings.rays, settings.distance)

    with reporting(progress):
        image, used = traced_image(mesh, uv, size, settings, atlas, depths)
        found = np.maximum(image[..., 0], 0.0) * np.float32(mesh.mean_edge_length)
        return shown_thickness(found, used, settings)


def shown_thickness(depths: _Single, atlas: TextureAtlas, settings: ThicknessSettings) -> _Single:
    """Return depths in units of the mesh (h, w) as `ThicknessSettings.look` says."""
    if settings.look == "thickness":
        return depths
    white = settings.white or float(depths.max(initial=0.0, where=atlas.inside))
    return np.clip(depths / np.float32(white or 1.0), 0.0, 1.0)


def _unit(vectors: _Single) -> _Single:
    lengths = np.linalg.norm(vectors, axis=2, keepdims=True)
    return np.where(lengths > 1e-6, vectors / np.maximum(lengths, 1e-6), np.float32(0.0))
