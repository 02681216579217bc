# SPDX-License-Identifier: GPL-3.0-or-later
"""The core's filters on what Blender keeps: seams, scale, symmetry, opacity. Needs no bpy."""
