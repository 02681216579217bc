# SPDX-License-Identifier: GPL-3.0-or-later
"""Ray tracing of triangles: a bounding volume hierarchy, and directions of rays.

May use only the rooms below `core.mesh`. The kernels are our own: libraries for ray tracing, such
as embree, have no wheels for some platforms of the extension, and nothing may be compiled on a
user's machine.
"""
