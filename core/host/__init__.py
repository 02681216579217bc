# SPDX-License-Identifier: GPL-3.0-or-later
"""The filters on what a host program such as Blender keeps: seams, scale, symmetry, opacity.

Everything here is arrays. `inputs` and what shows results need numpy only. `geometry`, `colors`,
`images`, `textures`, `denoising`, `flow` and `rehearsal` bring the compiled kernels along, which
takes a while: a host names their functions where they run, on a thread of its own. `rehearse_alone`
is a script for a process of its own.
"""
