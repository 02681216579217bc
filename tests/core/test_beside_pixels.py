# SPDX-License-Identifier: GPL-3.0-or-later
"""What image files hold beside plain pixels: long texts, thumbnails, opacity, chroma, levels."""

import io
import struct
import zlib
from pathlib import Path

import imagecodecs
import numpy as np
import OpenEXR
import pytest
from on_files import sharpen_image_file
from PIL import Image, ImageCms
from shock_filter import core
from shock_filter.core.files.formats.image.pillow import SIGNATURE, chunk
from shock_filter.core.files.image_formats import read_image

STRONG = core.ImageSettings(time=64)
PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
LONG = b"<x:xmpmeta>" + b"a history of edits " * 100_000 + b"</x:xmpmeta>"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def picture(channels=3, dtype="uint8"):
    """A soft edge, at another place in each channel."""
    rows, columns = np.mgrid[:16, :20]
    soft = [np.tanh((columns - 8 - c + np.sin(rows / 3)) / 3) * 0.4 + 0.5 for c in range(channels)]
    values = soft[0] if channels == 1 else np.stack(soft, axis=-1)
    if np.dtype(dtype).kind == "f":
        return values.astype(dtype)
    return np.rint(values * np.iinfo(dtype).max).astype(dtype)


def chunks(data):
    place = len(SIGNATURE)
    while place < len(data):
        length, kind = struct.unpack_from(">I4s", data, place)
        yield kind, data[place + 8 : place + 8 + length]
        place += 12 + length


def write_png(name, pixels, *more, behind=()):
    """Write a PNG with further parts before and behind its pixels."""
    data = imagecodecs.png_encode(pixels)
    start, end = len(SIGNATURE) + 25, len(data) - 12
    Path(name).write_bytes(b"".join([data[:start], *more, data[start:end], *behind, data[end:]]))


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
@pytest.mark.parametrize("is_behind", [False, True])
def test_long_texts_of_a_png_are_kept(dtype, is_behind):
    texts = [
        chunk(b"tEXt", b"Comment\0" + LONG),
        chunk(b"zTXt", b"History\0\0" + zlib.compress(LONG)),
        chunk(b"iTXt", b"XML:com.adobe.xmp\0\1\0\0\0" + zlib.compress(LONG)),
        chunk(b"iTXt", b"Title\0\0\0en\0\0" + LONG),
    ]
    write_png("in.png", picture(dtype=dtype), *([] if is_behind else texts),
              behind=texts if is_behind else ())  # fmt: skip
    sharpen_image_file("in.png", "out.png", STRONG)
    kept = [whole for whole in chunks(Path("out.png").read_bytes()) if whole[0][1:] in
            (b"EXt", b"TXt")]  # fmt: skip
    assert kept == [(text[4:8], text[8:-4]) for text in texts]
    np.testing.assert_array_equal(
        imagecodecs.imread("out.png"), core.sharpen_image(picture(dtype=dtype), STRONG)
    )


@pytest.mark.parametrize("head", [b"\0\0\0\0", b"\1\0en\0history\0"])
def test_xmp_and_profile_of_a_png_reach_other_formats(head):
    text = zlib.compress(LONG) if head[:1] == b"\1" else LONG
    large = PROFILE[:-4] + bytes(2_000_000)
    write_png("in.png", picture(), chunk(b"iCCP", b"p\0\0" + zlib.compress(large)),
              chunk(b"iTXt", b"XML:com.adobe.xmp\0" + head + text))  # fmt: skip
    about = read_image(Path("in.png"), False).about
    assert about["XMP"] == LONG
    assert about["ICC profile"] == large
    sharpen_image_file("in.png", "out.webp", STRONG)
    with Image.open("out.webp") as image:
        assert image.info["xmp"] == LONG


def test_a_damaged_text_is_not_handed_on():
    packed = zlib.compress(LONG)
    write_png("in.png", picture(), chunk(b"iTXt", b"XML:com.adobe.xmp\0\1\0\0\0" + packed[:99]))
    sharpen_image_file("in.png", "out.webp", STRONG)
    with Image.open("out.webp") as image:
        assert "xmp" not in image.info


def exif_with_thumbnail(order):
    """EXIF data with a camera's name, and the old picture in small."""
    stream = io.BytesIO()
    Image.fromarray(picture()).resize((8, 6)).save(stream, "JPEG")
    small = stream.getvalue()
    maker = b"Camera\0"
    first = struct.pack(order + "HHHII", 1, 0x010F, 2, len(maker), 26) + struct.pack(
        order + "I", 34
    )
    second = struct.pack(order + "H", 2)
    second += struct.pack(order + "HHII", 0x0201, 4, 1, 64)
    second += struct.pack(order + "HHII", 0x0202, 4, 1, len(small)) + bytes(4)
    mark = b"II*\0" if order == "<" else b"MM\0*"
    head = mark + struct.pack(order + "I", 8) + first
    return head.ljust(26, b"\0") + maker.ljust(8, b"\0") + second, small, maker


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("name", ["in.jpg", "in.webp", "in.png"])
def test_thumbnails_of_the_old_picture_are_left_behind(name, order):
    head, small, maker = exif_with_thumbnail(order)
    exif = head.ljust(64, b"\0") + small
    words = {"lossless": True} if name == "in.webp" else {}
    Image.fromarray(picture()).save(name, exif=b"Exif\0\0" + exif, **words)
    assert small in Path(name).read_bytes()
    outcome = sharpen_image_file(name, f"out{name[2:]}", STRONG)
    assert "its thumbnail, which shows the old picture: left behind" in outcome.notes
    data = Path(f"out{name[2:]}").read_bytes()
    assert maker in data
    assert small[100:200] not in data
    with Image.open(f"out{name[2:]}") as image:
        assert image.getexif()[0x010F] == "Camera"
        assert not image.getexif().get_ifd(0x0201)


def test_exif_without_a_thumbnail_stays_to_the_bit():
    exif = Image.Exif()
    exif[0x010F], exif[0x0110] = "Camera", "One"
    Image.fromarray(picture()).save("in.jpg", exif=exif)
    outcome = sharpen_image_file("in.jpg", "out.jpg", STRONG)
    with Image.open("in.jpg") as given, Image.open("out.jpg") as found:
        assert found.info["exif"] == given.info["exif"]
    assert not any("thumbnail" in note for note in outcome.notes)


def test_thumbnails_of_photoshop_are_left_behind_and_captions_stay():
    def resource(number, data):
        return b"8BIM" + struct.pack(">HxxI", number, len(data)) + data + bytes(len(data) % 2)

    caption, small = resource(0x0404, b"\x1c\x02\x78\0\5hello"), resource(0x040C, b"old" * 99)
    block = b"Photoshop 3.0\0" + caption + small + resource(0x03ED, bytes(16))
    extra = b"\xff\xed" + struct.pack(">H", len(block) + 2) + block
    Image.fromarray(picture()).save("in.jpg", extra=extra)
    outcome = sharpen_image_file("in.jpg", "out.jpg", STRONG)
    data = Path("out.jpg").read_bytes()
    assert caption in data
    assert resource(0x03ED, bytes(16)) in data
    assert b"oldold" not in data
    assert any("thumbnail" in note for note in outcome.notes)


@pytest.mark.parametrize("target", ["out.bmp", "out.png"])
def test_opacity_of_a_bmp_is_kept(target):
    pixels = picture(4)
    Image.fromarray(pixels).save("in.png")
    sharpen_image_file("in.png", "in.bmp", core.ImageSettings(time=0))
    with Image.open("in.bmp") as image:
        assert image.mode == "RGBA"
        np.testing.assert_array_equal(np.asarray(image), pixels)
    sharpen_image_file("in.bmp", target, STRONG)
    with Image.open(target) as image:
        np.testing.assert_array_equal(np.asarray(image), core.sharpen_image(pixels, STRONG))


def exr_head(version, size, channels, *more):
    """Magic number, version and header of an EXR file without compression, written by hand."""
    height, width = size
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    listed = b"".join(
        name.encode() + b"\0" + struct.pack("<iB3xii", 1, 0, by, by)
        for name, by in sorted(channels.items())
    )
    attributes = [
        ("channels", "chlist", listed + b"\0"),
        ("compression", "compression", b"\0"),
        ("dataWindow", "box2i", window),
        ("displayWindow", "box2i", window),
        ("lineOrder", "lineOrder", b"\0"),
        ("pixelAspectRatio", "float", struct.pack("<f", 1)),
        ("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)),
        ("screenWindowWidth", "float", struct.pack("<f", 1)),
        *more,
    ]
    data = struct.pack("<II", 20000630, version)
    for name, kind, value in attributes:
        data += f"{name}\0{kind}\0".encode() + struct.pack("<i", len(value)) + value
    return data + b"\0"


def write_exr_parts(name, head, parts):
    """Write a header, the places of parts, and the parts."""
    start = len(head) + 8 * len(parts)
    places = np.cumsum([start, *map(len, parts)])[:-1]
    Path(name).write_bytes(head + struct.pack(f"<{len(parts)}Q", *places) + b"".join(parts))


def write_lines(name, channels, *more):
    """Write channels of half numbers line by line; coarse ones have values at even places."""
    size = max(values.shape for values in channels.values())
    by = {key: size[0] // len(values) for key, values in channels.items()}
    lines = []
    for row in range(size[0]):
        data = b"".join(
            values[row // by[key]].astype(np.float16).tobytes()
            for key, values in sorted(channels.items())
            if row % by[key] == 0
        )
        lines.append(struct.pack("<ii", row, len(data)) + data)
    write_exr_parts(name, exr_head(2, size, by, *more), lines)


def write_chroma(name, colors, weights=(0.2126, 0.7152, 0.0722), *more):
    """Write luminance, and chroma of half the resolution."""
    luminance = colors @ np.array(weights)
    red, blue = ((colors[..., c] / luminance - 1)[::2, ::2] for c in (0, 2))
    write_lines(name, {"Y": luminance, "RY": red, "BY": blue}, *more)


def test_exr_of_luminance_and_chroma_becomes_colors():
    colors = np.full((16, 20, 3), (0.2, 0.7, 0.4), np.float32)
    colors[:, :10] = (0.9, 0.3, 0.5)
    write_chroma("in.exr", colors)
    outcome = sharpen_image_file("in.exr", "out.exr", STRONG)
    assert "its luminance and chroma became RGB channels" in outcome.notes
    found = OpenEXR.File("out.exr").channels()["RGB"].pixels
    assert found.dtype == np.float16
    np.testing.assert_allclose(read_image(Path("in.exr"), False).pixels[:, :9], colors[:, :9],
                               atol=2e-3)  # fmt: skip
    np.testing.assert_allclose(found[:, 12:], colors[:, 12:], atol=2e-3)


def test_primaries_of_an_exr_are_heeded():
    colors = np.full((8, 8, 3), (0.2, 0.7, 0.4), np.float32)
    points = [(0.708, 0.292), (0.17, 0.797), (0.131, 0.046), (0.3127, 0.329)]  # of Rec. 2020
    places = struct.pack("<8f", *(number for point in points for number in point))
    weights = (0.2627, 0.6780, 0.0593)
    write_chroma("in.exr", colors, weights, ("chromaticities", "chromaticities", places))
    found = read_image(Path("in.exr"), False).pixels
    np.testing.assert_allclose(found.astype(float), colors, atol=2e-3)


def test_other_coarse_channels_of_an_exr_are_refused_before_all_work():
    whole, coarse = np.ones((8, 8)), np.ones((4, 4))
    write_lines("in.exr", {"R": whole, "G": whole, "B": whole, "mask": coarse})
    with pytest.raises(core.ShockError, match=r"channels of a lower resolution \(mask\)"):
        sharpen_image_file("in.exr", "out.exr", STRONG)


def test_levels_of_a_tiled_exr_are_left_behind():
    levels = [picture(1, "float16")[:side, :side] for side in (16, 8, 4, 2, 1)]
    about = ("tiles", "tiledesc", struct.pack("<IIB", 16, 16, 1))
    tiles = [
        struct.pack("<5i", 0, 0, number, number, level.nbytes) + level.tobytes()
        for number, level in enumerate(levels)
    ]
    write_exr_parts("in.exr", exr_head(2 | 0x200, (16, 16), {"Y": 1}, about), tiles)
    outcome = sharpen_image_file("in.exr", "out.exr", STRONG)
    assert "its smaller copies (levels): left behind" in outcome.notes
    np.testing.assert_array_equal(
        OpenEXR.File("out.exr").channels()["Y"].pixels,
        core.sharpen_image(levels[0].astype(np.float32), STRONG).astype(np.float16),
    )
