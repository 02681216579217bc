# SPDX-License-Identifier: GPL-3.0-or-later
"""Previews for a host program: patches and crops, the flow as arrows, screen colors.

May use `core.host`. The host imports modules with kernels only on the threads that run them.
"""
