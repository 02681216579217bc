# SPDX-License-Identifier: GPL-3.0-or-later
"""TIFF files of odd depths and other colors come out as bright as they went in, or are refused."""

import struct
from pathlib import Path

import numpy as np
import pytest
import tifffile
from on_files import sharpen_image_file
from PIL import Image
from shock_filter import core
from shock_filter.core.files import images
from shock_filter.core.files.formats.image import tiff

STILL = core.ImageSettings(time=0)
STRONG = core.ImageSettings(time=64)
COLORS = np.array([(255, 255, 255), (200, 40, 90), (10, 200, 60), (0, 0, 0)], np.uint8)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def slope(channels=1):
    """Values from 0 to 1, both reached."""
    rows, columns = np.mgrid[:16, :20]
    soft = 0.5 + 0.5 * np.tanh((columns - 10 + np.sin(rows / 3)) / 3)
    soft = (soft - soft.min()) / np.ptp(soft)
    return soft if channels == 1 else np.stack([soft, soft**2, 1 - soft], axis=-1)


def packed(values, bits):
    """Pack whole numbers into rows of whole bytes."""
    as_bits = (values[..., None] >> np.arange(bits - 1, -1, -1)) & 1
    return np.packbits(as_bits.reshape(len(values), -1).astype(np.uint8), axis=1)


def write_tiff(name, pixels, tags):
    """Write one strip with the given tags by hand; `tags` maps codes to (type, values)."""
    height, width = tags.pop("size")
    data = pixels.tobytes()
    entries = {256: (3, [width]), 257: (3, [height]), 259: (3, [1]), 273: (4, [8]),
               278: (3, [height]), 279: (4, [len(data)]), **tags}  # fmt: skip
    start = 8 + len(data) + len(data) % 2
    beyond = start + 2 + 12 * len(entries) + 4
    table, more = struct.pack("<H", len(entries)), b""
    for code, (kind, values) in sorted(entries.items()):
        value = struct.pack(f"<{len(values)}{'H' if kind == 3 else 'I'}", *values)
        if len(value) > 4:
            place, more = beyond + len(more), more + value
            value = struct.pack("<I", place)
        count = len(values) // 2 if kind == 5 else len(values)  # rationals are pairs
        table += struct.pack("<HHI", code, kind, count) + value.ljust(4, b"\0")
    with open(name, "wb") as file:
        file.write(struct.pack("<2sHI", b"II", 42, start) + data.ljust(start - 8, b"\0"))
        file.write(table + bytes(4) + more)


@pytest.mark.parametrize("bits", [2, 3, 4, 5, 6, 7, 9, 10, 12, 14, 15])
@pytest.mark.parametrize("channels", [1, 3])
def test_odd_depths_are_scaled_by_their_white(bits, channels):
    white = 2**bits - 1
    values = np.rint(white * slope(channels)).astype(np.uint16)
    write_tiff("in.tif", packed(values, bits), {
        "size": (16, 20), 258: (3, [bits] * channels), 262: (3, [1 if channels == 1 else 2]),
        277: (3, [channels]),
    })  # fmt: skip
    for settings in (STILL, STRONG):
        outcome = sharpen_image_file("in.tif", f"{settings.time}.tiff", settings)
        assert f"values of {bits} bits became {8 if bits < 8 else 16}-bit" in outcome.notes
    still, strong = (tifffile.imread(f"{each.time}.tiff") for each in (STILL, STRONG))
    top = np.iinfo(still.dtype).max
    np.testing.assert_array_equal(np.rint(still / top * white), values)
    assert (still.min(), still.max()) == (0, top)
    assert abs(strong.mean() / top - values.mean() / white) < 0.02


@pytest.mark.parametrize("bits", [17, 20, 24, 31])
def test_depths_beyond_16_bits_are_refused(bits):
    values = np.rint((2**bits - 1) * slope()).astype(np.int64)
    write_tiff("in.tif", packed(values, bits), {
        "size": (16, 20), 258: (3, [bits]), 262: (3, [1]), 277: (3, [1]),
    })  # fmt: skip
    with pytest.raises(core.ShockError, match=f"has values of {bits} bits; save it with 8 or 16"):
        sharpen_image_file("in.tif", "out.tiff", STILL)
    assert not Path("out.tiff").exists()


def test_odd_depths_of_tiles(monkeypatch):
    values = np.rint(4095 * slope()[:, :16]).astype(np.uint16)
    data = packed(values, 12)
    write_tiff("in.tif", data, {
        "size": (16, 16), 258: (3, [12]), 262: (3, [1]), 277: (3, [1]), 322: (3, [16]),
        323: (3, [16]), 324: (4, [8]), 325: (4, [data.size]),
    })  # fmt: skip
    monkeypatch.setattr(images, "BIG", 0)
    sharpen_image_file("in.tif", "out.tiff", STILL)
    np.testing.assert_array_equal(np.rint(tifffile.imread("out.tiff") / 65535 * 4095), values)


@pytest.mark.parametrize("white", ["minisblack", "miniswhite"])
def test_black_and_white_is_seen_as_before(white):
    tifffile.imwrite("in.tif", slope() > 0.7, photometric=white)
    outcome = sharpen_image_file("in.tif", "out.tiff", STRONG)
    assert "values of 1 bits became 8-bit" in outcome.notes
    seen, given = (np.asarray(Image.open(name).convert("L")) for name in ("out.tiff", "in.tif"))
    assert seen.mean() == pytest.approx(given.mean(), abs=10)


def blocks(across, down):
    """Flat fields of colors, and the same in luminance and chroma."""
    rgb = COLORS.reshape(2, 2, 3).repeat(8, axis=0).repeat(8, axis=1)
    return rgb, np.asarray(Image.fromarray(rgb).convert("YCbCr"))


@pytest.mark.parametrize("packing", [None, "lzw", "zlib", "packbits"])
def test_luminance_and_chroma_become_colors(packing):
    rgb, coded = blocks(1, 1)
    tifffile.imwrite("in.tif", coded, photometric="ycbcr", compression=packing, metadata=None)
    outcome = sharpen_image_file("in.tif", "out.tiff", STILL)
    assert "its luminance and chroma became RGB channels" in outcome.notes
    assert np.abs(np.asarray(Image.open("out.tiff")).astype(int) - rgb).max() <= 2


@pytest.mark.parametrize(("across", "down"), [(2, 2), (2, 1), (4, 1)])
def test_chroma_of_a_lower_resolution_becomes_colors(across, down):
    rgb, coded = blocks(across, down)
    units = coded.reshape(16 // down, down, 16 // across, across, 3).swapaxes(1, 2)
    luma = units[..., 0].reshape(16 // down, 16 // across, -1)
    data = np.concatenate([luma, units[:, :, 0, 0, 1:]], axis=-1)
    write_tiff("in.tif", data, {
        "size": (16, 16), 258: (3, [8, 8, 8]), 262: (3, [6]), 277: (3, [3]),
        530: (3, [across, down]),
    })  # fmt: skip
    sharpen_image_file("in.tif", "out.tiff", STILL)
    assert np.abs(tifffile.imread("out.tiff").astype(int) - rgb).max() <= 2


def test_video_range_and_coefficients_of_luminance_are_heeded():
    rgb = COLORS.reshape(2, 2, 3).repeat(8, axis=0).repeat(8, axis=1) / 255.0
    weights = np.array([0.2126, 0.7152, 0.0722])
    luma = rgb @ weights
    blue = (rgb[..., 2] - luma) / (2 - 2 * weights[2])
    red = (rgb[..., 0] - luma) / (2 - 2 * weights[0])
    coded = np.stack([16 + 219 * luma, 128 + 224 * blue, 128 + 224 * red], axis=-1)
    rational = [part for weight in weights for part in (round(weight * 10000), 10000)]
    limits = [part for limit in (16, 235, 128, 240, 128, 240) for part in (limit, 1)]
    write_tiff("in.tif", np.rint(coded).astype(np.uint8), {
        "size": (16, 16), 258: (3, [8, 8, 8]), 262: (3, [6]), 277: (3, [3]), 530: (3, [1, 1]),
        529: (5, rational), 532: (5, limits),
    })  # fmt: skip
    sharpen_image_file("in.tif", "out.tiff", STILL)
    found = tifffile.imread("out.tiff").astype(int)
    assert np.abs(found - np.rint(255 * rgb)).max() <= 3


def test_jpeg_colors_stay_as_they_were():
    rgb, _ = blocks(1, 1)
    tifffile.imwrite(
        "in.tif", rgb, photometric="rgb", compression="jpeg", compressionargs={"level": 95}
    )
    sharpen_image_file("in.tif", "out.tiff", STILL)
    np.testing.assert_array_equal(tifffile.imread("out.tiff"), tifffile.imread("in.tif"))


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("cielab", "CIE L*a*b*"),
        ("separated", "CMYK"),
        ("cfa", "raw sensor"),
        ("linear_raw", "raw sensor"),
    ],
)
def test_other_colors_are_refused_by_name(kind, name):
    shape = {"separated": (16, 16, 4), "cfa": (16, 16)}.get(kind, (16, 16, 3))
    planar = {} if len(shape) == 2 else {"planarconfig": "contig"}
    tifffile.imwrite("in.tif", np.zeros(shape, np.uint8), photometric=kind, metadata=None, **planar)
    with pytest.raises(core.ShockError, match=name.replace("*", r"\*")):
        sharpen_image_file("in.tif", "out.tiff", STILL)


def test_channels_of_different_depths_are_refused():
    data = np.zeros((16, 16), np.uint16)
    write_tiff("in.tif", data, {
        "size": (16, 16), 258: (3, [5, 6, 5]), 262: (3, [2]), 277: (3, [3]),
    })  # fmt: skip
    with pytest.raises(core.ShockError, match="channels of 5, 6, 5 bits"):
        sharpen_image_file("in.tif", "out.tiff", STILL)


@pytest.mark.parametrize("bits", [1, 2, 4, 8])
def test_palettes_of_any_depth(bits):
    numbers = (np.arange(256).reshape(16, 16) % 2**bits).astype(np.uint8)
    palette = np.linspace(0, 65535, 3 * 2**bits).astype(int).reshape(3, -1)
    write_tiff("in.tif", packed(numbers, bits), {
        "size": (16, 16), 258: (3, [bits]), 262: (3, [3]), 277: (3, [1]),
        320: (3, palette.ravel().tolist()),
    })  # fmt: skip
    sharpen_image_file("in.tif", "out.tiff", STILL)
    np.testing.assert_array_equal(
        tifffile.imread("out.tiff"), np.moveaxis(palette[:, numbers], 0, -1)
    )


@pytest.mark.parametrize("palette", [None, [5, 5, 5], list(range(9))])
def test_broken_palettes_are_refused(palette, caplog):
    tags = {"size": (16, 16), 258: (3, [8]), 262: (3, [3]), 277: (3, [1])}
    if palette:
        tags[320] = (3, palette)
    write_tiff("in.tif", np.full((16, 16), 7, np.uint8), tags)
    with pytest.raises(core.ShockError, match=r"in\.tif (has a broken palette|cannot be read)"):
        sharpen_image_file("in.tif", "out.tiff", STILL)
    assert not [each for each in caplog.records if each.name.startswith("shock_filter")]


def test_a_depth_or_colors_that_are_misread_are_noticed(monkeypatch):
    values = np.rint(4095 * slope()).astype(np.uint16)
    write_tiff("odd.tif", packed(values, 12), {
        "size": (16, 20), 258: (3, [12]), 262: (3, [1]), 277: (3, [1]),
    })  # fmt: skip
    tifffile.imwrite("ycc.tif", blocks(1, 1)[1], photometric="ycbcr", metadata=None)
    monkeypatch.setattr(tiff, "_has_odd_depth", lambda page: False)
    monkeypatch.setattr(tiff, "_is_unconverted", lambda page: False)
    for name in ("odd.tif", "ycc.tif"):
        with pytest.raises(core.ShockError, match="its mean brightness is"):
            sharpen_image_file(name, "out.tif", STRONG)
    assert not Path("out.tif").exists()


def test_a_picture_that_is_written_the_other_way_round_is_noticed(monkeypatch):
    Image.fromarray((255 * slope() ** 2).astype(np.uint8)).save("in.png")
    options = tiff._options
    monkeypatch.setattr(
        tiff, "_options", lambda *given: {**options(*given), "photometric": "miniswhite"}
    )
    for name in ("_meant", "_meaning"):
        monkeypatch.setattr(tiff, name, lambda options: tiff._Meaning(False, False))
    with pytest.raises(core.ShockError, match=r"out\.tif: its mean brightness is"):
        sharpen_image_file("in.png", "out.tif", STRONG)
    assert not Path("out.tif").exists()
