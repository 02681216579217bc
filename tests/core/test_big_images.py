# SPDX-License-Identifier: GPL-3.0-or-later
"""Zarr arrays and tiled TIFF files that may be larger than memory, through the command line."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numcodecs
import numpy as np
import pytest
import tifffile
import zarr
from on_files import denoise_image_file, sharpen_image_file
from scipy.ndimage import gaussian_filter
from shock_filter import core
from shock_filter.core import cli
from shock_filter.core.files import big_images, images, reading

SIDE = 64
SETTINGS = core.ImageSettings(time=64.0)


@pytest.fixture(autouse=True)
def small_chunks(tmp_path, monkeypatch):
    """Filter small pictures as large ones are."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(big_images, "_SIDE", SIDE)
    monkeypatch.setattr(images, "BIG", 0)


def picture(channels=3, kind=np.uint8, size=(150, 200)):
    soft = gaussian_filter(np.random.default_rng(0).random((*size, channels)), (5, 5, 0))
    values = (soft - soft.min()) / (soft.max() - soft.min())
    values = values if channels > 1 else values[..., 0]
    return (np.iinfo(kind).max * values if np.dtype(kind).kind == "u" else values).astype(kind)


def save_zarr(name, pixels, chunks=(32, 50), version=3, **attributes):
    chunks = (*chunks, *pixels.shape[2:])
    array = zarr.open_array(name, mode="w", shape=pixels.shape, chunks=chunks, dtype=pixels.dtype,
                            zarr_format=version)  # fmt: skip
    array[:] = pixels
    array.attrs.update(attributes)


def save_tiff(name, pixels, **words):
    colors = "rgb" if pixels.ndim == 3 else "minisblack"
    tifffile.imwrite(name, pixels, tile=(48, 80), photometric=colors, **words)


def load(name):
    return zarr.open_array(name, mode="r")[:] if name.endswith("zarr") else tifffile.imread(name)


@pytest.mark.parametrize("version", [2, 3])
def test_zarr(version):
    image = picture()
    save_zarr("in.zarr", image, version=version, unit="nm")
    outcome = sharpen_image_file("in.zarr", "out.zarr", SETTINGS)
    found = zarr.open_array("out.zarr", mode="r")
    expected = core.sharpen_image(image, SETTINGS)
    np.testing.assert_array_equal(found[:], expected)
    assert (found.chunks, found.metadata.zarr_format) == ((32, 50, 3), version)
    assert dict(found.attrs) == {"unit": "nm"}
    assert outcome.changed == (image != expected).any(axis=2).sum()
    assert outcome.notes[-1].endswith("than expected: 0")


@pytest.mark.parametrize("kind", [np.uint16, np.float16, np.float32])
@pytest.mark.parametrize("channels", [1, 4])
def test_types_and_channels(kind, channels):
    image = picture(channels, kind)
    save_zarr("in.zarr", image)
    sharpen_image_file("in.zarr", "out.zarr", SETTINGS)
    given = image.astype(np.float32) if kind == np.float16 else image
    np.testing.assert_array_equal(
        load("out.zarr"), core.sharpen_image(given, SETTINGS).astype(kind)
    )


@pytest.mark.parametrize(("order", "packing"), [(">", None), ("<", "zlib")])
def test_tiled_tiff(order, packing):
    image = picture(kind=np.uint16)
    save_tiff("in.tif", image, byteorder=order, compression=packing, resolution=(300, 300),
              resolutionunit="INCH", software="a scanner")  # fmt: skip
    sharpen_image_file("in.tif", "out.tif", SETTINGS)
    np.testing.assert_array_equal(load("out.tif"), core.sharpen_image(image, SETTINGS))
    with tifffile.TiffFile("out.tif") as file:
        page = file.pages[0]
        assert file.is_bigtiff
        assert page.is_tiled
        assert bool(packing) == (page.compression != 1)
        assert page.resolution == (300, 300)
        assert page.tags["Software"].value == "a scanner"


def test_from_one_format_to_the_other():
    image = picture(1)
    save_tiff("in.tif", image)
    sharpen_image_file("in.tif", "between.zarr", core.ImageSettings(time=0))
    sharpen_image_file("between.zarr", "out.tif", core.ImageSettings(time=0))
    np.testing.assert_array_equal(load("out.tif"), image)
    save_zarr("one.zarr", image[..., None])  # one channel along an axis of its own
    sharpen_image_file("one.zarr", "one.tif", core.ImageSettings(time=0))
    np.testing.assert_array_equal(load("one.tif"), image)
    tifffile.imwrite("strips.tif", image)
    outcome = sharpen_image_file("strips.tif", "strips.zarr", core.ImageSettings(time=0))
    np.testing.assert_array_equal(load("strips.zarr"), image)
    assert outcome.changed == 0


def test_zarr_keeps_how_it_is_stored():
    words = {
        "compressors": zarr.codecs.GzipCodec(level=3),
        "fill_value": 7,
        "chunks": (16, 16),
        "shards": (64, 64),
        "dimension_names": ("y", "x"),
        "attributes": {"unit": "nm"},
    }
    image = picture(1)
    group = zarr.open_group("in.zarr", mode="w", attributes={"crs": "EPSG:4326"})
    before = group.create_array("band", shape=image.shape, dtype=image.dtype, **words)
    before[:] = image
    for name, count in zip("yx", image.shape, strict=True):
        group.create_array(name, shape=(count,), dtype="f8", dimension_names=(name,))[:] = 0.5
    sharpen_image_file("in.zarr", "out.zarr", SETTINGS)
    found = zarr.open_group("out.zarr", mode="r")
    assert found.attrs.asdict() == {"crs": "EPSG:4326"}
    assert found["band"].metadata == before.metadata
    assert sorted(name for name, _ in found.arrays()) == ["band", "x", "y"]
    assert (found["x"][:] == 0.5).all()
    np.testing.assert_array_equal(found["band"][:], core.sharpen_image(image, SETTINGS))


@pytest.mark.filterwarnings("ignore")  # zarr's own
@pytest.mark.parametrize("version", [2, 3])
def test_enlarged_zarr_keeps_all_but_coordinates(version, capsys):
    image = picture(1)
    group = zarr.open_group("in.zarr", mode="w", zarr_format=version, attributes={"crs": "x"})
    band = group.create_array("band", shape=image.shape, chunks=(32, 32), dtype=">u2", fill_value=9)
    band[:] = image
    group.create_array("x", shape=(image.shape[1],), dtype="f8")[:] = 0.5
    zarr.consolidate_metadata("in.zarr")
    assert cli.main(["sharpen-image", "in.zarr", "out.zarr", "--enlarge", "2", "--time", "1"]) == 0
    assert "x did not fit the new size: left behind" in capsys.readouterr().out
    for consolidated in (True, False):
        found = zarr.open_group("out.zarr", mode="r", use_consolidated=consolidated)
        assert [name for name, _ in found.arrays()] == ["band"]
        assert found["band"].shape == (300, 400)
        assert (found["band"].fill_value, found["band"].chunks) == (9, (32, 32))
        assert found.attrs["crs"] == "x"


def test_codecs_that_cannot_be_written_are_said_at_once(capsys):
    image = picture(1)
    words = {"zarr_format": 2, "compressors": numcodecs.Blosc()}
    array = zarr.create_array("in.zarr", shape=image.shape, dtype=image.dtype, **words)
    array[:] = image
    about = json.loads(Path("in.zarr/.zarray").read_text())
    about["compressor"]["cname"] = "none"
    Path("in.zarr/.zarray").write_text(json.dumps(about))
    assert cli.main(["sharpen-image", "in.zarr", "out.zarr"]) == 1
    said = capsys.readouterr().err
    assert "in.zarr cannot be read; is it damaged? (bad compressor" in said
    assert "Traceback" not in said
    assert not Path("out.zarr").exists()


def test_flat_pictures_are_written_however_small_they_pack(monkeypatch):
    monkeypatch.setattr(reading, "_FREE", 1000)
    monkeypatch.setattr(reading, "_RATIO", 2)
    flat = np.zeros((150, 200), np.uint8)
    save_tiff("in.tif", flat)
    sharpen_image_file("in.tif", "out.tif", core.ImageSettings(time=1))
    np.testing.assert_array_equal(load("out.tif"), flat)


def test_mask_guide_and_enlarging(capsys):
    image, mask = picture(), picture(1)
    save_zarr("in.zarr", image)
    save_tiff("mask.tif", mask)
    save_zarr("guide.zarr", 255 - image)
    words = ["sharpen-image", "in.zarr", "out.zarr", "--mask", "mask.tif", "--invert-mask"]
    words += ["--guide", "guide.zarr", "--enlarge", "2", "--time", "64"]
    assert cli.main(words) == cli.DONE, capsys.readouterr().err
    settings = core.ImageSettings(time=64.0, enlarge=2)
    expected = core.sharpen_image(image, settings, mask=1.0 - mask / 255.0, guide=255 - image)
    np.testing.assert_array_equal(load("out.zarr"), expected)


def test_denoise_then_sharpen():
    image = picture()
    save_zarr("in.zarr", image)
    settings = core.BeltramiSettings()
    denoise_image_file("in.zarr", "out.zarr", settings, sharpen_time=16.0)
    both = core.registry.find("beltrami_image").function(16.0)
    np.testing.assert_array_equal(load("out.zarr"), both(image, settings=settings))


def test_chunks_that_run_again_are_told(monkeypatch, capsys):
    from shock_filter.core.color import chunked

    monkeypatch.setattr(chunked, "_LONG_WALK", 1)
    monkeypatch.setattr(chunked, "_WALK", 1)
    save_zarr("in.zarr", picture())
    assert cli.main(["sharpen-image", "in.zarr", "out.zarr", "--time", "inf"]) == cli.DONE
    told = capsys.readouterr().out
    assert "filtered in 8 chunks" in told
    assert int(told.rpartition(":")[2]) > 0


def test_outputs_are_replaced_only_if_asked(capsys):
    save_zarr("in.zarr", picture())
    save_zarr("out.zarr", picture(1))
    command = ["sharpen-image", "in.zarr", "out.zarr", "--time", "0"]
    assert cli.main(command) == cli.FAILED
    assert "exists already" in capsys.readouterr().err
    assert load("out.zarr").ndim == 2
    assert cli.main([*command, "--overwrite"]) == cli.DONE
    np.testing.assert_array_equal(load("out.zarr"), picture())
    assert cli.main(["sharpen-image", "in.zarr/", "in.zarr", "--time", "64", "--overwrite"]) == 0
    np.testing.assert_array_equal(load("in.zarr"), core.sharpen_image(picture(), SETTINGS))


def test_bad_input_is_named_and_leaves_nothing(tmp_path, capsys):
    spoiled = picture(kind=np.float32)
    spoiled[120, 130, 1] = np.nan
    save_zarr("nan.zarr", spoiled)
    save_zarr("deep.zarr", np.zeros((4, 4, 2, 2), np.uint8))
    save_zarr("type.zarr", np.zeros((4, 4), np.int64))
    save_zarr("good.zarr", picture())
    save_zarr("small.zarr", picture(1)[:50])
    save_zarr("half.zarr", picture(kind=np.float16))
    zarr.open_group("group.zarr", mode="w")
    damaged = tmp_path / "damaged.zarr"
    save_zarr("damaged.zarr", picture())
    next(path for path in (damaged / "c").rglob("*") if path.is_file()).write_bytes(b"no")
    (tmp_path / "plain.zarr").mkdir()
    (tmp_path / "plain.zarr" / "letter.txt").write_text("keep me")
    before = sorted(os.listdir())
    for words, reason in {
        "nan.zarr out.zarr": "NaN or infinity",
        "nan.zarr out.tif": "NaN or infinity",
        "deep.zarr out.zarr": "shape (4, 4, 2, 2)",
        "type.zarr out.zarr": "int64",
        "group.zarr out.zarr": "group of 0 arrays",
        "damaged.zarr out.zarr": "is it damaged?",
        "plain.zarr out.zarr": "no Zarr array",
        "none.zarr out.zarr": "There is no file",
        "good.zarr out.png": "use one of .zarr, .tif, .tiff",
        "half.zarr out.tif": ".tif cannot hold 3 channels of float16",
        "good.zarr plain.zarr --overwrite": "folder of other files",
        "good.zarr out.zarr --mask small.zarr": "The mask has the shape (50, 200)",
        "good.zarr out.zarr --mask good.zarr": "gray image",
    }.items():
        assert cli.main(["sharpen-image", *words.split(), "--time", "4"]) == cli.FAILED
        assert reason in capsys.readouterr().err, words
        assert sorted(os.listdir()) == before, words
    assert os.listdir("plain.zarr") == ["letter.txt"]


@pytest.mark.parametrize("package", ["dask.array", "zarr"])
def test_missing_packages_are_named(package, monkeypatch):
    save_zarr("in.zarr", picture())
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(core.ShockError, match=rf"needs {package}; run: .*shock-filter\[cluster\]"):
        sharpen_image_file("in.zarr", "out.zarr", SETTINGS)


def test_cancelling_leaves_nothing():
    save_zarr("in.zarr", picture())
    asked = []

    def progress(fraction, message):
        asked.append(fraction)
        return fraction < 0.3

    with pytest.raises(core.Cancelled):
        sharpen_image_file("in.zarr", "out.zarr", SETTINGS, progress=progress)
    assert asked == sorted(asked)
    assert len(asked) > 5
    assert os.listdir() == ["in.zarr"]


def test_on_a_cluster():
    from distributed import Client

    image = picture()
    spoiled = image.astype(np.float32)
    spoiled[120, 130, 1] = np.nan
    save_zarr("in.zarr", image)
    save_zarr("nan.zarr", spoiled)
    with Client(processes=False, n_workers=1, threads_per_worker=2, dashboard_address=":0"):
        sharpen_image_file("in.zarr", "out.zarr", SETTINGS)
        np.testing.assert_array_equal(load("out.zarr"), core.sharpen_image(image, SETTINGS))
        with pytest.raises(core.InvalidSignal, match="NaN or infinity"):
            sharpen_image_file("nan.zarr", "none.zarr", SETTINGS)
        with pytest.raises(core.Cancelled):
            sharpen_image_file("in.zarr", "none.zarr", SETTINGS, progress=lambda *_: False)
    assert sorted(os.listdir()) == ["in.zarr", "nan.zarr", "out.zarr"]


RUN = """
import resource, sys
from functools import partial
import dask
from shock_filter import core
from shock_filter.core.files import big_images, images
big_images._SIDE = 512
images.BIG = 0
run = lambda name: images.filter_image_file(
    partial(core.sharpen_image, settings=core.ImageSettings(time=1.0)), name + ".tif",
    name + ".zarr")
peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
with dask.config.set(num_workers=2):
    run("small")
    before = peak()
    run("large")
print(peak() - before)
"""


def test_memory_is_that_of_some_chunks():
    tile = picture(3, np.uint8, (256, 256))
    for name, times in (("small", 4), ("large", 12)):  # 3 MiB, and 27 MiB
        shape = (256 * times, 256 * times, 3)
        tiles = (tile for _ in range(times * times))
        tifffile.imwrite(f"{name}.tif", tiles, shape=shape, dtype="u1", tile=(256, 256),
                         photometric="rgb")  # fmt: skip
    done = subprocess.run([sys.executable, "-c", RUN], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 64  # MiB; in memory 54 for both pictures, and 72 for the flow
