# SPDX-License-Identifier: GPL-3.0-or-later
"""Textures of meshes, across seams: sharpened, denoised, detailed, generated.

May use `core.color`, the Beltrami kernel, finite elements and texture atlases.
"""
