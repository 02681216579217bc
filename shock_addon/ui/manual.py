# SPDX-License-Identifier: GPL-3.0-or-later
"""Links into the manual: the page and heading of each operator and property.

The pages are in the folder ``manual`` of the extension. ``nox -s docs`` builds them in a source
tree; without them, Blender reports that there is no page.
"""

from __future__ import annotations

from pathlib import Path

import bpy

from ..data import PICTURES
from ..modes import MODES, choices
from ..operators.properties import AUTO, FROM, LENGTH

FOLDER = Path(__file__).resolve().parents[2] / "manual"

HOME = "index"

_OPERATORS = {
    "preview": "preview",
    "preview_generated": "preview#generate",
    "keep_auto": "panel#auto",
    "paint_gain": "detail#paint-gain",
    "show_flow": "preview#show-flow",
    "hide_flow": "preview#show-flow",
    "mark_creases": "creases#mark-creases",
    "show_creases": "creases#show-creases",
    "hide_creases": "creases#show-creases",
    "crisp_low_poly": "creases#crisp-low-poly",
    "cancel": "panel#while-it-runs",
    "bake_maps": "maps",
    "link_map": "generate#add-node",
    "before_after": "panel#before-and-after",
    "use_preset": "presets",
    "update_live": "live#after-edits",
    "auto_update_live": "live#of-what-modifiers-make",
    "paint_live": "live",
    "paint_live_texture": "live#textures",
}
"""The places of operators that are not filters."""

_SHARED = {
    "vertex_group": "masks#vertex-group",
    "invert_mask": "masks#invert",
    "selected_only": "masks#selected-only",
    "mask_image": "masks#mask-image",
    "weld": "masks#weld",
}
"""Properties that are explained in one place for all modes."""

_ALSO = {"start": (FROM,), "blending": (LENGTH,)}
"""Properties that show others in another way."""

_TOGETHER = {
    "steady_state": "time",
    "fit_steps": "fit-steps-and-crease-freedom",
    "crease_freedom": "fit-steps-and-crease-freedom",
    "then_sharpen": "then-sharpen-sharpen-time",
    "sharpen_time": "then-sharpen-sharpen-time",
    **dict.fromkeys(PICTURES, "image-2-image-3-image-4"),
    "mark_sharp": "mark-sharp-sharp-angle",
    "sharp_angle": "mark-sharp-sharp-angle",
}
"""Properties that share a heading."""


def heading(name: str, on_screen: str) -> str:
    """Return the anchor of a property's heading, which is made from its label."""
    return _TOGETHER.get(name, on_screen.lower().replace(" ", "-"))


def entries() -> dict[str, str]:
    """List pairs of a pattern of Blender's names and its place, most specific first."""
    places = _OPERATORS | {mode.operator: mode.page for mode in MODES}
    places |= {f"{mode.key}_preset_add": "presets" for mode in choices()}
    found = {f"bpy.ops.shock_filter.{name}": where for name, where in places.items()}
    scene = bpy.types.Scene.bl_rna.properties["shock_filter"].fixed_type
    for mode in choices():
        group = scene.properties[mode.key].fixed_type
        for name in mode.names:
            on_screen = group.properties[name].name
            where = _SHARED.get(name) or f"{mode.page}#{heading(name, on_screen)}"
            for shown in (name, f"{name}{AUTO}", *_ALSO.get(name, ())):
                if shown in group.properties:
                    found[f"bpy.types.{group.identifier.lower()}.{shown}"] = where
    for name in ("mode", "image_mode", "job", "image_job", "noisy"):
        found[f"bpy.types.shock_filter_pg_scene.{name}"] = "panel#modes"
    found["bpy.*.shock_filter*"] = HOME
    return found


def file_of(where: str) -> str:
    """Return the name of the file that redirects to a place."""
    # There is a file for each heading, as Blender drops the part of a URL after #.
    return f"go/{where.replace('#', '.')}.html" if "#" in where else f"{where}.html"


def address(where: str = HOME) -> str | None:
    """Return the URL of a place in the manual; None if the manual is missing."""
    path = FOLDER / file_of(where)
    return path.as_uri() if path.is_file() else None


def manual_map() -> tuple[str, tuple[tuple[str, str], ...]]:
    """Return the pages that Blender's menu entry *Online Manual* opens."""
    if address() is None:
        return "", ()
    pairs = ((name, file_of(where)) for name, where in entries().items())
    return f"{FOLDER.as_uri()}/", tuple(pairs)


class SHOCK_FILTER_preferences(bpy.types.AddonPreferences):
    """What is seen of the extension in Blender's preferences."""

    bl_idname = __package__.removesuffix(".shock_addon.ui")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the link to the manual."""
        url = address()
        if url is not None:
            self.layout.operator("wm.url_open", text="Manual", icon="HELP").url = url


CLASSES = (SHOCK_FILTER_preferences,)


def register() -> None:
    """Register the manual in Blender."""
    bpy.utils.register_manual_map(manual_map)


def unregister() -> None:
    """Unregister the manual."""
    bpy.utils.unregister_manual_map(manual_map)
