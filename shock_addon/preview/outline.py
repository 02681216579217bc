# SPDX-License-Identifier: GPL-3.0-or-later
"""A thin line in the 3D views around the patch that a preview computes."""

from __future__ import annotations

from typing import Any

import bpy
import gpu
import numpy as np
import numpy.typing as npt
from gpu_extras.batch import batch_for_shader

_COLOR = (1.0, 1.0, 1.0, 0.6)


class Outline:
    """Draws edges until `end`, also where other surfaces hide them.

    Parameters
    ----------
    obj : bpy.types.Object
    edges : (n, 2, 3) array of float
        In the object's space.
    """

    def __init__(self, obj: bpy.types.Object, edges: npt.NDArray[np.float32]) -> None:
        self._uid, self._ends, self._batch = obj.session_uid, edges.reshape(-1, 3), None
        self._drawing: Any = None
        if len(edges):
            self._drawing = bpy.types.SpaceView3D.draw_handler_add(
                self._draw, (), "WINDOW", "POST_VIEW"
            )

    def end(self) -> None:
        """Stop drawing."""
        if self._drawing is not None:
            bpy.types.SpaceView3D.draw_handler_remove(self._drawing, "WINDOW")
            self._drawing = None

    def _draw(self) -> None:
        obj = next((obj for obj in bpy.data.objects if obj.session_uid == self._uid), None)
        if obj is None or not obj.visible_get(viewport=bpy.context.space_data):
            return
        shader = gpu.shader.from_builtin("UNIFORM_COLOR")
        if self._batch is None:
            self._batch = batch_for_shader(shader, "LINES", {"pos": self._ends})
        shader.uniform_float("color", _COLOR)
        gpu.state.blend_set("ALPHA")
        with gpu.matrix.push_pop():
            gpu.matrix.multiply_matrix(obj.matrix_world)
            self._batch.draw(shader)
        gpu.state.blend_set("NONE")
