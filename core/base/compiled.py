# SPDX-License-Identifier: GPL-3.0-or-later
"""The shared library of compiled kernels: a placeholder until it is built."""

from __future__ import annotations

import importlib.util


def library_problem() -> str:
    """Return why kernels cannot run, with the remedy; empty if they can."""
    if importlib.util.find_spec("numba") is not None:
        return ""
    return (
        "numba cannot be found: install the Shock Filter zip that was made for this Blender"
        " version and platform, or, outside Blender, numba."
    )
