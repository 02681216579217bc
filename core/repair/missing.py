# SPDX-License-Identifier: GPL-3.0-or-later
"""Which texels of a texture are missing: given, transparent, of one color, or never seen."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..base.checks import SCALES, as_array, checked_weights
from ..errors import InvalidSignal
from ..mesh.triangle_mesh import Ints
from ..settings import FillSettings
from ..sparse.components import connected_components

Bools = npt.NDArray[np.bool_]

_BLACK = 2.5 / 255
"""Values up to this are black, though bytes were rounded and compressed."""

_RUN_IN = 14 / 255
"""Means of channels up to this are black where a picture was compressed until blocks were seen."""

_LEFT = 0.5
"""Least share of black texels in each unseen face there, and of truly black ones in all."""

_RINGS = 4
"""Texels around unseen faces that are filled, too, there, as black has run into them."""

_STRAY_THERE = 0.3
"""As `_STRAY`, there."""

_STRAY = 0.15
"""Share of black texels in the faces around a group of black ones from which it is painted."""

_FEWEST = 16
"""Fewest texels of a group of faces that may be missing."""


def missing_texels(
    atlas: TextureAtlas,
    pixels: npt.NDArray,
    alpha: int,
    missing: npt.ArrayLike | None,
    settings: FillSettings,
) -> npt.NDArray[np.float64]:
    """Return how far each texel is to be replaced: (h, w) float64 in [0, 1].

    Parameters
    ----------
    atlas : TextureAtlas
    pixels : (h, w, c) array
    alpha : int
        The channel of opacity; -1: none.
    missing
        As in `fill_texture`.
    settings : FillSettings
        Its `find` says what counts if nothing is given.

    Raises
    ------
    InvalidSignal
        If what is given does not fit.
    """
    weights: npt.NDArray | None = None
    if missing is not None:
        given = as_array(missing, "missing")
        if given.ndim == 1:
            weights = _of_color(pixels, given, alpha).astype(np.float64)
        else:
            weights = checked_weights(given, pixels)
            weights = np.ones(pixels.shape[:2]) if weights is None else weights
        if settings.find == "auto":
            return weights
    found = _found(atlas, pixels, alpha, settings.find)
    return found.astype(np.float64) if weights is None else found * weights


def _found(atlas: TextureAtlas, pixels: npt.NDArray, alpha: int, find: str) -> Bools:
    if find != "unseen" and alpha >= 0:
        clear = pixels[..., alpha] <= 0
        if find == "opacity" or (clear & atlas.inside).any():
            return clear
    if find == "opacity":  # and there is none
        return np.zeros(pixels.shape[:2], dtype=np.bool_)
    return unseen_texels(atlas, pixels, alpha)


def _of_color(pixels: npt.NDArray, color: npt.NDArray, alpha: int) -> Bools:
    count = pixels.shape[2]
    if len(color) not in (count, count - (alpha >= 0)) or color.dtype.kind not in "iuf":
        raise InvalidSignal(
            f"The missing color has {len(color)} values; give a mask, or as many as the image has"
            f" channels, {count}."
        )
    step = 0.5 if pixels.dtype.kind == "u" else 1e-6
    off = np.abs(pixels[..., : len(color)].astype(np.float64) - color)
    return (off <= step).all(axis=2)


def unseen_texels(
    atlas: TextureAtlas, pixels: npt.NDArray, alpha: int = -1, *, was_compressed: bool = False
) -> Bools:
    """Find the texels of faces that no photo saw: groups of faces that are black all over.

    What is painted black does not end where faces do: a group counts only if few of the texels
    beside it are black.

    Parameters
    ----------
    atlas : TextureAtlas
    pixels : (h, w, c) array
    alpha : int
        The channel of opacity, which does not matter; -1: none.
    was_compressed : bool
        Whether compression, as JPEG does, lets colors from around run into what was black.
    """
    colors = pixels if alpha < 0 else np.delete(pixels, alpha, axis=2)
    white = 1.0 / SCALES[pixels.dtype.name]
    truly = (colors <= _BLACK * white).all(axis=2)
    share, most, left = 1.0, _STRAY, 0.0
    if was_compressed:  # color runs farther than brightness
        means = colors.mean(axis=2, dtype=np.float32)
        black = means <= _RUN_IN * white
        share, most, left = _LEFT, _STRAY_THERE, _LEFT
    else:
        black = truly
    masks = atlas.masks()
    face = masks.face
    shown = face >= 0
    count = len(atlas.mesh.faces)
    texels = np.bincount(face[shown], minlength=count)
    dark = np.bincount(face[shown & black], minlength=count)
    # Texels on a face's border may show another face's color.
    unseen = (texels > 0) & (dark >= share * texels - 0.1 * np.sqrt(texels))
    groups = _groups(atlas, unseen | ((texels == 0) & _beside(atlas, unseen)))
    total = int(groups.max(initial=-1)) + 1
    if total == 0:
        return np.zeros(face.shape, dtype=np.bool_)
    size = np.bincount(groups[groups >= 0], weights=texels[groups >= 0], minlength=total)
    # Texels of faces across the group's outline, and the black ones among them.
    twins = atlas.mesh.twins.reshape(-1)
    edges = np.flatnonzero((twins >= 0) & np.repeat(groups >= 0, 3))
    edges = edges[groups[twins[edges] // 3] < 0]
    others, group = twins[edges] // 3, groups[edges // 3]
    around = np.bincount(group, texels[others], total)
    stray = np.bincount(group, dark[others], total)
    core = np.bincount(groups[face[shown & truly]] + 1, minlength=total + 1)[1:]
    found = (size >= _FEWEST) & (stray <= most * around) & (core >= left * size)
    of_face = np.zeros(count, dtype=np.bool_)
    of_face[groups >= 0] = found[groups[groups >= 0]]
    result = np.zeros(face.shape, dtype=np.bool_)
    result[shown] = of_face[face[shown]]
    return widened(result, _RINGS) & shown if was_compressed else result


def widened(marked: Bools, rings: int) -> Bools:
    """Mark texels within some rings of neighbors of marked ones, too."""
    for _ in range(rings):
        wide = marked.copy()
        wide[1:] |= marked[:-1]
        wide[:-1] |= marked[1:]
        marked = wide.copy()
        marked[:, 1:] |= wide[:, :-1]
        marked[:, :-1] |= wide[:, 1:]
    return marked


def _beside(atlas: TextureAtlas, faces: Bools) -> Bools:
    # Faces that share an edge with one of these.
    twins = atlas.mesh.twins.reshape(-1, 3)
    return (faces[np.maximum(twins, 0) // 3] & (twins >= 0)).any(axis=1)


def _groups(atlas: TextureAtlas, faces: Bools) -> Ints:
    # Numbers of connected groups of the marked faces; -1 for others.
    twins = atlas.mesh.twins.reshape(-1)
    edges = np.flatnonzero((twins >= 0) & np.repeat(faces, 3))
    edges = edges[faces[twins[edges] // 3]]
    of, to = (edges // 3).astype(np.int32), (twins[edges] // 3).astype(np.int32)
    _, parts = connected_components(len(faces), of, to)
    result = np.full(len(faces), -1, dtype=np.int32)
    result[faces] = np.unique(parts[faces], return_inverse=True)[1].reshape(-1)
    return result
