# SPDX-License-Identifier: GPL-3.0-or-later
"""The short-time Beltrami kernel: smoothing that keeps edges, on grids, meshes, texels (paper C).

May use `core.atlas`, `core.mesh` and `core.grid`.
"""
