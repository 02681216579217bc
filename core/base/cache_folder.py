# SPDX-License-Identifier: GPL-3.0-or-later
"""Where compiled kernels are kept, for a host program to choose before the first is imported.

Needs no numba, which takes long to import.
"""

from __future__ import annotations

chosen: str | None = None
"""A folder; it is made when needed. None leaves the choice to numba, beside the sources.

The environment variable ``NUMBA_CACHE_DIR`` comes first.
"""
