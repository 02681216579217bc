# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs on a thread beside Blender's window: jobs, compiled kernels, the status bar.

May use `core`, and no operator.
"""
