# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings that a preview changes: a time or width by the mouse, another one by the wheel."""

from __future__ import annotations

import math

from ..settings import Setting

_OCTAVE = 50.0
"""Number of pixels that double the value."""

_WHOLE = 400.0
"""Number of pixels from 0 to the useful maximum of a share."""

TIMES = 14
"""Number of times that the useful range of times can be halved."""


class LogarithmicDial:
    """A number on a logarithmic scale; at its lower end it is 0, at its upper end infinite.

    Parameters
    ----------
    value : float
    about : Setting
        Its maximum says whether the number may become infinite.
    octaves : int
        Number of times that the useful range can be halved.
    """

    def __init__(self, value: float, about: Setting, octaves: int = TIMES) -> None:
        self._high = math.log2(min(16.0 * about.soft_maximum, about.maximum))
        self._low = math.log2(about.soft_maximum) - octaves
        self._endless = math.isinf(about.maximum)
        self._place = math.log2(value) if value > 0 else self._low
        if math.isfinite(self._place):
            self._low, self._high = min(self._low, self._place), max(self._high, self._place)
        self._place = min(self._place, self._high)

    @property
    def value(self) -> float:
        """The number, to three digits."""
        if self._place <= self._low:
            return 0.0
        if self._place >= self._high and self._endless:
            return math.inf
        return float(f"{2.0**self._place:.3g}")

    def drag(self, pixels: float) -> None:
        """Change the number by a mouse move in pixels, positive to the right."""
        self._place = min(max(self._place + pixels / _OCTAVE, self._low), self._high)


class LinearDial:
    """A share on a linear scale, between its bounds.

    Parameters
    ----------
    value : float
    about : Setting
    """

    def __init__(self, value: float, about: Setting) -> None:
        self._about = about
        self._place = value

    @property
    def value(self) -> float:
        """The number, to three digits."""
        return float(f"{self._place:.3g}")

    def drag(self, pixels: float) -> None:
        """Change the number by a mouse move in pixels, positive to the right."""
        place = self._place + pixels / _WHOLE * self._about.soft_maximum
        self._place = min(max(place, self._about.minimum), self._about.maximum)


def dial_of(value: float, about: Setting, octaves: int) -> LogarithmicDial | LinearDial:
    """Return a dial for a setting: linear for shares, which have no unit of length."""
    if about.length_power == 0 and math.isfinite(about.maximum):
        return LinearDial(value, about)
    return LogarithmicDial(value, about, octaves)


def turned(value: float, kind: type, about: Setting, clicks: float) -> float:
    """Return a number changed by wheel clicks of a twentieth of the useful range, or by 1.

    A value beyond the useful range does not move farther away.
    """
    step = clicks * about.soft_maximum / 20.0
    if kind is int:
        step = math.copysign(max(1.0, abs(clicks)), clicks)
    new = min(max(value + step, about.minimum), max(value, about.soft_maximum))
    if new == value:
        return value
    return int(new) if kind is int else float(f"{new:.4g}")
