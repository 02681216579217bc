# SPDX-License-Identifier: GPL-3.0-or-later
"""The extra ``cluster`` filters pictures chunk by chunk, on workers."""

import dask.array
import numpy as np
import tifffile
import zarr
from distributed import Client, LocalCluster
from shock_filter import core


def test_chunks_give_the_bits_of_the_whole(tmp_path):
    values = np.random.default_rng(0).random((48, 64, 3), np.float32)
    zarr.save(str(tmp_path / "in.zarr"), values)
    tifffile.imwrite(tmp_path / "in.tif", values, photometric="rgb")
    settings = core.ImageSettings(time=4.0)
    one = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": ":0"}
    with LocalCluster(**one) as cluster, Client(cluster):
        lazy = dask.array.from_zarr(str(tmp_path / "in.zarr")).rechunk((24, 32, 3))
        found = core.sharpen_image(lazy, settings).compute()
    np.testing.assert_array_equal(found, core.sharpen_image(values, settings))
