# SPDX-License-Identifier: GPL-3.0-or-later
"""TIFF files, read and written by tifffile."""

from __future__ import annotations

import contextlib
import itertools
import logging
import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ....errors import ShockError
from ...reading import check_claim, needed
from .image_file import ICC, RESOLUTION, XMP, ImageFile, lost
from .orientation import ORIENTATION, UPRIGHT, checked
from .ycbcr import read_ycbcr

logging.getLogger("tifffile").addHandler(logging.NullHandler())  # otherwise it prints warnings

_RGB, _PALETTE, _YCBCR = 2, 3, 6
_GRAY = {0: "miniswhite", 1: "minisblack"}
_COLORS = {*_GRAY, _RGB, _PALETTE, _YCBCR}
_OTHER_COLORS = {
    4: "mask", 5: "CMYK", 8: "CIE L*a*b*", 9: "ICC L*a*b*", 10: "ITU L*a*b*", 32803: "raw sensor",
    32844: "LogL", 32845: "LogLuv", 34892: "raw sensor", 51177: "depth",
}  # fmt: skip
_JPEG = {6, 7, 33007, 34892}  # compressions that are decoded to RGB
_WHOLE_BITS = (8, 16, 32, 64)
_MOST_BITS = 16  # no type that is written holds all values of more bits
_NONE, _UNSPECIFIED = 1, 0
_ASSOCIATED, _STRAIGHT = 1, 2  # opacity that is multiplied into the colors, or is not
_PHOTOMETRIC = 262
_MIN_IS_WHITE = "miniswhite"
_UNDEFINED, _FLOAT, _COMPLEX = 4, 3, (5, 6)  # formats of samples
_FLOAT_BITS = (16, 32, 64)
_OLD_PALETTE = 256  # entries below this are of 8 bits, as written by old programs
_ROWS = 256
TILE = 256
"""Side of the tiles that are written, in pixels."""

_MOST_PAGES = 99  # a picture and smaller copies; a damaged file may seem to go on forever
# Tags that say how pixels are stored, or where in the file data are; tifffile writes those that
# the copy needs.
_STORAGE = {254, 255, 256, 257, 258, 259, 262, 263, 264, 265, 266, 273, 277, 278, 279, 280, 281}
_STORAGE |= {282, 283, 284, 288, 289, 296, 317, 320, 322, 323, 324, 325, 330, 338, 339, 340, 341}
_STORAGE |= {347, 512, 513, 514, 515, 519, 520, 521, 529, 530, 531, 532, 34675}
_SUB_PAGES = 330
# Tags that cannot be copied, or would show the old pixels.
_BLOCKS = {34665: "EXIF", 34853: "GPS", 40965: "EXIF interoperability", 37724: "layers"}
_TEXT = 2  # type of tags
_RESOLUTION_UNITS = {1: None, 2: 1.0, 3: 2.54}
_PIXEL_SCALE, _TIE_POINTS, _TRANSFORM = 33550, 33922, 34264
"""Tags of GeoTIFF that say where pixels lie."""

_XMP = 700
_ICC = 34675
_NAMES = {_XMP: XMP, _ICC: ICC}


class _Meaning(NamedTuple):
    """How a file's values differ from those that filters expect."""

    is_inverted: bool
    """White is 0."""

    is_divided: bool
    """The last channel, opacity, is multiplied into the colors."""

    def plain(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return values in which white is the largest, and colors are not premultiplied."""
        if not any(self) or values.dtype.kind != "u":
            return values
        values = values.copy()
        for top in range(0, len(values), _ROWS):
            band = values[top : top + _ROWS]
            if self.is_inverted:
                _invert(band)
            if self.is_divided:
                _divide(band)
        return values


def _invert(values: npt.NDArray[Any]) -> None:
    gray = values if values.ndim == 2 else values[..., 0]
    np.subtract(np.iinfo(values.dtype).max, gray, out=gray)


def _divide(values: npt.NDArray[Any]) -> None:
    white = np.iinfo(values.dtype).max
    opacity = values[..., -1:].astype(np.uint32)
    colors = values[..., :-1].astype(np.uint32) * white  # fits for 16 bits
    parts = (colors + opacity // 2) // np.maximum(opacity, 1)
    values[..., :-1] = np.where(opacity, np.minimum(parts, white), values[..., :-1])


def _meaning(page: Any) -> _Meaning:
    is_gray = page.photometric in _GRAY
    extra = tuple(map(int, page.extrasamples))
    is_opacity = page.samplesperpixel == (2 if is_gray else 4) and extra == (_ASSOCIATED,)
    return _Meaning(_GRAY.get(page.photometric) == _MIN_IS_WHITE, is_opacity)


def read_tiff(path: Path) -> ImageFile:
    """Read a TIFF file of one picture."""
    with _only_page(path) as (page, has_previews):
        check_claim(path, page.nbytes)
        image_file = _about_page(page, has_previews)
        if _is_unconverted(page):
            image_file.pixels = read_ycbcr(page)
            image_file.notes.insert(0, "its luminance and chroma became RGB channels")
            return image_file
        pixels = page.asarray()
        if page.axes.startswith("S"):  # planes, one after the other
            pixels = np.moveaxis(pixels, 0, -1)
        if page.photometric == _PALETTE:
            image_file.pixels = _of_palette(path, page, pixels)
            bits = 8 * image_file.pixels.itemsize
            image_file.notes.insert(0, f"its palette was replaced by {bits}-bit RGB channels")
            return image_file
        if _has_odd_depth(page):
            pixels = _scaled(pixels, page.bitspersample)
            bits = 8 * pixels.itemsize
            image_file.notes.insert(0, f"values of {page.bitspersample} bits became {bits}-bit")
        meaning = _meaning(page)
        image_file.pixels = meaning.plain(pixels)
        is_whole = meaning.is_divided and pixels.dtype.kind == "u"
        if is_whole and (pixels[..., :-1] > pixels[..., -1:]).any():
            image_file.notes.append("colors beyond their opacity were cut")
        return image_file


def _is_unconverted(page: Any) -> bool:
    """Whether tifffile returns luminance and chroma."""
    return page.photometric == _YCBCR and page.compression not in _JPEG


def _has_odd_depth(page: Any) -> bool:
    """Whether white is not the largest value of the type that tifffile returns."""
    return page.dtype.kind in "bu" and page.bitspersample not in _WHOLE_BITS


def _scaled(pixels: npt.NDArray[Any], bits: int) -> npt.NDArray[Any]:
    """Scale whole numbers of some bits to the next larger type, white to white."""
    kind = np.dtype(np.uint8 if bits < 8 else np.uint16)
    steps = (
        (255 if bits < 8 else 65535) * np.arange(1 << bits, dtype=np.float64) / ((1 << bits) - 1)
    )
    return np.rint(steps).astype(kind)[pixels.astype(np.uint16)]


def _of_palette(path: Path, page: Any, pixels: npt.NDArray[Any]) -> npt.NDArray[Any]:
    pixels = pixels.astype(np.intp)
    palette = page.colormap
    if np.ndim(palette) != 2 or len(palette) != 3 or pixels.max(initial=0) >= len(palette[0]):
        raise ShockError(f"{path} has a broken palette; save it as RGB.")
    entries = np.asarray(palette, np.uint16)
    if entries.max() < _OLD_PALETTE:
        entries = entries.astype(np.uint8)
    return np.moveaxis(entries[:, pixels], 0, -1)


def claimed_size(path: Path) -> int:
    """Return the bytes of the picture in a tiled TIFF file; 0 for other files."""
    with needed("tifffile", path).TiffFile(path) as file:
        return file.pages[0].nbytes if file.pages[0].is_tiled else 0


def open_tiff_tiles(path: Path) -> ImageFile | None:
    """Open a TIFF file whose tiles can be read one by one; None for other files."""
    with _only_page(path) as (page, has_previews):
        is_plain = not (_is_unconverted(page) or _has_odd_depth(page))
        if not (is_plain and page.is_tiled) or page.photometric == _PALETTE:
            return None
        if page.axes.startswith("S"):
            return None
        image_file = _about_page(page, has_previews)
        image_file.pixels = TiffTiles(path, page)
        return image_file


class TiffTiles:
    """The picture of a tiled TIFF file: windows are read on demand, and not kept.

    Tasks may carry it to other processes, which read the file themselves.
    """

    def __init__(self, path: Path, page: Any) -> None:
        self.path, self.page, self.shape = path, page.index, page.shape
        self.dtype = page.dtype.newbyteorder("=")
        self.chunks, self.ndim = page.chunks, len(page.shape)
        self._meaning = _meaning(page)

    def __getitem__(self, window: tuple[slice, ...]) -> npt.NDArray[Any]:
        rows, columns = (range(n)[part] for n, part in zip(self.shape, window[:2], strict=False))
        out = np.empty((len(rows), len(columns), *self.shape[2:]), self.dtype)
        high, wide = self.chunks[:2]
        across = -(-self.shape[1] // wide)
        with needed("tifffile", self.path).TiffFile(self.path) as file:
            page = file.pages[self.page]
            for down in range(rows.start // high, -(-rows.stop // high)):
                for right in range(columns.start // wide, -(-columns.stop // wide)):
                    tile = _read_tile(page, across * down + right)
                    y, x = down * high - rows.start, right * wide - columns.start
                    top, left = max(y, 0), max(x, 0)
                    part = tile[top - y : len(rows) - y, left - x : len(columns) - x]
                    out[top : top + len(part), left : left + part.shape[1]] = part.reshape(
                        *part.shape[:2], *self.shape[2:]
                    )
        return self._meaning.plain(out)[(slice(None), slice(None), *window[2:])]


def _read_tile(page: Any, number: int) -> npt.NDArray[Any]:
    file = page.parent.filehandle
    file.seek(page.dataoffsets[number])
    data = file.read(page.databytecounts[number])
    tables = {"jpegtables": page.jpegtables} if page.jpegtables else {}
    return page.decode(data, number, **tables)[0][0]


@contextlib.contextmanager
def _only_page(path: Path) -> Iterator[tuple[Any, bool]]:
    # The page of the only picture, and whether there are smaller copies of it.
    tifffile = needed("tifffile", path)
    try:
        with tifffile.TiffFile(path) as file:
            pages = list(itertools.islice(file.pages, _MOST_PAGES))
            whole = [page for page in pages if not page.is_reduced]
            if len(whole) != 1 or len(pages) == _MOST_PAGES:
                raise ShockError(
                    f"{path} does not hold one picture alone; save its pages as files of one page"
                    " each."
                )
            (page,) = whole
            _check_page(path, page)
            _check_compression(path, page)
            if not (_is_listed(page.dataoffsets) and _is_listed(page.databytecounts)):
                raise ShockError(f"{path} is damaged: its parts are nowhere; copy it again.")
            count = math.prod(page.chunked)
            present = min(len(page.dataoffsets), len(page.databytecounts))
            if present < count:
                raise ShockError(
                    f"{path} is damaged: of its {count} parts it has {present}; copy or save it"
                    " again."
                )
            if 0 in page.databytecounts:
                raise ShockError(f"{path} has parts without data; fill them, or save it anew.")
            yield page, len(pages) > 1
    except tifffile.TiffFileError as error:
        raise ShockError(f"{path} cannot be read; is it damaged? ({error})") from error


def _check_compression(path: Path, page: Any) -> None:
    """Refuse compressions that tifffile, or imagecodecs as built, cannot decode."""
    from tifffile import TIFF

    try:
        _ = TIFF.DECOMPRESSORS[page.compression]
    except KeyError:
        name = getattr(page.compression, "name", page.compression)
        raise ShockError(
            f"{path} has a compression that is not read ({name}); save it with another one, as"
            " LZW, or without."
        ) from None


def _is_listed(values: Any) -> bool:
    return isinstance(values, (tuple, list, np.ndarray)) and len(values) > 0


def _check_page(path: Path, page: Any) -> None:
    """Refuse pages that are not gray or color pictures of one depth."""
    numbers = page.imagelength, page.imagewidth, page.samplesperpixel
    if not all(isinstance(number, int) for number in numbers):
        raise ShockError(f"{path} has broken tags; copy or save it again.")
    if 0 in page.shape or page.size == 0:
        raise ShockError(f"{path} has no pixels; copy or save it again.")
    if _PHOTOMETRIC not in page.tags:  # programs guess differently
        raise ShockError(
            f"{path} does not say what its values mean, as black or white; save it again."
        )
    if page.photometric not in _COLORS:
        name = _OTHER_COLORS.get(page.photometric, f"unknown ({page.photometric})")
        raise ShockError(f"{path} has {name} colors; convert it to gray or RGB first.")
    if page.photometric == _PALETTE and page.samplesperpixel != 1:
        raise ShockError(f"{path} has a palette and more channels; save it as RGB.")
    if page.imagedepth != 1:
        raise ShockError(f"{path} is a volume; save its slices as files of one page each.")
    depths = page.tags[258].value if 258 in page.tags else 1
    if isinstance(depths, tuple) and len(set(depths)) > 1:
        named = ", ".join(map(str, depths))
        raise ShockError(f"{path} has channels of {named} bits; save it with 8 or 16 bits each.")
    kinds = page.tags[339].value if 339 in page.tags else 1
    if set(np.atleast_1d(kinds)) & set(_COMPLEX):
        raise ShockError(f"{path} holds complex numbers; save what is to be seen of them.")
    is_float = page.dtype is not None and page.dtype.kind == "f"
    if is_float and page.bitspersample not in _FLOAT_BITS:
        raise ShockError(
            f"{path} has floats of {page.bitspersample} bits; save it with floats of 32 bits."
        )
    if page.dtype is not None and _has_odd_depth(page) and page.bitspersample > _MOST_BITS:
        raise ShockError(
            f"{path} has values of {page.bitspersample} bits; save it with 8 or 16 bits."
        )
    if all(_meaning(page)):
        raise ShockError(
            f"{path} has white that is 0 and opacity that is multiplied in, which programs read in"
            " different ways; save it with black that is 0."
        )
    if page.dtype is None:
        raise ShockError(
            f"{path} has values of a kind that is not read; save it with 8 or 16 bits."
        )


def _about_page(page: Any, has_previews: bool) -> ImageFile:
    # Everything but the pixels.
    tags = {tag.code: tag for tag in page.tags.values()}
    about = {
        name: tags[code].value
        for code, name in _NAMES.items()
        if code in tags and isinstance(tags[code].value, bytes)
    }
    unit = _RESOLUTION_UNITS.get(tags[296].value if 296 in tags else 2)
    if unit and 282 in tags and 283 in tags:
        about[RESOLUTION] = tuple(
            unit * top / (bottom or 1) for top, bottom in (tags[282].value, tags[283].value)
        )
    notes = []
    if _ICC in tags and ICC not in about:
        notes.append("its damaged color profile: left behind")
    if has_previews or _SUB_PAGES in tags:
        notes.append("smaller copies in the file: left behind")
    blocks = [name for code, name in _BLOCKS.items() if code in tags]
    if blocks:
        notes.append(f"{', '.join(blocks)} cannot be copied: left behind")
    if page.sampleformat == _UNDEFINED:
        notes.append("its values, of a kind that is not stated, were read as whole numbers")
    options = _write_options(page)
    is_premultiplied = _meaning(page).is_divided
    if is_premultiplied and page.dtype.kind != "f":  # reading divides whole numbers
        options["extrasamples"] = [_STRAIGHT]
        is_premultiplied = False
        notes.append("its colors were divided by the opacity that was multiplied into them")
    named = {code: tag.name for code, tag in tags.items() if code not in _NAMES}
    only_tiff = [named[code] for code, *_ in options["extratags"] if code in named]
    orientation = checked(tags[ORIENTATION].value) if ORIENTATION in tags else UPRIGHT
    return ImageFile(
        *(np.empty((0, 0)), "TIFF", about, notes, options, only_tiff, orientation),
        is_premultiplied,
    )


def is_unstated(image_file: ImageFile) -> bool:
    """Whether a TIFF file does not say what the extra channel beside gray or colors is."""
    return [int(each) for each in image_file.own["extrasamples"] or ()] == [_UNSPECIFIED]


def make_tags_upright(image_file: ImageFile) -> None:
    """Set the orientation in a TIFF file's own tags to upright, after rotating its pixels."""
    xmp = image_file.about.get(XMP)
    image_file.own["extratags"] = [
        (code, kind, count, xmp if xmp and code == _XMP else value, once)
        for code, kind, count, value, once in image_file.own["extratags"]
        if code != ORIENTATION
    ]
    image_file.only_own = [name for name in image_file.only_own if name != "Orientation"]


def _write_options(page: Any) -> dict[str, Any]:
    """Options of `tifffile.imwrite` that make the copy like the original."""
    from tifffile import EXTRASAMPLE, TIFF

    dropped = _STORAGE | set(_BLOCKS) | set(TIFF.TAG_FILTERED)
    extra = page.samplesperpixel - (1 if page.photometric in _GRAY else 3)
    known = set(page.extrasamples) <= {int(meaning) for meaning in EXTRASAMPLE}
    stated = known and len(page.extrasamples) == extra
    return {
        "photometric": _GRAY.get(page.photometric),
        "compressed": page.compression != _NONE,
        "extrasamples": (page.extrasamples if stated else [_UNSPECIFIED] * extra) or None,
        "extratags": [
            (tag.code, int(tag.dtype), tag.count, _tag_value(page, tag), True)
            for tag in page.tags.values()  # some codes occur twice
            if tag.code not in dropped
        ],
    }


def _tag_value(page: Any, tag: Any) -> Any:
    if int(tag.dtype) != _TEXT:
        return tag.value
    file = page.parent.filehandle  # texts as bytes, as their encoding is unknown
    file.seek(tag.valueoffset)
    return file.read(tag.valuebytecount)


def write_tiff(path: Path, image_file: ImageFile, pixels: npt.NDArray[Any]) -> list[str]:
    """Write any number of channels; with lossless compression if the source was compressed."""
    options = _options(image_file, pixels.shape)
    stored = _meant(options).plain(pixels)
    needed("tifffile", path).imwrite(path, stored, **options)
    return lost(image_file, path, {ICC, RESOLUTION, XMP}, "TIFF")


def write_tiff_tiles(
    path: Path,
    image_file: ImageFile,
    shape: tuple[int, ...],
    kind: np.dtype,
    tiles: Iterable[npt.NDArray[Any]],
) -> list[str]:
    """Write a BigTIFF file tile by tile, row by row; tiles are full, also at the border."""
    options = _options(image_file, shape) | {"bigtiff": True, "tile": (TILE, TILE)}
    stored = map(_meant(options).plain, tiles)
    needed("tifffile", path).imwrite(path, stored, shape=shape, dtype=kind, **options)
    return lost(image_file, path, {ICC, RESOLUTION, XMP}, "TIFF")


def _meant(options: dict[str, Any]) -> _Meaning:
    """How written values differ from those that filters return; inverting twice cancels."""
    return _Meaning(options["photometric"] == _MIN_IS_WHITE, False)


def _options(image_file: ImageFile, shape: tuple[int, ...]) -> dict[str, Any]:
    count = shape[2] if len(shape) == 3 else 1
    own = dict(image_file.own) if image_file.format == "TIFF" else {"compressed": True}
    options: dict[str, Any] = {"metadata": None, "software": False}
    if own.pop("compressed"):
        options |= {"compression": "zlib", "predictor": True}
    options["photometric"] = "rgb" if count >= 3 else "minisblack"
    if len(shape) == 3:
        options["planarconfig"] = "contig"
    if count in (2, 4):
        options["extrasamples"] = [_ASSOCIATED if image_file.premultiplied else _STRAIGHT]
    options |= {name: value for name, value in own.items() if value is not None}
    if RESOLUTION in image_file.about:
        options |= {"resolution": image_file.about[RESOLUTION], "resolutionunit": "INCH"}
    options["iccprofile"] = image_file.about.get(ICC)
    if XMP in image_file.about and image_file.format != "TIFF":
        data = image_file.about[XMP]
        options["extratags"] = [(_XMP, 1, len(data), data, True)]
    scales = [new / old for new, old in zip(shape[:2], image_file.pixels.shape[:2], strict=True)]
    options["extratags"] = [
        (code, kind, count, _placed(code, value, *scales), once)
        for code, kind, count, value, once in options.get("extratags", ())
    ]
    return options


def _placed(code: int, value: Any, down: float, across: float) -> Any:
    """A tag of GeoTIFF for a picture of another size, which covers the same ground."""
    if code not in (_PIXEL_SCALE, _TIE_POINTS, _TRANSFORM) or down == across == 1.0:
        return value
    values = np.array(value, dtype=float)
    if code == _PIXEL_SCALE:
        values[:2] /= across, down
    elif code == _TIE_POINTS:
        values.reshape(-1, 6)[:, :2] *= across, down
    else:
        values.reshape(4, 4)[:, :2] /= across, down
    return tuple(values.tolist())
