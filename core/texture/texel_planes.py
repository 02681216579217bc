# SPDX-License-Identifier: GPL-3.0-or-later
"""Channels of a texture as planes of a sheet, whose windows reach across seams.

Filters proceed in steps of one texel; after each step, the ghosts around charts are updated from
across the seams. Lengths are in texels. Beyond the border of the surface, its last texels are
repeated.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.advect import advect_texels
from ..atlas.cell_means import CellMeans
from ..atlas.ghosts import fill_planes, find_reads
from ..atlas.potential import smooth_texels, texel_potential
from ..atlas.sheet import ROWS
from ..atlas.walk import shock_flow
from ..base.parallel import kernel, run
from ..base.progress import aside, ask, phase
from ..color.learned.planes import (
    NONE,
    Plan,
    Planes,
    WholePlanes,
    mix_potentials,
    planes_of,
    variance_of,
)
from ..color.learned.surroundings import Singles, averages
from ..grid.channels import Channels
from ..grid.part import Part
from ..grid.windows import smooth, smooth_rows

_MESSAGE = "Sharpening"

_VARIANCE = 0.5
"""Largest variance of a smoothing pass, along each axis."""

_LEAST, _MOST = 1 / 4096, 4096.0
"""Bounds of the squared area of a texel, which is the factor of its flow time: lengths of 1/8 and
8."""


class Surface:
    """Data of one atlas that its planes share.

    Parameters
    ----------
    atlas : TextureAtlas
    """

    def __init__(self, atlas: TextureAtlas) -> None:
        self.atlas = atlas
        sheet, sources = atlas.sheet, atlas.sources
        ends = sheet.ghosts[sources.cells < 0]
        nearest = np.empty_like(ends)
        with aside(_MESSAGE):
            run(_nearest_inside, len(ends), ends, sheet.nodes, nearest)
            self._reads = find_reads(sheet, sources)
        self._ends, self._nearest = ends[nearest >= 0], nearest[nearest >= 0]

    @cached_property
    def means(self) -> CellMeans:
        """Means over wide surroundings."""
        with aside(_MESSAGE):
            return CellMeans(self.atlas)

    @cached_property
    def inside(self) -> npt.NDArray[np.bool_]:
        """Nodes inside charts: (rows, columns)."""
        return self.atlas.sheet.nodes >= 0

    def complete(self, planes: Singles) -> Singles:
        """Fill the ghosts, in place: (k, rows, columns)."""
        with aside(_MESSAGE):
            fill_planes(self._reads, planes)
            for plane in planes:
                flat = plane.reshape(-1)
                flat[self._ends] = flat[self._nearest]
                ask()
        return planes

    def smooth(self, planes: Singles, variance: float) -> Singles:
        """Smooth planes whose ghosts are filled: (k, rows, columns)."""
        count = math.ceil(variance / _VARIANCE)
        side = np.float32(variance / count / 2.0)
        weights = np.array([1 - 2 * side, side], np.float32)
        spares: list[Singles] = []
        for number in range(count):
            out = spares.pop() if spares else np.empty_like(planes)
            with aside(_MESSAGE):
                for plane, target in zip(planes, out, strict=True):
                    run(_smooth_rows, len(plane), plane, weights, target, chunk=_CHUNK)
            if number > 0:  # the given planes must not change
                spares.append(planes)
            planes = self.complete(out)
        return planes

    def extremes(self, low: Singles, high: Singles, steps: int) -> None:
        """Take minima of `low` and maxima of `high` within some texels, in place."""
        spare = np.empty((2, *low.shape[1:]), np.float32)
        for _ in range(steps):
            for k in range(len(low)):
                spare[0], spare[1] = low[k], high[k]
                with aside(_MESSAGE):
                    run(_extremes, len(low[k]), *spare, low[k], high[k], chunk=_CHUNK)
            self.complete(low)
            self.complete(high)


_CHUNK = 4 * ROWS

_BESIDE, _FAINTEST = 10, 0.02
"""Distance from a seam with a step, in texels, from which weights are 1, and the weight at the
seam. That is not 0, because small charts have no other texels."""

_ORDINARY = 2.0
"""Squared second differences at a seam are ordinary up to this factor times those nearby."""

_NEARBY = np.array([5, 4, 3, 2, 1], np.float32) / np.float32(25)
"""Weights of the smoothing over texels nearby."""


@dataclass(frozen=True)
class TexelPlanes(WholePlanes):
    """Channels of a texture at the nodes and ghosts of a sheet, with or without opacity.

    Attributes
    ----------
    values, opacity
        As in `Planes`; (c, rows, columns) and (rows, columns).
    surface : Surface
    """

    surface: Surface = field(kw_only=True)

    @classmethod
    def of_texels(cls, surface: Surface, values: Singles, channels: Channels) -> TexelPlanes:
        """Take the filtered channels of nodes and ghosts, (rows, columns, c)."""
        planes = Planes.of(values, channels)
        if planes.opacity.size:
            surface.complete(planes.opacity[None])
        return cls(planes.values, planes.opacity, surface=surface).with_values(planes.values)

    def with_values(self, values: Singles) -> TexelPlanes:
        """Return other values of the same opacity; their ghosts are filled in place."""
        if not self.opacity.size:
            return replace(self, values=self.surface.complete(values))
        seen = self.opacity > 0
        sums = self.surface.complete(_times(values, self.opacity))
        beside = seen & ~self.surface.inside
        np.divide(sums, self.opacity, out=values, where=beside)
        values[:, ~seen] = 0
        return replace(self, values=values)

    def columns(self, start: int, stop: int) -> npt.NDArray[np.bool_]:
        """Return which texels of some rows, (rows * columns,), lie inside charts."""
        return self.surface.inside[start:stop].reshape(-1)

    def surroundings(self) -> _Means:
        """Return an object that computes means over wide surroundings."""
        return _Means(self.surface)

    @property
    def weighted(self) -> bool:
        """Whether energies have weights: always, see `away`."""
        return True

    @cached_property
    def away(self) -> Singles:
        """Weights of nodes in the measurement of sharpness: (rows, columns).

        They are 1, except beside seams with much larger second differences than nearby. There two
        materials meet in a step that is sharp whatever the blur, or a blur of the image has made
        both sides slightly different.
        """
        inside = self.surface.inside
        steps, around = np.zeros((2, *inside.shape), np.float32)
        for axis in (0, 1):
            ends = [[slice(None)] * 2 for _ in range(3)]
            for place, each in enumerate(ends):
                each[axis] = slice(place, place - 2 if place < 2 else None)
            before, here, behind = map(tuple, ends)
            bend = np.zeros(inside[here].shape, np.float32)
            for value in self.values:
                with aside(_MESSAGE):
                    bend += np.square(value[before] - 2 * value[here] + value[behind])
            bend *= inside[here]
            alone = inside[before] & inside[behind]
            around[here] += bend * alone
            steps[here] += bend * ~alone
        with aside(_MESSAGE):
            count = np.float32(_ORDINARY) / np.maximum(smooth(np.float32(inside), _NEARBY), 1e-3)
        with aside(_MESSAGE):
            usual = count * smooth(around, _NEARBY)
        with aside(_MESSAGE):
            spread = np.maximum(steps - usual, 0) / (steps + usual + np.float32(1e-30))
            for _ in range(_BESIDE):
                less = spread - np.float32(1 / _BESIDE)
                np.maximum(spread[1:], less[:-1], out=spread[1:])
                np.maximum(spread[:-1], less[1:], out=spread[:-1])
                np.maximum(spread[:, 1:], less[:, :-1], out=spread[:, 1:])
                np.maximum(spread[:, :-1], less[:, 1:], out=spread[:, :-1])
                spread *= inside
                ask()
        return np.float32(_FAINTEST) + np.float32(1 - _FAINTEST) * (1 - spread) ** 2

    def with_weights(self, energies: Singles, top: int, bottom: int) -> Singles:
        """Multiply energies of all rows by weights, and append these: (k + 1, rows, columns)."""
        weights = self.away
        found = np.empty((len(energies) + 1, *weights.shape), np.float32)
        _times(energies, weights, found[:-1])
        found[-1] = weights * self.opacity if self.opacity.size else weights
        return found

    def premultiplied(self) -> TexelPlanes:
        """Return the values times their opacity, as planes without opacity."""
        if not self.opacity.size:
            return self
        return replace(self, values=_times(self.values, self.opacity), opacity=NONE)

    def averaged(
        self, energies: Singles, first: int, sigma: float, top: int, bottom: int
    ) -> Singles:
        """Smooth energies that are weighted by opacity: (k, rows, columns)."""
        energies = self.surface.complete(np.ascontiguousarray(energies))
        if not self.opacity.size:
            return self.surface.smooth(energies, variance_of(sigma))
        both = _joined(energies, self.opacity)
        return averages(self.surface.smooth(both, variance_of(sigma)), True)

    def _smoothed(self, sigmas: tuple[float, ...]) -> Singles:
        out = np.empty((len(sigmas), *self.values.shape), np.float32)
        smooth, variance = self.premultiplied().values, 0.0
        if self.opacity.size:
            smooth = _joined(smooth, self.opacity)
        for number, (target, sigma) in enumerate(zip(out, sigmas, strict=True)):
            with phase((number / len(out)) ** 2, ((number + 1) / len(out)) ** 2, _MESSAGE):
                smooth = self.surface.smooth(smooth, variance_of(sigma) - variance)
            variance = variance_of(sigma)
            target[:] = smooth[: len(target)]
            if self.opacity.size:
                np.divide(target, smooth[-1], out=target, where=smooth[-1] > 0)
        return out

    def _found_ranges(self, reaches: tuple[int, ...]) -> tuple[Singles, Singles]:
        low, high = (np.empty((len(reaches), *self.values.shape), np.float32) for _ in range(2))
        hidden = self.opacity == 0 if self.opacity.size else None
        done = 0
        for r, reach in enumerate(reaches):
            ask(done / reaches[-1])
            low[r] = low[r - 1] if r else self.values
            ask(done / reaches[-1])
            high[r] = high[r - 1] if r else self.values
            if hidden is not None and r == 0:
                self._leave_out(hidden, low[r], high[r])
            self.surface.extremes(low[r], high[r], reach - done)
            done = reach
        if hidden is not None:
            low[..., hidden], high[..., hidden] = 0, 0
        return low, high

    def _leave_out(self, hidden: npt.NDArray[np.bool_], low: Singles, high: Singles) -> None:
        # Excludes hidden texels from minima and maxima.
        seen = ~hidden & self.surface.inside
        if seen.any():
            with aside(_MESSAGE):
                for least, most in zip(low, high, strict=True):
                    np.copyto(least, least.max(initial=-np.inf, where=seen), where=hidden)
                    ask()
                    np.copyto(most, most.min(initial=np.inf, where=seen), where=hidden)
                    ask()

    def flowed(
        self,
        plan: Plan,
        brightness: Singles,
        passes: int,
        nearest: bool,
        part: Part | None,
    ) -> TexelPlanes:
        """Advect the values, across seams.

        The flow is measured on the surface, but times are in units of texels, so that borders close
        alike in charts of any scale.
        """
        atlas = self.surface.atlas
        texels, channels = self.interleaved(brightness)
        with phase(0.3, 0.5, "Computing the flow"):
            potential = texel_potential(atlas, texels, channels, passes)
            wide = smooth_texels(atlas, potential[..., None].copy(), plan.passes)[..., 0]
            run(mix_potentials, len(wide), potential, wide, plan.shares, chunk=_CHUNK)
        areas = atlas.metric.texel_areas[np.maximum(atlas.sheet.nodes, 0)]
        with np.errstate(over="ignore"):  # an infinite time is allowed
            times = plan.times * np.clip(areas * areas, _LEAST, _MOST)
        out = texels.copy()
        with phase(0.5, 1.0, "Tracing flow-lines"):
            advect_texels(atlas, texels, channels, shock_flow(atlas, wide), times, out,
                          nearest=nearest)  # fmt: skip
        return self.with_values(planes_of(out[..., : channels.stop]))


class _Means:
    # Implements `Surroundings` for texels.

    def __init__(self, surface: Surface) -> None:
        self._means = surface.means
        self._height = len(surface.atlas.sheet.nodes)

    def means(self, count: int, energies: Callable[[int, int], Singles]) -> Singles:
        found = energies(0, self._height)
        with aside(_MESSAGE):
            return self._means.means(found)

    def smoothed(self, means: Singles, weighted: bool) -> Singles:
        with aside(_MESSAGE):
            return averages(self._means.smoothed(means), weighted)

    def of_region(self, means: Singles, weighted: bool) -> Singles:
        with aside(_MESSAGE):
            return averages(self._means.of_region(means), weighted)

    def rows(self, means: Singles, start: int, stop: int) -> Singles:
        return self._means.rows(means, start, stop)


def _times(planes: Singles, weights: Singles, out: Singles | None = None) -> Singles:
    # Multiplies each plane by the weights.
    out = np.empty_like(planes) if out is None else out
    with aside(_MESSAGE):
        for plane, target in zip(planes, out, strict=True):
            np.multiply(plane, weights, out=target)
            ask()
    return out


def _joined(planes: Singles, last: Singles) -> Singles:
    # Appends one plane to others.
    out = np.empty((len(planes) + 1, *last.shape), np.float32)
    with aside(_MESSAGE):
        for target, plane in zip(out, (*planes, last), strict=True):
            target[:] = plane
            ask()
    return out


@kernel
def _nearest_inside(start, stop, ghosts, nodes, out):
    columns = nodes.shape[1]
    for i in range(start, stop):
        y, x = divmod(ghosts[i], columns)
        out[i] = -1
        for n in (1, 3, 5, 7, 0, 2, 6, 8):
            b, a = y + n // 3 - 1, x + n % 3 - 1
            if 0 <= b < nodes.shape[0] and 0 <= a < columns and nodes[b, a] >= 0:
                out[i] = b * columns + a
                break


@kernel
def _smooth_rows(start, stop, plane, weights, out):
    smooth_rows(plane, 0, len(plane), weights, start, out[start:stop])


@kernel
def _extremes(start, stop, low, high, new_low, new_high):
    height, width = low.shape
    least, most = np.empty(width, np.float32), np.empty(width, np.float32)
    for y in range(start, stop):
        up, down = max(y - 1, 0), min(y + 1, height - 1)
        for x in range(width):
            least[x] = min(min(low[up, x], low[down, x]), low[y, x])
            most[x] = max(max(high[up, x], high[down, x]), high[y, x])
        a, b = new_low[y], new_high[y]
        for x in range(1, width - 1):
            a[x] = min(min(least[x - 1], least[x + 1]), least[x])
            b[x] = max(max(most[x - 1], most[x + 1]), most[x])
