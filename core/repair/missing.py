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
from .blocks import compression_of

Bools = npt.NDArray[np.bool_]

_BLACK = 2.5 / 255
"""Largest value of black, to allow for rounding and light compression."""

_RUN_IN = 14 / 255
"""Largest mean of channels that counts as black in strongly compressed pictures, where colors from
around bleed into black."""

_NEAR, _FAR = 3, 10
"""Width in texels of the rim inside a group of black faces that is tested for bright texels, and
distance up to which the surroundings are measured."""

_RINGS = 4
"""Distance in texels that colors bleed in compressed pictures: texels within it around unseen faces
are filled too, and texels farther inside a group are unaffected."""

_DEEP = 2.0 / 255
"""Largest mean value of the unaffected texels: black paint is hardly ever as dark."""

_APART = 0.004
"""Largest share of bright texels in the rim of an unseen group, per texel of a face's diameter. In
black paint, whose borders do not follow edges, it is at least three times as large."""

_RESOLVED = 10.0
"""Least mean number of texels per face for this test."""

_STRAY = 0.15
"""Share of black texels in the faces around a group of black faces above which it is painted."""

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
        Its `find` says how missing texels are found if `missing` is None.

    Raises
    ------
    InvalidSignal
        If `missing` does not fit the image.
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
    found = unseen_texels(atlas, pixels, alpha)
    further = unseen_in_compressed(atlas, pixels, alpha) & ~found
    if further.any() and compression_of(pixels) is not None:
        found |= further
    return found


def _of_color(pixels: npt.NDArray, color: npt.NDArray, alpha: int) -> Bools:
    count = pixels.shape[2]
    if len(color) not in (count, count - (alpha >= 0)) or color.dtype.kind not in "iuf":
        raise InvalidSignal(
            f"The missing color has {len(color)} values; give a mask, or as many as the image has"
            f" channels, {count}."
        )
    step = 0.5 if pixels.dtype.kind == "u" else 1e-6 * np.maximum(np.abs(color), 1.0)
    off = np.abs(pixels[..., : len(color)].astype(np.float64) - color)
    return (off <= step).all(axis=2)


def unseen_texels(atlas: TextureAtlas, pixels: npt.NDArray, alpha: int = -1) -> Bools:
    """Find the texels of faces that no photo has seen: groups of wholly black faces.

    The borders of black paint do not follow edges, so a group counts only if few of the texels of
    the faces beside it are black.

    Parameters
    ----------
    atlas : TextureAtlas
    pixels : (h, w, c) array
    alpha : int
        The channel of opacity, which is ignored; -1: none.
    """
    colors = pixels if alpha < 0 else np.delete(pixels, alpha, axis=2)
    black = (colors <= _BLACK / SCALES[pixels.dtype.name]).all(axis=2)
    groups, texels, dark = _dark_groups(atlas, black, 1.0)
    total = int(groups.max(initial=-1)) + 1
    face = atlas.masks().face
    if total == 0:
        return np.zeros(face.shape, dtype=np.bool_)
    size = np.bincount(groups[groups >= 0], weights=texels[groups >= 0], minlength=total)
    # The number of texels of faces across the outline of each group, and of black ones among them.
    twins = atlas.mesh.twins.reshape(-1)
    edges = np.flatnonzero((twins >= 0) & np.repeat(groups >= 0, 3))
    edges = edges[groups[twins[edges] // 3] < 0]
    others, group = twins[edges] // 3, groups[edges // 3]
    around = np.bincount(group, texels[others], total)
    stray = np.bincount(group, dark[others], total)
    return _shown(atlas, groups, (size >= _FEWEST) & (stray <= _STRAY * around))


def unseen_in_compressed(atlas: TextureAtlas, pixels: npt.NDArray, alpha: int = -1) -> Bools:
    """Find the same in pictures whose compression, as by JPEG, made colors bleed into the black.

    A group counts if it is black deep inside, and if the dark area ends at its outline. Groups
    whose faces have few texels cannot be tested, and do not count.

    Parameters
    ----------
    atlas, pixels, alpha
        As in `unseen_texels`.
    """
    colors = pixels if alpha < 0 else np.delete(pixels, alpha, axis=2)
    # The mean of channels is used, because color bleeds farther than brightness.
    means = colors.mean(axis=2, dtype=np.float32) * np.float32(SCALES[pixels.dtype.name])
    groups, texels, _ = _dark_groups(atlas, means <= _RUN_IN, 0.5)
    total = int(groups.max(initial=-1)) + 1
    face = atlas.masks().face
    if total == 0:
        return np.zeros(face.shape, dtype=np.bool_)
    label = np.where(face >= 0, groups[np.maximum(face, 0)], np.int32(-1))
    rows, columns = _around(label >= 0, _FAR)
    small, means, shown = label[rows, columns], means[rows, columns], face[rows, columns] >= 0
    near = _grown(small, _NEAR)
    ringed = _grown(near, _RINGS - _NEAR)
    far = _grown(ringed, _FAR - _RINGS)
    beside = (far >= 0) & (ringed < 0) & shown
    deep = (small >= 0) & ~widened(small < 0, _RINGS)
    inner = (small >= 0) & widened((small < 0) & shown, _NEAR)

    def count(labels: Ints, which: Bools, values: npt.NDArray | None = None) -> npt.NDArray:
        of = None if values is None else values[which]
        return np.bincount(labels[which], of, total)

    outside = count(far, beside, means) / np.maximum(count(far, beside), 1)
    inside = count(small, deep, means) / np.maximum(count(small, deep), 1)
    bright = means > 0.5 * outside[np.maximum(small, 0)]
    wrong = count(small, inner & bright) / np.maximum(count(small, inner), 1)
    of_faces = groups[groups >= 0]
    size = np.bincount(of_faces, texels[groups >= 0], total) / np.bincount(of_faces, None, total)
    found = (count(small, deep) >= _FEWEST) & (count(far, beside) >= _FEWEST) & (inside <= _DEEP)
    found &= (size >= _RESOLVED) & (wrong <= _APART * np.sqrt(2 * size))
    marked = _shown(atlas, groups, found)
    return marked | (widened(marked, _RINGS) & (face >= 0))


def _dark_groups(
    atlas: TextureAtlas, black: Bools, share: float
) -> tuple[Ints, npt.NDArray, npt.NDArray]:
    # Groups of faces with at least a share of black texels; the number of texels and of black
    # texels of each face.
    face = atlas.masks().face
    shown = face >= 0
    count = len(atlas.mesh.faces)
    texels = np.bincount(face[shown], minlength=count)
    dark = np.bincount(face[shown & black], minlength=count)
    # Texels on the border of a face may have the color of another face.
    unseen = (texels > 0) & (dark >= share * texels - 0.1 * np.sqrt(texels))
    return _groups(atlas, unseen | ((texels == 0) & _beside(atlas, unseen))), texels, dark


def _shown(atlas: TextureAtlas, groups: Ints, found: Bools) -> Bools:
    # The texels of the groups that were found; also those read by charts too small for own texels.
    of_face = np.append((groups >= 0) & found[np.maximum(groups, 0)], False)
    result: Bools = of_face[np.maximum(atlas.masks().face, atlas.lone)]
    return result


def _around(marked: Bools, margin: int) -> tuple[slice, slice]:
    # The rows and columns that contain all marked texels, with a margin.
    lines = (np.flatnonzero(marked.any(axis=1 - axis)) for axis in (0, 1))
    first, second = (slice(max(int(n[0]) - margin, 0), int(n[-1]) + margin + 1) for n in lines)
    return first, second


def _grown(labels: Ints, rings: int) -> Ints:
    # Extends labels to texels without one, -1, around them.
    for _ in range(rings):
        wide = labels.copy()
        np.maximum(wide[1:], labels[:-1], out=wide[1:])
        np.maximum(wide[:-1], labels[1:], out=wide[:-1])
        both = wide.copy()
        np.maximum(both[:, 1:], wide[:, :-1], out=both[:, 1:])
        np.maximum(both[:, :-1], wide[:, 1:], out=both[:, :-1])
        labels = np.where(labels >= 0, labels, both)
    return labels


def widened(marked: Bools, rings: int) -> Bools:
    """Mark also the texels within some rings around marked ones."""
    for _ in range(rings):
        wide = marked.copy()
        wide[1:] |= marked[:-1]
        wide[:-1] |= marked[1:]
        marked = wide.copy()
        marked[:, 1:] |= wide[:, :-1]
        marked[:, :-1] |= wide[:, 1:]
    return marked


def _beside(atlas: TextureAtlas, faces: Bools) -> Bools:
    # Faces that share an edge with one of the given faces.
    twins = atlas.mesh.twins.reshape(-1, 3)
    return (faces[np.maximum(twins, 0) // 3] & (twins >= 0)).any(axis=1)


def _groups(atlas: TextureAtlas, faces: Bools) -> Ints:
    # Labels of the connected groups of the marked faces; -1 for other faces.
    twins = atlas.mesh.twins.reshape(-1)
    edges = np.flatnonzero((twins >= 0) & np.repeat(faces, 3))
    edges = edges[faces[twins[edges] // 3]]
    of, to = (edges // 3).astype(np.int32), (twins[edges] // 3).astype(np.int32)
    _, parts = connected_components(len(faces), of, to)
    result = np.full(len(faces), -1, dtype=np.int32)
    result[faces] = np.unique(parts[faces], return_inverse=True)[1].reshape(-1)
    return result
