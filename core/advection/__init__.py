# SPDX-License-Identifier: GPL-3.0-or-later
"""Flows as moving textures: Lagrangian-Eulerian advection of noise and dye (paper D).

May use `core.texture` and texture atlases, for flows on surfaces.
"""
