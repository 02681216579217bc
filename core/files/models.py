# SPDX-License-Identifier: GPL-3.0-or-later
"""Repairs models on disk together with the textures of their materials."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.progress import phase, reporting
from ..errors import Cancelled, ShockError
from ..mesh.triangle_mesh import TriangleMesh
from ..mesh.weld import weld, weld_borders
from ..repair.picture import Painted, side_by_side
from ..repair.repairing import repair_textures
from ..repair.shape import repair_shape
from ..settings import ModelSettings, RepairSettings, describe
from .document import Floats
from .formats.image.image_file import ImageFile
from .formats.mesh.gltf import GltfFile
from .formats.mesh.maps import COLOR, NORMALS, OPACITY, MapGroup, MapImage, TexturedDocument
from .formats.mesh.obj import ObjFile
from .image_formats import FORMATS, Pixels, check_format, read_pixels
from .images import write_image_file
from .meshes import filtered, read_back, read_document
from .output import DEFAULTS, Options, Outcome, check_free, staged
from .reading import check_ending, check_target, reading

MODELS: dict[str, Callable[[Path], TexturedDocument]] = {
    ".glb": GltfFile,
    ".gltf": GltfFile,
    ".obj": ObjFile,
}
_PNG = ".png"
_UNIT = 0.1
"""Normals in an image differ by at most this from unit length, in the median."""


class _Map(NamedTuple):
    # An image of a group, read; row 0 is at v = 0.
    image: MapImage
    pixels: Pixels
    content: str


def repair_model_file(
    source: str | Path,
    target: str | Path,
    settings: ModelSettings,
    options: Options = DEFAULTS,
    *,
    picture: str | Path | None = None,
) -> Outcome:
    """Repair all textures of a model, and its shape on request, and write it to another file.

    Parameters
    ----------
    source, target : path
        GLB, glTF or OBJ files of one kind. Repaired images are stored as PNG: inside of GLB files,
        and beside others. `target` appears when it is complete.
    settings : ModelSettings
    options : Options
    picture : path, optional
        An image file for the model before and after.

    Returns
    -------
    Outcome
        Counts of textures, and sentences on what was found, and on what could not be repaired.

    Raises
    ------
    ShockError
        If a file cannot be read or written, or nothing of the model can be repaired.
    """
    source, target = Path(source), Path(target)
    check_target(target, MODELS)
    check_ending(source, MODELS, "such files hold no textures that can be repaired")
    reader = MODELS[source.suffix.lower()]
    if MODELS[target.suffix.lower()] is not reader:
        raise ShockError(f"{target}: models keep their format; end it in {source.suffix}.")
    check_free(target, options.overwrite)
    if picture is not None:
        check_target(Path(picture), FORMATS)
        check_free(Path(picture), options.overwrite)
    how = RepairSettings(**{name: getattr(settings, name) for name in describe(RepairSettings)})
    document = read_document(source, reader, options.any_size)
    with reading(source, options.any_size):
        groups, left = document.read_maps()
        uv = document.read_uvs()[0]
    notes = [*left]
    before: list[Painted] = []
    after: list[Painted] = []
    new: dict[Hashable, bytes] = {}
    count = 0
    with reporting(options.progress):
        with phase(0.0, 0.2 if settings.geometry != "keep" else 0.0, "Repairing the shape"):
            positions, moved = _shaped(document, settings)
        with phase(0.2 if settings.geometry != "keep" else 0.0, 0.95, "Repairing textures"):
            for number, group in enumerate(groups):
                with phase(number / len(groups), (number + 1) / len(groups), "Repairing textures"):
                    maps, more = _read_maps(source, group, options.any_size)
                    notes += more
                    results, more = _repaired(document, uv, group, maps, how)
                notes += more
                count += len(results)
                for each, result in zip(maps, results, strict=False):
                    if result.shape != each.pixels.shape or (result != each.pixels).any():
                        new[each.image.key] = _encoded(source, result)
                if maps and maps[0].image.part == COLOR and group.faces.any():
                    shown = _corners(document.vertices, document, group), uv[group.faces]
                    before.append(Painted(*shown, maps[0].pixels))
                    later = _corners(positions, document, group)
                    after.append(Painted(later, shown[1], (results or [maps[0].pixels])[0]))
    if not count and settings.geometry == "keep":
        reason = "; ".join(note.rstrip(".") for note in notes) or "its materials name no images"
        raise ShockError(f"{source} has no textures that can be repaired: {reason}.")
    with staged(target, options.overwrite, document.own_files(target)) as path:
        notes += document.save_maps(path, positions, moved, new)
        read_back(document, path, positions)
    if picture is not None and before:
        try:
            write_image_file(Path(picture), side_by_side([before, after]), options.overwrite)
        except (ShockError, OSError) as error:
            notes.append(f"the picture was not written: {error}")
    done = "repaired {changed} of {total} textures"
    if settings.geometry != "keep":
        done += f", moved {np.count_nonzero(moved)} of {len(moved)} vertices"
    return Outcome(count, len(new), tuple(dict.fromkeys(notes)), done)


def _shaped(
    document: TexturedDocument, settings: ModelSettings
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    # The positions, and which of them moved.
    old = document.vertices
    if settings.geometry == "keep":
        return old, np.zeros(len(old), dtype=np.bool_)

    def function(mesh: TriangleMesh, mask: None = None) -> Floats:
        return repair_shape(mesh, settings.geometry)

    result = filtered(document, weld(old), function, None)
    positions = np.where(result == old, old, result)
    return positions, (positions != old).any(axis=1)


def _read_maps(source: Path, group: MapGroup, any_size: bool) -> tuple[list[_Map], list[str]]:
    maps: list[_Map] = []
    notes: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        for number, image in enumerate(group.images):
            path = Path(folder, f"{number}{image.ending}")
            path.write_bytes(image.data)
            try:
                pixels = read_pixels(path, any_size, upright=False)
                check_format(source, _PNG, pixels)
            except ShockError as error:
                reason = str(error).replace(str(path), image.name)
                notes.append(f"{image.name} was left as it was: {reason}")
                continue
            upright = np.ascontiguousarray(pixels[::-1])
            maps.append(_Map(image, upright, _content_of(image, upright)))
    return maps, notes


def _content_of(image: MapImage, pixels: Pixels) -> str:
    # OBJ files do not say whether a bump map holds heights or normals.
    if pixels.ndim != 3 or pixels.shape[2] not in (3, 4):
        return "values"
    if image.part == NORMALS:
        return "normals"
    if image.part != "bump":
        return "values"
    scale = 2.0 / np.iinfo(pixels.dtype).max if pixels.dtype.kind == "u" else 2.0
    lengths = np.linalg.norm(pixels[::4, ::4, :3] * scale - 1.0, axis=-1)
    return "normals" if abs(float(np.median(lengths)) - 1.0) < _UNIT else "values"


def _repaired(
    document: TexturedDocument,
    uv: Floats,
    group: MapGroup,
    maps: list[_Map],
    settings: RepairSettings,
) -> tuple[list[Pixels], list[str]]:
    # The maps of a group, none if it cannot be repaired; and sentences on what was not done.
    if not maps:
        return [], []
    notes: list[str] = []
    fill = settings.fill
    if fill == "auto" and any(each.image.is_cut_out for each in maps):
        fill = "unseen"  # transparent texels are intended
    if fill != "nothing" and maps[0].image.part != COLOR:
        fill = "nothing"
        notes.append(f"{_names(maps)}: nothing was filled, as there is no map of colors with them")
    # A map of opacity is black where nothing is shown.
    opacity = [each for each in maps if each.image.part == OPACITY]
    others = [each for each in maps if each.image.part != OPACITY]
    found: dict[Hashable, Pixels] = {}
    try:
        faces = weld_borders(document.vertices, document.faces[group.faces])
        mesh = TriangleMesh(document.vertices, faces)
        for some, what in ((others, fill), (opacity, "nothing")):
            if some:
                results = repair_textures(
                    mesh,
                    uv[group.faces],
                    [each.pixels for each in some],
                    settings.changed(fill=what),
                    contents=[each.content for each in some],
                )
                found |= zip([each.image.key for each in some], results, strict=True)
    except Cancelled:
        raise
    except ShockError as error:
        return [], [f"{_names(maps)}: left as they were. {error}"]
    return [found[each.image.key] for each in maps], notes


def _names(maps: list[_Map]) -> str:
    return ", ".join(each.image.name for each in maps)


def _corners(positions: Floats, document: TexturedDocument, group: MapGroup) -> Floats:
    return positions[document.faces[group.faces]]


def _encoded(source: Path, pixels: Pixels) -> bytes:
    shown: Any = np.ascontiguousarray(pixels[::-1])
    if shown.ndim == 3 and shown.shape[2] == 1:
        shown = shown[..., 0]
    check_format(source, _PNG, shown)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"image{_PNG}")
        FORMATS[_PNG].write(path, ImageFile(shown, ""), shown)
        return path.read_bytes()
