# SPDX-License-Identifier: GPL-3.0-or-later
"""Symmetric linear systems: conjugate gradients and multigrid, for any number of columns.

May use only `core.base` and `core.sparse`.
"""
