# SPDX-License-Identifier: GPL-3.0-or-later
"""The old name of welding.py."""

from .welding import Surface, Welded, welded  # noqa: F401  # transition
