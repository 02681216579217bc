# SPDX-License-Identifier: GPL-3.0-or-later
"""Worn edges, dirt and dust: masks from the shape of a mesh, in a texture or at vertices."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..base.checks import Floats, by_keyword, checked_size
from ..base.progress import ProgressCallback, phase, reporting
from ..mesh.calculus import unit_vectors
from ..mesh.edges import checked_edges
from ..mesh.nearest import nearest_point, point_tree
from ..mesh.triangle_mesh import TriangleMesh, check_mesh
from ..settings import WearSettings, given_or_default
from .ray_noise import without_noise
from .solid_noise import solid_noise
from .traced import traced_image
from .tracing import Scene, Sites, look_around, look_past_edges, scaled_to, scene_of, vertex_sites

_Single = npt.NDArray[np.float32]

_WIDTHS = {"edges": 0.04, "dirt": 0.1, "dust": 0.0}
"""Automatic widths, relative to the diagonal of the box around the mesh."""

_GRAIN = 0.03
"""Automatic size of the grain, relative to the same."""

_LEAST = 2.0
"""Least automatic width of worn edges, in texels, or in mean edge lengths at vertices."""

_SHELTER = 8.0
"""Distance, in widths, within which other parts shelter an edge from wear."""

_GAIN = {"edges": 6.0, "dirt": 5.0, "dust": 3.0}
"""Gains of the masks."""

_SMOOTH, _SHARP = 0.991, 0.94
"""Ramp of the cosine between shading and face normals: above the first value, an edge is smooth (a
turn of 15 degrees), below the second it is sharp (40 degrees). So the single edges of round parts
are not worn."""

_AT_VERTICES = 4
"""Factor of the number of rays at vertices, which are few, and differ more from their neighbours
than texels do."""

_STEP = 0.1
"""Distance between points on marked edges, in widths."""

_MOST_POINTS = 1_000_000


@by_keyword
def wear(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    settings: WearSettings | None = None,
    *,
    size: tuple[int, int],
    edges: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
) -> _Single:
    """Draw worn edges, dirt or dust into a texture, without seams.

    Parameters
    ----------
    mesh, uv, progress, atlas
        As in `sharpen_texture`.
    settings : WearSettings, optional
    size : (int, int)
        Rows and columns of the image.
    edges : (k, 2) array of int, optional
        Edges of the mesh that are worn, as pairs of vertices, such as those of convex lines of
        `find_creases`. Default: wherever the surface is convex.

    Returns
    -------
    (h, w) float32
        A mask in [0, 1]: 1 is worn off, full of dirt, or under dust. The gutter around the charts
        is filled; the rest is 0.

    Raises
    ------
    InvalidUV, Cancelled
        As in `sharpen_texture`.
    InvalidSignal
        If `edges` is no list of pairs of vertices.
    InvalidSettings
        If the size cannot be used.

    Notes
    -----
    All three are traced by rays, so they are as fine as the texture, even on coarse meshes. Edges:
    the share of rays into the body that leave it within `width` through another side. This is
    (1 - cos a) / 2 on a sharp edge where the surface turns by the angle a, less on a smoothly
    shaded one, and falls to 0 at the width. It is multiplied by the share of the sky that is
    visible within 8 widths. Opposite sides of thin walls do not count. Dirt: the share of rays that
    hit something within `width`, less if it is far. Dust: the visible share of the sky around the Z
    axis, times the square of the cosine to it.

    A value v becomes 1 - exp(-g v) with a gain g, and noise n in space breaks it up: (v - b n) /
    (1 - b n), where b is `breakup`.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0], [0, 0, -2], [2, 0, -2]]
    >>> ridge = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3], [4, 1, 0], [4, 5, 1]])
    >>> places = ridge.vertices[ridge.faces]
    >>> uv = np.stack([places[..., 0] / 2, 0.6 + places[..., 1] / 3 + places[..., 2] / 4], axis=-1)
    >>> image = core.wear(ridge, uv, core.WearSettings(breakup=0, width=0.5), size=(64, 64))
    >>> bool(image[39, 32] > 0.8), bool(image[56, 32] < 0.01)  # on the edge, and far from it
    (True, True)
    """
    settings = given_or_default(settings, WearSettings)
    check_mesh(mesh)
    pairs = None if edges is None else checked_edges(mesh, edges)
    shape = checked_size(size)
    with reporting(progress):
        texel = np.sqrt(mesh.areas.sum() / (shape[0] * shape[1])) * mesh.mean_edge_length
        wears = _Wear(mesh, settings, float(texel), pairs)
        image, _ = traced_image(mesh, uv, shape, settings, atlas, wears.traced, wears.mask)
        return np.clip(image[..., 0], 0.0, 1.0)


@by_keyword
def vertex_wear(
    mesh: TriangleMesh,
    settings: WearSettings | None = None,
    *,
    edges: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> Floats:
    """Compute worn edges, dirt or dust at the vertices.

    Parameters
    ----------
    mesh, settings, edges, progress
        As in `wear`.

    Returns
    -------
    (n,) float64
        A mask in [0, 1].

    Raises
    ------
    InvalidSignal, Cancelled
        As in `wear`.

    Examples
    --------
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0], [0, 0, -2], [2, 0, -2]]
    >>> ridge = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3], [4, 1, 0], [4, 5, 1]])
    >>> found = core.vertex_wear(ridge, core.WearSettings(kind="dust", breakup=0))
    >>> bool(found[2] > 0.8), bool(found[4] == 0)  # above, and on the side
    (True, True)
    """
    settings = given_or_default(settings, WearSettings)
    check_mesh(mesh)
    pairs = None if edges is None else checked_edges(mesh, edges)
    with reporting(progress), phase(0.0, 1.0, "Tracing rays"):
        wears = _Wear(
            mesh, settings.changed(rays=min(_AT_VERTICES * settings.rays, 65536)),
            mesh.mean_edge_length, pairs,
        )  # fmt: skip
        sites = vertex_sites(mesh)
        with phase(0.0, 0.9, "Tracing rays"):
            halves = wears.traced(sites)
        with phase(0.9, 1.0, "Smoothing"):
            values = without_noise(sites, halves, settings.smoothing)
        return wears.mask(values, sites)[:, 0].astype(np.float64)


class _Wear:
    # Traces the rays for a mask, and computes the mask from them.

    def __init__(
        self,
        mesh: TriangleMesh,
        settings: WearSettings,
        sampling: float,
        edges: npt.NDArray[np.intp] | None,
    ) -> None:
        low, high = mesh.box
        size = float(np.linalg.norm(high - low))
        least = _LEAST * sampling if settings.kind == "edges" else 0.0
        self._mesh, self._settings, self._edges = mesh, settings, edges
        self._width = settings.width or max(_WIDTHS[settings.kind] * size, least)
        self._grain = settings.grain or _GRAIN * size

    def traced(self, sites: Sites) -> _Single:
        """Trace rays, in two halves: (k, 2 c)."""
        scene, rays = scene_of(self._mesh), self._settings.rays
        if self._settings.kind == "dust":
            up = np.zeros_like(sites.normals)
            up[:, 2] = 1.0
            return look_around(scene, sites._replace(normals=up), rays, self._width)[0]
        if self._settings.kind == "dirt":
            return look_around(scene, sites, rays, self._width, measured=True)[2]
        return self._traced_edges(scene, sites, rays)

    def _traced_edges(self, scene: Scene, sites: Sites, rays: int) -> _Single:
        with phase(0.0, 0.5, "Tracing rays"):
            convex = look_past_edges(scene, _less_shaded(sites), rays, self._width)
        with phase(0.5, 1.0, "Tracing rays"):
            seen = look_around(scene, sites, rays, _SHELTER * self._width)[0]
        return np.stack([convex[:, 0], seen[:, 0], convex[:, 1], seen[:, 1]], axis=1)

    def mask(self, values: _Single, sites: Sites) -> _Single:
        """Convert traced values (k, c) into a mask (k, 1)."""
        settings = self._settings
        found = np.clip(values, 0.0, 1.0).prod(axis=1).astype(np.float64)
        if settings.kind == "dust":
            found *= np.maximum(sites.normals[:, 2], 0.0) ** 2
        if settings.kind == "edges" and self._edges is not None:
            found *= self._along_edges(sites)
        found = -np.expm1(-settings.amount * _GAIN[settings.kind] * found)
        grain = self._grain / self._mesh.mean_edge_length
        noise = settings.breakup * solid_noise(sites.points, grain, settings.seed)
        broken = np.clip((found - noise) / np.maximum(1.0 - noise, 1e-3), 0.0, 1.0)
        return broken[:, None].astype(np.float32)

    def _along_edges(self, sites: Sites) -> Floats:
        # 1 on the given edges, smoothly down to 0 at twice the width.
        mesh = self._mesh
        assert self._edges is not None
        if not len(self._edges):
            return np.zeros(len(sites.points))
        ends = mesh.vertices[self._edges]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        step = max(_STEP * self._width, float(lengths.sum()) / _MOST_POINTS)
        counts = np.ceil(lengths / step).astype(np.intp) + 1
        which = np.repeat(np.arange(len(counts)), counts)
        place = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
        share = (place / np.maximum(counts[which] - 1, 1))[:, None]
        points = (1.0 - share) * ends[which, 0] + share * ends[which, 1]
        low, high = mesh.box
        reach = min(2.0 * self._width, 4.0 * float(np.linalg.norm(high - low)))
        reach /= mesh.mean_edge_length
        tree = point_tree(scaled_to(mesh, points))
        far, _ = nearest_point(tree, sites.points.astype(np.float64), reach)
        nearness: Floats = np.maximum(1.0 - far / reach, 0.0)
        return nearness * nearness * (3.0 - 2.0 * nearness)


def _less_shaded(sites: Sites) -> Sites:
    # Blends from shading normals to face normals, the more they differ.
    agrees = (sites.normals * sites.facing).sum(axis=1, keepdims=True)
    share = np.clip((agrees - _SHARP) / (_SMOOTH - _SHARP), 0.0, 1.0)
    normals = sites.facing + share * (sites.normals - sites.facing)
    return sites._replace(normals=unit_vectors(normals).astype(np.float32))
