# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line in Blender: ``blender --command shock_filter`` and batch.py."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy

from ...core import cli
from ...core.cli import flows
from ...core.cli.parsing import sources_of
from ...core.errors import Cancelled, InvalidUV, ShockError
from ...core.files.output import Outcome, staged
from ...core.registry import FIELD, FLOW, GEOMETRY, MASK
from .. import data
from ..data import PICTURES
from ..data.skipped import Skipped
from ..operators import base as operators
from ..running import kernels
from . import blender_files as files
from . import flags

Progress = operators.Progress

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
        self.offered = cli.COMMANDS

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
        progress: Progress,
    ) -> Outcome:
        """Filter one file into another; IN may be - for the open file, but not for images."""
        if command.kind is MASK:
            return _draw_mask(source, target, options, progress)
        if command.kind is FLOW:
            return _visualize(source, target, settings, options, progress)
        if command.kind is FIELD:
            return _draw_field(source, target, settings, options, progress)
        run = _Run(command, flags.values_of(command, settings, options), progress)
        if not command.kind.is_image:
            return _filter_meshes(run, source, target, options)
        filter_file = _filter_texture if command.kind.on_mesh else _filter_image
        return filter_file(run, source, target, options)


class _Run:
    """A run of a command's operator; `listener` of the operators while it is under way."""

    def __init__(self, command: cli.Command, values: dict[str, Any], progress: Progress) -> None:
        self.command, self.values, self.progress = command, values, progress
        self.counts = 0, 0
        self._cancelled = False

    def __call__(self, fraction: float, message: str) -> bool:
        """Pass the progress on."""
        self._cancelled = not self.progress(0.9 * fraction, message)
        return not self._cancelled

    def start(self, **more: Any) -> tuple[int, int]:
        """Run, and return how many vertices, colors or pixels changed, and how many there are."""
        operators.listener = self
        try:
            name = flags.mode_of(self.command)[0].operator
            files.call(f"shock_filter.{name}", **self.values, **more)
        except ShockError:
            if self._cancelled:
                raise Cancelled("Interrupted; nothing was written.") from None
            raise
        finally:
            operators.listener = None
        return self.counts


def _filter_meshes(run: _Run, source: str, target: Path, options: argparse.Namespace) -> Outcome:
    files.check_ending(target)
    objects, notes = _opened(source, options)
    moves = run.command.kind is GEOMETRY
    with _selected(objects), _mirrored(objects, options.mirror if moves else []):
        changed, total = run.start()
    if not run.progress(1.0, "Writing"):
        raise Cancelled("Interrupted before writing.")
    files.save_scene(target, options.overwrite)
    verb, things = ("moved", "vertices") if moves else ("changed", "colors")
    return Outcome(total, changed, tuple(notes), f"{verb} {{changed}} of {{total}} {things}")


def _selected(objects: list[bpy.types.Object]) -> AbstractContextManager:
    """Select these objects for operators, and restore the selection of the file afterwards."""
    active = bpy.context.view_layer.objects.active
    if active is not None and active.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    return bpy.context.temp_override(
        selected_objects=objects,
        selected_editable_objects=objects,
        active_object=objects[0],
        object=objects[0],
    )


@contextmanager
def _mirrored(objects: list[bpy.types.Object], axes: list[str]) -> Iterator[None]:
    """Turn on mirror options of the meshes for these axes, and restore them afterwards."""
    names = [f"use_mirror_{axis}" for axis in axes]
    meshes = [obj.data for obj in objects]
    turned_on = [(mesh, name) for mesh in meshes for name in names if not getattr(mesh, name)]
    for mesh, name in turned_on:
        setattr(mesh, name, True)
    try:
        yield
    finally:
        for mesh, name in turned_on:
            setattr(mesh, name, False)


def _filter_image(run: _Run, source: str, target: Path, options: argparse.Namespace) -> Outcome:
    with files.loaded_image(source) as image:
        kind = files.image_format(target)
        if image.file_format != kind:
            raise ShockError(
                f"{source} is a {image.file_format} file, and Blender keeps its depth only in this"
                " format; end OUT accordingly, or use shock-filter outside Blender."
            )
        changed, total = run.start(image=image.name, output="REPLACE")
        with staged(target, options.overwrite) as path:
            if changed:
                files.write_image(image, path)
            else:
                shutil.copyfile(source, path)
    notes = ("Blender writes no further layers, nor metadata that it does not know",)
    return Outcome(total, changed, notes if changed else (), "changed {changed} of {total} pixels")


def _filter_texture(run: _Run, source: str, target: Path, options: argparse.Namespace) -> Outcome:
    files.image_format(target)
    objects, notes = _opened(options.mesh, options)
    with ExitStack() as stack:
        stack.enter_context(_selected(objects))
        if run.command.takes_mask and options.mask:
            mask = stack.enter_context(files.loaded_image(options.mask))
            run.values |= {"mask_image": mask.name, "invert_mask": options.invert_mask}
        if run.command.takes_gain and options.gain_map:
            gains = stack.enter_context(files.loaded_image(options.gain_map))
            run.values["gain_map"] = gains.name
        if run.command.takes_others:
            run.values |= _pictures(options.others, stack)
        outcome = _filter_image(run, source, target, options)
    return replace(outcome, notes=(*notes, *outcome.notes))


def _pictures(paths: list[str], stack: ExitStack) -> dict[str, str]:
    if len(paths) > len(PICTURES):
        raise ShockError(
            f"--with is given {len(paths)} times, and Blender joins {len(PICTURES) + 1} pictures at"
            " most; join the others in a second run, or use shock-filter outside Blender."
        )
    images = [stack.enter_context(files.loaded_image(path)) for path in paths]
    return {name: image.name for name, image in zip(PICTURES, images, strict=False)}


def _draw_mask(
    source: str, target: Path, options: argparse.Namespace, progress: Progress
) -> Outcome:
    ending = target.suffix.lower()
    kind = None if ending == _ARRAY else files.image_format(target)
    faces, size, notes = _to_draw_on(source, options)
    from ...core.files.textures import mask_outcome, mask_pixels
    from ...core.host.textures import analyse

    atlas = analyse(faces, size, progress)
    shown = mask_pixels(atlas, options.kind, ending)
    with staged(target, options.overwrite) as path:
        files.write_values(path, kind, shown)
    return mask_outcome(atlas, notes)


def _draw_field(
    source: str, target: Path, settings: Any, options: argparse.Namespace, progress: Progress
) -> Outcome:
    kind = None if target.suffix.lower() == _ARRAY else files.image_format(target)
    faces, size, notes = _to_draw_on(source, options)
    import numpy as np

    from ...core.files.fields import FILES, field_outcome, field_pixels
    from ...core.host.fields import FieldSurface, generate

    given = sources_of(options)
    for flag, name in FILES.items():
        if flag in given:
            with files.loaded_image(given.pop(flag)) as image:
                given[name] = data.image.textures.grays_of(data.arrays.read_pixels(image))
    surface = FieldSurface(faces, size, given)
    made = generate(surface, options.command.name, settings, progress)
    pixels = field_pixels(made.values, made.shown, target, np.uint8)
    with staged(target, options.overwrite) as path:
        files.write_values(path, kind, pixels)
    return field_outcome(made.values, made.shown, (*notes, *made.notes))


def _visualize(
    source: str,
    target: Path,
    shown: flows.Shown,
    options: argparse.Namespace,
    progress: Progress,
) -> Outcome:
    from ...core.files.flows import check_target_of_flow, write_flow
    from ...core.files.output import Options
    from ...core.files.velocities import How, PlaneFlow, read_velocity

    behind = None
    if options.background:
        with files.loaded_image(options.background) as image:
            behind = data.arrays.read_pixels(image)[::-1, :, :3].copy()
    look = flows.look_of(shown, options, behind)
    check_target_of_flow(target, look, options.overwrite)
    ending = Path(source).suffix.lower()
    if ending not in flows.ARRAYS and not files.is_image(source):
        return _visualize_meshes(source, target, look, options, progress)
    kernels.load()
    if ending in flows.ARRAYS:
        flow = read_velocity(source, How(**flows.how_to_read(options)))
    else:
        with files.loaded_image(source) as image:
            flow = PlaneFlow(data.image.flows.read_map(image, options.y_axis).surface.velocity)
    return write_flow(flow, target, look, Options(overwrite=options.overwrite, progress=progress))


def _visualize_meshes(
    source: str, target: Path, look: Any, options: argparse.Namespace, progress: Progress
) -> Outcome:
    from ...core.files.flows import size_on_surface, write_pictures
    from ...core.host.advection import FlowSurface, frames_of

    options.size = size_on_surface(look)
    faces, size, notes = _to_draw_on(source, options)
    objects, _ = _chosen(source, options)
    try:
        ((of, given),) = data.image.fields.read_directions(objects, options.attribute).items()
    except Skipped as reason:
        raise ShockError(f"{source}: {reason}.") from reason
    surface = FlowSurface(faces, size, of, given)
    pictures = frames_of(
        surface, look.settings, look.frames, look.in_colors, progress, look.background
    )
    return write_pictures(pictures, target, look, notes, options.overwrite)


def _to_draw_on(source: str, options: argparse.Namespace) -> tuple[Any, tuple[int, int], tuple]:
    """Open a file; return its faces, the height and width of the image, and remarks."""
    objects, notes = _opened(source, options)
    size = options.size
    if size is None:
        with files.loaded_image(options.like) as image:
            size = image.size[1], image.size[0]
    kernels.load()
    try:
        faces, _, skipped = data.image.textures.read_faces(bpy.context, objects, None, None)
    except Skipped as reason:
        raise InvalidUV(f"{source}: {reason}.") from reason
    return faces, size, (*notes, *skipped)


def _opened(source: str, options: argparse.Namespace) -> tuple[list[bpy.types.Object], list[str]]:
    """Open a file; return objects to filter, each mesh once, and notes on skipped ones."""
    files.open_scene(source)
    return _chosen(source, options)


def _chosen(source: str, options: argparse.Namespace) -> tuple[list[bpy.types.Object], list[str]]:
    names = options.objects
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
    if not any(obj.data.polygons for obj in chosen):
        name = "The open file" if source == files.OPEN_FILE else source
        raise ShockError(f"{name} has no faces; is it a mesh, and not cut short?")
    notes = [f"hidden, so left as they are: {', '.join(hidden)}"] if hidden else []
    return list({obj.data: obj for obj in chosen}.values()), notes
