# SPDX-License-Identifier: GPL-3.0-or-later
"""Sparse matrices and graphs: sums, products, connected components, and factors.

May use only `core.base`.
"""
