# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances by fast marching against exact ones, and the kernel against the Beltrami flow."""

from __future__ import annotations

import math
from collections.abc import Callable

import common
import numpy as np
import trimesh
import variants
from report import Target, table, targets
from shock_filter import core
from shock_filter.core.grid.geodesics import march, open_band
from shock_filter.core.mesh import geodesics

ORDER = 0.9
ROUNDING = 1e-5
"""Errors below this part of the radius are float32's: there is no order to measure."""

Measurement = tuple[float, float, float]
"""Mean edge length, largest error and mean error."""


def _square(n: int) -> tuple[np.ndarray, np.ndarray]:
    return np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1))


def plane_grid(n: int, shear: float) -> tuple[np.ndarray, np.ndarray]:
    """A sheared plane and the exact distances from its centre."""
    u, v = _square(n)
    points = np.stack([u + shear * v, v, np.zeros_like(u)], axis=-1)
    return points, np.linalg.norm(points, axis=-1)


def sphere_grid(n: int, shear: float) -> tuple[np.ndarray, np.ndarray]:
    """A part of a sphere, its coordinates sheared, and the exact distances."""
    u, v = _square(n)
    u = u + shear * v
    points = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=-1)
    chords = np.linalg.norm(points - points[n // 2, n // 2], axis=-1)
    return points, 2 * np.arcsin(chords / 2)


def cone_grid(n: int, shear: float) -> tuple[np.ndarray, np.ndarray]:
    """A part of a cone, its coordinates sheared, and the exact distances."""
    u, v = _square(n)
    slope, s = math.sin(math.pi / 6), v + 2
    angle = u + shear * v
    around = [s * slope * np.cos(angle), s * slope * np.sin(angle), s * math.cos(math.pi / 6)]
    flat = np.stack([s * np.cos(slope * angle), s * np.sin(slope * angle)], axis=-1)
    exact = np.linalg.norm(flat - flat[n // 2, n // 2], axis=-1)
    return np.stack(around, axis=-1), exact


def grid_distances(
    points: np.ndarray, y: int, x: int, radius: float, flat: bool = False
) -> np.ndarray:
    """Distances on a grid of points from one of them, infinite beyond the radius.

    With `flat`, places in the plane, a pixel apart, are added to the coordinates.
    """
    guide, square = np.ascontiguousarray(points, dtype=np.float32), np.float32(radius**2)
    height, width = guide.shape[0], guide.shape[1] + 2
    band, front = open_band(guide, np.float32(flat), square, 0, height)
    march((y + 1) * width + x + 1, square, band, front)
    return np.sqrt(front.final.reshape(height + 2, width)[1:-1, 1:-1])


def grid_error(shape: Callable, shear: float, n: int) -> Measurement:
    """Errors within a radius of 0.4 on a parametric manifold of n x n squares."""
    points, exact = shape(n, shear)
    found = grid_distances(points, n // 2, n // 2, 0.4)
    errors = abs(found - exact)[exact < 0.38]
    return 2 / n, float(errors.max()), float(errors.mean())


def sheet(n: int, jitter: float) -> tuple[np.ndarray, np.ndarray]:
    """A flat square of side 1 of n x n cells, each cut in two, inner points jittered."""
    x, y = np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0), indexing="ij")
    vertices = np.stack([x, y, np.zeros_like(x)], axis=-1)
    steps = np.random.default_rng(2).uniform(-jitter, jitter, (n - 1, n - 1, 2))
    vertices[1:-1, 1:-1, :2] += steps
    index = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    halves = [np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))]
    return vertices.reshape(-1, 3) / n, np.concatenate(halves)


def obtuse_share(vertices: np.ndarray, faces: np.ndarray) -> float:
    """How many of the triangles are obtuse."""
    sides = vertices[faces] - np.roll(vertices[faces], -1, axis=1)
    squares = (sides**2).sum(axis=2)
    return float((2 * squares.max(axis=1) > squares.sum(axis=1)).mean())


def irregular_plane(level: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A stretched sheet of irregular triangles, most of them obtuse; exact distances."""
    n = 6 * 2**level
    source = (n // 2) * (n + 1) + n // 4
    vertices, faces = sheet(n, 0.2)
    vertices *= [3.0, 1.0, 1.0]
    return vertices, faces, np.linalg.norm(vertices - vertices[source], axis=1)


def whole_sphere(level: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A sphere of nearly equal triangles, to its opposite pole."""
    ball = trimesh.creation.icosphere(subdivisions=level + 1)
    points = np.asarray(ball.vertices)
    return points, np.asarray(ball.faces), np.arccos(np.clip(points @ points[0], -1, 1))


def sheet_on_cone(level: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A sheet of irregular triangles, rolled onto a cone without changing lengths."""
    n = 8 * 2**level
    flat, faces = sheet(n, 0.2)
    source = (n // 2) * (n + 1) + n // 4
    radius, turn = np.hypot(*flat[:, :2].T), 2.5 * np.arctan2(flat[:, 1], flat[:, 0])
    height = np.full_like(turn, math.sqrt(1 - 1 / 2.5**2))
    points = np.stack([np.cos(turn) / 2.5, np.sin(turn) / 2.5, height], axis=1) * radius[:, None]
    return points, faces, np.linalg.norm(flat - flat[source], axis=1)


def mesh_error(shape: Callable, level: int) -> tuple[Measurement, float]:
    """Errors over a whole mesh, from where the exact distance is 0; and its obtuse share."""
    vertices, faces, exact = shape(level)
    mesh = core.TriangleMesh(vertices, faces)
    source = int(exact.argmin())
    front = geodesics.new_front(mesh.vertex_count)
    geodesics.march(
        source, 1, np.inf, geodesics.ALL, geodesics.stencils(mesh, mesh.scaled_vertices), front
    )
    errors = abs(np.sqrt(front.squares) * mesh.mean_edge_length - exact)
    found = (mesh.mean_edge_length, float(errors.max()), float(errors.mean()))
    return found, obtuse_share(vertices, faces)


GRIDS = {
    "plane": (plane_grid, 0.0),
    "plane, sheared": (plane_grid, 2.3),
    "sphere": (sphere_grid, 0.0),
    "sphere, sheared": (sphere_grid, 1.5),
    "cone": (cone_grid, 0.0),
    "cone, sheared": (cone_grid, 1.5),
}
MESHES = {
    "plane, stretched": irregular_plane,
    "sphere": whole_sphere,
    "sheet on a cone": sheet_on_cone,
}


def orders(series: list[Measurement]) -> list[float]:
    """Orders of convergence of largest and mean error, fitted over all sizes."""
    sizes, *errors = np.log(np.array(series)).T
    return [float(np.polyfit(sizes, error, 1)[0]) for error in errors]


def _row(label: list[str], series: list[Measurement]) -> tuple[list[str], list[float] | None]:
    errors = [f"{error:.1e}" for _, error, _ in series]
    if max(error for _, error, _ in series) < ROUNDING:
        return [*label, *errors, "exact", "exact"], None
    found = orders(series)
    return [*label, *errors, *(f"{order:.2f}" for order in found)], found


def distances(job: common.Job) -> None:
    """Distances against exact ones, with orders of convergence."""
    goals, rows = [], []
    for name, (shape, shear) in GRIDS.items():
        line, found = _row([name], [grid_error(shape, shear, n) for n in (16, 32, 64, 128)])
        rows.append(line)
        if found:
            goals.append(Target(f"grid, {name}: order of the mean", found[1], ORDER, at_least=True))
    head = ["order, largest", "order, mean"]
    text = [
        "Parametric manifolds of n x n squares, distances up to 0.4 from the middle (the squares'"
        " side is 2 / n before they are bent). Largest error by n:",
        table(["manifold", "16", "32", "64", "128", *head], rows),
    ]
    rows = []
    for name, shape in MESHES.items():
        found_all = [mesh_error(shape, level) for level in range(1, 5)]
        label = [name, f"{found_all[-1][1]:.0%}"]
        line, found = _row(label, [measurement for measurement, _ in found_all])
        rows.append(line)
        if found:
            goals.append(Target(f"mesh, {name}: order of the mean", found[1], ORDER, at_least=True))
    text += [
        "Triangle meshes, each step with edges half as long; distances over the whole mesh. Largest"
        " error by step:",
        table(["mesh", "obtuse", "1", "2", "3", "4", *head], rows, words=1),
        targets(goals),
    ]
    job.page.write("distances", "\n\n".join(text))


def beltrami_flow(image: np.ndarray, beta: float, time: float, steps: int) -> np.ndarray:
    """Explicit steps of the Beltrami flow on one channel."""
    values = image.copy()
    for _ in range(steps):
        down, across = np.gradient(values)
        root = np.sqrt(1 + beta**2 * (across**2 + down**2))
        change = np.gradient(down / root, axis=0) + np.gradient(across / root, axis=1)
        values += time / steps * change / root
    return values


def flow(job: common.Job) -> None:
    """The kernel against the Beltrami flow as the time goes to 0."""
    y, x = np.mgrid[:120, :120] / 120
    image = np.sin(2 * np.pi * x) * np.cos(2 * np.pi * y + 0.5) + 0.3 * x * y
    beta, inside = 24.0, slice(42, -42)
    rows, errors, times = [], [], [1.0, 2.0, 4.0, 8.0]
    for time in times:
        settings = core.BeltramiSettings(time=time, beta=beta, iterations=1)
        with variants.cutoff(1e-5), variants.by_surface():
            ours = core.beltrami_image(image, settings)
        reference = beltrami_flow(image, beta, time, math.ceil(8 * time))
        error, change = (ours - reference)[inside, inside], (reference - image)[inside, inside]
        errors.append(float(np.sqrt((error**2).mean())))
        relative = errors[-1] / float(np.sqrt((change**2).mean()))
        rows.append([f"{time:g}", f"{errors[-1]:.2e}", f"{relative:.2%}"])
    order = float(np.polyfit(np.log(times), np.log(errors), 1)[0])
    text = [
        "A smooth gray image of 120 x 120 pixels, beta = 24, one application of the kernel against"
        " explicit steps of the flow; root mean square over the inner part.",
        table(["time", "difference", "of the change"], rows),
        targets([Target("order in time of the difference", order, 1.8, at_least=True)]),
    ]
    job.page.write("flow", "\n\n".join(text))
