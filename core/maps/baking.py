# SPDX-License-Identifier: GPL-3.0-or-later
"""Several maps in one run, of a mesh itself or of a detailed mesh onto a simple one."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.normal_frames import NormalFrames
from ..base.checks import Floats, as_array, by_keyword, checked_size
from ..base.findings import Length, tell
from ..base.progress import ProgressCallback, ask, phase, reporting
from ..errors import InvalidSettings, InvalidSignal
from ..mesh.curvature import curvatures_of
from ..mesh.jets import Frames, radii_of
from ..mesh.triangle_mesh import TriangleMesh, check_mesh
from ..settings import BakeSettings, DilateSettings, given_or_default
from ..texture.normal_maps import checked_normals
from ..texture.texels import Texture, written
from .drawing import atlas_for, drawn_smoothly, with_gutter
from .projecting import Onto, project
from .ray_noise import without_noise
from .traced import on_sheet
from .tracing import (
    Scene,
    Sites,
    checked_occluders,
    look_around,
    look_inside,
    scene_of,
    texel_sites,
)
from .unmet import Unmet

_Single = npt.NDArray[np.float32]

SIGNED = "curvature", "displacement"
"""Maps whose 0 is middle gray."""

_OF_ONE = "curvature", "occlusion", "bent_normals", "thickness"

_TRACED = _OF_ONE[1:]
"""Maps that are traced by rays."""

MAPS = (*_OF_ONE, "normals", "displacement", "colors")
"""All maps; the last three need a detailed mesh."""

_SHOWN = 0.98
"""Share of the texels whose curvature is within the range of grays."""

_WHITE = {
    "displacement": "In the map of heights, white is {white} above, black as much below.",
    "curvature": "In the map of curvature, white bends with a radius of {radius}, black as much"
    " inward.",
    "thickness": "In the map of thickness, white is {white}.",
}
"""Reports of the meaning of white."""

_BAKING = "Baking maps"


@by_keyword
def bake_maps(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    settings: BakeSettings | None = None,
    *,
    size: tuple[int, int],
    maps: Sequence[str] = _OF_ONE,
    high: TriangleMesh | None = None,
    colors: npt.ArrayLike | None = None,
    normals: npt.ArrayLike | None = None,
    occluders: Sequence[TriangleMesh] = (),
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
) -> dict[str, _Single]:
    """Bake several maps of a mesh in one run, or of a detailed mesh onto a simple one.

    Parameters
    ----------
    mesh, uv, progress, atlas
        As in `sharpen_texture`.
    settings : BakeSettings, optional
    size : (int, int)
        Rows and columns of the images.
    maps : sequence of str
        Names of maps: "curvature" (the mean one), "occlusion", "bent_normals", "thickness"; with
        `high` also "normals", "displacement" and "colors".
    high : TriangleMesh, optional
        A detailed mesh in the same space, such as a sculpted one, whose maps are baked.
    colors : (k, c) array of float, optional
        Colors of the detailed mesh's vertices, for the map of colors.
    normals : (m, 3, 3) array of float, optional
        The shading normals of `mesh` at the corners of its faces, for the map of normals. Default:
        smooth normals.
    occluders : sequence of TriangleMesh
        Other meshes that block rays of occlusion.

    Returns
    -------
    dict of str to float32 arrays
        By the names in `maps`. "curvature" (h, w) in 1 / unit of the mesh, convex positive;
        "thickness" and "displacement" (h, w) in units of the mesh, or all three as grays, see
        `BakeSettings.look`. "occlusion" (h, w) from 0 to 1. "bent_normals" (h, w, 3) as colors,
        0.5 plus half the component, in the mesh's axes. "normals" (h, w, 3) as colors in tangent
        space, green up. "colors" (h, w, c). Gutters are filled; the rest is 0.

    Raises
    ------
    InvalidSettings
        If there is no such map, or its input is missing.
    InvalidUV, InvalidSignal, SolverError, Cancelled
        As in `ambient_occlusion`.

    Notes
    -----
    From each texel, rays are cast up and down along the smooth normal of the simple mesh, as far as
    the cage; the nearer hit that faces the same way is used. Without a hit, normals and
    displacement are those of the simple mesh, and other maps are filled smoothly from texels
    around, which a finding reports. Tangents are those of MikkTSpace, as in Blender.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]
    >>> low = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> high = core.TriangleMesh(np.add(vertices, [0, 0, 0.1]), low.faces)
    >>> uv = low.vertices[low.faces][..., :2] / 2
    >>> baked = core.bake_maps(low, uv, size=(8, 8), maps=["normals", "displacement"], high=high)
    >>> baked["normals"][4, 4].round(3).tolist(), round(float(baked["displacement"][4, 4]), 3)
    ([0.5, 0.5, 1.0], 0.1)
    """
    settings = given_or_default(settings, BakeSettings)
    check_mesh(mesh)
    wanted = _checked_maps(maps, high, colors)
    shape = checked_size(size)
    given = checked_normals(mesh, normals)
    others = checked_occluders(occluders)
    if high is not None:
        check_mesh(high)
    source = mesh if high is None else high
    painted = None if colors is None else _checked_colors(source, colors)
    by_rays = 18 * bool(set(wanted) & set(_TRACED))
    bent, in_colors = 4 * ("curvature" in wanted), int("colors" in wanted)
    parts = iter(_parts([6, 3, by_rays, bent + in_colors, *([1] * len(wanted))]))
    with reporting(progress):
        with phase(*next(parts), "Finding texels"):
            found = atlas_for(atlas, mesh, uv, shape)
        with phase(*next(parts), _BAKING):
            scene = scene_of(source, others, settings.ground)
            sites = texel_sites(found)
            alone = scene if high is None or not others else scene_of(high)
            onto = None if high is None else project(found, sites, alone, high, settings.cage)
        baker = _Baker(found, source, sites if onto is None else onto.sites, scene, settings, onto)
        with phase(*next(parts), "Tracing rays"):
            sheets = baker.traced(wanted)
        with phase(*next(parts), _BAKING):
            sheets |= baker.read(wanted, painted)
        images = {}
        for name, part in zip(wanted, parts, strict=True):
            with phase(*part, "Filling the gutter"):
                images[name] = baker.image(name, sheets[name], given)
        return images


class _Baker:
    # Computes maps for the texels of an atlas from places on a mesh.

    def __init__(
        self,
        atlas: TextureAtlas,
        mesh: TriangleMesh,
        sites: Sites,
        scene: Scene,
        settings: BakeSettings,
        onto: Onto | None,
    ) -> None:
        self._atlas, self._mesh, self._sites, self._onto = atlas, mesh, sites, onto
        self._scene, self._settings = scene, settings
        met = np.full(len(sites.numbers), True) if onto is None else onto.faces >= 0
        self._is_met, self._met = met, Sites._make(each[met] for each in sites)
        self._unmet = Unmet(atlas, sites.numbers[~met])

    def traced(self, wanted: Sequence[str]) -> dict[str, _Single]:
        """Return a map that is traced by rays, on the sheet."""
        scene, sites, settings = self._scene, self._sites, self._settings
        halves: dict[str, _Single] = {}
        names = [name for name in _TRACED if name in wanted]
        is_open, is_thick = bool(set(names) - {"thickness"}), "thickness" in names
        around, inside, *parts = _parts([5 * is_open, 3 * is_thick, *([2] * len(names))])
        with phase(*around, "Tracing rays"):
            if is_open:
                seen, bent, _ = look_around(scene, sites, settings.rays, settings.distance)
                halves = {"occlusion": seen, "bent_normals": bent}
        with phase(*inside, "Tracing rays"):
            if is_thick:
                halves["thickness"] = look_inside(scene, sites, settings.rays)
        filling = 0.3 * self._unmet.is_needed
        sheets = {}
        for name, part in zip(names, parts, strict=True):
            with phase(*part, "Smoothing"):
                both = halves[name].astype(np.float32)
                with phase(0.0, 1.0 - filling, "Smoothing"):
                    found = without_noise(self._met, both[self._is_met], settings.smoothing)
                if name == "thickness":
                    found = found * np.float32(scene.unit)
                with phase(1.0 - filling, 1.0, "Filling"):
                    sheet = on_sheet(self._atlas, self._met, found)
                    sheets[name] = self._unmet.filled(sheet)
        if "bent_normals" in sheets:
            vectors = sheets["bent_normals"]
            lengths = np.linalg.norm(vectors, axis=2, keepdims=True)
            sheets["bent_normals"] = 0.5 + 0.5 * vectors / np.maximum(lengths, 1e-6)
        return sheets

    def read(self, wanted: Sequence[str], colors: Floats | None) -> dict[str, _Single]:
        """Return a map that is interpolated from the mesh, on the sheet."""
        sheets = {}
        if "curvature" in wanted:
            with phase(0.0, 0.5, "Finding curvature"):
                frames, radii = Frames(self._mesh), radii_of(self._mesh, 0.0)
                mean = curvatures_of(self._mesh, frames, radii).mean[:, None]
            with phase(0.5, 0.8, "Drawing"):
                if self._onto is None:
                    sheets["curvature"] = drawn_smoothly(self._atlas, frames, radii, mean)
                else:
                    sheets["curvature"] = self._at_places(mean)
        if "colors" in wanted and colors is not None:
            with phase(0.8, 1.0, "Drawing"):
                sheets["colors"] = self._at_places(colors)
        if self._onto is not None and "displacement" in wanted:
            sheets["displacement"] = self._laid(self._onto.heights[:, None])
        if self._onto is not None and "normals" in wanted:
            sheets["normals"] = self._laid(0.5 + 0.5 * self._sites.normals)
        ask()
        return sheets

    def image(self, name: str, sheet: _Single, normals: Floats | None) -> _Single:
        """Return a map as an image."""
        gutter = self._settings.gutter
        if name == "normals":
            frames = NormalFrames(self._atlas, normals)
            empty = np.zeros((self._atlas.height, self._atlas.width, 3), dtype=np.float32)
            texture = Texture(self._atlas, empty, frames=frames, unit=True, made=True)
            image: _Single = written(texture, sheet, DilateSettings(gutter=gutter), None)
            return image
        image = with_gutter(self._atlas, np.ascontiguousarray(sheet, np.float32), gutter)
        if name == "bent_normals":
            return np.clip(image, 0.0, 1.0)
        if name == "colors":
            return image
        gray = image[..., 0]
        if name == "occlusion":
            return np.clip(gray, 0.0, 1.0)
        return gray if self._settings.look == "values" else self._grays(name, gray)

    def _grays(self, name: str, values: _Single) -> _Single:
        inside = np.abs(values[self._atlas.inside])
        if name == "displacement":
            white = self._settings.cage or float(inside.max(initial=0.0))
        else:
            part = _SHOWN if name == "curvature" else 1.0
            white = float(np.quantile(inside, part)) if inside.size else 0.0
        if white > 0 and name == "curvature":
            tell(_WHITE[name], white=white, radius=Length(1.0 / white))
        elif white > 0:
            tell(_WHITE[name], white=Length(white))
        scaled = values / np.float32(max(white, 1e-30))
        return np.clip(0.5 + 0.5 * scaled if name in SIGNED else scaled, 0.0, 1.0)

    def _at_places(self, values: Floats) -> _Single:
        # Values at the vertices of the detailed mesh, at the places of the texels.
        assert self._onto is not None
        corners = values[self._mesh.faces[self._onto.faces]]
        read = np.einsum("kv,kvc->kc", self._onto.shares, corners)
        read[self._onto.faces < 0] = 0.0
        return self._unmet.filled(self._laid(read))

    def _laid(self, values: npt.NDArray) -> _Single:
        return on_sheet(self._atlas, self._sites, values.astype(np.float32))


def _parts(weights: Sequence[int]) -> list[tuple[float, float]]:
    # Beginnings and ends of phases of these weights.
    ends = np.cumsum([0, *weights]) / max(sum(weights), 1)
    return [(float(a), float(b)) for a, b in pairwise(ends)]


def _checked_maps(
    maps: Sequence[str], high: TriangleMesh | None, colors: npt.ArrayLike | None
) -> list[str]:
    if isinstance(maps, str) or not isinstance(maps, Sequence):
        raise InvalidSettings(f"The maps are {maps!r}; give a list of names.")
    possible = _OF_ONE if high is None else MAPS
    for name in maps:
        known = isinstance(name, str) and name in MAPS
        if not known or name not in possible:
            hint = " of a detailed mesh; give it as `high`"
            hint = hint if known else f"; there are {', '.join(possible)}"
            raise InvalidSettings(f"There is no map {name!r}{hint}.")
    if "colors" in maps and colors is None:
        raise InvalidSettings("The map of colors needs the detailed mesh's colors; give `colors`.")
    return list(dict.fromkeys(maps))


def _checked_colors(mesh: TriangleMesh, colors: npt.ArrayLike) -> Floats:
    given = as_array(colors, "colors")
    if given.ndim != 2 or len(given) != mesh.vertex_count or given.dtype.kind not in "fiu":
        raise InvalidSignal(
            f"The colors have the shape {given.shape}; give ({mesh.vertex_count}, c) numbers."
        )
    values: Floats = given.astype(np.float64)
    if not np.isfinite(values).all():
        raise InvalidSignal("A color is NaN or infinite; give numbers.")
    return values
