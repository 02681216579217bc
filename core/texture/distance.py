# SPDX-License-Identifier: GPL-3.0-or-later
"""Geodesic distance in a texture, across seams (paper B, section 7.3)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..base.checks import Floats, as_array, by_keyword, checked_indices, checked_size
from ..base.findings import Length, tell
from ..base.progress import ProgressCallback, aside, phase, reporting
from ..elements.fronts import Segments, SurfaceDistance, distance_on_mesh
from ..elements.matrices import TextureSpace
from ..elements.multigrid import SheetSolver
from ..errors import InvalidSettings, InvalidSignal
from ..mesh.edges import checked_edges, half_edges_between
from ..mesh.triangle_mesh import Ints, TriangleMesh, check_mesh
from ..settings import DistanceSettings, given_or_default
from .texels import Texture, checked_atlas, drawn

_TOLERANCE = 1e-4
"""Residual of the smoothed distance relative to the right-hand side."""

_SHORTEST = 1e-3
"""Least smoothing length; less has no effect in single precision."""

_JUMP = 0.6
"""Relative change of lengths across a texel above which its mean metric is too inexact."""

_LINES = 10
"""Number of lines from the source to the farthest point, if their width is not given."""

_OF_SIZE, _OF_SPACING = 0.08, 0.3
"""Upper limits of the width of a mask along lines, as shares of the model's diagonal and of the
spacing of the lines."""

_LEAST_TEXELS, _LEAST_EDGES = 2.0, 1.0
"""Least automatic width of such a mask, in texels, and in mean edge lengths without a texture."""

_NO_SOURCE = (
    "No source lies on the surface; give vertices, points, edges or a painted image, or take the"
    " borders or seams as sources."
)

_BEYOND = -1.0
"""Marks texels beyond the gutter."""

_Single = npt.NDArray[np.float32]


class _Sources(NamedTuple):
    # The sources from which distance is measured.
    segments: Segments
    vertices: Ints  # vertices that lie exactly on a source
    image: npt.NDArray | None
    half: npt.NDArray[np.intp]  # half-edges on given edges
    are_lines: bool  # nothing but edges


@by_keyword
def geodesic_distance(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    settings: DistanceSettings | None = None,
    *,
    size: tuple[int, int],
    vertices: npt.ArrayLike | None = None,
    points: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    edges: npt.ArrayLike | None = None,
    image: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
) -> _Single:
    """Compute the geodesic distance of each texel from the nearest source, across seams.

    Parameters
    ----------
    mesh, uv, progress, atlas
        As in `sharpen_texture`.
    size : (int, int)
        Rows and columns of the image.
    vertices : (k,) array of int, optional
        Vertices that are sources.
    points : ((k,) array of int, (k, 3) array of float), optional
        Points that are sources: faces, and barycentric coordinates in them.
    edges : (k, 2) array of int, optional
        Edges that are sources, as pairs of vertices.
    image : (h, w) array of float in [0, 1], optional
        Texels of 0.5 or more are sources. Kinds of sources can be combined.
    settings : DistanceSettings, optional

    Returns
    -------
    (h, w) float32
        The distance in units of the mesh, infinite where no path leads to a source; or a gradient
        or lines, see `DistanceSettings.look`. The gutter around the charts is filled; the rest is
        0.

    Raises
    ------
    InvalidUV, Cancelled
        As in `sharpen_texture`.
    InvalidSignal
        If there is no source, or a source is not on the mesh.
    InvalidSettings
        If the size cannot be used.
    SolverError
        If no solution is found for smoothed distance.

    Notes
    -----
    Paper B uses the heat method. Here fronts march over the texels, see `core.elements.fronts`;
    these have no parameter, and are as exact far from the source as near it. The error is a
    fraction of a texel: on a sphere, 0.07 % of the distance at 512 x 512 texels.

    Where only edges, borders or seams are sources, the automatic width w of a gradient is 1 / w =
    1 / (0.08 d) + 1 / (0.3 s), with the diagonal d of the box around the mesh and the spacing s of
    the edges, which is the area by their length; at least 2 texels. The width is reported; see
    `base.findings`.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = mesh.vertices[mesh.faces][..., :2] / 4
    >>> distance = core.geodesic_distance(mesh, uv, size=(32, 32), vertices=[0])
    >>> bool(np.isclose(distance[10, 20], np.hypot(10.5, 20.5) / 8, atol=1e-5))
    True
    """
    settings = given_or_default(settings, DistanceSettings)
    rows, columns = checked_size(size)
    sources = _checked_sources(mesh, (rows, columns), vertices, points, edges, image)
    with reporting(progress):
        with phase(0.0, 0.5, "Finding texels"):
            pixels = np.zeros((rows, columns, 2), dtype=np.float32)
            pixels[..., 1] = _BEYOND
            texture = Texture(checked_atlas(atlas, mesh, uv, pixels), pixels)
            space = TextureSpace(texture.atlas, _JUMP)
        with phase(0.5, 0.8, "Measuring distance"):
            values = _spread(space, sources, settings).values()
        with phase(0.8, 0.9, "Smoothing"):
            reached = np.isfinite(values).astype(np.float32)
            values[reached == 0] = 0.0
            if settings.smoothing > _SHORTEST:
                values = _smoothed(space, values, settings.smoothing)
        with phase(0.9, 1.0, "Filling the gutter"):
            both = np.concatenate([values, reached], axis=1)
            found = drawn(texture, space, both, settings.gutter)
            distances = np.maximum(found[..., 0], 0.0) * np.float32(texture.atlas.texel_size)
            distances[found[..., 1] < 0.5] = np.inf
            texel = float(texture.atlas.texel_size)
            lines = _lines_of(mesh, sources, settings, texture.atlas.charts.borders)
            along = _width_along(mesh, lines, _LEAST_TEXELS * texel)
            distances = _shown(distances, texture.atlas.inside, settings, along)
            distances[found[..., 1] == _BEYOND] = 0.0
            return distances


@by_keyword
def vertex_distance(
    mesh: TriangleMesh,
    settings: DistanceSettings | None = None,
    *,
    vertices: npt.ArrayLike | None = None,
    points: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    edges: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> Floats:
    """Compute the geodesic distance of each vertex from the nearest source.

    Parameters
    ----------
    mesh, vertices, points, edges, progress
        As in `geodesic_distance`.
    settings : DistanceSettings, optional
        Smoothing and gutter have no effect. Seams cannot be the source; give their edges.

    Returns
    -------
    (n,) float64
        Infinite where no path leads to a source, and at vertices without faces.

    Raises
    ------
    InvalidSignal, InvalidSettings, Cancelled
        As in `geodesic_distance`.

    Notes
    -----
    Fronts march over the triangles as in `geodesic_distance`. Distances are exact on developable
    surfaces.

    Examples
    --------
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [3, 0, 0], [3, 4, 0], [0, 4, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> core.vertex_distance(mesh, vertices=[0]).round(3).tolist()
    [0.0, 3.0, 5.0, 4.0]
    """
    settings = given_or_default(settings, DistanceSettings)
    sources = _checked_sources(mesh, (0, 0), vertices, points, edges, None)
    if settings.source == "seams":
        raise InvalidSettings(
            "source is 'seams', and a mesh alone has none; give their edges, or choose 'border'."
        )
    with reporting(progress), phase(0.0, 1.0, "Measuring distance"):
        segments = sources.segments
        if settings.source == "border":
            segments = _joined([segments, _along(_border_of(mesh))])
        if not len(segments.faces):
            raise InvalidSignal(_NO_SOURCE)
        found = distance_on_mesh(mesh, segments) * mesh.mean_edge_length
        found[sources.vertices] = 0.0
        lines = _lines_of(mesh, sources, settings, np.zeros(0, dtype=np.intp))
        along = _width_along(mesh, lines, _LEAST_EDGES * mesh.mean_edge_length)
        return _shown(found, np.isfinite(found), settings, along)


def _spread(space: TextureSpace, sources: _Sources, settings: DistanceSettings) -> SurfaceDistance:
    atlas, mesh = space.atlas, space.atlas.mesh
    segments = sources.segments
    if settings.source != "given":
        half = _border_of(mesh) if settings.source == "border" else atlas.charts.borders
        segments = _joined([segments, _along(half)])
    fronts = SurfaceDistance(space)
    with aside("Measuring distance"):
        if sources.image is not None:
            painted = atlas.gather(sources.image.astype(np.float32)[..., None])[..., 0]
            fronts.start_at_nodes(painted >= 0.5)
        fronts.start_at_segments(segments)
    if not fronts.found:
        raise InvalidSignal(_NO_SOURCE)
    fronts.spread()
    return fronts


def _border_of(mesh: TriangleMesh) -> npt.NDArray[np.intp]:
    half = np.flatnonzero(mesh.twins.reshape(-1) < 0)
    if not len(half):
        raise InvalidSignal("The mesh has no border; choose seams or give sources.")
    return half


def _smoothed(space: TextureSpace, values: _Single, length: float) -> _Single:
    # Solves for the change of values, as other filters do.
    solver = SheetSolver(space.matrix(length**-2.0))
    change = np.zeros_like(values)
    solver.solve(-space.apply_stiffness(values), change, _TOLERANCE, message="Smoothing")
    return values + change


def _lines_of(
    mesh: TriangleMesh,
    sources: _Sources,
    settings: DistanceSettings,
    seams: npt.NDArray[np.intp],
) -> npt.NDArray[np.intp]:
    # The half-edges on the source; empty if it is more than lines.
    if not sources.are_lines:
        return np.zeros(0, dtype=np.intp)
    more = {"border": _border_of, "seams": lambda _: seams}.get(settings.source)
    return sources.half if more is None else np.union1d(sources.half, more(mesh))


def _width_along(mesh: TriangleMesh, half: npt.NDArray[np.intp], least: float) -> float:
    # The automatic width of a mask along lines, in units of the mesh; 0 without lines.
    edge = mesh.mean_edge_length  # in which all is, up to the last line
    f, k = np.divmod(half, 3)
    ends = mesh.scaled_vertices[mesh.faces[f]]
    sides = np.where(mesh.twins.reshape(-1)[half] < 0, 1.0, 0.5)  # which are on both, as a rule
    rows = np.arange(len(half))
    length = float(sides @ np.linalg.norm(ends[rows, (k + 1) % 3] - ends[rows, k], axis=1))
    if not length > 0.0:
        return 0.0
    low, high = mesh.box
    by_size = _OF_SIZE * float(np.linalg.norm((high - low) / edge))
    by_spacing = _OF_SPACING * float(mesh.areas.sum()) / length
    return max(by_size * by_spacing / (by_size + by_spacing) * edge, least)


def _shown(
    distances: npt.NDArray,
    inside: npt.NDArray[np.bool_],
    settings: DistanceSettings,
    along: float,
) -> npt.NDArray:
    # `along` is the automatic width along lines; 0 where there is more than lines.
    if settings.look == "distance":
        return distances
    reached = distances[inside & np.isfinite(distances)]
    largest = float(reached.max(initial=0.0)) or 1.0
    if settings.look == "gradient":
        width = settings.width or along or largest
        if not settings.width:
            tell("The gradient ends at a distance of {width}.", width=Length(width))
        is_reached = np.isfinite(distances)
        shares = np.where(is_reached, distances, 0.0) / width
        return np.where(is_reached, np.clip(1.0 - shares, 0.0, 1.0), 0.0).astype(distances.dtype)
    width = settings.width or largest / _LINES
    if not settings.width:
        tell("The lines are {width} apart.", width=Length(width))
    turns = 2.0 * np.pi * np.where(np.isfinite(distances), distances, 0.0)
    lines = 0.5 + 0.5 * np.cos(turns / width)
    return np.where(np.isfinite(distances), lines, 0.0).astype(distances.dtype)


def _checked_sources(
    mesh: TriangleMesh,
    size: tuple[int, int],
    vertices: npt.ArrayLike | None,
    points: tuple[npt.ArrayLike, npt.ArrayLike] | None,
    edges: npt.ArrayLike | None,
    image: npt.ArrayLike | None,
) -> _Sources:
    check_mesh(mesh)
    known, parts = [np.zeros(0, dtype=np.int64)], [_along(np.zeros(0, dtype=np.int64))]
    if vertices is not None:
        given = checked_indices(vertices, mesh.vertex_count, "vertices", "vertex").reshape(-1)
        chosen = np.zeros(mesh.vertex_count, dtype=np.bool_)
        chosen[given] = True
        faces, corners = np.nonzero(chosen[mesh.faces])
        parts.append(_at(faces, np.eye(3)[corners]))
        known.append(given[np.isin(given, mesh.faces)])
    if points is not None:
        parts.append(_at(*_checked_points(mesh, points)))
    half, starts = np.zeros(0, dtype=np.intp), len(parts)
    if edges is not None:
        half = _checked_edges(mesh, edges)
        parts.append(_along(half))
        f, k = np.divmod(half, 3)
        known += [mesh.faces[f, k], mesh.faces[f, (k + 1) % 3]]
    painted = None
    if image is not None:
        painted = as_array(image, "image of sources")
        if painted.shape != size:
            raise InvalidSignal(f"The image of sources has the shape {painted.shape}; give {size}.")
        if painted.dtype.kind not in "bfiu" or not np.isfinite(painted).all():
            raise InvalidSignal(
                "The image of sources holds NaN, infinity or no numbers; give 0 to 1."
            )
        painted = np.clip(painted.astype(np.float64), 0.0, 1.0)
    are_lines = painted is None and not any(len(part.faces) for part in parts[1:starts])
    return _Sources(_joined(parts), np.concatenate(known), painted, half, are_lines)


def _checked_points(
    mesh: TriangleMesh, points: tuple[npt.ArrayLike, npt.ArrayLike]
) -> tuple[npt.NDArray[np.int64], Floats]:
    if not isinstance(points, tuple | list) or len(points) != 2:
        raise InvalidSignal("The points are no pair; give their faces and barycentric coordinates.")
    faces = checked_indices(points[0], mesh.face_count, "faces of the points", "face").reshape(-1)
    shares = as_array(points[1], "barycentric coordinates")
    if shares.shape != (len(faces), 3) or shares.dtype.kind not in "fiu":
        raise InvalidSignal(
            f"The barycentric coordinates have the shape {shares.shape}; give ({len(faces)}, 3)."
        )
    shares = shares.astype(np.float64)
    if not np.isfinite(shares).all() or (shares < -1e-6).any() or (shares.sum(axis=1) <= 0).any():
        raise InvalidSignal("A point lies outside its face; give three numbers from 0 to 1.")
    shares = np.maximum(shares, 0.0) / np.maximum(shares, 0.0).sum(axis=1, keepdims=True)
    turned = mesh.flipped[faces]
    shares[turned] = shares[turned][:, [0, 2, 1]]
    return faces, shares


def _checked_edges(mesh: TriangleMesh, edges: npt.ArrayLike) -> npt.NDArray[np.intp]:
    # The half-edges of pairs of vertices, of both sides.
    pairs = checked_edges(mesh, edges)
    half, joined = half_edges_between(mesh, pairs)
    if not joined.all():
        a, b = pairs[np.argmin(joined)]
        raise InvalidSignal(f"No edge joins the vertices {a} and {b}; give ends of edges.")
    return np.flatnonzero(half)


def _at(faces: npt.NDArray, shares: Floats) -> Segments:
    return Segments(faces.astype(np.int32), np.repeat(shares[:, None], 2, axis=1))


def _along(half: npt.NDArray) -> Segments:
    f, k = np.divmod(half.astype(np.int64), 3)
    return Segments(f.astype(np.int32), np.stack([np.eye(3)[k], np.eye(3)[(k + 1) % 3]], axis=1))


def _joined(parts: list[Segments]) -> Segments:
    return Segments(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
