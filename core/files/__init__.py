# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes, images and textures on disk, outside Blender.

May use only the filters, the registry and the rooms below these, not `core.host`.
"""
