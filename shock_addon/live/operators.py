# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators Update, Auto Update, and Paint Where of meshes and of textures."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt

from .. import data
from ..data.skipped import Refused, explain, listed
from ..operators import poll as obstacles
from ..operators.base import can_run
from . import automatic, updating
from .drawing import BLACK_SHOWS, PAINTED, WHITE_SHOWS

_GROUP = "Shock Filter"
"""The vertex group that is painted."""

_WHOLE = (
    "{names}: changes as a whole, as Update keeps no selection or mask of another mode; use a"
    " vertex group, or Paint Where."
)

_Plan = list[tuple[bpy.types.Object, list[updating.Step]]]
"""Objects, with the operator that updates their results."""


def _active(context: bpy.types.Context) -> bpy.types.Object | None:
    obj = context.object
    return obj if obj is not None and obj.type == "MESH" else None


def _is_limited(step: updating.Step) -> bool:
    return data.live.recipes.LIMITED in step.settings


class SHOCK_FILTER_OT_update_live(bpy.types.Operator):
    """Make live results again."""

    bl_idname = "shock_filter.update_live"
    bl_label = "Update"
    bl_description = (
        "Update the live results of the selected objects, with the settings that made them. The"
        " modifiers keep their inputs, and live copies are made again from their source"
    )
    bl_options = set()  # the filter adds the step of undo

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether there is a live result that can be updated."""
        return can_run(cls, updating.obstacle(_active(context)))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Compute on a thread if it is one object."""
        plan = self._plan(context)
        return self._update(plan, "INVOKE_DEFAULT" if len(plan) == 1 else "EXEC_DEFAULT")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Update one after the other."""
        return self._update(self._plan(context), "EXEC_DEFAULT")

    def _update(self, plan: _Plan, how: str) -> set[str]:
        done = 0
        made: list[updating.Step] = []
        limited = []
        for obj, steps in plan:
            ended: set[str] = set()
            left = [step for step in steps if not any(each.does(step) for each in made)]
            try:
                if left:
                    is_last = obj == plan[-1][0]
                    ended = updating.run_each(obj, left, how, is_last, ended=made.append)
                    done += ended != {"CANCELLED"}
                    if ended != {"CANCELLED"} and any(map(_is_limited, left)):
                        limited.append(obj.name)
            except RuntimeError as error:
                self.report({"ERROR"}, str(error).strip().removeprefix("Error: "))
        if limited:
            text = pgettext_rpt(_WHOLE).format(names=listed(limited))
            self.report({"WARNING"}, text)
        if done and ended.isdisjoint({"FINISHED", "RUNNING_MODAL"}):  # it has added no step of undo
            bpy.ops.ed.undo_push(message=self.bl_label)
        return {"FINISHED"} if done else {"CANCELLED"}

    def _plan(self, context: bpy.types.Context) -> _Plan:
        """List objects, each with its steps; without those of which the active one makes all."""
        first = updating.steps_of(context.object)
        others = [obj for obj in data.chosen.mesh_objects(context) if obj != context.object]
        plan = [(obj, updating.steps_of(obj)) for obj in others if not updating.obstacle(obj)]
        return [(context.object, first)] + [
            (obj, steps)
            for obj, steps in plan
            if not all(any(each.does(step) for each in first) for step in steps)
        ]


class SHOCK_FILTER_OT_auto_update_live(bpy.types.Operator):
    """Turn automatic updates of a live copy on or off."""

    bl_idname = "shock_filter.auto_update_live"
    bl_label = "Auto Update"
    bl_description = (
        "Update this live copy whenever its source changes. After a file is opened it waits"
        " until this is pressed"
    )
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether the active object is a live copy."""
        obj = _active(context)
        is_copy = obj is not None and data.chosen.live_source(obj) is not None
        return can_run(cls, "" if is_copy else "Make a live copy the active object.")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Turn it on or off."""
        automatic.switch(context.object, not automatic.is_on(context.object))
        return {"FINISHED"}


class SHOCK_FILTER_OT_paint_live(bpy.types.Operator):
    """Paint a mask of a live result."""

    bl_idname = "shock_filter.paint_live"
    bl_label = "Paint Where"
    bl_description = (
        "Paint where the live result is shown: in Weight Paint Mode, on the vertex group that is"
        " the Mask of the modifier. A new one is 1 everywhere; paint with weight 0"
    )
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether there is a live result, in Object Mode."""
        obj = _active(context)
        obstacle = "Make a mesh object with a live result the active one."
        if obj is not None and data.chosen.live_modifiers(obj):
            obstacle = "" if obj.mode == "OBJECT" else "Go to Object Mode first."
        if not obstacle and data.chosen.mesh_refusal(obj.data):
            obstacle = data.chosen.mesh_refusal(obj.data)
        return can_run(cls, obstacle)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add the group, let the modifier read it, and go to Weight Paint Mode."""
        obj = context.object
        modifiers = data.chosen.live_modifiers(obj)
        name = data.live.stacks.linked_input(modifiers[0], data.live.graph.MASK)
        if name not in obj.vertex_groups:
            group = obj.vertex_groups.new(name=_GROUP)
            group.add(range(len(obj.data.vertices)), 1.0, "REPLACE")
            name = group.name
        for modifier in modifiers:
            linked = data.live.stacks.linked_input(modifier, data.live.graph.MASK)
            if linked not in obj.vertex_groups:
                data.live.stacks.link_input(modifier, data.live.graph.MASK, name)
        obj.vertex_groups.active = obj.vertex_groups[name]
        bpy.ops.object.mode_set(mode="WEIGHT_PAINT")
        self.report({"INFO"}, pgettext_rpt(PAINTED))
        return {"FINISHED"}


class SHOCK_FILTER_OT_paint_live_texture(bpy.types.Operator):
    """Paint a mask of a live texture."""

    bl_idname = "shock_filter.paint_live_texture"
    bl_label = "Paint Where"
    bl_description = (
        "Paint where the result of a live texture is shown: in Texture Paint Mode, on the image"
        " that is the Mask of its nodes. A new one is black, or white where a gain map is"
        " painted; paint with white"
    )
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether the active object has a live texture, in Object or Texture Paint Mode."""
        return can_run(cls, _texture_obstacle(context))

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add the image, let the nodes read it, and go to Texture Paint Mode."""
        obj = context.object
        node, mix = data.mixes.first_mixed(obj)
        _, settings = data.live.recipes.noted(mix, data.LIVE_TEXTURE) or ("", {})
        gain_map = bpy.data.images.get(settings.get("gain_map", ""))
        try:
            with data.mesh.meshes.object_mode(context):
                mask, is_inverted = data.image.live_masks.to_paint([obj.name], node.image, gain_map)
        except Refused as error:
            self.report({"ERROR"}, explain(error))
            return {"CANCELLED"}
        data.image.canvas.paint_on(context, mask, node.image)
        self.report({"INFO"}, pgettext_rpt(BLACK_SHOWS if is_inverted else WHITE_SHOWS))
        return {"FINISHED"}


def _texture_obstacle(context: bpy.types.Context) -> str:
    obj = _active(context)
    if obj is None:
        return obstacles.of_meshes(context)
    if obj.mode not in {"OBJECT", "TEXTURE_PAINT"}:
        return "Go to Object Mode first."
    if not obj.data.uv_layers:
        return obstacles.of_unwrapped(context)
    if not data.mixes.mixed([obj.name]):
        return (
            "Make a texture of the active object live first, by a filter of textures with the"
            " output Live; one that is linked from another file cannot be."
        )
    return ""


CLASSES = (
    SHOCK_FILTER_OT_update_live,
    SHOCK_FILTER_OT_auto_update_live,
    SHOCK_FILTER_OT_paint_live,
    SHOCK_FILTER_OT_paint_live_texture,
)
