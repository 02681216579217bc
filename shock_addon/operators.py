# SPDX-License-Identifier: GPL-3.0-or-later
"""What all operators do: read, filter with progress and Esc, write, say what was done."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from ..core.errors import (
    Cancelled,
    InvalidMesh,
    InvalidSettings,
    InvalidSignal,
    InvalidUV,
    ShockError,
    SolverError,
)
from . import kernels, obstacles, statistics
from .data.mesh_data import object_mode, read_targets
from .filters.recolored import Recolored
from .jobs import ModalJob, Work, current
from .properties import settings_from
from .skipped import Skipped, sentences

log = logging.getLogger(__name__)

Progress = Callable[[float, str], bool]
Filter = Callable[[Any, Progress], Any]

_HARDLY_SEEN = 0.01
"""A change of colors that people hardly see."""

summaries: dict[str, str] = {}
"""What each mode has done last."""

listener: Progress | None = None
"""Asked too while `execute` runs, when set: the command line's progress bar and Ctrl-C."""


class SharpenOperator(ModalJob):
    """Mixin for operators; subclasses say what they read, filter and write.

    Attributes
    ----------
    mode : str
        Key of `summaries`.
    settings_type : type
        One of the core's settings classes.
    """

    mode: str
    settings_type: type

    def read_settings(self) -> Any:
        """Read what is handed to `filter` from the operator's properties."""
        return settings_from(self.settings_type, self)

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Return the targets, which have `name` and `surface`, and reasons for what is no target.

        What is handed to the filter is ``target.surface``, which has `size`.
        """
        raise NotImplementedError

    def filter(self, settings: Any) -> Filter:
        """Return ``filter(surface, progress)``, which runs on any thread and knows no bpy."""
        raise NotImplementedError

    def write(self, context: bpy.types.Context, results: list[Any]) -> tuple[list, list[str]]:
        """Write the results of `self.targets`; see `write_results`."""
        raise NotImplementedError

    def summary(self, written: list[tuple], seconds: float) -> str:
        """Say in one line what was done and how long it took."""
        raise NotImplementedError

    def notes(self, written: list[tuple]) -> str:
        """Say what was left as it is although it shapes what is seen."""
        return ""

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
            settings = self.read_settings()
        except InvalidSettings as error:
            self.report({"ERROR"}, str(error))
            return None
        self.targets, self._skipped = self.read(context)
        if not self.targets:
            self.report({"ERROR"}, " ".join(self._skipped))
            return None
        targets, function, folder = self.targets, self.filter(settings), kernels.cache_folder()
        return lambda progress: filter_targets(targets, function, folder, progress)

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
        except Exception as error:  # a bug or no memory: the job ends, and says so
            log.exception("%s failed.", self.bl_label)
            reason = str(error) or type(error).__name__
            self.report(
                {"ERROR"}, f"{self.bl_label} failed: {reason}; the console has the details."
            )
            return {"CANCELLED"}
        written, skipped = self.write(context, results)
        skipped = self._skipped + skipped
        if not written:
            self.report({"ERROR"}, " ".join(skipped))
            return {"CANCELLED"}
        seconds = time.perf_counter() - self._began
        statistics.learn(self, seconds)
        text = self.summary(written, seconds)
        summaries[self.mode] = text
        # In one line: Blender's status bar shows only the last report.
        line = " ".join(filter(None, [text, self.notes(written), *skipped]))
        self.report({"WARNING"} if skipped else {"INFO"}, line)
        return {"FINISHED"}


class MeshOperator(SharpenOperator):
    """Mixin for operators on mesh objects."""

    @staticmethod
    def read_object(obj: bpy.types.Object, mode: str, parameters: Any) -> tuple[str, Any]:
        """Read one object; see `read_targets`."""
        raise NotImplementedError

    @staticmethod
    def write_object(target: Any, result: Any) -> bpy.types.Object:
        """Write one result, in Object Mode; returns the object, or raises `Skipped`."""
        raise NotImplementedError

    @staticmethod
    def filter_surface(surface: Any, settings: Any, weld: bool, progress: Progress) -> Any:
        """Filter one object's surface, on any thread."""
        raise NotImplementedError

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Want a mesh object and no other run."""
        return can_run(cls, obstacles.of_meshes(context))

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Read all selected objects, or those in the current mode."""
        return read_targets(context, self.read_object, self)

    def filter(self, settings: Any) -> Filter:
        """Filter one object's surface."""
        function, weld = self.filter_surface, self.weld
        return lambda surface, progress: function(surface, settings, weld, progress)

    def write(self, context: bpy.types.Context, results: list[Any]) -> tuple[list, list[str]]:
        """Write them, and return to the current mode."""
        with object_mode(context):
            return write_results(self.targets, results, self.write_object)


def can_run(operator: type, obstacle: str) -> bool:
    """Whether there is no obstacle and no other run; else the operator's button says what is."""
    if current() is not None:
        obstacle = "A run is under way; wait for it, or press Esc to cancel it."
    if obstacle:
        operator.poll_message_set(pgettext_rpt(obstacle))
    return not obstacle


def filter_targets(
    targets: Sequence[Any], function: Filter, folder: str | None, progress: Progress
) -> list[Any]:
    """Filter all targets, on any thread; one that fails gives its error as its result."""
    progress(0.0, "Preparing (compiles on first use)")
    kernels.load(folder)
    total = sum(target.surface.size for target in targets)
    done = 0
    results: list[Any] = []
    for target in targets:
        size = target.surface.size

        def part(fraction: float, message: str, done: int = done, size: int = size) -> bool:
            return progress((done + fraction * size) / total, message)

        try:
            results.append(function(target.surface, part))
        except (InvalidMesh, InvalidSignal, InvalidUV, SolverError) as error:
            results.append(error)
        done += size
    return results


def write_results(
    targets: Sequence[Any], results: list[Any], write: Callable[[Any, Any], Any]
) -> tuple[list[tuple], list[str]]:
    """Write what was computed.

    Returns
    -------
    written : list of tuple
        What `write` returned, with the result.
    skipped : list of str
        A sentence for each target that was left alone.
    """
    written, skipped = [], []
    for target, result in zip(targets, results, strict=True):
        if isinstance(result, ShockError):
            skipped += sentences([(target.name, str(result).removesuffix("."))])
            continue
        try:
            written.append((write(target, result), result))
        except Skipped as reason:
            skipped += sentences([(target.name, str(reason))])
    return written, skipped


def counted(number: int, one: str, many: str) -> str:
    """Write a number with its noun, such as ``counted(2, "1 mesh", "{:,} meshes")``."""
    return pgettext_rpt(one) if number == 1 else pgettext_rpt(many).format(number)


def describe_colors(
    results: Sequence[Recolored],
    things: str,
    advice: str = "for wide edges raise Time or Smoothing",
) -> str:
    """Say how many things changed and how much, and what to do if it was little."""
    total = sum(result.colors[..., 0].size for result in results)
    changed = sum(result.changed for result in results)
    largest = max(result.largest_change for result in results)
    text = pgettext_rpt(
        "{total:,} {things}, changed {changed:,}, largest change {largest:.2g}"
    ).format(total=total, things=pgettext_rpt(things), changed=changed, largest=largest)
    if largest < _HARDLY_SEEN:
        text += f" ({pgettext_rpt(advice)})"
    return text


def _shown_by(manager: bpy.types.WindowManager) -> Progress:
    def show(fraction: float, message: str) -> bool:
        manager.progress_update(fraction)
        return listener is None or listener(fraction, message)

    return show
