# SPDX-License-Identifier: GPL-3.0-or-later
"""Flows on meshes: the potential, tracing along flow-lines, and sampling at their ends.

May use only `core.mesh` and the rooms below it.
"""
