# SPDX-License-Identifier: GPL-3.0-or-later
"""Formats of meshes, one module for each, or for the package that knows it.

May use `core.files` for reading, staging and side files.
"""
