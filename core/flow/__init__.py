# SPDX-License-Identifier: GPL-3.0-or-later
"""Flows on meshes: the potential, tracing along flow-lines, and reading values at their ends.

May use `core.mesh`.
"""
