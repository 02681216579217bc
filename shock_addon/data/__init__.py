# SPDX-License-Identifier: GPL-3.0-or-later
"""Between Blender's data and arrays: meshes, shape keys, masks, colors, images."""
