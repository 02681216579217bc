# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line in Blender: ``blender --command shock_filter`` and batch.py."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy

from ...core import cli, host
from ...core.errors import Cancelled, InvalidUV, ShockError
from ...core.files.output import Outcome, staged
from ...core.registry import GEOMETRY, MASK
from .. import data
from ..data.skipped import Skipped
from ..operators import base as operators
from ..operators import kernels
from . import blender_files as files
from . import flags

_ARRAY = ".npy"


def run(arguments: Sequence[str], program: str) -> int:
    """Run the command line in this Blender; returns the exit code, usage errors included."""
    try:
        return cli.main(arguments, BlenderBackend(program))
    except SystemExit as stop:  # argparse ends so: after --help and on usage errors
        return int(stop.code or 0)


class BlenderBackend:
    """Reads with Blender's importers, filters with its operators, writes with the exporters."""

    add_arguments = staticmethod(flags.add_arguments)

    def __init__(self, program: str) -> None:
        self.prog = program

    def formats(self, command: cli.Command) -> str:
        """Name the files that a command reads and writes."""
        return flags.FORMATS[command.kind]

    def filter(
        self,
        command: cli.Command,
        source: str,
        target: Path,
        settings: Any,
        options: argparse.Namespace,
        progress: operators.Progress,
    ) -> Outcome:
        """Filter one file into another; IN may be - for the open file, but not for images."""
        if command.kind is MASK:
            return _draw_mask(source, target, options, progress)
        values = flags.values_of(command, settings, options)
        run = _filter_meshes
        if command.kind.is_image:
            run = _filter_texture if command.kind.on_mesh else _filter_image
        return run(command, source, target, values, options, progress)


def _filter_meshes(
    command: cli.Command,
    source: str,
    target: Path,
    values: dict[str, Any],
    options: argparse.Namespace,
    progress: operators.Progress,
) -> Outcome:
    exporter = files.exporter_of(target)
    files.open_scene(source)
    objects, notes = _chosen(options.objects)
    axes = options.mirror if command.kind is GEOMETRY else []
    with _selected(objects), _mirrored(objects, axes):
        changed, total = _run_operator(command, values, progress)
    if not progress(1.0, "Writing"):
        raise Cancelled("Interrupted before writing.")
    files.save_scene(target, exporter, options.overwrite)
    done = "changed {changed} of {total} colors"
    if command.kind is GEOMETRY:
        done = "moved {changed} of {total} vertices"
    return Outcome(total, changed, tuple(notes), done)


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


def _filter_image(
    command: cli.Command,
    source: str,
    target: Path,
    values: dict[str, Any],
    options: argparse.Namespace,
    progress: operators.Progress,
) -> Outcome:
    with files.loaded_image(source) as image:
        kind = files.image_format(target)
        if image.file_format != kind:
            raise ShockError(
                f"{source} is a {image.file_format} file, and Blender keeps its depth only in this"
                " format; end OUT accordingly, or use shock-filter outside Blender."
            )
        more = {"image": image.name, "output": "REPLACE"}
        changed, total = _run_operator(command, values | more, progress)
        with staged(target, options.overwrite) as path:
            if changed:
                files.write_image(image, path)
            else:
                shutil.copyfile(source, path)
    notes = ("Blender writes no further layers, nor metadata that it does not know",)
    return Outcome(total, changed, notes if changed else (), "changed {changed} of {total} pixels")


def _filter_texture(
    command: cli.Command,
    source: str,
    target: Path,
    values: dict[str, Any],
    options: argparse.Namespace,
    progress: operators.Progress,
) -> Outcome:
    files.image_format(target)
    files.open_scene(options.mesh)
    objects, notes = _chosen(options.objects)
    with ExitStack() as stack:
        stack.enter_context(_selected(objects))
        if command.takes_mask and options.mask:
            mask = stack.enter_context(files.loaded_image(options.mask))
            values |= {"mask_image": mask.name, "invert_mask": options.invert_mask}
        outcome = _filter_image(command, source, target, values, options, progress)
    return replace(outcome, notes=(*notes, *outcome.notes))


def _draw_mask(
    source: str, target: Path, options: argparse.Namespace, progress: operators.Progress
) -> Outcome:
    ending = target.suffix.lower()
    kind = None if ending == _ARRAY else files.image_format(target)
    files.open_scene(source)
    objects, notes = _chosen(options.objects)
    size = options.size
    if size is None:
        with files.loaded_image(options.like) as image:
            size = image.size[1], image.size[0]
    kernels.choose_folder()
    kernels.load()
    import numpy as np

    from ...core.files.textures import mask_outcome, mask_pixels

    try:
        faces, _, skipped = data.textures.read_faces(bpy.context, objects, None, None)
    except Skipped as reason:
        raise InvalidUV(f"{source}: {reason}.") from reason
    atlas = host.textures.analyse(faces, size, progress)
    shown = mask_pixels(atlas, options.kind, ending)
    with staged(target, options.overwrite) as path:
        if kind is None:
            np.save(path, shown[::-1])
        else:
            files.write_values(path, kind, shown)
    return mask_outcome(atlas, (*notes, *skipped))


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


class _Listener:
    """Hears of an operator's progress, and what it has done."""

    def __init__(self, progress: operators.Progress) -> None:
        self._progress = progress
        self.cancelled = False
        self.counts = 0, 0

    def __call__(self, fraction: float, message: str) -> bool:
        self.cancelled = not self._progress(0.9 * fraction, message)
        return not self.cancelled


def _run_operator(
    command: cli.Command, values: dict[str, Any], progress: operators.Progress
) -> tuple[int, int]:
    """Return how many vertices, colors or pixels have changed, of how many."""
    operators.listener = listener = _Listener(progress)
    try:
        files.call(f"shock_filter.{flags.mode_of(command)[0].operator}", **values)
    except ShockError:
        if listener.cancelled:
            raise Cancelled("Interrupted; nothing was written.") from None
        raise
    finally:
        operators.listener = None
    return listener.counts
