# SPDX-License-Identifier: GPL-3.0-or-later
"""Make images from the shape of a surface, with the arrays of a host program such as Blender."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..base.findings import Finding
from ..base.progress import ProgressCallback, phase, reporting
from ..grid.resize import resized
from ..maps.baking import bake_maps
from ..mesh.directions import gradient_directions, named_directions
from ..mesh.edges import checked_edges, half_edges_between
from ..mesh.triangle_mesh import TriangleMesh
from ..registry import find
from ..settings import BakeSettings, describe
from ..texture.texels import grays_of
from .inputs import TexturedFaces
from .textures import analyse, atlas_of

_ANALYSIS = 0.3  # of the time that a run takes

_QUICK, _SLOW = 256, 192
"""Most texels along each axis of a preview; and of a preview of a slow filter."""


@dataclass(frozen=True)
class FieldSurface:
    """The faces that will show an image.

    Attributes
    ----------
    faces : TexturedFaces
    shape : (int, int)
        Height and width of the image.
    given : mapping
        Keyword arguments for the function in the registry, without its settings. Directions may
        also be given by name (`along`), or by numbers at the corners with this gradient (`rising`);
        occluders are a list of `WorldMesh`.
    at_vertices : bool
        Whether values at the vertices are computed instead of an image.
    is_tried : bool
        Whether this is a preview, so that results to reuse are kept with the faces.
    """

    faces: TexturedFaces
    shape: tuple[int, int]
    given: Mapping[str, Any] = field(default_factory=dict)
    at_vertices: bool = False
    is_tried: bool = False

    @property
    def size(self) -> int:
        """The amount of work, for comparison with other data."""
        return self.shape[0] * self.shape[1]


@dataclass(frozen=True)
class Generated:
    """A new image or attribute, and remarks on the texture coordinates.

    Attributes
    ----------
    values : (h, w) or (n,) float32
        Values of texels, from the bottom up, or of vertices.
    shown : (h, w) or (n,) bool
        Which values are on the surface and finite.
    notes : tuple of Finding
    """

    values: npt.NDArray[np.float32]
    shown: npt.NDArray[np.bool_]
    notes: tuple[Finding, ...]

    @property
    def grays(self) -> npt.NDArray[np.float32]:
        """The visible values, including the gutter: in [0, 1], 0 where they are infinite."""
        values = np.where(np.isfinite(self.values), self.values, np.float32(0.0))
        largest = float(values.max(initial=0.0, where=self.shown))
        return np.clip(values / max(largest, 1.0), 0.0, 1.0)


def reduced(surface: FieldSurface, is_slow: bool) -> FieldSurface:
    """Return a surface with an image small enough for previews.

    Parameters
    ----------
    surface : FieldSurface
    is_slow : bool
        Whether the filter is slow, as its row in the registry says.
    """
    height, width = surface.shape
    most = _SLOW if is_slow else _QUICK
    smaller = min(1.0, most / max(height, width))
    shape = max(round(smaller * height), 1), max(round(smaller * width), 1)
    given = dict(surface.given)
    for name in {"image", "rates"} & given.keys():
        pixels = np.asarray(given[name], dtype=np.float32)[..., None]
        given[name] = resized(pixels, shape)[..., 0].astype(np.float64)
    return replace(surface, shape=shape, given=given, at_vertices=False, is_tried=True)


def reduced_settings(settings: Any, large: tuple[int, int], small: tuple[int, int]) -> Any:
    """Return settings for an image of another size that give the same look.

    Lengths in texels are scaled to the same size on the surface, unless the smaller image cannot
    show it. Settings are limited to `tried_at_most`.
    """
    smaller = max(small) / max(large)
    changes = {}
    for name, (_, _, about) in describe(type(settings)).items():
        value = getattr(settings, name)
        if about.counts_in == "texels":
            value = max(smaller**about.length_power * value, about.minimum)
        if about.tried_at_most < math.inf:
            value = min(value, about.tried_at_most)
        changes[name] = value
    return settings.changed(**changes)


def generate(
    surface: FieldSurface, name: str, settings: Any, progress: ProgressCallback | None = None
) -> Generated:
    """Generate an image.

    Parameters
    ----------
    surface : FieldSurface
    name, settings
        As in `images.filter_image`.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Raises
    ------
    ShockError
        See `TriangleMesh`, `TextureAtlas` and the function.
    """
    with reporting(progress):
        with phase(0.0, _ANALYSIS, "Preparing the mesh"):
            atlas = atlas_of(surface.faces, surface.shape, surface.is_tried)
        with phase(_ANALYSIS, 1.0, "Generating"):
            uv, given = surface.faces.uv, dict(surface.given)
            if "along" in given:
                given["directions"], given["at"] = named_directions(atlas.mesh, given.pop("along"))
            if "rising" in given:
                given["directions"] = gradient_directions(atlas.mesh, given.pop("rising"))
            if "edges" in given:
                given["edges"] = _of_faces(atlas.mesh, given["edges"])
            if "occluders" in given:
                given["occluders"] = [each.mesh for each in given["occluders"]]
            if "directions" in given:
                given.setdefault("at", "faces")
            made: Any
            if surface.at_vertices:
                made = _at_vertices(surface, atlas, name, settings, given)
            else:
                function = find(name).function()
                made = function(atlas.mesh, uv, settings, size=surface.shape, atlas=atlas, **given)
    values = made if surface.at_vertices else grays_of(made, atlas.inside)
    shown = np.isfinite(values) if surface.at_vertices else np.isfinite(values) & atlas.inside
    values = values.astype(np.float32, copy=False)
    return Generated(values, shown, tuple(atlas.report.findings(made=True)))


def _of_faces(mesh: TriangleMesh, edges: npt.ArrayLike) -> npt.NDArray[np.int64]:
    # The edges that faces have: others are loose, or belong to faces of another material.
    pairs = checked_edges(mesh, edges)
    return pairs[half_edges_between(mesh, pairs)[1]]


def _at_vertices(
    surface: FieldSurface, atlas: TextureAtlas, name: str, settings: Any, given: dict[str, Any]
) -> npt.NDArray[np.float64]:
    # Vertices on painted texels are sources, and so are the edges of seams.
    mesh, given = atlas.mesh, dict(given)
    if "image" in given:
        texels = np.floor(surface.faces.uv * surface.shape[::-1]).astype(np.int64)
        x, y = np.moveaxis(texels, -1, 0)
        grays = given.pop("image")[y % surface.shape[0], x % surface.shape[1]]
        given["vertices"] = mesh.faces[mesh.own_corners(grays >= 0.5)]
    if find(name).takes_starts and settings.source == "seams":
        f, k = np.divmod(atlas.charts.borders, 3)
        given["edges"] = np.stack([mesh.faces[f, k], mesh.faces[f, (k + 1) % 3]], axis=1)
        settings = replace(settings, source="given")
    return find(name).function(vertices=True)(mesh, settings, **given)


@dataclass(frozen=True)
class WorldMesh:
    """A mesh in the world.

    Attributes
    ----------
    positions : (n, 3) float64
    triangles : (m, 3) int
    colors : (n, c) float64 or None
        Colors of the vertices.
    """

    positions: npt.NDArray[np.float64]
    triangles: npt.NDArray[np.int64]
    colors: npt.NDArray[np.float64] | None = None

    @property
    def mesh(self) -> TriangleMesh:
        """The mesh for the core."""
        return TriangleMesh(self.positions, self.triangles)


@dataclass(frozen=True)
class BakeSurface:
    """The faces that will show maps, and the meshes that the maps are baked from.

    Attributes
    ----------
    faces : TexturedFaces
    shape : (int, int)
        Height and width of the images.
    maps : tuple of str
    high : WorldMesh or None
        The detailed mesh.
    occluders : sequence of WorldMesh
    """

    faces: TexturedFaces
    shape: tuple[int, int]
    maps: tuple[str, ...]
    high: WorldMesh | None = None
    occluders: Sequence[WorldMesh] = ()

    @property
    def size(self) -> int:
        """The amount of work, for comparison with other data."""
        return self.shape[0] * self.shape[1]


@dataclass(frozen=True)
class Baked:
    """Images (h, w, c) by the names of maps, from the bottom up, and remarks on the UV map."""

    images: dict[str, npt.NDArray[np.float32]]
    notes: tuple[Finding, ...]


def bake(
    surface: BakeSurface, settings: BakeSettings, progress: ProgressCallback | None = None
) -> Baked:
    """Bake maps; see `bake_maps`.

    Parameters
    ----------
    surface : BakeSurface
    settings : BakeSettings
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.
    """
    faces, high = surface.faces, surface.high
    with reporting(progress):
        with phase(0.0, 0.15, "Preparing the mesh"):
            atlas = analyse(faces, surface.shape)
        with phase(0.15, 1.0, "Baking maps"):
            found = bake_maps(
                atlas.mesh,
                faces.uv,
                settings,
                size=surface.shape,
                maps=surface.maps,
                high=None if high is None else high.mesh,
                colors=None if high is None else high.colors,
                normals=faces.normals,
                occluders=[each.mesh for each in surface.occluders],
                atlas=atlas,
            )
    images = {name: each if each.ndim == 3 else each[..., None] for name, each in found.items()}
    return Baked(images, tuple(atlas.report.findings(made=True)))
