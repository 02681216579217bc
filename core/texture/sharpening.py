# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening of textures on the surface, across seams (paper A, section 4; paper B, section 3)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.ghosts import fill_ghosts
from ..atlas.seams import settle_seams
from ..base.checks import LARGEST, by_keyword, checked_image, checked_weights
from ..base.progress import ProgressCallback, aside, phase, reporting
from ..color.by_width.domain import flow_for_time
from ..color.guides import checked_guide
from ..color.image_steps import LARGEST as LARGEST_BY_WIDTH
from ..color.learned.report import tell_opacity
from ..errors import InvalidSignal
from ..grid.channels import channel_groups, opacity_channel, with_opacity
from ..grid.pixels import copied
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import DilateSettings, TextureSettings, given_or_default
from .sheet_domain import SheetDomain
from .texel_planes import Surface
from .texels import (
    Texture,
    checked_atlas,
    checked_content,
    gathered,
    least_step,
    mix_texels,
    read_ghosts,
    values_of,
    written,
)
from .textures_by_width import follow_texels_by_width, nodes_inside, sharpen_texels_by_width
from .textures_learned import are_learned, sharpen_texels_learned


@by_keyword
def sharpen_texture(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    image: npt.ArrayLike,
    settings: TextureSettings | None = None,
    *,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
    guide: npt.ArrayLike | None = None,
) -> npt.NDArray:
    """Sharpen a texture on its surface: values flow towards the edges, and across seams.

    Parameters
    ----------
    mesh : TriangleMesh
        Vertices that seams have split should be welded first (see `core.weld_borders`).
    uv : (m, 3, 2) array of float
        Texture coordinates of the corners of the faces that the mesh was made from.
    image : (h, w) or (h, w, c) array of uint8, uint16, float32 or float64
        Row 0 is at v = 0. Whole numbers are scaled to [0, 1]; floats may go beyond.
    settings : TextureSettings, optional
        Times are for lengths in mean texel sizes on the surface.
    mask : (h, w) array of float in [0, 1], optional
        1 sharpens fully, less mixes with the input, 0 keeps it bit for bit. It acts inside the
        charts; `TextureAtlas.bake` makes one from weights of vertices or faces.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.
    atlas : TextureAtlas, optional
        The atlas of the same mesh, coordinates and image size, which saves computing it; `uv` is
        then ignored.
    guide : (h, w) or (h, w, c) array, optional
        Another texture of the same size and layout, whose flow moves the values instead of their
        own; see `sharpen_image`. Seams are closed where either of them differs.

    Returns
    -------
    array like `image`
        Inside the charts, each value is within the range of the input near it on the surface, up
        to rounding to single precision. Opacity is sharpened by itself; with a time or a guide it
        is not sharpened. The gutter around the charts is filled with the colors across the seam; at
        closed seams, the chart's own colors are extended. A time of 0 returns the input bit for
        bit.

    Raises
    ------
    InvalidUV
        If the texture coordinates cannot be used; see `TextureAtlas`.
    InvalidSignal
        If the image's shape or type is not supported, it holds NaN or infinity, mask or guide do
        not fit it, or channels of normals are not coupled.
    InvalidSettings
        If the settings do not allow a guide.
    Cancelled
        If `progress` returned False.

    Notes
    -----
    Paper A, sections 3.2, 3.3 and Appendix A, on the texels of paper B, section 3. Paper B merges
    basis functions at seams; here charts are extended by ghost texels that read across the seam.
    Besides the atlas, the image and the result, each node of the sheet needs 12 bytes, and 8 more
    for each channel; the learned recipe (`core.texture.textures_learned`), which is the default,
    needs about 300 for three channels.

    Examples
    --------
    A soft edge on a square of two faces gets steeper:

    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = mesh.vertices[mesh.faces][..., :2]
    >>> image = np.tile(0.5 + 0.5 * np.tanh(np.linspace(-4, 4, 32)), (32, 1))
    >>> sharp = core.sharpen_texture(mesh, uv, image, core.TextureSettings(time=1024.0))
    >>> [round(float(np.diff(rows[16]).max()), 1) for rows in (image, sharp)]
    [0.1, 0.3]
    """
    settings = given_or_default(settings, TextureSettings)
    given = checked_image(image, LARGEST_BY_WIDTH if settings.by_width else LARGEST)
    pixels = given.reshape(*given.shape[:2], -1)
    weights = checked_weights(mask, given)
    alpha, normals = checked_content(pixels, settings)
    if normals and settings.channels != "coupled":
        raise InvalidSignal(
            f"A texture of normals needs channels 'coupled'; these are {settings.channels!r}."
        )
    lead = checked_guide(None if guide is None else checked_image(guide, LARGEST), given, settings)
    with reporting(progress):
        with phase(0.0, 0.3, "Finding texels"):
            texture = Texture(checked_atlas(atlas, mesh, uv, pixels), pixels, alpha, normals)
        if settings.is_neutral:
            return given.copy()
        with phase(0.3, 0.9, "Sharpening"):
            if lead is None:
                texture, values = gathered(texture, settings)
                learned = are_learned(settings, normals)
                texture = texture._replace(opacity_stays=not learned)
                values = _sharpened(texture, values, settings, weights)
            else:
                texture, values, leading = _gathered_with(texture, lead, settings)
                values = _following(texture, values, leading, settings, weights)
        with phase(0.9, 1.0, "Filling the gutter"):
            keep = None if weights is None else weights == 0
            return written(texture, values, settings, keep).reshape(given.shape)


@by_keyword
def dilate_texture(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    image: npt.ArrayLike,
    settings: DilateSettings | None = None,
    *,
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
) -> npt.NDArray:
    """Fill the gutter of a texture with the colors across the seams.

    Texels whose centres lie in charts stay bit for bit. Each other texel around the charts gets the
    color at the end of a straight walk on the surface, across the nearest seam, so that linear and
    mip-mapped sampling show no seams. At closed seams, where different materials meet, it gets the
    nearest color of its own chart.

    Parameters
    ----------
    mesh, uv, image, progress, atlas
        As in `sharpen_texture`.
    settings : DilateSettings, optional

    Returns
    -------
    array like `image`

    Raises
    ------
    InvalidUV, InvalidSignal, Cancelled
        As in `sharpen_texture`.

    Notes
    -----
    Texels and charts are those of paper B, section 3, which does not describe a gutter. Values are
    copied unchanged, so tangent-space normals are not rotated.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = 0.25 + 0.5 * mesh.vertices[mesh.faces][..., :2]
    >>> image = np.zeros((8, 8), dtype=np.uint8)
    >>> image[2:6, 2:6] = 255
    >>> core.dilate_texture(mesh, uv, image, core.DilateSettings(gutter=1))[4]
    array([255, 255, 255, 255, 255, 255, 255, 255], dtype=uint8)
    """
    given = checked_image(image, LARGEST)
    settings = given_or_default(settings, DilateSettings)
    pixels = given.reshape(*given.shape[:2], -1)
    with reporting(progress):
        with phase(0.0, 0.7, "Finding texels"):
            texture = Texture(checked_atlas(atlas, mesh, uv, pixels), pixels)
        with phase(0.7, 1.0, "Filling the gutter"):
            texture, values = gathered(texture, settings)
            inside = texture.atlas.inside
            return written(texture, values, settings, inside).reshape(given.shape)


def _gathered_with(
    texture: Texture, lead: npt.NDArray, settings: TextureSettings
) -> tuple[Texture, npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    # As `gathered`, with the guide's values; seams are closed where either of them differs.
    atlas, pixels, alpha, normals = texture[:4]
    guiding = opacity_channel(lead.shape[2], "auto")
    with aside("Comparing the seams"):
        values, leading = values_of(atlas, pixels, alpha), values_of(atlas, lead, guiding)
        colors = leading
        if guiding >= 0:
            colors = leading[..., :guiding] * leading[..., guiding, None]
        both = np.concatenate([values, colors], axis=2)
        step = max(least_step(pixels), least_step(lead))
        atlas = settle_seams(atlas, both, settings.seams, step, alpha=alpha, normals=normals)
    return texture._replace(atlas=atlas), values, leading


def _sharpened(
    texture: Texture,
    values: npt.NDArray[np.float32],
    settings: TextureSettings,
    weights: npt.NDArray[np.float64] | None,
) -> npt.NDArray[np.float32]:
    # The new values of the nodes inside charts.
    atlas, normals = texture.atlas, texture.normals
    with aside("Computing the flow"):
        read_ghosts(texture, values)
        result = copied(values)
    groups = channel_groups(values.shape[2], settings)
    surface = Surface(atlas) if are_learned(settings, normals) else None
    has_opacity = settings.by_width and not normals and texture.alpha >= 0
    if has_opacity:
        opacity = values[..., texture.alpha][nodes_inside(atlas)]
        if (opacity[1:] != opacity[:-1]).any():
            groups = with_opacity(groups)
    for number, channels in enumerate(groups):
        with phase(number / len(groups), (number + 1) / len(groups), "Sharpening"):
            if surface is not None:
                sharpen_texels_learned(surface, values, channels, settings, result)
                continue
            if settings.by_width:
                sharpen_texels_by_width(atlas, values, channels, settings, result, normals=normals)
                continue
            domain = SheetDomain(atlas, channels, settings.sampling == "nearest", normals)
            passes = settings.smoothing_passes
            flow_for_time(domain, values, domain, values, passes, settings.time, result)
    if has_opacity:  # hidden texels stay hidden, because they have no color
        opacity, sharp = values[..., texture.alpha], result[..., texture.alpha]
        sharp[opacity == 0] = 0
    mix_texels(atlas, values, settings.amount, weights, result)
    if has_opacity and not np.array_equal(opacity, sharp):
        tell_opacity()
    return result


def _following(
    texture: Texture,
    values: npt.NDArray[np.float32],
    leading: npt.NDArray[np.float32],
    settings: TextureSettings,
    weights: npt.NDArray[np.float64] | None,
) -> npt.NDArray[np.float32]:
    # The new values of the nodes inside charts, moved by the flow of others.
    atlas, normals = texture.atlas, texture.normals
    (channels,) = channel_groups(values.shape[2], replace(settings, channels="coupled"))
    (guides,) = channel_groups(leading.shape[2], replace(settings, alpha="auto"))
    with aside("Computing the flow"):
        read_ghosts(texture, values)
        fill_ghosts(atlas.sheet, atlas.sources, leading, guides.alpha, None)
        result = copied(values)
    if settings.by_width:
        follow_texels_by_width(
            atlas, leading, guides, values, channels, settings, result, normals=normals
        )
    else:
        domain = SheetDomain(atlas, channels, settings.sampling == "nearest", normals)
        guiding, passes = SheetDomain(atlas, guides), settings.smoothing_passes
        flow_for_time(domain, values, guiding, leading, passes, settings.time, result)
    mix_texels(atlas, values, settings.amount, weights, result)
    return result
