# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawing of an image on a surface in the 3D views; objects and materials are not changed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import gpu
import numpy as np
import numpy.typing as npt
from gpu_extras.batch import batch_for_shader

from ...core.host.inputs import TexturedFaces
from ..data import views

_VERTICES = """
void main()
{
  place = corner;
  shade = 0.4 + 0.6 * abs(dot(normal, towards));
  gl_Position = to_clip * vec4(position, 1.0);
}
"""

_PIXELS = """
void main()
{
  ivec2 size = textureSize(pixels, 0);
  vec2 at = fract(place) * vec2(size) - 0.5;
  ivec2 first = (ivec2(floor(at)) + size) % size;
  ivec2 next = (first + 1) % size;
  vec2 share = fract(at);
  vec3 below = mix(texelFetch(pixels, first, 0).rgb,
                   texelFetch(pixels, ivec2(next.x, first.y), 0).rgb, share.x);
  vec3 above = mix(texelFetch(pixels, ivec2(first.x, next.y), 0).rgb,
                   texelFetch(pixels, next, 0).rgb, share.x);
  vec3 color = max(mix(below, above, share.y), 0.0);
  // Colors are linear here, and are to look as they do in the Image Editor.
  result = vec4(shade * pow(color, vec3(gamma)), 1.0);
}
"""


_GAMMA = 2.2


class Coat:
    """Draws pixels on faces, from `show` until `end`.

    Parameters
    ----------
    faces : TexturedFaces
    encoded : bool
        Whether pixels are stored with a gamma, as bytes are; else they are linear.
    draws_into : callable, optional
        ``draws_into(space)`` says which 3D views it is drawn into; default: all.
    """

    def __init__(
        self,
        faces: TexturedFaces,
        encoded: bool = True,
        draws_into: Callable[[bpy.types.SpaceView3D], bool] = lambda space: True,
    ) -> None:
        self._faces = faces
        self._gamma, self._draws_into = _GAMMA if encoded else 1.0, draws_into
        self._values: npt.NDArray[np.float32] | None = None
        self._batch: Any = None
        self._shader: Any = None
        self._texture: Any = None
        self._drawing: Any = bpy.types.SpaceView3D.draw_handler_add(
            self._draw, (), "WINDOW", "POST_VIEW"
        )

    def show(self, values: npt.NDArray[np.float32] | None) -> None:
        """Draw (h, w) grays or (h, w, channels), row 0 at v = 0; None draws nothing."""
        self._values, self._texture = values, None
        views.redraw()

    def end(self) -> None:
        """Stop drawing."""
        if self._drawing is not None:
            bpy.types.SpaceView3D.draw_handler_remove(self._drawing, "WINDOW")
            self._drawing = None
            views.redraw()

    def _draw(self) -> None:
        if self._values is None or not self._draws_into(bpy.context.space_data):
            return
        if self._shader is None:
            self._shader = _shader()
            self._batch = batch_for_shader(self._shader, "TRIS", _corners(self._faces))
        if self._texture is None:
            self._texture = _texture(self._values)
        view = bpy.context.region_data
        nearer = views.lifted(gpu.matrix.get_projection_matrix(), view)
        self._shader.bind()
        self._shader.uniform_sampler("pixels", self._texture)
        self._shader.uniform_float("gamma", self._gamma)
        self._shader.uniform_float("to_clip", nearer @ gpu.matrix.get_model_view_matrix())
        self._shader.uniform_float("towards", view.view_matrix.inverted().col[2].xyz)
        gpu.state.depth_test_set("LESS_EQUAL")
        gpu.state.depth_mask_set(True)
        self._batch.draw(self._shader)
        gpu.state.depth_mask_set(False)
        gpu.state.depth_test_set("NONE")


def _corners(faces: TexturedFaces) -> dict[str, npt.NDArray[np.float32]]:
    corners = faces.positions[faces.triangles]
    if faces.normals is None:
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(across, axis=1, keepdims=True)
        normals = np.repeat((across / np.where(length > 0, length, 1.0))[:, None], 3, axis=1)
    else:
        normals = faces.normals
    found = {"position": corners, "normal": normals, "corner": faces.uv}
    return {
        name: np.ascontiguousarray(values.reshape(-1, values.shape[-1]), dtype=np.float32)
        for name, values in found.items()
    }


def _texture(values: npt.NDArray[np.float32]) -> Any:
    height, width = values.shape[:2]
    channels = values.reshape(height, width, -1)
    flat = np.ones((height, width, 4), dtype=np.float32)
    flat[..., :3] = channels[..., :3] if channels.shape[2] > 2 else channels[..., :1]
    buffer = gpu.types.Buffer("FLOAT", flat.size, flat.reshape(-1))
    return gpu.types.GPUTexture((width, height), format="RGBA32F", data=buffer)


def _shader() -> Any:
    between = gpu.types.GPUStageInterfaceInfo("shock_filter_coat")
    between.smooth("VEC2", "place")
    between.smooth("FLOAT", "shade")
    info = gpu.types.GPUShaderCreateInfo()
    info.vertex_in(0, "VEC3", "position")
    info.vertex_in(1, "VEC3", "normal")
    info.vertex_in(2, "VEC2", "corner")
    info.vertex_out(between)
    info.fragment_out(0, "VEC4", "result")
    info.sampler(0, "FLOAT_2D", "pixels")
    info.push_constant("MAT4", "to_clip")
    info.push_constant("VEC3", "towards")
    info.push_constant("FLOAT", "gamma")
    info.vertex_source(_VERTICES)
    info.fragment_source(_PIXELS)
    return gpu.shader.create_from_info(info)
