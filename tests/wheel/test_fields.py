# SPDX-License-Identifier: GPL-3.0-or-later
"""The extra ``fields`` reads velocities out of NetCDF and Zarr."""

import numpy as np
import pytest
import xarray


@pytest.mark.parametrize("ending", ["nc", "zarr"])
def test_velocities_become_frames(shock_filter, tmp_path, ending):
    values = ("y", "x"), np.ones((8, 12), np.float32)
    data = xarray.Dataset({"u": values, "v": values})
    if ending == "nc":
        data.to_netcdf(tmp_path / "wind.nc")
    else:
        data.to_zarr(tmp_path / "wind.zarr", consolidated=False)
    shock_filter("visualize-flow", f"wind.{ending}", "frames", "--frames", "2")
    assert len(list((tmp_path / "frames").glob("*.png"))) == 2
