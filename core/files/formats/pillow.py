# SPDX-License-Identifier: GPL-3.0-or-later
"""PNG, JPEG, BMP and WebP files, read and written by Pillow; 16-bit PNG by imagecodecs."""

from __future__ import annotations

import struct
import threading
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...errors import ShockError
from ..image_file import EXIF, ICC, RESOLUTION, XMP, ImageFile, lost
from ..reading import needed

_READABLE = ("PNG", "JPEG", "BMP", "DIB", "WEBP")
_INFO = {ICC: "icc_profile", RESOLUTION: "dpi", EXIF: "exif", XMP: "xmp"}
_PLAIN_MODES = ("L", "LA", "RGB", "RGBA")
_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# Parts of a PNG that say how values are meant, so that they stay true for other values.
_MEANING = (b"cHRM", b"gAMA", b"iCCP", b"sRGB", b"cICP", b"mDCV", b"cLLI")
_EXIF_MARK = b"Exif\0\0"
_LIMIT = threading.Lock()
_CLEAR_COLOR = "its transparent color became a channel of opacity"


def read_pillow(path: Path) -> ImageFile:
    """Read a PNG, JPEG, BMP or WebP file, whatever its name says."""
    with _opened(path) as image:
        if getattr(image, "is_animated", False) and image.format != "MPO":
            raise ShockError(f"{path} is animated; save its frames as files, and name these.")
        about = {key: image.info[name] for key, name in _INFO.items() if image.info.get(name)}
        if EXIF in about:
            about[EXIF] = about[EXIF].removeprefix(_EXIF_MARK)
        image_file = ImageFile(np.empty(0), image.format or "", about)
        if image.format == "PNG":
            data = path.read_bytes()
            image_file.own = _lasting_chunks(data)
            if data[24] == 16:
                if "transparency" in image.info:
                    image_file.notes.append(_CLEAR_COLOR)
                image_file.pixels = _decode_deep_png(data, path)
                return image_file
        if image.format in ("JPEG", "MPO"):
            image_file.own = _jpeg_options(image)
        if image.format == "MPO":
            image_file.notes.append("further pictures in the file (previews, depth): left behind")
        image_file.pixels = np.array(_plain(image, path, image_file.notes))
    return image_file


def _opened(path: Path) -> Any:
    """Read the header of an image of any size.

    Pillow refuses large images, since servers open what strangers send; here a person named it.
    Its limit is one for all threads.
    """
    needed("PIL", path)
    from PIL import Image

    with _LIMIT:
        limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            return Image.open(path, formats=_READABLE)
        finally:
            Image.MAX_IMAGE_PIXELS = limit


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


def write_png(path: Path, image_file: ImageFile, pixels: npt.NDArray[Any]) -> list[str]:
    """Write 8 or 16 bits; what the source PNG says beside its pixels is kept."""
    if pixels.dtype == np.uint16:
        data = needed("imagecodecs", path).png_encode(pixels)
    else:
        data = _encoded_png(pixels)
    chunks = image_file.own if image_file.format == "PNG" else _new_chunks(image_file.about)
    start = len(_SIGNATURE) + 25  # after the header chunk
    path.write_bytes(b"".join([data[:start], *chunks, data[start:]]))
    return []


def _encoded_png(pixels: npt.NDArray[Any]) -> bytes:
    import io

    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG")
    return stream.getvalue()


def _decode_deep_png(data: bytes, path: Path) -> npt.NDArray[Any]:
    return needed("imagecodecs", path).png_decode(data)


def _lasting_chunks(data: bytes) -> list[bytes]:
    """The parts of a PNG file that stay true when its pixels change."""
    found, place = [], len(_SIGNATURE)
    while place + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, place)
        kind = data[place + 4 : place + 8]
        optional, safe = kind[0:1].islower(), kind[3:4].islower()  # as the standard defines
        if kind in _MEANING or (optional and safe and kind != b"fdAT"):
            found.append(data[place : place + 12 + length])
        place += 12 + length
    return found


def _new_chunks(about: dict[str, Any]) -> list[bytes]:
    chunks = []
    if ICC in about:
        chunks.append(_chunk(b"iCCP", b"ICC profile\0\0" + zlib.compress(about[ICC])))
    if RESOLUTION in about:
        x, y = (round(float(inch) / 0.0254) for inch in about[RESOLUTION])
        chunks.append(_chunk(b"pHYs", struct.pack(">IIB", x, y, 1)))
    if EXIF in about:
        chunks.append(_chunk(b"eXIf", about[EXIF]))
    if XMP in about:
        chunks.append(_chunk(b"iTXt", b"XML:com.adobe.xmp\0\0\0\0\0" + about[XMP]))
    return chunks


def _chunk(kind: bytes, data: bytes) -> bytes:
    body = kind + data
    return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))


# ----------------------------------------------------------------------------- JPEG, WebP and BMP


def _jpeg_options(image: Any) -> dict[str, Any]:
    """What makes the copy as fine as the original."""
    from PIL import JpegImagePlugin

    options: dict[str, Any] = {"qtables": image.quantization}
    sampling = JpegImagePlugin.get_sampling(image)
    if sampling >= 0:
        options["subsampling"] = sampling
    if "comment" in image.info:
        options["comment"] = image.info["comment"]
    return options


def write_jpeg(path: Path, image_file: ImageFile, pixels: npt.NDArray[Any]) -> list[str]:
    """Write with the source's quality if it is a JPEG too."""
    options = {"quality": 95, "subsampling": 0}
    if image_file.format in ("JPEG", "MPO"):
        options = image_file.own
    kept = {ICC, RESOLUTION, EXIF, XMP}
    _save(path, "JPEG", image_file, pixels, kept, **options)
    return ["JPEG is lossy: all pixels were compressed anew", *lost(image_file, path, kept)]


def write_webp(path: Path, image_file: ImageFile, pixels: npt.NDArray[Any]) -> list[str]:
    """Write without loss."""
    kept = {ICC, EXIF, XMP}
    _save(path, "WEBP", image_file, pixels, kept, lossless=True, exact=True)
    return lost(image_file, path, kept)


def write_bmp(path: Path, image_file: ImageFile, pixels: npt.NDArray[Any]) -> list[str]:
    """Write without compression."""
    _save(path, "BMP", image_file, pixels, {RESOLUTION})
    return lost(image_file, path, {RESOLUTION})


def _save(
    path: Path,
    name: str,
    image_file: ImageFile,
    pixels: npt.NDArray[Any],
    kept: set[str],
    **options: Any,
) -> None:
    needed("PIL", path)
    from PIL import Image

    options |= {_INFO[key]: value for key, value in image_file.about.items() if key in kept}
    if "exif" in options:
        options["exif"] = _EXIF_MARK + options["exif"]
    Image.fromarray(pixels).save(path, name, **options)
