# SPDX-License-Identifier: GPL-3.0-or-later
"""The learned recipe for images: two stages, whose differences networks mix pixel by pixel.

Not in the papers. The networks have learned from made pictures (`tools/training`) how much of each
difference brings a spoiled picture back. Shares may have any sign; each stage's result is kept
between the least and the greatest value within 7 pixels. Nothing is decided by a threshold, so that
what changes little has a result that changes little. Finally, `grain` gives back what is too strong
for noise.
"""

from __future__ import annotations

import math
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...base.parallel import run
from ...base.progress import ask, phase
from ...grid.part import Part
from ...grid.potential import flow_reach
from ...mixture.network import Network, digest, load
from . import first as first_stage
from . import second as second_stage
from .first import First, FirstStrip
from .grain import REACH as REACH_OF_GRAIN
from .grain import give_grain_back
from .planes import Planes, keep_within
from .second import Second, SecondStrip, flow_plan
from .surroundings import CELL, SOFTEST, STRIP, WIDE, Singles, reach_of_surroundings

WEIGHTS = Path(__file__).with_name("images.npz")

STAGES = "first", "second"
"""Names of the networks, in order."""

DEFINITION = digest("images 2", repr((
    first_stage.SIGMAS, first_stage.SLOPES, first_stage.REACHES, first_stage.MASKS,
    second_stage.SPAN, second_stage.RATE, second_stage.CELLS, second_stage.TEXTURE,
    second_stage.SOFT, second_stage.FLOWED, second_stage.SMOOTHER, second_stage.WIDELY,
    WIDE.tolist(), SOFTEST, CELL,
)))  # fmt: skip
"""Changes with what the numbers mean; count the first word up when the code changes them."""

FAINT = 5e-5
"""Of an image's detail: energy that counts as none."""

_MOST = float(np.finfo(np.float16).max)

_PIXELS = 4096
"""That a network looks at at once."""

_AT_ONCE = 32 * _PIXELS
"""Pixels that a thread mixes before it takes others, where rows are no strips."""

_MESSAGE = "Sharpening"

_REACH = second_stage.REACH + REACH_OF_GRAIN
"""Radius in pixels within which the flowed image affects a result."""


class Wishes(NamedTuple):
    """What settings say about a learned sharpening.

    Attributes
    ----------
    floor : float
        Energy that counts as none, in the square of the image's range.
    square : float
        Squared width of the borders to close, as a Gaussian's sigma; 0 measures it everywhere.
    passes : int
        Smoothing passes on the flow.
    nearest : bool
        Whether the nearest pixel is read at the ends of flow-lines.
    span : float
        From the least to the greatest value of the smoothed image: grain that is strong beside it
        stays. Infinity lets all grain go.
    """

    floor: float
    square: float = 0.0
    passes: int = 1
    nearest: bool = False
    span: float = math.inf


@cache
def networks() -> list[Network]:
    """The networks that give differences their shares, one for each stage."""
    found = load(WEIGHTS, DEFINITION)
    return [found[name] for name in STAGES]


def sharpened(
    planes: Planes,
    brightness: Singles,
    wishes: Wishes,
    part: Part | None = None,
    nets: list[Network] | None = None,
) -> Singles:
    """Sharpen planes of an image: (c, h, w) float32.

    Parameters
    ----------
    planes : Planes
        Of at least two rows and columns.
    brightness : (k,) float32
        Weights of the channels that guide the flow, as in `Channels`.
    wishes : Wishes
    part : Part, optional
        The wanted pixels, if the image is a part of another one; others are not meant to be read.
    nets : list of Network, optional
        One for each stage; those that are shipped by default.

    Raises
    ------
    LeftPart
        If the part is too small for the wanted pixels.
    """
    nets = networks() if nets is None else nets
    with phase(0.0, 0.15, _MESSAGE):
        first = First(planes, wishes.floor, wishes.square)
    with phase(0.15, 0.5, _MESSAGE):
        values, shares = mixed(first, nets[0])
        result = planes.with_values(values)
        planes.forget()
    with phase(0.5, 0.7, "Tracing flow-lines"):
        second = second_of(first, result, shares, brightness, wishes, part)
    with phase(0.7, 1.0, _MESSAGE):
        values = mixed(second, nets[1], keep_shares=False)[0]
        give_grain_back(planes, values, wishes.span)
        return values


def second_of(
    first: First, result: Planes, shares: npt.NDArray[np.float16], brightness: Singles,
    wishes: Wishes, part: Part | None = None,
) -> Second:  # fmt: skip
    """Prepare the second stage."""
    wider = part and part.wider(_REACH)
    moved = result.flowed(flow_plan(first), brightness, wishes.passes, wishes.nearest, wider)
    return Second(first, result, shares, moved)


def mixed(
    stage: First | Second, network: Network, keep_shares: bool = True
) -> tuple[Singles, npt.NDArray[np.float16]]:
    """Add a stage's differences to its image as the network says; return the shares, too."""
    base = stage.base
    _, height, width = base.shape
    out = np.empty_like(base)
    kept = np.empty((stage.differences if keep_shares else 0, height, width), np.float16)
    rows = max(_PIXELS // width, 1)

    def mix(strip: FirstStrip | SecondStrip, start: int, stop: int) -> None:
        for y in range(start, stop, rows):
            ask()  # a strip of a wide image takes long
            end = min(y + rows, stop)
            differences, told = strip.rows(y, end)
            if len(more := stage.planes.told(y, end)):
                told = np.concatenate([told, more])
            told, chosen = told.reshape(len(told), -1), stage.planes.columns(y, end)
            shares = np.zeros((stage.differences, told.shape[1]), np.float32)
            shares[:, chosen] = network.of_columns(np.ascontiguousarray(told[:, chosen]))
            shares = shares.reshape(-1, end - y, width)
            first, low, high = strip.limits
            keep_within(y, end, first, base, differences, shares, low, high, out)
            if keep_shares:
                kept[:, y:end] = np.clip(shares, -_MOST, _MOST)

    if stage.planes.whole:
        with phase(0.0, 0.4, _MESSAGE):
            strip = stage.strip(0, height)
        with phase(0.4, 1.0, _MESSAGE):
            few = min(STRIP, max(_AT_ONCE // width, 1))  # so that large textures ask often, too
            run(partial(mix, strip), height, chunk=few)
    else:
        run(lambda start, stop: mix(stage.strip(start, stop), start, stop), height, chunk=STRIP)
    return out, kept


def reach(passes: int) -> tuple[int, int]:
    """Return the radii in pixels within which an image affects the flow, and what flowed a result.

    The result is affected within both, and as far as flow-lines go.
    """
    before = first_stage.REACH + reach_of_surroundings()
    return before + flow_reach(passes) + second_stage.SMOOTHER, _REACH
