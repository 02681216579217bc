# SPDX-License-Identifier: GPL-3.0-or-later
"""Colors of images, of vertices and of face corners: sharpened and denoised.

May use the Beltrami kernel, flow-lines, `core.mesh` and `core.grid`.
"""
