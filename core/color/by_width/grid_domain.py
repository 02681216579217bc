# SPDX-License-Identifier: GPL-3.0-or-later
"""The pixels of an image as a domain.

Neighbourhoods are computed in bands of rows, on threads, with the rows around them that windows
reach.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ...base.checks import SCALES
from ...base.parallel import run
from ...grid.advect import advect_pixels
from ...grid.borders import guide_planes
from ...grid.channels import Channels
from ...grid.part import Part
from ...grid.potential import image_potential
from ...grid.windows import gaussian, least_and_greatest, smooth
from ...settings import ImageSettings
from .dials import contrast
from .domain import Domain, Nearby

_FEWEST_ROWS = 64


@dataclass(frozen=True)
class GridDomain(Domain):
    """Pixels, (h, w, c) of any real type.

    Attributes
    ----------
    channels : Channels
    scale : float
        Factor that brings values to [0, 1].
    nearest : bool
        Whether the nearest pixel is read at the ends of flow-lines.
    part : Part or None
        The wanted pixels, if the image is a part of another one.
    """

    channels: Channels
    scale: float
    nearest: bool
    part: Part | None

    @classmethod
    def of(
        cls, pixels: npt.NDArray, channels: Channels, settings: ImageSettings, part: Part | None
    ) -> GridDomain:
        """Make the domain of an image."""
        return cls(channels, SCALES[pixels.dtype.name], settings.sampling == "nearest", part)

    def each_nearby(
        self,
        values: npt.NDArray,
        sigma: float,
        distance: float,
        use: Callable[[Any, Nearby], None],
    ) -> None:
        """Call `use` for bands of rows of one channel, in the image's range."""
        start, stop, alpha, _ = self.channels
        weights = gaussian(sigma)
        reach, halo = int(np.ceil(distance)), nearby_reach(sigma, distance)

        def take(top: int, bottom: int) -> None:
            first = max(top - halo, 0)
            band = values[first : bottom + halo]
            inner = slice(top - first, bottom - first)
            opacity = None
            if alpha >= 0:
                opacity = np.ascontiguousarray(band[..., alpha], dtype=np.float32)
                spread, hidden = smooth(opacity, weights), opacity == 0
            for c in range(start, stop):
                own = np.ascontiguousarray(band[..., c], dtype=np.float32)
                low, high = own.copy(), own.copy()
                if opacity is None:
                    smoothed = smooth(own, weights)
                else:
                    smoothed = smooth(own * opacity, weights)
                    np.divide(smoothed, spread, out=smoothed, where=spread > 0)
                    low[hidden], high[hidden] = np.inf, -np.inf
                least_and_greatest(low, high, reach)
                nearby = Nearby(own[inner], smoothed[inner], low[inner], high[inner])
                if opacity is not None:
                    nearby = nearby._replace(hidden=hidden[inner])
                use((slice(top, bottom), slice(None), c), nearby)

        run(take, len(values), chunk=max(_FEWEST_ROWS, halo))

    def contrasts(self, values: npt.NDArray, presmooth: float, reach: float) -> npt.NDArray:
        """Measure contrasts of values in [0, 1]: (h, w) float32."""
        before, after = gaussian(presmooth), gaussian(reach / 2.0)
        halo = contrast_reach(presmooth, reach)
        out = np.empty(values.shape[:2], np.float32)

        def fill(top: int, bottom: int) -> None:
            first = max(top - halo, 0)
            planes = guide_planes(values, self.scale, self.channels, slice(first, bottom + halo))
            low = np.stack([smooth(plane, before) for plane in planes])
            high = low.copy()
            for least, greatest in zip(low, high, strict=True):
                least_and_greatest(least, greatest, round(reach))
            around = smooth(contrast(np.moveaxis(low, 0, -1), np.moveaxis(high, 0, -1)), after)
            out[top:bottom] = around[top - first : bottom - first]

        run(fill, len(values), chunk=max(_FEWEST_ROWS, halo))
        return out

    def potential(self, values: npt.NDArray, passes: int) -> npt.NDArray:
        """Compute P: (h, w) float32."""
        return image_potential(values, self.scale, self.channels, passes)

    def advect(
        self,
        values: npt.NDArray,
        potential: npt.NDArray,
        times: float | npt.NDArray,
        out: npt.NDArray,
    ) -> None:
        """Advect the image.

        Raises
        ------
        LeftPart
            If the part is too small for the pixels that are wanted.
        """
        advect_pixels(values, self.channels, potential, times, out, nearest=self.nearest,
                      part=self.part)  # fmt: skip


def nearby_reach(sigma: float, distance: float) -> int:
    """Return the radius in pixels within which an image affects a `Nearby`."""
    return max(len(gaussian(sigma)), int(np.ceil(distance)))


def contrast_reach(presmooth: float, reach: float) -> int:
    """Return the radius in pixels within which an image affects the contrast."""
    return len(gaussian(presmooth)) + round(reach) + len(gaussian(reach / 2.0))
