# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes, images and textures on disk, outside Blender.

May use the filters and the registry, but not `core.host`.
"""
