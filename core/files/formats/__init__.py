# SPDX-License-Identifier: GPL-3.0-or-later
"""File formats, one room per kind of data. May use the modules that all of `core.files` uses."""
