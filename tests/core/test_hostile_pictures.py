# SPDX-License-Identifier: GPL-3.0-or-later
"""Damaged picture files are read or refused with a sentence, and what stood at the target stays."""

import io
import logging
import re
import struct
import zlib
from pathlib import Path

import imagecodecs
import numpy as np
import OpenEXR
import pytest
import tifffile
from on_files import sharpen_image_file
from PIL import Image
from shock_filter import core
from shock_filter.core.files import images

GRAY = np.random.default_rng(1).integers(0, 255, (20, 24), dtype=np.uint8)
COLORS = np.dstack([GRAY, GRAY[::-1], GRAY[:, ::-1]])
TIMES = 60


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def saved(name, image, **words):
    stream = io.BytesIO()
    image.save(stream, name, **words)
    return stream.getvalue()


def tiff(pixels, **words):
    stream = io.BytesIO()
    tifffile.imwrite(stream, pixels, **words)
    return stream.getvalue()


def exr(compression):
    header = {"compression": compression, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": COLORS / np.float32(255)}) as file:
        file.write("made.exr")
    return Path("made.exr").read_bytes()


def array(pixels):
    stream = io.BytesIO()
    np.save(stream, pixels)
    return stream.getvalue()


def files(ending):
    """Files of a format, of several kinds."""
    gray, colors = Image.fromarray(GRAY), Image.fromarray(COLORS)
    exif = Image.Exif()
    exif[274] = 6
    if ending == ".png":
        return [
            saved("PNG", colors, exif=exif),
            saved("PNG", gray, transparency=5),
            saved("PNG", colors.quantize(16)),
            imagecodecs.png_encode(COLORS.astype(np.uint16) * 257),
        ]
    if ending == ".jpg":
        return [saved("JPEG", colors, exif=exif, comment=b"hi"), saved("JPEG", gray, quality=5)]
    if ending == ".webp":
        return [saved("WEBP", colors, exif=exif), saved("WEBP", colors, lossless=True)]
    if ending == ".bmp":
        return [saved("BMP", colors), saved("BMP", colors.quantize(16)), saved("BMP", gray)]
    if ending == ".exr":
        return [exr(OpenEXR.NO_COMPRESSION), exr(OpenEXR.ZIP_COMPRESSION)]
    if ending == ".npy":
        return [array(GRAY), array(COLORS.astype(">u2")), array(np.asfortranarray(COLORS / 255))]
    palette = np.arange(768).reshape(3, 256).astype(np.uint16)
    return [
        tiff(GRAY, photometric="miniswhite", compression="lzw"),
        tiff(COLORS, photometric="rgb", compression="zlib", predictor=True, byteorder=">"),
        tiff(COLORS, photometric="rgb", tile=(16, 16), compression="jpeg"),
        tiff(COLORS, photometric="ycbcr"),
        tiff(GRAY, photometric="palette", colormap=palette, bigtiff=True),
        tiff(GRAY.astype(np.uint16), extratags=[(274, 3, 1, 6, True), (700, 1, 4, b"abcd", True)]),
        tiff(
            np.dstack([COLORS, GRAY]),
            photometric="rgb",
            extrasamples=["assocalpha"],
            rowsperstrip=7,
        ),
    ]


def damaged(data, ending, random):
    """Return a file that is cut, or with bits, bytes or tags that changed."""
    data = bytearray(data)
    how = random.integers(5)
    if how == 0:
        del data[random.integers(len(data)) :]
    elif how == 1:
        data[random.integers(min(len(data), 200))] = random.integers(256)
    elif how == 2 and ending == ".tif":
        change_tag(data, random)
    elif how == 2 and ending == ".png":
        change_chunk(data, random)
    else:
        for _ in range(random.integers(1, 6)):
            data[random.integers(len(data))] ^= 1 << random.integers(8)
    return bytes(data)


def change_tag(data, random):
    order = "<" if data[:2] == b"II" else ">"
    version, place = struct.unpack_from(f"{order}HI", data, 2)
    if version != 42:
        return
    (count,) = struct.unpack_from(f"{order}H", data, place)
    place += 2 + 12 * int(random.integers(count))
    kind, at = (("H", 0), ("H", 2), ("I", 4), ("I", 8))[random.integers(4)]
    number = int(random.choice([0, 1, 2, 3, 5, 6, 8, 16, 32, 274, 338, 50001]))
    struct.pack_into(order + kind, data, place + at, number)


def change_chunk(data, random):
    (length,) = struct.unpack_from(">I", data, 8)
    data[16 + random.integers(length)] = random.choice([0, 1, 2, 3, 4, 6, 8, 16])
    data[16 + length : 20 + length] = struct.pack(">I", zlib.crc32(data[12 : 16 + length]))


@pytest.mark.parametrize("ending", [".tif", ".png", ".jpg", ".webp", ".bmp", ".exr", ".npy"])
def test_damaged_pictures_are_read_or_refused(ending, monkeypatch, caplog):
    random = np.random.default_rng(7)
    made = files(ending)
    refused = 0
    for number in range(TIMES if ending != ".tif" else 2 * TIMES):
        Path(f"in{ending}").write_bytes(damaged(made[number % len(made)], ending, random))
        target = Path(f"out{ending}" if number % 3 else "out.npy")
        target.write_bytes(b"kept")
        monkeypatch.setattr(images, "BIG", 0 if number % 5 == 0 else 1 << 28)
        try:
            sharpen_image_file(f"in{ending}", target, core.ImageSettings(time=0.25), overwrite=True)
        except core.ShockError as error:
            refused += 1
            assert "could not be read back" not in str(error)
            assert target.read_bytes() == b"kept"
    assert refused
    ours = [each for each in caplog.records if each.name.startswith("shock_filter")]
    assert not [each for each in ours if each.levelno >= logging.WARNING]
    assert not list(Path().glob(".shock*"))


def test_tiff_with_fewer_parts_than_its_size_needs_is_refused():
    data = bytearray(tiff(GRAY, compression="lzw"))
    place = data.index(struct.pack("<HHII", 257, 4, 1, 20))
    struct.pack_into("<I", data, place + 8, 40000)
    Path("in.tif").write_bytes(data)
    with pytest.raises(core.ShockError, match="is damaged: of its 2000 parts it has 1"):
        sharpen_image_file("in.tif", "out.tif")


def test_tiff_that_does_not_say_what_is_white_is_refused():
    data = bytearray(tiff(GRAY))
    place = data.index(struct.pack("<HHI", 262, 3, 1))
    struct.pack_into("<H", data, place, 263)
    Path("in.tif").write_bytes(data)
    with pytest.raises(core.ShockError, match="does not say what its values mean"):
        sharpen_image_file("in.tif", "out.tif")


@pytest.mark.parametrize("name", ["group3", "group4", "tiff_ccitt"])
def test_compressions_of_fax_machines_are_read_or_refused_by_name(name):
    Image.fromarray(GRAY > 99).save("in.tif", compression=name)
    try:
        sharpen_image_file("in.tif", "out.png", core.ImageSettings(time=0.0))
    except core.ShockError as error:  # older imagecodecs
        assert re.search(r"a compression that is not read \(CCITT", str(error))
    else:
        np.testing.assert_array_equal(np.asarray(Image.open("out.png")) > 0, GRAY > 99)


def test_palettes_with_more_channels_are_refused_by_name():
    Image.fromarray(COLORS).quantize(16).convert("PA").save("in.tif")
    with pytest.raises(core.ShockError, match="has a palette and more channels"):
        sharpen_image_file("in.tif", "out.tif")


def test_deep_exr_is_refused_by_name():
    deep = np.empty(GRAY.shape, object)
    for place in np.ndindex(GRAY.shape):
        deep[place] = np.arange(3, dtype=np.float32)
    header = {"compression": OpenEXR.ZIPS_COMPRESSION, "type": OpenEXR.deepscanline}
    with OpenEXR.File(header, dict.fromkeys("RGB", deep)) as file:
        file.write("in.exr")
    with pytest.raises(core.ShockError, match="holds deep pixels; flatten it first"):
        sharpen_image_file("in.exr", "out.exr")


@pytest.mark.parametrize("name", ["DWAA", "DWAB", "B44", "B44A", "PXR24"])
def test_exr_of_lossy_compression_is_written_without_loss(name):
    pixels = np.repeat(np.linspace(0, 1, 48, dtype=np.float16)[None], 40, axis=0)
    pixels[:, 20:] += np.float16(1)
    header = {"compression": getattr(OpenEXR, f"{name}_COMPRESSION"), "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": np.dstack([pixels] * 3)}) as file:
        file.write("in.exr")
    outcome = sharpen_image_file("in.exr", "out.exr", core.ImageSettings(time=16))
    assert outcome.changed
    assert "its lossy compression became ZIP, so that all values stay" in outcome.notes
    with OpenEXR.File("out.exr") as file:
        assert file.header()["compression"] == OpenEXR.ZIP_COMPRESSION


def test_opacity_that_is_full_everywhere_is_left_out_of_webp():
    np.save("in.npy", np.dstack([COLORS, np.full_like(GRAY, 255)]))
    sharpen_image_file("in.npy", "out.webp", core.ImageSettings(time=0))
    np.testing.assert_array_equal(np.asarray(Image.open("out.webp").convert("RGB")), COLORS)


def test_one_channel_that_is_an_axis_stays_one():
    np.save("in.npy", GRAY[..., None])
    sharpen_image_file("in.npy", "out.npy", core.ImageSettings(time=0))
    np.testing.assert_array_equal(np.load("out.npy"), GRAY[..., None])


@pytest.mark.parametrize(("target", "side"), [("out.jpg", 65501), ("out.webp", 16384)])
def test_pictures_that_are_too_long_for_a_format_are_refused_before_all_work(target, side):
    np.save("in.npy", np.zeros((1, side, 3), np.uint8))
    with pytest.raises(core.ShockError, match=f"cannot hold {side} pixels side by side"):
        sharpen_image_file("in.npy", target, core.ImageSettings(time=0))
