# SPDX-License-Identifier: GPL-3.0-or-later
"""Read and write scenes and images with Blender's importers and exporters."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy

from ...core.errors import ShockError
from ...core.files.output import staged
from ...core.files.reading import check_file, reading_back
from ...core.files.staging import beside

OPEN_FILE = "-"
_BLEND = ".blend"
_USD = (".usd", ".usda", ".usdc", ".usdz")
_GLTF = ("import_scene.gltf",), "export_scene.gltf"
_SCENES: dict[str, tuple[tuple[str, ...], str, dict[str, Any]]] = {
    ".abc": (("wm.alembic_import",), "wm.alembic_export", {"as_background_job": False}),
    ".dae": (("wm.collada_import",), "wm.collada_export", {}),
    ".fbx": (
        ("import_scene.fbx", "wm.fbx_import"),
        "export_scene.fbx",
        {"path_mode": "COPY", "embed_textures": True},
    ),
    ".glb": (*_GLTF, {"export_format": "GLB"}),
    ".gltf": (*_GLTF, {"export_format": "GLTF_SEPARATE"}),
    ".obj": (("wm.obj_import",), "wm.obj_export", {"path_mode": "COPY", "export_colors": True}),
    ".ply": (("wm.ply_import",), "wm.ply_export", {}),
    ".stl": (("wm.stl_import",), "wm.stl_export", {}),
    **dict.fromkeys(_USD, (("wm.usd_import",), "wm.usd_export", {})),
}
"""By ending: importers, of which the first available one is used; exporter and its options."""

_UNWRITTEN = (
    "{path.name} cannot be written ({reason}); is there room on the disk and in the folder a right"
    " to write?"
)
"""Blender names no reason for a full disk, or a wrong one."""

_IMAGE_FORMATS = {
    ".bmp": "BMP",
    ".exr": "OPEN_EXR",
    ".hdr": "HDR",
    ".jpeg": "JPEG",
    ".jpg": "JPEG",
    ".png": "PNG",
    ".tga": "TARGA",
    ".tif": "TIFF",
    ".tiff": "TIFF",
    ".webp": "WEBP",
}


def check_ending(target: Path) -> None:
    """Raise an error if this Blender cannot write files of this kind."""
    ending = target.suffix.lower()
    known = [each for each, (_, exporter, _) in _SCENES.items() if _exists(exporter)]
    if ending not in (_BLEND, *known):
        raise _unknown(str(target), known)


def open_scene(source: str) -> None:
    """Open a file or import it into an empty scene; - is the file that is already open."""
    if source == OPEN_FILE:
        return
    check_file(Path(source))
    path = str(Path(source).absolute())
    ending = Path(source).suffix.lower()
    if ending == _BLEND:
        call("wm.open_mainfile", filepath=path, load_ui=False)
        return
    known = {
        each: next(filter(_exists, importers))
        for each, (importers, _, _) in _SCENES.items()
        if any(map(_exists, importers))
    }
    if ending not in known:
        raise _unknown(source, list(known))
    bpy.ops.wm.read_homefile(use_empty=True)
    call(known[ending], filepath=path)


def save_scene(target: Path, overwrite: bool) -> None:
    """Export the scene, or save it as Blender's own file."""
    ending = target.suffix.lower()
    own = f"{target.stem}.bin", f"{target.stem}.mtl"  # as the exporters name them
    with staged(target, overwrite, own) as path:
        if ending == _BLEND:
            # In the target's own folder, as the file names others relative to where it is saved.
            options = {"copy": True, "check_existing": False}
            with beside(path, _BLEND) as saved:
                with _reported(_UNWRITTEN, path=path):
                    bpy.ops.wm.save_as_mainfile(filepath=str(saved), **options)
                os.replace(saved, path)
        else:
            _, exporter, options = _SCENES[ending]
            call(exporter, filepath=str(path), **options)
        _read_back(path)


def _read_back(path: Path) -> None:
    """Check a scene that was just written: that it exists, its header and sizes."""
    from ...core.files.formats.mesh.gltf_tree import read_tree
    from ...core.files.formats.mesh.ply import PlyVertices

    readers = {".glb": read_tree, ".gltf": read_tree, ".ply": PlyVertices}
    with reading_back(path):
        if path.suffix.lower() == _BLEND:
            with bpy.data.libraries.load(str(path)) as (names, _):
                found = bool(names.scenes)
        else:
            readers.get(path.suffix.lower(), Path.stat)(path)
            found = path.stat().st_size > 0
        if not found:
            raise ValueError("nothing in it")


def image_format(target: Path) -> str:
    """Return Blender's format for the ending of a file."""
    kind = _IMAGE_FORMATS.get(target.suffix.lower())
    if kind is None:
        raise ShockError(
            f"{target}: this ending cannot be handled here; use one of {', '.join(_IMAGE_FORMATS)}."
        )
    return kind


def is_image(source: str) -> bool:
    """Whether a file's ending is that of an image."""
    return Path(source).suffix.lower() in _IMAGE_FORMATS


@contextmanager
def loaded_image(source: str) -> Iterator[bpy.types.Image]:
    """Return the image of a file: that of the open scene, or one that is removed afterwards."""
    check_file(Path(source))
    known = set(bpy.data.images)
    with _reported():
        image = bpy.data.images.load(str(Path(source).absolute()), check_existing=True)
    try:
        if not image.size[0] * image.size[1]:
            raise ShockError(f"{source} cannot be read; is it an image, and not damaged?")
        yield image
    finally:
        if image not in known:
            bpy.data.images.remove(image)


def write_image(image: bpy.types.Image, path: Path) -> None:
    """Save an image in its own format."""
    with _reported(_UNWRITTEN, path=path):
        image.save(filepath=str(path))
    with reading_back(path), loaded_image(str(path)) as written:
        if tuple(written.size) != tuple(image.size):
            raise ValueError("another size")


def write_values(path: Path, kind: str | None, shown: Any) -> None:
    """Write gray values or colors, as bytes or floats; as a NumPy file if no kind is given."""
    import numpy as np

    from ..data.arrays import write_pixels

    if kind is None:
        np.save(path, shown[::-1])
        return
    height, width = shown.shape[:2]
    is_float = shown.dtype.kind == "f"
    pixels = np.ones((height, width, 4), dtype=np.float32)
    pixels[..., :3] = shown.reshape(height, width, -1) / np.float32(1 if is_float else 255)
    image = bpy.data.images.new(
        "mask", width, height, alpha=False, float_buffer=is_float, is_data=True
    )
    write_pixels(image, pixels)
    image.file_format = kind
    write_image(image, path)
    bpy.data.images.remove(image)


def operator(name: str) -> Any:
    """Look up one of Blender's operators by its name."""
    group, _, function = name.partition(".")
    return getattr(getattr(bpy.ops, group), function)


def _exists(name: str) -> bool:
    try:
        operator(name).get_rna_type()
    except KeyError:
        return False
    return True


def call(name: str, **options: Any) -> None:
    """Call an operator; its error reports become a ShockError."""
    with _reported():
        result = operator(name)(**options)
    if result != {"FINISHED"}:
        raise ShockError(f"Blender's {name} stopped before its end.")


@contextmanager
def _reported(text: str = "{reason}", **values: Any) -> Iterator[None]:
    """Turn errors that Blender reports into a ShockError with this text."""
    try:
        yield
    except RuntimeError as error:
        reason = str(error).strip().removeprefix("Error: ")
        raise ShockError(text.format(reason=reason, **values)) from error


def _unknown(path: str, known: list[str]) -> ShockError:
    endings = ", ".join([".blend", *known])
    return ShockError(f"{path}: this Blender cannot handle this ending; use one of {endings}.")
