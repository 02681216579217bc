# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the flow of the filters, and the state of creases, over an object.

May use the operators and `data`.
"""
