# SPDX-License-Identifier: GPL-3.0-or-later
"""A patch of a large surface, for previews."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import InvalidMesh
from ..host.inputs import ColoredSurface, MirroredSurface, PaintedSurface, Surface
from ..settings import ShockSettings, describe

_REACH = 12.0
_SAMPLE = 200_000


def _no_borders(what: str) -> float:
    return 0.0


@dataclass(frozen=True)
class Patch:
    """A part of a surface, or all of it.

    Attributes
    ----------
    surface : Surface or PaintedSurface
        The part. Vertices at its border are masked, so that they stay.
    whole : callable
        Converts the result for the part to that for the whole surface.
    lengths : float
        Mean edge length of the whole surface, relative to that of the part.
    share : float
        Fraction of the triangles.
    outline : (n, 2, 3) array of float
        Ends of the edges at the border of the part, in the object's space; empty for all of it.
    width : callable
        Measures the borders between colors on the whole surface; see `colors.width_of_borders`.
    """

    surface: Any
    whole: Callable[[Any], Any]
    lengths: float
    share: float
    outline: npt.NDArray[np.float32]
    width: Callable[[str], float] = _no_borders

    def settings(self, settings: Any) -> Any:
        """Convert settings for the whole surface to the part's units of length."""
        if self.share == 1.0:
            return settings
        settings = settings.changed(**self._scaled(settings.kernel))
        if settings.sharpen_time is None:
            return settings
        power = describe(ShockSettings)["time"][2].length_power
        return replace(settings, sharpen_time=settings.sharpen_time * self.lengths**power)

    def _scaled(self, settings: Any) -> dict[str, Any]:
        # The values that differ on the part.
        fields = describe(type(settings))
        given = {name: getattr(settings, name) for name in fields}
        new: dict[str, Any] = {}
        if settings.by_width and settings.width == 0 and settings.what != "auto":
            given["width"] = self.width(settings.what)
            if not given["width"] > 0:
                new["amount"] = 0.0
        for name, (_, _, about) in fields.items():
            if about.counts_in != "edges" or not given[name] > 0:
                continue  # a time below 0 is no length
            new[name] = min(given[name] * self.lengths**about.length_power, about.maximum)
        return new


def whole_surface(surface: Any) -> Patch:
    """Return a patch that is the whole surface."""
    nothing = np.empty((0, 2, 3), dtype=np.float32)
    return Patch(surface, lambda result: result, 1.0, 1.0, nothing)


def patch_around(surface: Any, vertex: int, size: int) -> Patch:
    """Cut out the part of a surface around a vertex, and around its mirror images.

    Parameters
    ----------
    surface : Surface or PaintedSurface
    vertex : int
    size : int
        About the number of vertices of the part.

    Raises
    ------
    core.InvalidMesh
        If there are no faces.
    """
    shape = surface.shape if isinstance(surface, PaintedSurface) else surface
    distances = _distances(shape, vertex)
    used = np.zeros(len(distances), dtype=bool)
    used[shape.triangles] = True
    distances[~used] = np.inf
    count = min(size, len(distances))
    near = distances <= np.partition(distances, count - 1)[count - 1]
    inside = near[shape.triangles].all(axis=1)
    if not inside.any():
        raise InvalidMesh("There are no faces to preview here; point at another place.")
    lengths = _mean_edge_length(shape, ...) / _mean_edge_length(shape, inside)
    outline = shape.positions[_border(shape.triangles[inside])]
    part, whole = _cut(surface, inside)
    share = float(inside.mean())
    if isinstance(surface, ColoredSurface):
        width = cache(partial(_width_of_borders, surface))
        return Patch(part, whole, lengths, share, outline, width)
    return Patch(part, whole, lengths, share, outline)


def seen_vertex(
    positions: npt.NDArray, to_clip: npt.NDArray, size: tuple[int, int], mouse: tuple[float, float]
) -> int:
    """Find the vertex at a point in a view.

    Parameters
    ----------
    positions : (n, 3) array of float
    to_clip : (4, 4) array of float
        From the object's space to the view's clip space.
    size : tuple of int
        Width and height of the view in pixels.
    mouse : tuple of float
        The point, in pixels from the lower left corner.

    Returns
    -------
    int
        Of the vertices closest to the point in the view, the foremost one.
    """
    clip = positions @ to_clip[:, :3].T + to_clip[:, 3]
    before = clip[:, 3] > 0
    if not before.any():
        return 0
    clip[~before, 3] = 1.0
    seen = clip[:, :3] / clip[:, 3:]
    pixels = 0.5 * (seen[:, :2] + 1.0) * size - mouse
    away = np.where(before, np.hypot(pixels[:, 0], pixels[:, 1]), np.inf)
    close = np.flatnonzero(away <= away.min() + _REACH)
    return int(close[seen[close, 2].argmin()])


def _width_of_borders(surface: ColoredSurface, what: str) -> float:
    from ..host.colors import (
        width_of_borders,
    )

    return width_of_borders(surface, what)


def _distances(shape: Surface, vertex: int) -> npt.NDArray:
    """Return squared distances of vertices from a vertex or its closest mirror image."""
    mirror = shape.mirror if isinstance(shape, MirroredSurface) else (False, False, False)
    nearest = np.full(len(shape.positions), np.inf)
    for signs in product(*((1, -1) if mirrored else (1,) for mirrored in mirror)):
        away = shape.into_world(
            shape.positions * np.array(signs, dtype=np.float32) - shape.positions[vertex]
        )
        np.minimum(nearest, np.einsum("ij,ij->i", away, away), out=nearest)
    return nearest


def _border(triangles: npt.NDArray) -> npt.NDArray:
    # The edges that only one of the triangles has.
    edges = np.sort(
        np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    )
    found, times = np.unique(edges, axis=0, return_counts=True)
    return found[times == 1]


def _cut(surface: Any, inside: npt.NDArray[np.bool_]) -> tuple[Any, Callable[[Any], Any]]:
    """Return the part with these triangles, and the function that converts its result."""
    if isinstance(surface, PaintedSurface):
        shape, whole_shape = _cut(surface.shape, inside)
        paint, whole_paint = _cut(surface.paint, inside)
        return PaintedSurface(shape, paint), lambda result: replace(
            result, shape=whole_shape(result.shape), paint=whole_paint(result.paint)
        )
    vertices = np.unique(surface.triangles[inside])
    index = np.full(len(surface.positions), -1, dtype=np.int32)
    index[vertices] = np.arange(len(vertices), dtype=np.int32)
    mask = np.ones(len(vertices)) if surface.mask is None else surface.mask[vertices]
    border = index[surface.triangles[~inside]]
    mask[border[border >= 0]] = 0.0
    part = replace(
        surface,
        positions=surface.positions[vertices],
        triangles=index[surface.triangles[inside]],
        mask=mask,
    )
    if isinstance(part, MirroredSurface):
        edges = None if surface.edges is None else index[surface.edges]
        edges = None if edges is None else edges[(edges >= 0).all(axis=1)]
        part = replace(part, edges=edges)
    if not isinstance(part, ColoredSurface):
        return part, lambda result: _spread_shape(result, surface.positions, vertices)
    colored = vertices
    if surface.corners is not None:
        colored, corners = np.unique(surface.corners[inside], return_inverse=True)
        free = None if surface.free is None else surface.free[colored]
        part = replace(part, corners=corners.reshape(-1, 3).astype(np.int32), free=free)
    part = replace(part, colors=surface.colors[colored])
    return part, lambda result: _spread(result, "colors", surface.colors, colored)


def _spread_shape(result: Any, old: npt.NDArray, vertices: npt.NDArray) -> Any:
    # Outside of the part there are no creases.
    if result.creases is not None:
        places = np.full(len(old), -1, dtype=result.creases.places.dtype)
        places[vertices] = result.creases.places
        result = replace(result, creases=replace(result.creases, places=places))
    return _spread(result, "positions", old, vertices)


def _spread(result: Any, name: str, old: npt.NDArray, places: npt.NDArray) -> Any:
    # All values, with those of the part replaced.
    new = old.copy()
    new[places] = getattr(result, name)
    return replace(result, **{name: new})


def _mean_edge_length(surface: Surface, chosen: Any) -> float:
    triangles = surface.triangles[chosen]
    triangles = triangles[:: -(-len(triangles) // _SAMPLE)]
    points = surface.into_world(surface.positions[triangles].astype(np.float64))
    return float(np.linalg.norm(points - np.roll(points, 1, axis=1), axis=2).mean())
