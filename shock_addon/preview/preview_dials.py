# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings that a preview changes by mouse: the time by dragging, another one by the wheel.

Needs no bpy.
"""

from __future__ import annotations

import math

from ...core.settings import Setting

_OCTAVE = 50.0
"""Pixels that double the time."""


class TimeDial:
    """A time on a logarithmic scale; at its lower end it is 0, at its upper end infinite.

    Parameters
    ----------
    time : float
    about : Setting
        Only times whose maximum is infinite become so.
    """

    def __init__(self, time: float, about: Setting) -> None:
        self._high = math.log2(16.0 * about.soft_maximum)
        self._low = math.log2(about.soft_maximum / 2.0**14)
        self._endless = math.isinf(about.maximum)
        self._place = self._low
        if time > 0:
            self._place = min(max(math.log2(time), self._low), self._high)

    @property
    def time(self) -> float:
        """The time, to three digits."""
        if self._place <= self._low:
            return 0.0
        if self._place >= self._high and self._endless:
            return math.inf
        return float(f"{2.0**self._place:.3g}")

    def drag(self, pixels: float) -> None:
        """Move the mouse to the right, or to the left if negative."""
        self._place = min(max(self._place + pixels / _OCTAVE, self._low), self._high)


def turned(value: float, kind: type, about: Setting, clicks: float) -> float:
    """Turn the wheel: a click is a twentieth of the useful range, or a whole number."""
    if kind is int:
        steps = math.copysign(max(1.0, abs(clicks)), clicks)
        return int(min(max(value + steps, about.minimum), about.soft_maximum))
    step = clicks * about.soft_maximum / 20.0
    return float(f"{min(max(value + step, about.minimum), about.soft_maximum):.4g}")
