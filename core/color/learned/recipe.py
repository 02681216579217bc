# SPDX-License-Identifier: GPL-3.0-or-later
"""The learned recipe for images: two stages, in which networks weigh differences for each pixel.

Not in the papers. The networks are trained on synthetic pictures (`tools/training`) to restore
degraded ones by adding weighted differences. Weights may have any sign; the result of each stage is
clipped to the range of values within 7 pixels. There are no thresholds, so the result depends
continuously on the image. Finally, `grain` restores grain that is too strong to be noise.
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
"""Digest of what the features mean. When a change of the code changes them, raise the number in the
first text."""

FAINT = 5e-5
"""Energy that counts as none, over the detail of the image."""

_MOST = float(np.finfo(np.float16).max)

_PIXELS = 4096
"""Pixels per call of a network."""

_AT_ONCE = 32 * _PIXELS
"""Pixels per chunk of a thread, for planes that are not computed in strips."""

_MESSAGE = "Sharpening"

_REACH = second_stage.REACH + REACH_OF_GRAIN
"""Radius in pixels within which the flowed image affects a result."""


class Wishes(NamedTuple):
    """The parameters of a learned sharpening.

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
        Range of the values of the smoothed image; grain that is strong compared with it stays.
        Infinity removes all grain.
    """

    floor: float
    square: float = 0.0
    passes: int = 1
    nearest: bool = False
    span: float = math.inf


@cache
def networks() -> list[Network]:
    """Load the networks that weigh the differences, one for each stage."""
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
        With at least two rows and columns.
    brightness : (k,) float32
        Weights of the channels that guide the flow, as in `Channels`.
    wishes : Wishes
    part : Part, optional
        The wanted pixels, if the image is a part of another one; results elsewhere are undefined.
    nets : list of Network, optional
        One for each stage; by default the shipped ones.

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
    """Add a stage's differences, weighted by the network, to its image; return also the weights."""
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
            few = min(STRIP, max(_AT_ONCE // width, 1))  # so that large textures report progress
            run(partial(mix, strip), height, chunk=few)
    else:
        run(lambda start, stop: mix(stage.strip(start, stop), start, stop), height, chunk=STRIP)
    return out, kept


def reach(passes: int) -> tuple[int, int]:
    """Return two radii in pixels: of an image's effect on its flow, and on results after the flow.

    The total radius is the sum of both and the length of flow-lines.
    """
    before = first_stage.REACH + reach_of_surroundings()
    return before + flow_reach(passes) + second_stage.SMOOTHER, _REACH
