# SPDX-License-Identifier: GPL-3.0-or-later
"""Live results: attributes with movements, the nodes that add them, and copies that have a source.

May use the modules of `data`, but none of its other folders.
"""

from typing import TYPE_CHECKING

from .. import importing

if TYPE_CHECKING:
    from . import copies, movement, nodes, recipes, stacks, watching  # noqa: F401

__getattr__ = importing(__name__)
