# SPDX-License-Identifier: GPL-3.0-or-later
"""Stitching: several pictures of a surface, or charts that differ, become one texture.

May use `texture` and the rooms below it.
"""
