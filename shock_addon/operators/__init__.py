# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators of the buttons: they read, filter on a thread, write and report.

May use `running`, `data` and the table of modes.
"""
