# SPDX-License-Identifier: GPL-3.0-or-later
"""Stitching: merges several pictures of a surface, or charts that differ, into one texture.

May use `texture` and the rooms below it.
"""
