# SPDX-License-Identifier: GPL-3.0-or-later
"""The dials What and Width, and the noise, as amounts of sharpening and flow times.

Pure functions of numbers and arrays, for colors on meshes, images and textures alike. A filter
measures the width if the setting is 0, makes a plan by `plan_of`, and then

- smooths the signal by ``plan.blur`` (a Gaussian's sigma) and adds the difference, with
  `limited_unsharp`: the result stays between the least and the greatest value within
  ``plan.limit``;
- advects that (with `plan.unsharp_first`) or the signal itself. `flow_times` computes the time at
  each place from the local contrast: the `contrast` of the least and greatest value within
  ``plan.reach``, of the advected signal smoothed by ``plan.presmooth``; the contrast is smoothed
  by half of ``plan.reach``;
- mixes the two with `blended`, and the result with the signal by Amount.

All lengths are in the unit of the width: pixels, mean texel sizes or mean edge lengths.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...base.findings import tell
from ...settings import WIDTH_OF_SIGMA

SHARP = 1.6
"""Measured widths up to this count as sharp."""

WIDEST = {"drawing": 16.0, "photo": 8.0}
"""Largest width that is closed by default; wider borders are meant to be soft."""

_DRAWING, _PHOTO = (2.0, 0.6), (2.0, 1.0)  # times the unsharp difference, widths that flow
_RATE = 0.7  # the time in which a border of contrast 1 closes, over its width to the power of 4
_CELLS = 3.0  # added to squared widths for the coarseness of the grid
_FAINT = 0.02  # contrast below which nothing is a border
_STRAY = 4.0  # how many times the noise, and no border, contrasts are
_PHOTO_OWN = 2.0  # width of the borders that photos have at their sharpest
_ENLARGED = (1.0, 0.8)  # as above, of drawings that were enlarged, whose borders lie close together
_ROUNDED = 2.0  # width of what enlarging rounds off in drawings, beside their own
_FADES = {"drawing": 0.02, "photo": 0.008}  # the noise at which the unsharp part is half as strong
_GRAIN = 5.0  # times the noise: how far values lie apart where there is nothing else
_LIGHT_NOISE = 0.008
_WIDE = 8.0  # width from which a second smoothing pass pays off where there is noise


class Plan(NamedTuple):
    """The amounts and lengths for one width.

    Attributes
    ----------
    blur : float
        Sigma of the smoothing for the unsharp mask.
    unsharp : float
        Factor of the unsharp mask.
    grain : float
        Range of values due to noise; the unsharp mask is not added where the range is no larger.
    limit : float
        Radius of the neighbourhood whose range the unsharp part keeps.
    unsharp_first : bool
        Whether the result of the unsharp part is advected, and not the signal itself.
    share : float
        Share of the advected signal in the result; the rest is the unsharp part.
    square : float
        Squared width that the flow closes, for `flow_times`; 0 if nothing flows.
    passes : int
        Smoothing passes on the flow.
    presmooth : float
        Sigma of the smoothing before contrasts are measured.
    reach : float
        Radius of the neighbourhood in which contrast is measured.
    faint : float
        Least contrast of a border.
    """

    blur: float
    unsharp: float
    grain: float
    limit: float
    unsharp_first: bool
    share: float
    square: float
    passes: int
    presmooth: float
    reach: float
    faint: float


def plan_of(what: str, width: float, noise: float = 0.0, passes: int = 1, enlarge: int = 1) -> Plan:
    """Make the plan for ``"drawing"`` or ``"photo"`` and a width above 0.

    Parameters
    ----------
    what : str
    width : float
        Width of the borders, from 10 to 90 percent.
    noise : float
        Standard deviation of the signal's noise.
    passes : int
        The least smoothing passes on the flow.
    enlarge : int
        How many times the image was enlarged.
    """
    drawing = what == "drawing"
    if noise > _LIGHT_NOISE and width >= _WIDE:
        passes = max(passes, 2)
    own = 0.0 if drawing or noise >= _LIGHT_NOISE else _PHOTO_OWN
    unsharp, flowing = _DRAWING if drawing else _PHOTO
    if drawing and enlarge > 1:
        unsharp, flowing = _ENLARGED
    fade = 1.0 + (noise / _FADES[what]) ** 2
    flow = (1.0 - (1.0 - flowing) / fade) * width  # does what the faded unsharp part leaves
    square = _square(flow, own, passes)
    sigma = flow / WIDTH_OF_SIGMA
    return Plan(
        blur=width / WIDTH_OF_SIGMA,
        unsharp=unsharp / fade,
        grain=_GRAIN * noise if drawing else 0.0,
        limit=width / 2.0,
        unsharp_first=drawing,
        share=1.0 if drawing else 0.5,
        square=square,
        passes=passes,
        presmooth=max(0.7, 0.4 * sigma),
        reach=max(2.0, 1.2 * flow),
        faint=max(_FAINT, _STRAY * noise / max(1.0, 2.5 * sigma)),
    )


def _square(flow: float, own: float, passes: int) -> float:
    square = max(flow * flow - own * own, 0.0)
    if square > 0:
        square += _CELLS * square / (square + _CELLS) + max(passes - 1, 0)
    return square


def flow_only(plan: Plan, width: float, what: str = "photo") -> Plan:
    """Return a plan without the unsharp part, for values that cannot be added or have a guide."""
    plain = plan_of("photo", width, 0.0, plan.passes)
    own = _PHOTO_OWN if what == "photo" else 0.0
    square = _square(width, own, plan.passes)
    return plain._replace(unsharp=0.0, share=1.0, faint=plan.faint, square=square)


def contrast(low: npt.NDArray, high: npt.NDArray) -> npt.NDArray:
    """Add up the ranges of all channels: (..., c), (..., c) -> (...)."""
    ranges = high - low
    return np.sqrt((ranges * ranges).sum(axis=-1))


def flow_times(plan: Plan, contrasts: npt.NDArray) -> npt.NDArray:
    """Return the flow time at each place that closes the plan's width at its contrast."""
    return _RATE * plan.square**2 / (contrasts * contrasts + plan.faint**2)


def limited_unsharp(
    plan: Plan, values: npt.NDArray, smooth: npt.NDArray, low: npt.NDArray, high: npt.NDArray
) -> npt.NDArray:
    """Add the unsharp mask, limited to the range of the neighbourhood."""
    added = plan.unsharp * (values - smooth)
    if plan.grain > 0:
        beyond = np.maximum(high - low - plan.grain, 0.0)
        added *= beyond / (beyond + plan.grain)
    return np.clip(values + added, low, high)


def blended(plan: Plan, unsharp: npt.NDArray, flowed: npt.NDArray) -> npt.NDArray:
    """Mix the results of both parts."""
    return unsharp + plan.share * (flowed - unsharp)


def tell_widths(unit: str, width: float, count: int, result: float | None) -> None:
    """Report the widths of borders before and after; see `base.findings`.

    Parameters
    ----------
    unit : str
        Unit of lengths: "pixels", "texels" or "edge lengths".
    width : float
        The measured width.
    count : int
        Number of borders.
    result : float or None
        The width in the result; None if nothing was done.
    """
    if not count:
        tell("No borders were found; give a Width.")
    elif result is None:
        tell(f"Already sharp: borders {{width:.1f}} {unit} wide.", width=width)
    elif not 0 < result < width:  # those that are left are others, which are wider
        tell(f"Borders up to {{width:.1f}} {unit} wide were closed.", width=width)
    else:
        text = f"Borders {{width:.1f}} {unit} wide, closed to {{result:.1f}}."
        tell(text, width=width, result=result)


def counted_width(width: float, measured: float, what: str = "drawing", enlarge: int = 1) -> float:
    """Return the width to close: the given one or, for 0, the measured one; 0 if sharp.

    Parameters
    ----------
    width : float
        In pixels of the input.
    measured : float
        In pixels of the enlarged image.
    what : str
    enlarge : int
        How many times the image was enlarged.
    """
    rounded = _ROUNDED if enlarge > 1 and what == "drawing" else 0.0
    if width > 0:
        return math.hypot(enlarge * width, rounded)
    if rounded > 0 and 0 < measured <= SHARP:
        measured = enlarge  # thin lines read as sharp, but nothing is that was enlarged
    if measured <= SHARP or not math.isfinite(measured):
        return 0.0
    return min(math.hypot(measured, rounded), enlarge * WIDEST[what])
