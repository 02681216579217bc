# SPDX-License-Identifier: GPL-3.0-or-later
"""Formats of meshes, one module per format, or per package that reads several.

May use reading, staging and side files of `core.files`.
"""
