# SPDX-License-Identifier: GPL-3.0-or-later
"""The analysis of a texture atlas: from a mesh and its texture coordinates to texels."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..base.checks import BAND, SCALES, as_array, by_keyword, checked_size
from ..base.findings import Finding
from ..base.parallel import blocks, kernel, run
from ..base.progress import ProgressCallback, phase, reporting
from ..errors import InvalidSignal
from ..mesh.triangle_mesh import Floats, Ints, TriangleMesh, check_mesh
from .charts import degenerate_faces, find_charts
from .ghosts import find_sources
from .metric import Ways, measure_metric
from .sheet import (
    NOTHING,
    ROWS,
    clearly_within,
    ends,
    lay_out,
    nearest_on_edge,
    shares_of_corners,
    span,
)


@dataclass(frozen=True)
class UVReport:
    """Unusual properties of texture coordinates; none of them stops the filters.

    Attributes
    ----------
    charts : int
        Number of charts.
    overlapping : (k,) int
        Faces that share texels with other faces. A texel holds only one value: it is filtered
        where the first of the faces lies.
    mirrored : (k,) int
        Faces whose orientation in the texture differs from that of most faces.
    outside : (k,) int
        Faces with corners outside the image, where it repeats; whole tiles do not count.
    degenerate : (k,) int
        Faces without area in the texture; flow-lines cross them, they show one line of texels.

    Examples
    --------
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = 1.5 + mesh.vertices[mesh.faces][..., :2]
    >>> core.TextureAtlas(mesh, uv, size=(8, 8)).report.sentences()
    ['Faces that leave the image, which repeats there: 2.']
    """

    charts: int
    overlapping: npt.NDArray[np.intp]
    mirrored: npt.NDArray[np.intp]
    outside: npt.NDArray[np.intp]
    degenerate: npt.NDArray[np.intp]

    def sentences(self, made: bool = False) -> list[str]:
        """Describe what was found in sentences; empty if there is nothing.

        Parameters
        ----------
        made : bool
            Whether the image was made from the surface, not filtered.
        """
        return [str(each) for each in self.findings(made)]

    def findings(self, made: bool = False) -> list[Finding]:
        """Return what `sentences` says, with the numbers apart, so that it can be translated."""
        found = [
            (
                self.overlapping,
                "Faces that overlap in the texture, which holds the values of the first: {count}."
                if made
                else "Faces that overlap in the texture, and are filtered where the first lies:"
                " {count}.",
            ),
            (self.outside, "Faces that leave the image, which repeats there: {count}."),
            (self.degenerate, "Faces that have no area in the texture: {count}."),
        ]
        return [Finding(text, {"count": len(faces)}) for faces, text in found if len(faces)]


@dataclass(frozen=True)
class TextureMasks:
    """Classification of the texels: all arrays are (h, w), row 0 at v = 0.

    Attributes
    ----------
    active : bool
        Texels that linear sampling of some face reads.
    boundary : bool
        Active texels that are only partly covered by charts.
    face : int32
        The face in which the texel's centre lies, or -1.
    chart : int32
        The chart of that face, or -1.
    count : int32
        Number of charts that read the texel; a chart that meets itself around the image's rim
        counts twice.
    """

    active: npt.NDArray[np.bool_]
    boundary: npt.NDArray[np.bool_]
    face: Ints
    chart: Ints
    count: Ints


class TextureAtlas:
    """A mesh with texture coordinates, prepared for an image size.

    It can be used for all textures of this size on the same coordinates.

    Parameters
    ----------
    mesh : TriangleMesh
        Vertices that were split along seams should be welded first (see `core.weld_borders`): the
        flow ends at the borders of the mesh.
    uv : (m, 3, 2) array of float
        Texture coordinates of the corners of the faces that the mesh was made from. The image
        covers 0 to 1 and repeats beyond.
    size : (int, int)
        Rows and columns of the image.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Attributes
    ----------
    report : UVReport
        Unusual properties of the coordinates.
    charts : Charts
        The parts of the texture in which faces are connected.
    sheet : Sheet
        The layout of the texels, separated by chart.
    metric : AtlasMetric
        The surface's metric in each face.
    sources : GhostSources
        What the ghosts around each chart are interpolated from, across seams.
    owners : (h, w) int32
        The node, counted along the sheet's rows, whose value each texel receives; -1: none.
    copies : (k, 2) int32
        Nodes inside charts that do not own their texel, each with the node that does.

    Raises
    ------
    InvalidUV
        If the coordinates are missing, do not fit the mesh, hold NaN or infinity, have no area,
        or cover the image more than sixteen times.
    InvalidSettings
        If the size cannot be used.
    Cancelled
        If `progress` returned False.

    Notes
    -----
    Paper B, section 3. The metric is that of the faces, constant in each. The sheet has as many
    nodes as the image has texels, and more where charts overlap or touch; each costs about 20
    bytes.

    Examples
    --------
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = 0.25 + 0.5 * mesh.vertices[mesh.faces][..., :2]
    >>> atlas = core.TextureAtlas(mesh, uv, size=(8, 8))
    >>> atlas.texel_size
    0.25
    >>> atlas.bake(mesh.vertices[mesh.faces][..., 0])[4]
    array([0.   , 0.   , 0.125, 0.375, 0.625, 0.875, 0.   , 0.   ])
    """

    @by_keyword
    def __init__(
        self,
        mesh: TriangleMesh,
        uv: npt.ArrayLike,
        *,
        size: tuple[int, int],
        progress: ProgressCallback | None = None,
    ) -> None:
        check_mesh(mesh)
        self.mesh = mesh
        self.height, self.width = checked_size(size)
        with reporting(progress):
            self._analyse(uv)

    def _analyse(self, uv: npt.ArrayLike) -> None:
        with phase(0.0, 0.2, "Finding charts"):
            self.charts = find_charts(self.mesh, uv, self.height, self.width)
        with phase(0.2, 0.8, "Finding texels"):
            self.sheet = lay_out(self.charts, self.height, self.width)
        with phase(0.8, 0.85, "Finding texels"):
            self.metric = measure_metric(self.mesh, self.charts, self.sheet.points)
        with phase(0.85, 0.95, "Finding texels"):
            self.sources, self._taken = find_sources(self.sheet, self.metric)
        overlapping = self.sheet.overlapping.copy()
        with phase(0.95, 1.0, "Finding texels"):
            self.owners = _owned_within(self.sheet.nodes, self.height, self.width)
            self.copies = _own_elsewhere(self.charts, self.sheet, self.owners, overlapping)
            _own_ghosts(self.charts, self.sheet, self.sources, self.owners)
        areas = self.charts.areas
        self.report = UVReport(
            len(self.charts.boxes),
            np.flatnonzero(overlapping),
            np.flatnonzero(areas < 0 if areas.sum() >= 0 else areas > 0),
            np.flatnonzero(self.charts.outside),
            np.flatnonzero(degenerate_faces(self.charts)),
        )

    def closed(self, starts: Ints, closed: npt.NDArray[np.bool_]) -> TextureAtlas:
        """Return the atlas with parts of seams closed, as if the surface ended at them.

        Parameters
        ----------
        starts : (3 m + 1,) int32
        closed : (parts,) bool
            See `Ways`. Ghosts beyond a closed part continue the chart's own values.
        """
        other = copy(self)
        other.metric = self.metric._replace(ways=Ways(self.mesh.twins, starts, closed))
        cells = self.sheet.cells.copy()
        cells.reshape(-1)[self._taken.numbers] = self._taken.faces
        other.sheet = self.sheet._replace(cells=cells)
        other.sources, other._taken = find_sources(other.sheet, other.metric)
        other.owners = np.where(self.inside, self.owners, np.int32(NOTHING))
        _own_ghosts(self.charts, other.sheet, other.sources, other.owners)
        return other

    @property
    def texel_size(self) -> float:
        """Mean length of a texel on the surface, in the unit of the mesh."""
        return self.metric.texel_size

    @cached_property
    def inside(self) -> npt.NDArray[np.bool_]:
        """Texels whose centre lies in a face: (h, w) bool."""
        found = np.empty(self.owners.shape, dtype=np.bool_)
        nodes = self.sheet.nodes.reshape(-1)
        for rows in blocks(self.height, BAND):
            found[rows] = nodes[self.owners[rows]] >= 0  # the last node is empty, for owner -1
        return found

    @cached_property
    def lone(self) -> npt.NDArray[np.int32]:
        """A face of a chart that contains no texel centre, at texels that it reads; else -1.

        (h, w) int32. Such charts are points, lines, or smaller than a texel, as in palettes of
        colors. Their values are those of the texels around them. Texels whose centre lies in a face
        belong to that face.
        """
        sheet, labels = self.sheet, self.charts.labels
        empty = np.ones(len(self.charts.boxes), dtype=np.bool_)
        for rows in blocks(len(sheet.nodes), BAND):
            nodes = sheet.nodes[rows]
            empty[labels[nodes[nodes >= 0]]] = False
        if not empty.any():
            return np.broadcast_to(np.int32(NOTHING), self.owners.shape)
        found = np.full(self.owners.shape, NOTHING, dtype=np.int32)
        faces = sheet.ghost_edges // 3  # -1 for ghosts without an edge
        which = np.flatnonzero((faces >= 0) & empty[labels[faces]])
        places = np.stack(np.divmod(sheet.ghosts[which], sheet.nodes.shape[1]), axis=1)
        places -= sheet.shifts[labels[faces[which]]]
        found[places[:, 0] % self.height, places[:, 1] % self.width] = faces[which]
        found[self.inside] = NOTHING
        return found

    def gather(self, pixels: npt.NDArray) -> npt.NDArray[np.float32]:
        """Copy an image (h, w, c) to the sheet, scaled to white = 1: (rows, columns, c)."""
        scale = SCALES[pixels.dtype.name]
        values = np.zeros((*self.sheet.nodes.shape, pixels.shape[2]), dtype=np.float32)
        pixels = np.ascontiguousarray(pixels)
        run(_gather, len(values), self.charts, self.sheet, pixels, scale, values, chunk=ROWS)
        return values

    def bake(self, values: npt.ArrayLike) -> Floats:
        """Draw a signal at the corners of the faces into texels.

        Parameters
        ----------
        values : (m, 3) or (m, 3, d) array of float
            Values at the corners of the faces that the mesh was made from, such as vertex weights.

        Returns
        -------
        (h, w) or (h, w, d) float64
            Linear in each face; zero at texels whose centre is in no face.

        Raises
        ------
        InvalidSignal
            If the values do not fit the mesh or are not finite.
        """
        given = as_array(values, "values")
        if given.dtype.kind not in "biuf":
            raise InvalidSignal(f"The values are of type {given.dtype}; give floats.")
        given = given.astype(np.float64)
        count = self.mesh.face_count
        if given.ndim not in (2, 3) or given.shape[:2] != (count, 3):
            raise InvalidSignal(
                f"The values have the shape {given.shape}; give ({count}, 3) or ({count}, 3, d)."
            )
        if not np.isfinite(given).all():
            raise InvalidSignal("The values hold NaN or infinity; replace these first.")
        corners = self.mesh.own_corners(given).reshape(count, 3, -1)
        out = np.zeros((self.height, self.width, corners.shape[2]))
        run(_bake, self.height, self.owners, self.sheet.nodes, self.sheet.points, corners, out,
            chunk=ROWS)  # fmt: skip
        return out[..., 0] if given.ndim == 2 else out

    def masks(self) -> TextureMasks:
        """Classify the texels, for debugging and as masks for other tools."""
        cut = np.zeros(self.sheet.nodes.shape, dtype=np.bool_)
        _mark_cut(self.charts.borders, self.sheet.points, cut)
        boundary = np.zeros(self.owners.shape, dtype=np.bool_)
        count = np.zeros(self.owners.shape, dtype=np.int32)
        _count_charts(self.charts, self.sheet, cut, boundary, count)
        face = np.where(self.inside, self.sheet.nodes.reshape(-1)[self.owners], NOTHING)
        chart = np.where(self.inside, self.charts.labels[face], NOTHING)
        return TextureMasks(count > 0, boundary, face, chart, count)


@kernel
def _texel(charts, sheet, y, x, height, width):
    # The texel (row, column) of a node; (-1, -1) if there is none, or for a ghost without an edge.
    node = sheet.nodes[y, x]
    if node == NOTHING:
        return -1, -1
    face = node if node >= 0 else sheet.ghost_edges[-2 - node] // 3
    if face < 0:
        return -1, -1
    label = charts.labels[face]
    row, column = y - sheet.shifts[label, 0], x - sheet.shifts[label, 1]
    # Tested first, as this is rare and dividing is slow.
    if not 0 <= row < height:
        row %= height
    if not 0 <= column < width:
        column %= width
    return row, column


def _owned_within(nodes: Ints, height: int, width: int) -> Ints:
    # The owners in charts whose place in the sheet is that in the image.
    numbers = np.arange(nodes.size, dtype=np.int32).reshape(nodes.shape)
    within = slice(1, height + 1), slice(1, width + 1)
    return np.where(nodes[within] >= 0, numbers[within], np.int32(NOTHING))


@kernel
def _own_elsewhere(charts, sheet, owners, overlapping):
    # Nodes inside charts on shelves or beyond the image's rim own the texels that are left. Returns
    # the nodes that own no texel, each with the owner of its texel.
    nodes, points = sheet.nodes, sheet.points
    height, width = owners.shape
    rows, columns = nodes.shape
    copies = np.empty((np.count_nonzero(nodes >= 0) - np.count_nonzero(owners >= 0), 2), np.int32)
    count = 0
    for y in range(rows):
        for x in range(columns):
            if nodes[y, x] < 0 or (1 <= y <= height and 1 <= x <= width):
                continue
            row, column = _texel(charts, sheet, y, x, height, width)
            owner = owners[row, column]
            if owner == NOTHING:
                owners[row, column] = y * columns + x
                continue
            copies[count, 0] = y * columns + x
            copies[count, 1] = owner
            count += 1
            b, a = divmod(owner, columns)
            face = nodes[b, a]
            if clearly_within(points[nodes[y, x]], y, x) and clearly_within(points[face], b, a):
                overlapping[nodes[y, x]] = True
                overlapping[face] = True
    return copies[:count].copy()


@kernel
def _own_ghosts(charts, sheet, sources, owners):
    # If several ghosts with a source share a texel, the one nearest to its chart owns it.
    nodes, ghosts, edges, points = sheet.nodes, sheet.ghosts, sheet.ghost_edges, sheet.points
    height, width = owners.shape
    columns = nodes.shape[1]
    for ghost in range(ghosts.shape[0]):
        if sources.cells[ghost] < 0:
            continue
        y, x = divmod(ghosts[ghost], columns)
        row, column = _texel(charts, sheet, y, x, height, width)
        owner = owners[row, column]
        if owner != NOTHING:
            b, a = divmod(owner, columns)
            if nodes[b, a] >= 0:
                continue
            _, other = nearest_on_edge(points, edges[-2 - nodes[b, a]], b, a)
            _, own = nearest_on_edge(points, edges[ghost], y, x)
            if other <= own:
                continue
        owners[row, column] = ghosts[ghost]


@kernel
def _gather(start, stop, charts, sheet, pixels, scale, values):
    height, width = pixels.shape[:2]
    for y in range(start, stop):
        for x in range(sheet.nodes.shape[1]):
            row, column = _texel(charts, sheet, y, x, height, width)
            if row < 0:
                continue
            for c in range(values.shape[2]):
                values[y, x, c] = pixels[row, column, c] * scale


@kernel
def _bake(start, stop, owners, nodes, points, corners, out):
    columns = nodes.shape[1]
    for row in range(start, stop):
        for column in range(out.shape[1]):
            owner = owners[row, column]
            if owner == NOTHING:
                continue
            y, x = divmod(owner, columns)
            f = nodes[y, x]
            if f < 0:
                continue
            first, second, third = shares_of_corners(points, f, y, x)
            for c in range(out.shape[2]):
                out[row, column, c] = (
                    first * corners[f, 0, c] + second * corners[f, 1, c] + third * corners[f, 2, c]
                )


@kernel
def _mark_cut(borders, points, cut):
    # Marks the cells that the outlines of charts run through.
    line = np.empty((3, 2))
    for edge in borders:
        line[0, 0], line[0, 1], line[1, 0], line[1, 1] = ends(points, edge)
        line[2] = line[1]
        low = int(np.floor(min(line[0, 0], line[1, 0])))
        high = int(np.floor(max(line[0, 0], line[1, 0])))
        for row in range(low, high + 1):
            first, last = span(line, row, row + 1)
            if last >= first:
                for column in range(int(np.floor(first)), int(np.floor(last)) + 1):
                    cut[row, column] = True


@kernel
def _count_charts(charts, sheet, cut, boundary, count):
    nodes = sheet.nodes
    height, width = count.shape
    for y in range(nodes.shape[0]):
        for x in range(nodes.shape[1]):
            row, column = _texel(charts, sheet, y, x, height, width)
            if row < 0:
                continue
            count[row, column] += 1
            # The sheet's last row and column are empty, so that -1 may stand for them.
            if cut[y, x] or cut[y - 1, x] or cut[y, x - 1] or cut[y - 1, x - 1] or nodes[y, x] < 0:
                boundary[row, column] = True
