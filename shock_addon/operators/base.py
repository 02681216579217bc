# SPDX-License-Identifier: GPL-3.0-or-later
"""The base of all operators: read, filter with progress and Esc, write, report."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import bpy
from bpy.app.translations import pgettext_iface, pgettext_rpt

from ...core.errors import Cancelled, InvalidMesh, InvalidSignal, InvalidUV, ShockError, SolverError
from .. import data
from ..data.skipped import Refused, Skipped, as_reason, explain, sentences
from ..kinds import Data
from ..modes import Mode
from ..running import kernels
from ..running.jobs import ModalJob, current, is_scene_read
from .properties import settings_of

Progress = Callable[[float, str], bool]

if TYPE_CHECKING:
    from ...core.base.findings import Finding

_HARDLY_SEEN = 0.01
"""A change of colors that people hardly see."""

_NOTICED = 0.5
"""Seconds of compiling that people notice."""

summaries: dict[str, str] = {}
"""What each mode has done last, or why it has not."""

_subjects: dict[str, set[int]] = {}
"""The uids of the objects and images that it was done with."""

listener: Any = None
"""Asked too while `execute` runs, when set: the command line's progress bar and Ctrl-C.

Its `counts` become those of the operator.
"""


_FAILED = "{operator} failed: {reason}; the console has the details."
_FAILED_WRITING = (
    "{operator} failed while writing: {reason}; undo it, and see the console for the details."
)


class Written(NamedTuple):
    """A target whose result is in place; `data` is the object or the image that has it."""

    target: Any
    data: Any
    result: Any


Done = tuple[list[Written], list[str]]
"""What was written, and a sentence for each target that was left alone."""


class Task(NamedTuple):
    """What a run computes, on any thread; it knows no bpy.

    Attributes
    ----------
    targets : sequence
        They have `surface`, which is handed to the filter and has `size`.
    kind : Data
        How they are filtered.
    name : str
        Of the filter, in the registry.
    settings : object
        Of `settings_of`.
    weld : bool
        Whether vertices at the same place are one.
    findings : list of Finding
        What the filter says about its work; filled by `run`.
    """

    targets: Sequence[Any]
    kind: Data
    name: str
    settings: Any
    weld: bool
    findings: list[Finding]

    def run(self, progress: Progress) -> list[Any]:
        """Filter all targets; one that fails gives its error as its result."""
        from ...core.base.findings import gathering

        progress(0.0, "Preparing")
        kernels.load()
        total = sum(target.surface.size for target in self.targets)
        done = 0
        results: list[Any] = []
        with gathering() as found:
            for target in self.targets:
                surface = target.surface

                def part(
                    fraction: float, message: str, done: int = done, size: int = surface.size
                ) -> bool:
                    return progress((done + fraction * size) / total, message)

                try:
                    results.append(
                        self.kind.filter(surface, self.name, self.settings, self.weld, part)
                    )
                except (InvalidMesh, InvalidSignal, InvalidUV, SolverError) as error:
                    results.append(error)
                done += surface.size
        self.findings.extend(found)
        return results


def task_of(mode: Mode, parameters: Any, settings: Any, targets: Sequence[Any]) -> Task:
    """Say what a run computes.

    Parameters
    ----------
    mode : Mode
    parameters : object
        Those of the operator or the panel.
    settings : object
        Of `settings_of`.
    targets : sequence
    """
    chosen = mode.target(parameters)
    weld = "weld" in chosen.places and parameters.weld
    return Task(targets, chosen.data, chosen.filter, settings, weld, [])


class FilterOperator(ModalJob):
    """Mixin for operators; subclasses say what they read, filter and write.

    Attributes
    ----------
    row : Mode
        What it does.
    obstacle : callable
        ``obstacle(context)`` says why it cannot run, empty if it can; see `operators.poll`.
    """

    if TYPE_CHECKING:  # Blender would evaluate these for each operator
        row: Mode
        obstacle: Callable[[bpy.types.Context], str]

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Want no obstacle and no other run."""
        return can_run(cls, cls.obstacle(context))

    @property
    def key(self) -> str:
        """Key of `summaries`."""
        return self.row.group

    def read_settings(self) -> Any:
        """Read what is handed to the filter from the operator's properties."""
        return settings_of(self.row, self)

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Return the targets, and reasons for what is no target.

        Targets have `name`, beside what `Task` says. A `ShockError` or `Refused` that is raised is
        reported.
        """
        raise NotImplementedError

    def task(self, settings: Any) -> Task:
        """Say what is computed of `self.targets`."""
        return task_of(self.row, self, settings, self.targets)

    def write(self, context: bpy.types.Context, results: list[Any]) -> Done:
        """Write the results of `self.targets`; see `write_results`."""
        raise NotImplementedError

    def counts(self, written: list[Written]) -> tuple[int, int]:
        """Count what has changed, and what was worked on."""
        raise NotImplementedError

    def summary(self, written: list[Written], seconds: float) -> str:
        """Say in one line what was done and how long it took."""
        raise NotImplementedError

    @property
    def advice(self) -> str:
        """What to do if little has changed; empty where the filter has said itself why."""
        return "" if self._findings else self.row.advice

    def notes(self, written: list[Written]) -> str:
        """Say what was left as it is although it shapes what is seen."""
        return ""

    def done(self) -> str:
        """Say what was done, in a verb."""
        sharpened = self.row.follows is not None and self.then_sharpen
        return pgettext_rpt(f"{self.row.done} and sharpened" if sharpened else self.row.done)

    def draw(self, context: bpy.types.Context) -> None:
        """Show the parameters after the run, as the tab does."""
        from . import drawing

        drawing.draw_after_run(self.layout, context, self.properties, self.row)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Run to the end: for scripts, background and redo."""
        task = self._prepare(context)
        if task is None:
            return {"CANCELLED"}
        manager = context.window_manager

        def show(fraction: float, message: str) -> bool:
            manager.progress_update(fraction)
            return listener is None or listener(fraction, message)

        manager.progress_begin(0.0, 1.0)
        try:
            return self.finish(context, lambda: task.run(show))
        finally:
            manager.progress_end()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Run on a thread, so that the window stays alive."""
        if bpy.app.background or context.window is None:
            return self.execute(context)
        task = self._prepare(context)
        return {"CANCELLED"} if task is None else self.run_job(context, task.run)

    def _prepare(self, context: bpy.types.Context) -> Task | None:
        # Reads; on the main thread.
        self._began = time.perf_counter()
        self._compiled = kernels.seconds_compiling()
        with self._errors_reported(_FAILED):
            data.image.stand_in.put_away()
            _subjects[self.key] = data.chosen.subjects(context)
            settings = self.read_settings()
            self.targets, self._skipped = self.read(context)
            if self.targets:
                task = self.task(settings)
                self._findings = task.findings
                kernels.choose_folder()
                return task
            self.tell("ERROR", " ".join(self._skipped))
        return None

    def finish(self, context: bpy.types.Context, compute: Callable[[], Any]) -> set[str]:
        """Write the results and say what was done."""
        try:
            with self._errors_reported(_FAILED):
                results = compute()
                with self._errors_reported(_FAILED_WRITING):
                    return self._write_and_tell(context, results)
                return {"FINISHED"}  # what was written until then can be undone
            return {"CANCELLED"}
        finally:
            self._forget()

    def cancel(self, context: bpy.types.Context) -> None:
        """Drop the work and what it was done for."""
        super().cancel(context)
        self._forget()

    def tell(self, kind: str, text: str) -> None:
        """Say how it ended, also in the panel."""
        super().tell(kind, text)
        summaries[self.key] = text

    def _forget(self) -> None:
        # Blender keeps the last 32 operators, so what a run has read and computed goes.
        vars(self).clear()

    @contextmanager
    def _errors_reported(self, text: str) -> Iterator[None]:
        """End the block at any error and report it; bugs and lack of memory are logged, too."""
        try:
            yield
        except Cancelled as error:
            self.tell("INFO", explain(error))
        except (ShockError, Refused) as error:
            self.tell("ERROR", explain(error))
        except Exception as error:  # the boundary of a run: a bug, or Blender's own refusal
            import logging

            logging.getLogger(__name__).exception("%s failed.", self.bl_label)
            reason = str(error) or type(error).__name__
            label = pgettext_iface(self.bl_label, "Operator")
            self.tell("ERROR", pgettext_rpt(text).format(operator=label, reason=reason))

    def _write_and_tell(self, context: bpy.types.Context, results: list[Any]) -> set[str]:
        from . import statistics

        written, skipped = self.write(context, results)
        skipped = self._skipped + skipped
        if not written:
            self.tell("ERROR", " ".join(skipped))
            return {"CANCELLED"}
        _subjects[self.key] |= {each.data.session_uid for each in written}
        seconds = time.perf_counter() - self._began
        compiling = kernels.seconds_compiling() - self._compiled
        statistics.learn(self, seconds - compiling)
        if listener is not None:
            listener.counts = self.counts(written)
        # In one line: Blender's status bar shows only the last report.
        parts = [
            self.summary(written, seconds),
            *map(explain, self._findings),
            _said_of(compiling),
            self.notes(written),
            *skipped,
        ]
        self.tell("WARNING" if skipped else "INFO", " ".join(filter(None, parts)))
        return {"FINISHED"}


def _said_of(compiling: float) -> str:
    if compiling < _NOTICED:
        return ""
    text = pgettext_rpt("Compiling took {seconds:.1f} s of it, which only first runs do.")
    return text.format(seconds=compiling)


def summary_of(context: bpy.types.Context, key: str) -> str:
    """Return what a mode has done last with what is chosen now; empty if it was something else."""
    same = data.chosen.subjects(context) & _subjects.get(key, set())
    return summaries.get(key, "") if same else ""


def can_run(operator: type, obstacle: str) -> bool:
    """Whether there is no obstacle and no other run; else the operator's button says what is."""
    if is_scene_read():
        obstacle = "Wait until the render, or the last run, has ended."
    if current() is not None:
        obstacle = "A run is under way; wait for it, or press Esc to cancel it."
    if obstacle:
        operator.poll_message_set(pgettext_rpt(obstacle))
    return not obstacle


def write_results(
    targets: Sequence[Any], results: list[Any], write: Callable[[Any, Any], Any]
) -> Done:
    """Write what was computed.

    Returns
    -------
    written : list of Written
    skipped : list of str
        A sentence for each target that was left alone.
    """
    written, skipped = [], []
    for target, result in zip(targets, results, strict=True):
        if isinstance(result, ShockError):
            skipped += sentences([(target.name, as_reason(explain(result)))])
            continue
        try:
            written.append(Written(target, write(target, result), result))
        except Skipped as reason:
            skipped += sentences([(target.name, str(reason))])
    return written, skipped


def counted(number: int, one: str, many: str) -> str:
    """Write a number with its noun, such as ``counted(2, "1 mesh", "{:,} meshes")``."""
    return pgettext_rpt(one) if number == 1 else pgettext_rpt(many).format(number)


def describe_colors(results: Sequence[Any], things: str, advice: str) -> str:
    """Say how many things changed and how much, and what to do if it was little.

    Parameters
    ----------
    results : sequence of Recolored
    things : str
        What is counted, such as "pixels".
    advice : str
        Empty for none.
    """
    total = sum(result.counted for result in results)
    # All pixels of an enlarged image are new, but not another picture.
    changed = sum(result.changed for result in results if result.largest_change)
    largest = max(result.largest_change for result in results)
    things = things.removesuffix("s") if total == 1 else things
    text = pgettext_rpt(
        "{total:,} {things}, changed {changed:,}, largest change {largest:.2g}"
    ).format(total=total, things=pgettext_rpt(things), changed=changed, largest=largest)
    if largest < _HARDLY_SEEN and advice:
        text += f" ({pgettext_rpt(advice)})"
    return text
