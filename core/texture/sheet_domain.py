# SPDX-License-Identifier: GPL-3.0-or-later
"""The texels of an atlas as a domain.

Windows reach across seams, so that both sides of a seam agree on contrasts and limits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.advect import advect_texels
from ..atlas.ghosts import fill_ghosts
from ..atlas.potential import texel_potential
from ..atlas.walk import shock_flow
from ..atlas.windows import smooth_as_far, texel_ranges
from ..base.progress import phase
from ..color.by_width.dials import contrast
from ..color.by_width.domain import Domain, Nearby
from ..grid.channels import Channels

Texels = npt.NDArray[np.float32]


@dataclass(frozen=True)
class SheetDomain(Domain):
    """Nodes and ghosts of an atlas, (rows, columns, c) float32.

    Attributes
    ----------
    atlas : TextureAtlas
    channels : Channels
    nearest : bool
        Whether the nearest node is read at the ends of flow-lines.
    normals : bool
        Whether the first two channels are tangent-space directions around 1/2, which rotate across
        seams. They flow, and have no unsharp part.
    """

    atlas: TextureAtlas
    channels: Channels
    nearest: bool = False
    normals: bool = False

    def each_nearby(
        self,
        values: Texels,
        sigma: float,
        distance: float,
        use: Callable[[Any, Nearby], None],
    ) -> None:
        """Call `use` once, for all nodes and ghosts."""
        use((..., self._chosen), self._nearby(values, sigma, int(np.ceil(distance))))

    def _nearby(self, values: Texels, sigma: float, reach: int) -> Nearby:
        own = np.ascontiguousarray(values[..., self._chosen])
        if self.normals:
            return Nearby(own, own, own, own)
        if self.channels.alpha < 0:
            with phase(0.0, 0.5, "Sharpening"):
                smooth = smooth_as_far(self.atlas, own.copy(), sigma)
            with phase(0.5, 1.0, "Sharpening"):
                return Nearby(own, smooth, *texel_ranges(self.atlas, own, reach))
        opacity = values[..., self.channels.alpha, None]
        both = np.concatenate([own * opacity, opacity], axis=2)
        with phase(0.0, 0.5, "Sharpening"):
            both = smooth_as_far(self.atlas, both, sigma)
        smooth, spread = both[..., :-1], both[..., -1:]
        np.divide(smooth, spread, out=smooth, where=spread > 0)
        hidden = opacity == 0
        with phase(0.5, 1.0, "Sharpening"):
            return Nearby(own, smooth, *texel_ranges(self.atlas, own, reach, hidden), hidden)

    def contrasts(self, values: Texels, presmooth: float, reach: float) -> Texels:
        """Measure contrasts: (rows, columns)."""
        guides = values[..., self._chosen]
        brightness, alpha = self.channels.brightness, self.channels.alpha
        if brightness.size:
            guides = guides[..., : brightness.size] @ brightness[:, None]
        guides = np.array(guides, dtype=np.float32, order="C")
        if alpha >= 0:
            guides *= values[..., alpha, None]
        with phase(0.0, 0.2, "Computing the flow"):
            guides = smooth_as_far(self.atlas, guides, presmooth)
        with phase(0.2, 0.6, "Computing the flow"):
            low, high = texel_ranges(self.atlas, guides, round(reach))
        with phase(0.6, 1.0, "Computing the flow"):
            around = np.ascontiguousarray(contrast(low, high)[..., None])
            return smooth_as_far(self.atlas, around, reach / 2.0)[..., 0]

    def potential(self, values: Texels, passes: int) -> Texels:
        """Compute P: (rows, columns)."""
        return texel_potential(self.atlas, values, self.channels, passes, normals=self.normals)

    def advect(self, values: Texels, potential: Texels, times: float | Texels, out: Texels) -> None:
        """Advect the texels, across seams."""
        flow = shock_flow(self.atlas, potential)
        advect_texels(self.atlas, values, self.channels, flow, times, out,
                      nearest=self.nearest, normals=self.normals)  # fmt: skip

    def complete(self, values: Texels) -> None:
        """Read the ghosts from across the seams."""
        fill_ghosts(self.atlas.sheet, self.atlas.sources, values, self.channels.alpha)

    @property
    def _chosen(self) -> slice:
        return slice(self.channels.start, self.channels.stop)
