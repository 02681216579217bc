# SPDX-License-Identifier: GPL-3.0-or-later
"""Finite elements on the texels of a surface, and multigrid that solves them (paper B, section 3).

May use only texture atlases, `core.linear`, `core.mesh` and the rooms below these.
"""
