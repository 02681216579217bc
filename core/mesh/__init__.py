# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangle meshes: connectivity, memory order, calculus and geodesic distances.

May use only `core.base` and `core.sparse`.
"""
