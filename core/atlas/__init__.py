# SPDX-License-Identifier: GPL-3.0-or-later
"""Texture atlases: charts, seams, texels, the gutter, and flows on them (paper B, sections 3, 4).

May use only `core.mesh`, `core.grid`, `core.linear` and the rooms below these.
"""

from .atlas import TextureAtlas, TextureMasks, UVReport

__all__ = ["TextureAtlas", "TextureMasks", "UVReport"]
