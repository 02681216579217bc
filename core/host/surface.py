# SPDX-License-Identifier: GPL-3.0-or-later
"""The old name of inputs.py and welding.py."""

from .inputs import Surface  # noqa: F401  # transition
from .welding import Welded, welded  # noqa: F401  # transition
