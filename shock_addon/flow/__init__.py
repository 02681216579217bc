# SPDX-License-Identifier: GPL-3.0-or-later
"""Show where the filters will pull.

May use the operators and `data`.
"""
