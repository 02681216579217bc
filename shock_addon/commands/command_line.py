# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line in Blender: ``blender --command shock_filter`` and batch.py."""

from __future__ import annotations

import argparse
import math
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import bpy

from ...core import cli
from ...core import host as filters
from ...core.errors import Cancelled, InvalidUV, ShockError
from ...core.files.output import Outcome, staged
from ...core.files.reading import check_file
from .. import data
from ..data.skipped import Skipped
from ..operators import base as operators
from ..operators import kernels
from ..operators.properties import COLOR_PREFIX

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

_ARRAY = ".npy"
_AXES = ["x", "y", "z"]


def run(arguments: Sequence[str], program: str) -> int:
    """Run the command line in this Blender; returns the exit code, usage errors included."""
    try:
        return cli.main(arguments, BlenderBackend(program))
    except SystemExit as stop:  # argparse ends so: after --help and on usage errors
        return int(stop.code or 0)


class BlenderBackend:
    """Reads with Blender's importers, filters with its operators, writes with the exporters."""

    def __init__(self, program: str) -> None:
        self.prog = program

    def formats(self, command: cli.Command) -> str:
        """Name the files that a command reads and writes."""
        images = "PNG, JPEG, TIFF, EXR, HDR, Targa, BMP and WebP files"
        if command in cli.ON_IMAGES:
            return f"{images}, which keep their format"
        if command.on_mesh:
            return f"{images}, which keep their format, on whatever meshes this Blender reads"
        if command is cli.TEXTURE_MASK:
            return f"from whatever this Blender reads to {images}; EXR and NumPy hold numbers"
        return (
            "whatever this Blender reads and writes, such as blend, OBJ, PLY, STL, glTF, FBX, USD"
        )

    def add_arguments(self, parser: argparse.ArgumentParser, command: cli.Command) -> None:
        """Add the flags for objects, vertex groups and color attributes."""
        if command in cli.ON_IMAGES:
            return
        if command is cli.TEXTURE:
            parser.add_argument(
                "--mask",
                metavar="FILE",
                default="",
                help="gray image of the same size: black stays, white changes fully",
            )
        elif command in (*cli.ON_GEOMETRY, *cli.ON_COLORS):
            parser.add_argument(
                "--mask",
                metavar="NAME",
                default="",
                help="vertex group that says how much is done to each vertex: 0 keeps it, 1"
                " changes it fully",
            )
        if command not in (cli.DILATE, cli.TEXTURE_MASK):
            parser.add_argument("--invert-mask", action="store_true", help="use one minus the mask")
        parser.add_argument(
            "--object",
            metavar="NAME",
            action="append",
            dest="objects",
            help="take this object only, even if it is hidden (may be repeated); without it, all"
            " visible meshes of the scene",
        )
        if command in cli.ON_COLORS:
            parser.add_argument(
                "--attribute",
                metavar="NAME",
                default="",
                help="color attribute to work on; each mesh's active one if left out",
            )
        if command in cli.ON_GEOMETRY:
            _add_shape_flags(parser, command)

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
        if command in cli.ON_IMAGES:
            return _sharpen_image(command, source, target, settings, options, progress)
        if command.on_mesh:
            return _filter_texture(command, source, target, settings, options, progress)
        if command is cli.TEXTURE_MASK:
            return _draw_mask(source, target, options, progress)
        return _sharpen_meshes(command, source, target, settings, options, progress)


def _add_shape_flags(parser: argparse.ArgumentParser, command: cli.Command) -> None:
    """Add what the operators have beside settings, under their names and in their words."""
    known = _operator(_operator_name(command)).get_rna_type().properties
    normals = known["custom_normals"]
    meanings = [f"{i.identifier.lower()}: {i.description}." for i in normals.enum_items]
    parser.add_argument(
        "--custom-normals",
        choices=[item.identifier.lower() for item in normals.enum_items],
        default=normals.default.lower(),
        help=f"{normals.description}. {' '.join(meanings)} (default {normals.default.lower()})",
    )
    parser.add_argument(
        "--mark-sharp", action="store_true", help=f"{known['mark_sharp'].description}."
    )
    angle = known["sharp_angle"]
    parser.add_argument(
        "--sharp-angle",
        type=_angle,
        metavar="N",
        help=f"{angle.description}. Implies --mark-sharp. (default"
        f" {math.degrees(angle.default):g}, 0 to 180, degrees)",
    )
    parser.add_argument(
        "--mirror",
        choices=_AXES,
        action="append",
        default=[],
        help="keep what is symmetric across this plane of the object so, as the mesh's mirror"
        " option does (may be repeated); meshes whose option is on stay symmetric without it",
    )
    parser.add_argument(
        "--new-shape-key",
        action="store_true",
        help="keep the mesh and put the new shape into a new shape key of value 1, whose slider"
        " sets the strength later; OUT must be of a format with shape keys, or it holds the new"
        " shape",
    )


def _angle(text: str) -> float:
    """Radians."""
    degrees = float(text)
    if not 0.0 <= degrees <= 180.0:
        raise ValueError
    return math.radians(degrees)


_angle.__name__ = "angle from 0 to 180"  # argparse says "invalid angle ... value"


def _shape_values(options: argparse.Namespace) -> dict[str, Any]:
    values: dict[str, Any] = {
        "output": "SHAPE_KEY" if options.new_shape_key else "MESH",
        "custom_normals": options.custom_normals.upper(),
        "mark_sharp": options.mark_sharp or options.sharp_angle is not None,
    }
    if options.sharp_angle is not None:
        values["sharp_angle"] = options.sharp_angle
    return values


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
    axes: list[str] = []
    if command in cli.ON_COLORS:
        values["attribute"] = options.attribute
        look, done = partial(_colors, name=options.attribute), "changed {changed} of {total} colors"
    else:
        values |= _shape_values(options)
        axes = options.mirror
        look = _visible_shape if options.new_shape_key else _coordinates
        done = "moved {changed} of {total} vertices"
    before = [look(obj) for obj in objects]
    with _selected(objects), _mirrored(objects, axes):
        _run_operator(command, settings, values, options, progress)
    after = [look(obj) for obj in objects]
    changed = sum(_count_changed(old, new) for old, new in zip(before, after, strict=True))
    if not progress(1.0, "Writing"):
        raise Cancelled("Interrupted before writing.")
    if exporter is None:
        _save(target, options.overwrite)
    else:
        with staged(target, options.overwrite) as path:
            _call(exporter[0], filepath=str(path), **exporter[1])
    return Outcome(sum(map(len, before)), changed, tuple(notes), done)


@contextmanager
def _selected(objects: list[bpy.types.Object]) -> Iterator[None]:
    """Have operators act on these objects; the file's own selection stays as it is."""
    active = bpy.context.view_layer.objects.active
    if active is not None and active.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    with bpy.context.temp_override(
        selected_objects=objects,
        selected_editable_objects=objects,
        active_object=objects[0],
        object=objects[0],
    ):
        yield


@contextmanager
def _mirrored(objects: list[bpy.types.Object], axes: list[str]) -> Iterator[None]:
    """Turn on the meshes' mirror options for these axes; the file's own ones come back."""
    names = [f"use_mirror_{axis}" for axis in axes]
    turned_on = [
        (obj.data, name) for obj in objects for name in names if not getattr(obj.data, name)
    ]
    for mesh, name in turned_on:
        setattr(mesh, name, True)
    try:
        yield
    finally:
        for mesh, name in turned_on:
            setattr(mesh, name, False)


def _sharpen_image(
    command: cli.Command,
    source: str,
    target: Path,
    settings: Any,
    options: argparse.Namespace,
    progress: operators.Progress,
    more: dict[str, Any] | None = None,
) -> Outcome:
    with _loaded_image(source) as image:
        kind = _image_format(target)
        if image.file_format != kind:
            raise ShockError(
                f"{source} is a {image.file_format} file, and Blender keeps its depth only in this"
                " format; end OUT accordingly, or use shock-filter outside Blender."
            )
        before = _pixels(image)
        values = {"image": image.name, "output": "REPLACE", **(more or {})}
        _run_operator(command, settings, values, options, progress)
        changed = _count_changed(before, _pixels(image))
        with staged(target, options.overwrite) as path:
            if changed:
                _write_image(image, path)
            else:
                shutil.copyfile(source, path)
    notes = ("Blender writes no further layers, nor metadata that it does not know",)
    return Outcome(
        len(before), changed, notes if changed else (), "changed {changed} of {total} pixels"
    )


def _filter_texture(
    command: cli.Command,
    source: str,
    target: Path,
    settings: Any,
    options: argparse.Namespace,
    progress: operators.Progress,
) -> Outcome:
    _image_format(target)
    _open(options.mesh)
    objects, notes = _chosen(options.objects)
    with ExitStack() as stack:
        stack.enter_context(_selected(objects))
        more: dict[str, Any] = {}
        if command is cli.TEXTURE and options.mask:
            mask = stack.enter_context(_loaded_image(options.mask))
            more = {"mask_image": mask.name, "invert_mask": options.invert_mask}
        outcome = _sharpen_image(command, source, target, settings, options, progress, more)
    return replace(outcome, notes=(*notes, *outcome.notes))


def _draw_mask(
    source: str, target: Path, options: argparse.Namespace, progress: operators.Progress
) -> Outcome:
    ending = target.suffix.lower()
    kind = None if ending == _ARRAY else _image_format(target)
    _open(source)
    objects, notes = _chosen(options.objects)
    size = options.size
    if size is None:
        with _loaded_image(options.like) as image:
            size = image.size[1], image.size[0]
    kernels.choose_folder()
    kernels.load()
    import numpy as np

    from ...core.files.textures import mask_outcome, mask_pixels

    try:
        faces, _, skipped = data.read_faces(bpy.context, objects, None, data.EVERYWHERE)
    except Skipped as reason:
        raise InvalidUV(f"{source}: {reason}.") from reason
    atlas = filters.analyse(faces, size, progress)
    shown = mask_pixels(atlas, options.kind, ending)
    with staged(target, options.overwrite) as path:
        if kind is None:
            np.save(path, shown[::-1])
        else:
            _save_picture(path, kind, shown)
    return mask_outcome(atlas, (*notes, *skipped))


def _save_picture(path: Path, kind: str, shown: Any) -> None:
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
    _write_image(image, path)
    bpy.data.images.remove(image)


def _write_image(image: bpy.types.Image, path: Path) -> None:
    try:
        image.save(filepath=str(path))
    except RuntimeError as error:
        raise _unwritten(path, str(error).strip().removeprefix("Error: ")) from error


def _image_format(target: Path) -> str:
    kind = _IMAGE_FORMATS.get(target.suffix.lower())
    if kind is None:
        raise ShockError(
            f"{target}: this ending cannot be handled here; use one of {', '.join(_IMAGE_FORMATS)}."
        )
    return kind


@contextmanager
def _loaded_image(source: str) -> Iterator[bpy.types.Image]:
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
    check_file(Path(source))
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


def _save(target: Path, overwrite: bool) -> None:
    with staged(target, overwrite) as path:
        # In the target's own folder, since the file names others relative to where it is saved.
        beside = target.absolute().with_name(f"{path.parent.name}.blend")
        try:
            _call("wm.save_as_mainfile", filepath=str(beside), copy=True, check_existing=False)
            os.replace(beside, path)
        except ShockError as error:
            raise _unwritten(path, str(error)) from error
        finally:
            beside.unlink(missing_ok=True)


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


# The operator Denoise has more than one target, the settings of which have names of their own.
_DENOISE = {
    cli.DENOISE_GEOMETRY: ("shock_filter.denoise", "", {"target": "geometry"}),
    cli.DENOISE_COLORS: ("shock_filter.denoise", COLOR_PREFIX, {"target": "colors"}),
    cli.DENOISE_IMAGE: ("shock_filter.denoise_image", "", {}),
}


def _operator_name(command: cli.Command) -> str:
    if command in _DENOISE:
        return _DENOISE[command][0]
    return f"shock_filter.{command.name.replace('-', '_')}"


def _values_of(command: cli.Command, settings: Any, options: argparse.Namespace) -> dict[str, Any]:
    """Return the values of the operator's properties."""
    values = asdict(settings)
    if command not in _DENOISE:
        if math.isinf(values.get("time", 0.0)):
            values |= {"time": 0.0, "steady_state": True}
        return values
    _, prefix, more = _DENOISE[command]
    values = {prefix + key: value for key, value in values.items()} | more
    if options.then_sharpen is not None:
        values |= {"then_sharpen": True, "sharpen_time": options.then_sharpen}
    return values


def _run_operator(
    command: cli.Command,
    settings: Any,
    more: dict[str, Any],
    options: argparse.Namespace,
    progress: operators.Progress,
) -> None:
    values = _values_of(command, settings, options)
    cancelled = False

    def listen(fraction: float, message: str) -> bool:
        nonlocal cancelled
        cancelled = not progress(0.9 * fraction, message)
        return not cancelled

    operators.listener = listen
    try:
        _call(_operator_name(command), **more, **values)
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


def _visible_shape(obj: bpy.types.Object) -> Any:
    """Vertex positions as the shape keys mix them: (n, 3)."""
    from ..data import shape_keys

    keys = obj.data.shape_keys
    if keys is None or not keys.use_relative:
        return _coordinates(obj)
    return shape_keys.visible_shape(obj, "OBJECT")


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


def _unwritten(path: Path, reason: str) -> ShockError:
    # Blender names no reason for a full disk, or a wrong one.
    return ShockError(
        f"{path.name} cannot be written ({reason}); is there room on the disk and in the folder a"
        " right to write?"
    )


def _unknown(path: str, known: list[str]) -> ShockError:
    endings = ", ".join([".blend", *known])
    return ShockError(f"{path}: this Blender cannot handle this ending; use one of {endings}.")
