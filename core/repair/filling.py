# SPDX-License-Identifier: GPL-3.0-or-later
"""Filling of texels that hold nothing, across the surface of a mesh and over its seams."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.gutter import unit_normals
from ..atlas.seams import settle_seams
from ..atlas.sheet import ROWS
from ..base.checks import LARGEST, Floats, by_keyword, checked_image
from ..base.parallel import run
from ..base.progress import ProgressCallback, aside, phase, reporting
from ..elements.matrices import TextureSpace
from ..elements.surface_values import hidden_values
from ..grid.channels import opacity_channel
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import FillSettings, given_or_default
from ..texture.normal_maps import checked_normals
from ..texture.texels import (
    Texture,
    check_content,
    checked_atlas,
    least_step,
    mix_texels,
    normals_of,
    values_of,
    written,
)
from .grain import grain_of
from .membrane import Holes
from .missing import missing_texels
from .quarters import LESS, enlarged, reduced

_Single = npt.NDArray[np.float32]

_LARGE = 512
"""Height and width from which an initial guess from a smaller texture saves time."""


@by_keyword
def fill_texture(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    image: npt.ArrayLike,
    settings: FillSettings | None = None,
    *,
    missing: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    normals: npt.ArrayLike | None = None,
    atlas: TextureAtlas | None = None,
) -> npt.NDArray:
    """Fill texels without data smoothly from those around them on the surface.

    Known texels stay bit for bit. Colors cross UV seams, so that a hole at a seam is filled from
    both of its sides.

    Parameters
    ----------
    mesh, uv, image, progress, atlas
        As in `sharpen_texture`.
    settings : FillSettings, optional
    missing : (h, w) array of float in [0, 1], or a color, optional
        1 where a texel is missing; less mixes the filled value with the image, 0 keeps the image
        bit for bit. Or the color that marks missing texels, in units of the image, with one value
        per channel. By default missing texels are found, see `FillSettings.find`.
    normals : (m, 3, 3) array of float, optional
        As in `filter_texture`.

    Returns
    -------
    array like `image`
        The filled image; opacity is filled too. The gutter around the charts is filled anew. If
        nothing is missing, the image bit for bit.

    Raises
    ------
    InvalidUV, InvalidSignal, Cancelled
        As in `sharpen_texture`; also if `missing` does not fit the image, or no texel is known.
    SolverError
        If no solution is found.

    See Also
    --------
    find_missing : shows what would be filled.

    Notes
    -----
    The membrane solves the Laplace equation on the elements of paper B, section 5, with the known
    texels as boundary values; the thin plate solves the biharmonic equation, with their values and
    slopes. A connected part of the surface without any known texel takes the colors of the nearest
    known texels in space, averaged over 16 texels. With `grain`, noise as strong as the detail
    around is subtracted before, and added after; see `repair.grain`.

    Examples
    --------
    The middle of a ramp is missing:

    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = mesh.vertices[mesh.faces][..., :2]
    >>> ramp = np.tile(np.linspace(0.0, 1.0, 16), (16, 1))
    >>> hole = np.tile((np.arange(16) > 4) & (np.arange(16) < 12), (16, 1))
    >>> filled = core.fill_texture(mesh, uv, np.where(hole, 0.0, ramp), missing=hole)
    >>> bool(np.abs(filled - ramp).max() < 1e-3)
    True
    """
    given = checked_image(image, LARGEST)
    settings = given_or_default(settings, FillSettings)
    pixels = given.reshape(*given.shape[:2], -1)
    check_content(pixels, settings)
    at_corners = checked_normals(mesh, normals)
    alpha = opacity_channel(pixels.shape[2], settings.alpha)
    with reporting(progress):
        with phase(0.0, 0.2, "Finding texels"):
            texture = Texture(checked_atlas(atlas, mesh, uv, pixels), pixels, alpha)
            weights = missing_texels(texture.atlas, pixels, alpha, missing, settings)
            gone = weights > 0
            if not (gone & texture.atlas.inside).any():
                return given.copy()
            texture = normals_of(texture, settings, at_corners)
            values = values_of(texture.atlas, pixels, alpha, texture.frames)
            missing = _at_nodes(texture.atlas, gone)
            if settings.seams == "extend":
                texture = texture._replace(atlas=_settled(texture, values, "extend"))
        grain = None
        if settings.grain > 0:
            with phase(0.2, 0.4, "Filling"):
                grain = np.float32(settings.grain) * grain_of(texture, values, missing)
        with phase(0.2 if grain is None else 0.4, 0.8, "Filling"):
            first = _first_guess(texture, uv, gone, settings, at_corners)
            result = _filled(texture, values, missing, settings, first, grain)
            if settings.seams == "auto":
                # Borders of materials are seen once something stands on both sides.
                settled = _settled(texture, result, "auto")
                if settled is not texture.atlas:
                    texture = texture._replace(atlas=settled)
                    result = _filled(texture, values, missing, settings, result, grain)
        with phase(0.8, 1.0, "Filling the gutter"):
            if (gone & (weights < 1)).any():
                mix_texels(texture.atlas, values, 1.0, weights, result)
            if not texture.unit:
                _limit(result, pixels[~gone], alpha)
            texture = texture._replace(opacity_stays=False)
            out = written(texture, result.copy(), settings, ~gone)
            points = gone & (texture.atlas.lone >= 0)
            if points.any():
                out[points] = written(texture._replace(made=True), result, settings, None)[points]
            return out.reshape(given.shape)


@by_keyword
def find_missing(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    image: npt.ArrayLike,
    settings: FillSettings | None = None,
    *,
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
) -> npt.NDArray[np.bool_]:
    """Find the texels of a texture that `fill_texture` would fill.

    Parameters
    ----------
    mesh, uv, image, progress, atlas
        As in `sharpen_texture`.
    settings : FillSettings, optional
        Its `find` says how.

    Returns
    -------
    (h, w) bool
        Texels whose centres lie in charts.

    Raises
    ------
    InvalidUV, InvalidSignal, Cancelled
        As in `fill_texture`.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = mesh.vertices[mesh.faces][..., :2]
    >>> image = np.full((16, 16, 4), 0.5)
    >>> image[4:8, 4:8, 3] = 0.0
    >>> int(core.find_missing(mesh, uv, image).sum())
    16
    """
    given = checked_image(image, LARGEST)
    settings = given_or_default(settings, FillSettings)
    pixels = given.reshape(*given.shape[:2], -1)
    alpha = opacity_channel(pixels.shape[2], settings.alpha)
    with reporting(progress), phase(0.0, 1.0, "Finding texels"):
        atlas = checked_atlas(atlas, mesh, uv, pixels)
        return (missing_texels(atlas, pixels, alpha, None, settings) > 0) & atlas.inside


def _settled(texture: Texture, values: _Single, how: str) -> TextureAtlas:
    return settle_seams(texture.atlas, values, how, least_step(texture.pixels), alpha=texture.alpha)


def _first_guess(
    texture: Texture,
    uv: npt.ArrayLike,
    gone: npt.NDArray[np.bool_],
    settings: FillSettings,
    normals: Floats | None,
) -> _Single | None:
    # An initial guess: the result for a quarter of the resolution, interpolated. With it, conjugate
    # gradients need a third of the iterations.
    pixels, mesh = texture.pixels, texture.atlas.mesh
    height, width = pixels.shape[:2]
    if height % LESS or width % LESS or min(height, width) < _LARGE:
        return None
    means, lacking = reduced(pixels, texture.atlas.inside & ~gone)
    if lacking.all():
        return None
    with phase(0.0, 0.2, "Filling"):
        quick = settings.changed(
            surface="membrane", find="auto", seams="continue", gutter=2, grain=0
        )
        filled = fill_texture(
            mesh, uv, means, quick, missing=lacking.astype(np.float64), normals=normals
        )
    guess = enlarged(filled, texture.atlas, gone & texture.atlas.inside)
    if texture.frames is not None:
        texture.frames.to_object(guess)
    return guess


def _filled(
    texture: Texture,
    values: _Single,
    missing: npt.NDArray[np.bool_],
    settings: FillSettings,
    first: _Single | None,
    grain: _Single | None,
) -> _Single:
    # The values of the nodes inside charts, from an initial guess. The grain is subtracted before
    # and added after, so that it continues the detail of the known texels.
    atlas = texture.atlas
    is_plate = settings.surface == "thin_plate"
    given = values
    if grain is not None:
        values = values - grain
        first = None if first is None else first - grain
    with aside("Measuring texels"):
        space = TextureSpace(atlas)
        holes = Holes(space, missing)
        unknowns = np.zeros((space.size, values.shape[2]), dtype=np.float32)
        flat = values.reshape(-1, values.shape[2])
        unknowns[: len(flat)] = flat
        holes.start(unknowns, None if first is None else first.reshape(flat.shape))
    with phase(0.1, 0.3 if is_plate else 1.0, "Filling"):
        solver = holes.membrane(unknowns, "Filling")
    if is_plate:
        with phase(0.3, 1.0, "Filling"):
            holes.plate(unknowns, solver, "Filling")
    result = unknowns[: len(flat)].reshape(values.shape)
    hidden_values(space, unknowns, result)
    if grain is not None:
        result += grain
    if texture.unit:
        run(unit_normals, len(result), result, chunk=ROWS)
    if texture.unit or grain is not None:
        np.copyto(result, given, where=~missing[..., None])
    else:  # known unknowns kept theirs
        hidden = space.cut_cells.hidden[:, 0]
        hidden = hidden[~missing.reshape(-1)[hidden]]
        result.reshape(flat.shape)[hidden] = flat[hidden]
    return result


def _limit(result: _Single, known: npt.NDArray, alpha: int) -> None:
    # Slopes and grain may lead to values below 0, and opacity above 1; both are clipped if no known
    # value is there. Integers are clipped when they are written.
    for channel in range(known.shape[1] if known.dtype.kind == "f" and len(known) else 0):
        values = result[..., channel]
        if known[:, channel].min() >= 0:
            np.maximum(values, 0, out=values)
        if channel == alpha and known[:, channel].max() <= 1:
            np.minimum(values, 1, out=values)


def _at_nodes(atlas: TextureAtlas, gone: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    missing: npt.NDArray[np.bool_] = atlas.gather(gone.view(np.uint8)[..., None])[..., 0] > 0
    return missing
