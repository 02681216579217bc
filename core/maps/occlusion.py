# SPDX-License-Identifier: GPL-3.0-or-later
"""Occlusion, bent normals and thickness in a texture, by rays from its texels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.sheet import shares_of_corners
from ..base.checks import Floats, by_keyword, checked_size
from ..base.parallel import kernel, run
from ..base.progress import ProgressCallback, phase, reporting
from ..elements.surface_values import sheet_values
from ..errors import InvalidSignal
from ..mesh.calculus import unit_vectors
from ..mesh.triangle_mesh import TriangleMesh, check_mesh
from ..rays.boxes import STACK, Boxes, boxes_around, first_hit
from ..rays.directions import mixed, on_disk, sobol_points
from ..settings import OcclusionSettings, ThicknessSettings, given_or_default
from ..texture.texels import Texture
from .drawing import new_texture, with_gutter
from .ray_noise import without_noise

_Single = npt.NDArray[np.float32]

_TRACING = "Tracing rays"

_ROWS = 4
"""Rows of a chunk: rays take long, and Esc should not."""

_SAME, _OTHER = 0.87, 0.5
"""Cosines between normals up to which faces are shaded as one, and from which as two."""

_DIAGONAL = 1.74
"""No ray within a cube goes farther, in lengths of its sides."""

_OFF = 1e-4
"""How far above the surface rays begin: in mean edge lengths, and (a hundredth) of the size."""

_CONE = 0.75
"""Square of the sine of the half angle of the cone of thickness: 60 degrees."""


class _Scene(NamedTuple):
    # What rays meet, and where they begin, in mean edge lengths about the middle of the mesh.
    tree: Boxes
    corners: Floats
    faces: Floats  # normals
    normals: Floats
    limit: float
    off: float
    floor: float
    reach: float  # down to the floor


@by_keyword
def ambient_occlusion(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    settings: OcclusionSettings | None = None,
    *,
    size: tuple[int, int],
    occluders: Sequence[TriangleMesh] = (),
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
) -> _Single:
    """Draw how much of the sky each place of a surface sees into a texture, across seams.

    Parameters
    ----------
    mesh, uv, progress, atlas
        As in `sharpen_texture`.
    settings : OcclusionSettings, optional
    size : (int, int)
        Rows and columns of the image.
    occluders : sequence of TriangleMesh
        Other meshes that stand in the way, in the same space.

    Returns
    -------
    (h, w) float32
        In [0, 1]: 1 where nothing is in the way, 0 where everything is, each direction weighted by
        its cosine with the normal. The gutter around the charts is filled; the rest is 0.

    Raises
    ------
    InvalidUV, Cancelled
        As in `sharpen_texture`.
    InvalidSignal
        If an occluder is no mesh.
    InvalidSettings
        If the size cannot be used.
    SolverError
        If the noise cannot be smoothed.

    Notes
    -----
    Rays leave each texel in the directions of Sobol's points, scrambled anew at each texel, and
    meet triangles in a hierarchy of boxes. Both sides of faces stand in the way. Normals are
    smooth over edges of less than 30 degrees, sharp over those of more than 60, and in between in
    between. Noise is smoothed along the surface, see `OcclusionSettings.smoothing`: for each place,
    one half of the rays tells how far the other may be smoothed.

    The kernels are part of the core, as libraries for rays have no wheels for some platforms of
    the extension.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]
    >>> floor = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> wall = core.TriangleMesh([[0, -99, 0], [0, 99, 0], [0, 0, 99]], [[0, 1, 2]])
    >>> uv = floor.vertices[floor.faces][..., :2] / 2
    >>> image = core.ambient_occlusion(floor, uv, size=(32, 32), occluders=[wall])
    >>> bool(np.isclose(image[16, 2], 0.5, atol=0.03))  # beside a high wall
    True
    """
    settings = given_or_default(settings, OcclusionSettings)
    check_mesh(mesh)
    shape = checked_size(size)
    others = _checked(occluders)
    with reporting(progress):
        with phase(0.0, 0.15, "Finding texels"):
            texture = new_texture(atlas, mesh, uv, shape, 1)
        with phase(0.15, 0.2, _TRACING):
            scene = _scene(mesh, others, settings.distance, settings.ground)
        with phase(0.2, 0.8, _TRACING):
            halves, _ = _traced(texture, scene, settings.rays)
        if settings.smoothing > 0:
            with phase(0.8, 0.95, "Smoothing"):
                space, values = without_noise(texture.atlas, halves, settings.smoothing)
                sheet = np.zeros((*halves.shape[:2], 1), dtype=np.float32)
                sheet_values(space, values, sheet)
        else:
            sheet = halves.mean(axis=2, keepdims=True)
        with phase(0.95, 1.0, "Filling the gutter"):
            return np.clip(with_gutter(texture, sheet, settings.gutter)[..., 0], 0.0, 1.0)


@by_keyword
def bent_normals(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    settings: OcclusionSettings | None = None,
    *,
    size: tuple[int, int],
    occluders: Sequence[TriangleMesh] = (),
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
) -> _Single:
    """Draw the mean direction in which each place of a surface sees the sky, across seams.

    Parameters
    ----------
    mesh, uv, settings, size, occluders, progress, atlas
        As in `ambient_occlusion`.

    Returns
    -------
    (h, w, 3) float32
        Unit vectors in the mesh's own axes; the normal where nothing can be seen. The gutter
        around the charts is filled; the rest is 0.

    Raises
    ------
    InvalidUV, InvalidSignal, InvalidSettings, SolverError, Cancelled
        As in `ambient_occlusion`.

    Examples
    --------
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]
    >>> floor = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> wall = core.TriangleMesh([[0, -99, 0], [0, 99, 0], [0, 0, 99]], [[0, 1, 2]])
    >>> uv = floor.vertices[floor.faces][..., :2] / 2
    >>> vectors = core.bent_normals(floor, uv, size=(32, 32), occluders=[wall])
    >>> bool(vectors[16, 2, 0] > 0.4)  # away from the wall
    True
    """
    settings = given_or_default(settings, OcclusionSettings)
    check_mesh(mesh)
    shape = checked_size(size)
    others = _checked(occluders)
    with reporting(progress):
        with phase(0.0, 0.15, "Finding texels"):
            texture = new_texture(atlas, mesh, uv, shape, 3)
        with phase(0.15, 0.2, _TRACING):
            scene = _scene(mesh, others, settings.distance, settings.ground)
        with phase(0.2, 0.8, _TRACING):
            _, bent = _traced(texture, scene, settings.rays)
        if settings.smoothing > 0:
            with phase(0.8, 0.95, "Smoothing"):
                space, values = without_noise(texture.atlas, bent, settings.smoothing)
                sheet = np.zeros((*bent.shape[:2], 3), dtype=np.float32)
                sheet_values(space, values, sheet)
        else:
            sheet = 0.5 * (bent[..., :3] + bent[..., 3:])
        with phase(0.95, 1.0, "Filling the gutter"):
            return _unit(with_gutter(texture, np.ascontiguousarray(sheet), settings.gutter))


@by_keyword
def thickness(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    settings: ThicknessSettings | None = None,
    *,
    size: tuple[int, int],
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
) -> _Single:
    """Draw how thick the body behind each place of a surface is, across seams.

    Parameters
    ----------
    mesh, uv, progress, atlas
        As in `sharpen_texture`.
    settings : ThicknessSettings, optional
    size : (int, int)
        Rows and columns of the image.

    Returns
    -------
    (h, w) float32
        In units of the mesh; or grays in [0, 1], see `ThicknessSettings.look`. The gutter around
        the charts is filled; the rest is 0.

    Raises
    ------
    InvalidUV, InvalidSettings, SolverError, Cancelled
        As in `ambient_occlusion`.

    Notes
    -----
    The mean, over rays into the body in a cone of 60 degrees about the normal, of how deep below
    the surface they come out again; so it is exact on plates. Rays that come out nowhere, as under
    an open sheet, count as the largest distance.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> square = np.array([[0.0, 0, 0], [9, 0, 0], [9, 9, 0], [0, 9, 0]])
    >>> faces = [[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]]
    >>> plates = core.TriangleMesh(np.concatenate([square, square - [0, 0, 0.5]]), faces)
    >>> uv = plates.vertices[plates.faces][..., :2] / 18
    >>> uv[2:, :, 0] += 0.5
    >>> image = core.thickness(plates, uv, size=(32, 32))
    >>> bool(np.isclose(image[8, 8], 0.5, atol=1e-3))
    True
    """
    settings = given_or_default(settings, ThicknessSettings)
    check_mesh(mesh)
    shape = checked_size(size)
    with reporting(progress):
        with phase(0.0, 0.15, "Finding texels"):
            texture = new_texture(atlas, mesh, uv, shape, 1)
        with phase(0.15, 0.2, _TRACING):
            scene = _scene(mesh, [], settings.distance, "none")
        with phase(0.2, 0.8, _TRACING):
            sheet = texture.atlas.sheet
            halves = np.zeros((*sheet.nodes.shape, 2), dtype=np.float32)
            run(_look_inside, len(halves), sheet.nodes, sheet.points, *scene[:6],
                sobol_points(settings.rays), halves, chunk=_ROWS)  # fmt: skip
        with phase(0.8, 0.95, "Smoothing"):
            if settings.smoothing > 0:
                space, values = without_noise(texture.atlas, halves, settings.smoothing)
                drawn = np.zeros((*halves.shape[:2], 1), dtype=np.float32)
                sheet_values(space, values, drawn)
            else:
                drawn = halves.mean(axis=2, keepdims=True)
        with phase(0.95, 1.0, "Filling the gutter"):
            depths = np.maximum(with_gutter(texture, drawn, settings.gutter)[..., 0], 0.0)
        depths *= np.float32(mesh.mean_edge_length)
        if settings.look == "gray":
            white = settings.white or float(depths.max(initial=0.0, where=texture.atlas.inside))
            depths = np.clip(depths / np.float32(white or 1.0), 0.0, 1.0)
        return depths


def _checked(occluders: Sequence[TriangleMesh]) -> list[TriangleMesh]:
    if not isinstance(occluders, list | tuple):
        raise InvalidSignal(f"The occluders are {occluders!r}; give a list of meshes.")
    for each in occluders:
        check_mesh(each)
    return list(occluders)


def _scene(mesh: TriangleMesh, others: list[TriangleMesh], distance: float, ground: str) -> _Scene:
    corners = mesh.scaled_vertices[mesh.faces]
    low, high = mesh.box
    unit, middle = mesh.mean_edge_length, low + 0.5 * (high - low)
    parts = [corners] + [(other.vertices[other.faces] - middle) / unit for other in others]
    every = np.concatenate(parts)
    extent = float((every.max(axis=(0, 1)) - every.min(axis=(0, 1))).max())
    limit = distance / unit if distance > 0 else np.inf
    floor = float(corners[..., 2].min()) if ground == "below" else -np.inf
    return _Scene(
        boxes_around(every),
        corners,
        mesh.normals,
        _shading(mesh),
        min(limit, _DIAGONAL * extent),
        _OFF * (1.0 + 0.01 * extent),
        floor,
        limit,
    )


def _shading(mesh: TriangleMesh) -> Floats:
    # At each corner the mean normal of the faces around, by angle, as far as they are of one side.
    sides = np.roll(mesh.scaled_vertices[mesh.faces], -1, axis=1)
    sides = sides - mesh.scaled_vertices[mesh.faces]
    ahead, back = (
        unit_vectors(sides.reshape(-1, 3)),
        -unit_vectors(np.roll(sides, 1, axis=1).reshape(-1, 3)),
    )
    angles = np.arccos(np.clip((ahead * back).sum(axis=1), -1.0, 1.0))
    out = np.empty((mesh.face_count, 3, 3))
    run(_blend, mesh.face_count, mesh.faces, *mesh.corners, mesh.normals, angles, out)
    return out


def _traced(texture: Texture, scene: _Scene, rays: int) -> tuple[_Single, _Single]:
    # Of both halves of the rays: the part that sees the sky, and the mean direction of that.
    sheet = texture.atlas.sheet
    seen = np.zeros((*sheet.nodes.shape, 2), dtype=np.float32)
    bent = np.zeros((*sheet.nodes.shape, 6), dtype=np.float32)
    run(_look_around, len(seen), sheet.nodes, sheet.points, *scene, sobol_points(rays), seen, bent,
        chunk=_ROWS)  # fmt: skip
    return seen, bent


def _unit(vectors: _Single) -> _Single:
    lengths = np.linalg.norm(vectors, axis=2, keepdims=True)
    return np.where(lengths > 1e-6, vectors / np.maximum(lengths, 1e-6), np.float32(0.0))


@kernel
def _blend(start, stop, faces, corner_start, corners, normals, angles, out):
    for f in range(start, stop):
        for k in range(3):
            v = faces[f, k]
            x, y, z = 1e-9 * normals[f, 0], 1e-9 * normals[f, 1], 1e-9 * normals[f, 2]
            for i in range(corner_start[v], corner_start[v + 1]):
                g = corners[i] // 3
                agrees = 0.0
                for c in range(3):
                    agrees += normals[f, c] * normals[g, c]
                share = min(max((agrees - _OTHER) / (_SAME - _OTHER), 0.0), 1.0)
                weight = share * share * (3.0 - 2.0 * share) * angles[corners[i]]
                x += weight * normals[g, 0]
                y += weight * normals[g, 1]
                z += weight * normals[g, 2]
            length = max(np.sqrt(x * x + y * y + z * z), 1e-300)
            out[f, k, 0], out[f, k, 1], out[f, k, 2] = x / length, y / length, z / length


@kernel
def _begin(places, corners, face_normals, normals, off, f, y, x):
    # A texel's place, a little off its face, and its normal.
    u, v, w = shares_of_corners(places, f, y, x)
    ox = u * corners[f, 0, 0] + v * corners[f, 1, 0] + w * corners[f, 2, 0]
    oy = u * corners[f, 0, 1] + v * corners[f, 1, 1] + w * corners[f, 2, 1]
    oz = u * corners[f, 0, 2] + v * corners[f, 1, 2] + w * corners[f, 2, 2]
    nx = u * normals[f, 0, 0] + v * normals[f, 1, 0] + w * normals[f, 2, 0]
    ny = u * normals[f, 0, 1] + v * normals[f, 1, 1] + w * normals[f, 2, 1]
    nz = u * normals[f, 0, 2] + v * normals[f, 1, 2] + w * normals[f, 2, 2]
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    if length <= 1e-12:
        nx, ny, nz = 0.0, 0.0, 1.0
        length = 1.0
    return (
        ox + off * face_normals[f, 0], oy + off * face_normals[f, 1], oz + off * face_normals[f, 2],
        nx / length, ny / length, nz / length,
    )  # fmt: skip


@kernel
def _tangents(nx, ny, nz):
    # Duff et al. (2017), "Building an orthonormal basis, revisited".
    sign = 1.0 if nz >= 0 else -1.0
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    return 1.0 + sign * nx * nx * a, sign * b, -sign * nx, b, sign + ny * ny * a, -ny


@kernel
def _look_around(
    start, stop, nodes, places, tree, corners, face_normals, normals, limit, off, floor, reach,
    points, seen, bent,
):  # fmt: skip
    stack = np.empty(STACK, np.int32)
    columns, count = nodes.shape[1], points.shape[0]
    total = np.empty(2)
    for y in range(start, stop):
        for x in range(columns):
            f = nodes[y, x]
            if f < 0:
                continue
            ox, oy, oz, nx, ny, nz = _begin(places, corners, face_normals, normals, off, f, y, x)
            ax, ay, az, bx, by, bz = _tangents(nx, ny, nz)
            scramble = mixed(np.uint64(y * columns + x + 1) * np.uint64(0x9E3779B97F4A7C15))
            total[0], total[1] = 0.0, 0.0
            for i in range(count):
                half = 0 if 2 * i < count else 1
                p, q = on_disk(points, i, scramble)
                up = np.sqrt(max(1.0 - p * p - q * q, 0.0))
                dx, dy, dz = (
                    p * ax + q * bx + up * nx,
                    p * ay + q * by + up * ny,
                    p * az + q * bz + up * nz,
                )
                above = dx * face_normals[f, 0] + dy * face_normals[f, 1] + dz * face_normals[f, 2]
                if above <= 1e-6:  # below the face itself, though not below the smooth normal
                    continue
                total[half] += 1.0
                if dz < 0.0 and floor < oz < floor - reach * dz:
                    continue
                far = first_hit(
                    tree, np.float32(ox), np.float32(oy), np.float32(oz), np.float32(dx),
                    np.float32(dy), np.float32(dz), np.float32(limit), True, stack,
                )  # fmt: skip
                if far >= np.float32(limit):
                    seen[y, x, half] += np.float32(1)
                    bent[y, x, 3 * half] += np.float32(dx)
                    bent[y, x, 3 * half + 1] += np.float32(dy)
                    bent[y, x, 3 * half + 2] += np.float32(dz)
            for half in range(2):
                share = np.float32(1.0 / max(total[half], 1.0))
                seen[y, x, half] *= share
                little = np.float32(1e-3)
                bent[y, x, 3 * half] = bent[y, x, 3 * half] * share + little * np.float32(nx)
                bent[y, x, 3 * half + 1] = bent[y, x, 3 * half + 1] * share + little * np.float32(
                    ny
                )
                bent[y, x, 3 * half + 2] = bent[y, x, 3 * half + 2] * share + little * np.float32(
                    nz
                )


@kernel
def _look_inside(
    start, stop, nodes, places, tree, corners, face_normals, normals, limit, off, points, depths
):
    stack = np.empty(STACK, np.int32)
    columns, count = nodes.shape[1], points.shape[0]
    for y in range(start, stop):
        for x in range(columns):
            f = nodes[y, x]
            if f < 0:
                continue
            ox, oy, oz, nx, ny, nz = _begin(places, corners, face_normals, normals, -off, f, y, x)
            ax, ay, az, bx, by, bz = _tangents(nx, ny, nz)
            scramble = mixed(np.uint64(y * columns + x + 1) * np.uint64(0x9E3779B97F4A7C15))
            for i in range(count):
                half = 0 if 2 * i < count else 1
                p, q = on_disk(points, i, scramble)
                p, q = p * np.sqrt(_CONE), q * np.sqrt(_CONE)
                down = np.sqrt(max(1.0 - p * p - q * q, 0.0))
                far = first_hit(
                    tree, np.float32(ox), np.float32(oy), np.float32(oz),
                    np.float32(p * ax + q * bx - down * nx),
                    np.float32(p * ay + q * by - down * ny),
                    np.float32(p * az + q * bz - down * nz), np.float32(limit / down), False, stack,
                )  # fmt: skip
                depths[y, x, half] += np.float32(min(far * down + off, limit))
            for half in range(2):
                rays = (count + 1) // 2 if half == 0 else count // 2
                depths[y, x, half] /= np.float32(max(rays, 1))
