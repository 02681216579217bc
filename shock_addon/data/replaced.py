# SPDX-License-Identifier: GPL-3.0-or-later
"""Swapping of the last run's result with the data that it replaced, bit for bit.

The current data are compared with both, so that this also works after undo and redo.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

import bpy
import numpy.typing as npt

from ...core.base.memo import equal
from ...core.host import forgetting
from . import arrays, shown
from .chosen import subjects
from .image import images, mixing, textures
from .image.tiles import Tiles
from .live import color_nodes, nodes, recipes
from .mesh import shape_keys, visible
from .mesh.meshes import check_leaving, object_mode
from .mesh.original import color_attribute
from .mesh.targets import MeshTarget, find
from .skipped import Refused, Skipped

BEFORE, AFTER = "before", "after"


class _Attribute(NamedTuple):
    """A copy of an attribute of a mesh."""

    data_type: str
    domain: str
    values: npt.NDArray


class _Key(NamedTuple):
    """A copy of a shape key."""

    positions: npt.NDArray
    mute: bool


Contents = dict[tuple[str, str], _Attribute | _Key | str | None]
"""The data of a mesh, by kind and name, and recipes of live results; None for missing data."""


class MeshSwap:
    """A mesh before and after a run; created before it, and completed by `note_after`.

    Parameters
    ----------
    target : MeshTarget
        In Object Mode.
    """

    def __init__(self, target: MeshTarget) -> None:
        obj = find(target)
        self.name, self.uids = obj.name, {target.object_uid}
        self._mesh = target.mesh_uid
        self._attributes = ["position", "sharp_edge", "custom_normal", *nodes.ATTRIBUTES]
        self._attributes += color_nodes.ATTRIBUTES
        if color := color_attribute(target):
            self._attributes.append(color)
        self._before = self._after = self._read(obj.data)
        place = target.place[0] if isinstance(target.place, tuple) else target.place
        turned = getattr(place, "custom_normals", "KEEP") != "KEEP"
        self._is_whole = not (turned and _has_hidden_normals(obj.data))

    def note_after(self) -> None:
        """Store the mesh as it is now as the result, and drop data that has not changed."""
        mesh = self._find()
        before, after = self._before, self._read(mesh)
        for part, new in after.items():
            if isinstance(new, _Key) and part not in before:  # a muted key is not shown
                is_basis = part[1] == mesh.shape_keys.reference_key.name
                before[part] = new._replace(mute=not is_basis)
        changed = [part for part, new in after.items() if not _same(before.get(part), new)]
        self._before = {part: before.get(part) for part in changed}
        self._after = {part: after[part] for part in changed}

    @property
    def is_empty(self) -> bool:
        """Whether the run has changed nothing, or data that cannot be swapped."""
        return not (self._after and self._is_whole)

    def state(self) -> str:
        """Return which state the mesh has now, `BEFORE` or `AFTER`; empty for neither."""
        mesh = self._find()
        if mesh is None or mesh.is_editmode:
            return ""
        now = self._read(mesh)
        for state, contents in ((AFTER, self._after), (BEFORE, self._before)):
            if all(_same(now.get(part), kept) for part, kept in contents.items()):
                return state
        return ""

    def write(self, state: str) -> None:
        """Write one of both, in Object Mode."""
        mesh = self._find()
        for (kind, name), kept in (self._before if state == BEFORE else self._after).items():
            if kind == "recipe":
                recipes.put(mesh, name, kept)
            elif isinstance(kept, _Key):
                key = mesh.shape_keys.key_blocks[name]
                shape_keys.write(key, kept.positions)
                key.mute = kept.mute
            elif kept is None:
                mesh.attributes.remove(mesh.attributes[name])
            else:
                attribute = arrays.find_or_add_attribute(mesh, name, kept.data_type, kept.domain)
                arrays.write_attribute(attribute, kept.values)
        if mesh.shape_keys is not None:
            mesh.shape_keys.update_tag()
        mesh.update()

    def _find(self) -> bpy.types.Mesh | None:
        return next((mesh for mesh in bpy.data.meshes if mesh.session_uid == self._mesh), None)

    def _read(self, mesh: bpy.types.Mesh) -> Contents:
        found: Contents = {}
        for name in self._attributes:
            each = mesh.attributes.get(name)
            # Another attribute may have the same name.
            if each is not None and not arrays.is_readable(each):
                continue
            found["attribute", name] = each and _Attribute(
                each.data_type, each.domain, arrays.read_attribute(each)
            )
        for key in mesh.shape_keys.key_blocks if mesh.shape_keys else []:
            found["key", key.name] = _Key(shape_keys.read(key), key.mute)
        for key in recipes.OF_MESHES:
            found["recipe", key] = mesh.get(key)
        return found


class PixelsSwap:
    """An image whose pixels a run has replaced.

    Parameters
    ----------
    image : bpy.types.Image
        With the result.
    before : Tiles
        The old pixels, as `images.read_parts` returns them.
    after : bytes
        Digest of the result.
    objects : collection of int
        Uids of the objects whose faces show the image.
    """

    is_empty = False

    def __init__(
        self, image: bpy.types.Image, before: Tiles, after: bytes, objects: Collection[int] = ()
    ) -> None:
        self.name, self.uids = image.name, {image.session_uid, *objects}
        self._image = image.session_uid
        self._digests = {AFTER: after}
        self._other = before

    def state(self) -> str:
        """Return which of both the image holds now; see `MeshSwap`."""
        image = _image(self._image)
        if image is None:
            return ""
        now = images.digest_of(image)
        return next((state for state, digest in self._digests.items() if digest == now), "")

    def write(self, state: str) -> None:
        """Write the other one."""
        image = _image(self._image)
        now = images.read_parts(image)
        images.write_parts(image, self._other, image.packed_file is not None)
        self._digests[state] = images.digest_of(image)
        self._other = now


class ImageSwap:
    """An image that a run has added; it is swapped in editors and materials.

    Parameters
    ----------
    source, result : bpy.types.Image
    objects : list of str
        Names of the objects whose materials show the result.
    """

    def __init__(
        self, source: bpy.types.Image, result: bpy.types.Image, objects: Sequence[str]
    ) -> None:
        self.name, self._objects = result.name, list(objects)
        self.uids = {source.session_uid, result.session_uid}
        self.uids |= {bpy.data.objects[name].session_uid for name in objects}
        self._images = {BEFORE: source.session_uid, AFTER: result.session_uid}
        self._editors: set[int] = set()

    @property
    def is_empty(self) -> bool:
        """Whether neither editors nor materials show the result."""
        return self.state() != AFTER

    def state(self) -> str:
        """Return which of both is shown now; see `MeshSwap`."""
        seen = shown.images() + textures.shown_by(self._objects)
        uids = {image.session_uid for image in seen}
        return next((state for state in (AFTER, BEFORE) if self._images[state] in uids), "")

    def write(self, state: str) -> None:
        """Show one of both wherever the other one is shown."""
        other = _image(self._images[BEFORE if state == AFTER else AFTER])
        image = _image(self._images[state])
        only = None if state == BEFORE else self._editors
        self._editors = shown.replace(other, image, only)
        textures.assign(self._objects, other, image)


class MixSwap(ImageSwap):
    """An image that a run has added, and that materials mix with the old one."""

    def state(self) -> str:
        """Return which of both is mixed in now; see `MeshSwap`."""
        mixed = {node.image.session_uid for node in self._nodes() if node.image is not None}
        return next((state for state in (AFTER, BEFORE) if self._images[state] in mixed), "")

    def write(self, state: str) -> None:
        """Mix in one of the two images; the old one mixed with itself stays unchanged."""
        for node in self._nodes():
            node.image = _image(self._images[state])

    def _nodes(self) -> list[bpy.types.ShaderNodeTexImage]:
        return mixing.results(self._objects, _image(self._images[BEFORE]))


class ObjectSwap:
    """An object that a run has added where another one, which it has hidden, was.

    Parameters
    ----------
    source, result : bpy.types.Object
    """

    is_empty = False

    def __init__(self, source: bpy.types.Object, result: bpy.types.Object) -> None:
        self.name = result.name
        self._objects = {BEFORE: source.session_uid, AFTER: result.session_uid}
        self.uids = set(self._objects.values())

    def state(self) -> str:
        """Return which of both is shown now; see `MeshSwap`."""
        there = {state: self._find(state) for state in self._objects}
        if None in there.values():
            return ""
        shown_now = [state for state, obj in there.items() if not obj.hide_render]
        return shown_now[0] if len(shown_now) == 1 else ""

    def write(self, state: str) -> None:
        """Show one of both, selected, and hide the other one."""
        visible.show(self._find(state), self._find(BEFORE if state == AFTER else AFTER))

    def _find(self, state: str) -> bpy.types.Object | None:
        uid = self._objects[state]
        return next((obj for obj in bpy.data.objects if obj.session_uid == uid), None)


Swap = MeshSwap | PixelsSwap | ImageSwap | ObjectSwap

_held: list[Swap] = []
"""The data that the last run has replaced."""

_state: str | None = None
"""Which of both is there; None if it is not known."""

_last = AFTER
"""The one of both that was there last."""

_swaps = 0
"""Number of swaps since the run, minus undone ones; -1 if the run itself was undone."""


def of_meshes(targets: Sequence[MeshTarget]) -> list[MeshSwap]:
    """Read the data that a run may replace, in Object Mode."""
    found = []
    for target in targets:
        try:
            found.append(MeshSwap(target))
        except Skipped:  # the error is reported when the result is written
            continue
    return found


def hold(swaps: Sequence[Swap]) -> None:
    """Keep the data that a run has replaced, and drop that of an earlier run."""
    global _state, _last, _swaps
    _held[:] = [swap for swap in swaps if not swap.is_empty]
    _state, _last, _swaps = AFTER, AFTER, 0


@forgetting.with_file
def forget() -> None:
    """Drop all data."""
    hold([])


def look_again(step: int) -> None:
    """Compare the data again, after an undo, where `step` is -1, or a redo, where it is 1."""
    global _state, _last, _swaps
    if not _held:
        return
    if bpy.context.mode == "EDIT_MESH":  # in which meshes cannot be read
        _state = None
        return
    _state = _look()
    if _state and _state != _last:
        _last, _swaps = _state, _swaps + step


def is_held(context: bpy.types.Context) -> bool:
    """Whether the last run has replaced data of the current selection."""
    chosen = subjects(context)
    return any(swap.uids & chosen for swap in _held)


def is_before() -> bool:
    """Whether the data before the run is shown, by a swap and not by undo."""
    return _swaps > 0 and state() == BEFORE


def state() -> str:
    """Return which of both is there, `BEFORE` or `AFTER`; empty for neither."""
    global _state
    if _state is None and bpy.context.mode != "EDIT_MESH":
        _state = _look()
    return _state or ""


def swap(context: bpy.types.Context) -> str:
    """Restore the data before the last run or, if that is there, the result.

    Returns
    -------
    str
        `BEFORE` or `AFTER`, as it is now.

    Raises
    ------
    Skipped
        If the data has changed since, or the object mode cannot be left. Nothing is swapped then.
    """
    global _state, _last, _swaps
    check_leaving(context)
    with object_mode(context):
        states = [each.state() for each in _held]
        for each, found in zip(_held, states, strict=True):
            if not found:
                raise Refused(
                    "{name} was changed since the last run, so nothing was swapped; undo that"
                    " change, or run again.",
                    name=each.name,
                )
        new = BEFORE if all(found == AFTER for found in states) else AFTER
        for each, found in zip(_held, states, strict=True):
            if found != new:
                each.write(new)
    _state, _last, _swaps = new, new, _swaps + 1
    return new


def _look() -> str:
    states = {each.state() for each in _held}
    return states.pop() if len(states) == 1 else ""


def _same(one: Any, other: Any) -> bool:
    return (one is None) == (other is None) and (one is None or equal(one, other))


def _has_hidden_normals(mesh: bpy.types.Mesh) -> bool:
    # Custom normals that are no attribute, as before Blender 4.5: they cannot be put back exactly.
    return mesh.has_custom_normals and "custom_normal" not in mesh.attributes


def _image(uid: int) -> bpy.types.Image | None:
    return next((image for image in bpy.data.images if image.session_uid == uid), None)
