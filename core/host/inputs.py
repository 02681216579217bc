# SPDX-License-Identifier: GPL-3.0-or-later
"""The data of a host program such as Blender as arrays: surfaces, their colors, images.

Needs numpy only, so that a host can read its data before the compiled kernels are loaded.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Pixels = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Surface:
    """A mesh object's geometry.

    Attributes
    ----------
    positions : (n, 3) float32
        Vertices in the object's space.
    triangles : (m, 3) int32
    mask : (n,) float64 or None
        1 sharpens fully, 0 leaves the vertex as it is.
    to_world : (3, 3) float64
        Lengths are measured after it: the object's scale, shear and rotation, or a multiple of
        the identity; see `mesh.evenness`.
    """

    positions: npt.NDArray[np.float32]
    triangles: npt.NDArray[np.int32]
    mask: Floats | None
    to_world: Floats

    @property
    def size(self) -> int:
        """The amount of work, for comparison with other data."""
        return len(self.positions)

    def into_world(self, vectors: npt.NDArray) -> npt.NDArray:
        """Transform vectors of the object's space, as rows, to the world."""
        return vectors if self._as_in_world() else vectors @ self.to_world.T

    def from_world(self, vectors: npt.NDArray) -> npt.NDArray:
        """Transform vectors of the world, as rows, to the object's space."""
        return vectors if self._as_in_world() else np.linalg.solve(self.to_world, vectors.T).T

    def _as_in_world(self) -> bool:
        return np.array_equal(self.to_world, np.identity(3))


@dataclass(frozen=True)
class MirrorPlane:
    """A plane at which a modifier joins a surface with its mirror image.

    Attributes
    ----------
    normal : (3,) float64
        Points in the plane have ``points @ normal + offset == 0``.
    offset : float
    reach : float
        Points up to this distance from the plane belong to it.
    """

    normal: Floats
    offset: float
    reach: float

    def hold(self, moves: Floats, points: Floats) -> Floats:
        """Let the points that belong to the plane move along it only: (n, 3)."""
        inside = np.abs(points @ self.normal + self.offset) <= self.reach
        along = self.normal / (self.normal @ self.normal)
        held = moves[inside] - np.outer(moves[inside] @ self.normal, along)
        result = moves.copy()
        result[inside] = held
        return result


@dataclass(frozen=True)
class MirroredSurface(Surface):
    """The geometry of a mesh object, with its mirror symmetry.

    Attributes
    ----------
    mirror : (bool, bool, bool)
        Axes along which a symmetric surface stays symmetric.
    planes : tuple of MirrorPlane
        Where modifiers join the surface with its mirror image.
    sharp_angle : float or None
        Angle in degrees above which edges of creases are returned too; None returns none.
    edges : (k, 2) int or None
        Vertices of the edges of the faces, where these are no triangles.
    """

    mirror: tuple[bool, bool, bool]
    planes: tuple[MirrorPlane, ...]
    sharp_angle: float | None = None
    edges: npt.NDArray[np.int32] | None = None


@dataclass(frozen=True)
class CutSurface(Surface):
    """A mesh object's geometry, and edges across which its data differ.

    Attributes
    ----------
    cuts : (k, 2) int
        Vertices of the edges: seams of UVs, borders of materials.
    """

    cuts: npt.NDArray[np.integer]


@dataclass(frozen=True)
class ColoredSurface(Surface):
    """A mesh object's geometry and colors.

    Attributes
    ----------
    colors : (k, 3) float32
        Colors of the vertices, or of the face corners if `corners` is given.
    corners : (m, 3) int32 or None
        The face corner of each corner of the triangles.
    free : (k,) bool or None
        Face corners that may change; False overrides the mask.
    levels : int
        Byte colors have 255 steps; 0 for float colors.
    """

    colors: npt.NDArray[np.float32]
    corners: npt.NDArray[np.int32] | None
    free: npt.NDArray[np.bool_] | None
    levels: int


@dataclass(frozen=True)
class PaintedSurface:
    """The shape and the colors of a mesh object; the mask of the shape holds for both."""

    shape: MirroredSurface
    paint: ColoredSurface

    @property
    def size(self) -> int:
        """The amount of work, for comparison with other data."""
        return self.shape.size


@dataclass(frozen=True)
class HostImage:
    """An image's pixels.

    Attributes
    ----------
    pixels : (h, w, 4) float32
        From the bottom up.
    opacity : str
        Meaning of the fourth channel, as Blender names it: "STRAIGHT" or "PREMUL" for opacity,
        "CHANNEL_PACKED" for another channel like the others, "NONE" for none.
    premultiplied : bool
        Whether colors are multiplied by opacity, if there is one.
    levels : int
        Bytes have 255 steps; 0 for floats.
    known : Measured or None
        Measurements of the image of which this is a part.
    """

    pixels: Pixels
    opacity: str
    premultiplied: bool
    levels: int
    known: Any = None

    @property
    def size(self) -> int:
        """The amount of work, for comparison with other data."""
        return self.pixels.shape[0] * self.pixels.shape[1]


@dataclass(frozen=True)
class TexturedFaces:
    """The faces that show an image.

    Attributes
    ----------
    positions : (n, 3) float64
        Vertices in the world.
    triangles : (m, 3) int
    uv : (m, 3, 2) float64
        Texture coordinates of the triangles' corners.
    weights : (m, 3) float64 or None
        1 sharpens fully, 0 leaves the texture as it is at that corner.
    grays : (m, 3) float64 or None
        A gain map at the corners; see `painted_gain.gains_of`.
    normals : (m, 3, 3) float64 or None
        Shading normals at the corners, in the world; None for smooth normals.
    """

    positions: Floats
    triangles: npt.NDArray[np.int64]
    uv: Floats
    weights: Floats | None
    grays: Floats | None = None
    normals: Floats | None = None


@dataclass(frozen=True)
class TexturedSurface:
    """The faces that show an image, of all objects, and the image.

    Attributes
    ----------
    faces : TexturedFaces
    picture : HostImage
    mask : (h, w) float64 or None
        1 sharpens a texel fully, 0 leaves it unchanged; multiplied by the weights of the faces.
    guide : HostImage or None
        An image of any size whose flow moves the values, if the filter has one.
    content : str
        The content of the texture, in place of that in the settings; empty for the latter.
    grays : (h, w) float64 or None
        A gain map, if the filter takes one; multiplied by the gains of the faces.
    others : tuple of HostImage
        Pictures of the same surface and size, if the filter merges several images.
    is_tried : bool
        Whether this is a preview, so that results to reuse are kept with the faces.
    """

    faces: TexturedFaces
    picture: HostImage
    mask: Floats | None
    guide: HostImage | None = None
    content: str = ""
    grays: Floats | None = None
    others: tuple[HostImage, ...] = ()
    is_tried: bool = False

    @property
    def size(self) -> int:
        """The amount of work, for comparison with other data."""
        return self.picture.size


@dataclass(frozen=True)
class Denoising:
    """The settings of the kernel, and the time of the sharpening or None.

    Settings of a filter have the same attributes, so that readers need not distinguish them.
    """

    kernel: Any
    sharpen_time: float | None

    def changed(self, **values: Any) -> Denoising:
        """Return a copy with other values in the settings of the kernel."""
        return replace(self, kernel=self.kernel.changed(**values))
