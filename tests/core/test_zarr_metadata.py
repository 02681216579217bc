# SPDX-License-Identifier: GPL-3.0-or-later
"""Ways around the list of codecs of Zarr, and around the limit of what folders may claim."""

import json
import os
import shutil
from pathlib import Path

import numcodecs
import numpy as np
import pytest
import zarr
from shock_filter.core.errors import ShockError
from shock_filter.core.files.formats.array.zarr import open_zarr
from shock_filter.core.files.velocities import read_velocity

SIDE = 4
PICKLE = [{"id": "pickle"}]


def format_2(**words):
    array = {"zarr_format": 2, "shape": [SIDE, SIDE], "chunks": [SIDE, SIDE], "dtype": "<f4",
             "compressor": None, "fill_value": 0, "order": "C", "filters": None}  # fmt: skip
    return {**array, **words}


def format_3(codecs=("bytes",), kind="float32", **words):
    grid = {"name": "regular", "configuration": {"chunk_shape": [SIDE, SIDE]}}
    array = {"zarr_format": 3, "node_type": "array", "shape": [SIDE, SIDE], "data_type": kind,
             "chunk_grid": grid, "chunk_key_encoding": {"name": "default"}, "fill_value": 0,
             "codecs": list(codecs), "attributes": {}}  # fmt: skip
    return {**array, **words}


def group_3(members):
    inline = {"kind": "inline", "must_understand": False, "metadata": members}
    return {"zarr_format": 3, "node_type": "group", "consolidated_metadata": inline}


def sharded(*codecs, index=("bytes",)):
    words = {"chunk_shape": [2, 2], "codecs": list(codecs), "index_codecs": list(index)}
    return {"name": "sharding_indexed", "configuration": words}


def named(name, **words):
    return {"name": name, "configuration": words}


def folder(path, **files):
    """Write metadata, and beside them two velocities that are sound."""
    path.mkdir()
    for name, document in files.items():
        place = path / name
        place.parent.mkdir(exist_ok=True)
        place.write_text(json.dumps(document))
    return path


def sound(path, kind="<f4", **words):
    words = {"shape": (SIDE, SIDE), "chunks": (SIDE, SIDE), "dtype": kind, **words}
    group = zarr.open_group(path, mode="w", zarr_format=2)
    for name in "uv":
        group.create_array(name, **words).attrs["_ARRAY_DIMENSIONS"] = ["y", "x"]
    return Path(path)


def refused_by_all(path, words):
    """Ask both ways that lead to a Zarr folder."""
    for read in (open_zarr, read_velocity):
        with pytest.raises(ShockError, match=words):
            read(path)


FORBIDDEN = {
    "filter": {".zarray": format_2(filters=PICKLE)},
    "compressor": {".zarray": format_2(compressor=PICKLE[0])},
    "of a coordinate": {".zgroup": {"zarr_format": 2}, "x/.zarray": format_2(filters=PICKLE)},
    "far below": {".zgroup": {"zarr_format": 2}, "a/.zarray": format_2(),
                  "a/b/.zarray": format_2(filters=PICKLE)},
    "consolidated": {".zgroup": {"zarr_format": 2}, "u/.zarray": format_2(),
                     ".zmetadata": {"metadata": {"u/.zarray": format_2(filters=PICKLE)}}},
    "array as a group": {".zgroup": {"zarr_format": 2},
                         ".zmetadata": {"metadata": {"u/.zgroup": format_2(filters=PICKLE)}}},
    "in a group's file": {".zgroup": {"zarr_format": 2, **{
        "consolidated_metadata": group_3({"u": format_2(filters=PICKLE)})["consolidated_metadata"]
    }}},
    "format 2 in 3": {"zarr.json": group_3({"u": format_2(filters=PICKLE)})},
    "format 2 in 3's file": {"zarr.json": format_2(filters=PICKLE, node_type="array")},
    "format 3 in 2's file": {".zarray": format_3([named("numcodecs.pickle")])},
    "group in a group": {"zarr.json": group_3({"a": group_3({"u": format_2(filters=PICKLE)})})},
    "format 3": {"zarr.json": format_3([named("numcodecs.pickle")])},
    "format 3, by its name": {"zarr.json": format_3(["pickle"])},
    "in shards": {"zarr.json": format_3([sharded("bytes", named("numcodecs.pickle"))])},
    "in an index": {"zarr.json": format_3([sharded("bytes", index=["bytes", "pickle"])])},
}  # fmt: skip


@pytest.mark.parametrize("files", FORBIDDEN.values(), ids=FORBIDDEN)
def test_pickle_is_refused_wherever_it_stands(tmp_path, files):
    path = folder(tmp_path / "a.zarr", **files)
    refused_by_all(path, "codec 'pickle' is not read, since it can run code")


def test_nothing_is_run(tmp_path):
    pickled = b"cposix\nsystem\n(S'touch %s'\ntR." % os.fsencode(tmp_path / "ran")
    path = sound(tmp_path / "a.zarr")
    for name in "uv":
        about = format_2(dtype="|O", filters=[{"id": "vlen-utf8"}, *PICKLE])
        (path / name / ".zarray").write_text(json.dumps(about))
        (path / name / "0.0").write_bytes(pickled)
    refused_by_all(path, "since it can run code")
    assert not (tmp_path / "ran").exists()


OTHERS = {
    "objects": ({".zarray": format_2(dtype="|O")}, "type '|O' is not read, since it can run code"),
    "objects inside": ({".zarray": format_2(filters=[{"id": "delta", "dtype": "|O"}])},
                       "type '|O'"),
    "unknown type": ({"zarr.json": format_3(kind="evil")}, "type 'evil' is not read"),
    "unknown codec": ({".zarray": format_2(compressor={"id": "evil"})}, "codec 'evil' is not read"),
    "no name": ({".zarray": format_2(compressor={"id": ["zlib"]})}, "is not read"),
    "transformer": ({"zarr.json": format_3(storage_transformers=[{"name": "evil"}])}, "evil"),
    "grid": ({"zarr.json": format_3(chunk_grid={"name": "evil"})}, "chunk grid 'evil'"),
    "outside": ({".zgroup": {}, ".zmetadata": {"metadata": {"../u/.zarray": format_2()}}},
                "which is not in the folder"),
    "outside, absolute": ({"zarr.json": group_3({"/u": format_3()})}, "which is not in the folder"),
    "no chunks": ({".zarray": format_2(chunks=[0, 0])}, "no chunks of whole numbers from 1"),
    "other axes": ({".zarray": format_2(shape=[4])}, "other axes"),
    "unknown format": ({".zarray": format_2(zarr_format=4)}, "a format other than 2 and 3"),
    "a list": ({".zarray": [1]}, "is no JSON object"),
    "packed twice": ({".zarray": format_2(compressor={"id": "zlib"}, filters=[{"id": "bz2"}])},
                     "packed 2 times over"),
    "packed in shards": ({"zarr.json": format_3([sharded("bytes", "gzip"), "zstd"])},
                         "packed 2 times over"),
    "one chunk": ({".zarray": format_2(shape=[200_000] * 2, chunks=[200_000] * 2)},
                  "149.0 GiB in .* bytes; .* add --any-size"),
    "a large chunk": ({".zarray": format_2(chunks=[200_000] * 2)}, "claims to hold 149.0 GiB"),
    "no chunks stored": ({".zgroup": {"zarr_format": 2}, "x/.zarray": format_2(
        shape=[10**10], chunks=[100])}, "claims to hold 37.3 GiB"),
    "consolidated claim": ({"zarr.json": group_3({"u": format_3(shape=[10**6] * 2)})},
                           "claims to hold"),
}  # fmt: skip


@pytest.mark.parametrize(("files", "words"), OTHERS.values(), ids=OTHERS)
def test_what_else_is_refused(tmp_path, files, words):
    refused_by_all(folder(tmp_path / "a.zarr", **files), words.replace("|", r"\|"))


@pytest.mark.parametrize("name", [".ZARRAY", "Zarr.json"])
def test_capitals_do_not_hide_metadata(tmp_path, name):
    path = sound(tmp_path / "a.zarr")
    about = format_2(filters=PICKLE)
    (path / "u" / name).write_text(json.dumps(about))
    refused_by_all(path, "pickle")


def test_deep_metadata_are_refused_in_a_sentence(tmp_path, caplog):
    path = folder(tmp_path / "a.zarr")
    inner = '{"a":{"zarr_format":3,"node_type":"group","consolidated_metadata":{"metadata":'
    for deep in (300, 100_000):
        text = inner * deep + "{}" + "}}}" * deep
        (path / "zarr.json").write_text(f'{{"consolidated_metadata":{{"metadata":{text}}}}}')
        for read in (open_zarr, read_velocity):
            with pytest.raises(ShockError):
                read(path)
    assert not caplog.records


def test_links_may_not_lead_out(tmp_path):
    outside = sound(tmp_path / "other.zarr")
    path = sound(tmp_path / "a.zarr")
    shutil.rmtree(path / "u")
    (path / "u").symlink_to(outside / "u", target_is_directory=True)
    refused_by_all(path, "u is a link out of the folder")
    (path / "u").unlink()
    (path / "u").symlink_to("v", target_is_directory=True)
    assert read_velocity(path).velocity.shape == (SIDE, SIDE, 2)


def test_a_pipe_is_not_waited_for(tmp_path):
    path = sound(tmp_path / "a.zarr")
    os.mkfifo(path / "u" / "0.0")
    refused_by_all(path, "is neither a file nor a folder")


def test_folders_that_cannot_be_listed_are_not_passed_over(tmp_path, monkeypatch):
    path = sound(tmp_path / "a.zarr")
    listed = os.scandir

    def scandir(place):
        if Path(place).name == "u":
            raise PermissionError(13, "Permission denied", str(place))
        return listed(place)

    monkeypatch.setattr(os, "scandir", scandir)
    for read in (open_zarr, read_velocity):
        with pytest.raises(PermissionError):
            read(path)


def test_claims_are_compared_with_the_velocity_that_is_made(tmp_path):
    path = sound(tmp_path / "a.zarr", "i1", shape=(10_000, 10_000), chunks=(1000, 1000))
    with pytest.raises(ShockError, match=r"claims to hold 0\.7 GiB"):
        read_velocity(path)


KINDS = {
    "2, none": {"zarr_format": 2, "compressors": None},
    "2, usual": {"zarr_format": 2},
    "2, filters": {"zarr_format": 2, "filters": [numcodecs.Delta("<f4")]},
    "3, usual": {"zarr_format": 3},
    "3, blosc": {"zarr_format": 3, "compressors": zarr.codecs.BloscCodec()},
    "3, gzip in shards": {"zarr_format": 3, "compressors": zarr.codecs.GzipCodec(),
                          "shards": (SIDE, SIDE), "chunks": (2, 2)},
    "3, turned": {"zarr_format": 3, "filters": [zarr.codecs.TransposeCodec(order=(1, 0))]},
}  # fmt: skip


@pytest.mark.filterwarnings("ignore")  # zarr's own
@pytest.mark.parametrize("words", KINDS.values(), ids=KINDS)
def test_usual_codecs_are_read(tmp_path, words):
    values = np.random.default_rng(0).random((SIDE, SIDE), np.float32)
    words = {"shape": (SIDE, SIDE), "chunks": (SIDE, SIDE), "dtype": "<f4", **words}
    zarr.create_array(tmp_path / "a.zarr", **words)[:] = values
    assert np.array_equal(open_zarr(tmp_path / "a.zarr").pixels[:], values)
