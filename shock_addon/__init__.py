# SPDX-License-Identifier: GPL-3.0-or-later
"""The user interface in Blender: properties, operators, panels and menus for the core."""

from __future__ import annotations

import atexit
import sys

import bpy
from bpy.app.handlers import persistent

from ..core.host import forgetting
from . import data
from .commands import registration as command
from .data import shown, strokes
from .flow import marking
from .flow import operator as flow_operator
from .flow import showing as flow_shown
from .live import automatic
from .live import operators as live_operators
from .operators import base as operators
from .operators import comparing, filtering, generating, keeping, linking, properties
from .preview import operator as preview_operator
from .preview import painting
from .running import jobs, kernels
from .ui import manual, menus, panels, presets, translations

_CLASSES = (
    *jobs.CLASSES,
    *filtering.classes(),
    *comparing.CLASSES,
    *keeping.CLASSES,
    *linking.CLASSES,
    *generating.CLASSES,
    *flow_operator.CLASSES,
    *marking.CLASSES,
    *live_operators.CLASSES,
    *preview_operator.CLASSES,
    *painting.CLASSES,
    *presets.CLASSES,
    *panels.CLASSES,
    *menus.CLASSES,
    *manual.CLASSES,
)


@persistent
def _forget_file(*_: object) -> None:
    # Forget data and messages of the previous file.
    forgetting.forget_file()
    operators.summaries.clear()
    operators.details.clear()
    keeping.found.clear()
    keeping.owners.clear()


@persistent
def _note_undo(*_: object) -> None:
    # Data that was undone no longer exists.
    operators.summaries.clear()
    comparing.look_again(-1)
    data.live.watching.doubt()
    automatic.wait()


@persistent
def _note_redo(*_: object) -> None:
    comparing.look_again(1)
    data.live.watching.doubt()
    automatic.wait()


@persistent
def _note_changes(scene: bpy.types.Scene, graph: bpy.types.Depsgraph) -> None:
    data.live.watching.note(scene, graph)


@persistent
def _keep_changes(*_: object) -> None:
    data.live.watching.keep()


@persistent
def _reset_unknown_choices(*_: object) -> None:
    properties.reset_unknown_choices()


@persistent
def _read_changes(*_: object) -> None:
    data.live.watching.read()
    automatic.forbid()


def _handlers() -> list[tuple]:
    handlers = bpy.app.handlers
    # End previews before anything reads or replaces the data that they show.
    changes = (handlers.load_pre, handlers.save_pre, handlers.undo_pre, handlers.redo_pre)
    return [
        *((each, preview_operator.stop) for each in changes),
        *((each, painting.stop) for each in (handlers.load_pre, handlers.save_pre)),
        *((each, painting.put_away) for each in (handlers.load_post, handlers.undo_post)),
        (handlers.redo_post, painting.put_away),
        (handlers.load_pre, _forget_file),
        (handlers.load_post, _reset_unknown_choices),
        (handlers.depsgraph_update_post, _note_changes),
        (handlers.save_pre, _keep_changes),
        (handlers.load_post, _read_changes),
        (handlers.undo_post, _note_undo),
        (handlers.undo_post, strokes.note_step),
        (handlers.redo_post, _note_redo),
        (handlers.undo_pre, shown.note),
        (handlers.undo_post, shown.restore),
        (handlers.redo_pre, shown.note),
        (handlers.redo_post, shown.restore),
    ]


def _unregister_at_exit() -> None:
    # Blender disables its add-ons itself. The bpy module crashes at exit if a script registers the
    # package and does not unregister it.
    package = sys.modules[__package__.rpartition(".")[0]]
    if not getattr(package, "__addon_enabled__", False):
        unregister()


def _refuse_second_copy() -> None:
    # Of two copies, from two repositories, one would replace the classes of the other.
    own = __package__.rpartition(".")[0]
    for name, module in sys.modules.items():
        is_copy = name != own and name.rpartition(".")[2] == "shock_filter"
        if is_copy and getattr(module, "__addon_enabled__", False):
            raise RuntimeError(
                f"Shock Filter {module.__version__} is enabled already, as {name}. Disable that one"
                " in the preferences, under Add-ons, then enable this one."
            )


def register() -> None:
    """Register everything; it is unregistered when the process ends, at the latest.

    Raises
    ------
    RuntimeError
        If another copy of the extension is enabled; that one goes on working.
    """
    _refuse_second_copy()
    atexit.register(_unregister_at_exit)
    kernels.register()
    translations.register()
    properties.register()
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    menus.register()
    manual.register()
    command.register()
    for handlers, function in _handlers():
        handlers.append(function)


def unregister() -> None:
    """Stop all runs and previews, and unregister everything in reverse order."""
    from .operators import statistics

    atexit.unregister(_unregister_at_exit)
    painting.unregister()
    preview_operator.unregister()
    jobs.stop_all()
    flow_shown.hide()
    automatic.stop()
    strokes.forget_step()
    for handlers, function in _handlers():
        if function in handlers:  # other add-ons may clear these lists
            handlers.remove(function)
    command.unregister()
    manual.unregister()
    menus.unregister()
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
    properties.unregister()
    translations.unregister()
    _forget_file()
    data.live.watching.forget()
    statistics.forget()
    kernels.unregister()
