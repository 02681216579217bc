# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening by the width of borders, on any domain: a mesh, a grid of pixels, a sheet of texels.

The steps are those of `dials`, and the same on each `Domain`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ...base.parallel import blocks
from ...base.progress import aside, phase
from .dials import Plan, blended, flow_times, limited_unsharp
from .domain import Domain, Nearby

_BLOCK = 1 << 16  # numbers per numpy operation, so that temporary arrays are small


class Lead(NamedTuple):
    """A guide: another signal that defines the flow.

    Attributes
    ----------
    domain : Domain
    values : array
    plan : Plan
        Its plan, made for its own noise.
    """

    domain: Domain
    values: npt.NDArray
    plan: Plan


def sharpen_by_width(
    domain: Domain,
    plan: Plan,
    values: npt.NDArray,
    target: npt.NDArray,
    lead: Lead | None = None,
) -> None:
    """Sharpen a signal, or advect it by the flow of another one.

    Parameters
    ----------
    domain : Domain
    plan : Plan
        `plan.grain` is in the signal's range.
    values : array
    target : array
        The values in the layout of results; overwritten with the result, rounded if whole numbers.
    lead : Lead, optional
        By default, the signal defines its own flow.
    """
    if plan.unsharp_first:
        with phase(0.0, 0.2, "Sharpening"):
            sharp = _unsharp_mask(domain, plan, values)
            if lead is not None:
                leading = _unsharp_mask(lead.domain, lead.plan, lead.values)
                lead = lead._replace(values=leading)
        with phase(0.2, 1.0, "Sharpening"):
            _flow(domain, plan, sharp, target, lead)
        return
    in_place = plan.share == 1 or target.dtype.kind == "f"
    flowed = target if in_place else _floats(values)
    with phase(0.0, 0.8, "Sharpening"):
        if plan.square > 0:
            _flow(domain, plan, values, flowed, lead)
    if plan.share == 1:
        return

    def mix(piece: Any, nearby: Nearby) -> None:
        sharp = domain.as_result(_unsharp(plan, nearby))
        mixed = blended(plan, sharp, flowed[piece])
        target[piece] = np.rint(mixed) if target.dtype.kind == "u" else mixed

    with phase(0.8, 1.0, "Sharpening"):
        domain.each_nearby(values, plan.blur, plan.limit, mix)


def _unsharp_mask(domain: Domain, plan: Plan, values: npt.NDArray) -> npt.NDArray:
    sharp = _floats(values)

    def put(piece: Any, nearby: Nearby) -> None:
        sharp[piece] = _unsharp(plan, nearby)

    domain.each_nearby(values, plan.blur, plan.limit, put)
    domain.complete(sharp)
    return sharp


def _unsharp(plan: Plan, nearby: Nearby) -> npt.NDArray:
    values, smooth, low, high, hidden = nearby
    sharp = limited_unsharp(plan, values, smooth, low, high)
    if hidden is not None:
        np.copyto(sharp, values, where=hidden)
    return sharp


def _flow(
    domain: Domain, plan: Plan, values: npt.NDArray, out: npt.NDArray, lead: Lead | None
) -> None:
    leading, guide = (domain, values) if lead is None else (lead.domain, lead.values)
    message = "Computing the flow"
    with phase(0.0, 0.25, message):
        times = leading.contrasts(guide, plan.presmooth, plan.reach)
        with aside(message):
            for block in _blocks(times):
                times[block] = flow_times(plan, times[block])
    with phase(0.25, 0.4, message):
        potential = leading.potential(guide, plan.passes)
    with phase(0.4, 1.0, "Tracing flow-lines"):
        domain.advect(values, potential, times, out)


def _floats(values: npt.NDArray) -> npt.NDArray:
    copy = np.empty(values.shape, np.float64 if values.dtype == np.float64 else np.float32)
    with aside("Sharpening"):
        for block in _blocks(values):
            copy[block] = values[block]
    return copy


def _blocks(values: npt.NDArray) -> Iterator[slice]:
    return blocks(len(values), max(_BLOCK * len(values) // max(values.size, 1), 1))
