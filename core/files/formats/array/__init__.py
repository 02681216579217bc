# SPDX-License-Identifier: GPL-3.0-or-later
"""Formats of arrays: NetCDF, HDF5, Zarr, and what their metadata may hold.

May use `core.files.reading`.
"""
