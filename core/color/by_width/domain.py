# SPDX-License-Identifier: GPL-3.0-or-later
"""The interface of a domain of signals: a mesh, a grid of pixels or a sheet of texels.

A `Domain` computes neighbourhoods of a place and lets values flow. Each domain is a subclass in a
file of its own: `mesh_domain`, `grid_domain` and `core.texture.sheet_domain`.
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
    """Where a signal lives, which of its channels are filtered, and how values are read.

    Lengths are in those of the width: pixels, mean texel sizes or mean edge lengths. The first axis
    of each array counts places, or rows of them.
    """

    def each_nearby(
        self,
        values: npt.NDArray,
        sigma: float,
        distance: float,
        use: Callable[[Any, Nearby], None],
    ) -> None:
        """Call ``use(piece, nearby)`` for pieces that make up the channels that are filtered.

        Parameters
        ----------
        values : array
            A signal.
        sigma : float
            Of the Gaussian that smooths it.
        distance : float
            Within which the least and greatest values lie.
        use : callable
            Gets an index into arrays like `values`, and what is near there. May be called on
            several threads.
        """

    def contrasts(self, values: npt.NDArray, presmooth: float, reach: float) -> npt.NDArray:
        """Measure how far apart values lie around each place, all channels together.

        Parameters
        ----------
        values : array
            A signal.
        presmooth : float
            Sigma of the smoothing before.
        reach : float
            How far around a place; the result is smoothed by half of it.
        """

    def potential(self, values: npt.NDArray, passes: int) -> npt.NDArray:
        """Compute the potential of a signal, with so many smoothing passes before and after."""

    def advect(
        self,
        values: npt.NDArray,
        potential: npt.NDArray,
        times: float | npt.NDArray,
        out: npt.NDArray,
    ) -> None:
        """Let a signal flow into `out`, for one time, or each place for its own."""

    def complete(self, values: npt.NDArray) -> None:
        """Make up, in place, values that are copies of others; most domains have none."""
        return

    def as_result(self, values: npt.NDArray) -> npt.NDArray:
        """Lay a piece of a signal out as results are; on most domains these are alike."""
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
    """Let a signal follow the flow of a guide, for the same time everywhere.

    Parameters
    ----------
    domain : Domain
    values : array
        The signal.
    leading : Domain
    guide : array
        The signal whose flow is followed; may be the same.
    passes : int
        Smoothing passes on the flow.
    time : float
    out : array
        Holds the values as results are laid out, and gets the result.
    """
    with phase(0.0, 0.25, "Computing the flow"):
        potential = leading.potential(guide, passes)
    with phase(0.25, 1.0, "Tracing flow-lines"):
        domain.advect(values, potential, time, out)
