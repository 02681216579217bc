# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the creases of an object in colors, updated when Widest Fillet changes."""

from __future__ import annotations

from collections import Counter
from typing import Any

import blf
import bpy
import gpu
import numpy as np
import numpy.typing as npt
from bpy.app.translations import pgettext_iface as iface_
from bpy.app.translations import pgettext_rpt
from gpu_extras.batch import batch_for_shader

from ...core.host.creases import FoundCreases, creases_of
from .. import data
from ..data import views
from ..modes import find
from ..operators import base
from ..operators.properties import settings_of
from .overlay import Overlay, is_seen

_COLORS = {
    "closes": (1.0, 0.45, 0.05, 1.0),
    "fillet": (0.2, 0.65, 1.0, 1.0),
    "thin": (0.95, 0.15, 0.3, 1.0),
    "unsure": (0.65, 0.65, 0.65, 1.0),
    "sharp": (1.0, 1.0, 1.0, 1.0),
}
_WORDS = {
    "closes": "will close",
    "fillet": "stay as fillets",
    "thin": "too thin",
    "unsure": "not sure",
    "sharp": "sharp already",
}
_WIDTH = 3.0
"""Of the lines, in pixels."""


class CreasesOfMesh:
    """The creases of a mesh, which are found again when the panel's settings change."""

    kind = "creases"

    def __init__(
        self,
        obj: bpy.types.Object,
        surface: Any,
        parameters: bpy.types.PropertyGroup,
        found: FoundCreases,
    ) -> None:
        self.report = ""
        self._name, self._surface, self._weld = obj.name, surface, parameters.weld
        self._polygons = len(obj.data.polygons)
        self._settings = settings_of(find("geometry"), parameters)
        self._found = found

    def fits(self, mesh: bpy.types.Mesh) -> bool:
        """Whether a mesh has not changed."""
        if len(mesh.polygons) != self._polygons:
            return False
        return np.array_equal(data.mesh.meshes.read_positions(mesh), self._surface.positions)

    def now(self) -> tuple[FoundCreases, bool]:
        """Return them for the current settings of the panel, and whether they have changed."""
        parameters = bpy.context.scene.shock_filter.geometry
        settings = settings_of(find("geometry"), parameters)
        if settings == self._settings:
            return self._found, False
        self._settings = settings
        self._found = creases_of(self._surface, settings, self._weld)
        if self.report and base.summaries.get("geometry") == self.report:
            self.say(said_of(self._name, self._found.lines))
        return self._found, True

    def say(self, report: str) -> None:
        """Let the panel show a report, which is updated with the drawing."""
        self.report = base.summaries["geometry"] = report

    def segments(self) -> dict[str, npt.NDArray[np.float32]]:
        """Return both ends of each edge of the lines (k, 3), by their states."""
        found, _ = self.now()
        positions = self._surface.positions
        return {
            state: positions[np.concatenate(edges).reshape(-1)]
            for state in _COLORS
            if (edges := [line.edges for line in found.lines if line.state == state])
        }


def said_of(name: str, lines: list[Any]) -> str:
    """Return the report on the creases drawn over an object."""
    text = pgettext_rpt("Creases of {name}: {counts}.")
    return text.format(name=name, counts=counts_of(lines))


def counts_of(lines: list[Any]) -> str:
    """Describe the number of lines in each state."""
    counts = Counter(line.state for line in lines)
    said = [f"{counts[state]:,} {iface_(_WORDS[state])}" for state in _COLORS if counts[state]]
    return ", ".join(said) or iface_("none")


def draw_surface(overlay: Overlay) -> None:
    """Draw the lines, where the view shows the object."""
    context, obj = bpy.context, overlay.object()
    if not is_seen(obj, context.space_data):
        return
    _, is_news = overlay.found.now()
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    if overlay.surface is None or is_news:
        overlay.surface = {
            state: batch_for_shader(shader, "LINES", {"pos": ends})
            for state, ends in overlay.found.segments().items()
        }
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_test_set("LESS_EQUAL")
    with gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
        gpu.matrix.multiply_matrix(obj.matrix_world)
        projection = gpu.matrix.get_projection_matrix()
        gpu.matrix.load_projection_matrix(views.lifted(projection, context.region_data))
        region, scale = context.region, context.preferences.system.ui_scale
        shader.uniform_float("viewportSize", (region.width, region.height))
        shader.uniform_float("lineWidth", _WIDTH * scale)
        for state, batch in overlay.surface.items():
            shader.uniform_float("color", _COLORS[state])
            batch.draw(shader)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")


def draw_legend(overlay: Overlay) -> None:
    """Draw the legend of the colors, at the lower right."""
    context = bpy.context
    if not is_seen(overlay.object(), context.space_data):
        return
    scale, font = context.preferences.system.ui_scale, 0
    blf.size(font, 12 * scale)
    sides = [region.width for region in context.area.regions if region.type == "UI"]
    found, _ = overlay.found.now()
    counts = Counter(line.state for line in found.lines)
    y = 24 * scale
    for state in reversed(_COLORS):
        if not counts[state]:
            continue
        text = f"{counts[state]:,} {iface_(_WORDS[state])}"
        blf.color(font, *_COLORS[state])
        x = context.region.width - sum(sides) - 24 * scale - blf.dimensions(font, text)[0]
        blf.position(font, x, y, 0.0)
        blf.draw(font, text)
        y += 18 * scale
