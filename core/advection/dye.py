# SPDX-License-Identifier: GPL-3.0-or-later
"""Dye that is released into a flow and carried away (paper D, section 5)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base.checks import by_keyword
from ..base.parallel import kernel, run
from ..base.progress import ProgressCallback, one_of
from ..errors import InvalidSettings
from ..settings import DyeSettings, NoiseSettings, given_or_default
from .loops import Frames, repeating
from .noise import noise_frames
from .opacity import Look, checked_background
from .sharpening import sharpen_dye
from .sources import DyeSource, coverage
from .velocity import ROWS, FieldOfTime, Flow, Motion, checked_frames, wraps

_Singles = npt.NDArray[np.float32]


@by_keyword
def advect_dye(
    velocity: npt.ArrayLike | FieldOfTime,
    sources: DyeSource | Sequence[DyeSource],
    settings: DyeSettings | None = None,
    *,
    frames: int = 100,
    size: tuple[int, int] | None = None,
    mask: npt.ArrayLike | None = None,
    noise: NoiseSettings | None = None,
    background: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> Frames:
    """Release dye into a flow and advect it.

    Parameters
    ----------
    velocity, frames, size, mask, progress
        As in `advect_noise`.
    sources : DyeSource or sequence of these
        Places, times and colors of the dye.
    settings : DyeSettings, optional
    noise : NoiseSettings, optional
        Draws the dye over noise in the same flow. `step`, `periodic` and `loop` are those of the
        dye's settings.
    background : (h, w) or (h, w, 3) array of float, optional
        Draws the dye over a picture; with `noise`, over the noise on the picture.

    Yields
    ------
    (h, w, 4) float32
        Red, green, blue and opacity in [0, 1]; colors are not multiplied by opacity. Opaque
        where there is noise or a background.

    Raises
    ------
    InvalidSignal, InvalidSettings, Cancelled
        As in `advect_noise`, or if a source cannot be used.

    Notes
    -----
    Paper D, section 5, advects and sharpens the channels of colors, which changes the colors. Here
    each color is a dye of its own, of which a pixel holds a share from 0 to 1. The sharpening is
    not in the paper: it is a shock filter in conservative form, which loses no dye.

    Examples
    --------
    A spot that goes half a pixel to the right in each frame:

    >>> import numpy as np
    >>> from shock_filter import core
    >>> spot = core.DyeSource([(0.25, 0.5)], width=8, colors=[(1, 0, 0)], every=0)
    >>> settings = core.DyeSettings(step=0)
    >>> field = np.full((32, 64, 2), [0.5, 0.0])
    >>> for frame in core.advect_dye(field, spot, settings, frames=31):
    ...     pass
    >>> middle = (frame[..., 3].sum(axis=0) * np.arange(64)).sum() / frame[..., 3].sum()
    >>> frame.shape, round(float(middle), 1)
    ((32, 64, 4), 30.5)
    """
    settings = given_or_default(settings, DyeSettings)
    count = checked_frames(frames, settings.loop)
    flow = Flow(velocity, size, mask, settings.step, settings.periodic, count, settings.loop > 0)
    given = _listed(sources)
    for source in given:
        if not isinstance(source, DyeSource):
            raise InvalidSettings(f"A source is {source!r}; give a DyeSource.")
        if settings.loop and source.every and count % source.period:
            raise InvalidSettings(
                "A source repeats after {period} frames, the loop after {frames}; give a number of"
                " frames that it divides.",
                period=source.period,
                frames=count,
            )
    behind = checked_background(background, flow.size)
    under = None
    if noise is not None:
        below = _noise_of(given_or_default(noise, NoiseSettings), settings)
        under = noise_frames(flow, below, Look(flow.longest, below, behind, None))
    return _frames_of(flow, given, settings, count, under, behind, progress)


def _listed(sources: Any) -> list[DyeSource]:
    is_row = isinstance(sources, Iterable) and not isinstance(sources, np.ndarray)
    return list(sources) if is_row else [sources]


def _noise_of(noise: NoiseSettings, settings: DyeSettings) -> NoiseSettings:
    given = vars(noise) | {name: getattr(settings, name) for name in ("step", "periodic", "loop")}
    return NoiseSettings(**given)


def _frames_of(
    flow: Flow,
    sources: list[DyeSource],
    settings: DyeSettings,
    count: int,
    under: Frames | None,
    behind: _Singles | None,
    progress: ProgressCallback | None,
) -> Frames:
    dyes, colors = _palette(sources)
    shares = repeating(
        lambda first: _shares(flow, sources, dyes, settings, first),
        flow.frames, settings.loop, _mixed,
    )  # fmt: skip
    for number in range(count):
        with one_of(progress, number, count, "Advecting dye"):
            picture = behind if under is None else next(under)
            frame = np.empty((*flow.size, 4), dtype=np.float32)
            below = np.zeros((0, 0, 1), np.float32)
            if picture is not None:
                below = picture if picture.ndim == 3 else picture[..., None]
            run(_show, len(frame), next(shares), colors, below, flow.at(number).defined, frame,
                chunk=ROWS)  # fmt: skip
        yield frame


def _palette(sources: list[DyeSource]) -> tuple[list[list[int]], _Singles]:
    """Return the numbers of each source's colors, and a table of all colors."""
    table = list(dict.fromkeys(color for source in sources for color in source.colors))
    dyes = [[table.index(color) for color in source.colors] for source in sources]
    return dyes, np.array(table, dtype=np.float32).reshape(-1, 3)


def _shares(
    flow: Flow,
    sources: list[DyeSource],
    dyes: list[list[int]],
    settings: DyeSettings,
    first: int,
) -> Frames:
    """Yield the share of each dye, from frame `first` on: (k, h, w)."""
    kinds = max((max(each) for each in dyes), default=-1) + 1
    joined = wraps(settings.periodic)
    rows = flow.size[0]
    spots = [coverage(source, flow.size, joined) for source in sources]
    old = np.zeros((kinds, *flow.size), dtype=np.float32)
    new = np.empty_like(old)
    back = np.empty((*flow.size, 2), dtype=np.float32)
    back_of: Motion | None = None
    # Dye at the start of a loop was released in the previous round.
    number = -flow.frames if settings.loop else 0
    while True:
        for spot, source, kind in zip(spots, sources, dyes, strict=True):
            pulse = source.pulse(number, settings.loop > 0)
            if pulse is not None:
                run(_release, rows, spot, kind[pulse % len(kind)], old, chunk=ROWS)
        if number >= first:
            yield old
        number += 1
        motion = flow.at(number)
        if back_of is not motion:
            halfway = flow.at(number - 0.5)
            run(_find_midpoint, rows, motion.right, motion.down, halfway.right, halfway.down,
                joined, back, chunk=ROWS)  # fmt: skip
            back_of = motion
        run(_read_back, rows, old, back, motion.defined, joined, new, chunk=ROWS)
        old, new = sharpen_dye(new, settings, joined), old


def _mixed(old: _Singles, new: _Singles, share: float) -> _Singles:
    return np.float32(1.0 - share) * old + np.float32(share) * new


@kernel
def _release(start, stop, spot, released, shares):
    for kind in range(shares.shape[0]):
        for i in range(start, stop):
            for j in range(shares.shape[2]):
                cover = spot[i, j]
                shares[kind, i, j] *= np.float32(1) - cover
                if kind == released:
                    shares[kind, i, j] += cover


@kernel
def _corner(x, count, joined):
    # The two samples on both sides of a place, and the share of the second; -1 is outside.
    before = int(np.floor(x))
    share = x - np.floor(x)
    after = before + 1
    if joined:
        before %= count
        after %= count
    else:
        if before < 0 or before >= count:
            before = -1
        if after < 0 or after >= count:
            after = -1
    return before, after, np.float32(share)


@kernel
def _find_midpoint(start, stop, right, down, right_halfway, down_halfway, joined, back):
    rows, columns = right.shape
    half = np.float32(0.5)
    for i in range(start, stop):
        for j in range(columns):
            x = right[i, j]
            y = down[i, j]
            left, after, across = _corner(np.float64(j) - half * x, columns, joined[0])
            top, below, share = _corner(np.float64(i) - half * y, rows, joined[1])
            # Beyond the border there is no velocity halfway, so that at the end is used.
            if (
                left >= 0
                and top >= 0
                and (after >= 0 or across == 0)
                and (below >= 0 or share == 0)
            ):
                after = max(after, 0)
                below = max(below, 0)
                a = right_halfway[top, left]
                a += across * (right_halfway[top, after] - a)
                b = right_halfway[below, left]
                b += across * (right_halfway[below, after] - b)
                x = a + share * (b - a)
                a = down_halfway[top, left]
                a += across * (down_halfway[top, after] - a)
                b = down_halfway[below, left]
                b += across * (down_halfway[below, after] - b)
                y = a + share * (b - a)
            back[i, j, 0] = x
            back[i, j, 1] = y


@kernel
def _read_back(start, stop, old, back, defined, joined, new):
    kinds, rows, columns = old.shape
    one = np.float32(1)
    least = np.float32(1e-9)  # the smallest numbers of all are slow
    for i in range(start, stop):
        for j in range(columns):
            left, after, across = _corner(np.float64(j) - back[i, j, 0], columns, joined[0])
            top, below, share = _corner(np.float64(i) - back[i, j, 1], rows, joined[1])
            for kind in range(kinds):
                total = np.float32(0)
                if defined[i, j]:
                    if top >= 0 and left >= 0:
                        total += (one - share) * (one - across) * old[kind, top, left]
                    if top >= 0 and after >= 0:
                        total += (one - share) * across * old[kind, top, after]
                    if below >= 0 and left >= 0:
                        total += share * (one - across) * old[kind, below, left]
                    if below >= 0 and after >= 0:
                        total += share * across * old[kind, below, after]
                new[kind, i, j] = total if total > least else np.float32(0)


@kernel
def _show(start, stop, shares, colors, below, defined, frame):
    zero = np.float32(0)
    one = np.float32(1)
    least = np.float32(1e-6)
    opaque = below.shape[0] > 0
    last = below.shape[2] - 1  # gray pictures have one channel
    for i in range(start, stop):
        for j in range(frame.shape[1]):
            total = zero
            red = zero
            green = zero
            blue = zero
            for c in range(shares.shape[0]):
                share = shares[c, i, j]
                total += share
                red += share * colors[c, 0]
                green += share * colors[c, 1]
                blue += share * colors[c, 2]
            if total < least:
                total = red = green = blue = zero
            else:
                red /= total
                green /= total
                blue /= total
            total = min(total, one) if defined[i, j] else zero
            if opaque:
                red = total * red + (one - total) * below[i, j, 0]
                green = total * green + (one - total) * below[i, j, min(1, last)]
                blue = total * blue + (one - total) * below[i, j, min(2, last)]
                total = one
            frame[i, j, 0] = red
            frame[i, j, 1] = green
            frame[i, j, 2] = blue
            frame[i, j, 3] = total
