# SPDX-License-Identifier: GPL-3.0-or-later
"""The base that all rooms share: progress, threads, compiled kernels, checks, cached results.

May use only the settings and the errors.
"""
