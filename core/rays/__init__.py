# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays against triangles: a hierarchy of boxes, and directions in which to look.

May use only the rooms below `core.mesh`. The kernels are our own: libraries for rays, such as
embree, have no wheels for all platforms of the extension, and none may compile on a user's
machine.
"""
