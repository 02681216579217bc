# SPDX-License-Identifier: GPL-3.0-or-later
"""What every room stands on: progress, threads, compiled kernels, checks, kept results.

May use the settings and the errors alone.
"""
