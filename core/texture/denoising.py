# SPDX-License-Identifier: GPL-3.0-or-later
"""Smoothing of textures on the surface, across seams, that keeps edges (paper C)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..base.checks import LARGEST, by_keyword, checked_image, checked_weights
from ..base.progress import ProgressCallback, aside, phase, reporting
from ..beltrami.texel_smoothing import smooth_texels_once
from ..color.image_smoothing import with_beta
from ..grid.pixels import copied
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import BeltramiTextureSettings, given_or_default
from .texels import (
    Texture,
    checked_atlas,
    checked_content,
    gathered,
    mix_texels,
    read_ghosts,
    written,
)


@by_keyword
def beltrami_texture(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    image: npt.ArrayLike,
    settings: BeltramiTextureSettings | None = None,
    *,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
) -> npt.NDArray:
    """Smooth a texture by the short-time Beltrami kernel, which keeps edges and crosses seams.

    Each texel becomes a weighted mean of those around it on the surface. Weights are Gaussians of
    the distance in space and colors together, so texels beyond an edge have little weight.

    Parameters
    ----------
    mesh : TriangleMesh
        Vertices that seams have split should be welded first (see `core.weld_borders`).
    uv : (m, 3, 2) array of float
        Texture coordinates of the corners of the faces that the mesh was made from.
    image : (h, w) or (h, w, c) array of uint8, uint16, float32 or float64
        Row 0 is at v = 0. Whole numbers are scaled to [0, 1]; floats may go beyond.
    settings : BeltramiTextureSettings, optional
    mask : (h, w) array of float in [0, 1], optional
        1 smooths fully, less mixes with the input, 0 keeps it bit for bit. It acts inside the
        charts.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.
    atlas : TextureAtlas, optional
        The atlas of the same mesh, coordinates and image size, which saves computing it; `uv` is
        then ignored.

    Returns
    -------
    array like `image`
        Inside the charts, each value is within the range of the input near it on the surface, up
        to rounding to single precision; opacity stays. The gutter around them is filled with the
        colors across the seam; at closed seams, the chart's own colors are extended. A time of 0
        returns the input bit for bit.

    Raises
    ------
    InvalidUV
        If the texture coordinates cannot be used; see `TextureAtlas`.
    InvalidSignal
        If the image's shape or type is not supported, it holds NaN or infinity, or the mask does
        not fit it.
    Cancelled
        If `progress` returned False.

    Notes
    -----
    Paper C, equations 20 to 23, and beta by the noise, as in `beltrami_image`, on the texels of
    paper B, section 3.
    As for the paper's images painted on manifolds, distances are those between texels in space,
    with colors as further coordinates. Their unit is different: lengths in space are measured in
    local texels, because noise is as wide as these. So the kernel follows the shape of stretched
    texels, and small texels count as much as large ones. A chart is extended across its seams
    (`core.atlas.patches`); each texel there has the value of the nearest one of the other chart.
    Across stretched texels kernels reach at most three times as many texels as in squares.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = mesh.vertices[mesh.faces][..., :2]
    >>> step = np.where(np.arange(16) < 8, 0.2, 0.8) * np.ones((12, 1))
    >>> noisy = step + 0.05 * np.random.default_rng(0).normal(size=step.shape)
    >>> smooth = core.beltrami_texture(mesh, uv, noisy, core.BeltramiTextureSettings(beta=15))
    >>> bool(abs(smooth - step).mean() < 0.4 * abs(noisy - step).mean())
    True
    """
    given = checked_image(image, LARGEST)
    settings = given_or_default(settings, BeltramiTextureSettings)
    pixels = given.reshape(*given.shape[:2], -1)
    weights = checked_weights(mask, given)
    alpha, normals = checked_content(pixels, settings)
    with reporting(progress):
        with phase(0.0, 0.3, "Finding texels"):
            texture = Texture(checked_atlas(atlas, mesh, uv, pixels), pixels, alpha, normals)
        if settings.time == 0:
            return given.copy()
        with phase(0.3, 0.9, "Smoothing"):
            with aside("Smoothing"):
                settings = with_beta(settings, pixels, texture.atlas.inside)
            texture, values = gathered(texture, settings)
            values = _smoothed(texture, values, settings, weights)
        with phase(0.9, 1.0, "Filling the gutter"):
            keep = None if weights is None else weights == 0
            return written(texture, values, settings, keep).reshape(given.shape)


def _smoothed(
    texture: Texture,
    values: npt.NDArray[np.float32],
    settings: BeltramiTextureSettings,
    weights: npt.NDArray[np.float64] | None,
) -> npt.NDArray[np.float32]:
    # The new values of the nodes inside charts.
    atlas, _, alpha, normals = texture[:4]
    with aside("Smoothing"):
        old, new = values, copied(values)
    for i in range(settings.iterations):
        with phase(i / settings.iterations, (i + 1) / settings.iterations, "Smoothing"):
            if i > 0:
                old, new = new, copied(new) if old is values and weights is not None else old
            with aside("Smoothing"):
                read_ghosts(texture, old)
            smooth_texels_once(atlas, old, settings, new, alpha=alpha, normals=normals)
    mix_texels(atlas, values, 1.0, weights, new)
    return new
