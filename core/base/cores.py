# SPDX-License-Identifier: GPL-3.0-or-later
"""How many cores there are; for what must not import numba."""  # transition: file goes

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
