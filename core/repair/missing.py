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
"""Values up to this are black, though bytes were rounded and compressed."""

_RUN_IN = 14 / 255
"""Means of channels up to this are black where a picture was compressed until blocks were seen."""

_NEAR, _FAR = 3, 10
"""Texels within which a group is compared with what is dark, and with what lies around it."""

_RINGS = 4
"""Texels around unseen faces that are filled, too, where a picture was compressed, as black has run
into them; and how far inside a group nothing else has run in."""

_DEEP = 2.0 / 255
"""Most mean value there: black paint is hardly ever as dark."""

_APART = 0.004
"""Share of bright texels inside a group's outline, for each texel of a face's diameter, up to which
what is dark ends where faces do: in black paint it is three times as much or more."""

_RESOLVED = 10.0
"""Least texels of a face at which that can be told."""

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
    """Find the texels of faces that no photo saw: groups of faces that are black all over.

    What is painted black does not end where faces do: a group counts only if few of the texels
    beside it are black.

    Parameters
    ----------
    atlas : TextureAtlas
    pixels : (h, w, c) array
    alpha : int
        The channel of opacity, which does not matter; -1: none.
    """
    colors = pixels if alpha < 0 else np.delete(pixels, alpha, axis=2)
    black = (colors <= _BLACK / SCALES[pixels.dtype.name]).all(axis=2)
    groups, texels, dark = _dark_groups(atlas, black, 1.0)
    total = int(groups.max(initial=-1)) + 1
    face = atlas.masks().face
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
    return _shown(atlas, groups, (size >= _FEWEST) & (stray <= _STRAY * around))


def unseen_in_compressed(atlas: TextureAtlas, pixels: npt.NDArray, alpha: int = -1) -> Bools:
    """Find the same where compression, as JPEG does, let colors from around run into the black.

    A group counts if it is black deep inside, and if what is dark ends at its outline. Faces of few
    texels cannot tell: there nothing is found.

    Parameters
    ----------
    atlas, pixels, alpha
        As in `unseen_texels`.
    """
    colors = pixels if alpha < 0 else np.delete(pixels, alpha, axis=2)
    # Color runs farther than brightness.
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
    # Groups of faces of which at least a share is black; texels of faces, and black ones of these.
    face = atlas.masks().face
    shown = face >= 0
    count = len(atlas.mesh.faces)
    texels = np.bincount(face[shown], minlength=count)
    dark = np.bincount(face[shown & black], minlength=count)
    # Texels on a face's border may show another face's color.
    unseen = (texels > 0) & (dark >= share * texels - 0.1 * np.sqrt(texels))
    return _groups(atlas, unseen | ((texels == 0) & _beside(atlas, unseen))), texels, dark


def _shown(atlas: TextureAtlas, groups: Ints, found: Bools) -> Bools:
    # The texels of the groups that were found; also where a chart is too small to show any.
    of_face = np.append((groups >= 0) & found[np.maximum(groups, 0)], False)
    result: Bools = of_face[np.maximum(atlas.masks().face, atlas.lone)]
    return result


def _around(marked: Bools, margin: int) -> tuple[slice, slice]:
    # The rows and columns that hold what is marked, with a margin.
    lines = (np.flatnonzero(marked.any(axis=1 - axis)) for axis in (0, 1))
    first, second = (slice(max(int(n[0]) - margin, 0), int(n[-1]) + margin + 1) for n in lines)
    return first, second


def _grown(labels: Ints, rings: int) -> Ints:
    # Labels of texels without one, -1, from those around.
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
