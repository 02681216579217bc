# SPDX-License-Identifier: GPL-3.0-or-later
"""The old name of inputs.py and images.py."""

from .images import filter_picture  # noqa: F401  # transition
from .inputs import HostImage as Picture  # noqa: F401  # transition
from .inputs import Pixels  # noqa: F401  # transition
