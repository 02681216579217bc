# SPDX-License-Identifier: GPL-3.0-or-later
"""One module for each file format, or for the package that knows it."""
