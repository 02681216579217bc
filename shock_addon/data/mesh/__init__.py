# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh objects: positions, colors, masks, shape keys, marks.

May use the rest of `data` but `data.image`.
"""

from typing import TYPE_CHECKING

from .. import importing

if TYPE_CHECKING:
    from . import (  # noqa: F401
        colors,
        creases,
        flow,
        geometry,
        low_poly,
        masks,
        meshes,
        original,
        painted,
        shading,
        shape_keys,
        targets,
        vertex_groups,
        visible,
    )

__getattr__ = importing(__name__)
