# SPDX-License-Identifier: GPL-3.0-or-later
"""Try settings by mouse, seen at once.

May use the operators, `data` and `core.preview`.
"""
