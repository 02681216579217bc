# SPDX-License-Identifier: GPL-3.0-or-later
"""Symmetric linear systems: conjugate gradients and multigrid over matrices and columns.

May use `core.base` alone.
"""
