# SPDX-License-Identifier: GPL-3.0-or-later
"""Reports of the learned recipe; see `base.findings`."""

from __future__ import annotations

from ...base.findings import tell
from ...grid.borders import Borders

_NARROWER = 0.95
"""Borders count as unchanged if the width in the result is at least this share of the old one."""

_SAME = 0.02
"""Relative change of the detail up to which no difference is visible."""

_WIDE = 8.0
"""Width above which borders may stay, because the training set has few of them."""

_SOFT, _HARDLY_NARROWER = 4.0, 0.85
"""Borders wider than the first value that keep more than the second of their width still look
blurred."""


def tell_learned(unit: str, before: Borders, after: Borders | None) -> None:
    """Report what sharpening did.

    Parameters
    ----------
    unit : str
        Unit of lengths: "pixels" or "texels".
    before, after : Borders
        Measurements of an image and of its result; None if the result is the same.
    """
    width = before.width if before.number else 0.0
    share = after.width / width if width and after is not None else 0.0
    is_soft = width > _SOFT and _HARDLY_NARROWER < share < _NARROWER
    if is_soft or (width > _WIDE and (after is None or share > 0.5)):
        text = f"Borders stay {{width:.1f}} {unit} wide; in flat colors, What: Drawing closes them."
        tell(text, width=width if after is None else after.width)
    elif after is not None and width and 0 < after.width < _NARROWER * width:
        text = f"Borders {{width:.1f}} {unit} wide, closed to {{result:.1f}}."
        tell(text, width=width, result=after.width)
    elif after is None or abs(after.detail - before.detail) <= _SAME * before.detail:
        if width:
            tell(f"Already sharp: borders {{width:.1f}} {unit} wide.", width=width)
        else:
            tell("Nothing to sharpen was found.")
    elif after.detail < before.detail:
        tell("Noise was smoothed; borders stay as wide as they were.")
    elif width and after.width == 0:
        tell(f"Borders up to {{width:.1f}} {unit} wide were closed.", width=width)
    else:
        tell("Texture was sharpened; borders stay as wide as they were.")


def tell_opacity() -> None:
    """Report that opacity was sharpened too."""
    tell("Opacity was sharpened, too.")
