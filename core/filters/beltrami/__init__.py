# SPDX-License-Identifier: GPL-3.0-or-later
"""The short-time Beltrami kernel: smoothing that keeps edges, on images and meshes.

References
----------
A. Spira, R. Kimmel, N. Sochen: A Short Time Beltrami Kernel for Smoothing Images and Manifolds,
2007. (Paper C.)
"""
