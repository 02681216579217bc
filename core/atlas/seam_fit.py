# SPDX-License-Identifier: GPL-3.0-or-later
"""Fine adjustment of the texels around charts, so that both sides of a seam show one value.

Such a texel is seen only by linear sampling next to the seam. Its value from across the seam is
right up to the error of interpolation; least squares over samples along the seams remove that
error and change only these texels.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import Floats
from ..base.parallel import kernel, run
from ..base.progress import aside, ask
from ..linear.cg import solve
from ..linear.system import LinearSystem
from ..sparse.matrix import (
    added,
    applied,
    diagonal_matrix,
    from_triples,
    in_double,
    in_order,
    product,
    transposed,
)
from .atlas import TextureAtlas
from .metric import open_places
from .sheet import NOTHING, ROWS

_SPACING = 0.5
"""Distance of the samples along a seam, in texels."""

_HOLD = 0.02
"""Weight of the texels' values from across the seam, per sample of weight 1."""

_TOLERANCE = 3e-2
"""Residual of the least squares, relative to its right-hand side (see `SolveReport`)."""

_SLACK = 0.5
"""How far a texel may leave the range around it, in multiples of that range. Its centre is not
visible; on the chart, where it is interpolated, values are in the range of both sides."""


class SeamFit:
    """The least-squares problem of an atlas, for any number of textures."""

    def __init__(self, atlas: TextureAtlas) -> None:
        self._atlas = atlas
        count = atlas.sheet.nodes.size
        self._free = free = atlas.owners[(atlas.owners != NOTHING) & ~atlas.inside]
        ask()
        reads, weights = _seam_samples(atlas)
        ask()
        numbers = np.full(count, -1, dtype=np.int32)
        numbers[free] = np.arange(len(free), dtype=np.int32)
        columns = numbers[reads]
        useful = (columns >= 0).any(axis=1)
        self._reads, self._weights = reads[useful], weights[useful]
        self._columns = columns = columns[useful]
        if len(columns) == 0:
            return
        ask()
        known = columns >= 0
        rows = np.broadcast_to(np.arange(len(columns))[:, None], columns.shape)
        entries = rows[known], columns[known], self._weights[known]
        reading = from_triples(*entries, (len(columns), len(free)))
        ask()
        back = transposed(reading)
        normal = in_double(in_order(product(back, reading)))
        self._back = in_double(back)
        held = added(normal, diagonal_matrix(np.full(len(free), _HOLD)))
        self._system = LinearSystem.from_csr(held)

    def apply(self, values: npt.NDArray[np.float32], step: float) -> None:
        """Adjust ghosts that own a texel, in place; `values` are (rows, columns, c) of the sheet.

        Visible values on the charts stay in the range of values along the seam there, and no
        value leaves the range of the texture. Results will be rounded to multiples of `step`
        (0 for floats), which gives at least that much freedom where values are equal.
        """
        if len(self._columns) == 0:
            return
        atlas, free = self._atlas, self._free
        flat = values.reshape(-1, values.shape[2])
        ask()
        jumps = np.empty((len(self._reads), flat.shape[1]), dtype=np.float32)
        run(_read, len(jumps), self._reads, self._weights, flat, jumps)
        largest = np.abs(jumps).max(axis=0).astype(np.float64)
        largest[largest == 0] = 1.0
        # Scale columns to one size, so that units of the values do not matter.
        adjustment = largest * self._least_squares(jumps / largest)
        adjusted = flat[free] - adjustment.astype(np.float32)
        low = flat[free]
        high = low.copy()
        _widen(self._reads, self._columns, flat, low, high)
        slack = np.maximum(_SLACK * (high - low), np.float32(step))
        shape = -(-atlas.height // ROWS), flat.shape[1]
        least, most = np.full(shape, np.inf, np.float32), np.full(shape, -np.inf, np.float32)
        with aside("Filling the gutter"):
            run(_bound, atlas.height, atlas.owners, atlas.inside, flat, least, most, chunk=ROWS)
        low = np.maximum(low - slack, least.min(axis=0))
        high = np.minimum(high + slack, most.max(axis=0))
        flat[free] = np.clip(adjusted, low, high)

    def _least_squares(self, wanted: Floats) -> Floats:
        # min |A x - wanted|^2 + hold |x|^2 for all columns at once.
        message = "Filling the gutter"
        with aside(message):
            rhs = applied(self._back, wanted)
            return solve(self._system, rhs, _TOLERANCE, message=message)[0]


def _seam_samples(atlas: TextureAtlas) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float32]]:
    # Nodes that linear sampling of the image reads on both sides of seams, and their weights,
    # negative on the second side: (samples, 8). There are no samples at closed places and next to
    # borders of the mesh.
    borders, twins, points = atlas.charts.borders, atlas.mesh.twins.reshape(-1), atlas.charts.points
    seams = borders[twins[borders] > borders]  # each seam once
    face, k = np.divmod(np.stack([seams, twins[seams]]), 3)
    begin = points[face, k]
    along = points[face, (k + 1) % 3] - begin
    longest = np.sqrt(along[..., 0] ** 2 + along[..., 1] ** 2).max(axis=0)
    counts = np.ceil(longest / _SPACING).astype(np.int64)
    seam = np.repeat(np.arange(len(seams)), counts)
    number = np.arange(len(seam)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (number + 0.5) / counts[seam]
    goes_on = open_places(atlas.metric.ways, seams[seam], share)
    seam, share = seam[goes_on], share[goes_on]
    places = begin[:, seam] + np.stack([share, 1.0 - share])[..., None] * along[:, seam]
    ask()
    first = np.floor(places).astype(np.int64)
    rows = (first[..., 0, None, None] + [[0], [1]]) % atlas.height
    columns = (first[..., 1, None, None] + [[0, 1]]) % atlas.width
    nodes = np.moveaxis(atlas.owners[rows, columns], 1, 0).reshape(-1, 8)
    parts = np.stack([1.0 - (places - first), places - first], axis=-1)
    weights = parts[:, :, 0, :, None] * parts[:, :, 1, None, :]
    weights[1] *= -1.0
    weights = np.moveaxis(weights, 1, 0).reshape(-1, 8)
    complete = (nodes != NOTHING).all(axis=1)
    return nodes[complete], weights[complete].astype(np.float32)


@kernel
def _read(start, stop, reads, weights, values, jumps):
    for sample in range(start, stop):
        for c in range(values.shape[1]):
            total = np.float32(0)
            for slot in range(8):
                total += weights[sample, slot] * values[reads[sample, slot], c]
            jumps[sample, c] = total


@kernel
def _bound(start, stop, owners, inside, values, lows, highs):
    low = np.full(values.shape[1], np.float32(np.inf), dtype=np.float32)
    high = -low
    for y in range(start, stop):
        for x in range(owners.shape[1]):
            if inside[y, x]:
                node = owners[y, x]
                for c in range(values.shape[1]):
                    low[c] = min(low[c], values[node, c])
                    high[c] = max(high[c], values[node, c])
    lows[start // ROWS] = low
    highs[start // ROWS] = high


@kernel
def _widen(reads, columns, values, low, high):
    # Extends each free node's range by the values of the samples that read it.
    for sample in range(reads.shape[0]):
        for c in range(values.shape[1]):
            least = most = values[reads[sample, 0], c]
            for slot in range(1, 8):
                value = values[reads[sample, slot], c]
                least = min(least, value)
                most = max(most, value)
            for slot in range(8):
                number = columns[sample, slot]
                if number >= 0:
                    low[number, c] = min(low[number, c], least)
                    high[number, c] = max(high[number, c], most)
