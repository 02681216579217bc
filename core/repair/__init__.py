# SPDX-License-Identifier: GPL-3.0-or-later
"""Repair of textures and images: filling of missing texels, tiling, removal of JPEG blocks.

Nothing is invented: missing texels are computed from those around them. May use `stitch`,
`texture` and the rooms below it.
"""
