# SPDX-License-Identifier: GPL-3.0-or-later
"""Formats of images and animations, one module per format, or per package that reads several.

May use only `core.files.reading` of `core.files`.
"""
