# SPDX-License-Identifier: GPL-3.0-or-later
"""Auto Update: live copies are updated when their source has changed and no change follows."""

from __future__ import annotations

import math
import time
from contextlib import nullcontext

import bpy

from .. import data
from ..running import jobs
from . import updating

REST = 0.15
"""Seconds without a change before an update; a change that comes later cancels it."""

_PAUSE = 1.0
"""Seconds without a change after which the next is taken as the only one, and waits for nothing."""

_QUIET = 1.0
"""Seconds of an update before its progress is drawn, which takes time from it."""

_LOOK, LOOK_ASLEEP = 0.02, 0.05
"""Seconds between checks during activity, and otherwise."""

_AWAKE = 3.0
"""Seconds of activity after a change."""

_AFTER_UNDO = 1.0
"""Seconds after an undo or redo in which changes are those that it brought."""

_seen = 0.0
_rest = REST
"""Seconds without a change that the last one waits for."""

_job: jobs.Job | None = None
"""That of the last update."""

_updated = 0
"""Uid of the copy of the last update."""

_undone = -math.inf
_is_allowed = True
"""Whether copies may update themselves: in an opened file only after someone turns it on."""

_refused: set[int] = set()
"""Uids of copies whose last update failed, until their source changes again."""


def is_on(obj: bpy.types.Object) -> bool:
    """Whether a live copy updates itself."""
    is_wanted = bool(obj.get(data.LIVE_AUTO))
    return _is_allowed and is_wanted and data.chosen.live_source(obj) is not None


def is_coming(obj: bpy.types.Object) -> bool:
    """Whether a live copy that is out of date is about to be updated.

    Right after a change the tab is drawn before that is looked at. If it said then that the copy is
    out of date, its panels would move for it, and back: each takes several drawings of the window.
    """
    is_running = _running() is not None and obj.session_uid == _updated
    is_new = not _is_of_undo() and obj.session_uid in data.live.watching.changed_since(_seen)
    return is_on(obj) and (is_running or is_new or obj.session_uid not in _refused)


def switch(obj: bpy.types.Object, is_wanted: bool) -> None:
    """Turn Auto Update on or off; turning it on also allows it for this file."""
    global _is_allowed
    obj[data.LIVE_AUTO] = is_wanted
    if is_wanted:
        _is_allowed = True
        start()


def start() -> None:
    """Start checking."""
    if not bpy.app.timers.is_registered(_look):
        bpy.app.timers.register(_look, first_interval=REST)


def stop() -> None:
    """Stop checking."""
    if bpy.app.timers.is_registered(_look):
        bpy.app.timers.unregister(_look)


def forbid(*_: object) -> None:
    """Pause automatic updates in an opened file, until someone turns them on."""
    global _is_allowed
    _is_allowed = False
    _refused.clear()


def wait(*_: object) -> None:
    """Pause automatic updates after an undo or redo, since an update would end the redo."""
    global _undone
    _undone = time.monotonic()
    _refused.update(obj.session_uid for obj in data.live.watching.changed_copies())
    if job := _running():
        job.cancel()  # it has read what is gone


def due() -> list[bpy.types.Object]:
    """List the copies that would be updated now."""
    if not _is_allowed or _is_busy():
        return []
    behind = [obj for obj in data.live.watching.changed_copies() if is_on(obj)]
    return [obj for obj in behind if obj.session_uid not in _refused and not updating.obstacle(obj)]


def run() -> None:
    """Update the first copy that is due."""
    global _updated
    for obj in due()[:1]:
        _updated = obj.session_uid
        _refused.add(_updated)  # an error must not come again and again
        try:
            window = bpy.context.window_manager.windows[0] if not bpy.app.background else None
            with bpy.context.temp_override(window=window) if window else nullcontext():
                updating.update(obj, "INVOKE_DEFAULT", began=_note_job, with_textures=False)
        except RuntimeError as error:
            print(f"Shock Filter: {obj.name}: {error}")


def _note_job() -> None:
    global _job
    _job = jobs.current()
    if _job is not None:
        _job.quiet_until = time.monotonic() + _QUIET
        # Before Blender 4.2 nobody knows of a drag that a key has begun.
        _job.keys_pass = "modal_operators" in bpy.types.Window.bl_rna.properties
        _job.is_welcome = _is_welcome


def _look() -> float:
    global _seen, _rest
    changed_at = data.live.watching.changed_at
    if changed_at != _seen:
        changed = data.live.watching.changed_since(_seen)
        _rest = 0.0 if changed_at - _seen > _PAUSE else REST
        _seen = changed_at
        if not _is_of_undo():
            _refused.difference_update(changed)
        else:  # Blender evaluates after the handlers of undo
            _refused.update(obj.session_uid for obj in data.live.watching.changed_copies())
        if _updated in changed:
            _drop()  # its result would be out of date
    if bpy.context.mode != "OBJECT":
        _drop()  # nothing is written in other modes, in which the artist may stay for long
    elapsed = time.monotonic() - changed_at
    if elapsed < _rest:
        return max(_rest - elapsed, 0.01)
    run()
    return _LOOK if elapsed < _AWAKE else LOOK_ASLEEP


def _running() -> jobs.Job | None:
    return _job if _job is jobs.current() else None


def _drop() -> None:
    # An update that is under way comes again when it may.
    if job := _running():
        job.cancel()
        _refused.discard(_updated)


def _is_welcome() -> bool:
    """Whether the result of an update may be written: not while keys do something else.

    Nor before `_look` has seen the last change, which may put it out of date.
    """
    is_seen = bool(data.live.watching.changed_at == _seen)
    return is_seen and bpy.context.mode == "OBJECT" and not _is_artist_busy()


def _is_of_undo() -> bool:
    """Whether an undo or redo has brought the last change."""
    return data.live.watching.changed_at - _undone <= _AFTER_UNDO


def _is_busy() -> bool:
    if jobs.current() is not None or jobs.is_settling() or jobs.is_scene_read():
        return True
    return bpy.context.mode != "OBJECT" or _is_artist_busy()


def _is_artist_busy() -> bool:
    return jobs.is_artist_busy(time.monotonic() - data.live.watching.changed_at)
