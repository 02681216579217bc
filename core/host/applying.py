# SPDX-License-Identifier: GPL-3.0-or-later
"""Any filter of the registry with what a host program says about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from ..registry import find
from .inputs import Denoising


def applied(
    name: str, settings: Any, *, corners: bool = False, alpha: str = "auto"
) -> Callable[..., Any]:
    """Return ``function(*data, mask=None)``: a filter with settings, and what follows.

    Parameters
    ----------
    name : str
        Of the filter.
    settings : object
        Of the filter's settings class; a `Denoising` where a sharpening may follow.
    corners : bool
        Whether the signal is given at the corners of faces.
    alpha : str
        Replaces that of the settings, if they have one.
    """
    then_time = None
    if isinstance(settings, Denoising):
        settings, then_time = settings.kernel, settings.sharpen_time
    if hasattr(settings, "alpha"):
        settings = replace(settings, alpha=alpha)
    return partial(find(name).function(then_time, corners), settings=settings)
