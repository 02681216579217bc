# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs of all filters on tiny examples, which compile their kernels in advance.

May use `core.host` and the registry.
"""
