# SPDX-License-Identifier: GPL-3.0-or-later
"""Traces rays from places on a surface, outwards and into the body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.sheet import shares_of_corners
from ..base.checks import Floats
from ..base.parallel import kernel, run
from ..errors import InvalidSignal
from ..mesh.calculus import unit_vectors
from ..mesh.order import morton_codes
from ..mesh.triangle_mesh import TriangleMesh, check_mesh
from ..rays.boxes import STACK, Boxes, boxes_around, first_hit
from ..rays.directions import grid_codes, ray_of, ray_points

_Single = npt.NDArray[np.float32]

_AT_ONCE = 1024
"""Places per chunk of a thread: few, so that a run is quickly cancelled."""

_SAME, _OTHER = 0.87, 0.5
"""Ramp of the cosine between face normals: above the first value, faces are shaded smoothly; below
the second, the edge between them is sharp."""

_DIAGONAL = 1.74
"""Longest ray within a cube, relative to its side."""

_OFF = 1e-4
"""Distance above the surface at which rays begin: in mean edge lengths, and, divided by 100,
relative to the size."""

_UNEVEN = 4.0
"""Largest factor by which a texel may be smaller or larger than the mean texel; sizes are clipped.
"""

_CONE = 0.75
"""Square of the sine of the half angle of the cone of thickness: 60 degrees."""


class Sites(NamedTuple):
    """Places from which rays are cast, in mean edge lengths relative to the centre of a mesh.

    Attributes
    ----------
    points : (k, 3) float32
    normals : (k, 3) float32
        Unit vectors around which rays are distributed.
    facing : (k, 3) float32
        Unit normals of the faces; rays do not go below the faces.
    numbers : (k,) int64
        Indices of the nodes or the vertices.
    turns : (k,) int64
        Positions along a space-filling curve: neighbours on it share a sequence of rays.
    spacings : (k,) float32
        Distances between neighbouring places.
    """

    points: _Single
    normals: _Single
    facing: _Single
    numbers: npt.NDArray[np.int64]
    turns: npt.NDArray[np.int64]
    spacings: _Single


class Scene(NamedTuple):
    """The geometry that rays hit, in the units of `Sites`.

    Attributes
    ----------
    tree : Boxes
    off : float
        Distance from the surface at which rays begin.
    farthest : float
        Upper limit of the length of rays that hit something.
    floor : float
        Height of an infinite floor; minus infinity if there is none.
    unit : float
        The mean edge length.
    """

    tree: Boxes
    off: float
    farthest: float
    floor: float
    unit: float

    def limit(self, distance: float) -> float:
        """Return the length of the longest rays, for a distance in units of the mesh or 0."""
        return min(distance / self.unit if distance > 0 else np.inf, self.farthest)


def checked_occluders(occluders: Sequence[TriangleMesh]) -> list[TriangleMesh]:
    """Return a list of meshes, or raise `InvalidSignal` or `InvalidMesh`."""
    if not isinstance(occluders, list | tuple):
        raise InvalidSignal(f"The occluders are {occluders!r}; give a list of meshes.")
    for each in occluders:
        check_mesh(each)
    return list(occluders)


def scene_of(
    mesh: TriangleMesh, others: Sequence[TriangleMesh] = (), ground: str = "none"
) -> Scene:
    """Build the hierarchy of boxes of a mesh, and of others in its space."""
    corners = mesh.scaled_vertices[mesh.faces]
    parts = [corners, *(scaled_to(mesh, other.vertices)[other.faces] for other in others)]
    every = np.concatenate(parts)
    extent = float((every.max(axis=(0, 1)) - every.min(axis=(0, 1))).max())
    floor = float(corners[..., 2].min()) if ground == "below" else -np.inf
    off = _OFF * (1.0 + 0.01 * extent)
    return Scene(boxes_around(every), off, _DIAGONAL * extent, floor, mesh.mean_edge_length)


def scaled_to(mesh: TriangleMesh, places: Floats) -> Floats:
    """Return places (k, 3) in mean edge lengths about the middle of a mesh, as `Sites` are."""
    low, high = mesh.box
    scaled: Floats = (places - (low + 0.5 * (high - low))) / mesh.mean_edge_length
    return scaled


def texel_sites(atlas: TextureAtlas) -> Sites:
    """Return the places of the nodes inside charts, along a curve through each chart."""
    mesh, nodes = atlas.mesh, atlas.sheet.nodes.reshape(-1)
    numbers = np.flatnonzero(nodes >= 0)
    turns = grid_codes(np.stack(np.divmod(numbers, atlas.sheet.nodes.shape[1]), axis=1))
    order = np.argsort(turns, kind="stable")
    numbers, turns = numbers[order], turns[order]
    points = read_corners(atlas, numbers, mesh.scaled_vertices[mesh.faces])
    normals = read_corners(atlas, numbers, shading_normals(mesh))
    facing = mesh.normals[nodes[numbers]].astype(np.float32)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(lengths > 1e-12, normals / np.maximum(lengths, 1e-12), facing)
    metric = atlas.metric
    spread = np.sqrt(metric.texel_areas[nodes[numbers]])
    spread = np.clip(np.where(spread > 0, spread, 1.0), 1.0 / _UNEVEN, _UNEVEN)
    spacings = (metric.texel_size / mesh.mean_edge_length * spread).astype(np.float32)
    return Sites(points, normals.astype(np.float32), facing, numbers, turns, spacings)


def read_corners(atlas: TextureAtlas, numbers: npt.NDArray[np.int64], corners: Floats) -> _Single:
    """Interpolate values at the corners of faces (m, 3, c) at nodes inside charts: (k, c)."""
    out = np.empty((len(numbers), corners.shape[2]), dtype=np.float32)
    run(_read, len(numbers), numbers, atlas.sheet.nodes, atlas.sheet.points,
        np.ascontiguousarray(corners), out)  # fmt: skip
    return out


def vertex_sites(mesh: TriangleMesh) -> Sites:
    """Return the vertices as places, with the mean normals around them."""
    normals = np.zeros((mesh.vertex_count, 3))
    shading = shading_normals(mesh).reshape(-1, 3)
    for axis in range(3):
        normals[:, axis] = np.bincount(
            mesh.faces.reshape(-1), shading[:, axis], minlength=mesh.vertex_count
        )
    single = unit_vectors(normals).astype(np.float32)
    order = np.argsort(morton_codes(mesh), kind="stable")
    turns = np.empty(mesh.vertex_count, dtype=np.int64)
    turns[order] = np.arange(mesh.vertex_count)
    areas = np.repeat(mesh.areas / 3.0, 3)
    around = np.bincount(mesh.faces.reshape(-1), areas, minlength=mesh.vertex_count)
    points, spacings = mesh.scaled_vertices.astype(np.float32), np.sqrt(around).astype(np.float32)
    return Sites(points, single, single, np.arange(mesh.vertex_count), turns, spacings)


def shading_normals(mesh: TriangleMesh) -> Floats:
    """Return unit normals at the corners of faces: (m, 3, 3).

    They are means over the faces around, weighted by angle: smooth across edges of less than 30
    degrees, sharp across edges of more than 60, and blended in between.
    """
    corners = mesh.scaled_vertices[mesh.faces]
    sides = np.roll(corners, -1, axis=1) - corners
    ahead = unit_vectors(sides.reshape(-1, 3))
    back = -unit_vectors(np.roll(sides, 1, axis=1).reshape(-1, 3))
    angles = np.arccos(np.clip((ahead * back).sum(axis=1), -1.0, 1.0))
    out = np.empty((mesh.face_count, 3, 3))
    run(_blend, mesh.face_count, mesh.faces, *mesh.corners, mesh.normals, angles, out)
    return out


def look_around(
    scene: Scene, sites: Sites, rays: int, distance: float = 0.0, *, measured: bool = False
) -> tuple[_Single, _Single, _Single]:
    """Trace rays outwards from the surface, in two halves.

    Parameters
    ----------
    scene : Scene
    sites : Sites
    rays : int
    distance : float
        Length of rays, in units of the mesh; 0 is infinite.
    measured : bool
        Whether `near` is computed, which takes longer.

    Returns
    -------
    seen : (k, 2) float32
        The share of rays that hit nothing, for each half.
    bent : (k, 6) float32
        The mean direction of these rays.
    near : (k, 2) float32
        The share of rays that hit something, weighted by nearness, which falls to 0 at `distance`.
    """
    count, limit = len(sites.points), scene.limit(distance)
    reach = distance / scene.unit if distance > 0 else np.inf
    seen, near = np.zeros((count, 2), np.float32), np.zeros((count, 2), np.float32)
    bent = np.zeros((count, 6), np.float32)
    run(_look_around, count, sites, scene.tree, limit, scene.off, scene.floor, reach,
        ray_points(rays), rays, measured, seen, bent, near, chunk=_AT_ONCE)  # fmt: skip
    return seen, bent, near


def look_inside(scene: Scene, sites: Sites, rays: int, distance: float = 0.0) -> _Single:
    """Trace rays into the body, in a cone of 60 degrees: their mean depths, (k, 2) float32."""
    count = len(sites.points)
    depths = np.zeros((count, 2), np.float32)
    run(_look_inside, count, sites, scene.tree, scene.limit(distance), scene.off,
        ray_points(rays), rays, depths, chunk=_AT_ONCE)  # fmt: skip
    return depths


def look_past_edges(scene: Scene, sites: Sites, rays: int, distance: float) -> _Single:
    """Measure how convex the surface is within a distance, by rays into the body: (k, 2) float32.

    Returns
    -------
    (k, 2) float32
        For each half, the share of rays that leave the body through another side: 0 on planes and
        where the surface is concave, (1 - cos a) / 2 on a sharp edge where it turns by the angle a,
        falling to 0 at the distance. Rays that leave through the opposite side, as of a thin wall,
        do not count.
    """
    count = len(sites.points)
    found = np.zeros((count, 2), np.float32)
    run(_look_past, count, sites, scene.tree, scene.limit(distance), scene.off,
        ray_points(rays), rays, found, chunk=_AT_ONCE)  # fmt: skip
    return found


@kernel
def _read(start, stop, numbers, nodes, places, corners, out):
    for i in range(start, stop):
        y, x = divmod(numbers[i], nodes.shape[1])
        f = nodes[y, x]
        shares = shares_of_corners(places, f, y, x)
        for c in range(out.shape[1]):
            total = 0.0
            for k in range(3):
                total += shares[k] * corners[f, k, c]
            out[i, c] = total


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
def tangents(nx, ny, nz):
    """Complete a unit normal to a basis."""
    # Duff et al. (2017), "Building an orthonormal basis, revisited".
    sign = 1.0 if nz >= 0 else -1.0
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    return 1.0 + sign * nx * nx * a, sign * b, -sign * nx, b, sign + ny * ny * a, -ny


@kernel
def _origin(sites, i, off):
    # A place a little off its face.
    x = sites.points[i, 0] + off * sites.facing[i, 0]
    y = sites.points[i, 1] + off * sites.facing[i, 1]
    z = sites.points[i, 2] + off * sites.facing[i, 2]
    return np.float32(x), np.float32(y), np.float32(z)


@kernel
def _look_around(
    start, stop, sites, tree, limit, off, floor, reach, points, rays, measured, seen, bent, near
):
    stack = np.empty(STACK, np.int32)
    total = np.empty(2)
    for k in range(start, stop):
        ox, oy, oz = _origin(sites, k, off)
        nx = np.float64(sites.normals[k, 0])
        ny = np.float64(sites.normals[k, 1])
        nz = np.float64(sites.normals[k, 2])
        ax, ay, az, bx, by, bz = tangents(nx, ny, nz)
        total[0], total[1] = 0.0, 0.0
        for i in range(rays):
            half = 0 if 2 * i < rays else 1
            p, q = ray_of(points, rays, sites.turns[k], i)
            up = np.sqrt(max(1.0 - p * p - q * q, 0.0))
            dx = p * ax + q * bx + up * nx
            dy = p * ay + q * by + up * ny
            dz = p * az + q * bz + up * nz
            above = dx * sites.facing[k, 0] + dy * sites.facing[k, 1] + dz * sites.facing[k, 2]
            if above <= 1e-6:  # below the face itself, though not below the smooth normal
                continue
            total[half] += 1.0
            far, row = limit, -1
            if dz < 0.0 and floor < oz < floor - reach * dz:
                far, row = (floor - oz) / dz, 0
            else:
                hit, row = first_hit(
                    tree, ox, oy, oz, np.float32(dx), np.float32(dy), np.float32(dz),
                    np.float32(limit), not measured, stack,
                )  # fmt: skip
                far = np.float64(hit)
            if row < 0:
                seen[k, half] += np.float32(1)
                bent[k, 3 * half] += np.float32(dx)
                bent[k, 3 * half + 1] += np.float32(dy)
                bent[k, 3 * half + 2] += np.float32(dz)
            else:
                near[k, half] += np.float32(max(1.0 - far / limit, 0.0))
        for half in range(2):
            share, little = np.float32(1.0 / max(total[half], 1.0)), np.float32(1e-3)
            seen[k, half] *= share
            near[k, half] *= share
            for c in range(3):
                mean = bent[k, 3 * half + c] * share
                bent[k, 3 * half + c] = mean + little * sites.normals[k, c]


@kernel
def _look_inside(start, stop, sites, tree, limit, off, points, rays, depths):
    stack = np.empty(STACK, np.int32)
    for k in range(start, stop):
        ox, oy, oz = _origin(sites, k, -off)
        nx = np.float64(sites.normals[k, 0])
        ny = np.float64(sites.normals[k, 1])
        nz = np.float64(sites.normals[k, 2])
        ax, ay, az, bx, by, bz = tangents(nx, ny, nz)
        for i in range(rays):
            half = 0 if 2 * i < rays else 1
            p, q = ray_of(points, rays, sites.turns[k], i)
            p, q = p * np.sqrt(_CONE), q * np.sqrt(_CONE)
            down = np.sqrt(max(1.0 - p * p - q * q, 0.0))
            far, _ = first_hit(
                tree, ox, oy, oz,
                np.float32(p * ax + q * bx - down * nx),
                np.float32(p * ay + q * by - down * ny),
                np.float32(p * az + q * bz - down * nz), np.float32(limit / down), False, stack,
            )  # fmt: skip
            depths[k, half] += np.float32(min(far * down + off, limit))
        for half in range(2):
            depths[k, half] /= np.float32(max((rays + 1 - half) // 2, 1))


@kernel
def _look_past(start, stop, sites, tree, limit, off, points, rays, found):
    stack = np.empty(STACK, np.int32)
    total = np.empty(2)
    triangles = tree.triangles
    for k in range(start, stop):
        ox, oy, oz = _origin(sites, k, -off)
        nx = np.float64(sites.normals[k, 0])
        ny = np.float64(sites.normals[k, 1])
        nz = np.float64(sites.normals[k, 2])
        ax, ay, az, bx, by, bz = tangents(nx, ny, nz)
        total[0], total[1] = 0.0, 0.0
        for i in range(rays):
            half = 0 if 2 * i < rays else 1
            p, q = ray_of(points, rays, sites.turns[k], i)
            down = np.sqrt(max(1.0 - p * p - q * q, 0.0))
            dx = np.float32(p * ax + q * bx - down * nx)
            dy = np.float32(p * ay + q * by - down * ny)
            dz = np.float32(p * az + q * bz - down * nz)
            above = dx * sites.facing[k, 0] + dy * sites.facing[k, 1] + dz * sites.facing[k, 2]
            if above >= -1e-6:  # out of the face itself, which the smooth normal leans from
                continue
            total[half] += 1.0
            far, row = first_hit(tree, ox, oy, oz, dx, dy, dz, np.float32(limit), False, stack)
            if row < 0:
                continue
            ux, uy, uz = triangles[row, 3], triangles[row, 4], triangles[row, 5]
            vx, vy, vz = triangles[row, 6], triangles[row, 7], triangles[row, 8]
            mx, my, mz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            length = np.sqrt(np.float64(mx * mx + my * my + mz * mz))
            if mx * dx + my * dy + mz * dz <= 0 or length <= 0:
                continue  # it enters something else there
            agrees = (mx * nx + my * ny + mz * nz) / length
            weight = min(2.0 * max(1.0 + agrees, 0.0), 1.0)
            found[k, half] += np.float32(weight * max(1.0 - far / limit, 0.0))
        for half in range(2):
            found[k, half] /= np.float32(max(total[half], 1.0))
