# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds creases as lines along mesh edges, with the state of each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.checks import by_keyword, checked_angle
from ..base.memo import kept
from ..base.parallel import kernel
from ..base.progress import ProgressCallback, ask, phase, reporting
from ..base.vectors import after
from ..mesh.adjacency import within_rings
from ..mesh.edges import checked_edges, half_edges_between
from ..mesh.nearest import point_tree, points_within
from ..mesh.order import is_scattered, sorted_along_curve
from ..mesh.triangle_mesh import Floats, TriangleMesh, check_mesh
from ..mixture.choice import mixture
from ..settings import GeometrySettings, given_or_default
from .candidates import TAKES_SIDES, Candidates
from .crease_edges import (
    EVEN,
    STRONG,
    Bools,
    Singles,
    crease_edges,
    even_share,
    turns_across,
    unevenness,
)
from .creases import WIDTHS, find_targets, weighed, widths

CLOSES = "closes"
SHARP = "sharp"
FILLET = "fillet"
THIN = "thin"
UNSURE = "unsure"

_CLOSING_TURN = 8.0
"""Mean turn in degrees, of the faces beside a line, from which the line closes."""

_TURN_EDGES = 4
"""Number of edges to either side over which that turn is averaged."""

_STRENGTH_QUANTILE = 0.9
"""Quantile of the angles of a line's edges that is its strength: beside weak edges, faces lie
across the crease."""

_BLUNT_TURN = 8.0
"""Lines that stay pass only within one ring of vertices at which the RMS turn of the normals is
more, in degrees."""

_APART = 2
"""Lines that stay are farther from all others than this number of edges."""

_FILLET = 1.25
"""Radius, in mean edge lengths, above which a rounding that stays counts as a designed fillet, if
Widest Fillet is not set."""

_WALL = 2.0
"""Thickness, in mean edge lengths, up to which a wall is thin."""

_AT_ONCE = 1024
"""Number of vertices per search for walls."""

_OPPOSITE_COSINE = -0.7
"""Greatest cosine of the angle between the normals of the two sides of a wall."""


@dataclass(frozen=True)
class CreaseLine:
    """A crease: a line between two corners, or a closed loop.

    Attributes
    ----------
    vertices : (k,) int
        Vertices in order along mesh edges. The first one of a loop is not repeated at its end.
    is_loop : bool
    is_convex : bool
        True for a ridge, False for a groove.
    strength : float
        Angle in degrees between the normals of its two sides once it is closed: 90 on a box.
    width : float
        Radius of its rounding before it is closed, in mean edge lengths; 0 if it is sharp.
    sureness : float
        From 0 to 1: the share of its length that surely is a crease. Weak edges, as in bridged
        gaps, count as 0.
    state : str
        "closes" if sharpening will close it; "sharp" if it is sharp already. Otherwise it stays
        because it is a "fillet", wider than the widest that closes; "thin", so that two sides of
        the surface are within 2 mean edge lengths; or "unsure".

    Examples
    --------
    >>> from shock_filter import core
    >>> import numpy as np
    >>> core.CreaseLine(np.array([3, 5, 8]), False, True, 90.0, 0.0, 1.0, "sharp").edges.tolist()
    [[3, 5], [5, 8]]
    """

    vertices: npt.NDArray[np.intp]
    is_loop: bool
    is_convex: bool
    strength: float
    width: float
    sureness: float
    state: str

    @property
    def edges(self) -> npt.NDArray[np.intp]:
        """Its edges, as pairs of vertices: (k or k - 1, 2)."""
        pairs = np.stack([self.vertices, np.roll(self.vertices, -1)], axis=1)
        return pairs if self.is_loop else pairs[:-1]


class _Lines(NamedTuple):
    # The half-edges of all lines in order, the index at which each line begins, and whether it is
    # a loop.
    edges: npt.NDArray[np.int32]
    starts: npt.NDArray[np.int32]
    loops: Bools


@by_keyword
def find_creases(
    mesh: TriangleMesh,
    settings: GeometrySettings | None = None,
    *,
    angle: float = STRONG,
    edges: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> list[CreaseLine]:
    """Find the creases of a mesh, as lines along its edges.

    Parameters
    ----------
    mesh : TriangleMesh
        A mesh before or after sharpening.
    settings : GeometrySettings, optional
        The settings for `sharpen_geometry`. Only the widest fillet and those of the flow matter.
    angle : float
        Least strength, in degrees, from 5 to 170. Lines continue along edges half as strong.
    edges : (k, 2) array of int, optional
        Edges that lines may follow, as pairs of vertices; by default all. With the edges of the
        quads that triangles were cut from, lines avoid the diagonals. Pairs that are no edge are
        ignored.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    list of CreaseLine
        First the lines that close or are sharp already, then those that stay. Lines meet at
        corners; there one may end on another that continues.

    Raises
    ------
    InvalidSettings
        If the angle is out of range.
    InvalidSignal
        If edges are not pairs of vertices.
    Cancelled
        If `progress` returned False.

    Notes
    -----
    Before sharpening, lines follow the vertices that will lie on the creases. They zigzag by up to
    an edge length, and become straight once `sharpen_geometry` has moved these vertices. Not in the
    papers; see `shape.crease_edges`.

    Examples
    --------
    A folded sheet has one crease:

    >>> import numpy as np
    >>> from shock_filter import core
    >>> x, y = np.divmod(np.arange(81.0), 9)
    >>> a = np.flatnonzero((x < 8) & (y < 8))
    >>> faces = np.stack([[a, a + 9, a + 1], [a + 1, a + 9, a + 10]]).swapaxes(1, 2)
    >>> faces = faces.reshape(-1, 3)
    >>> sheet = core.TriangleMesh(np.stack([x, y, -abs(x - 4)], axis=1), faces)
    >>> (line,) = core.find_creases(sheet)
    >>> line.vertices.tolist(), line.state, line.is_convex, round(line.strength)
    ([36, 37, 38, 39, 40, 41, 42, 43, 44], 'sharp', True, 90)
    """
    check_mesh(mesh)
    settings = given_or_default(settings, GeometrySettings)
    angle = checked_angle(angle, "angle", 5.0, 170.0)
    pairs = None if edges is None else checked_edges(mesh, edges)
    with reporting(progress):
        return _in_good_order(mesh, settings, angle, pairs, with_left=True)


def closing_creases(
    mesh: TriangleMesh,
    settings: GeometrySettings,
    angle: float,
    edges: npt.NDArray[np.int64] | None = None,
) -> list[CreaseLine]:
    """Find only the creases that close or are sharp already, faster than `find_creases`.

    Parameters
    ----------
    mesh, settings, angle, edges
        As in `find_creases`, which checks them.
    """
    return _in_good_order(mesh, settings, angle, edges, with_left=False)


def standing_out(mesh: TriangleMesh, lines: list[CreaseLine], angle: float) -> list[CreaseLine]:
    """Keep the lines that close, and the sharp ones with a smooth surface on both sides.

    Steep edges of rocks, folds and noise are sharp lines too, but not designed ones. The larger the
    share of steep edges with smooth sides in the mesh, the rougher the sides of the others may be.

    Parameters
    ----------
    mesh : TriangleMesh
    lines : list of CreaseLine
        From `closing_creases`.
    angle : float
        The angle they were found with. Edges of smaller angles measure how smooth the sides are.
    """
    if not lines:
        return []
    uneven = unevenness(mesh, turns_across(mesh, mesh.normals), angle)
    most = EVEN / max(1.0 - even_share(mesh), 1e-9)
    return [
        line
        for line in lines
        if line.state != SHARP or uneven[line.vertices].mean() <= most * line.strength
    ]


def _in_good_order(
    mesh: TriangleMesh,
    settings: GeometrySettings,
    angle: float,
    pairs: npt.NDArray[np.int64] | None,
    with_left: bool,
) -> list[CreaseLine]:
    if not is_scattered(mesh):
        return _found(mesh, settings, angle, pairs, with_left)
    ordered, order, _ = kept(mesh, "order", (), lambda: sorted_along_curve(mesh))
    if pairs is not None:
        rank = np.empty(mesh.vertex_count, dtype=np.int64)
        rank[order] = np.arange(mesh.vertex_count)
        pairs = rank[pairs]
    lines = _found(ordered, settings, angle, pairs, with_left)
    return [replace(line, vertices=order[line.vertices]) for line in lines]


def edges_of(lines: Iterable[CreaseLine]) -> npt.NDArray[np.intp]:
    """Return the edges of all lines, as pairs of vertices: (k, 2)."""
    return np.concatenate([np.zeros((0, 2), dtype=np.intp), *(line.edges for line in lines)])


def _found(
    mesh: TriangleMesh,
    settings: GeometrySettings,
    angle: float,
    edges: npt.NDArray[np.int64] | None,
    with_left: bool,
) -> list[CreaseLine]:
    hidden = None
    if edges is not None:
        hidden = kept(mesh, "hidden", (edges,), lambda: ~half_edges_between(mesh, edges)[0])
    with phase(0.0, 0.8, "Finding creases"):
        targets = find_targets(mesh, settings)
        found, scores = weighed(mesh, settings)
    with phase(0.8, 0.9, "Tracing creases"):
        turns = turns_across(mesh, targets.normals)
        chosen = crease_edges(mesh, targets.normals, turns, angle, hidden=hidden)
        lines = _traced(mesh, chosen)
        cosines = np.einsum("ij,ij->i", mesh.normals, targets.normals)
        turned = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))
        lines, closes = _parted(mesh, lines, turned)
        sided = np.where(turned > _CLOSING_TURN, targets.sided, 1.0)
        states = np.where(closes, CLOSES, SHARP)
        given = _described(mesh, lines, turns, sided, found, angle, states)
    if not with_left:
        return given
    with phase(0.9, 1.0, "Tracing creases"):
        ends = np.zeros(mesh.vertex_count, dtype=np.bool_)
        ends[mesh.faces[chosen]] = True
        blunt = within_rings(mesh.neighbours, found.turn > np.radians(_BLUNT_TURN), 1)
        allowed = blunt & ~within_rings(mesh.neighbours, ends, _APART)
        if not allowed.any():
            return given
        closed = mesh.normals.copy()
        closed[found.rows] = mixture(found.normals, scores, TAKES_SIDES)[0]
        turns = turns_across(mesh, closed)
        lines = _traced(mesh, crease_edges(mesh, closed, turns, angle, allowed, hidden))
        sided = np.zeros(mesh.face_count)
        sided[found.rows] = targets.sided[found.rows]
        left = _described(mesh, lines, turns, sided, found, angle, np.full(len(lines.loops), ""))
        left = [line for line in left if line.strength >= angle]
        return given + _with_reasons(mesh, left, closed, settings)


def _traced(mesh: TriangleMesh, chosen: Bools) -> _Lines:
    count = int(np.count_nonzero(chosen)) // 2
    edges = np.empty(count, dtype=np.int32)
    starts = np.empty(count + 1, dtype=np.int32)
    loops = np.empty(count, dtype=np.bool_)
    nodes = np.zeros(mesh.vertex_count, dtype=np.int32)
    np.add.at(nodes, mesh.faces[chosen], 1)
    vertices = np.flatnonzero(nodes)
    vertices = vertices[np.argsort(nodes[vertices] == 2, kind="stable")]  # loops come last
    lines = _trace(vertices, mesh.faces, mesh.twins, *mesh.corners, chosen.copy(), nodes, edges,
                   starts, loops)  # fmt: skip
    ask()
    return _Lines(edges, starts[:lines], loops[:lines])


def _parted(mesh: TriangleMesh, lines: _Lines, turned: Floats) -> tuple[_Lines, Bools]:
    # Splits lines where they change between closing and not; returns also which of them close.
    edges, starts, loops = lines
    if len(edges) == 0:
        return lines, np.zeros(0, dtype=bool)
    face, side = np.divmod(edges, 3)
    other = mesh.twins[face, side] // 3
    areas = np.stack([mesh.areas[face], mesh.areas[other]], axis=1)
    turns = (areas * np.stack([turned[face], turned[other]], axis=1)).sum(axis=1)
    sizes = np.diff(np.append(starts, len(edges)))
    first, last = np.repeat(starts, sizes), np.repeat(starts + sizes, sizes)
    places = np.arange(len(edges))
    low, high = np.maximum(places - _TURN_EDGES, first), np.minimum(places + _TURN_EDGES + 1, last)
    sums = np.append(0.0, np.cumsum(turns - _CLOSING_TURN * areas.sum(axis=1)))
    closes = sums[high] - sums[low] > 0
    changes = np.flatnonzero((closes[1:] != closes[:-1]) & (first[1:] == first[:-1])) + 1
    whole = np.ones(len(starts), dtype=bool)
    whole[np.searchsorted(starts, changes, side="right") - 1] = False
    new = np.union1d(starts, changes).astype(np.int32)
    is_loop = np.zeros(len(new), dtype=bool)
    is_loop[np.searchsorted(new, starts)] = loops & whole
    return _Lines(edges, new, is_loop), closes[new]


def _described(
    mesh: TriangleMesh,
    lines: _Lines,
    turns: Singles,
    sided: Floats,
    found: Candidates,
    angle: float,
    states: npt.NDArray[np.str_],
) -> list[CreaseLine]:
    edges, starts, loops = lines
    if len(edges) == 0:
        return []
    face, side = np.divmod(edges, 3)
    begin, end = mesh.faces[face, side], mesh.faces[face, (side + 1) % 3]
    length = np.linalg.norm(mesh.scaled_vertices[end] - mesh.scaled_vertices[begin], axis=1)
    length = np.maximum(length, 1e-9)

    def mean(values: Floats, weights: Floats = length) -> Floats:
        sums = np.add.reduceat(values * weights, starts)
        return sums / np.maximum(np.add.reduceat(weights, starts), 1e-30)

    turn = turns[face, side].astype(np.float64)
    signed = mean(turn)
    strong = np.abs(turn) >= angle
    ends = np.append(starts[1:], len(edges))
    by_turn = np.sort(np.abs(turn) + 256.0 * np.repeat(np.arange(len(starts)), ends - starts))
    typical = starts + (_STRENGTH_QUANTILE * (ends - starts - 1)).round().astype(np.int32)
    strength = by_turn[typical] - 256.0 * np.arange(len(starts))
    surely = np.maximum(sided[face], sided[mesh.twins[face, side] // 3])
    sureness = mean(np.where(strong, surely, 0.0))
    weights = found.turn[begin] ** 2
    radius = np.interp(mean(widths(found)[begin], weights + 1e-12), *WIDTHS[::-1])
    radius = np.where(states == SHARP, 0.0, radius)
    lines_given = []
    for i, (low, high) in enumerate(zip(starts.tolist(), ends.tolist(), strict=True)):
        vertices = begin[low:high] if loops[i] else np.append(begin[low:high], end[high - 1])
        lines_given.append(
            CreaseLine(vertices.astype(np.intp), bool(loops[i]), bool(signed[i] >= 0),
                       float(strength[i]), float(radius[i]), float(sureness[i]), str(states[i]))
        )  # fmt: skip
    return lines_given


def _with_reasons(
    mesh: TriangleMesh, lines: list[CreaseLine], normals: Floats, settings: GeometrySettings
) -> list[CreaseLine]:
    # Sets the reason why each line stays as its state.
    if not lines:
        return []
    widest = settings.widest_fillet or _FILLET
    thin = _thin_vertices(mesh, np.concatenate([line.vertices for line in lines]), normals)
    given, at = [], 0
    for line in lines:
        of_line = thin[at : at + len(line.vertices)]
        at += len(line.vertices)
        state = THIN if of_line.mean() > 0.5 else FILLET if line.width > widest else UNSURE
        given.append(replace(line, state=state))
    return given


def _thin_vertices(mesh: TriangleMesh, vertices: npt.NDArray[np.intp], normals: Floats) -> Bools:
    # Whether, close to each vertex, another part of the surface faces the opposite way.
    centers = mesh.scaled_vertices[mesh.faces].mean(axis=1)
    tree = point_tree(centers)
    thin = np.zeros(len(vertices), dtype=bool)
    start, corners = mesh.corners
    for i, v in enumerate(vertices):
        if i % _AT_ONCE == 0:  # one search for all would block other threads for too long
            ask()
            points = mesh.scaled_vertices[vertices[i : i + _AT_ONCE]]
            first, near = points_within(tree, points, _WALL + 1.0)
        others = near[first[i % _AT_ONCE] : first[i % _AT_ONCE + 1]]
        around = normals[corners[start[v] : start[v + 1]] // 3]
        away = centers[others] - mesh.scaled_vertices[v]
        across = np.abs(away @ around.T) < _WALL
        thin[i] = ((normals[others] @ around.T < _OPPOSITE_COSINE) & across).any()
    return thin


@kernel
def _trace(vertices, faces, twins, corner_start, corners, left, degrees, edges, starts, loops):
    # Traces lines from node to node, then loops; returns how many there are.
    count = lines = 0
    for v in vertices:
        for i in range(corner_start[v], corner_start[v + 1]):
            h = corners[i]
            if not left[h // 3, h % 3]:
                continue
            starts[lines] = count
            loops[lines] = degrees[v] == 2
            lines += 1
            while h >= 0:
                twin = twins[h // 3, h % 3]
                left[h // 3, h % 3] = False
                left[twin // 3, twin % 3] = False
                edges[count] = h
                count += 1
                w = faces[h // 3, after(h % 3)]
                h = -1
                if degrees[w] == 2 and w != v:
                    for j in range(corner_start[w], corner_start[w + 1]):
                        if left[corners[j] // 3, corners[j] % 3]:
                            h = corners[j]
    return lines
