# SPDX-License-Identifier: GPL-3.0-or-later
"""Ways in which HDF5 finds other files, NetCDF-4 among them: none leads out of the folder."""

import h5py
import numpy as np
import pytest
from shock_filter.core.errors import ShockError
from shock_filter.core.files.velocities import read_velocity

SIDE = 4
SECRET = np.full((SIDE, SIDE), 42.0, np.float32)


@pytest.fixture
def places(tmp_path):
    """Make a folder with files of the reader, and one for what a stranger has sent."""
    own, sent = tmp_path / "own", tmp_path / "sent"
    own.mkdir()
    sent.mkdir()
    (own / "raw.bin").write_bytes(SECRET.tobytes())
    keep(own / "data-0.h5")
    return own, sent


def keep(path, **words):
    with h5py.File(path, "w") as file:
        file.create_dataset("d", data=SECRET, **words)


def velocity(path, make):
    with h5py.File(path, "w") as file:
        for name in "uv":
            make(file, name)
    return path


def link(target):
    return lambda file, name: file.__setitem__(name, h5py.ExternalLink(str(target), "d"))


def raw(target):
    return lambda file, name: file.create_dataset(
        name, SECRET.shape, "f4", external=[(str(target), 0, SECRET.nbytes)]
    )


def virtual(target):
    def make(file, name):
        layout = h5py.VirtualLayout(SECRET.shape, "f4")
        layout[:] = h5py.VirtualSource(str(target), "d", SECRET.shape)
        file.create_virtual_dataset(name, layout)

    return make


def numbered(target):
    """Make a virtual dataset whose sources the library finds by putting numbers into a name."""

    def make(file, name):
        words = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        space = h5py.h5s.create_simple((SIDE, SIDE), (h5py.h5s.UNLIMITED, SIDE))
        space.select_hyperslab((0, 0), (h5py.h5s.UNLIMITED, 1), (SIDE, SIDE), (SIDE, SIDE))
        source = h5py.h5s.create_simple(SECRET.shape)
        words.set_virtual(space, str(target).encode(), b"d", source)
        h5py.h5d.create(file.id, name.encode(), h5py.h5t.IEEE_F32LE, space, words)

    return make


KINDS = {"link": (link, "data-0.h5"), "raw": (raw, "raw.bin"), "virtual": (virtual, "data-0.h5"),
         "numbered": (numbered, "data-%b.h5")}  # fmt: skip


@pytest.mark.parametrize(("kind", "name"), KINDS.values(), ids=KINDS)
@pytest.mark.parametrize("way", ["absolute", "up", "from here", "by a link"])
def test_nothing_is_read_from_elsewhere(places, monkeypatch, kind, name, way):
    own, sent = places
    target = {"absolute": own / name, "up": f"../own/{name}", "from here": name}.get(way, name)
    if way == "from here":
        monkeypatch.chdir(own)
    if way == "by a link":
        (sent / name.replace("%b", "0")).symlink_to(own / name.replace("%b", "0"))
    path = velocity(sent / "a.nc", kind(target))
    with pytest.raises(ShockError, match=r"takes data from .*, which is not in its folder"):
        read_velocity(path)


def test_nothing_is_read_in_two_steps(places):
    own, sent = places
    velocity(sent / "b.h5", lambda file, name: file.__setitem__(
        name, h5py.ExternalLink(str(own / "data-0.h5"), "d")))  # fmt: skip
    # The library drops the folder of a name that is not there.
    for target in ("b.h5", "/nowhere/b.h5"):
        path = velocity(
            sent / "a.nc",
            lambda file, name, to=target: file.__setitem__(name, h5py.ExternalLink(to, name)),
        )
        with pytest.raises(ShockError, match="which is not in its folder"):
            read_velocity(path)


def test_a_link_in_a_group_that_is_not_read_is_found_too(places):
    own, sent = places
    path = velocity(sent / "a.nc", lambda file, name: file.create_dataset(name, data=SECRET))
    with h5py.File(path, "a") as file:
        file["deep/er/x"] = h5py.ExternalLink(str(own / "data-0.h5"), "d")
        file["deep/loop"] = file["deep"]
    with pytest.raises(ShockError, match="which is not in its folder"):
        read_velocity(path)


def test_files_of_the_same_folder_may_be_named(places):
    own, _ = places
    for kind, target in ((raw, own / "raw.bin"), (virtual, "data-0.h5"), (link, "data-0.h5")):
        assert (read_velocity(velocity(own / "a.nc", kind(target))).velocity == 42).all()


def test_what_is_packed_several_times_is_refused(places):
    _, sent = places

    def make(file, name):
        words = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        words.set_chunk(SECRET.shape)
        words.set_deflate(9)
        words.set_deflate(9)
        space = h5py.h5s.create_simple(SECRET.shape)
        h5py.h5d.create(file.id, name.encode(), h5py.h5t.IEEE_F32LE, space, words)

    with pytest.raises(ShockError, match="is packed several times over"):
        read_velocity(velocity(sent / "a.nc", make))


def test_claims_are_compared_before_memory_is_taken(places):
    _, sent = places
    words = {"dtype": "f4", "chunks": (100, 100), "compression": "gzip"}
    path = velocity(sent / "a.nc", lambda file, name: file.create_dataset(
        name, (60_000, 60_000), **words))  # fmt: skip
    with pytest.raises(ShockError, match=r"claims to hold 26\.8 GiB .* add --any-size"):
        read_velocity(path)


def test_coordinates_are_compared_before_they_are_read(places):
    _, sent = places

    def make(file, name):
        file.create_dataset(name, data=SECRET)
        if name == "v":
            axis = file.create_dataset("x", (4_000_000_000,), "f8", chunks=(1000,))
            axis.make_scale("x")

    path = velocity(sent / "a.nc", make)
    with pytest.raises(ShockError, match=r"claims to hold 29\.8 GiB"):
        read_velocity(path)


def test_addresses_on_the_network_are_names_of_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("http://127.0.0.1:9/a.nc", "http://127.0.0.1:9/a.zarr", "s3://a/b.zarr"):
        with pytest.raises(ShockError, match="There is no file"):
            read_velocity(name)
