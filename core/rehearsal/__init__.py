# SPDX-License-Identifier: GPL-3.0-or-later
"""Each filter run once on a tiny example, so that its kernels are compiled before they are needed.

May use `core.host` and the registry. `alone` is a script for a process of its own.
"""
