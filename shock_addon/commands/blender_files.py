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
from ...core.files.reading import check_file

_OPEN_FILE = "-"

# Blender's operators by file ending; of several importers the first that this Blender has.
_USD = (".usd", ".usda", ".usdc", ".usdz")
_IMPORTERS: dict[str, tuple[str, ...]] = {
    ".abc": ("wm.alembic_import",),
    ".dae": ("wm.collada_import",),
    ".fbx": ("import_scene.fbx", "wm.fbx_import"),
    ".glb": ("import_scene.gltf",),
    ".gltf": ("import_scene.gltf",),
    ".obj": ("wm.obj_import",),
    ".ply": ("wm.ply_import",),
    ".stl": ("wm.stl_import",),
    **dict.fromkeys(_USD, ("wm.usd_import",)),
}
_EXPORTERS: dict[str, tuple[str, dict[str, Any]]] = {
    ".abc": ("wm.alembic_export", {"as_background_job": False}),
    ".dae": ("wm.collada_export", {}),
    ".fbx": ("export_scene.fbx", {"path_mode": "COPY", "embed_textures": True}),
    ".glb": ("export_scene.gltf", {"export_format": "GLB"}),
    ".gltf": ("export_scene.gltf", {"export_format": "GLTF_SEPARATE"}),
    ".obj": ("wm.obj_export", {"path_mode": "COPY", "export_colors": True}),
    ".ply": ("wm.ply_export", {}),
    ".stl": ("wm.stl_export", {}),
    **{ending: ("wm.usd_export", {}) for ending in _USD},
}

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


def exporter_of(target: Path) -> tuple[str, dict[str, Any]] | None:
    """Return operator and options that write this ending; None for Blender's own format."""
    ending = target.suffix.lower()
    if ending == ".blend":
        return None
    if ending not in _EXPORTERS or not _exists(_EXPORTERS[ending][0]):
        raise _unknown(str(target), [e for e, (name, _) in _EXPORTERS.items() if _exists(name)])
    return _EXPORTERS[ending]


def open_scene(source: str) -> None:
    """Open or import a file, into an empty scene; - is the file that is open already."""
    if source == _OPEN_FILE:
        return
    check_file(Path(source))
    path = str(Path(source).absolute())
    ending = Path(source).suffix.lower()
    if ending == ".blend":
        call("wm.open_mainfile", filepath=path, load_ui=False)
        return
    importer = next(filter(_exists, _IMPORTERS.get(ending, ())), None)
    if importer is None:
        known = [e for e, names in _IMPORTERS.items() if any(map(_exists, names))]
        raise _unknown(source, known)
    bpy.ops.wm.read_homefile(use_empty=True)
    call(importer, filepath=path)


def save_scene(target: Path, exporter: tuple[str, dict[str, Any]] | None, overwrite: bool) -> None:
    """Export the scene, or save it as Blender's own file."""
    if exporter is not None:
        own = f"{target.stem}.bin", f"{target.stem}.mtl"  # as the exporters name them
        with staged(target, overwrite, own) as path:
            call(exporter[0], filepath=str(path), **exporter[1])
        return
    with staged(target, overwrite) as path:
        # In the target's own folder, since the file names others relative to where it is saved.
        beside = target.absolute().with_name(f"{path.parent.name}.blend")
        try:
            call("wm.save_as_mainfile", filepath=str(beside), copy=True, check_existing=False)
            os.replace(beside, path)
        except ShockError as error:
            raise _unwritten(path, str(error)) from error
        finally:
            beside.unlink(missing_ok=True)


def image_format(target: Path) -> str:
    """Name Blender's format for a file's ending."""
    kind = _IMAGE_FORMATS.get(target.suffix.lower())
    if kind is None:
        raise ShockError(
            f"{target}: this ending cannot be handled here; use one of {', '.join(_IMAGE_FORMATS)}."
        )
    return kind


@contextmanager
def loaded_image(source: str) -> Iterator[bpy.types.Image]:
    """Give the image of a file: the open scene's own one, or one that is removed afterwards."""
    check_file(Path(source))
    known = set(bpy.data.images)
    try:
        image = bpy.data.images.load(str(Path(source).absolute()), check_existing=True)
    except RuntimeError as error:
        raise ShockError(str(error).strip().removeprefix("Error: ")) from error
    try:
        if not image.size[0] * image.size[1]:
            raise ShockError(f"{source} cannot be read; is it an image, and not damaged?")
        yield image
    finally:
        if image not in known:
            bpy.data.images.remove(image)


def write_image(image: bpy.types.Image, path: Path) -> None:
    """Save an image in its own format."""
    try:
        image.save(filepath=str(path))
    except RuntimeError as error:
        raise _unwritten(path, str(error).strip().removeprefix("Error: ")) from error


def write_values(path: Path, kind: str, shown: Any) -> None:
    """Write gray values or colors, bytes or floats."""
    import numpy as np

    height, width = shown.shape[:2]
    is_float = shown.dtype.kind == "f"
    pixels = np.ones((height, width, 4), dtype=np.float32)
    pixels[..., :3] = shown.reshape(height, width, -1) / np.float32(1 if is_float else 255)
    image = bpy.data.images.new(
        "mask", width, height, alpha=False, float_buffer=is_float, is_data=True
    )
    image.pixels.foreach_set(pixels.reshape(-1))
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
    try:
        result = operator(name)(**options)
    except RuntimeError as error:
        raise ShockError(str(error).strip().removeprefix("Error: ")) from error
    if result != {"FINISHED"}:
        raise ShockError(f"Blender's {name} stopped before its end.")


def _unwritten(path: Path, reason: str) -> ShockError:
    # Blender names no reason for a full disk, or a wrong one.
    return ShockError(
        f"{path.name} cannot be written ({reason}); is there room on the disk and in the folder a"
        " right to write?"
    )


def _unknown(path: str, known: list[str]) -> ShockError:
    endings = ", ".join([".blend", *known])
    return ShockError(f"{path}: this Blender cannot handle this ending; use one of {endings}.")
