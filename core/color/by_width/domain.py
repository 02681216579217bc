# SPDX-License-Identifier: GPL-3.0-or-later
"""The interface of a domain of signals: a mesh, a grid of pixels or a sheet of texels.

A `Domain` computes neighbourhoods and advects values. Each domain is a subclass in its own module:
`mesh_domain`, `grid_domain` and `core.texture.sheet_domain`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from ...base.progress import phase


class Nearby(NamedTuple):
    """The neighbourhood of each place in a piece of a signal; arrays of one shape.

    Attributes
    ----------
    values : array of float
        The signal itself.
    smooth : array of float
        The signal smoothed by a Gaussian.
    low, high : array of float
        The least and the greatest value within a distance.
    hidden : array of bool, optional
        Places that are fully transparent, whose values stay. May be broadcast.
    """

    values: npt.NDArray
    smooth: npt.NDArray
    low: npt.NDArray
    high: npt.NDArray
    hidden: npt.NDArray[np.bool_] | None = None


class Domain(Protocol):
    """The domain of a signal, with its filtered channels and the interpolation of values.

    Lengths are in the unit of the width: pixels, mean texel sizes or mean edge lengths. The first
    axis of each array is that of places, or of rows of these.
    """

    def each_nearby(
        self,
        values: npt.NDArray,
        sigma: float,
        distance: float,
        use: Callable[[Any, Nearby], None],
    ) -> None:
        """Call ``use(piece, nearby)`` for pieces that cover the filtered channels.

        Parameters
        ----------
        values : array
            A signal.
        sigma : float
            Sigma of the Gaussian smoothing.
        distance : float
            Radius for the least and greatest values.
        use : callable
            Takes an index into arrays like `values`, and a `Nearby`. May be called on several
            threads.
        """

    def contrasts(self, values: npt.NDArray, presmooth: float, reach: float) -> npt.NDArray:
        """Measure the contrast around each place, of all channels together.

        Parameters
        ----------
        values : array
            A signal.
        presmooth : float
            Sigma of the smoothing before the measurement.
        reach : float
            Radius; the result is smoothed by half of it.
        """

    def potential(self, values: npt.NDArray, passes: int) -> npt.NDArray:
        """Compute the potential of a signal, with smoothing passes before and after."""

    def advect(
        self,
        values: npt.NDArray,
        potential: npt.NDArray,
        times: float | npt.NDArray,
        out: npt.NDArray,
    ) -> None:
        """Advect a signal, for one time or for a time at each place, and write it to `out`."""

    def complete(self, values: npt.NDArray) -> None:
        """Set values that are copies of others, in place; most domains have none."""
        return

    def as_result(self, values: npt.NDArray) -> npt.NDArray:
        """Convert a signal to the layout of results, which is the same on most domains."""
        return values


def flow_for_time(
    domain: Domain,
    values: npt.NDArray,
    leading: Domain,
    guide: npt.NDArray,
    passes: int,
    time: float,
    out: npt.NDArray,
) -> None:
    """Advect a signal by the flow of a guide, for the same time everywhere.

    Parameters
    ----------
    domain : Domain
    values : array
        The signal.
    leading : Domain
    guide : array
        The signal that defines the flow; may be the same signal.
    passes : int
        Smoothing passes on the flow.
    time : float
    out : array
        The values in the layout of results; overwritten with the result.
    """
    with phase(0.0, 0.25, "Computing the flow"):
        potential = leading.potential(guide, passes)
    with phase(0.25, 1.0, "Tracing flow-lines"):
        domain.advect(values, potential, time, out)
