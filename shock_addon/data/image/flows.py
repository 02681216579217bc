# SPDX-License-Identifier: GPL-3.0-or-later
"""Read the flows to show: of shapes, colors, attributes and flow maps."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

from ....core.advection.flow_maps import flow_map_velocity
from ....core.host.advection import FlowPlane, FlowSurface
from .. import arrays
from ..chosen import mesh_users, refusal, uids_of
from ..mesh import meshes
from ..mesh.colors import find_colors
from ..skipped import skip_if
from . import fields, textures

_BYTE = 255.0


@dataclass(frozen=True)
class Film:
    """A flow, and the frames to draw of it.

    Attributes
    ----------
    flow : FlowSurface or FlowPlane
    frames : int
        Number of frames.
    in_colors : bool
        Whether colors show the speed.
    parent : path
        Frames are written to a hidden folder in this one.
    """

    flow: FlowSurface | FlowPlane
    frames: int
    in_colors: bool
    parent: Path

    @property
    def size(self) -> int:
        """The amount of work, relative to other targets."""
        return self.flow.size


@dataclass(frozen=True)
class FlowTarget:
    """A flow to show.

    Attributes
    ----------
    name : str
        Of the active object or the flow map.
    surface : FlowSurface, FlowPlane or Film
        The flow; later the input of the filter.
    objects : dict of int to str
        Names by uids of the objects whose faces were read, the active one first.
    image_uid : int
        Of the flow map; 0 for other flows.
    """

    name: str
    surface: FlowSurface | FlowPlane | Film
    objects: dict[int, str] = field(default_factory=dict)
    image_uid: int = 0


def read_map(image: bpy.types.Image, y_axis: str) -> FlowTarget:
    """Read a flow map.

    Raises
    ------
    Skipped
        If the image cannot be read.
    """
    skip_if(refusal(image))
    pixels = arrays.read_pixels(image)[::-1]
    if not image.is_float:
        pixels = np.rint(_BYTE * pixels).astype(np.uint8)
    velocity = flow_map_velocity(pixels, y_axis=y_axis)
    return FlowTarget(image.name, FlowPlane(velocity), image_uid=image.session_uid)


def read_surface(
    context: bpy.types.Context, of: str, parameters: Any, settings: Any, colors: str
) -> tuple[FlowTarget, list[str]]:
    """Read the faces of the chosen objects, and the data that define their flow.

    Parameters
    ----------
    context : bpy.types.Context
    of : str
        "shape", "colors" or "attribute".
    parameters : object
        Has `image_size` and `field`.
    settings : object
        Of the shock filter, for shapes and colors.
    colors : str
        Name of the color attribute; empty for each object's active one.

    Raises
    ------
    Skipped
        If no object could be read, or one lacks the named attribute.
    """
    size = int(parameters.image_size)
    faces, names, skipped = textures.read_faces(context, mesh_users(context), None, None)
    objects = [bpy.data.objects[name] for name in names]
    given = settings
    with meshes.object_mode(context):
        if of == "colors":
            given = np.concatenate([_corner_colors(obj, colors) for obj in objects]), settings
        elif of == "attribute":
            ((of, given),) = fields.read_directions(objects, parameters.field).items()
    surface = FlowSurface(faces, (size, size), of, given)
    return FlowTarget(names[0], surface, uids_of(objects)), skipped


def _corner_colors(obj: bpy.types.Object, name: str) -> npt.NDArray[np.float64]:
    """Read colors at the corners of triangles."""
    mesh = obj.data
    attribute = find_colors(mesh, name)
    values = arrays.read_attribute(attribute)[:, :3].astype(np.float64)
    corners = meshes.read_triangle_corners(mesh)
    if attribute.domain == "POINT":
        corners = meshes.read_corner_vertices(mesh)[corners]
    return values[corners.reshape(-1)].reshape(len(corners), 3, -1)
