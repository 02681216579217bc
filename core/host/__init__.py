# SPDX-License-Identifier: GPL-3.0-or-later
"""The filters on what a host program such as Blender keeps: seams, scale, symmetry, opacity.

May use all filters. `inputs` needs numpy only; the other modules bring compiled kernels along, so a
host imports them where they run, on a thread of its own.
"""
