# SPDX-License-Identifier: GPL-3.0-or-later
"""Results that a host adds to its data itself, and may add less or more of.

May use numpy only.
"""
