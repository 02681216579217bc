# SPDX-License-Identifier: GPL-3.0-or-later
"""Zarr, HDF5 and archives from strangers: no code runs, and no other file is read."""

import json
import lzma
import os
import pickle
import zipfile
from pathlib import Path

import h5py
import netCDF4
import numpy as np
import pytest
import xarray
import zarr
from on_files import sharpen_image_file
from shock_filter import core
from shock_filter.core.files.formats.array.zarr_metadata import CODECS, check_zarr
from shock_filter.core.files.velocities import How, read_velocity

STRONG = core.ImageSettings(time=64)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "here"


class Trap:
    """Runs code where it is unpickled."""

    def __reduce__(self):
        return Path.touch, (Path("trapped"),)


def save_dataset(name, version=2, **more):
    grid = np.random.default_rng(0).random((4, 6)).astype(np.float32)
    data = xarray.Dataset(
        {"u": (("y", "x"), grid), "v": (("y", "x"), grid)},
        {"y": np.arange(4.0), "x": np.arange(6.0)},
    )
    data.to_zarr(name, zarr_format=version, consolidated=False)
    return grid


def edit(path, change):
    document = json.loads(Path(path).read_bytes())
    change(document)
    Path(path).write_text(json.dumps(document))


# ------------------------------------------------------------------------------------- Zarr: code


@pytest.mark.parametrize("part", ["u", "x"])
@pytest.mark.parametrize("place", ["filters", "compressor"])
def test_a_codec_that_runs_code_is_refused_by_name(part, place):
    save_dataset("a.zarr")
    codec = {"id": "pickle"}
    edit(f"a.zarr/{part}/.zarray", lambda array: array.update(
        {place: [{"id": "zlib", "level": 1}, codec] if place == "filters" else codec}
    ))  # fmt: skip
    for chunk in Path("a.zarr", part).glob("[0-9]*"):
        chunk.write_bytes(pickle.dumps(Trap()))
    with pytest.raises(core.ShockError, match="codec 'pickle' is not read, since it can run code"):
        read_velocity("a.zarr")
    assert not Path("trapped").exists()


def test_objects_are_refused():
    save_dataset("a.zarr")
    edit("a.zarr/u/.zarray", lambda array: array.update(
        dtype="|O", filters=[{"id": "vlen-utf8"}], fill_value=None
    ))  # fmt: skip
    with pytest.raises(core.ShockError, match=r"type '\|O' is not read, since it can run code"):
        read_velocity("a.zarr")


@pytest.mark.parametrize("name", ["pickle", "numcodecs.pickle", "json2", "categorize", "mine"])
@pytest.mark.parametrize("is_inner", [False, True])
def test_codecs_of_the_third_format_are_looked_at_too(name, is_inner):
    save_dataset("a.zarr", version=3)
    codec = {"name": name, "configuration": {}}
    shards = {"chunk_shape": [2, 2], "codecs": [codec], "index_codecs": [{"name": "bytes"}]}
    outer = {"name": "sharding_indexed", "configuration": shards}
    edit("a.zarr/u/zarr.json", lambda array: array.update(codecs=[outer if is_inner else codec]))
    with pytest.raises(core.ShockError, match="is not read, since it"):
        read_velocity("a.zarr")


def test_pictures_are_looked_at_as_velocities_are():
    zarr.create_array("a.zarr", shape=(8, 8), dtype="u1", zarr_format=2)[:] = 1
    edit("a.zarr/.zarray", lambda array: array.update(compressor={"id": "pickle"}))
    with pytest.raises(core.ShockError, match="codec 'pickle'"):
        sharpen_image_file("a.zarr", "b.zarr", STRONG)
    assert not Path("b.zarr").exists()


@pytest.mark.filterwarnings("ignore:Consolidated metadata")
@pytest.mark.parametrize("version", [2, 3])
def test_consolidated_metadata_are_looked_at(version):
    save_dataset("a.zarr", version)
    zarr.consolidate_metadata("a.zarr")
    if version == 2:
        edit("a.zarr/.zmetadata", lambda all_of_it: all_of_it["metadata"]["x/.zarray"].update(
            compressor={"id": "pickle"}
        ))  # fmt: skip
    else:
        edit("a.zarr/zarr.json", lambda group: group["consolidated_metadata"]["metadata"]["x"]
             .update(codecs=[{"name": "numcodecs.pickle", "configuration": {}}]))  # fmt: skip
    with pytest.raises(core.ShockError, match="codec 'pickle' is not read"):
        read_velocity("a.zarr")


@pytest.mark.parametrize("name", ["../outside", "/etc", "a/../../b", "c:/d"])
def test_consolidated_metadata_lead_nowhere_else(name):
    save_dataset("a.zarr")
    zarr.consolidate_metadata("a.zarr")
    edit("a.zarr/.zmetadata", lambda all_of_it: all_of_it["metadata"].update(
        {f"{name}/.zarray": all_of_it["metadata"]["u/.zarray"]}
    ))  # fmt: skip
    with pytest.raises(core.ShockError, match="which is not in the folder"):
        read_velocity("a.zarr")


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="no links")
def test_links_out_of_the_folder_are_refused():
    save_dataset("a.zarr")
    Path("secret").write_bytes(b"42 secrets" * 10)
    (chunk,) = Path("a.zarr/u").glob("0.0")
    chunk.unlink()
    chunk.symlink_to(Path("secret").absolute())
    with pytest.raises(core.ShockError, match=r"u/0\.0 is a link out of the folder"):
        read_velocity("a.zarr")


@pytest.mark.parametrize("change", [
    lambda array: array.pop("shape"),
    lambda array: array.update(shape="large"),
    lambda array: array.update(shape=[-1, 4]),
    lambda array: array.update(chunks=None),
    lambda array: array.update(dtype=[["a", "<f4"]]),
    lambda array: array.update(dtype=None),
    lambda array: array.update(filters={"id": 3}),
    lambda array: array.update(compressor="zlib"),
])  # fmt: skip
def test_broken_metadata_are_named(change):
    save_dataset("a.zarr")
    edit("a.zarr/u/.zarray", change)
    with pytest.raises(core.ShockError, match=r"a\.zarr: (u/\.zarray|type|codec)"):
        check_zarr(Path("a.zarr"))


@pytest.mark.parametrize("text", ["", "[]", "{", "[" * 100_000, "\xff"])
def test_metadata_that_are_no_json_are_named(text):
    save_dataset("a.zarr")
    Path("a.zarr/u/.zarray").write_text(text, encoding="latin-1")
    with pytest.raises(core.ShockError, match=r"u/\.zarray is no JSON"):
        read_velocity("a.zarr")


@pytest.mark.parametrize("version", [2, 3])
def test_all_that_zarr_packs_by_itself_is_read(version):
    grid = save_dataset("a.zarr", version)
    np.testing.assert_array_equal(read_velocity("a.zarr").velocity[..., 0], grid[::-1])
    assert {"blosc", "zstd", "gzip", "bytes", "delta", "sharding_indexed"} <= CODECS
    assert not CODECS & {"pickle", "json2", "msgpack2", "categorize", "vlen-array"}


# ----------------------------------------------------------------------------- HDF5: other files


def save_netcdf(name, **words):
    with netCDF4.Dataset(name, "w", **words) as data:
        data.createDimension("y", 4)
        data.createDimension("x", 6)
        for part in "uv":
            data.createVariable(part, "f4", ("y", "x"))[:] = 1.0


def secret(folder):
    with h5py.File(folder / "secret.h5", "w") as file:
        file["v"] = np.full((4, 6), 42.0, np.float32)
    return folder / "secret.h5"


def link(file, path):
    file["v"] = h5py.ExternalLink(path, "/v")


def raw(file, path):
    file.create_dataset("v", (4, 6), "f4", external=[(path, 0, 96)])


def virtual(file, path):
    layout = h5py.VirtualLayout((4, 6), "f4")
    layout[:] = h5py.VirtualSource(path, "v", (4, 6))
    file.create_virtual_dataset("v", layout)


@pytest.mark.parametrize("way", [link, raw, virtual])
@pytest.mark.parametrize("is_relative", [False, True])
@pytest.mark.parametrize("is_below", [False, True])
def test_files_beyond_the_folder_are_not_read(folder, way, is_relative, is_below):
    path = secret(folder.parent)
    save_netcdf("a.nc")
    with h5py.File("a.nc", "r+") as file:
        del file["v"]
        name = os.path.relpath(path, folder) if is_relative else str(path)
        way(file.create_group("deep/er") if is_below else file, name)
    with pytest.raises(core.ShockError, match=r"a\.nc takes data from .*secret\.h5"):
        read_velocity("a.nc")


def test_a_link_to_a_file_beside_that_leads_elsewhere_is_refused(folder):
    path = secret(folder.parent)
    save_netcdf("a.nc")
    with h5py.File("a.nc", "r+") as file, h5py.File("b.h5", "w") as other:
        file["more"] = h5py.ExternalLink("b.h5", "/")
        link(other, str(path))
    with pytest.raises(core.ShockError, match="takes data from"):
        read_velocity("a.nc")


def test_files_in_the_same_folder_may_be_read(folder):
    save_netcdf("a.nc")
    secret(folder)
    with h5py.File("a.nc", "r+") as file:
        file["more"] = h5py.ExternalLink("secret.h5", "/v")
    assert (read_velocity("a.nc").velocity == 1).all()


@pytest.mark.parametrize("kind", ["NETCDF3_CLASSIC", "NETCDF3_64BIT_DATA", "NETCDF4_CLASSIC"])
def test_older_netcdf_is_read_as_before(kind):
    save_netcdf("a.nc", format=kind)
    assert (read_velocity("a.nc").velocity == 1).all()


# ------------------------------------------------------------------------------------------ claims


@pytest.mark.parametrize("version", [2, 3])
def test_a_zarr_that_claims_more_than_it_can_hold_is_refused(version):
    words = {"dtype": "f4", "zarr_format": version}
    group = zarr.create_group("a.zarr", zarr_format=version)
    for name in "uv":
        group.create_array(name, shape=(60_000, 60_000), chunks=(1000, 1000), dtype="f4",
                           **({"dimension_names": "yx"} if version == 3 else {}))  # fmt: skip
    with pytest.raises(core.ShockError, match=r"claims to hold .* GiB .*--any-size"):
        read_velocity("a.zarr")
    zarr.create_array("one.zarr", shape=(200_000, 200_000), chunks=(200_000, 200_000), **words)
    zarr.create_array("chunk.zarr", shape=(10, 10), chunks=(200_000, 200_000), **words)
    for name in ("one.zarr", "chunk.zarr"):
        with pytest.raises(core.ShockError, match="claims to hold"):
            sharpen_image_file(name, "out.zarr", STRONG)


def test_coordinates_that_claim_too_much_are_refused():
    save_netcdf("a.nc")
    with netCDF4.Dataset("a.nc", "r+") as data:
        data.createDimension("z", 1 << 33)
        data.createVariable("z", "f8", ("z",), chunksizes=(1 << 20,), zlib=True)
    with pytest.raises(core.ShockError, match=r"claims to hold 64\.0 GiB"):
        read_velocity("a.nc")


def write_archive(name, header, data, packing):
    with zipfile.ZipFile(name, "w", packing) as archive:
        for part in "uv":
            with archive.open(f"{part}.npy", "w") as stream:
                np.lib.format.write_array_header_1_0(stream, header)
                for piece in data:
                    stream.write(piece)


@pytest.mark.parametrize("is_filled", [False, True])
def test_an_archive_that_claims_more_than_it_can_hold_is_refused(is_filled):
    side = 5_000 if is_filled else 100_000
    header = {"descr": "<f4", "fortran_order": False, "shape": (side, side)}
    data = [bytes(4 * side * 1000)] * 5 if is_filled else [b""]
    write_archive("a.npz", header, data, zipfile.ZIP_BZIP2 if is_filled else zipfile.ZIP_LZMA)
    assert Path("a.npz").stat().st_size < 200_000
    with pytest.raises(core.ShockError, match=r"claims to hold .* GiB"):
        read_velocity("a.npz")
    assert lzma  # without it, numpy could not read this kind


@pytest.mark.parametrize("values", [
    np.full((3, 4, 2), "wind"), np.ones((3, 4, 2), complex), np.ones((3, 4, 2), bool),
    np.zeros((3, 4, 2), "M8[s]"),
])  # fmt: skip
@pytest.mark.parametrize("ending", ["npy", "npz"])
def test_velocities_are_real_numbers(values, ending):
    (np.save if ending == "npy" else np.savez)(f"a.{ending}", values)
    with pytest.raises(core.ShockError, match="save real numbers"):
        read_velocity(f"a.{ending}")


def test_objects_in_arrays_are_not_unpickled():
    trap = np.empty((3, 4, 2), object)
    trap[...] = Trap()
    np.save("a.npy", trap, allow_pickle=True)
    np.savez("b.npz", trap, allow_pickle=True)
    for name in ("a.npy", "b.npz"):
        with pytest.raises(core.ShockError):
            read_velocity(name)
    assert not Path("trapped").exists()


def test_names_that_say_another_kind_are_said():
    np.savez("a.npz", velocity=np.ones((3, 4, 2)))
    os.rename("a.npz", "a.npy")
    with pytest.raises(core.ShockError, match=r"rename it to \.npz"):
        read_velocity("a.npy")
    np.save("b.npy", np.ones((3, 4, 2)))
    os.rename("b.npy", "b.npz")
    with pytest.raises(core.ShockError, match=r"rename it to \.npy"):
        read_velocity("b.npz", How())


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
def test_infinity_is_refused_in_all_types(kind):
    velocity = np.ones((8, 8, 2), kind)
    velocity[2, 2] = np.inf
    with pytest.raises(core.InvalidSignal, match="infinity"):
        core.advect_noise(velocity)
    assert np.isfinite(next(iter(core.advect_noise(np.full((8, 8, 2), 60000.0, kind))))).all()
