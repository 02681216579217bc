# SPDX-License-Identifier: GPL-3.0-or-later
"""Formats of files, in a room for each kind of data. May use what all of `core.files` stands on."""
