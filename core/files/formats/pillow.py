# SPDX-License-Identifier: GPL-3.0-or-later
"""PNG, JPEG, BMP and WebP files, read and written by Pillow; 16-bit PNG by imagecodecs."""

from __future__ import annotations

import struct
import threading
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...errors import ShockError
from ..image_file import EXIF, ICC, RESOLUTION, XMP, ImageFile, lost
from ..reading import needed

_READABLE = ("PNG", "JPEG", "BMP", "DIB", "WEBP")
_INFO = {ICC: "icc_profile", RESOLUTION: "dpi", EXIF: "exif", XMP: "xmp"}
_KEPT = {
    "PNG": {ICC, RESOLUTION, EXIF, XMP},
    "JPEG": {ICC, RESOLUTION, EXIF, XMP},
    "WEBP": {ICC, EXIF, XMP},
    "BMP": {RESOLUTION},
}
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
                image_file.pixels = needed("imagecodecs", path).png_decode(data)
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
    chunks = image_file.own
    if image_file.format != "PNG":
        chunks = _lasting_chunks(_encoded_png(np.zeros((1, 1), np.uint8), image_file.about))
    start = len(_SIGNATURE) + 25  # after the header chunk
    path.write_bytes(b"".join([data[:start], *chunks, data[start:]]))
    return []


def _encoded_png(pixels: npt.NDArray[Any], about: dict[str, Any] | None = None) -> bytes:
    import io

    from PIL import Image, PngImagePlugin

    options = _options(about or {}, "PNG")
    if XMP in (about or {}):
        options["pnginfo"] = PngImagePlugin.PngInfo()
        options["pnginfo"].add_itxt("XML:com.adobe.xmp", options.pop("xmp"))
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG", **options)
    return stream.getvalue()


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
    notes = _save(path, "JPEG", image_file, pixels, **options)
    return ["JPEG is lossy: all pixels were compressed anew", *notes]


def write_webp(path: Path, image_file: ImageFile, pixels: npt.NDArray[Any]) -> list[str]:
    """Write without loss."""
    return _save(path, "WEBP", image_file, pixels, lossless=True, exact=True)


def write_bmp(path: Path, image_file: ImageFile, pixels: npt.NDArray[Any]) -> list[str]:
    """Write without compression."""
    return _save(path, "BMP", image_file, pixels)


def _save(
    path: Path, name: str, image_file: ImageFile, pixels: npt.NDArray[Any], **options: Any
) -> list[str]:
    needed("PIL", path)
    from PIL import Image

    Image.fromarray(pixels).save(path, name, **_options(image_file.about, name), **options)
    return lost(image_file, path, _KEPT[name])


def _options(about: dict[str, Any], name: str) -> dict[str, Any]:
    """What Pillow has to be told of a picture, as far as a format keeps it."""
    options = {_INFO[key]: value for key, value in about.items() if key in _KEPT[name]}
    if "exif" in options:
        options["exif"] = _EXIF_MARK + options["exif"]
    return options
