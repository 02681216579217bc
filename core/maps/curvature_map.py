# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps of curvature in a texture, across seams."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..base.checks import Floats, by_keyword, checked_size
from ..base.parallel import kernel, run
from ..base.progress import ProgressCallback, ask, phase, reporting
from ..mesh.curvature import Curvatures, curvatures_of
from ..mesh.jets import Frames, radii_of
from ..mesh.triangle_mesh import TriangleMesh, check_mesh
from ..settings import CurvatureSettings, given_or_default
from .drawing import atlas_for, drawn_smoothly, with_gutter

_Single = npt.NDArray[np.float32]

_FINDING = "Finding curvature"

_SHOWN = 0.98
"""Share of the texels whose values are within the automatic range of grays."""

_LEAST_RANGE = 1e-3
"""Least range of grays, in 1 / size of the mesh, so that a plane is uniformly gray."""


@by_keyword
def curvature_map(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    settings: CurvatureSettings | None = None,
    *,
    size: tuple[int, int],
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
) -> _Single:
    """Draw the curvature of a surface into a texture, without facets and across seams.

    Parameters
    ----------
    mesh, uv, progress, atlas
        As in `sharpen_texture`.
    settings : CurvatureSettings, optional
    size : (int, int)
        Rows and columns of the image.

    Returns
    -------
    (h, w) float32
        In 1 / unit of the mesh (Gaussian curvature: its square), convex positive; or grays in
        [0, 1], see `CurvatureSettings.look`. The gutter around the charts is filled; the rest is 0.

    Raises
    ------
    InvalidUV, Cancelled
        As in `sharpen_texture`.
    InvalidSettings
        If the size cannot be used.

    Notes
    -----
    Curvatures at the vertices, see `curvature`, are interpolated by cubics with the gradients at
    the vertices. There is no detail between vertices: a box of twelve triangles has only corners,
    and must be subdivided first.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> x, y = np.meshgrid(np.linspace(-1, 1, 33), np.linspace(-1, 1, 33), indexing="ij")
    >>> vertices = np.stack([x, y, np.sqrt(4 - x * x)], axis=-1).reshape(-1, 3)
    >>> a = np.arange(32 * 33).reshape(32, 33)[:, :32].reshape(-1)
    >>> faces = np.concatenate([np.stack([a, a + 33, a + 34], 1), np.stack([a, a + 34, a + 1], 1)])
    >>> mesh = core.TriangleMesh(vertices, faces)
    >>> uv = 0.5 + 0.5 * mesh.vertices[mesh.faces][..., :2]
    >>> image = core.curvature_map(mesh, uv, size=(64, 64))  # a cylinder of radius 2
    >>> bool(np.allclose(image[20:44, 20:44], 0.25, atol=1e-3))
    True
    """
    settings = given_or_default(settings, CurvatureSettings)
    with reporting(progress):
        image = _drawn(
            *(mesh, uv, size, settings, atlas),
            lambda found: _signal(found, settings.kind)[:, None],
            lambda sheet, used: _shown(sheet, used, settings),
        )[..., 0]
        return image if settings.look == "curvature" else np.clip(image, 0.0, 1.0)


@by_keyword
def curvature_directions(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    settings: CurvatureSettings | None = None,
    *,
    size: tuple[int, int],
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
) -> _Single:
    """Draw the direction in which a surface bends most into a texture, across seams.

    Parameters
    ----------
    mesh, uv, progress, atlas, size
        As in `curvature_map`.
    settings : CurvatureSettings, optional
        Only radius and gutter are used.

    Returns
    -------
    (h, w, 3) float32
        Vectors along the surface in the mesh's own axes, of the principal curvature of larger
        magnitude. Their signs do not matter, and may change from texel to texel. The length is 1
        on a cylinder and 0 where the surface bends equally in all directions. The gutter is filled;
        the rest is 0.

    Raises
    ------
    InvalidUV, InvalidSettings, Cancelled
        As in `curvature_map`.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> x, y = np.meshgrid(np.linspace(-1, 1, 33), np.linspace(-1, 1, 33), indexing="ij")
    >>> vertices = np.stack([x, y, np.sqrt(4 - x * x)], axis=-1).reshape(-1, 3)
    >>> a = np.arange(32 * 33).reshape(32, 33)[:, :32].reshape(-1)
    >>> faces = np.concatenate([np.stack([a, a + 33, a + 34], 1), np.stack([a, a + 34, a + 1], 1)])
    >>> mesh = core.TriangleMesh(vertices, faces)
    >>> uv = 0.5 + 0.5 * mesh.vertices[mesh.faces][..., :2]
    >>> vectors = core.curvature_directions(mesh, uv, size=(64, 64))
    >>> bool(abs(vectors[32, 32, 0]) > 0.99)  # round the cylinder
    True
    """
    settings = given_or_default(settings, CurvatureSettings)
    with reporting(progress):
        drawn = _drawn(*(mesh, uv, size, settings, atlas), _tensors)
        out = np.zeros((*drawn.shape[:2], 3), dtype=np.float32)
        run(_longest, len(out), drawn, out)
        return out


def _drawn(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    size: tuple[int, int],
    settings: CurvatureSettings,
    atlas: TextureAtlas | None,
    signals: Callable[[Curvatures], Floats],
    shown: Callable[[_Single, TextureAtlas], _Single] = lambda sheet, _: sheet,
) -> _Single:
    # The image (h, w, c) of signals (n, c) of the curvatures, after they are drawn on the sheet.
    shape = checked_size(size)
    check_mesh(mesh)
    with phase(0.0, 0.3, "Finding texels"):
        found = atlas_for(atlas, mesh, uv, shape)
    with phase(0.3, 0.6, _FINDING):
        frames, radii = Frames(mesh), radii_of(mesh, settings.radius)
        values = signals(curvatures_of(mesh, frames, radii))
    with phase(0.6, 0.8, "Drawing"):
        sheet = shown(drawn_smoothly(found, frames, radii, values), found)
    with phase(0.8, 1.0, "Filling the gutter"):
        return with_gutter(found, sheet, settings.gutter)


def _signal(found: Curvatures, kind: str) -> Floats:
    if kind == "mean":
        return found.mean
    if kind == "gaussian":
        return found.gaussian
    return found.principal[:, 1] if kind == "convex" else -found.principal[:, 0]


def _tensors(found: Curvatures) -> Floats:
    # The tensor d d^T of the larger curvature, times the difference of magnitudes: six entries.
    size = np.abs(found.principal)
    larger = np.argmax(size, axis=1)
    along = found.directions[np.arange(len(larger)), larger]
    least, most = found.principal.T
    greatest = np.maximum(size.max(axis=1), 1e-300)
    # The difference of magnitudes: 0 on saddles that bend equally both ways, as on spheres.
    clear = (np.minimum(most - least, np.abs(most + least)) / greatest)[:, None]
    x, y, z = along.T
    return clear * np.stack([x * x, x * y, x * z, y * y, y * z, z * z], axis=1)


def _shown(values: _Single, atlas: TextureAtlas, settings: CurvatureSettings) -> _Single:
    # Values at the nodes of the sheet.
    is_sided = settings.kind in ("convex", "cavity")
    if is_sided:
        values = np.maximum(values, np.float32(0.0))
    if settings.look == "curvature":
        return values
    ask()
    scale = settings.white or _usual(values[atlas.sheet.nodes >= 0], atlas.mesh, settings.kind)
    grays = values.astype(np.float64) / scale
    grays = grays if is_sided else 0.5 + 0.5 * grays
    return np.clip(grays, 0.0, 1.0).astype(np.float32)


def _usual(values: _Single, mesh: TriangleMesh, kind: str) -> float:
    low, high = mesh.box
    least = _LEAST_RANGE / float((high - low).max())
    found = float(np.quantile(np.abs(values), _SHOWN)) if values.size else 0.0
    return max(found, least**2 if kind == "gaussian" else least)


@kernel
def _longest(start, stop, tensors, out):
    # The eigenvector of the largest eigenvalue of each tensor, of that length, by squaring.
    columns = tensors.shape[1]
    matrix, square = np.empty((3, 3)), np.empty((3, 3))
    for y in range(start, stop):
        for x in range(columns):
            t = tensors[y, x]
            trace = t[0] + t[3] + t[5]
            largest = 0.0
            for i in range(6):
                largest = max(largest, abs(t[i]))
            if largest <= 1e-30:
                continue
            matrix[0, 0], matrix[1, 1], matrix[2, 2] = t[0], t[3], t[5]
            matrix[0, 1], matrix[0, 2], matrix[1, 2] = t[1], t[2], t[4]
            matrix[1, 0], matrix[2, 0], matrix[2, 1] = t[1], t[2], t[4]
            for _ in range(6):  # the 64th power
                greatest = 0.0
                for i in range(3):
                    for j in range(3):
                        total = 0.0
                        for k in range(3):
                            total += matrix[i, k] * matrix[k, j]
                        square[i, j] = total
                        greatest = max(greatest, abs(total))
                for i in range(3):
                    for j in range(3):
                        matrix[i, j] = square[i, j] / greatest
            best = 0
            for k in range(1, 3):
                if matrix[k, k] > matrix[best, best]:
                    best = k
            length = np.sqrt(matrix[best, 0] ** 2 + matrix[best, 1] ** 2 + matrix[best, 2] ** 2)
            clear = min(max(trace, 0.0), 1.0)
            for k in range(3):
                out[y, x, k] = clear * matrix[best, k] / length
