# SPDX-License-Identifier: GPL-3.0-or-later
"""How many cores there are to work on. Imports neither numpy nor numba."""

from __future__ import annotations

import os
from functools import cache


@cache
def thread_count() -> int:
    """Cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # macOS and Windows
        return os.cpu_count() or 1
