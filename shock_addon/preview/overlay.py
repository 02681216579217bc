# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawing of pixels over an image in Image Editors; the image is not changed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import gpu
import numpy as np
import numpy.typing as npt
from gpu_extras.batch import batch_for_shader

from ...core.base.srgb import decoded
from .pointing import editors_of, is_shown_in

_FRAME = (1.0, 1.0, 1.0, 0.5)

_CHANNELS = {"RED": 0, "GREEN": 1, "BLUE": 2, "ALPHA": 3}
"""Display channels of the Image Editor that show one of the four as gray."""

_UNIFORMS = {"to_clip": "MAT4", "even": "VEC3", "odd": "VEC3", "channel": "INT", "cell_size": "INT"}

_VERTICES = """
void main()
{
  place = corner;
  gl_Position = to_clip * vec4(position, 0.0, 1.0);
}
"""

_PIXELS = """
void main()
{
  ivec2 size = textureSize(pixels, 0);
  vec4 pixel = texelFetch(pixels, min(ivec2(place * vec2(size)), size - 1), 0);
  if (channel >= 0) {
    result = vec4(vec3(pixel[channel]), 1.0);
    return;
  }
  vec3 behind = vec3(0.0);
  if (cell_size > 0) {
    ivec2 cell = ivec2(gl_FragCoord.xy) / cell_size;
    behind = (cell.x + cell.y) % 2 == 0 ? even : odd;
  }
  result = vec4(pixel.rgb + (1.0 - pixel.a) * behind, 1.0);
}
"""


@dataclass(frozen=True)
class Piece:
    """Pixels to draw.

    Attributes
    ----------
    box : tuple of float
        Left, bottom, right and top, as fractions of the image; UDIM tiles lie side by side.
    colors : (h, w, 4) float32
        Linear, and multiplied by opacity if they are transparent.
    framed : bool
        Whether a line is drawn around them.
    transparent : bool
    """

    box: tuple[float, float, float, float]
    colors: npt.NDArray[np.float32]
    framed: bool
    transparent: bool


class Overlay:
    """Draws pieces, from `show` until `end`."""

    def __init__(self, image: bpy.types.Image) -> None:
        self._uid = image.session_uid
        self._pieces: list[Piece] = []
        self._textures: list[Any] = []
        self._shader: Any = None
        self._drawing = bpy.types.SpaceImageEditor.draw_handler_add(
            self._draw, (), "WINDOW", "POST_VIEW"
        )

    def show(self, pieces: list[Piece]) -> None:
        """Draw these pieces."""
        self._pieces, self._textures = pieces, []
        self._redraw()

    def end(self) -> None:
        """Stop drawing."""
        bpy.types.SpaceImageEditor.draw_handler_remove(self._drawing, "WINDOW")
        self._redraw()

    def _redraw(self) -> None:
        for area in editors_of(self._uid):
            area.tag_redraw()

    def _draw(self) -> None:
        space = bpy.context.space_data
        if not is_shown_in(self._uid, space):
            return
        if self._shader is None:
            self._shader = _shader()
        if not self._textures:
            self._textures = [_texture(piece.colors) for piece in self._pieces]
        for piece, texture in zip(self._pieces, self._textures, strict=True):
            self._draw_piece(piece, texture, space.display_channels)

    def _draw_piece(self, piece: Piece, texture: Any, channels: str) -> None:
        left, bottom, right, top = piece.box
        corners = [(left, bottom), (right, bottom), (right, top), (left, top)]
        places = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
        theme = bpy.context.preferences.themes[0].user_interface
        checkered = piece.transparent and channels == "COLOR_ALPHA"
        shape = {"position": corners, "corner": places}
        batch = batch_for_shader(self._shader, "TRI_FAN", shape)
        to_clip = gpu.matrix.get_projection_matrix() @ gpu.matrix.get_model_view_matrix()
        self._shader.bind()
        self._shader.uniform_sampler("pixels", texture)
        self._shader.uniform_float("to_clip", to_clip)
        self._shader.uniform_int("channel", [_CHANNELS.get(channels, -1)])
        cell = theme.transparent_checker_size if checkered else 0
        self._shader.uniform_int("cell_size", [cell])
        self._shader.uniform_float("even", _linear(theme.transparent_checker_primary))
        self._shader.uniform_float("odd", _linear(theme.transparent_checker_secondary))
        batch.draw(self._shader)
        if piece.framed:
            line = gpu.shader.from_builtin("UNIFORM_COLOR")
            gpu.state.blend_set("ALPHA")
            line.uniform_float("color", _FRAME)
            batch_for_shader(line, "LINE_STRIP", {"pos": [*corners, corners[0]]}).draw(line)
            gpu.state.blend_set("NONE")


def _linear(color: Any) -> tuple[float, ...]:
    return tuple(decoded(np.array(color[:3], dtype=np.float32)).tolist())


def _texture(colors: npt.NDArray[np.float32]) -> Any:
    height, width = colors.shape[:2]
    buffer = gpu.types.Buffer("FLOAT", colors.size, np.ascontiguousarray(colors).reshape(-1))
    return gpu.types.GPUTexture((width, height), format="RGBA32F", data=buffer)


def _shader() -> Any:
    between = gpu.types.GPUStageInterfaceInfo("shock_filter_pixels")
    between.smooth("VEC2", "place")
    info = gpu.types.GPUShaderCreateInfo()
    info.vertex_in(0, "VEC2", "position")
    info.vertex_in(1, "VEC2", "corner")
    info.vertex_out(between)
    info.fragment_out(0, "VEC4", "result")
    info.sampler(0, "FLOAT_2D", "pixels")
    for name, kind in _UNIFORMS.items():
        info.push_constant(kind, name)
    info.vertex_source(_VERTICES)
    info.fragment_source(_PIXELS)
    return gpu.shader.create_from_info(info)
