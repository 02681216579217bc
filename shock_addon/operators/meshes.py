# SPDX-License-Identifier: GPL-3.0-or-later
"""The base of operators on mesh objects: each object is read, filtered and written."""

from __future__ import annotations

from functools import partial
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from .. import data
from ..data.skipped import Skipped, listed
from ..kinds import Data
from . import poll as obstacles
from .base import Done, FilterOperator, Written, counted, describe_colors, write_results

_APPLY = (
    "The mesh below the modifiers was filtered; to filter their result, apply them first, or"
    " choose the output New Object."
)


class MeshOperator(FilterOperator):
    """Mixin for operators on mesh objects."""

    obstacle = staticmethod(obstacles.of_meshes)

    @property
    def kind(self) -> Data:
        """Return the kind of data of the chosen target."""
        return self.row.target(self).data

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Read all selected objects, or those in the current object mode."""
        self._limited: set[int] = set()
        return data.mesh.meshes.read_targets(
            context,
            self._read_one,
            self,
            is_seen=partial(obstacles.makes_object, self.row, self),
            source_of=self._source_of,
        )

    def _read_one(self, obj: bpy.types.Object, mode: str, parameters: Any) -> Any:
        if self._is_live(obj):
            data.live.stacks.check(obj)
            self._check_colors(obj)
            if data.mesh.masks.is_limited(obj, mode, parameters):
                self._limited.add(obj.session_uid)
            parameters = data.live.recipes.AsLive(parameters)
        return self.kind.read(obj, mode, parameters)

    def write(self, context: bpy.types.Context, results: list[Any]) -> Done:
        """Write all objects, and return to the current object mode."""
        write: Any = partial(self.kind.write, key_name=self.row.done)
        write_new = partial(
            data.mesh.visible.write_new,
            write=write,
            suffix=self.row.done.lower(),
            only_changed=self.row.makes_objects(self, "AUTO"),
        )

        def write_one(target: Any, result: Any) -> bpy.types.Object:
            obj = data.mesh.targets.find(target)
            is_live = self._is_live(obj)
            if is_live and self._has_other_live(obj):
                self._other_live.append(obj.name)
            if is_live or target.is_seen:
                new = (self._write_live if is_live else write_new)(target, result)
                if new != obj:
                    swaps.append(data.replaced.ObjectSwap(obj, new))
                if not target.is_seen or (new != obj and not is_live):
                    data.live.copies.release(new.data)
                return new
            write(target, result)
            was_live = self.kind.moves and data.live.movement.remove(obj.data)
            was_live |= self.kind.paints and data.live.coloring.remove(obj.data)
            if was_live:
                self._replaced_live.append(obj.name)
            return obj

        self._replaced_live: list[str] = []
        self._other_live: list[str] = []
        with data.mesh.meshes.object_mode(context):
            meshes = data.replaced.of_meshes([each for each in self.targets if not each.is_seen])
            swaps: list[data.replaced.Swap] = [*meshes]
            done = write_results(self.targets, results, write_one)
            for swap in meshes:
                swap.note_after()
            data.replaced.hold(swaps)
        self._is_held_back = self.kind.moves and self._forget_closed(done[0])
        return done

    def _forget_closed(self, written: list[Written]) -> bool:
        """Drop remarks on closed creases of meshes that have not moved visibly, as by weak masks.

        Returns whether there were any.
        """
        closed = {id(target) for target, each in self._findings if "widest_fillet" in each.values}
        still = {
            id(each.target)
            for each in written
            if not getattr(each.result, "shape", each.result).moved
        }
        self._findings[:] = [each for each in self._findings if id(each[0]) not in closed & still]
        return bool(closed & still)

    def _is_live(self, obj: bpy.types.Object) -> bool:
        return obstacles.makes_live(self.row, self, obj)

    def _has_other_live(self, obj: bpy.types.Object) -> bool:
        """Whether another filter made the live result whose place this one takes."""
        kinds = [data.LIVE_STAMP] * self.kind.moves + [data.LIVE_COLORS] * self.kind.paints
        live = [each for each in kinds if data.chosen.is_live(obj, each)]
        made = [data.live.recipes.noted(obj.data, each) for each in live]
        return any(recipe is not None and recipe[0] != self.row.operator for recipe in made)

    def _check_colors(self, obj: bpy.types.Object) -> None:
        source = data.chosen.live_source(obj)
        if source is not None and not self.kind.moves:
            raise Skipped(
                "it is a live copy, whose colors come from {name}; make those of {name} live",
                name=source.name,
            )

    def _source_of(self, obj: bpy.types.Object) -> bpy.types.Object | None:
        return data.chosen.live_source(obj) if self._is_live(obj) else None

    def _write_live(self, target: Any, result: Any) -> bpy.types.Object:
        write = data.live.copies.write if target.is_seen else data.live.results.write
        obj = write(target, result)
        values = {name: getattr(self, name) for name in self.row.names_for(self)}
        values["output"] = "LIVE"
        if target.object_uid in self._limited:
            values[data.live.recipes.LIMITED] = True
        if self.kind.paints:
            values["attribute"] = target.place[1] if self.kind.moves else target.place
            data.live.recipes.note(obj.data, self.row.operator, values, data.LIVE_COLORS)
        if self.kind.moves:
            data.live.recipes.note(obj.data, self.row.operator, values)
        return obj

    def counts(self, written: list[Written]) -> tuple[int, int]:
        """Count the moved vertices and changed colors, and all of these."""
        changed = total = 0
        for each in written:
            if self.kind.moves:
                moved = _moved(each)
                changed, total = changed + int(moved.sum()), total + len(moved)
            if self.kind.paints:
                paint = getattr(each.result, "paint", each.result)
                changed, total = changed + paint.changed, total + paint.counted
        return changed, total

    def summary(self, written: list[Written], seconds: float) -> str:
        """Return the number of meshes, and of their changes."""
        results = [each.result for each in written]
        meshes = counted(len(written), "1 mesh", "{:,} meshes")
        kind = self.kind
        text, advice = pgettext_rpt("{done} {meshes}: {changes}, {seconds:.1f} s."), ""
        if not kind.paints:
            changes = describe_moves(results, self._edge_length(written))
            has_moved = any(result.moved for result in results)
            if not self.row.nothing and not has_moved:
                advice = self.advice and pgettext_rpt(self.advice)
            elif not has_moved and not self._is_held_back:
                has_modifiers = any(
                    _other_modifiers(each.data) and not each.target.is_seen for each in written
                )
                advice = _APPLY if has_modifiers else self.advice
                text = pgettext_rpt(self.row.nothing)
                advice = advice and pgettext_rpt(advice)
                marked = sum(data.mesh.shading.count_marks(each.data.data) for each in written)
                is_noted = any(map(_hides_marks, _noted(written, self)))
                if self.mark_sharp and marked and not is_noted:
                    marks = pgettext_rpt("Edges marked as sharp: {count:,}.").format(count=marked)
                    advice = f"{marks} {advice}".rstrip()
        elif not kind.moves:
            meshes = pgettext_rpt("the colors of {meshes}").format(meshes=meshes)
            changes = describe_colors(results, "colors", self.advice)
        else:
            meshes = counted(len(written), "1 mesh and its colors", "{:,} meshes and their colors")
            paints = [result.paint for result in results]
            shapes = [result.shape for result in results]
            moves = describe_moves(shapes, self._edge_length(written))
            changes = f"{moves}; {describe_colors(paints, 'colors', self.advice)}"
        said = text.format(done=self.done(), meshes=meshes, changes=changes, seconds=seconds)
        return f"{said} {advice}".rstrip()

    def scale_of(self, made: bpy.types.Object) -> float:
        """Return the scale of the object."""
        return data.mesh.meshes.scale_in_world(made)

    def _edge_length(self, written: list[Written]) -> float:
        """Return the mean edge length in the scene, of what moved farthest."""
        moved = [(getattr(each.result, "shape", each.result), each.data) for each in written]
        shape, made = max(moved, key=lambda pair: pair[0].largest_move * pair[0].edge_length)
        return shape.edge_length * self.scale_of(made)

    def notes(self, written: list[Written]) -> str:
        """Return remarks on modifiers and shape keys, if vertices may have moved."""
        said = _notes_of_objects(written, self) if self.kind.moves else ""
        kinds = [data.LIVE_STAMP] * self.kind.moves + [data.LIVE_COLORS] * self.kind.paints
        if any(data.chosen.is_live(each.data, key) for each in written for key in kinds):
            text = pgettext_rpt("The modifier Shock Filter sets how much of it is seen, and where.")
            said = f"{text} {said}".rstrip()
        if self._replaced_live:
            text = pgettext_rpt(
                "The live result of {names} was removed, since it would be added to this result."
            )
            said = f"{said} {text.format(names=listed(self._replaced_live))}"
        if self._other_live:
            text = pgettext_rpt(
                "The live result of {names} was replaced, which another filter had made. To keep"
                " both, undo, apply its modifier, and run again."
            )
            said = f"{said} {text.format(names=listed(self._other_live))}"
        return said.strip()


def _notes_of_objects(written: list[Written], operator: MeshOperator) -> str:
    new = _new(written)
    noted = _noted(written, operator)
    said = notes(noted, operator)
    if operator.output == "SHAPE_KEY" and not any(_moved(each).any() for each in written):
        text = pgettext_rpt("Nothing has changed, so no shape key was added.")
        return f"{text} {said}".rstrip()
    if len(noted) < len(written) and not new:
        text = pgettext_rpt("Nothing has changed, so no new object was made.")
        return f"{text} {said}".rstrip()
    if not new:
        return said
    made = pgettext_rpt("New: {names}.").format(names=listed([obj.name for obj in new]))
    return f"{made} {hidden_originals(len(new))} {said}".rstrip()


def _moved(written: Written) -> Any:
    # Which vertices moved, if only by a bit.
    new = getattr(written.result, "shape", written.result).positions
    old = getattr(written.target.surface, "shape", written.target.surface).positions
    return (new != old).any(axis=1)


def _new(written: list[Written]) -> list[bpy.types.Object]:
    return [each.data for each in written if each.data.session_uid != each.target.object_uid]


def _noted(written: list[Written], operator: MeshOperator) -> list[bpy.types.Object]:
    # All but those that stay what they were because nothing of what is seen has changed.
    new = _new(written)
    return [
        each.data
        for each in written
        if not each.target.is_seen
        or each.data in new
        or obstacles.makes_live(operator.row, operator, each.data)
    ]


def hidden_originals(count: int) -> str:
    """Say that what new objects were made of is hidden."""
    if count == 1:
        return pgettext_rpt("The original is hidden.")
    return pgettext_rpt("The originals are hidden.")


def describe_moves(results: list[Any], edge: float) -> str:
    """Return how many vertices moved visibly and how far.

    `edge` is the mean edge length in the scene of the one that moved farthest.
    """
    moved = sum(result.moved for result in results)
    farthest = max(results, key=lambda result: result.largest_move * result.edge_length)
    if moved:
        text = pgettext_rpt("{vertices:,} vertices, moved {moved:,}, largest move {largest}")
    elif farthest.largest_move > 0:
        text = pgettext_rpt("{vertices:,} vertices, none moved visibly, largest move {largest}")
    else:
        text = pgettext_rpt("{vertices:,} vertices, none moved")
    return text.format(
        vertices=sum(len(result.positions) for result in results),
        moved=moved,
        largest=data.lengths.in_both(farthest.largest_move, edge),
    )


def notes(objects: list[bpy.types.Object], parameters: Any) -> str:
    """Return remarks on data that was not changed although it affects the appearance.

    Parameters
    ----------
    objects : list of bpy.types.Object
    parameters : object
        Has `output`, `custom_normals` and `mark_sharp`.
    """
    found = []
    if any(map(_other_modifiers, objects)):
        found.append(pgettext_rpt("Modifiers were left in place and act on the new shape."))
    if parameters.custom_normals == "KEEP" and any(obj.data.has_custom_normals for obj in objects):
        found.append(
            pgettext_rpt(
                "Custom normals were kept, and no edges marked as sharp; choose Recompute or Clear"
                " if the shading looks wrong."
                if parameters.mark_sharp
                else "Custom normals were kept; choose Recompute or Clear if the shading looks"
                " wrong."
            )
        )
    if parameters.mark_sharp and any(map(_hides_marks, objects)):
        text = pgettext_rpt(
            "Edges marked as sharp: {count:,}; that shows on smooth faces only, use Shade Smooth."
        )
        marked = sum(data.mesh.shading.count_marks(obj.data) for obj in objects)
        found.append(text.format(count=marked))
    for obj in objects if parameters.output in {"MESH", "AUTO"} else []:
        key = obj.active_shape_key
        if key is not None and _is_muted(obj, key):
            text = pgettext_rpt("The shape key {name} is muted; unmute it to see the change.")
            found.append(text.format(name=key.name))
        elif key is not None and key.value == 0.0 and not _shows_key(obj, key):
            text = pgettext_rpt(
                "The value of the shape key {name} is 0; raise it to see the change."
            )
            found.append(text.format(name=key.name))
    return " ".join(found)


def _other_modifiers(obj: bpy.types.Object) -> list[bpy.types.Modifier]:
    # Without those of live results.
    live = data.chosen.live_modifiers(obj)
    return [each for each in obj.modifiers if each not in live]


def _hides_marks(obj: bpy.types.Object) -> bool:
    # Whether it has edges that are marked as sharp, and is shaded flat.
    return data.mesh.shading.is_flat(obj.data) and data.mesh.shading.count_marks(obj.data) > 0


def _is_muted(obj: bpy.types.Object, key: bpy.types.ShapeKey) -> bool:
    """Whether an object does not show its active shape key because it is muted, even if pinned."""
    keys = obj.data.shape_keys
    return key.mute and key != keys.reference_key and keys.use_relative and obj.mode != "EDIT"


def _shows_key(obj: bpy.types.Object, key: bpy.types.ShapeKey) -> bool:
    """Whether an object shows its active shape key at full strength, whatever its value."""
    keys = obj.data.shape_keys
    alone = obj.show_only_shape_key or obj.mode == "EDIT"
    return key == keys.reference_key or not keys.use_relative or alone
