# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames on disk, and image sequences that play them.

Any thread may write frames, into a hidden folder. The main thread moves them to their place; frames
that are never moved are removed.
"""

from __future__ import annotations

import os
import re
import weakref
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import bpy

from ....core.errors import Cancelled, ShockError
from ....core.files.frames import frame_name, write_folder
from ....core.files.output import Unfinished
from ....core.files.staging import temporary_folder
from ..chosen import find_again
from ..skipped import Refused

_FRAME = r"frame_\d+\.png"

_OWN = "shock_filter_frames"
"""Marks images that play frames that were made here."""

_written: set[Path] = set()
"""Folders that got frames in this session. The frames of other makers are never replaced."""


class Staged:
    """Complete frames in a hidden folder, which is removed with this object.

    Attributes
    ----------
    folder : Path
    count : int
    """

    def __init__(self, parent: Path, count: int) -> None:
        stack = ExitStack()
        self.folder = temporary_folder(parent, stack)
        self.count = count
        self._removal = weakref.finalize(self, stack.close)

    def remove(self) -> None:
        """Remove the folder, if it is still there."""
        self._removal()


def stage(pictures: Iterator[Any], parent: Path, count: int) -> Staged:
    """Write frames into a new hidden folder beside their place; does not use Blender.

    Raises
    ------
    ShockError
        If they cannot be written, or the run was cancelled. No files are left then.
    """
    staged = Staged(parent, count)
    try:
        write_folder(pictures, staged.folder, count)
    except BaseException as error:
        staged.remove()
        if isinstance(error, Unfinished):
            raise Cancelled("The run was cancelled; nothing was changed.") from error
        raise
    return staged


def move(staged: Staged, folder: Path) -> None:
    """Move frames to their place, and replace those of an earlier run."""
    folder.mkdir(exist_ok=True)
    _written.add(folder)
    for path in sorted(staged.folder.iterdir()):
        os.replace(path, folder / path.name)
    for path in folder.iterdir():
        number = re.fullmatch(r"frame_(\d+)\.png", path.name)
        if number and int(number[1]) > staged.count:
            path.unlink()
    staged.remove()


def find_folder(given: str, name: str, used: str) -> Path:
    """Choose the folder for frames.

    Parameters
    ----------
    given : str
        The user's choice; empty for a new folder beside the blend file.
    name : str
        What the frames show.
    used : str
        The folder of the earlier run that is repeated; empty for none.

    Raises
    ------
    Refused
        If there is no such place, or other files lie there.
    """
    same = not given or Path(bpy.path.abspath(given)) == Path(used)
    if used and same and Path(used).parent.is_dir():
        return Path(used)
    if not given:
        if not bpy.data.filepath:
            raise Refused("Save the blend file first, or choose a Folder (under Output).")
        return _free(Path(bpy.path.abspath("//")), bpy.path.clean_name(f"{name} flow"))
    if given.startswith("//") and not bpy.data.filepath:
        raise Refused("Save the blend file first, or choose a Folder that does not begin with //.")
    folder = Path(bpy.path.abspath(given))
    if not folder.parent.is_dir():
        raise Refused("There is no folder {folder}; make it first.", folder=str(folder.parent))
    if folder.exists() and not folder.is_dir():
        raise Refused("{folder} is a file; choose a folder.", folder=str(folder))
    if folder.is_dir() and not _is_own(folder):
        raise Refused(
            "The folder {folder} holds other files; choose an empty or a new one.",
            folder=str(folder),
        )
    if not os.access(folder.parent, os.W_OK | os.X_OK):
        raise Refused(
            "Cannot write to the folder {folder}; choose another.", folder=str(folder.parent)
        )
    return folder


def _is_own(folder: Path) -> bool:
    # Whether it is empty, or holds frames of an earlier run and nothing else.
    names = [path.name for path in folder.iterdir()]
    if not all(re.fullmatch(_FRAME, name) for name in names):
        return False
    played = (Path(bpy.path.abspath(i.filepath)).parent for i in bpy.data.images if _OWN in i)
    return not names or folder in _written or folder in played


def _free(parent: Path, name: str) -> Path:
    folder, number = parent / name, 0
    while folder.exists():
        number += 1
        folder = parent / f"{name}.{number:03}"
    return folder


def load(folder: Path, name: str, count: int) -> bpy.types.Image:
    """Add an image that plays the frames of a folder.

    Raises
    ------
    ShockError
        If Blender cannot read the first one.
    """
    try:
        image = bpy.data.images.load(str(folder / frame_name(1, count)))
    except RuntimeError as error:
        raise ShockError("{reason}", reason=str(error).strip()) from error
    image.name = name
    image[_OWN] = True
    image.source = "SEQUENCE"
    if bpy.data.filepath and folder.is_relative_to(Path(bpy.data.filepath).parent):
        image.filepath = bpy.path.relpath(image.filepath)  # the files move with the blend file
    return image


def play(user: bpy.types.ImageUser, count: int, repeats: bool) -> None:
    """Make a node or an editor play a sequence from frame 1 on."""
    user.frame_duration = count
    user.frame_start = 1
    user.frame_offset = 0
    user.use_cyclic = repeats
    user.use_auto_refresh = True


def play_in_materials(
    uids: dict[int, str], image: bpy.types.Image, count: int, repeats: bool
) -> None:
    """Play a sequence in the nodes that show an image, in the objects' materials."""
    for obj in find_again(uids)[0]:
        for slot in obj.material_slots:
            tree = slot.material.node_tree if slot.material else None
            for node in tree.nodes if tree else ():
                if node.type == "TEX_IMAGE" and node.image == image:
                    play(node.image_user, count, repeats)
