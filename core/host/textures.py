# SPDX-License-Identifier: GPL-3.0-or-later
"""Filter a texture on its surface, as a host program such as Blender stores both.

Colors are filtered as they are stored: bytes as values of the image's color space, floats as
linear ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..base.findings import Finding
from ..base.memo import kept
from ..base.progress import ProgressCallback, phase, reporting
from ..grid.resize import resized
from ..mesh.triangle_mesh import TriangleMesh
from ..mesh.weld import weld_borders
from ..registry import Filter, find
from ..settings import describe, named, value_of
from ..texture.painted_gain import gains_of
from .images import divided, filter_channels, filter_pixels, recolored_larger, with_opacity
from .inputs import Floats, HostImage, Pixels, TexturedFaces, TexturedSurface
from .mosaic import Mosaic
from .recolored import Recolored, recolored

_SURELY_PAINTED = 0.25
"""Distance of a gain from 1, of white being 2, from which on a mask of a gain map is 1."""

_ANALYSIS = 0.3  # of the time that a run takes


@dataclass(frozen=True)
class Retextured:
    """New colors of a texture, the texels inside its charts, and remarks on its coordinates."""

    recolored: Recolored
    shown: npt.NDArray[np.bool_] | None
    notes: tuple[Finding, ...]


def filter_texture(
    surface: TexturedSurface, name: str, settings: Any, progress: ProgressCallback | None = None
) -> Retextured:
    """Filter a texture.

    Parameters
    ----------
    surface : TexturedSurface
    name, settings
        As in `images.filter_image`.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Raises
    ------
    ShockError
        See `TriangleMesh`, `TextureAtlas` and the filter.
    """
    row = find(name)
    height, width = surface.picture.pixels.shape[:2]
    if surface.content:
        settings = _holding(settings, surface.content)
    words: dict[str, Any] = {}
    with reporting(progress):
        with phase(0.0, _ANALYSIS, "Preparing the mesh"):
            atlas = atlas_of(surface.faces, (height, width), surface.is_tried)
            mask = _mask(surface, atlas)
            is_limit = row.takes_mask and row.mask_as == "mask"
            shown = None if row.fills_gutter else _counted(atlas, mask if is_limit else None)
        with phase(_ANALYSIS, 1.0, "Filtering"):
            if surface.guide is not None and row.takes_guide:
                words["guide"] = _guiding(surface.guide, (height, width))
            words |= {"mask": mask, "atlas": atlas}
            if row.takes_normals:
                words["normals"] = surface.faces.normals
            if row.load_solver is not None and surface.is_tried:
                changed = _tried(surface, atlas, row.load_solver(), settings, mask)
            elif surface.others:
                changed = _joined(surface, atlas, row, settings, words)
            else:
                if row.takes_gain:
                    words["gain"] = _gains(surface, atlas, value_of(settings, "gain"))
                where = atlas.mesh, surface.faces.uv
                changed = filter_pixels(
                    surface.picture, name, settings, *where, shown=shown, **words
                )
    return Retextured(changed, shown, tuple(atlas.report.findings()))


def tiles_of(
    mosaic: Mosaic, old: dict[int, Pixels], result: Retextured, levels: int
) -> dict[int, Recolored]:
    """Cut a result into UDIM tiles and compare each with what it was.

    Parameters
    ----------
    mosaic : Mosaic
        The layout that was filtered.
    old : dict
        The pixels of the tiles by their numbers.
    result : Retextured
    levels : int
        As in `recolored`.
    """
    new = result.recolored.colors
    times = len(new) // mosaic.height
    if times > 1:
        parts = mosaic.enlarged(times).cut(new)
        return {n: recolored_larger(old[n], part, levels, times) for n, part in parts.items()}
    shown = {} if result.shown is None else mosaic.cut(result.shown)
    return {n: recolored(old[n], part, levels, shown.get(n)) for n, part in mosaic.cut(new).items()}


def analyse(
    faces: TexturedFaces, size: tuple[int, int], progress: ProgressCallback | None = None
) -> TextureAtlas:
    """Find charts and texels of an image of this height and width."""
    with reporting(progress):
        with phase(0.0, 0.1, "Preparing the mesh"):
            mesh = TriangleMesh(faces.positions, weld_borders(faces.positions, faces.triangles))
        with phase(0.1, 1.0, "Finding charts"):
            return TextureAtlas(mesh, faces.uv, size=size)


def atlas_of(faces: TexturedFaces, size: tuple[int, int], is_tried: bool) -> TextureAtlas:
    """Return `analyse` of faces, kept with these for previews."""
    if not is_tried:
        return analyse(faces, size)
    return kept(faces, "atlas", size, lambda: analyse(faces, size))


def _holding(settings: Any, content: str) -> Any:
    # Settings for an image that holds some content, or the choice that comes nearest to it.
    kind = type(settings.kernel)
    field = named(kind, "content")
    if not field:
        return settings
    _, _, about = describe(kind)[field]
    if content not in about.choices:
        content = "normals" if content == "normals_y_down" else "values"
    return settings.changed(**{field: content})


def _tried(
    surface: TexturedSurface,
    atlas: TextureAtlas,
    solver_of: Any,
    settings: Any,
    mask: Floats | None,
) -> Recolored:
    """Filter for a preview; the solver for all gains is kept with the faces.

    Results for the same painted gains are linear in the gain, so all are mixed from two. This does
    not hold for normals, which are normalized. Results are only shown, so they are not rounded,
    and changes are not counted.
    """
    picture, uv = surface.picture, surface.faces.uv
    wanted = value_of(settings, "gain")
    is_painted = surface.grays is not None or surface.faces.grays is not None

    def function(pixels: Pixels, alpha: str) -> Pixels:
        if wanted == 1 and not is_painted:
            return pixels.copy()
        shared = settings.changed(**{named(type(settings), "gain"): 1.0})
        shared = with_opacity(shared, alpha)
        key = (id(picture), *vars(shared).values())

        # The picture is kept with its solver, so that its id is not used again.
        def make() -> tuple[HostImage, Any]:
            normals = surface.faces.normals
            solver = solver_of(atlas.mesh, uv, pixels, shared, normals=normals, atlas=atlas)
            return picture, solver

        def result(gain: float) -> Pixels:
            gains = _gains(surface, atlas, gain)
            return solver.filtered(gain if gains is None else gains, mask=mask)

        with phase(0.0, 0.5, "Measuring texels"):
            _, solver = kept(surface.faces, "solver", key, make)
        with phase(0.5, 1.0, "Filtering"):
            if value_of(settings, "content", "values") != "values":
                return result(wanted)
            key = surface.grays, surface.mask
            gain, first = kept(solver, "first", key, lambda: (wanted, result(wanted)))
            other = 0.0 if gain > 0.5 else 2.0
            if wanted == gain and is_painted:  # the second one takes another solution
                return first
            if surface.grays is not None and surface.faces.grays is not None:
                return result(wanted)  # their product is not linear
            second = kept(solver, "second", (*key, other), lambda: result(other))
            share = np.float32((wanted - other) / (gain - other))
            return second + share * (first - second)

    alpha = value_of(settings, "opacity", "auto")
    return Recolored(filter_channels(picture, function, alpha), 0, 0.0, 0)


def _joined(
    surface: TexturedSurface,
    atlas: TextureAtlas,
    row: Filter,
    settings: Any,
    given: dict[str, Any],
) -> Recolored:
    """Merge several images into one; opacity says where each is known."""
    join = row.function()

    def function(pixels: Pixels, alpha: str) -> Pixels:
        words = dict(given)
        others = [each.pixels for each in surface.others]
        if alpha != "none":
            others = [_straight(each) for each in surface.others]
        elif pixels.shape[2] == 3:
            straight = [_straight(each) for each in surface.others]
            others = [np.ascontiguousarray(each[..., :3]) for each in straight]
            opacities = [each[..., 3].astype(np.float64) for each in straight]
            words["confidences"] = [np.ones(pixels.shape[:2]), *opacities]
        words["settings"] = with_opacity(settings, alpha)
        return join(atlas.mesh, surface.faces.uv, [pixels, *others], **words)

    picture = surface.picture
    new = filter_channels(picture, function, value_of(settings, "opacity", "auto"))
    return recolored(picture.pixels, new, picture.levels, _counted(atlas, given["mask"]))


def _straight(image: HostImage) -> Pixels:
    # Colors not multiplied by opacity; opaque if the image has none.
    if image.opacity in ("STRAIGHT", "PREMUL"):
        return divided(image.pixels) if image.premultiplied else image.pixels
    pixels = image.pixels.copy()
    pixels[..., 3] = 1.0
    return pixels


def _gains(surface: TexturedSurface, atlas: TextureAtlas, gain: float) -> Pixels | None:
    gains = None if surface.grays is None else gains_of(surface.grays, gain)
    if surface.faces.grays is None:
        return gains
    baked = gains_of(atlas.bake(surface.faces.grays), gain)
    baked[~atlas.inside] = 1.0
    return baked if gains is None else baked * gains


def mask_of_gain(grays: npt.ArrayLike) -> npt.NDArray[np.float32]:
    """Return where a gain map was painted, as a mask for its result.

    Parameters
    ----------
    grays : array of float
        As in `gains_of`: middle gray is not painted.

    Returns
    -------
    array of float32
        0 for middle gray, 1 from a quarter of the way to black or white on, linear in between, so
        that soft rims of strokes stay soft.

    Examples
    --------
    >>> mask_of_gain([0.0, 0.5, 0.5 + 1 / 16, 1.0]).round(1).tolist()
    [1.0, 0.0, 0.5, 1.0]
    """
    painted = np.abs(gains_of(grays, 2.0) - np.float32(1.0))
    return np.minimum(painted * np.float32(1.0 / _SURELY_PAINTED), np.float32(1.0))


def _guiding(guide: HostImage, size: tuple[int, int]) -> Pixels:
    # Multiplied colors are weighted by opacity already.
    is_straight = guide.opacity == "STRAIGHT" and not guide.premultiplied
    return resized(guide.pixels if is_straight else guide.pixels[..., :3], size)


def _counted(atlas: TextureAtlas, mask: Floats | None) -> npt.NDArray[np.bool_]:
    # Texels that are seen and were filtered.
    return atlas.inside if mask is None else atlas.inside & (mask > 0.0)


def _mask(surface: TexturedSurface, atlas: TextureAtlas) -> Floats | None:
    if surface.faces.weights is None:
        return surface.mask
    mask = np.clip(atlas.bake(surface.faces.weights), 0.0, 1.0)
    return mask if surface.mask is None else mask * surface.mask
