# SPDX-License-Identifier: GPL-3.0-or-later
"""Textures on disk, outside Blender: an image file and the mesh file whose surface shows it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..atlas import TextureAtlas
from ..base.progress import phase, reporting
from ..errors import InvalidUV, ShockError
from ..mesh.triangle_mesh import TriangleMesh
from ..mesh.weld import weld_borders
from .document import Floats
from .image_formats import Pixels, image_size, read_beside, read_pixels
from .images import filter_image_file, write_image_file
from .meshes import IN_PLACE, read_document
from .output import DEFAULTS, Options, Outcome
from .reading import check_ending, reading

RAW = (".npy", ".tif", ".tiff", ".exr")
"""Endings of files that hold a mask's numbers; others hold a picture of it."""

_EXACT = 1 << 24  # whole numbers below this are exact as 32-bit floats
_STEP = 64  # of gray, per count


@dataclass(frozen=True)
class TexturedMesh:
    """A mesh with the texture coordinates of its corners, and notes on them."""

    mesh: TriangleMesh
    uv: Floats
    notes: tuple[str, ...]


def filter_texture_file(
    function: Callable[..., Pixels],
    mesh: str | Path,
    source: str | Path,
    target: str | Path,
    options: Options = DEFAULTS,
    *,
    times: int = 1,
) -> Outcome:
    """Filter the texture of a mesh, on its surface, and write it to another image file.

    Parameters
    ----------
    function : callable
        ``function(mesh, uv, pixels, mask=None, guide=None, gain=None, atlas=None)`` returns an
        array like the pixels, with row 0 at v = 0; see `registry.Filter.function`. Mask, guide
        and gains are passed if given; with `Options.others`, a list of pixels is passed.
    mesh : path
        OBJ, PLY, GLB or glTF file with texture coordinates. Vertices that were split along seams
        are joined; see `core.weld_borders`.
    source, target, options, times
        As in :func:`shock_filter.core.files.images.filter_image_file`.

    Returns
    -------
    Outcome
        Counts of pixels, and notes on the texture coordinates and on what was lost.
    """
    surface = read_textured_mesh(mesh, options.material, options.any_size, shown=True)
    words = {word: pixels[::-1] for word, pixels in read_beside(options, upright=False).items()}
    others = {
        str(path): read_pixels(path, options.any_size, upright=False) for path in options.others
    }
    notes = list(surface.notes)

    def on_surface(pixels: Pixels) -> Pixels:
        height, width = pixels.shape[:2]
        _check_alike(pixels, source, others)
        with phase(0.0, 0.3, "Finding the charts"):
            atlas = TextureAtlas(surface.mesh, surface.uv, size=(height, width))
        notes.extend(atlas.report.sentences())
        upright = [np.ascontiguousarray(each[::-1]) for each in (pixels, *others.values())]
        given = upright if others else upright[0]
        with phase(0.3, 1.0, "Filtering"):
            return function(surface.mesh, surface.uv, given, **words, atlas=atlas)[::-1]

    alone = replace(options, mask=None, guide=None, gain_map=None, others=())
    outcome = filter_image_file(on_surface, source, target, alone, times=times, upright=False)
    return replace(outcome, notes=(*notes, *outcome.notes))


def _check_alike(pixels: Pixels, source: str | Path, others: dict[str, Pixels]) -> None:
    for path, other in others.items():
        if other.shape != pixels.shape or other.dtype != pixels.dtype:
            raise ShockError(
                f"{path} holds {_kind(other)}, {source} {_kind(pixels)}; save them with one size,"
                " the same channels and the same depth."
            )


def _kind(pixels: Pixels) -> str:
    height, width = pixels.shape[:2]
    channels = pixels.shape[2] if pixels.ndim == 3 else 1
    return f"{width} x {height} pixels of {channels} x {pixels.dtype}"


def texture_mask_file(
    mesh: str | Path,
    target: str | Path,
    kind: str,
    size: tuple[int, int] | str | Path,
    options: Options = DEFAULTS,
) -> Outcome:
    """Draw a mask of the texels of a mesh, and write it as an image.

    Parameters
    ----------
    mesh, options
        As in `filter_texture_file`.
    target : path
        NumPy, TIFF and EXR files hold numbers, with -1 for no face or chart; others hold a
        picture, in which the colors of faces and charts are the same in each run.
    kind : str
        A field of :class:`shock_filter.core.atlas.TextureMasks`.
    size : (int, int), or path
        Height and width in texels, or an image file of the wanted size.
    """
    target = Path(target)
    if not isinstance(size, tuple):
        size = image_size(size, options.any_size, upright=False)
    height, width = size
    surface = read_textured_mesh(mesh, options.material, options.any_size)
    with reporting(options.progress):
        atlas = TextureAtlas(surface.mesh, surface.uv, size=(height, width))
    shown = mask_pixels(atlas, kind, target.suffix.lower())
    write_image_file(target, np.ascontiguousarray(shown[::-1]), options.overwrite)
    return mask_outcome(atlas, surface.notes)


def mask_outcome(atlas: TextureAtlas, notes: tuple[str, ...]) -> Outcome:
    """Report how much of the image the charts cover."""
    total = atlas.height * atlas.width
    active = int(np.count_nonzero(atlas.masks().active))
    done = f"{atlas.report.charts} charts, {{changed}} of {{total}} texels active"
    return Outcome(total, active, (*notes, *atlas.report.sentences()), done)


def mask_pixels(atlas: TextureAtlas, kind: str, ending: str) -> Pixels:
    """Convert one of the masks to what a file with this ending holds, row 0 at v = 0."""
    values = getattr(atlas.masks(), kind)
    if ending == ".npy":
        return values.astype(np.uint8) if values.dtype == np.bool_ else values
    if ending in RAW:
        if values.max() >= _EXACT:
            raise ShockError(f"{ending} cannot hold numbers as large as these; write .npy.")
        return values.astype(np.float32)
    if values.dtype == np.bool_:
        return values.astype(np.uint8) * np.uint8(255)
    if kind == "count":
        return np.minimum(values * _STEP, 255).astype(np.uint8)
    return _colors(values)


def _colors(numbers: Pixels) -> Pixels:
    """Distinct colors for numbers: (h, w, 3) uint8, black for -1."""
    mixed = (numbers + 1).astype(np.uint32) * np.uint32(0x9E3779B1)
    mixed ^= mixed >> np.uint32(15)
    mixed *= np.uint32(0x85EBCA77)
    channels = [(mixed >> np.uint32(shift)) % np.uint32(192) for shift in (8, 16, 24)]
    colors = np.stack(channels, axis=-1).astype(np.uint8) + np.uint8(64)
    colors[numbers < 0] = 0
    return colors


def read_textured_mesh(
    path: str | Path,
    material: str | None = None,
    any_size: bool = False,
    *,
    shown: bool = False,
) -> TexturedMesh:
    """Read the faces of a mesh file that have texture coordinates.

    Parameters
    ----------
    path : path
        OBJ, PLY, GLB or glTF file.
    material : str, optional
        Only the faces of this material.
    any_size : bool
        As in `Options`.
    shown : bool
        Whether the texture is one that the materials show, by these coordinates.

    Raises
    ------
    InvalidUV
        If no face has texture coordinates.
    ShockError
        If the file cannot be read or has no such material, or a shown texture is transformed.
    """
    path = Path(path)
    check_ending(path, IN_PLACE, "such files hold no texture coordinates")
    document = read_document(path, IN_PLACE[path.suffix.lower()], any_size)
    with reading(path):
        uv, materials = document.read_uvs()
        moved = document.moved_colors()
    known = ~np.isnan(uv).any(axis=(1, 2))
    if not known.any():
        raise InvalidUV(
            f"{path} has no texture coordinates; unwrap it (in Blender: UV > Unwrap) and export"
            " it with them."
        )
    notes = []
    if not known.all():
        notes.append(f"{np.count_nonzero(~known)} triangles have no texture coordinates: left out")
    names = sorted(set(materials[known].tolist()))
    if material is not None:
        if material not in names:
            there = ", ".join(filter(None, names))
            remedy = f"it has: {there}" if there else "it names none; leave --material out"
            raise ShockError(f"{path} has no material {material!r}; {remedy}.")
        known &= materials == material
    elif len(names) > 1:
        notes.append(f"all materials ({', '.join(names)}) count; choose one with --material")
    for name in sorted(set(materials[known].tolist()) & set(moved)):
        words = f"the color of {name or 'a material'}: {moved[name]}"
        if shown:
            raise ShockError(
                f"{path}: {words}, so that the surface cannot be found on the texture; apply that"
                " first (in Blender: bake to a new image) and export the model again."
            )
        notes.append(f"{words}; the first ones as they are count here")
    faces = weld_borders(document.vertices, document.faces[known])
    mesh = TriangleMesh(document.vertices, faces)
    return TexturedMesh(mesh, uv[known], tuple(notes))
