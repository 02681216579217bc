# SPDX-License-Identifier: GPL-3.0-or-later
"""Other programs show a picture that was converted as they showed the original."""

import subprocess
import sys
import zlib
from pathlib import Path

import imagecodecs
import numpy as np
import OpenEXR
import pytest
import tifffile
from on_files import sharpen_image_file
from PIL import Image, ImageOps
from shock_filter import core
from shock_filter.core.files import images
from shock_filter.core.files.formats.image import orientation, pillow, tiff
from shock_filter.core.files.formats.image.thumbnails import without_exif_thumbnail

STILL = core.ImageSettings(time=0)
RAMP = np.linspace(10, 200, 12 * 16).reshape(12, 16).astype(np.uint8)
COLORS = np.stack([RAMP, 255 - RAMP, RAMP // 2], axis=-1)
OPACITY = np.full_like(RAMP, 51)
OPACITY[:6] = 204


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def convert(source, target):
    return sharpen_image_file(source, target, STILL)


def shown(name):
    """What libtiff or Pillow shows, on black, from 0 to 255."""
    path = Path(name)
    if path.suffix == ".tif":
        return imagecodecs.tiff_decode(path.read_bytes(), asrgb=True)[..., :3].astype(float)
    if path.suffix == ".npy":
        pixels = np.load(path)
        return 255.0 * (pixels if pixels.ndim == 3 else np.dstack([pixels] * 3)) / 255
    with Image.open(path) as image:
        if image.mode == "I;16":
            return np.dstack([np.asarray(image) / 257.0] * 3)
        pixels = np.asarray(ImageOps.exif_transpose(image).convert("RGBA")).astype(float)
    return pixels[..., :3] * pixels[..., 3:] / 255


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("target", ["out.png", "out.bmp", "out.jpg", "out.npy", "out.tif"])
def test_white_that_is_zero(kind, target):
    values = RAMP.astype(kind) * (1 if kind == np.uint8 else 257)
    tifffile.imwrite("in.tif", values, photometric="miniswhite")
    if kind == np.uint16 and target in ("out.bmp", "out.jpg"):
        with pytest.raises(core.ShockError, match="cannot hold 1 channels of uint16"):
            convert("in.tif", target)
        return
    convert("in.tif", target)
    if target == "out.npy":
        np.testing.assert_array_equal(np.load(target), np.iinfo(kind).max - values)
    elif kind == np.uint8:
        np.testing.assert_allclose(shown(target)[..., 0], 255.0 - RAMP, atol=3)
    else:  # which libtiff shows with a curve of its own
        np.testing.assert_allclose(shown(target), shown("in.tif" if "tif" in target else target))


def test_white_that_is_zero_stays_so_in_tiff(monkeypatch):
    for tiled in (False, True):
        tile = {"tile": (16, 16)} if tiled else {}
        monkeypatch.setattr(images, "BIG", 0 if tiled else 1 << 28)
        tifffile.imwrite("in.tif", RAMP, photometric="miniswhite", **tile)
        sharpen_image_file("in.tif", f"{tiled}.tif", core.ImageSettings(time=2))
        with tifffile.TiffFile(f"{tiled}.tif") as file:
            assert file.pages[0].photometric == 0
        assert abs(shown(f"{tiled}.tif") - shown("in.tif")).mean() < 8


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("colors", [RAMP[..., None], COLORS])
@pytest.mark.parametrize("target", ["out.png", "out.tif", "tiles.tif"])
def test_opacity_that_is_multiplied_in_is_divided_out(kind, colors, target, monkeypatch):
    white = np.iinfo(kind).max
    times = white // 255
    multiplied = np.rint(colors * (OPACITY[..., None] / 255.0) * times).astype(kind)
    pixels = np.dstack([multiplied, OPACITY.astype(kind) * times])
    tile = {"tile": (16, 16)} if target == "tiles.tif" else {}
    tifffile.imwrite(
        "in.tif", pixels, photometric="rgb" if pixels.shape[2] == 4 else "minisblack",
        planarconfig="contig", extrasamples=["assocalpha"], **tile,
    )  # fmt: skip
    if tile:
        monkeypatch.setattr(images, "BIG", 0)
    outcome = convert("in.tif", target)
    if target != "out.tif":  # which is a copy, as nothing changes
        assert "its colors were divided by the opacity that was multiplied into them" in (
            outcome.notes
        )
    found = images.read_image(Path(target), False).pixels
    assert abs(found[..., :-1] / times - colors.astype(float)).max() <= 255 / 51
    np.testing.assert_array_equal(found[..., -1], pixels[..., -1])


def test_opacity_of_floats_follows_the_format():
    pixels = np.dstack([COLORS, OPACITY]).astype(np.float32) / 255
    for kind in ("assocalpha", "unassalpha"):
        tifffile.imwrite(f"{kind}.tif", pixels, photometric="rgb", extrasamples=[kind])
        convert(f"{kind}.tif", f"{kind}.exr")
        convert(f"{kind}.exr", f"{kind}.back.tif")
    with OpenEXR.File("assocalpha.exr") as file:
        np.testing.assert_array_equal(file.channels()["RGBA"].pixels, pixels)
    with OpenEXR.File("unassalpha.exr") as file:
        expected = np.dstack([pixels[..., :3] * pixels[..., 3:], pixels[..., 3]])
        np.testing.assert_array_equal(file.channels()["RGBA"].pixels, expected)
    with tifffile.TiffFile("unassalpha.back.tif") as file:
        assert file.pages[0].extrasamples == (1,)  # multiplied in, as in the EXR file


def test_a_channel_of_no_stated_meaning_is_named():
    pixels = np.dstack([COLORS, OPACITY])
    tifffile.imwrite("in.tif", pixels, photometric="rgb", extrasamples=["unspecified"])
    outcome = convert("in.tif", "out.png")
    assert "its last channel, whose meaning is not stated, became opacity" in outcome.notes


def test_an_empty_channel_of_no_stated_meaning_hides_nothing():
    pixels = np.dstack([COLORS, np.zeros_like(RAMP)])
    tifffile.imwrite("in.tif", pixels, photometric="rgb", extrasamples=["unspecified"])
    outcome = convert("in.tif", "out.png")
    assert any("which is empty" in note for note in outcome.notes)
    np.testing.assert_array_equal(np.asarray(Image.open("out.png")), COLORS)


@pytest.mark.parametrize("bits", [1, 2, 4, 16])
def test_transparent_gray_of_any_depth(bits):
    values = (np.arange(12 * 16).reshape(12, 16) % min(2**bits, 7)).astype(">u2")
    as_bits = (values[..., None] >> np.arange(bits - 1, -1, -1)) & 1
    rows = np.packbits(as_bits.reshape(12, -1).astype(np.uint8), axis=1)
    head = pillow.chunk(b"IHDR", b"\0\0\0\x10\0\0\0\x0c" + bytes([bits, 0, 0, 0, 0]))
    data = zlib.compress(b"".join(b"\0" + row.tobytes() for row in rows))
    Path("in.png").write_bytes(
        pillow.SIGNATURE + head + pillow.chunk(b"tRNS", b"\0\1")
        + pillow.chunk(b"IDAT", data) + pillow.chunk(b"IEND", b"")
    )  # fmt: skip
    convert("in.png", "out.npy")
    white = 65535 if bits == 16 else 255
    expected = np.dstack([values.astype(int) * white // (2**bits - 1), white * (values != 1)])
    np.testing.assert_array_equal(np.load("out.npy"), expected)


@pytest.mark.parametrize("name", ["jpegxl", "jpeg2000", "webp", "lzma"])
def test_compressions_that_others_do_not_know_raise_no_alarm(name):
    tifffile.imwrite("in.tif", COLORS, photometric="rgb", compression=name)
    convert("in.tif", "out.png")
    np.testing.assert_array_equal(np.asarray(Image.open("out.png")), tifffile.imread("in.tif"))


def test_palettes_of_8_bits_are_as_bright_as_libtiff_shows_them():
    palette = np.stack([np.arange(256), np.arange(256)[::-1], np.arange(256) // 2])
    for times in (1, 257):
        colors = (palette * times).astype(np.uint16)
        tifffile.imwrite(f"{times}.tif", RAMP, photometric="palette", colormap=colors)
        outcome = convert(f"{times}.tif", f"{times}.png")
        bits = 8 if times == 1 else 16
        assert f"its palette was replaced by {bits}-bit RGB channels" in outcome.notes
        np.testing.assert_allclose(shown(f"{times}.png"), shown(f"{times}.tif"), atol=1)


def exif(number, order):
    head = b"II*\0" if order == "little" else b"MM\0*"
    short = number.to_bytes(2, order) + bytes(2)
    entry = (274).to_bytes(2, order) + (3).to_bytes(2, order) + (1).to_bytes(4, order) + short
    return head + (8).to_bytes(4, order) + (1).to_bytes(2, order) + entry + bytes(4)


def write_turned(name, number):
    """Write a picture that is to be turned."""
    if name.endswith(".tif"):
        tifffile.imwrite(name, COLORS, photometric="rgb", extratags=[(274, 3, 1, number, True)])
        return
    order = ("little", "big")[number % 2]
    words = {"lossless": True} if name.endswith(".webp") else {}
    with Image.fromarray(COLORS) as image:
        image.save(name, exif=b"Exif\0\0" + exif(number, order), **words)


def upright(name):
    """What is shown, turned."""
    if name.endswith(".tif"):
        with tifffile.TiffFile(name) as file:
            tag = file.pages[0].tags.get(274)
            return orientation.turned(file.pages[0].asarray(), tag.value if tag else 1).astype(int)
    if name.endswith(".npy"):
        return np.load(name).astype(int)
    with Image.open(name) as image:
        return np.asarray(ImageOps.exif_transpose(image)).astype(int)


@pytest.mark.parametrize("number", range(1, 9))
@pytest.mark.parametrize("source", ["in.tif", "in.png", "in.jpg", "in.webp"])
def test_pictures_stay_upright(source, number):
    write_turned(source, number)
    expected = upright(source)
    np.testing.assert_allclose(expected, orientation.turned(upright_stored(source), number))
    for target in ("out.tif", "out.png", "out.jpg", "out.webp", "out.bmp", "out.npy"):
        outcome = convert(source, target)
        assert abs(upright(target) - expected).mean() < 4, target
        if number > 1 and source[2:] != target[3:]:
            assert "turned upright, as its orientation tag said" in outcome.notes
    for settings in (STILL, core.ImageSettings(time=0.5)):
        sharpen_image_file(source, "again" + source[2:], settings, overwrite=True)
        assert abs(upright("again" + source[2:]) - expected).mean() < 4


def upright_stored(name):
    if name.endswith(".tif"):
        return tifffile.imread(name).astype(int)
    with Image.open(name) as image:
        return np.asarray(image).astype(int)


@pytest.mark.parametrize("source", ["in.tif", "in.png"])
def test_textures_stay_as_they_are_stored(source):
    write_turned(source, 6)

    def mirrored(pixels):
        return pixels[::-1]

    for target in ("out.npy", "out" + source[2:]):
        images.filter_image_file(mirrored, source, target, upright=False)
    np.testing.assert_array_equal(np.load("out.npy"), COLORS[::-1])
    np.testing.assert_array_equal(upright("out" + source[2:]), orientation.turned(COLORS[::-1], 6))


@pytest.mark.parametrize("number", [3, 6])
def test_large_pictures_and_masks_are_turned(number, monkeypatch):
    tags = [(274, 3, 1, number, True)]
    edge = np.where(np.add.outer(np.arange(40), np.arange(48)) > 40, 200, 40).astype(float)
    soft = sum(np.roll(edge, shift, axis=1) for shift in range(-3, 4)) / 7
    soft = soft.astype(np.uint8)
    tifffile.imwrite("in.tif", soft, tile=(16, 16), extratags=tags)
    mask = np.zeros_like(soft)
    mask[:20] = 255
    tifffile.imwrite("mask.tif", mask, extratags=tags)
    sharpen_image_file("in.tif", "whole.tif", core.ImageSettings(time=64), mask="mask.tif")
    monkeypatch.setattr(images, "BIG", 0)
    sharpen_image_file("in.tif", "tiles.tif", core.ImageSettings(time=64), mask="mask.tif")
    whole, given = tifffile.imread("whole.tif"), orientation.turned(soft, number)
    np.testing.assert_array_equal(tifffile.imread("tiles.tif"), whole)
    still = orientation.turned(mask, number) == 0
    np.testing.assert_array_equal(whole[still], given[still])
    assert (whole != given).any()


def test_xmp_is_told_that_the_picture_was_turned():
    xmp = b'<x:xmpmeta xmlns:x="adobe:ns:meta/" tiff:Orientation="6"/>'
    with Image.fromarray(COLORS) as image:
        image.save("in.jpg", xmp=xmp)
    expected = upright("in.jpg")
    assert expected.shape == (16, 12, 3)
    for target in ("out.png", "out.webp", "out.tif"):
        convert("in.jpg", target)
        assert abs(upright(target) - expected).mean() < 4
        assert b'tiff:Orientation="1"' in Path(target).read_bytes()


def test_exif_behind_the_pixels_of_a_png_is_found():
    with Image.fromarray(COLORS) as image:
        image.save("plain.png")
    data = Path("plain.png").read_bytes()
    Path("in.png").write_bytes(data[:-12] + pillow.chunk(b"eXIf", exif(6, "big")) + data[-12:])
    convert("in.png", "out.bmp")
    np.testing.assert_array_equal(upright("out.bmp"), orientation.turned(COLORS, 6))


def test_the_third_directory_of_exif_stays():
    def directory(entries, following):
        return (
            len(entries).to_bytes(2, "little") + b"".join(entries) + following.to_bytes(4, "little")
        )

    def entry(code, kind, count, value):
        parts = (code, 2), (kind, 2), (count, 4), (value, 4)
        return b"".join(number.to_bytes(size, "little") for number, size in parts)

    first = directory([entry(274, 3, 1, 1)], 26)
    strips = directory([entry(0x111, 4, 2, 74), entry(0x117, 4, 2, 82)], 56)
    third = directory([entry(305, 2, 3, 0x4241)], 0)
    arrays = b"".join(n.to_bytes(4, "little") for n in (90, 93, 3, 3))
    data = b"II*\0" + (8).to_bytes(4, "little") + first + strips + third + arrays + b"oldpixKEPT"
    cleaned, had = without_exif_thumbnail(data)
    assert had
    assert cleaned[22:26] == (56).to_bytes(4, "little")
    assert cleaned[56:74] == third
    assert cleaned[74:] == arrays + bytes(6) + b"KEPT"


@pytest.mark.parametrize(
    ("data", "kind", "message"),
    [
        (np.zeros((8, 8), np.complex64), None, "holds complex numbers"),
        (np.zeros((8, 8), np.int32), 5, "holds complex numbers"),
        (np.zeros((8, 12), np.float32), 24, "has floats of 24 bits"),
    ],
)
def test_kinds_of_numbers_are_refused_by_name(data, kind, message):
    tifffile.imwrite("in.tif", data)
    if kind is not None:
        with tifffile.TiffFile("in.tif", mode="r+b") as file:
            tags = file.pages[0].tags
            if kind == 24:
                tags[258].overwrite(24)
            else:
                tags[339].overwrite(kind)
    with pytest.raises(core.ShockError, match=message):
        convert("in.tif", "out.tif")
    assert not Path("out.tif").exists()


def test_values_of_an_undefined_kind_are_noted():
    tifffile.imwrite("in.tif", RAMP.view(np.int8))
    with tifffile.TiffFile("in.tif", mode="r+b") as file:
        file.pages[0].tags[339].overwrite(4)
    outcome = convert("in.tif", "out.png")
    assert "its values, of a kind that is not stated, were read as whole numbers" in outcome.notes
    np.testing.assert_array_equal(np.asarray(Image.open("out.png")), RAMP)


def test_nothing_but_notes_is_printed():
    tifffile.imwrite("webp.tif", COLORS, photometric="rgb", compression="webp")
    tifffile.imwrite("tags.tif", RAMP.view(np.int8))
    with tifffile.TiffFile("tags.tif", mode="r+b") as file:
        file.pages[0].tags[339].overwrite(7)
    code = (
        "from pathlib import Path\n"
        "from shock_filter.core.errors import ShockError\n"
        "from shock_filter.core.files.images import read_image\n"
        "for name in ('webp.tif', 'tags.tif'):\n"
        "    try: read_image(Path(name), False)\n"
        "    except ShockError: pass\n"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert found.stdout + found.stderr == b""


@pytest.mark.parametrize("target", ["out.png", "out.bmp", "out.webp", "out.tif"])
def test_a_picture_that_others_see_otherwise_replaces_nothing(target, monkeypatch):
    np.save("in.npy", COLORS)
    Path(target).write_bytes(b"kept")
    row = images.FORMATS[Path(target).suffix]

    def write(path, image_file, pixels):
        return row.write(path, image_file, pixels // 4)

    monkeypatch.setitem(images.FORMATS, Path(target).suffix, row._replace(write=write))
    monkeypatch.setattr(images, "read_back", lambda path, pixels: None)
    with pytest.raises(core.ShockError, match=f"{target}: its mean brightness is"):
        sharpen_image_file("in.npy", target, core.ImageSettings(time=1), overwrite=True)
    assert Path(target).read_bytes() == b"kept"


def test_tiles_that_others_see_otherwise_replace_nothing(monkeypatch):
    monkeypatch.setattr(images, "BIG", 0)
    tifffile.imwrite("in.tif", RAMP, photometric="miniswhite", tile=(16, 16))
    Path("out.tif").write_bytes(b"kept")
    monkeypatch.setattr(tiff, "_meaning", lambda page: tiff._Meaning(False, False))
    with pytest.raises(core.ShockError, match=r"in\.tif: its mean brightness is"):
        sharpen_image_file("in.tif", "out.tif", core.ImageSettings(time=1), overwrite=True)
    assert Path("out.tif").read_bytes() == b"kept"
