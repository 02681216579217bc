# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening of textures on the surface, across seams (paper A, section 4; paper B, section 3)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.ghosts import fill_ghosts
from ..atlas.gutter import unit_normals, write_texels
from ..atlas.seam_fit import stitch
from ..atlas.sheet import ROWS
from ..atlas.walk import advect_texels, texel_potential
from ..base.checks import BAND, SCALES, checked_image, checked_weights
from ..base.parallel import Progress, blocks, run
from ..base.progress import ProgressCallback
from ..errors import InvalidSignal
from ..grid.pixels import channel_groups, copied
from ..grid.walk import Channels
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import DilateSettings, TextureSettings
from .signals import mix_rows

_LARGEST = 1e30  # beyond, sums leave the range of single precision


def sharpen_texture(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    image: npt.ArrayLike,
    settings: TextureSettings | None = None,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    *,
    atlas: TextureAtlas | None = None,
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
        The analysis of the same mesh, coordinates and image size, to save doing it again; `uv`
        is not looked at then.

    Returns
    -------
    array like `image`
        Inside the charts, every value lies within the input's values near it on the surface, but
        for rounding to single precision; opacity stays. Around them the gutter is filled with
        what lies across the seam. A time of 0 returns the input bit for bit.

    Raises
    ------
    InvalidUV
        If the texture coordinates cannot be used; see `TextureAtlas`.
    InvalidSignal
        If the image's shape or type is not supported, it holds NaN or infinity, or the mask
        does not fit it.
    Cancelled
        If `progress` returned False.

    Notes
    -----
    Paper A, sections 3.2, 3.3 and Appendix A, on the texels of paper B, section 3. Differs from
    paper B in what makes values continuous: the charts are extended by ghost texels that read
    across the seam, instead of basis functions that are merged there. Beside the atlas and
    image and result, a node of its sheet costs 12 bytes and 8 more for each channel.
    """
    given = _checked_texture(image)
    settings = settings or TextureSettings()
    pixels = given.reshape(*given.shape[:2], -1)
    weights = checked_weights(mask, given)
    _check_content(settings, pixels)
    phases = Progress.of(progress)
    atlas = _checked_atlas(atlas, mesh, uv, pixels, phases.part(0.0, 0.3, "Finding texels"))
    if settings.time == 0:
        phases.update(1.0)
        return given.copy()
    scale = SCALES[given.dtype.name]
    still = phases.part(0.3, 0.3, "Computing the flow")
    values = atlas.gather(pixels, scale, still)
    normals = settings.content == "normals"
    groups = channel_groups(pixels.shape[2], settings)
    directions = 0.5 if normals else None
    alpha = groups[0].alpha
    if alpha >= 0:
        for rows in blocks(len(values), BAND, still):
            np.clip(values[rows, :, alpha], 0.0, 1.0, out=values[rows, :, alpha])
    fill_ghosts(atlas.sheet, atlas.sources, values, still, alpha, directions)
    result = copied(values, still)
    for number, channels in enumerate(groups):
        part = phases.part(0.3 + 0.6 * number / len(groups), 0.3 + 0.6 * (number + 1) / len(groups),
                           "Sharpening")  # fmt: skip
        _flow_channels(atlas, values, channels, settings, result, part)
    still = phases.part(0.9, 0.9, "Filling the gutter")
    keep = None
    if weights is not None:
        keep = weights == 0
        shares = atlas.gather(weights[..., None], 1.0, still).reshape(-1)
        flat = result.reshape(len(shares), -1)
        run(mix_rows, len(shares), values.reshape(flat.shape), flat, shares, flat, progress=still)
    del values
    fill_ghosts(atlas.sheet, atlas.sources, result, still, alpha, directions)
    if normals:
        run(unit_normals, len(result), result, chunk=ROWS, progress=still)
    else:
        stitch(atlas, result, _step(given), still)
    out = copied(pixels, still)
    write_texels(atlas, result, 1.0 / scale, settings, keep, out,
                 phases.part(0.9, 1.0, "Filling the gutter"), opacity=alpha,
                 normals=normals)  # fmt: skip
    return out.reshape(given.shape)


def dilate_texture(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    image: npt.ArrayLike,
    settings: DilateSettings | None = None,
    progress: ProgressCallback | None = None,
    *,
    atlas: TextureAtlas | None = None,
) -> npt.NDArray:
    """Fill the gutter of a texture with what lies across the seams.

    Texels whose centres lie in charts stay bit for bit. The others around the charts get the
    value of the surface where one comes by walking straight across the nearest seam, so that
    linear and mip-mapped sampling show none.

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
    Texels and charts are those of paper B, section 3; the paper leaves the gutter open. Values are
    taken as they are: tangent-space normals do not turn.
    """
    given = _checked_texture(image)
    settings = settings or DilateSettings()
    pixels = given.reshape(*given.shape[:2], -1)
    phases = Progress.of(progress)
    atlas = _checked_atlas(atlas, mesh, uv, pixels, phases.part(0.0, 0.7, "Finding texels"))
    scale = SCALES[given.dtype.name]
    still = phases.part(0.7, 0.7, "Filling the gutter")
    values = atlas.gather(pixels, scale, still)
    fill_ghosts(atlas.sheet, atlas.sources, values, still)
    stitch(atlas, values, _step(given), still)
    out = copied(pixels, still)
    write_texels(atlas, values, 1.0 / scale, settings, atlas.inside, out,
                 phases.part(0.7, 1.0, "Filling the gutter"))  # fmt: skip
    return out.reshape(given.shape)


def _flow_channels(
    atlas: TextureAtlas,
    values: npt.NDArray[np.float32],
    channels: Channels,
    settings: TextureSettings,
    result: npt.NDArray[np.float32],
    progress: Progress = Progress(None),
) -> None:
    parts = atlas.sheet, atlas.sources, atlas.surface, values
    normals = settings.content == "normals"
    potential = texel_potential(*parts, channels, settings.smoothing_passes, progress.part(
        0.0, 0.4, "Computing the flow"), normals=normals)  # fmt: skip
    advect_texels(*parts, channels, potential, settings.time, atlas.copies, result,
                  nearest=settings.sampling == "nearest", normals=normals,
                  progress=progress.part(0.4, 1.0, "Tracing flow-lines"))  # fmt: skip


def _checked_texture(image: npt.ArrayLike) -> npt.NDArray:
    given = checked_image(image)
    if given.dtype.kind == "f" and max(-float(given.min()), float(given.max())) > _LARGEST:
        raise InvalidSignal(
            "The image holds values beyond {most:g}; scale or clip them.", most=_LARGEST
        )
    return given


def _step(image: npt.NDArray) -> float:
    # Between values of whole numbers, where white is 1.
    return SCALES[image.dtype.name] if image.dtype.kind == "u" else 0.0


def _checked_atlas(
    atlas: TextureAtlas | None,
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    pixels: npt.NDArray,
    progress: Progress = Progress(None),
) -> TextureAtlas:
    height, width = pixels.shape[:2]
    if atlas is None:
        return TextureAtlas(mesh, uv, height, width, progress)
    if atlas.mesh is not mesh or (atlas.height, atlas.width) != (height, width):
        raise InvalidSignal(
            f"The atlas is for {atlas.width} x {atlas.height} texels of its own mesh, the image"
            f" has {width} x {height}; make an atlas for this mesh and size."
        )
    progress.update(1.0)
    return atlas


def _check_content(settings: TextureSettings, pixels: npt.NDArray) -> None:
    if settings.content == "normals" and (
        pixels.shape[2] not in (3, 4) or settings.channels != "coupled"
    ):
        raise InvalidSignal(
            f"A texture of normals needs three channels, or four with opacity, and channels"
            f" 'coupled'; this one has {pixels.shape[2]}, and channels {settings.channels!r}."
        )
