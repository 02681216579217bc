# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import bpy

from ..core.errors import (
    Cancelled,
    InvalidMesh,
    InvalidSettings,
    InvalidSignal,
    ShockError,
    SolverError,
)
from ..core.settings import GeometrySettings
from . import kernels
from .jobs import ModalJob, Work, current
from .mesh_data import Target, mesh_objects, object_mode, read_targets, write_target
from .properties import GeometryProperties, settings_from
from .skipped import Skipped

Progress = Callable[[float, str], bool]

last_summary = ""
listener: Progress | None = None
"""Asked too while `execute` runs, when set: the command line's progress bar and Ctrl-C."""

_HARDLY_SEEN = 0.02  # mean edge lengths


class SHOCK_FILTER_OT_sharpen_geometry(ModalJob, GeometryProperties, bpy.types.Operator):
    """Turn rounded creases into sharp ones: normals flow towards the creases, positions follow"""

    bl_idname = "shock_filter.sharpen_geometry"
    bl_label = "Sharpen Geometry"
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Want a mesh object and no other run."""
        if current() is not None:
            cls.poll_message_set("A run is under way; wait for it, or press Esc to cancel it.")
            return False
        if not mesh_objects(context):
            cls.poll_message_set("Select a mesh object.")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Run to the end: for scripts, background and redo."""
        work = self._prepare(context)
        if work is None:
            return {"CANCELLED"}
        manager = context.window_manager
        manager.progress_begin(0.0, 1.0)
        try:
            return self.finish(context, lambda: work(_shown_by(manager)))
        finally:
            manager.progress_end()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Run on a thread, so that the window stays alive."""
        if bpy.app.background or context.window is None:
            return self.execute(context)
        work = self._prepare(context)
        return {"CANCELLED"} if work is None else self.start(context, work)

    def _prepare(self, context: bpy.types.Context) -> Work | None:
        self._began = time.perf_counter()
        try:
            settings = settings_from(GeometrySettings, self)
        except InvalidSettings as error:
            self.report({"ERROR"}, str(error))
            return None
        self._targets, self._skipped = read_targets(context, self)
        if not self._targets:
            self.report({"ERROR"}, " ".join(self._skipped) or "Select a mesh object.")
            return None
        targets, weld, folder = self._targets, self.weld, kernels.cache_folder()
        return lambda progress: sharpen_targets(targets, settings, weld, folder, progress)

    def finish(self, context: bpy.types.Context, compute: Callable[[], Any]) -> set[str]:
        """Write the results and say what was done."""
        try:
            results = compute()
        except Cancelled as error:
            self.report({"INFO"}, str(error))
            return {"CANCELLED"}
        except ShockError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        with object_mode(context):
            written, skipped = write_results(self._targets, results)
        skipped = self._skipped + skipped
        if not written:
            self.report({"ERROR"}, " ".join(skipped))
            return {"CANCELLED"}
        for reason in skipped:
            self.report({"WARNING"}, reason)
        _remember(summary(written, time.perf_counter() - self._began))
        self.report({"INFO"}, f"{last_summary} {notes([obj for obj, _ in written])}".strip())
        return {"FINISHED"}


def sharpen_targets(
    targets: list[Target],
    settings: GeometrySettings,
    weld: bool,
    folder: str | None,
    progress: Progress,
) -> list[Any]:
    """Sharpen all targets, on any thread; one that fails gives its error as its result."""
    progress(0.0, "Preparing (compiles on first use)")
    kernels.load(folder)
    from .sharpening import sharpen

    total = sum(len(target.surface.positions) for target in targets)
    done = 0
    results: list[Any] = []
    for target in targets:
        size = len(target.surface.positions)

        def part(fraction: float, message: str, done: int = done, size: int = size) -> bool:
            return progress((done + fraction * size) / total, message)

        try:
            results.append(sharpen(target.surface, settings, weld, part))
        except (InvalidMesh, InvalidSignal, SolverError) as error:
            results.append(error)
        done += size
    return results


def write_results(targets: list[Target], results: list[Any]) -> tuple[list[tuple], list[str]]:
    """Write what was computed; returns (object, result) pairs and reasons for the others."""
    written, skipped = [], []
    for target, result in zip(targets, results, strict=True):
        if isinstance(result, ShockError):
            skipped.append(f"Skipped {target.name}: {result}")
            continue
        try:
            written.append((write_target(target, result.positions), result))
        except Skipped as reason:
            skipped.append(f"Skipped {target.name}: {reason}.")
    return written, skipped


def summary(written: list[tuple], seconds: float) -> str:
    """Say in one line what was done and how long it took."""
    meshes = "1 mesh" if len(written) == 1 else f"{len(written)} meshes"
    vertices = sum(len(result.positions) for _, result in written)
    moved = sum(result.moved for _, result in written)
    largest = max(result.largest_move for _, result in written)
    text = (
        f"Sharpened {meshes}: {vertices:,} vertices, moved {moved:,}, largest move"
        f" {largest:.2g} edge lengths, {seconds:.1f} s."
    )
    if largest < _HARDLY_SEEN:
        text += " For wide or gentle creases raise Time or lower Feature Threshold."
    return text


def notes(objects: list[bpy.types.Object]) -> str:
    """Say what was left as it is although it shapes what is seen."""
    found = []
    if any(obj.modifiers for obj in objects):
        found.append("Modifiers were left in place and act on the new shape.")
    if any(obj.data.has_custom_normals for obj in objects):
        found.append("Custom normals were kept; clear them if the shading looks wrong.")
    return " ".join(found)


def _shown_by(manager: bpy.types.WindowManager) -> Progress:
    def show(fraction: float, message: str) -> bool:
        manager.progress_update(fraction)
        return listener is None or listener(fraction, message)

    return show


def _remember(text: str) -> None:
    global last_summary
    last_summary = text


CLASSES = (SHOCK_FILTER_OT_sharpen_geometry,)
