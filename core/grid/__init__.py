# SPDX-License-Identifier: GPL-3.0-or-later
"""Images as meshes of squares: the flow in them, walks, samples and geodesic distances.

May use only `core.base` and `core.sparse`.
"""
