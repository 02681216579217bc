# SPDX-License-Identifier: GPL-3.0-or-later
"""Show over an object where the filters will pull, and what becomes of its creases.

May use the operators and `data`.
"""
