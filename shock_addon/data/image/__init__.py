# SPDX-License-Identifier: GPL-3.0-or-later
"""Images: pixels, tiles, material maps, sequences, fields and flows.

May use `data.mesh` and the rest of `data`.
"""

from typing import TYPE_CHECKING

from .. import importing

if TYPE_CHECKING:
    from . import (  # noqa: F401
        baked,
        canvas,
        fields,
        flows,
        images,
        in_world,
        linking,
        live_masks,
        maps,
        mixing,
        sequences,
        stand_in,
        textures,
        tiles,
    )

__getattr__ = importing(__name__)
