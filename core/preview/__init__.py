# SPDX-License-Identifier: GPL-3.0-or-later
"""What a host program shows before a run: a patch or a crop, the flow as arrows, screen colors.

May use `core.host`. Modules that compile kernels are imported by the host where they run.
"""
