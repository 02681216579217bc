# SPDX-License-Identifier: GPL-3.0-or-later
"""Repair of textures and images: what is missing is filled, pictures tile, blocks of JPEG go.

Nothing is invented: what is filled in follows from what is around it. May use `stitch`, `texture`
and the rooms below it.
"""
