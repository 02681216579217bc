# SPDX-License-Identifier: GPL-3.0-or-later
"""What a file holds arrives in the copy, or the note names it: for every pair of formats."""

import struct
import zlib
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import tifffile
from on_files import sharpen_image_file
from PIL import Image
from shock_filter import core
from test_image_files import PROFILE, picture

STRONG = core.ImageSettings(time=64)
XMP = b'<x:xmpmeta xmlns:x="adobe:ns:meta/">a packet</x:xmpmeta>'


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


# ------------------------------------------------------------------------------------------ images


def exif():
    tags = Image.Exif()
    tags[0x010F] = "a maker"
    return tags.tobytes()


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(name, dtype="uint8"):
    Image.fromarray(picture()).save(name, icc_profile=PROFILE, dpi=(72, 72), exif=exif())
    more = [
        chunk(b"tEXt", b"Title\0a title"),
        chunk(b"iTXt", b"XML:com.adobe.xmp\0\0\0\0\0" + XMP),
        chunk(b"gAMA", struct.pack(">I", 45455)),
        chunk(b"bKGD", bytes(6)),
    ]
    data = Path(name).read_bytes()
    Path(name).write_bytes(data[:33] + b"".join(more) + data[33:])


IPTC = b"8BIM\x04\x04\0\0\0\0\0\x10\x1c\x02\x78\0\x09a caption\0\0"


def jpeg(name):
    block = b"Photoshop 3.0\0" + IPTC
    extra = b"\xff\xed" + struct.pack(">H", len(block) + 2) + block
    extra += b"\xff\xeb" + struct.pack(">H", 12) + b"JP\0\1signed"
    words = {"icc_profile": PROFILE, "dpi": (72, 72), "exif": exif(), "xmp": XMP}
    Image.fromarray(picture()).save(name, comment=b"a comment", extra=extra, **words)


def tiff(name):
    tifffile.imwrite(
        name,
        picture(),
        photometric="rgb",
        description="Höhe ©".encode(),
        software="Kamera ö".encode(),
        iccprofile=PROFILE,
        resolution=(72, 72),
        resolutionunit="INCH",
        extratags=[
            (33432, 2, None, "© me".encode("latin-1"), True),
            (33550, 12, 3, (1.0, 2.0, 0.0), True),
            (700, 1, len(XMP), XMP, True),
            (37724, 7, 10, b"old layers", True),
        ],
    )


def webp(name):
    words = {"icc_profile": PROFILE, "exif": exif(), "xmp": XMP}
    Image.fromarray(picture()).save(name, lossless=True, **words)


def bmp(name):
    Image.fromarray(picture()).save(name, dpi=(72, 72))
    data = bytearray(Path(name).read_bytes())
    header = struct.pack("<I", 124) + data[18:54] + bytes(16) + b"DEBM" + bytes(64)
    struct.pack_into("<I", data, 10, 14 + len(header))
    Path(name).write_bytes(bytes(data[:14]) + header + bytes(data[54:]))


def exr(name):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    header |= {"comments": "a remark"}
    OpenEXR.File(header, {"RGB": picture(3, "float32"), "Z": picture(1, "float32")}).write(name)


IMAGES = {".png": png, ".jpg": jpeg, ".tif": tiff, ".webp": webp, ".bmp": bmp, ".exr": exr}
IMAGE_ITEMS = {
    ".png": ["ICC", "resolution", "EXIF", "XMP", "tEXt", "gAMA", "bKGD"],
    ".jpg": ["ICC", "resolution", "EXIF", "XMP", "comment", "IPTC", "APP11"],
    ".tif": ["ICC", "resolution", "XMP", "ImageDescription", "Software", "Copyright",
             "ModelPixelScaleTag", "layers"],
    ".webp": ["ICC", "EXIF", "XMP"],
    ".bmp": ["resolution", "color profile"],
    ".exr": ["comments", "channels (Z)"],
}  # fmt: skip
CARRIED = {
    "tEXt": b"a title",
    "gAMA": b"gAMA",
    "comment": b"a comment",
    "IPTC": b"a caption",
    "APP11": b"signed",
    "ImageDescription": "Höhe ©".encode(),
    "Software": "Kamera ö".encode(),
    "Copyright": "© me".encode("latin-1"),
    "ModelPixelScaleTag": struct.pack("<3d", 1.0, 2.0, 0.0),
    "comments": b"a remark",
    "channels (Z)": b"Z\0",
    "EXIF": b"a maker",
    "XMP": b"a packet",
    "layers": b"old layers",
    "bKGD": b"bKGD",
}
"""What stands in a file that keeps an item."""


def arrives(item, target):
    if item in CARRIED:
        return CARRIED[item] in Path(target).read_bytes()
    if target.endswith(".tif"):
        with tifffile.TiffFile(target) as file:
            page = file.pages[0]
            return (
                page.iccprofile == PROFILE
                if item == "ICC"
                else np.allclose(page.resolution, 72, atol=0.1)
            )
    if not target.endswith((".png", ".jpg", ".webp", ".bmp")):
        return False
    with Image.open(target) as image:
        if item == "ICC":
            return image.info.get("icc_profile") == PROFILE
        return np.allclose(image.info.get("dpi", 0), 72, atol=0.1) and item == "resolution"


@pytest.mark.parametrize("target", [*IMAGES, ".npy"])
@pytest.mark.parametrize("source", IMAGES)
def test_images(source, target):
    if (source == ".exr") != (target == ".exr") and target != ".npy":
        source_of = (".exr", ".tif")
        if source != ".exr" or target not in source_of:
            return  # of other values
    IMAGES[source]("in" + source)
    outcome = sharpen_image_file("in" + source, "out" + target, STRONG)
    note = "; ".join(outcome.notes)
    lost = [name for name in IMAGE_ITEMS[source] if not arrives(name, "out" + target)]
    assert [name for name in lost if name not in note] == []
    assert {"bKGD", "layers"} & set(IMAGE_ITEMS[source]) <= set(lost)  # of the old pixels
    if source == target:
        assert set(lost) <= {"bKGD", "layers", "APP11", "color profile"}


def test_both_descriptions_of_a_tiff_are_kept():
    tifffile.imwrite("in.tif", picture(), photometric="rgb", description="mine")  # and its own
    sharpen_image_file("in.tif", "out.tif", STRONG)
    for name in ("in.tif", "out.tif"):
        with tifffile.TiffFile(name) as file:
            found = [tag.value for tag in file.pages[0].tags.values() if tag.code == 270]
        assert found == ["mine", '{"shape": [24, 30, 3]}'], name


@pytest.mark.parametrize("tag", [269, 270, 271, 272, 285, 305, 306, 315, 316, 337, 33432, 42112])
@pytest.mark.parametrize("coding", ["utf-8", "latin-1"])
def test_texts_of_a_tiff_may_hold_any_letters(tag, coding):
    text = "© Höhe".encode(coding)
    extra = [(tag, 2, None, text, True)]
    words = {"photometric": "rgb", "metadata": None, "software": False}
    tifffile.imwrite("in.tif", picture(), extratags=extra, **words)
    assert sharpen_image_file("in.tif", "out.tif", STRONG).notes == ()
    assert text + b"\0" in Path("out.tif").read_bytes()
