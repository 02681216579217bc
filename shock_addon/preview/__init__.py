# SPDX-License-Identifier: GPL-3.0-or-later
"""Try settings by mouse, seen at once."""
