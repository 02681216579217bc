# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line in Blender: ``blender --command shock_filter`` and batch.py."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ..core.errors import Cancelled, ShockError
from ..core.output import Outcome, staged
from . import operators

if TYPE_CHECKING:
    from ..core.settings import GeometrySettings

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
    ".obj": ("wm.obj_export", {"path_mode": "COPY"}),
    ".ply": ("wm.ply_export", {}),
    ".stl": ("wm.stl_export", {}),
    **{ending: ("wm.usd_export", {}) for ending in _USD},
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
    from ..core import cli

    try:
        return cli.main(arguments, BlenderBackend(program))
    except SystemExit as stop:  # argparse ends so: after --help and on usage errors
        return int(stop.code or 0)


def _command(arguments: list[str]) -> int:
    return run(arguments, f"blender --command {COMMAND}")


class BlenderBackend:
    """Reads with Blender's importers, sharpens with the operator, writes with the exporters."""

    formats = "whatever this Blender reads and writes, such as blend, OBJ, PLY, STL, glTF, FBX, USD"

    def __init__(self, program: str) -> None:
        self.prog = program

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the flags for vertex groups and objects."""
        parser.add_argument(
            "--mask",
            metavar="NAME",
            default="",
            help="vertex group that says how far each vertex may go: 0 stays, 1 moves fully",
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

    def sharpen_geometry(
        self,
        source: str,
        target: Path,
        settings: GeometrySettings,
        options: argparse.Namespace,
        progress: Callable[[float, str], bool],
    ) -> Outcome:
        """Sharpen the meshes of one file into another; IN may be - for the open file."""
        exporter = _exporter(target)
        _open(source)
        objects, notes = _chosen(options.objects)
        before = [_coordinates(obj) for obj in objects]
        _sharpen(objects, settings, options, progress)
        after = [_coordinates(obj) for obj in objects]
        moved = sum(
            int((old != new).any(axis=1).sum()) for old, new in zip(before, after, strict=True)
        )
        if not progress(1.0, "Writing"):
            raise Cancelled("Interrupted before writing.")
        if exporter is None:
            _save(target)
        else:
            with staged(target, options.overwrite) as path:
                _call(exporter[0], filepath=str(path), **exporter[1])
        return Outcome(sum(map(len, before)), moved, tuple(notes))


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
    if Path(source).is_dir():
        raise ShockError(f"{source} is a folder; name the files in it.")
    if not Path(source).exists():
        raise ShockError(f"There is no file {source}; check its name and folder.")
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


def _sharpen(
    objects: list[bpy.types.Object],
    settings: GeometrySettings,
    options: argparse.Namespace,
    progress: operators.Progress,
) -> None:
    values = asdict(settings)
    if math.isinf(settings.time):
        values |= {"time": 0.0, "steady_state": True}
    active = bpy.context.view_layer.objects.active
    if active is not None and active.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    cancelled = False

    def listen(fraction: float, message: str) -> bool:
        nonlocal cancelled
        cancelled = not progress(0.9 * fraction, message)
        return not cancelled

    operators.listener = listen
    # Overriding the context leaves the file's own selection as it is.
    try:
        with bpy.context.temp_override(
            selected_objects=objects,
            selected_editable_objects=objects,
            active_object=objects[0],
            object=objects[0],
        ):
            _call(
                "shock_filter.sharpen_geometry",
                vertex_group=options.mask,
                invert_mask=options.invert_mask,
                **values,
            )
    except ShockError:
        if cancelled:
            raise Cancelled("Interrupted; nothing was written.") from None
        raise
    finally:
        operators.listener = None


def _coordinates(obj: bpy.types.Object) -> Any:
    """Vertex positions of the mesh, or of its active shape key: (n, 3)."""
    import numpy as np

    points = obj.data.attributes["position"].data
    name = "vector"
    if obj.active_shape_key is not None:
        points, name = obj.active_shape_key.data, "co"
    values = np.empty(3 * len(obj.data.vertices), dtype=np.float32)
    points.foreach_get(name, values)
    return values.reshape(-1, 3)


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
