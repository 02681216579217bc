# SPDX-License-Identifier: GPL-3.0-or-later
"""The folder of compiled kernels; a host program chooses it before it imports the first kernel.

Does not need numba, which takes long to import.
"""

from __future__ import annotations

chosen: str | None = None
"""A folder, made when needed. With None, numba chooses: beside the sources.

The environment variable ``NUMBA_CACHE_DIR`` takes precedence.
"""
