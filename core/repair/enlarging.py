# SPDX-License-Identifier: GPL-3.0-or-later
"""Enlarging of textures, whose charts see across their seams what the surface has there."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..base.checks import LARGEST, by_keyword, checked_count, checked_image
from ..base.progress import ProgressCallback, phase, reporting
from ..color.image_sharpening import sharpen_image
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import DilateSettings, ImageSettings, given_or_default
from ..texture.sharpening import dilate_texture
from ..texture.texels import checked_atlas

_AROUND = 16
"""Texels around the charts that enlarging may read; it reaches less far."""

_MOST = 8

_SAMPLE = 1 << 15
"""Most texels far from charts that are looked at."""


@by_keyword
def enlarge_texture(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    image: npt.ArrayLike,
    settings: DilateSettings | None = None,
    *,
    factor: int = 2,
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
) -> npt.NDArray:
    """Enlarge a texture; its charts see across UV seams what the surface has there.

    Texture coordinates stay as they are.

    Parameters
    ----------
    mesh, uv, image, progress, atlas
        As in `sharpen_texture`.
    settings : DilateSettings, optional
        The gutter is in texels of the new size.
    factor : int
        From 1 to 8; 1 only fills the gutter.

    Returns
    -------
    (factor * h, factor * w) or (factor * h, factor * w, c) array
        Of the type of the image.

    Raises
    ------
    InvalidUV, InvalidSignal, InvalidSettings, Cancelled
        As in `sharpen_texture`, and if the factor is no whole number from 1 to 8.

    Notes
    -----
    The gutter is filled from across the seams, but for what is painted in texels that charts cover
    in part; the picture is enlarged as `sharpen_image` does, and
    the gutter is filled anew at the new size.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = mesh.vertices[mesh.faces][..., :2]
    >>> ramp = np.tile(np.linspace(0.0, 1.0, 16, dtype=np.float32), (16, 1))
    >>> core.enlarge_texture(mesh, uv, ramp, factor=3).shape
    (48, 48)
    """
    given = checked_image(image, LARGEST)
    settings = given_or_default(settings, DilateSettings)
    times = checked_count(factor, "factor", 1, _MOST)
    pixels = given.reshape(*given.shape[:2], -1)
    around = DilateSettings(gutter=_AROUND, background="nearest", seams=settings.seams)
    with reporting(progress):
        with phase(0.0, 0.2, "Filling the gutter"):
            atlas = checked_atlas(atlas, mesh, uv, pixels)
            wide = dilate_texture(mesh, uv, given, around, atlas=atlas)
            painted = _painted_beside(atlas, pixels)
            wide.reshape(pixels.shape)[painted] = pixels[painted]
        with phase(0.2, 0.8, "Enlarging"):
            large = wide if times == 1 else sharpen_image(wide, ImageSettings(enlarge=times))
        with phase(0.8, 1.0, "Filling the gutter"):
            return dilate_texture(mesh, uv, large, settings)


def _painted_beside(atlas: TextureAtlas, pixels: npt.NDArray) -> npt.NDArray[np.bool_]:
    # Texels that charts cover in part and that hold something: not what most texels far from all
    # charts do. Little of a narrow chart is covered wholly; the rest is known from these.
    masks = atlas.masks()
    beside = masks.active & ~atlas.inside
    far = pixels[~masks.active]
    if len(far) == 0:
        return beside
    far = far[:: -(-len(far) // _SAMPLE)]
    colors, counts = np.unique(far, axis=0, return_counts=True)
    if 2 * counts.max() < len(far):
        return beside
    return beside & (pixels != colors[counts.argmax()]).any(axis=2)
