# SPDX-License-Identifier: GPL-3.0-or-later
"""Formats of arrays: NetCDF, HDF5, Zarr, and checks of their metadata.

May use only `core.files.reading` of `core.files`.
"""
