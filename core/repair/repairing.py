# SPDX-License-Identifier: GPL-3.0-or-later
"""All repairs of a texture in order, also of all maps of a material together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..base.checks import SCALES, by_keyword, checked_image, checked_weights
from ..base.findings import tell
from ..base.progress import ProgressCallback, phase, reporting
from ..color.by_width.measuring import measured
from ..color.image_steps import LARGEST
from ..errors import InvalidSignal
from ..grid.channels import channel_groups, opacity_channel
from ..grid.resize import resized
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import (
    BeltramiTextureSettings,
    BlockSettings,
    DilateSettings,
    EnlargeSettings,
    FillSettings,
    RepairSettings,
    StitchSettings,
    TextureSettings,
    given_or_default,
)
from ..stitch.stitching import stitch_textures
from ..texture.denoising import beltrami_texture
from ..texture.sharpening import dilate_texture, sharpen_texture
from ..texture.texels import Texture, check_content, checked_atlas, gathered, values_of
from ..texture.textures_by_width import nodes_inside
from .blocks import remove_blocks
from .enlarging import enlarge_texture
from .filling import fill_texture
from .missing import missing_texels
from .noticeable import against_contrast, among_small, beside_detail, beside_seams

_Bools = npt.NDArray[np.bool_]

_STEP = 12 / 255
"""Change of a texel at a seam that has the weight 1/2; where changes are larger, different
materials probably meet."""

_MOST_MISSING = 0.5
"""Largest share of missing texels inside charts. If there are more, they are so on purpose: black
paint, or opacity that the material does not show, as beside decals."""

_ROUNDING = 2e-6
"""Relative changes up to this are errors of single precision and its logarithms."""

_CRISP, _BLURRED = 2.25, 2.5
"""Ramp of the width of borders, from 10 to 90 % and in texels: up to the first value there is no
sharpening, from the second on there is full sharpening."""

_UNBLOCKED = 1.25
"""Factor by which compression and the removal of blocks widen borders."""

_WIDE, _GRADIENT = 8.0, 14.0
"""Ramp of the same width: from full sharpening down to none, for gradients that are not borders."""


_SHARPENING_WEIGHT = 0.75
"""Weight of the sharpening. Painted textures are rarely as crisp as texels allow, so a little of
their softness brings them nearer to the original. Crisp ones lose a fifth of the gain."""


class _Surface(NamedTuple):
    # A surface that shows an image.
    mesh: TriangleMesh
    uv: npt.ArrayLike
    atlas: TextureAtlas
    normals: npt.ArrayLike | None


@by_keyword
def repair_texture(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    image: npt.ArrayLike,
    settings: RepairSettings | None = None,
    *,
    missing: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    normals: npt.ArrayLike | None = None,
    atlas: TextureAtlas | None = None,
) -> npt.NDArray:
    """Repair a texture as it comes from a generator or from photogrammetry.

    The steps, in this order: JPEG blocks are removed, then noise; missing texels are filled; steps
    at seams are removed; the texture is sharpened, or enlarged on request; the gutter is filled.
    Each step leaves the texture bit for bit where there is nothing to do.

    Parameters
    ----------
    mesh, uv, image, progress, atlas
        As in `sharpen_texture`.
    settings : RepairSettings, optional
        By default, texels of opacity 0 inside charts are missing, as where photogrammetry has seen
        nothing, unless they are more than half of all, which is taken as intended. With fill
        "unseen", all opacity stays, such as that of cut-out leaves. The gutter is in texels of the
        result.
    missing : (h, w) array of float in [0, 1], optional
        1 where a texel is missing; replaces `settings.fill`.
    normals : (m, 3, 3) array of float, optional
        As in `filter_texture`.

    Returns
    -------
    array like `image`
        With `settings.enlarge`, this many times as high and wide.

    Raises
    ------
    InvalidUV, InvalidSignal, InvalidSettings, Cancelled
        As in `sharpen_texture`.
    SolverError
        If no solution is found.

    See Also
    --------
    repair_textures : repairs all maps of a material together.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = mesh.vertices[mesh.faces][..., :2]
    >>> ramp = np.tile(np.linspace(0.2, 1.0, 16), (16, 1))
    >>> hole = np.tile((np.arange(16) > 4) & (np.arange(16) < 12), (16, 1))
    >>> settings = core.RepairSettings(sharpen=0)
    >>> whole = core.repair_texture(mesh, uv, np.where(hole, 0, ramp), settings, missing=hole)
    >>> bool(np.abs(whole - ramp).max() < 0.01)
    True
    """
    given = checked_image(image, LARGEST)
    settings = given_or_default(settings, RepairSettings)
    with reporting(progress):
        with phase(0.0, 0.1, "Finding texels"):
            surface = _Surface(mesh, uv, checked_atlas(atlas, mesh, uv, given), normals)
        with phase(0.1, 1.0, "Repairing"):
            weights = None if missing is None else checked_weights(missing, given)
            return _repaired(surface, given, settings, weights, None)[0]


@by_keyword
def repair_textures(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    images: Sequence[npt.ArrayLike],
    settings: RepairSettings | None = None,
    *,
    contents: Sequence[str] = (),
    progress: ProgressCallback | None = None,
    normals: npt.ArrayLike | None = None,
) -> list[npt.NDArray]:
    """Repair all maps of a material together, each as by `repair_texture`.

    Parameters
    ----------
    mesh, uv, progress
        As in `sharpen_texture`.
    images : sequence of arrays
        The map of colors first; the others may have other sizes. In these, only texels that are
        missing in the first map too are filled, because black roughness may be intended.
    settings : RepairSettings, optional
        Its `content` is that of the first map.
    contents : sequence of str
        `RepairSettings.content` of each image. Default: all hold values.
    normals : (m, 3, 3) array of float, optional
        As in `filter_texture`.

    Returns
    -------
    list of arrays

    Raises
    ------
    InvalidUV, InvalidSignal, InvalidSettings, SolverError, Cancelled
        As in `repair_texture`.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = mesh.vertices[mesh.faces][..., :2]
    >>> color, rough = np.full((16, 16, 3), 0.5), np.full((8, 8), 0.25)
    >>> found = core.repair_textures(mesh, uv, [color, rough], core.RepairSettings(enlarge=2))
    >>> [each.shape for each in found]
    [(32, 32, 3), (16, 16)]
    """
    if not isinstance(images, list | tuple | np.ndarray) or not len(images):
        raise InvalidSignal("There are no images; give a list of arrays.")
    if not isinstance(contents, list | tuple):
        raise InvalidSignal(f"contents is {contents!r:.60}; give a list of words.")
    given = [checked_image(each, LARGEST) for each in images]
    settings = given_or_default(settings, RepairSettings)
    kinds = list(contents) or ["values"] * len(given)
    if len(kinds) != len(given):
        raise InvalidSignal(
            f"There are {len(given)} images and {len(kinds)} contents; give one of each."
        )
    results: list[npt.NDArray] = []
    atlases: dict[tuple[int, ...], TextureAtlas] = {}
    lacking: _Bools | None = None
    with reporting(progress):
        for number, (image, content) in enumerate(zip(given, kinds, strict=True)):
            with phase(number / len(given), (number + 1) / len(given), "Repairing"):
                size = image.shape[:2]
                if size not in atlases:
                    atlases[size] = TextureAtlas(mesh, uv, size=(size[0], size[1]))
                surface = _Surface(mesh, uv, atlases[size], normals)
                own = settings.changed(content=content)
                result, found = _repaired(surface, image, own, None, lacking)
                results.append(result)
                lacking = found if number == 0 else lacking
    return results


def _repaired(
    surface: _Surface,
    image: npt.NDArray,
    settings: RepairSettings,
    missing: npt.NDArray | None,
    within: _Bools | None,
) -> tuple[npt.NDArray, _Bools]:
    # Returns the image after all steps, and the texels that were missing.
    check_content(image.reshape(*image.shape[:2], -1), settings)
    with phase(0.0, 0.15, "Removing blocks"):
        clean = image
        if settings.blocks > 0:
            clean = remove_blocks(image, BlockSettings(strength=settings.blocks))
        unblocked = bool((clean != image).any())
    with phase(0.15, 0.3, "Smoothing"):
        weights = _missing(surface, image, settings, missing, within)
        clean = _without_noise(surface, clean, settings, weights)
    with phase(0.3, 0.6, "Filling"):
        if (weights > 0).any():
            filled = _filled(surface, clean, settings, weights)
            clean = (
                filled if missing is not None else _with_opacity(surface, filled, clean, settings)
            )
    with phase(0.6, 0.8, "Bringing seams together"):
        if settings.stitch != "nothing":
            clean = _stitched(surface, clean, settings)
    with phase(0.8, 1.0, "Sharpening"):
        return _finished(surface, clean, settings, unblocked), weights > 0


def _missing(
    surface: _Surface,
    image: npt.NDArray,
    settings: RepairSettings,
    missing: npt.NDArray | None,
    within: _Bools | None,
) -> npt.NDArray[np.float64]:
    # How far each texel is missing, from 0 to 1: (h, w).
    if missing is not None:
        return np.asarray(missing, dtype=np.float64)
    if settings.fill == "nothing" or (within is not None and not within.any()):
        return np.zeros(image.shape[:2])
    limit = None
    if within is not None:
        height, width = image.shape[:2]
        limit = resized(within.astype(np.float32)[..., None], (height, width))[..., 0] > 0.5
    how = FillSettings(find=settings.fill)
    alpha = _alpha_of(image, settings)
    pixels = image.reshape(*image.shape[:2], -1)
    inside = surface.atlas.inside
    found = missing_texels(surface.atlas, pixels, alpha, None, how) * inside
    if settings.fill == "unseen" and alpha >= 0:  # cut-out texels need no color
        found = found * (pixels[..., alpha] > 0)
    if np.count_nonzero(found[inside]) > _MOST_MISSING * np.count_nonzero(inside):  # intended
        return np.zeros(image.shape[:2])
    return found if limit is None else found * limit


def _without_noise(
    surface: _Surface,
    image: npt.NDArray,
    settings: RepairSettings,
    missing: npt.NDArray[np.float64],
) -> npt.NDArray:
    # Where there is no noise, its kernel is too narrow to change anything.
    if settings.denoise == 0:
        return image
    how = BeltramiTextureSettings(
        **_common(settings), alpha=settings.alpha, content=settings.content
    )
    mask = settings.denoise * (missing == 0)
    return beltrami_texture(surface.mesh, surface.uv, image, how, mask=mask, atlas=surface.atlas)


def _filled(
    surface: _Surface,
    image: npt.NDArray,
    settings: RepairSettings,
    missing: npt.NDArray[np.float64],
) -> npt.NDArray:
    inside = surface.atlas.inside
    share = np.count_nonzero(missing[inside]) / max(np.count_nonzero(inside), 1)
    tell("{share:.1%} of the texels were missing, and were filled.", share=share)
    how = FillSettings(gutter=settings.gutter, alpha=settings.alpha, content=settings.content)
    return fill_texture(
        surface.mesh,
        surface.uv,
        image,
        how,
        missing=missing,
        normals=surface.normals,
        atlas=surface.atlas,
    )


def _with_opacity(
    surface: _Surface, filled: npt.NDArray, image: npt.NDArray, settings: RepairSettings
) -> npt.NDArray:
    # Texels that were not fully transparent keep their opacity.
    alpha = _alpha_of(image, settings)
    if alpha >= 0:
        keep = surface.atlas.inside & (image[..., alpha] > 0)
        filled[..., alpha][keep] = image[..., alpha][keep]
    return filled


def _stitched(surface: _Surface, image: npt.NDArray, settings: RepairSettings) -> npt.NDArray:
    everywhere = settings.stitch == "everywhere"
    # If only the seams are stitched, large steps stay: as narrow ramps they would be visible too.
    atlas = surface.atlas if everywhere else _with_seams(surface.atlas, image, settings).atlas
    how = StitchSettings(
        gutter=settings.gutter,
        where=settings.stitch,
        seams=settings.seams if everywhere else "continue",
        alpha=settings.alpha,
        content=settings.content,
    )
    result = stitch_textures(
        surface.mesh, surface.uv, image, how, normals=surface.normals, atlas=atlas
    )
    if everywhere:
        return result
    old, new = _in_singles(image, result)
    pixels = image.reshape(*image.shape[:2], -1)
    shares = beside_detail(Texture(surface.atlas, pixels), new - old)
    shares *= among_small(surface.atlas.inside, new - old, _STEP)
    return _mixed(image, result, shares, settings)


def _in_singles(*images: npt.NDArray) -> list[npt.NDArray[np.float32]]:
    # Values for white = 1: (h, w, c).
    scale = np.float32(SCALES[images[0].dtype.name])
    return [scale * each.reshape(*each.shape[:2], -1).astype(np.float32) for each in images]


def _mixed(
    image: npt.NDArray,
    result: npt.NDArray,
    shares: npt.NDArray[np.float32],
    settings: RepairSettings,
) -> npt.NDArray:
    # The image with weighted changes, by weights (h, w); only changed texels are computed.
    old_texels, new_texels = (each.reshape(shares.size, -1) for each in (image, result))
    where = np.flatnonzero((old_texels != new_texels).any(axis=1))
    if len(where) == 0:
        return image
    given = old_texels[where]
    old, new = (each[0] for each in _in_singles(given[None], new_texels[where][None]))
    mixed = old + shares.reshape(-1, 1)[where] * (new - old)
    if settings.content != "values":  # normals are shorter after mixing
        normals = 2 * mixed[:, :3] - 1
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        mixed[:, :3] = (normals / np.maximum(lengths, 1e-6) + 1) / 2
    # Other texels keep their bits, for which single precision may not suffice.
    scale = SCALES[image.dtype.name]
    rounding = _ROUNDING * (np.abs(old) + scale * np.abs(image).mean(dtype=np.float64))
    changed = (np.abs(new - old) > rounding).any(axis=1)
    found = old_texels.copy()
    found[where[changed]] = _stored(mixed / scale, given)[changed]
    return found.reshape(image.shape)


def _finished(
    surface: _Surface, image: npt.NDArray, settings: RepairSettings, unblocked: bool
) -> npt.NDArray:
    # Enlarges or sharpens the image, and fills the gutter.
    mesh, uv, atlas, _ = surface
    words = {**_common(settings), "alpha": settings.alpha, "content": settings.content}
    if settings.enlarge > 1:  # enlarging includes sharpening
        larger = EnlargeSettings(factor=settings.enlarge, **words)
        return enlarge_texture(mesh, uv, image, larger, atlas=atlas)
    amount = settings.sharpen * _blur(atlas, image, settings, unblocked)
    if amount > 0:
        with phase(0.0, 0.9, "Sharpening"):
            sharp = sharpen_texture(mesh, uv, image, TextureSettings(**words), atlas=atlas)
            old, new = _in_singles(image, sharp)
            shares = np.float32(_SHARPENING_WEIGHT * amount) * against_contrast(
                atlas.inside, old, new - old
            )
            shares *= beside_seams(_with_seams(atlas, image, settings))
            image = _mixed(image, sharp, shares, settings)
    with phase(0.9, 1.0, "Filling the gutter"):
        return dilate_texture(mesh, uv, image, DilateSettings(**_common(settings)), atlas=atlas)


def _with_seams(atlas: TextureAtlas, image: npt.NDArray, settings: RepairSettings) -> Texture:
    # The image on an atlas whose seams are closed according to `settings.seams`.
    alpha, normals = _alpha_of(image, settings), settings.content == "normals"
    texture = Texture(atlas, image.reshape(*image.shape[:2], -1), alpha, normals)
    return gathered(texture, DilateSettings(**_common(settings)))[0]


def _blur(
    atlas: TextureAtlas, image: npt.NDArray, settings: RepairSettings, unblocked: bool = False
) -> float:
    # The share of sharpening that borders inside charts need, by their measured width.
    if settings.sharpen == 0:
        return 0.0
    pixels = image.reshape(*image.shape[:2], -1)
    how = TextureSettings(what="photo", alpha=settings.alpha)
    values = values_of(atlas, pixels, _alpha_of(image, settings))
    channels = channel_groups(pixels.shape[2], how)[0]
    width = measured(values, channels, how, inside=nodes_inside(atlas)).borders.width
    width /= _UNBLOCKED if unblocked else 1.0
    share = float(np.interp(width, [_CRISP, _BLURRED, _WIDE, _GRADIENT], [0.0, 1.0, 1.0, 0.0]))
    if share == 0:
        tell("Borders are as crisp as texels allow; they were not sharpened.")
    return share


def _stored(values: npt.NDArray[np.float32], like: npt.NDArray) -> npt.NDArray:
    # Converts values to the type and shape of an image.
    if like.dtype.kind == "u":
        values = np.rint(np.clip(values, 0, np.iinfo(like.dtype).max))
    return values.reshape(like.shape).astype(like.dtype)


def _common(settings: RepairSettings) -> dict[str, Any]:
    names = ("gutter", "background", "seams")
    return {name: getattr(settings, name) for name in names}


def _alpha_of(image: npt.NDArray, settings: RepairSettings) -> int:
    return opacity_channel(1 if image.ndim == 2 else image.shape[2], settings.alpha)
