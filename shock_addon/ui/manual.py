# SPDX-License-Identifier: GPL-3.0-or-later
"""The manual: which page and heading explain each operator and each property.

The pages lie in the folder ``manual`` of the extension. A source tree has them once
``nox -s docs`` has run; without them, Blender finds no page and says so.
"""

from __future__ import annotations

from pathlib import Path

import bpy

from ..data import PICTURES
from ..modes import MODES, choices

FOLDER = Path(__file__).resolve().parents[2] / "manual"

HOME = "index"

_OPERATORS = {
    "preview": "preview",
    "paint_gain": "detail#paint-gain",
    "show_flow": "preview#show-flow",
    "hide_flow": "preview#show-flow",
    "mark_creases": "creases#mark-creases",
    "show_creases": "creases#show-creases",
    "hide_creases": "creases#show-creases",
    "crisp_low_poly": "creases#crisp-low-poly",
    "cancel": "panel#while-it-runs",
    "before_after": "panel#before-and-after",
    "use_preset": "presets",
}
"""The places of the operators that are no filters."""

_SHARED = {
    "mode": "panel#modes",
    "image_mode": "panel#modes",
    "vertex_group": "masks#vertex-group",
    "invert_mask": "masks#invert",
    "selected_only": "masks#selected-only",
    "mask_image": "masks#mask-image",
    "weld": "masks#weld",
}
"""Properties that are explained in one place for all modes."""

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
    """Name the heading that explains a property: its name on screen, as pages write addresses."""
    return _TOGETHER.get(name, on_screen.lower().replace(" ", "-"))


def entries() -> dict[str, str]:
    """List the place for each of Blender's names, most special first."""
    places = _OPERATORS | {mode.operator: mode.page for mode in MODES}
    places |= {f"{mode.key}_preset_add": "presets" for mode in choices()}
    found = {f"bpy.ops.shock_filter.{name}": where for name, where in places.items()}
    scene = bpy.types.Scene.bl_rna.properties["shock_filter"].fixed_type
    for mode in choices():
        group = scene.properties[mode.key].fixed_type
        for name in mode.names:
            on_screen = group.properties[name].name
            where = _SHARED.get(name) or f"{mode.page}#{heading(name, on_screen)}"
            found[f"bpy.types.{group.identifier.lower()}.{name}"] = where
    for name in ("mode", "image_mode"):
        found[f"bpy.types.shock_filter_pg_scene.{name}"] = _SHARED[name]
    found["bpy.*.shock_filter*"] = HOME
    return found


def file_of(where: str) -> str:
    """Name the file that leads to a place."""
    # A file for each heading: what stands after # gets lost on the way to the browser.
    return f"go/{where.replace('#', '.')}.html" if "#" in where else f"{where}.html"


def address(where: str = HOME) -> str | None:
    """Return the address of a place in the manual; None if the manual is not there."""
    path = FOLDER / file_of(where)
    return path.as_uri() if path.is_file() else None


def manual_map() -> tuple[str, tuple[tuple[str, str], ...]]:
    """Tell Blender what its menu entry *Online Manual* opens."""
    if address() is None:
        return "", ()
    pairs = ((name, file_of(where)) for name, where in entries().items())
    return f"{FOLDER.as_uri()}/", tuple(pairs)


class SHOCK_FILTER_preferences(bpy.types.AddonPreferences):
    """What is seen of the extension in Blender's preferences."""

    bl_idname = __package__.removesuffix(".shock_addon.ui")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the way to the manual."""
        draw_link(self.layout, "Manual")


def draw_link(layout: bpy.types.UILayout, text: str, where: str = HOME) -> None:
    """Draw a button that opens the manual, or nothing if the manual is not there."""
    url = address(where)
    if url is not None:
        layout.operator("wm.url_open", text=text, icon="HELP").url = url


CLASSES = (SHOCK_FILTER_preferences,)


def register() -> None:
    """Have Blender ask for the manual."""
    bpy.utils.register_manual_map(manual_map)


def unregister() -> None:
    """Have Blender forget the manual."""
    bpy.utils.unregister_manual_map(manual_map)
