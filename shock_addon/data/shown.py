# SPDX-License-Identifier: GPL-3.0-or-later
"""Image Editors whose image is removed by undo, or restored by redo.

Blender leaves such an editor empty, because undo does not include the choice of its image.
"""

from __future__ import annotations

from collections.abc import Iterator

import bpy
from bpy.app.handlers import persistent

from ...core.host import forgetting

_sources: dict[int, int] = {}
"""The source of each image that a run has added; both by uid."""

_undone: dict[int, list[int]] = {}
"""The images that undo has removed from each editor, in that order."""

_robbed: set[int] = set()
"""The editors from which the last undo has removed images."""

_before: dict[int, int] = {}
"""The image of each editor before the current undo or redo."""

_there_before: set[int] = set()
"""All images before the current undo or redo."""


def show(
    space: bpy.types.Space | None, source: bpy.types.Image, image: bpy.types.Image, again: bool
) -> None:
    """Show an image that was made from `source` in an Image Editor, if there is one.

    Parameters
    ----------
    space : bpy.types.Space or None
        Which editor, of any kind.
    source, image : bpy.types.Image
        The same image if it was replaced.
    again : bool
        Whether a run is repeated with other settings: then other editors, from which undo has just
        taken what the first run had added, show its new result.
    """
    if image != source:
        _sources[image.session_uid] = source.session_uid
    for editor in _editors():
        is_robbed = again and editor.as_pointer() in _robbed
        if editor == space or (is_robbed and editor.image == source):
            editor.image = image
    _robbed.clear()


def images() -> list[bpy.types.Image]:
    """List the images that Image Editors show."""
    return [editor.image for editor in _editors() if editor.image is not None]


def replace(old: bpy.types.Image, new: bpy.types.Image, only: set[int] | None) -> set[int]:
    """Show another image in the Image Editors that show `old`; return these editors.

    If `only` is given, other editors are left alone.
    """
    found = set()
    for editor in _editors():
        if editor.image == old and (only is None or editor.as_pointer() in only):
            editor.image = new
            found.add(editor.as_pointer())
    return found


@persistent
def note(*_: object) -> None:
    """Store what editors show, before an undo or a redo."""
    _before.clear()
    _before.update(
        (editor.as_pointer(), editor.image.session_uid) for editor in _editors() if editor.image
    )
    _there_before.clear()
    _there_before.update(_images())


@persistent
def restore(*_: object) -> None:
    """Show the source of each image that is gone, and each image that has come back."""
    there = _images()
    _robbed.clear()
    for editor in _editors():
        uid = _before.get(editor.as_pointer())
        taken = _undone.setdefault(editor.as_pointer(), [])
        while uid not in there and uid in _sources:
            _robbed.add(editor.as_pointer())
            taken.append(uid)
            uid = _sources[uid]
        while taken and taken[-1] in there and _sources[taken[-1]] == uid:
            back = taken.pop()
            uid = uid if back in _there_before else back
        if uid in there and editor.image != there[uid]:
            editor.image = there[uid]


@forgetting.with_file
def forget() -> None:
    """Forget the images of the previous file."""
    _sources.clear()
    _undone.clear()


def _images() -> dict[int, bpy.types.Image]:
    return {image.session_uid: image for image in bpy.data.images}


def _editors() -> Iterator[bpy.types.SpaceImageEditor]:
    for screen in bpy.data.screens:
        for area in screen.areas:
            yield from (space for space in area.spaces if space.type == "IMAGE_EDITOR")
