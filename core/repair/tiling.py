# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes opposite sides of pictures meet, by solving an equation on a cylinder for each axis."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import LARGEST, Floats, by_keyword, checked_image, checked_weights
from ..base.progress import ProgressCallback, ask, phase, reporting
from ..errors import InvalidSignal
from ..grid.channels import opacity_channel
from ..settings import TileSettings, given_or_default

_LEAST = 4
"""Least number of pixels along an axis whose sides are joined."""

_USUAL, _OFTEN = 0.95, 0.9
"""Limit of the steps at a joint: this quantile (first) of the steps in the image, times the second
value. So steep borders beside a joint do not make it steeper."""

_BEND_RADIUS, _BEND_ENDS = 2.0, 24
"""Radius of the changes of slope at a joint, and the distance at which they end, in pixels."""

_LINES = 256
"""Least number of lines across the joint, if there are as many, from which that limit is computed.
"""

_EVEN = 0.85
"""Weight of the arithmetic mean of slopes at the joint; the rest is the harmonic mean."""

_LIGHT = 0.1
"""Standard deviation of the smoothing that separates light from detail, relative to the size of the
picture."""


@by_keyword
def make_tileable(
    image: npt.ArrayLike,
    settings: TileSettings | None = None,
    *,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> npt.NDArray:
    """Make opposite sides of a picture meet in values and slopes, so that it can be repeated.

    Steps between the sides are spread out over the picture; all detail stays in place, and nothing
    is blended, so that no ghosts appear.

    Parameters
    ----------
    image : (h, w) or (h, w, c) array
        Bytes, 16 bits, or floats.
    settings : TileSettings, optional
    mask : (h, w) array of float in [0, 1], optional
        1 takes the result, less mixes it with the image, 0 keeps the image bit for bit.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    array like `image`
        All channels are joined, also opacity, the last of two or four channels, which stays in
        [0, 1].

    Raises
    ------
    InvalidSignal
        If the image cannot be filtered, or is less than four pixels across.
    Cancelled
        If the callback says so.

    Notes
    -----
    For each axis that is joined, the step at the joint is reduced to a mean of the slopes on both
    sides, limited to usual slopes of the image, by changing both sides by half of the rest. The
    change u solves ``(1 / radius^2 - lap)^2 u = 0`` inside, with slope 0 at the joint: this is the
    gradient-domain blending of Perez, Gangnet and Blake (2003) with a thin plate in place of the
    membrane. Where the slope would change more at the joint than usual inside, a second solution of
    that equation, which is 0 at the joint and has a radius of two pixels, changes the slopes. Both
    are solved by Fourier transforms along the joint. Sides that are not joined are mirrored.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> ramp = np.tile(np.linspace(0.0, 1.0, 64), (64, 1))
    >>> tile = core.make_tileable(ramp)
    >>> [round(float(abs(each[32, 0] - each[32, -1])), 2) for each in (ramp, tile)]
    [1.0, 0.01]
    """
    given = checked_image(image, LARGEST)
    settings = given_or_default(settings, TileSettings)
    weights = checked_weights(mask, given)
    height, width = given.shape[:2]
    joined = {"x": (1,), "y": (0,), "both": (0, 1)}[settings.axes]
    if min(given.shape[axis] for axis in joined) < _LEAST:
        raise InvalidSignal(
            f"The image has {width} x {height} pixels; sides are joined from {_LEAST} pixels on."
        )
    pixels = given.reshape(height, width, -1)
    alpha = opacity_channel(pixels.shape[2], "auto")
    out = np.empty_like(pixels)
    with reporting(progress):
        radius = settings.radius * min(height, width)
        solvers = [_Joint((height, width), axis, joined, radius) for axis in joined]
        for channel in range(pixels.shape[2]):
            share = channel / pixels.shape[2], (channel + 1) / pixels.shape[2]
            with phase(*share, "Joining sides"):
                ask()
                old = pixels[..., channel].astype(np.float64)
                new = old.copy()
                for solver in solvers:  # a later change repeats along the earlier joint
                    new += solver.change(new)
                if settings.even_light > 0:
                    new -= settings.even_light * _light(new, joined)
                if weights is not None:
                    new = old + weights * (new - old)
                if given.dtype.kind == "u":
                    new = np.clip(np.rint(new), 0, np.iinfo(given.dtype).max)
                elif channel == alpha:
                    new = np.clip(new, min(old.min(), 0.0), max(old.max(), 1.0))
                elif old.min() >= 0:  # values such as light or heights stay nonnegative
                    new = np.maximum(new, 0.0)
                out[..., channel] = new
                if weights is not None:
                    np.copyto(out[..., channel], pixels[..., channel], where=weights == 0)
    return out.reshape(given.shape)


class _Joint:
    # The change that joins the two sides of an axis, for images of one size.

    def __init__(
        self, shape: tuple[int, int], axis: int, joined: tuple[int, ...], radius: float
    ) -> None:
        self._axis = axis
        count, along = shape[axis], shape[1 - axis]
        self._mirrored = 1 - axis not in joined
        self._along = along
        self._seldom = max(along // _LINES, 1)
        self._length = 2 * along if self._mirrored else along
        waves = 2.0 * np.sin(np.pi * np.fft.rfftfreq(self._length))
        rates = np.sqrt(waves**2 + radius**-2.0)[:, None]
        away = np.arange(count) * rates
        falling = (1.0 + away) * np.exp(-away)
        shape_of_change = falling[:, ::-1] - falling
        self._factors = 0.5 * shape_of_change / shape_of_change[:, -1:]
        away = np.arange(min(count // 2, _BEND_ENDS))
        self._bends = away * np.exp((1 - away) * np.sqrt(waves**2 + _BEND_RADIUS**-2.0)[:, None])

    def change(self, image: Floats) -> Floats:
        lines = np.moveaxis(image, self._axis, 1)
        steps = np.diff(lines, axis=1)
        bends = np.diff(steps[:: self._seldom], axis=1)
        slope = _usual(_slope(steps[:, 0], steps[:, -1]), steps[:: self._seldom])
        found = self._spread(lines[:, 0] - lines[:, -1] - slope, self._factors)
        after = steps[:, 0] + found[:, 1] - found[:, 0]
        before = steps[:, -1] + found[:, -1] - found[:, -2]
        reach = self._bends.shape[1]
        found[:, :reach] += self._spread(slope + _usual(after - slope, bends) - after, self._bends)
        turned = self._spread(before - slope + _usual(slope - before, bends), self._bends)
        found[:, -reach:] += turned[:, ::-1]
        return np.moveaxis(found, 1, self._axis)

    def _spread(self, values: Floats, factors: Floats) -> Floats:
        # The change with these values along the joint, computed for each frequency.
        if self._mirrored:
            values = np.concatenate([values, values[::-1]])
        waves = np.fft.rfft(values)[:, None] * factors
        found: Floats = np.fft.irfft(waves, self._length, axis=0)
        return found[: self._along]


def _usual(values: Floats, inside: Floats) -> Floats:
    # Limits values to usual ones inside the image.
    most = _OFTEN * np.quantile(np.abs(inside), _USUAL)
    found: Floats = np.clip(values, -most, most)
    return found


def _slope(one: Floats, other: Floats) -> Floats:
    # The arithmetic mean changes slopes least. It is mixed with the harmonic mean, or 0 where signs
    # differ (van Leer 1974), which makes the smallest steps.
    both = one * other
    total = np.where(both > 0, one + other, 1.0)
    low = np.where(both > 0, 2.0 * both / total, 0.0)
    return _EVEN * 0.5 * (one + other) + (1.0 - _EVEN) * low


def _light(image: Floats, joined: tuple[int, ...]) -> Floats:
    # The low-frequency part of the picture, minus its mean.
    values = image - image.mean()
    spread = [_LIGHT * n for n in image.shape]
    for axis in (0, 1):
        if axis not in joined:
            values = np.concatenate([values, np.flip(values, axis)], axis)
    rows = np.fft.fftfreq(values.shape[0])[:, None] * spread[0]
    columns = np.fft.rfftfreq(values.shape[1])[None, :] * spread[1]
    slow = np.exp(-2.0 * np.pi**2 * (rows**2 + columns**2))
    found = np.fft.irfft2(np.fft.rfft2(values) * slow, values.shape)
    return found[: image.shape[0], : image.shape[1]]
