# SPDX-License-Identifier: GPL-3.0-or-later
"""A preview under way: its settings, the computation, and the result on screen."""

from __future__ import annotations

import math
import time
from types import SimpleNamespace
from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_

from ...core.errors import Cancelled, ShockError
from ...core.preview.dials import TIMES, dial_of, turned
from ...core.settings import BETA_UNKNOWN, describe, value_of
from ..data.skipped import explain
from ..modes import STEADY_STATE, Mode
from ..operators.base import Progress, task_of
from ..operators.properties import label, settings_of
from ..running.jobs import Job

_WIDTHS = 5
"""Number of times that the mouse can halve the useful range of widths."""

_PATIENCE = 0.5
"""Seconds after which a run with outdated settings is cancelled; shorter ones are shown."""


def parameters_of(scene: bpy.types.Scene, mode: Mode) -> SimpleNamespace:
    """Copy the panel's settings."""
    settings = getattr(scene.shock_filter, mode.group)
    return SimpleNamespace(**{name: getattr(settings, name) for name in mode.names})


class Preview:
    """A preview on one object or image.

    Parameters
    ----------
    mode : Mode
    parameters : SimpleNamespace
        The panel's settings to begin with.
    stage : MeshStage or ImageStage
        The data of the preview, and its display. `chosen` are parameters of the operator that
        name the data; `note` says which patch is computed, empty for all.
        ``settings(settings)`` converts settings for all data into those for the patch.
        ``part(settings)`` returns, on any thread, the input of the filter, and a function that
        converts its result for ``show(seen)``, which raises `Skipped` if it fails.
        ``show_before()`` shows the original. ``lost()`` returns an error if the data is gone,
        empty if not; ``end()`` restores everything bit for bit.

    Attributes
    ----------
    mode, stage
        As given.
    parameters : SimpleNamespace
        The current settings.
    is_before : bool
        Whether the original is shown; the dials are then locked.
    updates : int
        Number of results shown.
    """

    def __init__(self, mode: Mode, parameters: SimpleNamespace, stage: Any) -> None:
        self.mode, self.parameters, self.stage = mode, parameters, stage
        self.updates, self.is_before = 0, False
        target = mode.target(parameters)
        self.dial, self._time = target.dial(parameters), target.time
        self.second, self._prefix = target.second(parameters, mode.second), target.prefix
        described = describe(target.row.settings).items()
        self._about = {target.prefix + name: each for name, each in described}
        self._dial = None
        if self.dial:
            is_time = self.dial == target.time
            endless = is_time and getattr(parameters, STEADY_STATE, False)
            start = math.inf if endless else getattr(parameters, self.dial)
            octaves = TIMES if is_time else _WIDTHS
            self._dial = dial_of(start, self._about[self.dial][2], octaves)
        self._job: Job | None = None
        self._began = 0.0
        self._computing: SimpleNamespace | None = None
        self._trouble = ""
        self._seen: Any = None
        self._measured = BETA_UNKNOWN

    @property
    def is_computing(self) -> bool:
        """Whether a result is being computed, or waits to be shown."""
        return self._job is not None

    def compare(self) -> None:
        """Show the original or, if that is shown, the result again.

        Raises
        ------
        Skipped
            As `tick` does.
        """
        self.is_before = not self.is_before
        self._show()

    def drag(self, pixels: float) -> None:
        """Change the first setting; 0 pixels keep it bit for bit."""
        if pixels == 0 or self._dial is None or self.is_before:
            return
        self._dial.drag(pixels)
        value = self._dial.value
        if self.dial == self._time and hasattr(self.parameters, STEADY_STATE):
            self.parameters.steady_state = math.isinf(value)
        if math.isfinite(value):
            least = self._about[self.dial][2].minimum
            setattr(self.parameters, self.dial, max(value, least))

    def roll(self, clicks: float) -> None:
        """Change the second setting."""
        name = self.second
        if not name or self.is_before:
            return
        kind, _, about = self._about[name]
        value = getattr(self.parameters, name)
        if value < 0:  # begins where the measurement is
            value = self._measured
        elif value == about.auto:
            value = about.usual
        new = turned(value, kind, about, clicks)
        setattr(self.parameters, name, max(new, 0.0) if about.minimum < 0 else new)

    def text(self) -> str:
        """Return the values of the dials in one line."""
        if self.is_before:
            return iface_("Before")
        parts = []
        if self.dial:
            text = iface_("{name} {value} (move mouse)")
            parts.append(text.format(name=self._label(self.dial), value=self._value(self.dial)))
        if self.second:
            text = iface_("{name} {value} (wheel)")
            parts.append(text.format(name=self._label(self.second), value=self._value(self.second)))
        if self.stage.note:
            parts.append(self.stage.note)
        if self._job is not None and time.perf_counter() - self._began > _PATIENCE:
            parts.append(f"{iface_(self._job.message)}: {self._job.fraction:.0%}")
        elif self._trouble:
            parts.append(self._trouble)
        return " | ".join(parts)

    def _label(self, name: str) -> str:
        plain = name.removeprefix(self._prefix)
        return iface_(self._about[name][2].label or label(plain))

    def _value(self, name: str) -> str:
        value = getattr(self.parameters, name)
        if name == self._time and getattr(self.parameters, STEADY_STATE, False):
            return iface_("Steady State")
        if value < 0 and name == self.second:
            return f"{self._measured:.4g}"
        if value == self._about[name][2].auto:
            return iface_(self._about[name][2].auto_label)
        return f"{value:g}"

    def tick(self) -> None:
        """Show a finished result, and start computing the newest settings.

        Raises
        ------
        Skipped
            If the object was removed, or changed by anything else.
        """
        if self._job is not None and self._job.done:
            job, self._job = self._job, None
            self._take(job)
        if self._computing == self.parameters:
            return
        if self._job is None:
            self._start()
        elif time.perf_counter() - self._began > _PATIENCE:
            self._job.cancel()

    def end(self) -> None:
        """Stop computing, and restore everything bit for bit."""
        if self._job is not None:
            self._job.cancel()
            self._job = None
        self.stage.end()

    def _start(self) -> None:
        parameters = SimpleNamespace(**vars(self.parameters))
        self._computing, self._began = parameters, time.perf_counter()
        mode, stage = self.mode, self.stage

        def work(progress: Progress) -> Any:
            settings = stage.settings(settings_of(mode, parameters))
            if not settings.kernel.by_noise:
                self._measured = value_of(settings.kernel, "edges", self._measured)
            part, seen = stage.part(settings)
            task = task_of(mode, parameters, settings, [SimpleNamespace(surface=part)])
            (result,) = task.run(progress)
            return result if isinstance(result, ShockError) else seen(result)

        self._job = Job(work)

    def _take(self, job: Job) -> None:
        try:
            result = job.result()
        except Cancelled:
            return
        except ShockError as error:
            result = error
        self._trouble = explain(result) if isinstance(result, ShockError) else ""
        if not self._trouble:
            self._seen = result
            self._show()

    def _show(self) -> None:
        if self.is_before:
            self.stage.show_before()
        elif self._seen is not None:
            self.stage.show(self._seen)
            self.updates += 1
