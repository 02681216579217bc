# SPDX-License-Identifier: GPL-3.0-or-later
"""Live previews of settings that the mouse changes.

May use the operators, `data` and `core.preview`.
"""
