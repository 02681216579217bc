# SPDX-License-Identifier: GPL-3.0-or-later
"""The interface: panels, menus, presets, translations, and links to the manual.

May use all of the add-on.
"""
