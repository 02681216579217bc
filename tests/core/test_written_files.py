# SPDX-License-Identifier: GPL-3.0-or-later
"""What is written can be read, and replaces nothing but what was named as output."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from on_files import sharpen_image_file
from PIL import Image
from shock_filter import core
from shock_filter.core.files import images
from test_image_files import picture, read, write

STRONG = core.ImageSettings(time=64)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def chunk(kind, data, check=None):
    body = kind + data
    crc = zlib.crc32(body) if check is None else check
    return struct.pack(">I", len(data)) + body + struct.pack(">I", crc)


FOREIGN = [
    b"<!DOCTYPE html><html><body>Not found</body></html>" * 5,
    b'<?xpacket end="w"?>',
    b"2026-01-01 12:00:00 done: file closed\n" * 3,
    b"\0\0\0\4abcd" + b"1234" + bytes(4),
]


@pytest.mark.parametrize("foreign", FOREIGN)
@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_bytes_behind_a_png_do_not_get_into_the_copy(foreign, dtype):
    pixels = picture(3, dtype)
    write("in.png", pixels)
    with Path("in.png").open("ab") as stream:
        stream.write(foreign)
    sharpen_image_file("in.png", "in.png", STRONG, overwrite=True)
    np.testing.assert_array_equal(read("in.png"), core.sharpen_image(pixels, STRONG))
    with Image.open("in.png") as image:
        image.verify()


def test_damaged_chunks_of_a_png_are_left_behind():
    write("in.png", picture())
    data = Path("in.png").read_bytes()
    good, bad = chunk(b"teXt", b"Title\0good"), chunk(b"teXt", b"Title\0bad", check=7)
    Path("in.png").write_bytes(data[:33] + good + data[33:-12] + bad + data[-12:])
    outcome = sharpen_image_file("in.png", "out.png", STRONG)
    result = Path("out.png").read_bytes()
    assert good in result
    assert bad not in result
    assert "damaged parts of the file (teXt): left behind" in outcome.notes


@pytest.mark.parametrize("name", ["in.png", "in.tif", "in.exr", "in.jpg", "in.webp", "in.bmp"])
@pytest.mark.parametrize("fault", ["cut", "other"])
def test_an_image_that_cannot_be_read_back_replaces_nothing(name, fault, monkeypatch):
    write(name, picture(3, "float32" if name == "in.exr" else "uint8"))
    before = Path(name).read_bytes()
    kind = images._FORMATS[Path(name).suffix]

    def spoil(path, image_file, pixels):
        other = pixels[:, :-1] if name == "in.jpg" else pixels[::-1]
        notes = kind.write(path, image_file, pixels if fault == "cut" else other)
        if fault == "cut":
            path.write_bytes(path.read_bytes()[:-200])
        return notes

    spoiled = images._FORMATS | {Path(name).suffix: kind._replace(write=spoil)}
    monkeypatch.setattr(images, "_FORMATS", spoiled)
    with pytest.raises(core.ShockError, match=f"{name} was not written: .* read back"):
        sharpen_image_file(name, name, STRONG, overwrite=True)
    assert Path(name).read_bytes() == before
    assert [path.name for path in Path().iterdir()] == [name]
