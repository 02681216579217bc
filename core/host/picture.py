# SPDX-License-Identifier: GPL-3.0-or-later
"""The old name of images.py."""

from .images import Picture, Pixels, filter_picture  # noqa: F401  # transition
