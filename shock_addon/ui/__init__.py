# SPDX-License-Identifier: GPL-3.0-or-later
"""What people see: panels, menus, presets, translations, and the way to the manual.

May use all of the add-on.
"""
