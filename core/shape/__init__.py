# SPDX-License-Identifier: GPL-3.0-or-later
"""The geometry of meshes: sharpened along creases, denoised, refitted to normals.

May use signals (`core.color`), the Beltrami kernel, learned mixtures, flow-lines, sparse solvers
and `core.mesh`.
"""
