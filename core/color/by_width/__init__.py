# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening by the width of borders: one recipe on meshes, grids and sheets of texels.

May use `core.color.signals`, flow-lines, `core.mesh` and `core.grid`.
"""
