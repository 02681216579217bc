# SPDX-License-Identifier: GPL-3.0-or-later
"""The short-time Beltrami kernel: smoothing that keeps edges, on images and meshes (paper C)."""
