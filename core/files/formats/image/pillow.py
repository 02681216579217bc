# SPDX-License-Identifier: GPL-3.0-or-later
"""PNG, JPEG, BMP and WebP files, read and written by Pillow; 16-bit PNG by imagecodecs."""

from __future__ import annotations

import io
import logging
import struct
import threading
import warnings
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ....errors import ShockError
from ...reading import check_claim, needed
from .image_file import EXIF, ICC, RESOLUTION, XMP, ImageFile, lost
from .orientation import UPRIGHT, exif_orientation, upright_exif, xmp_orientation
from .thumbnails import without_exif_thumbnail, without_photoshop_thumbnail

logging.getLogger("PIL").addHandler(logging.NullHandler())  # otherwise it prints warnings

_READABLE = ("PNG", "JPEG", "BMP", "DIB", "WEBP")
_INFO = {ICC: "icc_profile", RESOLUTION: "dpi", EXIF: "exif", XMP: "xmp"}
_KEPT = {
    "PNG": {ICC, RESOLUTION, EXIF, XMP},
    "JPEG": {ICC, RESOLUTION, EXIF, XMP},
    "WEBP": {ICC, EXIF, XMP},
    "BMP": {RESOLUTION},
}
_PLAIN_MODES = ("L", "LA", "RGB", "RGBA")
SIGNATURE = b"\x89PNG\r\n\x1a\n"
# Chunks of a PNG that say what values mean, and also hold for other values.
_MEANING = (b"cHRM", b"gAMA", b"iCCP", b"sRGB", b"cICP", b"mDCV", b"cLLI")
_CARRIED = (b"iCCP", b"pHYs", b"eXIf")
_XMP_KEY = b"XML:com.adobe.xmp"
# Parts of a JPEG that are read elsewhere, or only say how it is stored.
_KNOWN_JPEG = (
    *(b"JFIF", b"Exif\0", b"http://ns.adobe.com/xap/1.0/\0", b"ICC_PROFILE\0", b"MPF\0"),
    *(b"Adobe", b"Photoshop 3.0\0"),
)
_BMP_HEADER, _MASKED = 108, 3
_BMP_PROFILES = (b"DEBM", b"KNIL")
_EXIF_MARK = b"Exif\0\0"
_LIMIT = threading.Lock()
_OF_ANY_SIZE = (b"tEXt", b"zTXt", b"iTXt", b"iCCP")
_PIECE = 1 << 20
_OLD_THUMBNAIL = "its thumbnail, which shows the old picture: left behind"
_CLEAR_COLOR = "its transparent color became a channel of opacity"


def read_pillow(path: Path) -> ImageFile:
    """Read a PNG, JPEG, BMP or WebP file, whatever its name says."""
    png = _read_png_bytes(path)
    with opened(path, png) as image:
        if getattr(image, "is_animated", False) and image.format != "MPO":
            raise ShockError(f"{path} is animated; save its frames as files, and name these.")
        width, height = image.size
        check_claim(path, width * height * len(image.getbands()))
        about = {key: image.info[name] for key, name in _INFO.items() if image.info.get(name)}
        about |= png.about() if png else {}
        image_file = ImageFile(np.empty(0), image.format or "", about)
        if EXIF in about:
            exif, had_thumbnail = without_exif_thumbnail(about[EXIF].removeprefix(_EXIF_MARK))
            about[EXIF] = exif
            if had_thumbnail:
                image_file.notes.append(_OLD_THUMBNAIL)
        image_file.orientation = _orientation(about)
        if png is not None:
            data = png.pixels
            image_file.own, damaged, stale = _lasting_chunks(png.data)
            for what, kinds in (
                ("damaged parts of the file", damaged),
                ("parts that hold for the old pixels only", stale),
            ):
                if kinds:
                    image_file.notes.append(f"{what} ({_kinds(kinds)}): left behind")
            image_file.only_own = _only_png(image_file.own)
            bits, is_gray = data[24], data[25] == 0
            # Pillow takes a transparent color of fewer than 8 bits for one of 8 bits.
            if bits == 16 or (bits < 8 and is_gray and "transparency" in image.info):
                if "transparency" in image.info:
                    image_file.notes.append(_CLEAR_COLOR)
                image_file.pixels = needed("imagecodecs", path).png_decode(data)
                return image_file
        if image.format in ("JPEG", "MPO"):
            image_file.own, had_thumbnail = _jpeg_options(image)
            if had_thumbnail and _OLD_THUMBNAIL not in image_file.notes:
                image_file.notes.append(_OLD_THUMBNAIL)
            others = {name for name, data in image.applist if not data.startswith(_KNOWN_JPEG)}
            if others - {"COM"}:
                image_file.notes.append(f"{', '.join(sorted(others - {'COM'}))} data: left behind")
            given = {"comment": "comment", "extra": "IPTC"}
            image_file.only_own = [given[key] for key in image_file.own if key in given]
        if image.format in ("BMP", "DIB") and path.read_bytes()[70:74] in _BMP_PROFILES:
            image_file.notes.append("its color profile: left behind")
        if image.format == "MPO":
            image_file.notes.append("further pictures in the file (previews, depth): left behind")
        image_file.pixels = np.array(_plain(image, path, image_file.notes))
    return image_file


def opened(path: Path, png: _PngBytes | None = None) -> Any:
    """Read the header of an image of any size.

    Pillow refuses large images, as servers open files of strangers; here a person named the file.
    Its limit and its warnings are shared by all threads.
    """
    needed("PIL", path)
    from PIL import Image

    with _LIMIT, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about EXIF data
        limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            return Image.open(io.BytesIO(png.pixels) if png else path, formats=_READABLE)
        finally:
            Image.MAX_IMAGE_PIXELS = limit


def _orientation(about: dict[str, Any]) -> int:
    """Return the orientation of EXIF data, or if there is none, of XMP data."""
    stated = exif_orientation(about.get(EXIF, b""))
    return stated or xmp_orientation(about.get(XMP, b"")) or UPRIGHT


def _plain(image: Any, path: Path, notes: list[str]) -> Any:
    """The image with gray or RGB channels of 8 bits."""
    clear = "transparency" in image.info
    if image.mode in _PLAIN_MODES and not clear:
        return image
    if image.mode == "1":
        notes.append("black and white became 8-bit gray")
        return image.convert("L")
    if image.mode in ("P", "PA"):
        mode = "RGBA" if clear or image.mode == "PA" else "RGB"
        notes.append(f"its palette was replaced by {mode} channels")
        return image.convert(mode)
    if image.mode in _PLAIN_MODES:
        mode = "LA" if image.mode == "L" else "RGBA"
        notes.append(_CLEAR_COLOR)
        return image.convert(mode)
    raise ShockError(f"{path} has {image.mode} colors; convert it to gray, RGB or RGBA first.")


# --------------------------------------------------------------------------------------------- PNG


class _PngBytes:
    """A PNG file in memory: complete, and without texts and profiles, which may have any size.

    Libraries refuse texts of more than a megabyte, which photo editors write.
    """

    def __init__(self, path: Path, data: bytes) -> None:
        self._path, self.data = path, data
        self._profile = self._xmp = self._exif = b""
        kept, place = [SIGNATURE], len(SIGNATURE)
        while place + 12 <= len(data):
            length, kind = struct.unpack_from(">I4s", data, place)
            end = place + 12 + length
            content = data[place + 8 : end - 4]
            if kind == b"iCCP":
                self._profile = self._profile or content
            elif kind == b"eXIf":
                self._exif = self._exif or content
            elif kind == b"iTXt" and content.startswith(_XMP_KEY + b"\0"):
                self._xmp = self._xmp or content
            if kind not in _OF_ANY_SIZE:
                kept.append(data[place:end])
            place = end
            if kind == b"IEND":
                break
        self.pixels = b"".join([*kept, data[place:]])

    def about(self) -> dict[str, Any]:
        """Return those of profile, EXIF and XMP that can be read."""
        _, _, profile = self._profile.partition(b"\0")
        found = {ICC: self._inflated(profile[1:]), EXIF: self._exif}
        rest = self._xmp[len(_XMP_KEY) + 1 :]
        is_packed = rest[:1] == b"\1"
        _, _, text = rest[2:].partition(b"\0")  # after a language
        _, _, text = text.partition(b"\0")  # and the translated keyword
        found[XMP] = self._inflated(text) if is_packed else text
        return {name: value for name, value in found.items() if value}

    def _inflated(self, data: bytes) -> bytes:
        whole = zlib.decompressobj()
        parts, size = [], 0
        try:
            while data and not whole.eof:
                parts.append(whole.decompress(data, _PIECE))
                data = whole.unconsumed_tail
                size += len(parts[-1])
                check_claim(self._path, size)
        except zlib.error:
            return b""
        return b"".join(parts) if whole.eof else b""


def _read_png_bytes(path: Path) -> _PngBytes | None:
    with path.open("rb") as stream:
        if stream.read(len(SIGNATURE)) != SIGNATURE:
            return None
    return _PngBytes(path, path.read_bytes())


def write_png(path: Path, image_file: ImageFile, pixels: npt.NDArray[Any]) -> list[str]:
    """Write 8 or 16 bits; the metadata of a PNG source are kept."""
    if pixels.dtype == np.uint16:
        data = needed("imagecodecs", path).png_encode(pixels)
    else:
        data = _encoded_png(pixels)
    chunks = image_file.own
    if image_file.format != "PNG":
        chunks, *_ = _lasting_chunks(_encoded_png(np.zeros((1, 1), np.uint8), image_file.about))
    start = len(SIGNATURE) + 25  # after the header chunk
    path.write_bytes(b"".join([data[:start], *chunks, data[start:]]))
    return lost(image_file, path, _KEPT["PNG"], "PNG")


def _encoded_png(pixels: npt.NDArray[Any], about: dict[str, Any] | None = None) -> bytes:
    from PIL import Image, PngImagePlugin

    options = _options(about or {}, "PNG")
    if XMP in (about or {}):
        options["pnginfo"] = PngImagePlugin.PngInfo()
        options["pnginfo"].add_itxt(_XMP_KEY, options.pop("xmp"))
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG", **options)
    return stream.getvalue()


def _lasting_chunks(data: bytes) -> tuple[list[bytes], list[bytes], list[bytes]]:
    """The chunks of a PNG file that stay true when its pixels change.

    Also the kinds of damaged chunks, and of those that hold for the old pixels only. Data behind
    the file's end are ignored.
    """
    found, damaged, stale, place = [], [], [], len(SIGNATURE)
    while place + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, place)
        if kind == b"IEND":
            break
        whole = data[place : place + 12 + length]
        optional, safe = kind[0:1].islower(), kind[3:4].islower()  # defined by the standard
        if kind in _MEANING or (optional and safe and kind != b"fdAT"):
            if whole == chunk(kind, whole[8 : 8 + length]):
                if kind == b"eXIf":
                    whole = chunk(kind, without_exif_thumbnail(whole[8:-4])[0])
                found.append(whole)
            else:
                damaged.append(kind)
        elif optional and kind != b"tRNS":  # tRNS became opacity
            stale.append(kind)
        place += 12 + length
    return found, damaged, stale


def make_chunks_upright(image_file: ImageFile, was_transposed: bool) -> None:
    """Set the orientation in a PNG's own chunks to upright, after its pixels were rotated."""
    chunks = []
    for whole in image_file.own:
        kind, content = whole[4:8], whole[8:-4]
        if kind == b"eXIf":
            content = upright_exif(content)
        elif kind == b"pHYs" and was_transposed:
            content = content[4:8] + content[:4] + content[8:]
        elif kind == b"iTXt" and content.startswith(_XMP_KEY + b"\0") and XMP in image_file.about:
            content = _XMP_KEY + bytes(5) + image_file.about[XMP]
        chunks.append(chunk(kind, content))
    image_file.own = chunks


def _kinds(kinds: list[bytes]) -> str:
    return ", ".join(sorted({kind.decode("latin-1") for kind in kinds}))


def _only_png(chunks: list[bytes]) -> list[str]:
    """Names of a PNG's lasting chunks that other formats leave behind."""
    others = (each for each in chunks if each[4:8] not in _CARRIED and _XMP_KEY not in each[8:40])
    return list({chunk[4:8].decode() for chunk in others})


def chunk(kind: bytes, data: bytes) -> bytes:
    body = kind + data
    return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))


# ----------------------------------------------------------------------------- JPEG, WebP and BMP


def _jpeg_options(image: Any) -> tuple[dict[str, Any], bool]:
    """Options for a copy of the original's quality, and whether an old thumbnail was left out."""
    from PIL import JpegImagePlugin

    options: dict[str, Any] = {"qtables": image.quantization}
    sampling = JpegImagePlugin.get_sampling(image)
    if sampling >= 0:
        options["subsampling"] = sampling
    if "comment" in image.info:
        options["comment"] = image.info["comment"]
    blocks = [data for _, data in image.applist if data.startswith(b"Photoshop 3.0\0")]
    cleaned = [without_photoshop_thumbnail(data) for data in blocks]
    if blocks:  # IPTC: captions and copyright
        parts = (b"\xff\xed" + struct.pack(">H", len(data) + 2) + data for data, _ in cleaned)
        options["extra"] = b"".join(parts)
    return options, any(had for _, had in cleaned)


def write_jpeg(path: Path, image_file: ImageFile, pixels: npt.NDArray[Any]) -> list[str]:
    """Write with the source's quality if the source is a JPEG too."""
    options = {"quality": 95, "subsampling": 0}
    if image_file.format in ("JPEG", "MPO"):
        options = image_file.own
    notes = _save(path, "JPEG", image_file, pixels, **options)
    return ["JPEG is lossy: all pixels were compressed anew", *notes]


def write_webp(path: Path, image_file: ImageFile, pixels: npt.NDArray[Any]) -> list[str]:
    """Write lossless WebP."""
    return _save(path, "WEBP", image_file, pixels, lossless=True, exact=True)


def write_bmp(path: Path, image_file: ImageFile, pixels: npt.NDArray[Any]) -> list[str]:
    """Write without compression; opacity needs the fourth version of the header."""
    if pixels.ndim == 2 or pixels.shape[2] == 3:
        return _save(path, "BMP", image_file, pixels)
    height, width = pixels.shape[:2]
    x, y = image_file.about.get(RESOLUTION, (0, 0))
    per_meter = [round(float(each) / 0.0254) for each in (x, y)]
    start = 14 + _BMP_HEADER
    size = pixels.size
    header = struct.pack("<2sI4xI", b"BM", start + size, start)
    header += struct.pack("<IiiHHIIiiII", _BMP_HEADER, width, height, 1, 32, _MASKED, size,
                          *per_meter, 0, 0)  # fmt: skip
    header += struct.pack("<4I4s48x", 0xFF0000, 0xFF00, 0xFF, 0xFF000000, b"BGRs")
    path.write_bytes(header + pixels[::-1, :, [2, 1, 0, 3]].tobytes())
    return lost(image_file, path, _KEPT["BMP"], "BMP")


def _save(
    path: Path, name: str, image_file: ImageFile, pixels: npt.NDArray[Any], **options: Any
) -> list[str]:
    needed("PIL", path)
    from PIL import Image

    Image.fromarray(pixels).save(path, name, **_options(image_file.about, name), **options)
    return lost(image_file, path, _KEPT[name], name)


def _options(about: dict[str, Any], name: str) -> dict[str, Any]:
    """Pillow's options for a picture's metadata, as far as a format keeps them."""
    options = {_INFO[key]: value for key, value in about.items() if key in _KEPT[name]}
    if "exif" in options:
        options["exif"] = _EXIF_MARK + options["exif"]
    return options
