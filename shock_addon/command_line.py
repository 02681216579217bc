# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line in Blender: ``blender --command shock_filter`` and batch.py."""

from __future__ import annotations

import argparse
import math
import shutil
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import bpy

from ..core import cli
from ..core.errors import Cancelled, ShockError
from ..core.output import Outcome, staged
from . import operators

COMMAND = "shock_filter"
OPEN_FILE = "-"

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

_handle: Any = None


def register() -> None:
    """Add ``blender --command shock_filter``."""
    global _handle
    _handle = bpy.utils.register_cli_command(COMMAND, _command)


def unregister() -> None:
    """Remove it."""
    global _handle
    bpy.utils.unregister_cli_command(_handle)
    _handle = None


def run(arguments: Sequence[str], program: str) -> int:
    """Run the command line in this Blender; returns the exit code, usage errors included."""
    try:
        return cli.main(arguments, BlenderBackend(program))
    except SystemExit as stop:  # argparse ends so: after --help and on usage errors
        return int(stop.code or 0)


def _command(arguments: list[str]) -> int:
    return run(arguments, f"blender --command {COMMAND}")


class BlenderBackend:
    """Reads with Blender's importers, sharpens with its operators, writes with the exporters."""

    def __init__(self, program: str) -> None:
        self.prog = program

    def formats(self, command: cli.Command) -> str:
        """Name the files that a command reads and writes."""
        if command is cli.IMAGE:
            return "PNG, JPEG, TIFF, EXR, HDR, Targa, BMP and WebP files, which keep their format"
        return (
            "whatever this Blender reads and writes, such as blend, OBJ, PLY, STL, glTF, FBX, USD"
        )

    def add_arguments(self, parser: argparse.ArgumentParser, command: cli.Command) -> None:
        """Add the flags for objects, vertex groups and color attributes."""
        if command is cli.IMAGE:
            return
        parser.add_argument(
            "--mask",
            metavar="NAME",
            default="",
            help="vertex group that says how much is done to each vertex: 0 keeps it, 1 sharpens"
            " it fully",
        )
        parser.add_argument("--invert-mask", action="store_true", help="use one minus the mask")
        parser.add_argument(
            "--object",
            metavar="NAME",
            action="append",
            dest="objects",
            help="sharpen this object only, even if it is hidden (may be repeated); without it,"
            " all visible meshes of the scene",
        )
        if command is cli.COLORS:
            parser.add_argument(
                "--attribute",
                metavar="NAME",
                default="",
                help="color attribute to sharpen; each mesh's active one if left out",
            )

    def sharpen(
        self,
        command: cli.Command,
        source: str,
        target: Path,
        settings: Any,
        options: argparse.Namespace,
        progress: operators.Progress,
    ) -> Outcome:
        """Sharpen one file into another; IN may be - for the open file, but not for images."""
        if command is cli.IMAGE:
            return _sharpen_image(command, source, target, settings, options, progress)
        return _sharpen_meshes(command, source, target, settings, options, progress)


def _sharpen_meshes(
    command: cli.Command,
    source: str,
    target: Path,
    settings: Any,
    options: argparse.Namespace,
    progress: operators.Progress,
) -> Outcome:
    exporter = _exporter(target)
    _open(source)
    objects, notes = _chosen(options.objects)
    values: dict[str, Any] = {"vertex_group": options.mask, "invert_mask": options.invert_mask}
    look, done = _coordinates, "moved {changed} of {total} vertices"
    if command is cli.COLORS:
        values["attribute"] = options.attribute
        look, done = partial(_colors, name=options.attribute), "changed {changed} of {total} colors"
    before = [look(obj) for obj in objects]
    active = bpy.context.view_layer.objects.active
    if active is not None and active.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    # Overriding the context leaves the file's own selection as it is.
    with bpy.context.temp_override(
        selected_objects=objects,
        selected_editable_objects=objects,
        active_object=objects[0],
        object=objects[0],
    ):
        _run_operator(command, settings, values, progress)
    after = [look(obj) for obj in objects]
    changed = sum(_count_changed(old, new) for old, new in zip(before, after, strict=True))
    if not progress(1.0, "Writing"):
        raise Cancelled("Interrupted before writing.")
    if exporter is None:
        _save(target)
    else:
        with staged(target, options.overwrite) as path:
            _call(exporter[0], filepath=str(path), **exporter[1])
    return Outcome(sum(map(len, before)), changed, tuple(notes), done)


def _sharpen_image(
    command: cli.Command,
    source: str,
    target: Path,
    settings: Any,
    options: argparse.Namespace,
    progress: operators.Progress,
) -> Outcome:
    kind = _IMAGE_FORMATS.get(target.suffix.lower())
    if kind is None:
        raise ShockError(
            f"{target}: this ending cannot be handled here; use one of {', '.join(_IMAGE_FORMATS)}."
        )
    image = _load_image(source)
    try:
        if image.file_format != kind:
            raise ShockError(
                f"{source} is a {image.file_format} file, and Blender keeps its depth only in this"
                " format; end OUT accordingly, or use shock-filter outside Blender."
            )
        before = _pixels(image)
        values = {"image": image.name, "output": "REPLACE"}
        _run_operator(command, settings, values, progress)
        changed = _count_changed(before, _pixels(image))
        with staged(target, options.overwrite) as path:
            if changed:
                image.save(filepath=str(path))
            else:
                shutil.copyfile(source, path)
    finally:
        bpy.data.images.remove(image)
    notes = ("Blender writes no further layers, nor metadata that it does not know",)
    return Outcome(
        len(before), changed, notes if changed else (), "changed {changed} of {total} pixels"
    )


def _load_image(source: str) -> bpy.types.Image:
    _check_file(source)
    try:
        image = bpy.data.images.load(str(Path(source).absolute()))
    except RuntimeError as error:
        raise ShockError(str(error).strip().removeprefix("Error: ")) from error
    if not image.size[0] * image.size[1]:
        bpy.data.images.remove(image)
        raise ShockError(f"{source} cannot be read; is it an image, and not damaged?")
    return image


def _exporter(target: Path) -> tuple[str, dict[str, Any]] | None:
    """Operator and options that write this ending; None for Blender's own format."""
    ending = target.suffix.lower()
    if ending == ".blend":
        return None
    if ending not in _EXPORTERS or not _exists(_EXPORTERS[ending][0]):
        raise _unknown(str(target), [e for e, (name, _) in _EXPORTERS.items() if _exists(name)])
    return _EXPORTERS[ending]


def _open(source: str) -> None:
    if source == OPEN_FILE:
        return
    _check_file(source)
    path = str(Path(source).absolute())
    ending = Path(source).suffix.lower()
    if ending == ".blend":
        _call("wm.open_mainfile", filepath=path, load_ui=False)
        return
    importer = next(filter(_exists, _IMPORTERS.get(ending, ())), None)
    if importer is None:
        known = [e for e, names in _IMPORTERS.items() if any(map(_exists, names))]
        raise _unknown(source, known)
    bpy.ops.wm.read_homefile(use_empty=True)
    _call(importer, filepath=path)


def _check_file(source: str) -> None:
    if Path(source).is_dir():
        raise ShockError(f"{source} is a folder; name the files in it.")
    if not Path(source).exists():
        raise ShockError(f"There is no file {source}; check its name and folder.")


def _save(target: Path) -> None:
    # Blender writes beside the file and renames at the end by itself.
    _call("wm.save_as_mainfile", filepath=str(target.absolute()), copy=True, check_existing=False)


def _chosen(names: list[str] | None) -> tuple[list[bpy.types.Object], list[str]]:
    """Objects to sharpen, each mesh once, and notes on those that are not."""
    meshes = {obj.name: obj for obj in bpy.context.scene.objects if obj.type == "MESH"}
    missing = sorted(set(names or ()) - set(meshes))
    if missing:
        raise ShockError(
            f"There is no mesh object {', '.join(missing)}; the scene has:"
            f" {', '.join(meshes) or 'none'}."
        )
    hidden = [] if names else [name for name, obj in meshes.items() if not obj.visible_get()]
    chosen = [meshes[name] for name in (names or meshes) if name not in hidden]
    if not chosen:
        raise ShockError("The scene has no visible mesh; show one or name it with --object.")
    notes = [f"hidden, so left as they are: {', '.join(hidden)}"] if hidden else []
    return list({obj.data: obj for obj in chosen}.values()), notes


def _run_operator(
    command: cli.Command, settings: Any, options: dict[str, Any], progress: operators.Progress
) -> None:
    values = asdict(settings)
    if math.isinf(settings.time):
        values |= {"time": 0.0, "steady_state": True}
    cancelled = False

    def listen(fraction: float, message: str) -> bool:
        nonlocal cancelled
        cancelled = not progress(0.9 * fraction, message)
        return not cancelled

    operators.listener = listen
    try:
        _call(f"shock_filter.{command.name.replace('-', '_')}", **options, **values)
    except ShockError:
        if cancelled:
            raise Cancelled("Interrupted; nothing was written.") from None
        raise
    finally:
        operators.listener = None


def _count_changed(old: Any, new: Any) -> int:
    return int((old != new).any(axis=1).sum())


def _coordinates(obj: bpy.types.Object) -> Any:
    """Vertex positions of the mesh, or of its active shape key: (n, 3)."""
    if obj.active_shape_key is not None:
        return _rows(obj.active_shape_key.data, "co", 3)
    return _rows(obj.data.attributes["position"].data, "vector", 3)


def _colors(obj: bpy.types.Object, name: str) -> Any:
    """The colors of an attribute, or of the active one: (n, 4); none if there is none."""
    attributes = obj.data.color_attributes
    attribute = attributes.get(name) if name else attributes.active_color
    return _rows(attribute.data if attribute is not None else (), "color", 4)


def _pixels(image: bpy.types.Image) -> Any:
    import numpy as np

    values = np.empty(len(image.pixels), dtype=np.float32)
    image.pixels.foreach_get(values)
    return values.reshape(image.size[0] * image.size[1], -1)


def _rows(collection: Any, name: str, width: int) -> Any:
    import numpy as np

    values = np.empty(width * len(collection), dtype=np.float32)
    if len(collection):
        collection.foreach_get(name, values)
    return values.reshape(-1, width)


def _operator(name: str) -> Any:
    group, _, function = name.partition(".")
    return getattr(getattr(bpy.ops, group), function)


def _exists(name: str) -> bool:
    try:
        _operator(name).get_rna_type()
    except KeyError:
        return False
    return True


def _call(name: str, **options: Any) -> None:
    """Call an operator; its error reports become a ShockError."""
    try:
        result = _operator(name)(**options)
    except RuntimeError as error:
        raise ShockError(str(error).strip().removeprefix("Error: ")) from error
    if result != {"FINISHED"}:
        raise ShockError(f"Blender's {name} stopped before its end.")


def _unknown(path: str, known: list[str]) -> ShockError:
    endings = ", ".join([".blend", *known])
    return ShockError(f"{path}: this Blender cannot handle this ending; use one of {endings}.")
