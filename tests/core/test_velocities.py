# SPDX-License-Identifier: GPL-3.0-or-later
"""Velocities on disk: flow maps, arrays, NetCDF and Zarr, vectors of meshes."""

import re
import sys

import numpy as np
import pytest
from PIL import Image
from shock_filter import core
from shock_filter.core.files.images import write_image_file
from shock_filter.core.files.velocities import How, PlaneFlow, SurfaceFlow, read_velocity

H, W = 4, 6


def field(shape=(H, W)):
    """Make a velocity that differs in all places."""
    return np.random.default_rng(0).uniform(-1, 1, (*shape, 2)).astype(np.float32)


def read(path, **words):
    found = read_velocity(path, How(**words))
    assert isinstance(found, PlaneFlow)
    return found.velocity


# -------------------------------------------------------------------------------------- flow maps


def test_the_middle_of_a_flow_map_is_zero(tmp_path):
    path = tmp_path / "map.png"
    Image.fromarray(np.full((3, 4, 3), 128, np.uint8)).save(path)
    found = read_velocity(path)
    assert not found.velocity.any() and found.velocity.shape == (3, 4, 2)
    assert found.notes == ("the flow is 0",)


@pytest.mark.parametrize("y_axis, sign", [("up", 1.0), ("down", -1.0)])
def test_red_is_right_and_green_is_up_or_down(tmp_path, y_axis, sign):
    pixels = np.full((2, 2, 3), 128, np.uint8)
    pixels[0, 0] = 255, 128, 7  # blue has no meaning
    pixels[0, 1] = 128, 255, 0
    pixels[1, 0] = 0, 1, 0
    Image.fromarray(pixels).save(tmp_path / "map.png")
    wanted = [[[1, 0], [0, sign]], [[-1, -sign], [0, 0]]]
    np.testing.assert_array_equal(read(tmp_path / "map.png", y_axis=y_axis), wanted)


@pytest.mark.parametrize("kind", ["uint8", "uint16", "float32"])
def test_flow_maps_of_all_depths_hold_the_velocity(tmp_path, kind):
    wanted = field()
    values = np.dstack([0.5 + 0.5 * wanted, np.zeros((H, W), np.float32)])
    if kind != "float32":
        most = np.iinfo(kind).max
        values = np.rint(0.5 + most * values).astype(kind)
    write_image_file(tmp_path / "map.tif", values, False)
    found = read(tmp_path / "map.tif")
    assert np.abs(found - wanted).max() < {"uint8": 0.013, "uint16": 1e-4, "float32": 1e-6}[kind]


def test_clear_places_of_a_flow_map_are_undefined(tmp_path):
    pixels = np.full((2, 3, 4), 200, np.uint8)
    pixels[1, 2, 3] = 0
    Image.fromarray(pixels).save(tmp_path / "map.png")
    found = read(tmp_path / "map.png")
    np.testing.assert_array_equal(np.isnan(found).all(axis=2), pixels[..., 3] == 0)


def test_images_that_are_no_flow_maps_are_refused(tmp_path):
    Image.fromarray(np.zeros((3, 3), np.uint8)).save(tmp_path / "gray.png")
    with pytest.raises(core.ShockError, match="is gray; a flow map has its velocity in red"):
        read_velocity(tmp_path / "gray.png")
    with pytest.raises(core.InvalidSignal, match=r"leaves the range 0 to 1"):
        core.flow_map_velocity(np.full((2, 2, 3), -0.5))
    with pytest.raises(core.InvalidSignal, match=r"shape \(2, 2\)"):
        core.flow_map_velocity(np.zeros((2, 2)))
    with pytest.raises(core.InvalidSignal, match="type int32"):
        core.flow_map_velocity(np.zeros((2, 2, 3), np.int32))


# ----------------------------------------------------------------------------------------- arrays


@pytest.mark.parametrize("shape", [(H, W), (3, H, W)])
def test_arrays_are_read_as_they_are(tmp_path, shape):
    np.save(tmp_path / "a.npy", field(shape))
    np.testing.assert_array_equal(read(tmp_path / "a.npy"), field(shape))
    down = read(tmp_path / "a.npy", y_axis="down")
    np.testing.assert_array_equal(down, field(shape) * [1, -1])


def test_archives_hold_one_array_or_both_components(tmp_path):
    wanted = field()
    np.savez(tmp_path / "one.npz", whatever=wanted)
    np.savez(tmp_path / "named.npz", velocity=wanted, x=np.arange(3))
    np.savez(tmp_path / "both.npz", u=wanted[..., 0], v=wanted[..., 1], x=np.arange(3))
    for name in ("one", "named", "both"):
        np.testing.assert_array_equal(read(tmp_path / f"{name}.npz"), wanted)
    np.savez(tmp_path / "other.npz", a=wanted[..., 0], b=wanted[..., 1])
    np.testing.assert_array_equal(read(tmp_path / "other.npz", variables=("a", "b")), wanted)
    with pytest.raises(core.ShockError, match=r"has no u and v; it has: a, b. Name both"):
        read(tmp_path / "other.npz")
    np.savez(tmp_path / "odd.npz", u=np.zeros((2, 3)), v=np.zeros((3, 2)))
    with pytest.raises(core.ShockError, match=re.escape("u has the shape (2, 3), v (3, 2)")):
        read(tmp_path / "odd.npz")


def test_arrays_of_other_shapes_and_other_files_are_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((2, 5, 5)))
    with pytest.raises(core.ShockError, match=r"shape \(2, 5, 5\); save \(rows, columns, 2\)"):
        read(tmp_path / "a.npy")
    (tmp_path / "a.npz").write_bytes(b"no archive")
    with pytest.raises(core.ShockError, match="is no archive of arrays"):
        read(tmp_path / "a.npz")
    with pytest.raises(core.ShockError, match="not read from such files; use one of"):
        read(tmp_path / "a.stl")
    with pytest.raises(core.ShockError, match="There is no file"):
        read(tmp_path / "b.npy")


# --------------------------------------------------------------------------------- NetCDF and Zarr


@pytest.fixture
def grid():
    """Return a function that makes a data set of both components, rows from north to south."""
    xarray = pytest.importorskip("xarray")

    def make(names=("u", "v"), shape=(H, W), north_first=True, about=({}, {}), times=None, **axes):
        values = field(shape)
        dims = ("time", "lat", "lon")[-len(shape) :]
        lat = np.linspace(50.0, 40.0, H)
        if not north_first:
            values, lat = values[..., ::-1, :, :], lat[::-1]
        coords = {"lat": ("lat", lat), "lon": ("lon", np.arange(W) * 1.5)}
        if len(shape) == 3:
            at = np.arange(shape[0]) if times is None else times
            coords["time"] = ("time", at, {"units": "hours since 2001-01-01"})
        parts = {name: (dims, values[..., part], about[part]) for part, name in enumerate(names)}
        data = xarray.Dataset(parts, coords)
        return data.rename(axes) if axes else data

    return make


WRITERS = {
    "a.nc": lambda data, path: data.to_netcdf(path, engine="netcdf4"),
    "b.nc": lambda data, path: data.to_netcdf(path, format="NETCDF3_64BIT"),
    "c.zarr": lambda data, path: data.to_zarr(path),
}


@pytest.mark.filterwarnings("ignore")  # zarr's own
@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("shape", [(H, W), (3, H, W)])
def test_grids_come_out_with_north_on_top(tmp_path, grid, name, shape):
    for north_first in (True, False):
        path = tmp_path / f"{north_first}{name}"
        WRITERS[name](grid(shape=shape, north_first=north_first), path)
        np.testing.assert_array_equal(read(path), field(shape))


def save(data, tmp_path):
    path = tmp_path / "grid.nc"
    data.to_netcdf(path, engine="netcdf4")
    return path


@pytest.mark.parametrize(
    "first, second",
    [
        ("eastward_wind", "northward_wind"),
        ("sea_water_x_velocity", "sea_water_y_velocity"),
        ("x_wind", "y_wind"),
    ],
)
def test_components_are_found_by_their_standard_names(tmp_path, grid, first, second):
    about = {"standard_name": first}, {"standard_name": second}
    path = save(grid(("p", "q"), about=about), tmp_path)
    np.testing.assert_array_equal(read(path), field())
    assert read_velocity(path).notes == ("velocities are p and q",)


def test_components_are_found_by_name_or_named(tmp_path, grid):
    np.testing.assert_array_equal(read(save(grid(("uo", "vo")), tmp_path)), field())
    path = save(grid(("p", "q")), tmp_path)
    np.testing.assert_array_equal(read(path, variables=("p", "q")), field())
    with pytest.raises(core.ShockError, match=r"no variables named u and v.* It has: p, q"):
        read(path)
    with pytest.raises(core.ShockError, match="no variable r; it has: p, q"):
        read(path, variables=("p", "r"))


def test_rows_and_columns_are_found_by_their_coordinates(tmp_path, grid):
    data = grid(shape=(3, H, W)).transpose("lon", "time", "lat")
    np.testing.assert_array_equal(read(save(data, tmp_path)), field((3, H, W)))
    data = grid(lat="j", lon="i")
    data["j"].attrs["axis"], data["i"].attrs["standard_name"] = "Y", "longitude"
    np.testing.assert_array_equal(read(save(data.transpose("i", "j"), tmp_path)), field())
    data = grid().drop_vars(["lat", "lon"])  # rows are counted upwards then
    np.testing.assert_array_equal(read(save(data, tmp_path)), field()[::-1])


def test_masked_places_are_undefined(tmp_path, grid):
    data = grid()
    data["u"].encoding["_FillValue"] = np.float32(-999.0)
    data["u"][1, 2] = np.nan
    found = read(save(data, tmp_path))
    assert np.isnan(found[1, 2, 0]) and np.isfinite(found[0]).all()


def test_a_depth_has_to_be_chosen(tmp_path, grid):
    data = grid().expand_dims(depth=[5.0]).copy()
    np.testing.assert_array_equal(read(save(data, tmp_path)), field())  # the only one
    data = grid(shape=(3, H, W)).expand_dims(depth=[5.0, 10.0]).copy(deep=True)
    data["u"][1] += 1.0
    path = save(data, tmp_path)
    with pytest.raises(core.ShockError, match=r"dimension depth of 2 places; .*--select depth=0"):
        read(path)
    found = read(path, select={"depth": 1})
    np.testing.assert_allclose(found, field((3, H, W)) + [1.0, 0.0], atol=1e-6)
    assert read(path, select={"depth": 0, "time": 2}).shape == (H, W, 2)
    with pytest.raises(core.ShockError, match="no dimension height; it has: depth, time"):
        read(path, select={"height": 0})
    with pytest.raises(core.ShockError, match="depth has 2 places; give one from 0, not 2"):
        read(path, select={"depth": 2})


def test_key_frames_are_brought_to_even_times(tmp_path, grid):
    path = save(grid(shape=(3, H, W), times=[0.0, 1.0, 4.0]), tmp_path)
    found, wanted = read(path), field((3, H, W))
    np.testing.assert_array_equal(found[[0, 2]], wanted[[0, 2]])
    np.testing.assert_allclose(found[1], (2 * wanted[1] + wanted[2]) / 3, atol=1e-6)
    assert "interpolated to even" in read_velocity(path).notes[1]
    path = save(grid(shape=(3, H, W), times=[2.0, 1.0, 0.0]), tmp_path)
    np.testing.assert_array_equal(read(path), wanted[::-1])


def test_components_at_other_places_are_refused(tmp_path, grid):
    data = grid()
    data["v"] = data["v"].rename(lat="lat_v")
    with pytest.raises(core.ShockError, match="u is given at lat 4 x lon 6, v at lat_v 4"):
        read(save(data, tmp_path))


def test_files_that_are_no_grids_are_refused(tmp_path, monkeypatch):
    pytest.importorskip("xarray")
    (tmp_path / "a.nc").write_bytes(b"\x89HDF nothing")
    with pytest.raises(core.ShockError, match="cannot be read"):
        read(tmp_path / "a.nc")
    for name in ("b.nc", "b.zarr"):
        with pytest.raises(core.ShockError, match="There is no file"):
            read(tmp_path / name)
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(core.ShockError, match=re.escape("pip install 'shock-filter[fields]'")):
        read(tmp_path / "a.nc")


# ----------------------------------------------------------------------------------------- meshes


def square(path, *names, more="s t"):
    """Write a unit square of two triangles, with vectors of these names."""
    properties = [f"property float {name}" for name in ["x", "y", "z", *more.split(), *names]]
    head = ["ply", "format ascii 1.0", "element vertex 4", *properties, "element face 2"]
    head += ["property list uchar int vertex_indices", "end_header"]
    corners = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"]
    uv = ["0 0", "1 0", "1 1", "0 1"] if more else [""] * 4
    values = [" ".join(str(0.5 * (n + 1) * (k + 1)) for k in range(len(names))) for n in range(4)]
    rows = [" ".join(row) for row in zip(corners, uv, values, strict=True)]
    path.write_text("\n".join([*head, *rows, "3 0 1 2", "3 0 2 3"]) + "\n")
    return path


def test_vectors_of_a_mesh_are_found_and_named(tmp_path):
    wanted = 0.5 * np.outer(np.arange(1, 5), np.arange(1, 4))
    path = square(tmp_path / "a.ply", "flow_x", "flow_y", "flow_z")
    for words in ({}, {"attribute": "flow"}):
        found = read_velocity(path, How(**words))
        assert isinstance(found, SurfaceFlow)
        np.testing.assert_array_equal(found.vectors, wanted)
        assert found.uv.shape == (2, 3, 2) and found.mesh.vertex_count == 4
    with pytest.raises(core.ShockError, match="no vectors named 'wind'; it has: flow"):
        read_velocity(path, How(attribute="wind"))
    normals = square(tmp_path / "n.ply", "nx", "ny", "nz", "vx", "vy", "vz")
    assert read_velocity(normals).vectors[0].tolist() == [2.0, 2.5, 3.0]
    two = square(tmp_path / "t.ply", "ax", "ay", "az", "vx", "vy", "vz")
    with pytest.raises(core.ShockError, match=r"chosen at once; it has: a, v. Name one"):
        read_velocity(two)
    with pytest.raises(core.InvalidUV, match="no texture coordinates"):
        read_velocity(square(tmp_path / "u.ply", "vx", "vy", "vz", more=""))


@pytest.mark.parametrize(
    "sizes", [{"width": 1e-200, "step": 1e-200}, {"width": 1e-300, "duration": 1e300}]
)
def test_more_frames_than_can_be_counted_are_refused(sizes):
    velocity = np.full((5, 5, 2), [9.9, 0.0])
    with pytest.raises(core.InvalidSettings, match="number of frames"):
        core.flow_frames(velocity, **{"columns": 300, "width": 8.0, "duration": 1.0, **sizes})
