# SPDX-License-Identifier: GPL-3.0-or-later
"""Scans of known shapes, made by code: range images, fused ones, and meshes with white noise.

Lengths are in voxels or pixels of the scan, the shapes in a ball of radius 1. Scanners look along
parallel rays.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import common
import numpy as np
import trimesh
from numba import njit
from scipy import ndimage
from scipy.spatial import cKDTree
from shock_filter import core
from shock_filter.core.mesh.calculus import average_to_vertices
from skimage.measure import marching_cubes

FINE = 0.016
"""Edges of the shape that results are compared with."""

STEEPEST = 0.2
"""Least cosine of the angle at which a scanner sees a surface."""

LEAST_PIECE = 300
"""Faces of the smallest loose piece that stays in a scan."""

VIEWS = 14

Floats = np.ndarray

SPOT = "../textured/spot/spot_triangulated.obj"  # by Keenan Crane, CC0
FRONTS = {
    SPOT: (-0.65, 0.2, -0.75),
    "julius.obj": (0.1, 0.15, -1.0),
    "nicolo.obj": (-1.0, 0.15, -0.4),
    "igea.ply": (0.1, 0.15, 1.0),
    "bunny.obj": (0.1, 0.15, 1.0),
    "lion_statue.obj": (0.9, 0.1, 0.45),
    "dragon_50k.obj": (0.1, 0.15, 1.0),
}
"""From where a shape is scanned that has a front."""


class Scan(NamedTuple):
    """A scan and the shape it is of; `true_normals` are given where faces match one by one."""

    mesh: core.TriangleMesh
    shape: core.TriangleMesh
    true_normals: Floats | None = None


class Errors(NamedTuple):
    """Mean degrees to the true normals, and the percentage of the area that is 45 off or more."""

    normal: float
    scabs: float


def ring(outer: Floats, inner: Floats, height: float) -> tuple[Floats, Floats]:
    """A part with a hole through it: two outlines of equally many points, extruded."""
    count = len(outer)
    points = [np.c_[line, np.full(count, z)] for z in (height, -height) for line in (outer, inner)]
    here = np.arange(count)
    there = (here + 1) % count
    faces = []
    for one, other in ((0, 1), (3, 2), (1, 3), (2, 0)):
        a, b, c, d = (count * loop + at for loop in (one, other) for at in (here, there))
        faces += [np.c_[a, b, d], np.c_[a, d, c]]
    turn = trimesh.transformations.random_rotation_matrix(np.array([0.3, 0.6, 0.2]))[:3, :3]
    return np.concatenate(points) @ turn.T, np.concatenate(faces)


def around(radius: Floats) -> Floats:
    """An outline from radii at equal angles."""
    angles = 2 * np.pi * np.arange(len(radius)) / len(radius)
    return radius[:, None] * np.c_[np.cos(angles), np.sin(angles)]


def gear() -> tuple[Floats, Floats]:
    """Ten straight teeth around a round hole."""
    teeth = np.interp(np.arange(400) % 40, [0, 6, 16, 22, 40], [0.75, 1.0, 1.0, 0.75, 0.75])
    return ring(around(teeth), around(np.full(400, 0.35)), 0.3)


def washer() -> tuple[Floats, Floats]:
    """A short, thick pipe."""
    return ring(around(np.full(180, 0.8)), around(np.full(180, 0.4)), 0.5)


def nut() -> tuple[Floats, Floats]:
    """Six sides and a round hole."""
    angles = (np.arange(360) % 60 - 30) * np.pi / 180
    return ring(around(0.8 / np.cos(angles)), around(np.full(360, 0.5)), 0.4)


def boulder() -> tuple[Floats, Floats]:
    """Soft lumps of several sizes, as statues have."""
    ball = trimesh.creation.icosphere(subdivisions=6)
    points = np.asarray(ball.vertices)
    random = np.random.default_rng(3)
    radius = np.ones(len(points))
    for frequency in (2.0, 4.0, 8.0, 14.0):
        waves = frequency * random.normal(size=(6, 3))
        phases = random.uniform(0, 2 * np.pi, 6)
        radius += 0.05 / frequency**0.5 * np.sin(points @ waves.T + phases).mean(axis=1)
    return points * radius[:, None], np.asarray(ball.faces)


MADE: dict[str, Callable[[], tuple[Floats, Floats]]] = {
    "gear": gear,
    "washer": washer,
    "nut": nut,
    "boulder": boulder,
    "sharp sphere": lambda: common.load_mesh(None, common.CREASED_SPHERE, 6),
}


@cache
def shape(data: Path | None, name: str) -> core.TriangleMesh:
    """Make or load a shape, centred, in a ball of radius 1."""
    points, faces = MADE[name]() if name in MADE else common.load_mesh(data, name)
    points = points - (points.min(axis=0) + points.max(axis=0)) / 2
    solid = trimesh.Trimesh(points, faces, process=False)
    if solid.is_watertight and solid.volume < 0:
        faces = faces[:, ::-1]
    return core.TriangleMesh(points / np.linalg.norm(points, axis=1).max(), faces)


@cache
def _finely(data: Path | None, name: str) -> tuple[cKDTree, Floats]:
    # Places all over a shape, and the normals there.
    mesh = shape(data, name)
    triangles, normals, found = mesh.vertices[mesh.faces], mesh.normals, []
    while len(triangles):
        edges = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)
        done = edges.max(axis=1) < FINE
        found.append((triangles[done].mean(axis=1), normals[done]))
        triangles, normals, edges = triangles[~done], normals[~done], edges[~done]
        # The longest edge is halved.
        order = (edges.argmax(axis=1)[:, None] + [0, 1, 2]) % 3
        a, b, c = np.take_along_axis(triangles, order[:, :, None], axis=1).transpose(1, 0, 2)
        middle = (a + b) / 2
        halves = np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)
        triangles, normals = np.concatenate(halves), np.tile(normals, (2, 1))
    places, normals = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return cKDTree(places), normals


def with_white_noise(data: Path | None, name: str, amount: float, seed: int) -> Scan:
    """Move the vertices of a shape along their normals, by that many mean edge lengths."""
    mesh = shape(data, name)
    along = average_to_vertices(mesh, mesh.normals)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    steps = np.random.default_rng(seed).normal(0, amount, (mesh.vertex_count, 1))
    noisy = mesh.vertices + mesh.mean_edge_length * steps * along
    return Scan(core.TriangleMesh(noisy, mesh.faces), mesh, mesh.normals)


def range_image(data: Path | None, name: str, pixels: int, amount: float, seed: int) -> Scan:
    """Scan a shape from one side; each pixel is a vertex."""
    mesh, random = shape(data, name), np.random.default_rng(seed)
    view = _view(np.array(FRONTS.get(name, (0.55, 0.6, 0.6))))
    step = 2.0 / pixels
    depth = _scanned(*_depths(mesh, view, step), amount, step, random)
    y, x = np.mgrid[: len(depth), : len(depth)]
    places = np.stack([_coordinate(x, step), _coordinate(y, step), depth], axis=-1).reshape(-1, 3)
    index = np.arange(depth.size).reshape(depth.shape)
    a, b = index[:-1, :-1].reshape(-1), index[:-1, 1:].reshape(-1)
    c, d = index[1:, 1:].reshape(-1), index[1:, :-1].reshape(-1)

    def length(one: Floats, other: Floats) -> Floats:
        return np.linalg.norm(places[one] - places[other], axis=-1)

    short = (length(a, c) <= length(b, d))[:, None]
    faces = np.concatenate(
        [
            np.where(short, np.c_[a, c, b], np.c_[a, d, b]),
            np.where(short, np.c_[a, d, c], np.c_[b, d, c]),
        ]
    )
    longest = np.max([length(faces[:, k], faces[:, k - 1]) for k in range(3)], axis=0)
    faces = faces[np.isfinite(longest) & (longest < 5 * step)]
    return Scan(_cleaned(places @ view, faces, data, name), mesh)


def fused(data: Path | None, name: str, voxels: int, amount: float, seed: int) -> Scan:
    """Scan a shape from all sides, and fuse the range images as truncated signed distances."""
    mesh, random = shape(data, name), np.random.default_rng(seed)
    step = 2.12 / voxels
    line = np.arange(-1.06, 1.06, step)
    places = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    band = 2.5 * step
    total, weight = np.zeros(len(places)), np.zeros(len(places))
    pixel = 0.8 * step
    for direction in _all_sides(VIEWS):
        view = _view(direction)
        clean, cosine = _depths(mesh, view, pixel)
        depth = _scanned(clean, cosine, amount * step / pixel, pixel, random)
        nothing = ndimage.binary_erosion(~np.isfinite(clean))
        # Views are registered a little badly.
        axis, shift = random.normal(0, (0.15, 0.3), (3, 2)).T * amount * step
        x, y, z = ((places + np.cross(axis, places) + shift) @ view.T).T
        at = np.array([_pixel(y, pixel, len(depth)), _pixel(x, pixel, len(depth))])
        nearest = np.round(at).astype(int)
        inside = ((nearest >= 0) & (nearest < len(depth))).all(axis=0)
        row, column = np.where(inside, nearest, 0)
        between = ndimage.map_coordinates(depth, at, order=1, cval=np.nan)
        known = np.where(np.isfinite(between), between, depth[row, column])
        jumps = abs(between - depth[row, column]) > 2 * step
        known = np.where(jumps, depth[row, column], known)
        slant = cosine[row, column]
        distance = (z - known) * np.maximum(slant, 0.3) ** 0.5
        seen = inside & np.isfinite(distance) & (distance > -band)
        total[seen] += slant[seen] * np.minimum(distance[seen], band)
        weight[seen] += slant[seen]
        empty = nothing[row, column] & inside
        total[empty] += 0.5 * band
        weight[empty] += 0.5
    sure = weight > 0.3
    field = np.where(sure, total / np.maximum(weight, 1e-12), -band).reshape((len(line),) * 3)
    points, faces, _, _ = marching_cubes(
        field, 0, spacing=(step,) * 3, mask=sure.reshape(field.shape)
    )
    points = points.astype(np.float64) + line[0]
    tree, _ = _finely(data, name)
    near = tree.query(points[faces].mean(axis=1))[0] < 2 * step
    return Scan(_cleaned(points, faces[near], data, name), mesh)


def errors(data: Path | None, name: str, scan: Scan, positions: Floats) -> Errors:
    """Compare new positions with the shape; a face with the nearest place of the shape."""
    result = core.TriangleMesh(positions, scan.mesh.faces)
    areas, true = scan.mesh.areas, scan.true_normals
    if true is None:
        tree, normals = _finely(data, name)
        true = normals[tree.query(result.vertices[result.faces].mean(axis=1))[1]]
    cosines = np.clip((result.normals * true).sum(axis=1), -1.0, 1.0)
    off = np.degrees(np.arccos(cosines))
    share = float(areas[off > 45].sum() / areas.sum())
    return Errors(float(np.average(off, weights=areas)), 100 * share)


def _view(direction: Floats) -> Floats:
    # Rows are the axes of a scanner that looks from there: right, up, towards it.
    toward = direction / np.linalg.norm(direction)
    right = np.cross([0.0, 0.0, 1.0] if abs(toward[2]) < 0.9 else [0.0, 1.0, 0.0], toward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(toward, right), toward])


def _all_sides(count: int) -> Floats:
    heights = 1 - 2 * (np.arange(count) + 0.5) / count
    angles = np.pi * (1 + 5**0.5) * np.arange(count)
    flat = np.sqrt(1 - heights**2)
    return np.c_[flat * np.cos(angles), flat * np.sin(angles), heights]


def _pixel(places: Floats, step: float, count: int) -> Floats:
    return places / step + count / 2 - 0.5


def _coordinate(pixels: Floats, step: float) -> Floats:
    return (pixels + 0.5 - (pixels.max() + 1) / 2) * step


def _depths(mesh: core.TriangleMesh, view: Floats, step: float) -> tuple[Floats, Floats]:
    # What lies nearest to the scanner at each pixel, and the cosine of its slant.
    count = 2 * int(np.ceil(1.02 / step))
    depth, cosine = np.full((count, count), -np.inf), np.zeros((count, count))
    places = mesh.vertices @ view.T
    places[:, :2] = _pixel(places[:, :2], step, count)
    _draw(places, mesh.faces, mesh.normals @ view[2], depth, cosine)
    depth[~np.isfinite(depth)] = np.nan
    return depth, cosine


@njit
def _draw(places, faces, slants, depth, cosine):
    for f in range(len(faces)):
        a, b, c = places[faces[f, 0]], places[faces[f, 1]], places[faces[f, 2]]
        turn = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if abs(turn) < 1e-12:
            continue
        first = max(int(np.ceil(min(a[1], b[1], c[1]))), 0)
        last = min(int(np.floor(max(a[1], b[1], c[1]))), depth.shape[0] - 1)
        left = max(int(np.ceil(min(a[0], b[0], c[0]))), 0)
        right = min(int(np.floor(max(a[0], b[0], c[0]))), depth.shape[1] - 1)
        for y in range(first, last + 1):
            for x in range(left, right + 1):
                u = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / turn
                v = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / turn
                if u < -1e-9 or v < -1e-9 or u + v > 1 + 1e-9:
                    continue
                z = a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2])
                if z > depth[y, x]:
                    depth[y, x] = z
                    cosine[y, x] = slants[f]


def _scanned(
    depth: Floats, cosine: Floats, amount: float, step: float, random: np.random.Generator
) -> Floats:
    # Noise has bumps wider than a pixel, and grows with the slant; pixels at silhouettes mix near
    # and far; depths come in steps; some pixels see nothing.
    seen = np.isfinite(depth) & (cosine > STEEPEST)
    bumps = ndimage.gaussian_filter(random.normal(size=depth.shape), 1.4)
    noise = 0.95 * bumps / bumps.std() + 0.3 * random.normal(size=depth.shape)
    found = depth + amount * step * noise / np.maximum(cosine, STEEPEST) ** 0.7
    near = ndimage.maximum_filter(np.where(seen, depth, -np.inf), 3)
    far = ndimage.minimum_filter(np.where(seen, depth, np.inf), 3)
    mixed = seen & (near - far > 5 * step) & (random.random(depth.shape) < 0.13)
    share = random.random(np.count_nonzero(mixed))
    found[mixed] = share * near[mixed] + (1 - share) * far[mixed]
    quantum = 0.5 * amount * step
    found = quantum * np.round(found / quantum)
    dark = ndimage.gaussian_filter(random.normal(size=depth.shape), 2.5)
    return np.where(seen & (dark < np.quantile(dark, 0.996)), found, np.nan)


def _cleaned(points: Floats, faces: Floats, data: Path | None, name: str) -> core.TriangleMesh:
    # Without unused vertices, faces without area and small pieces; wound as the shape is.
    used, index = np.unique(faces, return_inverse=True)
    kept, same = core.weld(points[used])
    points, faces = points[used][kept], same[index.reshape(faces.shape)]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    pieces = trimesh.graph.connected_component_labels(
        trimesh.graph.face_adjacency(faces), len(faces)
    )
    faces = faces[np.bincount(pieces)[pieces] >= LEAST_PIECE]
    used, index = np.unique(faces, return_inverse=True)
    points, faces = np.ascontiguousarray(points[used]), index.reshape(faces.shape)
    a, b, c = points[faces].transpose(1, 0, 2)
    tree, normals = _finely(data, name)
    true = normals[tree.query((a + b + c) / 3)[1]]
    if (np.cross(b - a, c - a) * true).sum() < 0:
        faces = faces[:, ::-1]
    return core.TriangleMesh(points, np.ascontiguousarray(faces))
