# SPDX-License-Identifier: GPL-3.0-or-later
"""Stitching of textures: merges several pictures of a surface (paper B, section 7.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.ghosts import extend_ghosts
from ..atlas.gutter import unit_normals
from ..atlas.seams import settle_seams
from ..atlas.sheet import ROWS
from ..base.checks import LARGEST, Floats, as_array, by_keyword, checked_image, checked_weights
from ..base.findings import tell
from ..base.parallel import run
from ..base.progress import ProgressCallback, phase, reporting
from ..elements.matrices import CellWeights, TextureSpace
from ..elements.multigrid import SheetSolver
from ..elements.sheet_matrix import without_held
from ..elements.surface_values import corner_values, sheet_values, surface_values
from ..errors import InvalidSignal
from ..grid.channels import opacity_channel
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import StitchSettings, given_or_default
from ..texture.normal_maps import checked_normals
from ..texture.roughness import roughness_of_values
from ..texture.texels import (
    Texture,
    check_content,
    check_covered,
    checked_atlas,
    gathered,
    least_step,
    mix_texels,
    normals_of,
    values_of,
    written,
)
from .light import share_of_factors
from .seam_steps import clear_steps

_Single = npt.NDArray[np.float32]

_TOLERANCE = 1e-4
"""Residual of the solution relative to the right-hand side."""

_UNKNOWN = 1e-6
"""Screening of unknown texels, which have no value, to keep the matrix definite."""

_FLOOR = 0.01
"""Share of the mean value that is added before logarithms are taken, for values of 0."""

_HELD = 1e6
"""Screening of texels that must not change, relative to that of others."""


class _Source(NamedTuple):
    # One picture, and its confidence.
    values: _Single  # (rows, columns, c) at nodes and ghosts
    corners: Floats  # (v, c) at the corners of the pieces, by their own chart, with clear steps
    shares: Floats  # (v,) how much of a step stands out there, from 0 to 1
    confidence: _Single  # (n,) at nodes


class _Target(NamedTuple):
    # The desired values of the result, and their confidence.
    values: _Single  # (n, c)
    unbalance: _Single  # (n, c): difference of their gradients from the desired ones
    confidence: CellWeights
    known: npt.NDArray[np.bool_]  # (n,)


@by_keyword
def stitch_textures(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    images: npt.ArrayLike | Sequence[npt.ArrayLike],
    settings: StitchSettings | None = None,
    *,
    confidences: Sequence[npt.ArrayLike] | None = None,
    labels: npt.ArrayLike | None = None,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    normals: npt.ArrayLike | None = None,
    atlas: TextureAtlas | None = None,
) -> npt.NDArray:
    """Merge several textures without steps, or remove the steps at the seams of one texture.

    The gradients of the result are those of the known parts of the images. Steps from one image to
    another, or across a seam, are not among these gradients.

    Parameters
    ----------
    mesh, uv, progress, atlas
        As in `sharpen_texture`.
    images : array, or several, like the image in `sharpen_texture`
        Pictures of the surface in the same layout, such as photos projected from several sides.
        A single one, such as baked light or a scan, loses the steps across its seams.
    settings : StitchSettings, optional
    confidences : sequence of (h, w) arrays of float, optional
        Weights of the texels of each image; 0 where nothing is known. They are multiplied by
        opacity. Default: 1.
    labels : (h, w) array of int, optional
        The image of each texel, in place of confidences; negative where nothing is known. With one
        image, labels may be any numbers, and steps between areas of different labels are removed.
    mask : (h, w) array of float in [0, 1], optional
        1 takes the result, less mixes it with the first image, 0 keeps the first image bit for
        bit.
    normals : (m, 3, 3) array of float, optional
        As in `filter_texture`.

    Returns
    -------
    array like the first image
        Unknown texels are filled smoothly; parts of the surface of which nothing is known at all
        keep the first image. Values stay between black and white, or in the range of the images if
        that is larger; not those of normal maps. Opacity is the largest of the images. The gutter
        around the charts is filled anew, whatever the images hold there.

    Raises
    ------
    InvalidUV, InvalidSignal, Cancelled
        As in `sharpen_texture`; also if images, confidences or labels do not fit one another, or
        nothing is known anywhere.
    SolverError
        If no solution is found.

    Notes
    -----
    Paper B, sections 6 and 7.2: x minimizes ``sum_k w_k (|x - y_k|^2 / radius^2 +
    |grad x - grad y_k|^2)`` on the surface, lengths in mean texel sizes, for images y_k whose
    confidences w_k add up to 1 in the second term. At a seam, each
    side of an image has the values of its own chart, extrapolated linearly. For equal images, the
    result differs from them by rounding, but for steps where confidences end.

    Not in the paper: only the part of a step at a seam that stands out from the detail beside it is
    removed (see `stitch.seam_steps`), so that fine textures without steps hardly change; with
    ``seams="auto"``, steps between different materials stay. Images that differ by factors, as in
    another light, are stitched as logarithms, in which factors are steps. Whether they do is
    measured at seams, and where two images are known, by comparing the residuals of a factor and of
    an offset. Where both are about equal, both results are mixed.

    Examples
    --------
    Two pictures of one square, one of which is brighter:

    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = mesh.vertices[mesh.faces][..., :2]
    >>> one = np.tile(np.linspace(0.2, 0.4, 16), (16, 1))
    >>> left = np.tile(np.arange(16) < 8, (16, 1)).astype(float)
    >>> image = core.stitch_textures(mesh, uv, [one, one + 0.3], confidences=[left, 1 - left])
    >>> rows = [np.where(left, one, one + 0.3)[8], image[8]]
    >>> [round(float(np.diff(row).max()), 2) for row in rows]
    [0.31, 0.01]
    """
    pictures = _checked_images(images)
    settings = given_or_default(settings, StitchSettings)
    given = pictures[0]
    trust = _checked_confidences(confidences, labels, pictures)
    weights = checked_weights(mask, given)
    flat = [picture.reshape(*given.shape[:2], -1) for picture in pictures]
    check_content(flat[0], settings)
    at_corners = checked_normals(mesh, normals)
    alpha = opacity_channel(flat[0].shape[2], settings.alpha)
    with reporting(progress):
        with phase(0.0, 0.3, "Finding texels"):
            texture = Texture(checked_atlas(atlas, mesh, uv, flat[0]), flat[0], alpha)
            check_covered(texture.atlas)
            texture = normals_of(texture, settings, at_corners)
            same_material = settings.seams == "auto"
            seams = replace(settings, seams="continue") if same_material else settings
            texture, values = gathered(texture, seams)
        with phase(0.3, 0.5, "Comparing texels"):
            space = TextureSpace(texture.atlas)
            opacity = values[..., alpha].copy()  # the last channel's, if none is opacity
            sources = [
                _source(space, texture, picture, given, opacity, same_material)
                for picture, given in zip(flat, trust, strict=True)
            ]
        with phase(0.5, 0.9, "Stitching"):
            stitched = _stitched(space, sources, labels, settings)
            if settings.content == "values":
                stitched = np.clip(stitched, *_bounds(sources))
        with phase(0.9, 1.0, "Filling the gutter"):
            result = values.copy()
            if alpha >= 0:
                stitched = np.insert(stitched, alpha, 0.0, axis=1)
            sheet_values(space, stitched, result)
            if alpha >= 0:  # points along seams have none
                inside = space.atlas.sheet.nodes >= 0
                result[inside, alpha] = opacity[inside]
            unknown = _unknown_parts(space, sources)
            result[unknown] = values[unknown]
            if texture.unit:
                run(unit_normals, len(result), result, chunk=ROWS)
            mix_texels(texture.atlas, values, 1.0, weights, result)
            keep = None if weights is None else weights == 0
            if same_material and settings.where == "everywhere":
                # Where a step stays, the gutter continues the chart beside it.
                step = least_step(flat[0])
                shown = settle_seams(texture.atlas, result, "auto", step, alpha=alpha)
                texture = texture._replace(atlas=shown)
            # Opacity may rise.
            out = written(texture._replace(alpha=-1), result, settings, keep)
            return out.reshape(given.shape)


def _bounds(sources: list[_Source]) -> tuple[np.float32, np.float32]:
    # The range of all known values, and at least that from black to white.
    least, most = np.float32(0.0), np.float32(1.0)
    for source in sources:
        known = source.values.reshape(-1, source.values.shape[2])
        known = known[source.confidence[: len(known)] > 0]
        least = min(least, known.min(initial=least))
        most = max(most, known.max(initial=most))
    return least, most


def _unknown_parts(space: TextureSpace, sources: list[_Source]) -> npt.NDArray[np.bool_]:
    # (rows, columns): connected parts of the surface in which no source knows any texel.
    parts = space.components[: space.labels.size]
    unknown = np.ones(int(parts.max(initial=-1)) + 2, dtype=np.bool_)
    unknown[-1] = False  # beside the charts
    for source in sources:
        unknown[parts[source.confidence[: len(parts)] > 0]] = False
    return unknown[parts].reshape(space.labels.shape)


def _stitched(
    space: TextureSpace,
    sources: list[_Source],
    labels: npt.ArrayLike | None,
    settings: StitchSettings,
) -> _Single:
    # Mixes the results for factors, which are offsets of logarithms, and for offsets, by how likely
    # each is.
    least, floor = _least_and_floor(sources)
    share = {"brightness": 1.0, "difference": 0.0}.get(settings.even_out)
    if settings.content != "values" or least < 0 or floor == 0:
        share = 0.0
    if share is None:
        share = _share_of_factors(space, sources, floor)
    _tell_choice(settings.even_out, share)
    if share == 0:
        return _by_offsets(space, sources, labels, settings)
    with phase(0.0, 1.0 if share == 1 else 0.5, "Stitching"):
        logarithms = [_logarithms(source, floor) for source in sources]
        stitched = np.exp(_by_offsets(space, logarithms, labels, settings))
        stitched = np.maximum(stitched - floor, np.float32(0.0))
    if share == 1:
        return stitched
    with phase(0.5, 1.0, "Stitching"):
        other = _by_offsets(space, sources, labels, settings)
    return other + np.float32(share) * (stitched - other)


def _tell_choice(even_out: str, share: float) -> None:
    if even_out == "brightness" and share == 0:
        tell("Factors of brightness need values above 0; differences were added instead.")
    elif even_out == "auto" and share == 0:
        tell("Even Out: Auto took differences, which are added.", even_out="difference")
    elif even_out == "auto" and share == 1:
        tell("Even Out: Auto took factors of brightness, which keep black.", even_out="brightness")
    elif even_out == "auto":
        tell(
            "Even Out: Auto took factors of brightness by {share:.0%}, and differences for the"
            " rest.",
            share=share,
            even_out="auto",
        )


def _by_offsets(
    space: TextureSpace,
    sources: list[_Source],
    labels: npt.ArrayLike | None,
    settings: StitchSettings,
) -> _Single:
    with phase(0.0, 0.3, "Comparing texels"):
        target = _target_of(space, sources, labels)
    with phase(0.3, 1.0, "Stitching"):
        return target.values + _solved(space, target, settings)


def _share_of_factors(space: TextureSpace, sources: list[_Source], floor: np.float32) -> float:
    flat = [source.values.reshape(-1, source.values.shape[2]) for source in sources]
    known = [source.confidence[: len(each)] > 0 for source, each in zip(sources, flat, strict=True)]
    return share_of_factors(space, flat, [s.corners for s in sources], known, float(floor))


def _least_and_floor(sources: list[_Source]) -> tuple[float, np.float32]:
    # The least known value, and a share of the mean of known ones.
    least, total, count = np.inf, 0.0, 0
    for source in sources:
        known = source.values.reshape(-1, source.values.shape[2])
        known = known[source.confidence[: len(known)] > 0]
        least = min(least, float(known.min(initial=np.inf)))
        total, count = total + float(known.sum(dtype=np.float64)), count + known.size
    return least, np.float32(_FLOOR * max(total, 0.0) / max(count, 1))


def _logarithms(source: _Source, floor: np.float32) -> _Source:
    # Unknown values may be below 0; they are not used.
    return source._replace(
        values=np.log(np.maximum(source.values, 0) + floor),
        corners=np.log(np.maximum(source.corners, 0.0) + floor),
    )


def _target_of(
    space: TextureSpace, sources: list[_Source], labels: npt.ArrayLike | None
) -> _Target:
    atlas, pieces = space.atlas, space.cut_cells.pieces
    nodes = atlas.sheet.nodes.size
    count = sources[0].values.shape[2]
    silent = _silent_pieces(space)
    total = CellWeights(np.zeros_like(space.alike.cells), np.zeros(len(silent)))
    believed = np.zeros((*atlas.sheet.nodes.shape, 1), dtype=np.float32)
    mean = np.zeros((*atlas.sheet.nodes.shape, count), dtype=np.float32)
    mean_corners = np.zeros((len(pieces.points), count))
    wanted = np.zeros((space.size, count), dtype=np.float32)
    least = [_least_known(space, source, labels if len(sources) == 1 else None)
             for source in sources]  # fmt: skip
    for source, weights in zip(sources, least, strict=True):
        total.cells[:] += weights.cells
        total.pieces[:] += weights.pieces
        at_nodes = source.confidence[:nodes].reshape(believed.shape)
        believed += at_nodes
        mean += at_nodes * source.values
    if not believed.any():
        raise InvalidSignal(
            "Nothing is known of any texel; give confidences, labels or opacity above 0 somewhere."
        )
    mean /= np.maximum(believed, np.float32(1e-30))
    for source, weights in zip(sources, least, strict=True):
        shares = CellWeights(_divided(weights.cells, total.cells).astype(np.float32),
                             _divided(weights.pieces, total.pieces))  # fmt: skip
        corners = np.nan_to_num(_with_surface(space, source))
        mean_corners += np.repeat(shares.pieces, np.diff(pieces.start))[:, None] * corners
        values = np.zeros((space.size, count), dtype=np.float32)
        values[:nodes] = source.values.reshape(nodes, count)
        wanted += space.apply_stiffness(values, shares, corners)
    unknown = np.repeat(total.pieces == 0, np.diff(pieces.start))
    mean_corners[unknown] = np.nan
    values = surface_values(space, mean, mean_corners)
    # They show nothing of their own, so the differences across them stay.
    own = CellWeights(np.zeros_like(total.cells), silent.astype(np.float64))
    wanted += space.apply_stiffness(values, own) - space.apply_stiffness(values)
    total.pieces[silent] = 1.0
    known = np.ones(space.size, dtype=np.bool_)
    known[:nodes] = believed.reshape(-1) > 0
    return _Target(values, wanted, total, known)


def _with_surface(space: TextureSpace, source: _Source) -> Floats:
    # Some points at seams are no unknowns but lie between others, so the surface differs a little
    # from the mean of their sides. Where no step stands out, the corners get these differences, so
    # that nothing changes there.
    points = space.cut_cells.pieces.points
    known = ~np.isnan(source.corners[:, 0])
    counts = np.maximum(np.bincount(points[known], minlength=len(space.cut_cells.kinds)), 1)
    sums = [np.bincount(points[known], column[known], len(counts)) for column in source.corners.T]
    means = np.stack(sums, axis=1) / counts[:, None]
    surface = space.at_corners(surface_values(space, source.values, source.corners))
    corners: Floats = source.corners + (1.0 - source.shares[:, None]) * (surface - means[points])
    return corners


def _at_all_points(space: TextureSpace, known: _Single) -> _Single:
    # The confidence of nodes, continued to the points along seams: pieces without a node need it.
    sheet = space.atlas.sheet
    values = known.reshape(*sheet.nodes.shape, 1).copy()
    ghosts = extend_ghosts(sheet, space.atlas.charts.labels, values, sheet.nodes >= 0)
    corners = np.clip(corner_values(space, values, ghosts), 0.0, 1.0)
    found: _Single = surface_values(space, values, corners)[:, 0]
    found[: len(known)] = known
    return found


def _silent_pieces(space: TextureSpace) -> npt.NDArray[np.bool_]:
    # Pieces of faces without area in the texture, or too far from all texels of their chart.
    pieces, sheet = space.cut_cells.pieces, space.atlas.sheet
    values = np.zeros((*sheet.nodes.shape, 1), dtype=np.float32)
    ghosts = extend_ghosts(sheet, space.atlas.charts.labels, values, sheet.nodes >= 0)
    silent = pieces.cells < 0
    silent[_pieces_of(space, np.isnan(corner_values(space, values, ghosts)[:, 0]))] = True
    return silent


def _pieces_of(space: TextureSpace, corners: npt.NDArray[np.bool_]) -> npt.NDArray[np.intp]:
    start = space.cut_cells.pieces.start
    return np.repeat(np.arange(len(start) - 1), np.diff(start))[corners]


def _source(
    space: TextureSpace,
    texture: Texture,
    picture: npt.NDArray,
    trust: npt.NDArray | None,
    opacity: _Single,
    same_material: bool,
) -> _Source:
    # `opacity` becomes the largest of all sources.
    atlas, alpha = space.atlas, texture.alpha
    values = values_of(atlas, picture, alpha, texture.frames)
    known = (atlas.sheet.nodes.reshape(-1) >= 0).astype(np.float32)
    if trust is not None:
        known *= atlas.gather(trust[..., None]).reshape(-1)
    if alpha >= 0:
        known *= values[..., alpha].reshape(-1)
        np.maximum(opacity, values[..., alpha], out=opacity)
        values = np.ascontiguousarray(np.delete(values, alpha, axis=2))
    confidence = _at_all_points(space, known)
    believed = (atlas.sheet.nodes >= 0) & (known.reshape(atlas.sheet.nodes.shape) > 0)
    ghosts = extend_ghosts(atlas.sheet, atlas.charts.labels, values, believed)
    rough = roughness_of_values(atlas, values, believed, across=False)
    rough[(atlas.sheet.nodes >= 0) & ~believed] = np.nan
    missing = np.where((atlas.sheet.nodes >= 0) & ~believed, np.float32(np.nan), np.float32(0.0))
    whole = ~np.isnan(corner_values(space, missing[..., None], ghosts)[:, 0])
    corners = corner_values(space, values, ghosts)
    corners, shares = clear_steps(space, corners, rough, whole, same_material)
    return _Source(values, corners, shares, confidence)


def _least_known(space: TextureSpace, source: _Source, labels: npt.ArrayLike | None) -> CellWeights:
    # The confidence of each cell and piece: 0 if one of its nodes, or corners, is unknown.
    least = space.least(source.confidence)
    least.pieces[_pieces_of(space, np.isnan(source.corners[:, 0]))] = 0.0
    if labels is not None:
        areas = np.zeros(space.size, dtype=np.float32)
        ranks = np.unique(labels, return_inverse=True)[1].reshape(np.shape(labels))
        numbers = space.atlas.gather(ranks.astype(np.float32)[..., None])
        areas[: numbers.size] = numbers.reshape(-1)
        one, other = space.least(areas), space.least(-areas)
        least.cells[one.cells != -other.cells] = 0.0
        least.pieces[one.pieces != -other.pieces] = 0.0
    return least


def _divided(part: npt.NDArray, whole: npt.NDArray) -> npt.NDArray:
    return part / np.where(whole > 0, whole, 1.0)


def _solved(space: TextureSpace, target: _Target, settings: StitchSettings) -> _Single:
    # The correction of the target's values.
    largest = max(float(target.confidence.cells.max(initial=0.0)),
                  float(target.confidence.pieces.max(initial=0.0)), 1e-30)  # fmt: skip
    cells = np.maximum(target.confidence.cells / np.float32(largest), np.float32(_UNKNOWN))
    held = CellWeights(cells, np.maximum(target.confidence.pieces / largest, _UNKNOWN))
    screen = settings.radius**-2.0
    if settings.where == "seams":
        held.cells[target.confidence.cells > 0] = np.float32(_HELD / screen)
    matrix = space.weighted(held, only_mass=True).matrix(screen)
    change = np.zeros_like(target.values)
    left = matrix
    if settings.where == "seams" and not _some_unknown(space, target):
        # Only the seams are left. Beside unknown texels coarse levels need the held ones.
        left = without_held(matrix, _held_nodes(space, target))
    SheetSolver(left).solve(target.unbalance, change, _TOLERANCE, message="Stitching")
    # The exact change has a mean of 0. An error of the mean hardly shows in the residual.
    space.without_means(change, matrix.screen, change)
    if settings.where == "seams":
        free = ~target.known
        free[space.cut_cells.unknowns] = True
        change[~free] = 0.0
    return change


def _held_nodes(space: TextureSpace, target: _Target) -> npt.NDArray[np.bool_]:
    # (rows, columns): the corners of uncut cells in which all is known.
    cells = (target.confidence.cells > 0) & (space.cells[..., 3] > 0)
    nodes = cells.copy()
    nodes[1:] |= cells[:-1]
    nodes[:, 1:] |= cells[:, :-1]
    nodes[1:, 1:] |= cells[:-1, :-1]
    return nodes


def _some_unknown(space: TextureSpace, target: _Target) -> bool:
    # Whether something is unknown in uncut cells.
    unknown = (target.confidence.cells == 0) & (space.cells[..., 3] > 0)
    return bool(unknown.any())


def _checked_images(images: npt.ArrayLike | Sequence[npt.ArrayLike]) -> list[npt.NDArray]:
    if isinstance(images, np.ndarray) and images.ndim < 4:
        images = [images]
    if not isinstance(images, np.ndarray | Sequence):
        raise InvalidSignal("The images are no array and no list of arrays; give at least one.")
    pictures = [checked_image(image, LARGEST) for image in images]
    if not pictures:
        raise InvalidSignal("There is no image; give at least one.")
    for number, picture in enumerate(pictures):
        if picture.shape != pictures[0].shape or picture.dtype != pictures[0].dtype:
            raise InvalidSignal(
                f"Image {number + 1} is {picture.shape} of {picture.dtype}, the first one"
                f" {pictures[0].shape} of {pictures[0].dtype}; give images of one size and type."
            )
    return pictures


def _checked_confidences(
    confidences: Sequence[npt.ArrayLike] | None,
    labels: npt.ArrayLike | None,
    pictures: list[npt.NDArray],
) -> list[npt.NDArray | None]:
    shape, count = pictures[0].shape[:2], len(pictures)
    if labels is not None:
        if confidences is not None:
            raise InvalidSignal("There are confidences and labels; give one of them.")
        numbers = as_array(labels, "labels")
        if numbers.shape != shape or numbers.dtype.kind not in "iub":
            raise InvalidSignal(
                f"The labels are {numbers.shape} of {numbers.dtype}; give whole numbers {shape}."
            )
        if count > 1 and numbers.max() >= count:
            raise InvalidSignal(
                f"A label is {numbers.max()}, but there are {count} images; count from 0."
            )
        if count == 1:
            return [(numbers >= 0).astype(np.float64)]
        return [(numbers == number).astype(np.float64) for number in range(count)]
    if confidences is None:
        return [None] * count
    is_row = isinstance(confidences, np.ndarray) and confidences.ndim > 0
    if not is_row and not isinstance(confidences, Sequence):
        raise InvalidSignal("The confidences are no list of arrays; give one for each image.")
    given = [as_array(one, "confidence") for one in confidences]
    if len(given) != count:
        raise InvalidSignal(f"There are {len(given)} confidences for {count} images.")
    for one in given:
        if one.shape != shape:
            raise InvalidSignal(f"A confidence has the shape {one.shape}; give {shape}.")
        if one.dtype.kind not in "bfiu" or not np.isfinite(one).all() or one.min() < 0:
            raise InvalidSignal("A confidence is negative, NaN or no number; give values from 0.")
    largest = max(max(float(one.max()) for one in given), 1e-30)
    return [one.astype(np.float64) / largest for one in given]
