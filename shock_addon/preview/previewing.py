# SPDX-License-Identifier: GPL-3.0-or-later
"""A preview while it lasts: which settings are wanted, computing them, and what is shown."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_

from ...core.errors import Cancelled, ShockError
from ...core.settings import GeometrySettings, ShockSettings, describe
from .. import kernels
from ..data.color_data import read_colors
from ..data.geometry_data import read_geometry
from ..data.mesh_data import Target, find, object_mode
from ..denoise_operator import WORK, denoise_settings
from ..filters.coloring import sharpen_colors
from ..filters.sharpening import sharpen
from ..jobs import Job
from ..operators import filter_targets
from ..properties import COLOR_PREFIX, NAMES, STEADY_STATE, label, settings_from
from ..skipped import Skipped
from .preview_data import Original, color_attribute, show
from .preview_dials import TimeDial, turned
from .preview_patch import Patch

_PATIENCE = 0.5
"""Seconds after which a run whose settings are old news is cancelled; shorter ones are shown."""

_QUICK, _SLOW = 50_000, 8_000
"""Vertices that are sharpened, or denoised, in about a quarter of a second."""


@dataclass(frozen=True)
class Kind:
    """What is previewed.

    Attributes
    ----------
    operator : str
        The name of the operator that does it in earnest.
    read, filter : callable
        As in `operators.MeshOperator`.
    settings : callable
        ``settings(parameters)`` makes what `filter` wants.
    about : type
        The settings class that describes the dials.
    time, second : str
        The parameters that dragging and the wheel change.
    patch : int
        Vertices of the patch that is computed of surfaces with more than three times as many.
    """

    operator: str
    read: Callable[..., tuple]
    filter: Callable[..., Any]
    settings: Callable[[Any], Any]
    about: type
    time: str
    second: str
    patch: int


def kind_of(mode: str, parameters: Any) -> Kind:
    """Choose what is previewed by the panel's mode and its settings."""
    if mode == "geometry":
        settings = partial(settings_from, GeometrySettings)
        return Kind("sharpen_geometry", read_geometry, sharpen, settings, GeometrySettings,
                    "time", "feature_threshold", _QUICK)  # fmt: skip
    if mode == "colors":
        settings = partial(settings_from, ShockSettings)
        return Kind("sharpen_colors", read_colors, sharpen_colors, settings, ShockSettings,
                    "time", "smoothing_passes", _QUICK)  # fmt: skip
    work = WORK[parameters.target]
    return Kind("denoise", work.read, work.filter, denoise_settings, work.settings,
                work.prefix + "time", work.prefix + "beta", _SLOW)  # fmt: skip


def parameters_of(context: bpy.types.Context, mode: str) -> SimpleNamespace:
    """Copy the panel's settings."""
    settings = getattr(context.scene.shock_filter, mode)
    return SimpleNamespace(**{name: getattr(settings, name) for name in NAMES[mode]})


class Preview:
    """A preview on one object in Object Mode.

    Parameters
    ----------
    kind : Kind
    parameters : SimpleNamespace
        The panel's settings to begin with.
    target : Target
        The object as it was read.
    patch : Patch
        What of its surface is computed.

    Attributes
    ----------
    parameters : SimpleNamespace
        As the dials stand now.
    updates : int
        How many results were shown.
    """

    def __init__(
        self, kind: Kind, parameters: SimpleNamespace, target: Target, patch: Patch
    ) -> None:
        self.parameters = parameters
        self.updates = 0
        self._kind, self._target, self._patch = kind, target, patch
        self._original = Original(find(target).data, color_attribute(target))
        self._about = describe(kind.about)
        start = getattr(parameters, kind.time)
        endless = getattr(parameters, STEADY_STATE, False)
        self._dial = TimeDial(math.inf if endless else start, self._about["time"][2])
        self._folder = kernels.cache_folder()
        self._job: Job | None = None
        self._began = 0.0
        self._computing: SimpleNamespace | None = None
        self._trouble = ""

    def drag(self, pixels: float) -> None:
        """Change the time."""
        self._dial.drag(pixels)
        time_ = self._dial.time
        if hasattr(self.parameters, STEADY_STATE):
            self.parameters.steady_state = math.isinf(time_)
        if math.isfinite(time_):
            setattr(self.parameters, self._kind.time, time_)

    def roll(self, clicks: float) -> None:
        """Change the second setting."""
        name = self._kind.second
        kind, _, about = self._about[name.removeprefix(COLOR_PREFIX)]
        setattr(self.parameters, name, turned(getattr(self.parameters, name), kind, about, clicks))

    def text(self) -> str:
        """Say in one line how the dials stand."""
        endless = getattr(self.parameters, STEADY_STATE, False)
        time_ = getattr(self.parameters, self._kind.time)
        second = getattr(self.parameters, self._kind.second)
        parts = [
            iface_("Time {time} (drag)").format(
                time=iface_("Steady State") if endless else f"{time_:g}"
            ),
            iface_("{name} {value:.4g} (wheel)").format(
                name=iface_(self.second_label()), value=second
            ),
        ]
        if self._patch.share < 1.0:
            size = self._patch.surface.size
            parts.append(iface_("patch of {size:,} vertices").format(size=size))
        if self._job is not None and time.perf_counter() - self._began > _PATIENCE:
            parts.append(f"{iface_(self._job.message)}: {self._job.fraction:.0%}")
        elif self._trouble:
            parts.append(self._trouble)
        return " | ".join(parts)

    def second_label(self) -> str:
        """Return the words for what the wheel changes."""
        name = self._kind.second.removeprefix(COLOR_PREFIX)
        return self._about[name][2].label or label(name)

    def alive(self) -> bool:
        """Whether the object is still there, and in Object Mode."""
        try:
            return find(self._target).mode == "OBJECT"
        except Skipped:
            return False

    def tick(self) -> None:
        """Show what is ready and see to it that the newest settings are computed.

        Raises
        ------
        Skipped
            If the object was removed, or something else has changed it.
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
        """Stop computing, and bring everything back bit for bit."""
        if self._job is not None:
            self._job.cancel()
            self._job = None
        with object_mode(bpy.context):
            self._original.restore()

    def _start(self) -> None:
        parameters = SimpleNamespace(**vars(self.parameters))
        self._computing, self._began = parameters, time.perf_counter()
        kind, patch, folder = self._kind, self._patch, self._folder
        part = replace(self._target, surface=patch.surface)

        def work(progress: Callable[[float, str], bool]) -> Any:
            settings = patch.settings(kind.settings(parameters))

            def filter_part(surface: Any, phase: Callable[[float, str], bool]) -> Any:
                return patch.whole(kind.filter(surface, settings, parameters.weld, phase))

            (result,) = filter_targets([part], filter_part, folder, progress)
            return result

        self._job = Job(work)

    def _take(self, job: Job) -> None:
        try:
            result = job.result()
        except Cancelled:
            return
        except ShockError as error:
            result = error
        self._trouble = str(result) if isinstance(result, ShockError) else ""
        if not self._trouble:
            show(self._target, self._original, result)
            self.updates += 1
