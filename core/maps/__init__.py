# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps of the shape of a mesh, drawn into textures across seams.

May use all rooms of filters below it.
"""
