# SPDX-License-Identifier: GPL-3.0-or-later
"""Enlarging of textures, with values from across UV seams beside the charts."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..base.checks import LARGEST, SCALES, by_keyword, checked_image
from ..base.progress import ProgressCallback, phase, reporting
from ..color.image_sharpening import sharpen_image
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import EnlargeSettings, ImageSettings, given_or_default
from ..texture.texels import Texture, checked_atlas, checked_content, gathered, written
from .smoothest import share_of_first

Singles = npt.NDArray[np.float32]

_AROUND = 16
"""Width of the gutter, in texels, that is filled before; enlarging reads less far."""

_SAMPLE = 1 << 15
"""Number of texels away from charts, about, from which the background is measured."""

_NOISE_QUANTILE = 0.75
"""Quantile of their differences from the median that counts as the noise of the background."""

_NOISE_RAMP = 0.02, 0.06
"""Ramp of that noise, for white = 1: below the first value there is a plain background, above the
second there is none."""

_DIFFERENCE_RAMP = 1 / 255, 6 / 255
"""Ramp of the difference between a texel and the background, minus twice the noise: below the first
value the texel is background, above the second it is painted."""


@by_keyword
def enlarge_texture(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    image: npt.ArrayLike,
    settings: EnlargeSettings | None = None,
    *,
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
) -> npt.NDArray:
    """Enlarge a texture, with values from across UV seams beside the charts.

    Texture coordinates stay as they are.

    Parameters
    ----------
    mesh, uv, image, progress, atlas
        As in `sharpen_texture`.
    settings : EnlargeSettings, optional
        The gutter is in texels of the new size. A factor of 1 only fills the gutter.

    Returns
    -------
    (factor * h, factor * w) or (factor * h, factor * w, c) array
        An image of the same type. Normals have unit length.

    Raises
    ------
    InvalidUV, InvalidSignal, InvalidSettings, Cancelled
        As in `sharpen_texture`.

    Notes
    -----
    The gutter is filled from across the seams, except where texels that charts cover in part are
    painted, and beside seams where different materials meet. The picture is enlarged as by
    `sharpen_image`, and the gutter is filled anew at the new size. The unchanged picture is
    enlarged too, and at each texel the result that is smoother across seams has more weight: where
    an earlier reduction has mixed the background into the rims of charts, these are only restored
    with the background beside them.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = mesh.vertices[mesh.faces][..., :2]
    >>> ramp = np.tile(np.linspace(0.0, 1.0, 16, dtype=np.float32), (16, 1))
    >>> core.enlarge_texture(mesh, uv, ramp, core.EnlargeSettings(factor=3)).shape
    (48, 48)
    """
    given = checked_image(image, LARGEST)
    settings = given_or_default(settings, EnlargeSettings)
    times = settings.factor
    pixels = given.reshape(*given.shape[:2], -1)
    alpha, normals = checked_content(pixels, settings)
    with reporting(progress):
        with phase(0.0, 0.2, "Filling the gutter"):
            texture = Texture(checked_atlas(atlas, mesh, uv, pixels), pixels, alpha, normals)
            larger = texture.atlas
            if times > 1:
                larger = TextureAtlas(mesh, uv, size=(times * larger.height, times * larger.width))
            wide = _widened(texture, settings)
        with phase(0.2, 0.8, "Enlarging"):
            large = wide if times == 1 else _enlarged(texture, wide, larger, settings)
        with phase(0.8, 1.0, "Filling the gutter"):
            texture, values = gathered(Texture(larger, large, alpha, normals), settings)
            # Interpolated normals are shorter, so they are written anew with unit length.
            keep = None if normals and times > 1 else texture.atlas.inside
            result = written(texture, values, settings, keep)
    return result.reshape(*result.shape[:2], *given.shape[2:])


def _widened(texture: Texture, settings: EnlargeSettings) -> npt.NDArray:
    # The image with a filled gutter, for enlarging.
    pixels = texture.pixels
    around = settings.changed(gutter=_AROUND, background="nearest")
    settled, values = gathered(texture, around)
    wide = written(settled, values.copy(), around, texture.atlas.inside)
    painted = _painted(texture.atlas, pixels)[..., None]
    beside = texture.atlas.masks().active
    if painted.any() and settings.seams == "auto":
        # Where materials meet, painted texels are better than copies of the nearest color.
        own = around.changed(seams="extend")
        alone = written(gathered(texture, own)[0], values, own, texture.atlas.inside)
        beside = beside | (wide == alone).all(axis=2)
    mixed = wide + painted * (pixels.astype(np.float32) - wide)
    if wide.dtype.kind == "u":
        mixed = np.rint(mixed)
    np.copyto(wide, mixed.astype(wide.dtype), where=(painted > 0) & beside[..., None])
    np.copyto(wide, pixels, where=(painted == 1) & beside[..., None])
    return wide


def _enlarged(
    texture: Texture, wide: npt.NDArray, larger: TextureAtlas, settings: EnlargeSettings
) -> npt.NDArray:
    # Enlarges the image with and without a filled gutter, and mixes the results by their smoothness
    # across seams.
    how = ImageSettings(enlarge=settings.factor, alpha=settings.alpha)
    if (wide == texture.pixels).all():
        return sharpen_image(wide, how)
    with phase(0.0, 0.45, "Enlarging"):
        large = sharpen_image(wide, how)
    with phase(0.45, 0.9, "Enlarging"):
        alone = sharpen_image(texture.pixels, how)
    with phase(0.9, 1.0, "Comparing the seams"):
        settled, _ = gathered(texture._replace(atlas=larger, pixels=large), settings)
        shares = share_of_first(settled, alone, large)[..., None]
        mixed = large + shares * (alone.astype(np.float32) - large)
        if large.dtype.kind == "u":
            mixed = np.rint(mixed)
        return np.where(shares > 0, mixed.astype(large.dtype), large)


def _painted(atlas: TextureAtlas, pixels: npt.NDArray) -> Singles:
    # How surely texels beside the charts are painted: those that differ from a plain background, as
    # measured away from all charts. They matter for narrow charts, which cover few texels wholly.
    active = atlas.masks().active
    beside = ~atlas.inside
    far = pixels[~active]
    if len(far) == 0:
        return beside.astype(np.float32)
    scale = np.float32(SCALES[pixels.dtype.name])
    far = far[:: -(-len(far) // _SAMPLE)] * scale
    background = np.median(far, axis=0)
    noise = float(np.quantile(np.abs(far - background).max(axis=1), _NOISE_QUANTILE))
    plain = 1.0 - _rise(np.asarray(noise), _NOISE_RAMP)
    away = np.abs(pixels * scale - background).max(axis=2)
    differs = _rise(away - 2.0 * noise, _DIFFERENCE_RAMP)
    return np.where(beside, plain * differs + (1.0 - plain) * active, 0.0).astype(np.float32)


def _rise(values: npt.NDArray, ends: tuple[float, float]) -> npt.NDArray:
    return ((values - ends[0]) / (ends[1] - ends[0])).clip(0.0, 1.0)
