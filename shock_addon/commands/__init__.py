# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's command lines.

May use `core.cli`, `core.files`, the operators and `data`.
"""
