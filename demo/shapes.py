# SPDX-License-Identifier: GPL-3.0-or-later
"""The shapes of the demo: Blender's Suzanne, also painted, and a machine part made by code."""

from __future__ import annotations

import itertools

import bpy
import mathutils
import numpy as np
import numpy.typing as npt
from shock_filter import core
from shock_filter.core.mesh import calculus

Floats = npt.NDArray[np.float64]

TEETH = 14
BORE, HUB, ROOT, TIP = 0.32, 0.55, 0.85, 1.0
BODY_HEIGHT, HUB_HEIGHT = 0.3, 0.55


def suzanne(subdivisions: int) -> bpy.types.Object:
    """Blender's monkey, subdivided."""
    bpy.ops.mesh.primitive_monkey_add()
    obj = bpy.context.object
    obj.modifiers.new("Subdivision", "SUBSURF").levels = subdivisions
    bpy.ops.object.modifier_apply(modifier="Subdivision")
    return obj


def ball(subdivisions: int) -> bpy.types.Object:
    """A cube with six charts, subdivided until it is round."""
    bpy.ops.mesh.primitive_cube_add()
    obj = bpy.context.object
    obj.modifiers.new("Subdivision", "SUBSURF").levels = subdivisions
    bpy.ops.object.modifier_apply(modifier="Subdivision")
    return obj


def nut() -> bpy.types.Object:
    """A hexagonal nut: a short prism with a bore, which a boolean cuts."""
    bpy.ops.mesh.primitive_cylinder_add(vertices=6, radius=1.0, depth=0.8)
    obj = bpy.context.object
    bpy.ops.mesh.primitive_cylinder_add(vertices=96, radius=0.55, depth=2.0)
    return _cut(obj, bpy.context.object)


def cut_box() -> bpy.types.Object:
    """A box from which booleans take a corner and a round channel."""
    bpy.ops.mesh.primitive_cube_add(size=1.6)
    obj = bpy.context.object
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=(0.8, -0.8, 0.8))
    _cut(obj, bpy.context.object)
    bpy.ops.mesh.primitive_cylinder_add(
        vertices=96, radius=0.4, depth=4.0, location=(-0.2, 0.0, 0.8), rotation=(np.pi / 2, 0, 0)
    )
    return _cut(obj, bpy.context.object)


def _cut(obj: bpy.types.Object, tool: bpy.types.Object) -> bpy.types.Object:
    boolean = obj.modifiers.new("Cut", "BOOLEAN")
    boolean.operation, boolean.object = "DIFFERENCE", tool
    apply(obj)
    bpy.data.objects.remove(tool)
    return obj


def remesh(obj: bpy.types.Object, voxels: int, turned: tuple[float, float, float]) -> None:
    """Replace an object by Blender's voxel remesh, as triangles, askew to the voxels' grid."""
    turn = np.array(mathutils.Euler(turned).to_matrix())
    write_positions(obj.data, read_positions(obj.data) @ turn.T)
    voxel = obj.modifiers.new("Remesh", "REMESH")
    voxel.mode, voxel.voxel_size = "VOXEL", max(obj.dimensions) / voxels
    obj.modifiers.new("Triangulate", "TRIANGULATE")
    apply(obj)
    write_positions(obj.data, read_positions(obj.data) @ turn)


def apply(obj: bpy.types.Object) -> None:
    """Replace the mesh by what the modifiers make of it."""
    bpy.context.view_layer.update()
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = bpy.data.meshes.new_from_object(evaluated)
    obj.modifiers.clear()
    obj.data = mesh
    bpy.context.view_layer.update()


def write_positions(mesh: bpy.types.Mesh, positions: Floats) -> None:
    mesh.attributes["position"].data.foreach_set("vector", positions.astype(np.float32).ravel())
    mesh.update()


def gear(spacing: float) -> bpy.types.Object:
    """A gear with a raised hub and a bore, of triangles with edges about `spacing` long.

    Flat faces, round walls, convex and concave creases, and the mesh has edges along them.
    """
    loops = [_ring(BORE, spacing), _ring(HUB, spacing), _teeth(spacing)]
    points, triangles = _triangulate(loops, spacing)
    radii = np.linalg.norm(points[triangles].mean(axis=1), axis=1)
    hub = triangles[radii < HUB]
    body = triangles[radii > HUB]
    builder = _Builder(points)
    builder.cap(triangles, 0.0, upwards=False)
    builder.cap(hub, HUB_HEIGHT, upwards=True)
    builder.cap(body, BODY_HEIGHT, upwards=True)
    bore, step, outline = _split(loops)
    builder.wall(outline, 0.0, BODY_HEIGHT, spacing)
    builder.wall(step, BODY_HEIGHT, HUB_HEIGHT, spacing)
    builder.wall(bore[::-1], 0.0, HUB_HEIGHT, spacing)
    return builder.object("Gear")


def _split(loops: list[Floats]) -> list[npt.NDArray[np.intp]]:
    """Indices of each loop's points in the triangulation, which starts with them."""
    ends = np.cumsum([len(loop) for loop in loops])
    return [np.arange(end - len(loop), end) for loop, end in zip(loops, ends, strict=True)]


def _ring(radius: float, spacing: float) -> Floats:
    count = round(2 * np.pi * radius / spacing)
    angles = 2 * np.pi * np.arange(count) / count
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _teeth(spacing: float) -> Floats:
    # Each tooth: up its flank, over its tip, down, along the root.
    corners = []
    for tooth in range(TEETH):
        for share, radius in ((0.0, ROOT), (0.14, TIP), (0.42, TIP), (0.56, ROOT)):
            angle = 2 * np.pi * (tooth + share) / TEETH
            corners.append((radius * np.cos(angle), radius * np.sin(angle)))
    pieces = []
    for start, stop in zip(np.array(corners), np.roll(corners, -1, axis=0), strict=True):
        count = max(round(np.linalg.norm(stop - start) / spacing), 1)
        pieces.append(start + (stop - start) * np.arange(count)[:, None] / count)
    return np.concatenate(pieces)


def _triangulate(loops: list[Floats], spacing: float) -> tuple[Floats, npt.NDArray[np.intp]]:
    """Fill the area between the first and the last loop with even triangles."""
    size = np.arange(-TIP, TIP, spacing)
    rows = np.arange(-TIP, TIP, spacing * np.sqrt(0.75))
    x, y = np.meshgrid(size, rows)
    x[1::2] += 0.5 * spacing
    inner = np.stack([x.ravel(), y.ravel()], axis=1)
    tree = mathutils.kdtree.KDTree(sum(map(len, loops)))
    for index, (px, py) in enumerate(np.concatenate(loops)):
        tree.insert((px, py, 0.0), index)
    tree.balance()
    far = [tree.find((px, py, 0.0))[2] > 0.7 * spacing for px, py in inner]
    points = np.concatenate([*loops, inner[far]])
    edges = [
        (int(a), int(b))
        for loop in _split(loops)
        for a, b in zip(loop, np.roll(loop, -1), strict=True)
    ]
    # Type 0 keeps all triangles of the convex hull; which are inside is told by their centres.
    result = mathutils.geometry.delaunay_2d_cdt(
        [mathutils.Vector(p) for p in points], edges, [], 0, 1e-7, False
    )
    triangles = np.array(result[2])
    centres = points[triangles].mean(axis=1)
    return points, triangles[_inside(loops[-1], centres) & ~_inside(loops[0], centres)]


def _inside(polygon: Floats, points: Floats) -> npt.NDArray[np.bool_]:
    """Tell which points lie in a polygon, by counting the edges to their right."""
    inside = np.zeros(len(points), dtype=bool)
    for (ax, ay), (bx, by) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if ay == by:
            continue
        across = (ay > points[:, 1]) != (by > points[:, 1])
        inside ^= across & (points[:, 0] < ax + (bx - ax) * (points[:, 1] - ay) / (by - ay))
    return inside


class _Builder:
    """Collects caps and walls over the same plan; what is in the same place is one vertex."""

    def __init__(self, plan: Floats) -> None:
        self._plan = plan
        self._levels: dict[tuple[int, float], int] = {}
        self._vertices: list[tuple[float, float, float]] = []
        self._faces: list[tuple[int, int, int]] = []

    def cap(self, triangles: npt.NDArray[np.intp], height: float, upwards: bool) -> None:
        for triangle in triangles:
            a, b, c = (self._vertex(point, height) for point in triangle)
            self._faces.append((a, b, c) if upwards else (a, c, b))

    def wall(self, loop: npt.NDArray[np.intp], low: float, high: float, spacing: float) -> None:
        """Stand triangles on a loop that runs anticlockwise around what is solid."""
        layers = np.linspace(low, high, max(round((high - low) / spacing), 1) + 1)
        for lower, upper in itertools.pairwise(layers):
            for step, (p, q) in enumerate(zip(loop, np.roll(loop, -1), strict=True)):
                a, b = self._vertex(p, lower), self._vertex(q, lower)
                c, d = self._vertex(q, upper), self._vertex(p, upper)
                # Alternating diagonals, so that the mesh has no grain.
                faces = ((a, b, c), (a, c, d)) if step % 2 else ((a, b, d), (b, c, d))
                self._faces.extend(faces)

    def object(self, name: str) -> bpy.types.Object:
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata(self._vertices, [], self._faces)
        mesh.update()
        obj = bpy.data.objects.new(name, mesh)
        bpy.context.collection.objects.link(obj)
        return obj

    def _vertex(self, point: int, height: float) -> int:
        key = (int(point), round(float(height), 9))
        if key not in self._levels:
            self._levels[key] = len(self._vertices)
            self._vertices.append((*map(float, self._plan[point]), float(height)))
        return self._levels[key]


def soften(obj: bpy.types.Object, passes: int) -> None:
    """Round all features: each pass moves every vertex to the mean of its neighbours."""
    mesh = obj.data
    positions = read_positions(mesh)
    edges = np.empty(2 * len(mesh.edges), dtype=np.int32)
    mesh.attributes[".edge_verts"].data.foreach_get("value", edges)
    a, b = edges.reshape(-1, 2).T
    degree = np.bincount(edges, minlength=len(positions))[:, None]
    for _ in range(passes):
        sums = np.zeros_like(positions)
        for axis in range(3):
            sums[:, axis] = np.bincount(a, positions[b, axis], len(positions)) + np.bincount(
                b, positions[a, axis], len(positions)
            )
        positions = sums / degree
    mesh.attributes["position"].data.foreach_set("vector", positions.astype(np.float32).ravel())
    mesh.update()


def read_positions(mesh: bpy.types.Mesh) -> Floats:
    """Vertex positions: (n, 3) float64."""
    values = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.attributes["position"].data.foreach_get("vector", values)
    return values.reshape(-1, 3).astype(np.float64)


def read_triangles(mesh: bpy.types.Mesh) -> npt.NDArray[np.int32]:
    """Vertex indices of the mesh's triangles: (m, 3)."""
    values = np.empty(3 * len(mesh.loop_triangles), dtype=np.int32)
    mesh.loop_triangles.foreach_get("vertices", values)
    return values.reshape(-1, 3)


def paint(obj: bpy.types.Object, name: str, passes: int) -> None:
    """Paint wavy bands of color, blurred by umbrella smoothing, as a color attribute."""
    x, _, z = read_positions(obj.data).T
    bands = np.floor(6 * z + 0.8 * np.sin(7 * x)).astype(int) % 3
    palette = np.array([[0.85, 0.25, 0.1], [0.95, 0.85, 0.6], [0.05, 0.25, 0.4]])
    mesh = core.TriangleMesh(read_positions(obj.data), read_triangles(obj.data))
    colors = calculus.smooth_vertices(mesh, palette[bands], passes)
    attribute = obj.data.color_attributes.new(name, "FLOAT_COLOR", "POINT")
    flat = np.ones((len(colors), 4), dtype=np.float32)
    flat[:, :3] = colors
    attribute.data.foreach_set("color", flat.reshape(-1))
    obj.data.color_attributes.active_color = attribute


def read_colors(mesh: bpy.types.Mesh, name: str) -> Floats:
    """Read a color attribute of the vertices: (n, 3)."""
    flat = np.empty(4 * len(mesh.vertices), dtype=np.float32)
    mesh.color_attributes[name].data.foreach_get("color", flat)
    return flat.reshape(-1, 4)[:, :3].astype(np.float64)
