# SPDX-License-Identifier: GPL-3.0-or-later
"""Live results: attributes with movements, the nodes that add them, and copies that have a source.

May use the modules of `data`, but none of its other folders.
"""

from typing import TYPE_CHECKING

from .. import importing

if TYPE_CHECKING:
    from . import (  # noqa: F401
        color_nodes,
        coloring,
        copies,
        graph,
        marks,
        movement,
        nodes,
        recipes,
        results,
        sources,
        stacks,
        watching,
    )

__getattr__ = importing(__name__)
