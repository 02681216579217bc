# SPDX-License-Identifier: GPL-3.0-or-later
"""What the buttons run: reading, filtering on a thread, writing, saying what was done.

May use `running`, `data` and the table of modes.
"""
