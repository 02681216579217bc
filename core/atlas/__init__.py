# SPDX-License-Identifier: GPL-3.0-or-later
"""Texture atlases: charts, seams, texels and the gutter (paper B, sections 3 and 4)."""

from .atlas import TextureAtlas, TextureMasks, UVReport

__all__ = ["TextureAtlas", "TextureMasks", "UVReport"]
