# SPDX-License-Identifier: GPL-3.0-or-later
"""Image files: depth, channels and metadata survive; what cannot be handled is refused."""

import struct
import subprocess
import sys
import threading
import zlib
from pathlib import Path

import imagecodecs
import numpy as np
import OpenEXR
import pytest
import tifffile
from on_files import sharpen_image_file
from PIL import Image, ImageCms, PngImagePlugin
from shock_filter import core
from shock_filter.core import cli
from shock_filter.core.color.image_sharpening import measure_image
from shock_filter.core.files.formats.image.pillow import read_pillow
from shock_filter.core.files.image_formats import read_pixels
from shock_filter.core.files.images import filter_image_file

STILL = core.ImageSettings(time=0)
STRONG = core.ImageSettings(time=64)
PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def picture(channels=3, dtype="uint8", size=(24, 30)):
    """A soft edge, bent and of other colors in each channel."""
    rows, columns = np.mgrid[: size[0], : size[1]]
    slope = np.tanh((columns - size[1] / 2 + 3 * np.sin(rows / 5)) / 4) * 0.4 + 0.5
    values = np.stack([slope * (1 - 0.15 * c) for c in range(channels)], axis=2)
    if channels in (2, 4):
        values[..., -1] = np.clip(rows / size[0] + 0.2, 0, 1)
    values = values[..., 0] if channels == 1 else values
    if np.dtype(dtype).kind == "u":
        return np.rint(values * np.iinfo(dtype).max).astype(dtype)
    return values.astype(dtype)


def write(name, pixels):
    """Write pixels by means other than ours."""
    ending = Path(name).suffix
    if ending == ".png":
        Path(name).write_bytes(imagecodecs.png_encode(pixels))
    elif ending == ".tif":
        alpha = pixels.ndim == 3 and pixels.shape[2] in (2, 4)
        tifffile.imwrite(
            name,
            pixels,
            photometric="rgb" if pixels.ndim == 3 and pixels.shape[2] > 2 else "minisblack",
            extrasamples=["unassalpha"] if alpha else None,
        )
    elif ending == ".exr":
        write_exr(name, {"Y" if pixels.ndim == 2 else "RGBA"[: pixels.shape[2]]: pixels})
    elif ending == ".npy":
        np.save(name, pixels)
    else:
        Image.fromarray(pixels).save(name)


def read(name):
    """Read pixels by means other than ours."""
    ending = Path(name).suffix
    if ending == ".png":
        return imagecodecs.png_decode(Path(name).read_bytes())
    if ending == ".tif":
        return tifffile.imread(name)
    if ending == ".exr":
        return next(iter(read_exr(name)[1].values()))
    return np.load(name) if ending == ".npy" else np.array(opened(name))


def opened(name):
    with Image.open(name) as image:
        image.load()
        return image


def write_exr(name, channels, **header):
    header |= {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(name)


def read_exr(name):
    with OpenEXR.File(name) as file:
        return dict(file.header()), {key: c.pixels for key, c in file.channels().items()}


def sharpen(source, target, settings=STRONG, **options):
    return sharpen_image_file(source, target, settings, **options)


KINDS = [
    *[(".png", c, d) for c in (1, 2, 3, 4) for d in ("uint8", "uint16")],
    *[(".tif", c, d) for c in (1, 2, 3, 4) for d in ("uint8", "uint16", "float32", "float64")],
    *[(".exr", c, d) for c in (1, 3, 4) for d in ("float16", "float32")],
    *[(".npy", c, d) for c in (1, 3, 5) for d in ("uint8", "uint16", "float32", "float64")],
    *[(".bmp", c, "uint8") for c in (1, 3)],
    *[(".webp", c, "uint8") for c in (3, 4)],
]


def written(ending, channels, dtype):
    """Write in.ENDING; returns the pixels that it holds."""
    pixels = picture(channels, dtype)
    if ending == ".webp":
        Image.fromarray(pixels).save("in.webp", lossless=True, exact=True)
    else:
        write("in" + ending, pixels)
    return pixels


@pytest.mark.parametrize("ending, channels, dtype", KINDS)
def test_depth_and_channels_are_kept(ending, channels, dtype):
    pixels = written(ending, channels, dtype)
    outcome = sharpen("in" + ending, "out" + ending)
    result = read("out" + ending)
    assert (result.dtype, result.shape) == (pixels.dtype, pixels.shape)
    floats = pixels.astype(np.float32) if dtype == "float16" else pixels
    wanted = core.sharpen_image(floats, STRONG).astype(dtype)
    np.testing.assert_array_equal(result, wanted)
    assert outcome.total == 24 * 30
    differs = (wanted != pixels).reshape(24 * 30, -1).any(axis=1)
    assert outcome.changed == differs.sum() > 30
    assert outcome.notes == ()
    if channels in (2, 4):
        np.testing.assert_array_equal(result[..., -1], pixels[..., -1])


@pytest.mark.parametrize("ending, channels, dtype", [*KINDS, (".jpg", 1, "uint8")])
def test_time_zero_gives_the_same_bytes(ending, channels, dtype):
    written(ending, channels, dtype)
    outcome = sharpen("in" + ending, "out" + ending, STILL)
    assert outcome.changed == 0
    assert outcome.notes == ()
    assert Path("out" + ending).read_bytes() == Path("in" + ending).read_bytes()


@pytest.mark.parametrize("channels", [1, 3])
def test_jpeg_keeps_its_quality_and_says_that_it_is_lossy(channels):
    pixels = picture(channels, size=(96, 128))
    Image.fromarray(pixels).save("in.jpg", quality=71, comment=b"hello")
    steady = core.ImageSettings(time=np.inf)
    outcome = sharpen("in.jpg", "out.jpg", steady)
    assert outcome.notes == ("JPEG is lossy: all pixels were compressed anew",)
    old, new = opened("in.jpg"), opened("out.jpg")
    assert (new.mode, new.size) == (old.mode, old.size)
    assert new.quantization == old.quantization
    assert new.info["comment"] == b"hello"
    wanted = core.sharpen_image(np.array(old), steady)
    error = np.abs(np.array(new).astype(int) - wanted)
    assert 0 < error.mean() < 3
    assert np.abs(np.array(old).astype(int) - wanted).mean() > 2 * error.mean()


# ---------------------------------------------------------------------------------------- metadata


def exif():
    tags = Image.Exif()
    tags[0x010E] = "a test"
    return tags


@pytest.mark.parametrize("source, target", [("jpg", "jpg"), ("jpg", "png"), ("png", "jpg")])
def test_profile_resolution_and_exif_are_kept(source, target):
    image = Image.fromarray(picture())
    image.save("in." + source, icc_profile=PROFILE, dpi=(300, 150), exif=exif())
    sharpen("in." + source, "out." + target)
    result = opened("out." + target)
    assert result.info["icc_profile"] == PROFILE
    assert np.allclose(result.info["dpi"], (300, 150), atol=0.02)
    assert result.getexif()[0x010E] == "a test"


def insert(name, kind, data):
    """Insert a chunk behind the header of a PNG file."""
    chunk = struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    content = Path(name).read_bytes()
    Path(name).write_bytes(content[:33] + chunk + content[33:])


def test_png_keeps_what_does_not_depend_on_pixels():
    text = PngImagePlugin.PngInfo()
    text.add_text("Title", "An edge")
    Image.fromarray(picture()).save("in.png", pnginfo=text, icc_profile=PROFILE, dpi=(96, 96))
    insert("in.png", b"gAMA", struct.pack(">I", 45455))
    insert("in.png", b"iDOT", bytes(28))  # says where rows are stored: wrong in a copy
    sharpen("in.png", "out.png")
    result = opened("out.png")
    assert result.text == {"Title": "An edge"}
    assert result.info["gamma"] == 0.45455
    assert result.info["icc_profile"] == PROFILE
    assert np.allclose(result.info["dpi"], 96, atol=0.02)
    assert b"iDOT" in Path("in.png").read_bytes()
    assert b"iDOT" not in Path("out.png").read_bytes()


def test_deep_png_keeps_its_profile():
    write("in.png", picture(3, "uint16"))
    insert("in.png", b"gAMA", struct.pack(">I", 100000))
    sharpen("in.png", "out.png")
    assert opened("out.png").info["gamma"] == 1.0
    assert read("out.png").dtype == np.uint16


def test_tiff_keeps_profile_resolution_texts_and_foreign_tags():
    tifffile.imwrite(
        "in.tif",
        picture(3, "uint16"),
        photometric="rgb",
        compression="lzw",
        description="An edge",
        software="a camera",
        metadata=None,
        resolution=(300, 150),
        resolutionunit="INCH",
        iccprofile=PROFILE,
        extratags=[(33550, 12, 3, (1.0, 2.0, 0.0), True)],
    )
    assert sharpen("in.tif", "out.tif").notes == ()
    with tifffile.TiffFile("out.tif") as file:
        page = file.pages[0]
        assert page.description == "An edge"
        assert page.software == "a camera"
        assert page.iccprofile == PROFILE
        assert page.resolution == (300, 150)
        assert page.tags[33550].value == (1.0, 2.0, 0.0)
        assert page.compression == 8
    sharpen("in.tif", "out.png")
    assert opened("out.png").info["icc_profile"] == PROFILE
    assert np.allclose(opened("out.png").info["dpi"], (300, 150), atol=0.02)


def test_tiff_stored_in_planes_and_in_the_other_byte_order():
    pixels = picture(3, "uint16")
    tifffile.imwrite(
        "in.tif",
        np.moveaxis(pixels, 2, 0),
        photometric="rgb",
        planarconfig="separate",
        byteorder=">",
    )
    sharpen("in.tif", "out.tif")
    np.testing.assert_array_equal(read("out.tif"), core.sharpen_image(pixels, STRONG))


def test_tiff_of_gray_bands_stays_one():
    pixels = picture(5, "uint16")
    extra = ["unassalpha", "unspecified", "unspecified", "unspecified"]
    tifffile.imwrite("in.tif", pixels, photometric="minisblack", planarconfig="contig",
                     extrasamples=extra)  # fmt: skip
    sharpen("in.tif", "out.tif")
    np.testing.assert_array_equal(read("out.tif"), core.sharpen_image(pixels, STRONG))
    with tifffile.TiffFile("out.tif") as file:
        assert file.pages[0].photometric.name == "MINISBLACK"
        assert [sample.name.lower() for sample in file.pages[0].extrasamples] == extra


def test_tiff_with_an_unknown_kind_of_extra_channel_is_written():
    pixels = picture(4, "uint16")
    tifffile.imwrite("in.tif", pixels, photometric="rgb", extrasamples=["unassalpha"])
    with tifffile.TiffFile("in.tif") as file:
        at = file.pages[0].tags["ExtraSamples"].valueoffset
    damaged = bytearray(Path("in.tif").read_bytes())
    damaged[at : at + 2] = b"\xff\xff"
    Path("in.tif").write_bytes(damaged)
    sharpen("in.tif", "out.tif")
    assert read("out.tif").shape == pixels.shape


def test_exr_may_have_opacity_of_another_type():
    colors, opacity = picture(3, "float16"), np.ones(picture(1, "float32").shape[:2], np.float32)
    channels = {name: colors[..., at].copy() for at, name in enumerate("RGB")}
    write_exr("in.exr", {**channels, "A": opacity})
    assert sharpen("in.exr", "out.exr").notes == ("its channels of different types became float32",)
    assert read_exr("out.exr")[1]["RGBA"].dtype == np.float32


def test_a_larger_copy_of_a_map_covers_the_same_ground():
    matrix = (10.0, 0.0, 0.0, 7.0, 0.0, -20.0, 0.0, 8.0, *(4 * [0.0]), 0.0, 0.0, 0.0, 1.0)
    places = [
        (33550, 12, 3, (10.0, 20.0, 0.0), True),
        (33922, 12, 6, (1.0, 2.0, 0.0, 7.0, 8.0, 0.0), True),
        (34264, 12, 16, matrix, True),
    ]
    tifffile.imwrite("in.tif", picture(3, "uint8"), photometric="rgb", extratags=places)

    def doubled(pixels):
        return pixels.repeat(2, 0).repeat(2, 1)

    filter_image_file(doubled, "in.tif", "out.tif", times=2)
    with tifffile.TiffFile("out.tif") as file:
        tags = file.pages[0].tags
        assert tags[33550].value == (5.0, 10.0, 0.0)
        assert tags[33922].value == (2.0, 4.0, 0.0, 7.0, 8.0, 0.0)
        assert tags[34264].value == (5.0, 0.0, 0.0, 7.0, 0.0, -10.0, *matrix[6:])


def test_exr_keeps_header_and_other_channels():
    depth = picture(1, "float32") * 1e30
    depth[0, 0] = np.inf
    write_exr("in.exr", {"RGB": picture(3, "float16") * 4, "Z": depth}, comments="An edge")
    assert sharpen("in.exr", "out.exr").notes == ("the other channels (Z) stay as they are",)
    header, channels = read_exr("out.exr")
    assert header["comments"] == "An edge"
    assert channels["RGB"].dtype == np.float16
    assert channels["RGB"].max() > 1
    np.testing.assert_array_equal(channels["Z"], depth)
    left = sharpen("in.exr", "out.npy")
    assert left.notes == (".npy does not keep comments, the other channels (Z): left behind",)


def test_what_is_lost_is_said():
    image = Image.fromarray(picture())
    image.save("in.png", icc_profile=PROFILE, dpi=(300, 300), exif=exif())
    notes = sharpen("in.png", "out.bmp").notes
    assert notes == (".bmp does not keep EXIF, ICC profile: left behind",)
    notes = sharpen("in.png", "out.webp").notes
    assert notes == (".webp does not keep resolution: left behind",)
    assert opened("out.webp").info["icc_profile"] == PROFILE


# --------------------------------------------------------------------------------- unusual images


@pytest.mark.parametrize("clear, mode", [(None, "RGB"), (0, "RGBA")])
def test_palettes_become_channels(clear, mode):
    image = Image.fromarray(picture()).quantize(32)
    image.save("in.png", **({} if clear is None else {"transparency": clear}))
    outcome = sharpen("in.png", "out.png")
    assert outcome.notes == (f"its palette was replaced by {mode} channels",)
    result = opened("out.png")
    assert result.mode == mode
    wanted = core.sharpen_image(np.array(opened("in.png").convert(mode)), STRONG)
    np.testing.assert_array_equal(np.array(result), wanted)


def test_black_and_white_becomes_gray():
    Image.fromarray(picture(1) > 127).save("in.png")
    outcome = sharpen("in.png", "out.png", core.ImageSettings(time=64, smoothing_passes=3))
    assert opened("out.png").mode == "L"
    assert outcome.changed == 0 or outcome.notes == ("black and white became 8-bit gray",)


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_transparent_color_becomes_opacity(dtype):
    pixels = picture(3, dtype)
    write("in.png", pixels)
    insert("in.png", b"tRNS", struct.pack(">HHH", *pixels[0, 0].tolist()))
    outcome = sharpen("in.png", "out.png")
    assert outcome.notes == ("its transparent color became a channel of opacity",)
    result = read("out.png")
    assert result.dtype == pixels.dtype
    assert result.shape == (24, 30, 4)
    assert result[0, 0, 3] == 0
    assert result[0, -1, 3] == np.iinfo(dtype).max


def test_large_images_are_opened(monkeypatch):
    write("in.png", picture())
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)
    with pytest.raises(Image.DecompressionBombError):
        Image.open("in.png")
    assert sharpen("in.png", "out.png").changed > 0
    assert Image.MAX_IMAGE_PIXELS == 100


def test_readers_in_several_threads_leave_the_limit_as_it_was(monkeypatch):
    write("in.png", picture())
    limit, opening = Image.MAX_IMAGE_PIXELS, Image.open
    started, done = threading.Event(), threading.Event()

    def overlapping(*words, **options):
        if threading.current_thread() is second:
            started.set()
            done.wait(10)
        else:
            second.start()
            started.wait(0.3)  # in vain, if readers wait for each other
        return opening(*words, **options)

    second = threading.Thread(target=read_pillow, args=[Path("in.png")])
    monkeypatch.setattr(Image, "open", overlapping)
    read_pillow(Path("in.png"))
    done.set()
    second.join(10)
    assert started.is_set()
    assert limit == Image.MAX_IMAGE_PIXELS


def animated(name):
    frames = [Image.fromarray(picture()), Image.fromarray(picture()[::-1])]
    frames[0].save(name, save_all=True, append_images=frames[1:])


@pytest.mark.parametrize("name", ["in.png", "in.webp"])
def test_animations_are_refused(name):
    animated(name)
    with pytest.raises(core.ShockError, match="is animated; save its frames"):
        sharpen(name, "out.png")
    assert not Path("out.png").exists()


def test_tiff_of_pages_is_refused():
    tifffile.imwrite("in.tif", np.stack([picture(1)] * 3), photometric="minisblack")
    with pytest.raises(
        core.ShockError, match="not hold one picture alone; save its pages as files"
    ):
        sharpen("in.tif", "out.tif")


@pytest.mark.timeout(60)
def test_tiff_whose_pages_go_in_a_circle_is_refused():
    tifffile.imwrite("in.tif", picture(1), photometric="minisblack")
    data = bytearray(Path("in.tif").read_bytes())
    (first,) = struct.unpack_from("<I", data, 4)
    (tags,) = struct.unpack_from("<H", data, first)
    struct.pack_into("<I", data, first + 2 + 12 * tags, first)  # where the next page stands
    Path("in.tif").write_bytes(data)
    with pytest.raises(core.ShockError, match="not hold one picture alone"):
        sharpen("in.tif", "out.tif")


def test_damaged_arrays_are_refused():
    np.save("in.npy", picture(1))
    data = Path("in.npy").read_bytes()
    Path("in.npy").write_bytes(data.replace(b"{", b" "))
    with pytest.raises(core.ShockError, match=r"in\.npy cannot be read; is it damaged"):
        sharpen("in.npy", "out.npy")


def test_ink_colors_are_refused():
    Image.fromarray(picture()).convert("CMYK").save("in.jpg")
    with pytest.raises(core.ShockError, match="CMYK colors; convert it to gray, RGB"):
        sharpen("in.jpg", "out.jpg")
    tifffile.imwrite("in.tif", picture(4), photometric="separated")
    with pytest.raises(core.ShockError, match="has CMYK colors; convert it to gray or RGB"):
        sharpen("in.tif", "out.tif")


def test_exr_without_colors_is_refused():
    write_exr("in.exr", {"Z": picture(1, "float32")})
    with pytest.raises(core.ShockError, match="no channels R, G, B or Y; it has: Z"):
        sharpen("in.exr", "out.exr")


@pytest.mark.parametrize(
    "source, channels, dtype, target, others",
    [
        ("in.png", 4, "uint8", "out.jpg", ".png, .tif, .tiff, .bmp, .webp, .npy"),
        ("in.png", 3, "uint16", "out.jpg", ".png, .tif, .tiff, .npy"),
        ("in.tif", 3, "float32", "out.png", ".tif, .tiff, .exr, .npy"),
        ("in.exr", 3, "float16", "out.tif", ".exr, .npy"),
        ("in.png", 2, "uint8", "out.bmp", ".png, .tif, .tiff, .npy"),
    ],
)
def test_formats_that_cannot_hold_the_values_are_refused(source, channels, dtype, target, others):
    write(source, picture(channels, dtype))
    with pytest.raises(core.ShockError, match=f"cannot hold {channels} channels of {dtype}; ") as e:
        sharpen(source, target)
    assert str(e.value).endswith(f"write one of {others}.")
    assert not Path(target).exists()


@pytest.mark.parametrize("name", ["in.png", "in.jpg", "in.bmp", "in.webp", "in.tif", "in.exr"])
@pytest.mark.parametrize("damage", ["no image", "cut"])
def test_damaged_files_are_refused(name, damage):
    if name == "in.exr":
        write(name, picture(3, "float32", size=(200, 300)))
    else:
        write(name, picture(size=(200, 300)))
    data = Path(name).read_bytes()
    Path(name).write_bytes(b"hello world" if damage == "no image" else data[: len(data) // 2])
    with pytest.raises(core.ShockError, match=f"{name} cannot be read; "):
        sharpen(name, "out.tif")
    assert [path.name for path in Path.cwd().iterdir()] == [name]


def test_other_bad_inputs():
    Path("empty.png").touch()
    Path("folder.png").mkdir()
    Path("in.gif").touch()
    np.save("words.npy", np.array(["a", "b"]))
    np.save("line.npy", np.zeros(5, dtype=np.uint8))
    np.save("objects.npy", np.array([{}]), allow_pickle=True)
    np.save("nan.npy", np.full((4, 4), np.nan))
    np.save("signed.npy", np.zeros((4, 4), dtype=np.int32))
    for name, sentence in {
        "empty.png": "empty.png is empty",
        "folder.png": "folder.png is a folder",
        "gone.png": "no file gone.png",
        "in.gif": "in.gif: cannot handle this ending; use one of .png, ",
        "words.npy": "values of type <U1",
        "line.npy": r"shape \(5,\); give \(h, w\)",
        "objects.npy": "objects.npy cannot be read",
        "nan.npy": "holds NaN or infinity",
        "signed.npy": "values of type int32; save it with 8 or 16 bits",
    }.items():
        with pytest.raises(core.ShockError, match=sentence):
            sharpen(name, "out.npy")
        assert not Path("out.npy").exists()
    write("in.png", picture())
    with pytest.raises(core.ShockError, match="no folder deep"):
        sharpen("in.png", "deep/out.png")
    with pytest.raises(core.ShockError, match=r"out\.gif: cannot handle this ending"):
        sharpen("in.png", "out.gif")


def test_missing_packages_are_named(monkeypatch):
    write("in.png", picture(3, "uint16"))
    write("in.exr", picture(3, "float32"))
    write("in.tif", picture())
    for name, package in {"exr": "OpenEXR", "tif": "tifffile", "png": "imagecodecs"}.items():
        monkeypatch.setitem(sys.modules, package, None)
        with pytest.raises(core.ShockError, match=rf"{package}; run: pip install .*\[files\]"):
            sharpen("in." + name, "out." + name)


# ------------------------------------------------------------------------------------------- masks


@pytest.mark.parametrize("name", ["mask.png", "mask.tif", "mask.npy"])
@pytest.mark.parametrize("invert", [False, True])
def test_mask(name, invert):
    pixels = picture(3, "uint16")
    write("in.png", pixels)
    dtype = {"mask.png": "uint16", "mask.tif": "uint8", "mask.npy": "float32"}[name]
    mask = np.zeros((24, 30), dtype=dtype)
    mask[:12] = 1 if dtype == "float32" else np.iinfo(dtype).max
    write(name, mask)
    sharpen("in.png", "out.png", mask=name, invert_mask=invert)
    free = np.zeros((24, 30), dtype=bool)
    free[:12] = True
    free ^= invert
    result, whole = read("out.png"), core.sharpen_image(pixels, STRONG)
    np.testing.assert_array_equal(result[~free], pixels[~free])
    np.testing.assert_array_equal(result[free], whole[free])
    assert (whole[free] != pixels[free]).any()


def test_bad_masks():
    write("in.png", picture())
    write("colors.png", picture())
    write("small.png", picture(1, size=(5, 6)))
    for mask, sentence in {
        "colors.png": "colors.png: the mask has colors or opacity",
        "small.png": r"mask has the shape \(5, 6\); give \(24, 30\)",
        "gone.png": "no file gone.png",
    }.items():
        with pytest.raises(core.ShockError, match=sentence):
            sharpen("in.png", "out.png", mask=mask)


# ---------------------------------------------------------------------------- files of any size


def test_a_file_may_replace_itself():
    pixels = picture()
    for name in ("in.npy", "in.png"):
        write(name, pixels)
        with pytest.raises(core.ShockError, match="exists already; add --overwrite"):
            sharpen(name, name)
        np.testing.assert_array_equal(read(name), pixels)
        sharpen(name, name, overwrite=True)
        np.testing.assert_array_equal(read(name), core.sharpen_image(pixels, STRONG))


MEASURE = """
import sys, threading
from shock_filter import core
from shock_filter.core.files.images import filter_image_file
from shock_filter.core.files.output import Options

def anonymous():
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("RssAnon"))

peak = 0
def watch(fraction, message):
    global peak
    peak = max(peak, anonymous())
    return True

def sharpen(pixels, mask=None, out=None):
    return core.sharpen_image(pixels, core.ImageSettings(time=16), mask=mask, out=out)

filter_image_file(sharpen, "small.npy", "small_out.npy")  # compiles
before = anonymous()
filter_image_file(sharpen, "in.npy", "out.npy", Options(progress=watch))
print(1024 * (peak - before))
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="memory is read from /proc")
def test_arrays_are_not_loaded():
    size = (2500, 3000)
    write("small.npy", picture())
    write("in.npy", picture(size=size))
    run = subprocess.run(
        [sys.executable, "-c", MEASURE], capture_output=True, text=True, timeout=300
    )
    assert run.returncode == 0, run.stderr
    # 8 bytes a pixel for the flow; image and result, 6 more, stay on disk.
    assert 3 < int(run.stdout) / (size[0] * size[1]) < 12
    np.testing.assert_array_equal(
        np.load("out.npy"), core.sharpen_image(np.load("in.npy"), core.ImageSettings(time=16))
    )


@pytest.mark.skipif(sys.platform == "win32", reason="files there have room by themselves")
def test_arrays_take_their_room_on_the_disk_before_they_are_filled():
    write("in.npy", picture(size=(300, 400)))

    def watch(fraction, message):
        staged = next(Path().glob(".shock-filter-*/files/out.npy"))
        assert 512 * staged.stat().st_blocks >= 300 * 400 * 3
        seen.append(fraction)
        return True

    seen = []
    sharpen("in.npy", "out.npy", progress=watch)
    assert seen


@pytest.mark.parametrize("name", ["in.png", "in.tif", "in.exr", "in.jpg", "in.npy"])
def test_a_full_disk_fails_and_leaves_nothing(name):
    resource = pytest.importorskip("resource")  # a limit to files' sizes stands in
    dtype = "float32" if name == "in.exr" else "uint8"
    write(name, (np.random.default_rng(0).random((99, 99, 3)) * 255).astype(dtype))
    sharpen(name, f"out{Path(name).suffix}")  # kernels are kept in files, too
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, hard))
    try:
        with pytest.raises(core.ShockError, match=r"The disk of .* is full .*; make room"):
            sharpen(name, f"full{Path(name).suffix}")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not list(Path().glob("*full*"))
    assert not list(Path().glob(".*"))


def test_changes_far_down_are_written():
    pixels = np.full((700, 8), 60, dtype=np.uint8)
    pixels[650:, 4:] = 180
    pixels[650:, 4] = 90  # the one soft edge
    write("in.png", pixels)
    assert sharpen("in.png", "out.png", core.ImageSettings(time=4)).changed > 0
    assert (read("out.png") != pixels).any(axis=1).nonzero()[0].min() > 600


# ------------------------------------------------------------------------------------ command line


def test_command_line(capsys):
    for name in ("a.png", "b.png", "c.tif", "in/d.png"):
        Path(name).parent.mkdir(exist_ok=True)
        write(name, picture(3, "uint16"))
    Path("bad.png").write_text("no image")
    write("mask.png", picture(1) * 0)
    words = ["[abc].*", "bad.png", "in/**/d.png", "out", "--time", "64"]
    assert cli.main(["sharpen-image", *words]) == 1
    out, err = capsys.readouterr()
    names = sorted(path.name for path in Path("out").iterdir())
    assert names == ["a.png", "b.png", "c.tif", "d.png"]
    np.testing.assert_array_equal(read("out/a.png"), core.sharpen_image(read("a.png"), STRONG))
    assert len(out.splitlines()) == 4
    assert out.startswith("a.png -> out/a.png: changed ".replace("/", Path("/").root))
    assert " of 720 pixels in " in out
    assert err == "Failed: bad.png cannot be read; " + err.partition("cannot be read; ")[2]
    words = ["a.png", "masked.png", "--mask", "mask.png", "--quiet", "--time", "64"]
    assert cli.main(["sharpen-image", *words]) == 0
    assert Path("masked.png").read_bytes() == Path("a.png").read_bytes()
    assert capsys.readouterr().out == ""
    assert cli.main(["sharpen-image", *words, "--invert-mask", "--overwrite"]) == 0
    assert Path("masked.png").read_bytes() != Path("a.png").read_bytes()


def test_what_counts_of_the_whole_may_be_that_of_another_image():
    first = picture(3, size=(64, 64))
    rng = np.random.default_rng(0)
    second = np.clip(first + rng.normal(scale=12.0, size=first.shape), 0, 255).astype(np.uint8)
    write("first.png", first)
    write("second.png", second)
    assert cli.main(["sharpen-image", "second.png", "own.png", "--quiet"]) == 0
    assert cli.main(["sharpen-image", "second.png", "like.png", "--like", "first.png"]) == 0
    wanted = core.sharpen_image(second, known=measure_image(first))
    found = np.asarray(Image.open("like.png"))
    np.testing.assert_array_equal(found, wanted)
    assert (found != np.asarray(Image.open("own.png"))).any()


def test_an_image_to_measure_in_that_is_missing_is_named(capsys):
    write("first.png", picture(3))
    words = ["sharpen-image", "first.png", "out.png", "--like", "none.png"]
    assert cli.main(words) != 0
    assert "none.png" in capsys.readouterr().err
    assert not Path("out.png").exists()


@pytest.mark.parametrize("shape", [(0, 4), (4, 0, 3), (0, 0, 3), (4, 4, 0)])
def test_images_without_pixels_are_refused(shape):
    np.save("in.npy", np.zeros(shape, dtype=np.uint8))
    with pytest.raises(core.ShockError, match=r"has the shape .*; give \(h, w\)"):
        read_pixels("in.npy", any_size=False)


@pytest.mark.parametrize("name", ["in.png", "in.jpg", "in.tif", "in.exr", "in.npy"])
def test_files_without_bytes_are_refused(name):
    Path(name).write_bytes(b"")
    with pytest.raises(core.ShockError, match="is empty; copy or save it again"):
        read_pixels(name, any_size=False)
