# SPDX-License-Identifier: GPL-3.0-or-later
"""The base of all operators: read, filter with progress and Esc, write, report."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, NamedTuple

import bpy
from bpy.app.translations import pgettext_iface, pgettext_rpt

from ...core.errors import Cancelled, InvalidMesh, InvalidSignal, InvalidUV, ShockError, SolverError
from ...core.settings import describe
from .. import data
from ..data.skipped import (
    MOST_NAMES,
    Refused,
    Skipped,
    as_reason,
    explain,
    listed,
    sentences,
)
from ..kinds import Data
from ..modes import Mode, Target
from ..running import kernels
from ..running.jobs import ModalJob, current, is_previewing, is_scene_read
from .keeping import Found, found, owners
from .keeping import subjects as _subjects
from .properties import AUTO, settings_of

Progress = Callable[[float, str], bool]

if TYPE_CHECKING:
    from ...core.base.findings import Finding

_HARDLY_SEEN = 0.01
"""A change of colors that is hardly visible."""

summaries: dict[str, str] = {}
"""The last report of each mode, or the error."""

details: dict[str, str] = {}
"""The folded details of these reports; most have none."""

textures: dict[str, set[int]] = {}
"""The uids of the textures of these reports, before and after the run."""

listener: Any = None
"""Progress callback during `execute`, for the progress bar and Ctrl-C of the command line.

Its `counts` are set to those of the operator.
"""


_FAILED = "{operator} failed: {reason}; the console has the details."
_FAILED_WRITING = (
    "{operator} failed while writing: {reason}; undo it, and see the console for the details."
)


class Written(NamedTuple):
    """A target whose result is written; `data` is its object or image."""

    target: Any
    data: Any
    result: Any


Done = tuple[list[Written], list[str]]
"""The written targets, and a sentence for each target that was left alone."""


class Task(NamedTuple):
    """The computation of a run, on any thread; it does not use bpy.

    Attributes
    ----------
    targets : sequence
        Their `surface` is the input of the filter, and has `size`.
    kind : Data
        The kind of data.
    name : str
        Name of the filter in the registry.
    settings : object
        Of `settings_of`.
    weld : bool
        Whether vertices at the same place are one.
    findings : list of (target, Finding)
        Remarks of the filter on each target; filled by `run`.
    """

    targets: Sequence[Any]
    kind: Data
    name: str
    settings: Any
    weld: bool
    findings: list[tuple[Any, Finding]]

    def run(self, progress: Progress) -> list[Any]:
        """Filter all targets; the result of one that fails is its error."""
        from ...core.base.findings import gathering

        progress(0.0, "Preparing")
        kernels.load()
        total = sum(target.surface.size for target in self.targets)
        done = 0
        results: list[Any] = []
        for target in self.targets:
            surface = target.surface

            def part(
                fraction: float, message: str, done: int = done, size: int = surface.size
            ) -> bool:
                return progress((done + fraction * size) / total, message)

            with gathering() as found:
                try:
                    results.append(
                        self.kind.filter(surface, self.name, self.settings, self.weld, part)
                    )
                except (InvalidMesh, InvalidSignal, InvalidUV, SolverError) as error:
                    results.append(error)
            self.findings.extend((target, finding) for finding in found)
            done += surface.size
        return results


def task_of(mode: Mode, parameters: Any, settings: Any, targets: Sequence[Any]) -> Task:
    """Return the computation of a run.

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
    """Mixin for operators; subclasses define how data are read, filtered and written.

    Attributes
    ----------
    row : Mode
        Its row in the table of modes.
    obstacle : callable
        ``obstacle(context)`` returns why it cannot run, empty if it can; see `operators.poll`.
    chooses : bool
        Whether it filters, so that the panel shows what it chooses instead of what was chosen last.
    """

    chooses = True

    if TYPE_CHECKING:  # Blender would evaluate annotations for each operator
        row: Mode
        obstacle: Callable[[bpy.types.Context], str]

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether there is neither an obstacle nor another run."""
        return can_run(cls, cls.obstacle(context))

    @property
    def key(self) -> str:
        """Return the key of `summaries`."""
        return self.row.group

    def read_settings(self) -> Any:
        """Read the settings of the filter from the operator's properties."""
        return settings_of(self.row, self)

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Return the targets, and a sentence for each object or image that is left out.

        Besides the attributes for `Task`, targets have `name`. A raised `ShockError` or `Refused`
        is reported.
        """
        raise NotImplementedError

    def task(self, settings: Any) -> Task:
        """Return the computation for `self.targets`."""
        return task_of(self.row, self, settings, self.targets)

    def write(self, context: bpy.types.Context, results: list[Any]) -> Done:
        """Write the results of `self.targets`; see `write_results`."""
        raise NotImplementedError

    def counts(self, written: list[Written]) -> tuple[int, int]:
        """Return the number of changed elements, and of all."""
        raise NotImplementedError

    def count_filtered(self, written: list[Written]) -> int:
        """Return how much of the input was filtered; for statistics."""
        return sum(target.surface.size for target in self.targets)

    def summary(self, written: list[Written], seconds: float) -> str:
        """Return the report in one line: what was done, and how long it took."""
        raise NotImplementedError

    @property
    def advice(self) -> str:
        """Return advice if little has changed; empty if the filter has reported the reason.

        A remark on an automatic choice is not such a reason.
        """
        settings = describe(self.row.target(self).row.settings).keys()
        words = [{name for name, value in each.values.items() if isinstance(value, str)}
                 for _, each in self._findings]  # fmt: skip
        advice = self.row.target(self).advice or self.row.advice
        return advice if all(each & settings for each in words) else ""

    def notes(self, written: list[Written]) -> str:
        """Return remarks on data that was not changed although it affects the appearance."""
        return ""

    def done(self) -> str:
        """Return the verb of the report."""
        sharpened = self.row.follows is not None and self.then_sharpen
        return pgettext_rpt(f"{self.row.done} and sharpened" if sharpened else self.row.done)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the parameters after the run, as in the tab."""
        from . import drawing

        drawing.draw_after_run(self.layout, context, self.properties, self.row)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Run and wait for the end: for scripts, background mode and redo."""
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
        """Run on a thread, so that the window stays responsive."""
        if bpy.app.background or context.window is None:
            return self.execute(context)
        task = self._prepare(context)
        return {"CANCELLED"} if task is None else self.run_job(context, task.run)

    def _prepare(self, context: bpy.types.Context) -> Task | None:
        # Reads; on the main thread.
        self._began = time.perf_counter()
        with self._errors_reported(_FAILED):
            data.image.stand_in.put_away()
            _subjects[self.key] = data.chosen.subjects(context)
            textures.pop(self.key, None)
            if self.chooses:
                found.pop(self.key, None)
                owners[self.key] = data.chosen.subjects(context)
            settings = self.read_settings()
            self.targets, self._skipped = self.read(context)
            if self.targets:
                task = self.task(settings)
                self._findings = task.findings
                return task
            self.tell("ERROR", " ".join(self._skipped))
        return None

    def finish(self, context: bpy.types.Context, compute: Callable[[], Any]) -> set[str]:
        """Write the results and report."""
        try:
            with self._errors_reported(_FAILED):
                results = compute()
                with self._errors_reported(_FAILED_WRITING):
                    return self._write_and_tell(context, results)
                return {"FINISHED"}  # earlier results can be undone
            return {"CANCELLED"}
        finally:
            self._forget()

    def cancel(self, context: bpy.types.Context) -> None:
        """Drop the run and its targets."""
        super().cancel(context)
        self._forget()

    def is_detail(self, finding: Finding) -> bool:
        """Whether a remark of the filter is a detail, which the panel folds."""
        return False

    def tell(self, kind: str, text: str, folded: str = "") -> None:
        """Report the end of the run, also in the panel, which shows more lines than one."""
        super().tell(kind, f"{text} {folded}".replace("\n", " ").rstrip())
        summaries[self.key], details[self.key] = text, folded

    def _forget(self) -> None:
        # Blender keeps the last 32 operators, so their data is released.
        vars(self).clear()

    @contextmanager
    def _errors_reported(self, text: str) -> Iterator[None]:
        """Report any error in the block; bugs and lack of memory are also logged."""
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

        if "UNDO" in self.bl_options:
            data.strokes.keep(context)
        written, skipped = self.write(context, results)
        skipped = self._skipped + skipped
        if not written:
            self.tell("ERROR", " ".join(skipped))
            return {"CANCELLED"}
        for known in (_subjects, owners) if self.chooses else (_subjects,):
            known[self.key] |= {each.data.session_uid for each in written}
        seconds = time.perf_counter() - self._began
        statistics.learn(self, self.count_filtered(written), seconds)
        if listener is not None:
            listener.counts = self.counts(written)
        parts = [
            self.summary(written, seconds),
            *self._remarks(written, folded=False),
            self.notes(written),
            *skipped,
        ]
        between = " " if len(written) + len(skipped) == 1 else "\n"
        text = between.join(filter(None, parts))
        folded = between.join(self._remarks(written, folded=True))
        self.tell("WARNING" if skipped else "INFO", text, folded)
        return {"FINISHED"}

    def _remarks(self, written: list[Written], folded: bool) -> list[str]:
        """Return the remarks on each target, in a line; of several, with the names."""
        alike: dict[str, list[str]] = {}
        chosen = self.row.target(self)
        for target, made, _ in written:
            scale = self.scale_of(made)
            remarks = [
                finding
                for of, finding in self._findings
                if of is target and self.is_detail(finding) == folded
            ]
            for finding in remarks:
                of_active = _choices(self, chosen, finding, scale)  # which comes first
                found[self.key] = of_active | found.get(self.key, {})
            if text := " ".join(explain(finding, scale) for finding in remarks):
                alike.setdefault(text, []).append(target.name)
        lines = [
            text if len(names) == len(written) else f"{listed(names)}: {text}"
            for text, names in alike.items()
        ]
        if folded or len(lines) <= MOST_NAMES:
            return lines
        more = pgettext_rpt("{number:,} further remarks on other objects.")
        return [*lines[: MOST_NAMES - 1], more.format(number=len(lines) - MOST_NAMES + 1)]

    def scale_of(self, made: Any) -> float:
        """Return the scale of the written object, for lengths in reports; 0 for none."""
        return 0.0


def _choices(operator: Any, target: Target, finding: Finding, scale: float) -> dict[str, Found]:
    """Return the values that the filter chose for automatic settings, by their properties."""
    names = [name for name in target.fields if getattr(operator, name + AUTO, False)]
    chosen = {}
    for name in names:
        value = finding.values.get(name.removeprefix(target.prefix))
        if value is not None:
            of_mesh = 1.0 if hasattr(value, "of_mesh") else 0.0
            edge = getattr(value, "edge", of_mesh) * scale
            text = data.lengths.in_scene(value * edge) if edge > 0 else f"{value:.3g}"
            said = data.lengths.in_both(value, edge) if hasattr(value, "edge") else text
            chosen[name] = Found(float(value), text, said)
    for name in target.fields:
        value = finding.values.get(name.removeprefix(target.prefix))
        if getattr(operator, name, "") == "auto" and isinstance(value, str) and value != "auto":
            item = operator.properties.bl_rna.properties[name].enum_items[value]
            words = pgettext_iface(item.name)
            chosen[name] = Found(value, words, words)
    return chosen


def summary_of(context: bpy.types.Context, key: str, image: str = "") -> str:
    """Return the last report of a mode, if it is about the current selection; empty if not.

    Of textures it must also be about the one that is chosen, by its name or by the material.
    """
    same = data.chosen.subjects(context) & _subjects.get(key, set())
    if same and (about := textures.get(key)):
        with suppress(Skipped):
            same = about & {data.chosen.chosen_image(context, image).session_uid}
    return summaries.get(key, "") if same else ""


def details_of(context: bpy.types.Context, key: str, image: str = "") -> str:
    """Return the folded details of the report that `summary_of` returns."""
    return details.get(key, "") if summary_of(context, key, image) else ""


def can_run(operator: type, obstacle: str) -> bool:
    """Return whether a run can start; if not, the tooltip of the button says why."""
    if is_scene_read():
        obstacle = "Wait until the render, or the last run, has ended."
    if current() is not None:
        obstacle = "A run is under way; wait for it, or press Esc to cancel it."
    if is_previewing():
        obstacle = "A preview is under way; click to apply it, or press Esc."
    if obstacle:
        operator.poll_message_set(pgettext_rpt(obstacle))
    return not obstacle


def write_results(
    targets: Sequence[Any], results: list[Any], write: Callable[[Any, Any], Any]
) -> Done:
    """Write the results.

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
    """Return how many things changed and by how much, with advice if it was little.

    Parameters
    ----------
    results : sequence of Recolored
    things : str
        The things, such as "pixels".
    advice : str
        Empty for none.
    """
    total = sum(result.counted for result in results)
    # All pixels of an enlarged image are new, but the picture is the same.
    changed = sum(result.changed for result in results if result.largest_change)
    largest = max(result.largest_change for result in results)
    things = things.removesuffix("s") if total == 1 else things
    text = pgettext_rpt(
        "{total:,} {things}, changed {changed:,}, largest change {largest:.2g}"
    ).format(total=total, things=pgettext_rpt(things), changed=changed, largest=largest)
    if largest < _HARDLY_SEEN and advice:
        text += f" ({pgettext_rpt(advice)})"
    return text
