# SPDX-License-Identifier: GPL-3.0-or-later
"""Training examples for closing creases: meshes with the target normals of faces, made from seeds.

`remeshed` makes solids meshed from voxels, whose targets are the normals of the solid. `relief`,
`scanned`, `displaced`, `modelled` and others make surfaces that are right as they are: their
targets are their own normals.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.ndimage
from distances import Floats, Solid, gradient, greatest, nearest, norm, placed, truths, turn
from even_meshes import even, heights
from meshings import (
    EXTENT,
    RAISED,
    marching_cubes,
    mean_edge,
    preserved,
    renormalized,
    sampled,
    surface_nets,
    umbrella,
)
from scipy.spatial import ConvexHull, Delaunay
from shock_filter import core
from solids import KINDS, SHARES, part, smooth, solid, statue

Targets = Callable[[np.ndarray], tuple[Floats, Floats]]

MESHINGS = "nets", "cubes", "blurred", "crisp", "softened", "uneven"
HOW_OFTEN = 0.44, 0.18, 0.14, 0.07, 0.08, 0.09


@dataclass
class Example:
    """A mesh with its target normals, and how it was made.

    Attributes
    ----------
    mesh : TriangleMesh
    targets : callable
        Returns the target normals of some faces, given by index: two for each, either is right.
    kind, how : str
        Kind of the solid or surface, and how it was meshed.
    solid, spacing
        The signed distance function of the solid and the width of its voxels, if there is one.
    """

    mesh: core.TriangleMesh
    targets: Targets
    kind: str
    how: str
    solid: Solid | None = None
    spacing: float = 0.0


def remeshed(
    seed, kinds=None, meshings=None, cells=None, noise=None, closer: float = 1.0
) -> Example:
    """Make a solid meshed from voxels.

    `cells` is the number of voxels along each side, or its range. With `closer` above 1, half of
    the examples are parts of solids that are larger by up to this factor.
    """
    rng = np.random.default_rng(seed)
    kind = str(rng.choice(KINDS, p=SHARES) if kinds is None else rng.choice(kinds))
    fewest, most = (30, 105) if cells is None else (cells, cells) if np.isscalar(cells) else cells
    n = int(np.exp(rng.uniform(np.log(fewest), np.log(most))))
    h = 2 * EXTENT / (n - 1)
    times = np.exp(rng.uniform(0, np.log(closer))) if closer > 1 and rng.random() < 0.5 else 1.0
    shape = solid(rng, kind, h / times)
    if times > 1:
        shape = _seen_closer(rng, shape, times)
    how = str(rng.choice(MESHINGS, p=HOW_OFTEN) if meshings is None else rng.choice(meshings))
    amount = (rng.uniform(0, 0.05) if rng.random() < 0.35 else 0.0) if noise is None else noise
    d = sampled(shape, n)
    if how == "blurred":
        d = scipy.ndimage.gaussian_filter(d, rng.uniform(0.4, 1.6))
    elif how in ("voxels", "preserved"):
        d = renormalized(d, h) - (RAISED * h if how == "preserved" else 0.0)
    if amount and rng.random() < 0.6:
        x = scipy.ndimage.gaussian_filter(rng.normal(size=d.shape), rng.uniform(0.5, 2.0))
        d, amount = d + amount * h * x / x.std(), 0.0
    cubes = how == "cubes" or (how in ("blurred", "softened") and rng.random() < 0.3)
    v, f = marching_cubes(d) if cubes else surface_nets(d)
    v = v * h - EXTENT
    if how == "voxels" and rng.random() < 0.15:  # as a shrinkwrap does
        v = nearest(shape, v, h)
    elif how == "preserved":
        v = preserved(shape, v, f, h)
    edge = mean_edge(v, f)
    if how == "uneven" or (how in ("crisp", "softened") and rng.random() < 0.6):
        v = _scattered(rng, v, f, edge, shape, h)
    if how == "uneven":
        v = umbrella(v, f, int(rng.integers(0, 3)), 0.5)
    elif how in ("crisp", "softened"):
        v = _crisp_again(v, f, shape, h)
    centres = v[f].mean(1)
    if how == "softened":
        v = umbrella(v, f, int(np.exp(rng.uniform(0, np.log(14)))))
    if amount:
        v = v + rng.normal(size=v.shape) * amount * edge
    mesh = core.TriangleMesh(v, f)
    targets = lambda rows: truths(shape, centres[rows], mesh.normals[rows], edge, h)  # noqa: E731
    return Example(mesh, targets, kind, how, shape, h)


def _seen_closer(rng, shape: Solid, times: float) -> Solid:
    # Scales a solid up around a point of its surface, and cuts it at the border of the grid.
    at = nearest(shape, rng.uniform(-0.8, 0.8, (1, 3)), 1.0, 8)

    def distance(p):
        return np.maximum(times * shape(p / times + at), greatest(abs(p)) - 1.38)

    return distance


def relief(seed) -> Example:
    """Make a statue, alone or on a part, with relief as fine as its faces, which must stay."""
    rng = np.random.default_rng(seed)
    on, base = statue(rng, np.zeros(3), rng.uniform(0.7, 1.1)), None
    if rng.random() < 0.4:
        base = placed(part(rng, int(rng.integers(0, 3))), np.array([0, 0, -0.8]), np.eye(3))
    v, f, shape, h, q = _net(rng, on, base, (34, 100))
    edge = mean_edge(v, f)
    if rng.random() < 0.5:  # faces as scans and remeshers of triangles have them
        v = _scattered(rng, v, f, edge, shape, h)
    centres = v[f].mean(1)
    high = np.zeros((len(v), 1))
    for _ in range(rng.integers(1, 4)):
        x = umbrella(rng.normal(size=(len(v), 1)), f, int(rng.integers(1, 9)))
        x /= x.std()
        if rng.random() < 0.4:
            x = 0.8 - abs(x) if rng.random() < 0.5 else np.maximum(x, 0.3)
        high += x * np.exp(rng.uniform(np.log(0.05), np.log(0.45)))
    if base is not None:
        high *= (on(v @ q) < base(v @ q) - 2 * h)[:, None]
    if rng.random() < 0.15:
        high *= 0
    mesh = core.TriangleMesh(v + high * edge * gradient(shape, v), f)
    still = (abs(high[f]).max(1) > 0).reshape(-1) if base is not None else np.ones(len(f), bool)

    def targets(rows):
        one, two = truths(shape, centres[rows], mesh.normals[rows], edge, h)
        own = still[rows]
        one[own] = two[own] = mesh.normals[rows[own]]
        return one, two

    return Example(mesh, targets, "relief", "relief", shape, h)


def scanned(seed) -> Example:
    """Make a sculpture with folds, ridges and waves wider than its faces, like a scan."""
    rng = np.random.default_rng(seed)
    on = statue(rng, np.zeros(3), 0.9) if rng.random() < 0.7 else smooth(rng, 0.03)
    v, f, shape, h, _ = _net(rng, on, None, (40, 100))
    edge = mean_edge(v, f)
    if rng.random() < 0.75:
        v = _scattered(rng, v, f, edge, shape, h)
    normals = gradient(shape, v)
    for _ in range(rng.integers(1, 6)):
        length = edge * np.exp(rng.uniform(np.log(4), np.log(40)))  # wavelength
        bend = rng.uniform(0, 0.5) * length * np.sin(v @ rng.normal(size=(3, 3)) / length)
        phase = (v + bend) @ _unit(rng) * 2 * np.pi / length + rng.uniform(0, 6.3)
        kind = rng.random()
        wave = (
            np.sin(phase)
            if kind < 0.3
            else 1 - 2 * abs(np.sin(phase / 2)) ** rng.uniform(0.6, 1.5)
            if kind < 0.8
            else np.tanh(np.sin(phase) * rng.uniform(1, 5))
        )
        where = 1 / (1 + np.exp(-rng.uniform(2, 8) * (v @ _unit(rng) - rng.uniform(-0.7, 0.7))))
        sign = 1 if rng.random() < 0.5 else -1
        v = v + (sign * rng.uniform(0.01, 0.14) * length * wave * where)[:, None] * normals
    v = umbrella(v, f, int(rng.integers(0, 9)), 0.5)
    if rng.random() < 0.4:
        v = v + rng.normal(size=v.shape) * edge * rng.uniform(0, 0.03)
    return as_it_is(core.TriangleMesh(v, f), "scanned", "scanned")


def sculpted(seed) -> Example:
    """Make a gentle sculpture: wide forms, some fine and rounded features, hardly any noise."""
    rng = np.random.default_rng(seed)
    on = statue(rng, np.zeros(3), 0.9) if rng.random() < 0.5 else smooth(rng, 0.03)
    cut = rng.random() < 0.35  # each face is divided into four in its plane
    v, f, shape, h, _ = _net(rng, on, None, (30, 80) if cut else (56, 150))
    edge = mean_edge(v, f)
    if rng.random() < 0.8:
        v = _scattered(rng, v, f, edge, shape, h)
    normals = gradient(shape, v)
    for _ in range(rng.integers(2, 9)):
        length = edge * np.exp(rng.uniform(np.log(6), np.log(70)))
        bend = rng.uniform(0, 0.8) * length * np.sin(v @ rng.normal(size=(3, 3)) / length)
        phase = (v + bend) @ _unit(rng) * 2 * np.pi / length + rng.uniform(0, 6.3)
        wave = (
            np.sin(phase)
            if rng.random() < 0.4
            else 1 - 2 * abs(np.sin(phase / 2)) ** rng.uniform(0.6, 1.6)
            if rng.random() < 0.7
            else np.tanh(np.sin(phase) * rng.uniform(1, 6))
        )
        centre, wide = v[rng.integers(0, len(v))], rng.uniform(0.1, 1.5)
        where = np.exp(-0.5 * ((v - centre) ** 2).sum(1) / wide**2)
        high = np.exp(rng.uniform(np.log(0.004), np.log(0.1))) * length
        v = v + (rng.choice([-1, 1]) * high * wave * where)[:, None] * normals
    v = umbrella(v, f, int(rng.integers(0, 13)), 0.5)
    if rng.random() < 0.7:
        x = umbrella(rng.normal(size=(len(v), 1)), f, int(rng.integers(0, 4)))
        v = v + x / x.std() * edge * rng.uniform(0, 0.05) * normals
    if cut:
        v, f = _subdivided(v, f, crisp=True)
    return as_it_is(core.TriangleMesh(v, f), "sculpted", "sculpted")


def modelled(seed) -> Example:
    """Make clean meshes as people and programs model them: coarse round parts, bevels, grids."""
    rng = np.random.default_rng(seed)
    pieces = []
    for i in range(int(rng.integers(1, 7))):
        v, f = _PIECES[rng.integers(0, len(_PIECES))](rng)
        v = v * rng.uniform(0.5, 1.5, 3) @ turn(rng) * np.exp(rng.uniform(-0.7, 0.7))
        if len(f) < 5000 and rng.random() < 0.15:
            v, f = _subdivided(v, f, crisp=True)
        pieces.append((v + 5.0 * i, f))
    first = np.cumsum([0, *(len(v) for v, _ in pieces)])
    vertices = np.concatenate([v for v, _ in pieces])
    faces = np.concatenate([f + k for (_, f), k in zip(pieces, first[:-1], strict=True)])
    return as_it_is(core.TriangleMesh(vertices, faces), "modelled", "modelled")


def decimated(seed) -> Example:
    """Make statues and crisp parts, decimated to few faces as in game models."""
    import fast_simplification  # only for this

    rng = np.random.default_rng(seed)
    kind = str(rng.choice(["statue", "smooth", "plinth", "part", "filleted"],
                          p=[0.4, 0.2, 0.1, 0.15, 0.15]))  # fmt: skip
    n = int(np.exp(rng.uniform(np.log(28), np.log(72))))
    h = 2 * EXTENT / (n - 1)
    shape = solid(rng, kind, h)
    d = sampled(shape, n)
    v, f = marching_cubes(d) if rng.random() < 0.3 else surface_nets(d)
    v = v * h - EXTENT
    if kind in ("part", "filleted") or rng.random() < 0.3:
        v = _crisp_again(v, f, shape, h)
    else:
        v = umbrella(v, f, int(rng.integers(0, 6)), 0.5)
    count = int(np.exp(rng.uniform(np.log(80), np.log(4000))))
    if count < len(f):
        v, f = fast_simplification.simplify(v, f, target_count=count)
    if rng.random() < 0.3:
        v = umbrella(np.asarray(v, float), f, 1, rng.uniform(0.1, 0.5))
    return as_it_is(core.TriangleMesh(v, f), "decimated", kind)


def subdivided(seed) -> Example:
    """Make subdivided cages of some hundred faces, as in models for animation."""
    import fast_simplification  # only for this and `decimated`

    rng = np.random.default_rng(seed)
    kind = str(rng.choice(["statue", "smooth", "part", "filleted"], p=[0.4, 0.2, 0.2, 0.2]))
    h = 2 * EXTENT / 39
    shape = solid(rng, kind, h)
    v, f = surface_nets(sampled(shape, 40))
    v = umbrella(v * h - EXTENT, f, int(rng.integers(0, 4)), 0.5)
    count = int(np.exp(rng.uniform(np.log(60), np.log(900))))
    v, f = fast_simplification.simplify(v, f, target_count=count)
    v, f = np.asarray(v, float), np.asarray(f)
    for _ in range(rng.integers(1, 4 if count < 300 else 3)):
        v, f = _subdivided(v, f, crisp=rng.random() < 0.1)
    return as_it_is(core.TriangleMesh(v, f), "subdivided", kind)


def displaced(seed) -> Example:
    """Make relief with waves of few edge lengths on an even mesh, with hardly any or no noise."""
    rng = np.random.default_rng(seed)
    v, f, n, edge = even(rng)
    v = v + heights(rng, v, edge, 2.2, 20, 7) * n
    if rng.random() < 0.3:
        v = v + rng.normal(size=v.shape) * edge * rng.uniform(0, 0.03)
    return as_it_is(core.TriangleMesh(v, f), "displaced", "displaced")


def softened(seed) -> Example:
    """Make crisp meshes of even faces, smoothed in part or all; targets are the crisp normals."""
    rng = np.random.default_rng(seed)
    v, f = _CRISP[rng.integers(0, len(_CRISP))](rng)
    v = v * rng.uniform(0.7, 1.3, 3) @ turn(rng)
    clean = core.TriangleMesh(v, f)
    soft = umbrella(v, f, int(np.exp(rng.uniform(0, np.log(9)))), rng.uniform(0.5, 1.0))
    if rng.random() < 0.4:
        where = v @ _unit(rng) - np.quantile(v @ _unit(rng), rng.uniform(0.1, 0.9))
        soft = np.where((where > 0)[:, None], soft, v)
    if rng.random() < 0.2:
        soft = soft + rng.normal(size=v.shape) * mean_edge(v, f) * rng.uniform(0, 0.03)
    targets = lambda rows: (clean.normals[rows], clean.normals[rows])  # noqa: E731
    return Example(core.TriangleMesh(soft, f), targets, "softened", "softened")


def _crisp_again(v, f, shape, h):
    mesh = core.TriangleMesh(v, f)
    for _ in range(3):
        normals = gradient(shape, nearest(shape, mesh.vertices[f].mean(1), h))
        settings = core.FitSettings(screening_radius=8.0)
        mesh = mesh.moved_to(core.fit_to_normals(mesh, normals, settings))
    return mesh.vertices


def as_it_is(mesh, kind, how) -> Example:
    """Make an example whose targets are the mesh's own normals."""
    return Example(mesh, lambda rows: (mesh.normals[rows], mesh.normals[rows]), kind, how)


def _unit(rng):
    x = rng.normal(size=3)
    return x / np.linalg.norm(x)


def _scattered(rng, v, f, edge, shape, h):
    # Makes faces uneven in shape and size, with vertices on the solid.
    for _ in range(rng.integers(1, 4)):
        v = v + rng.normal(size=v.shape) * edge * rng.uniform(0.05, 0.3)
        v = nearest(shape, umbrella(v, f, 1, 0.5), h, 2)
    return v


def _net(rng, on, base, cells):
    # Meshes a statue, which may stand on a base, in a random rotation.
    n = int(np.exp(rng.uniform(*np.log(cells))))
    h, q = 2 * EXTENT / (n - 1), turn(rng)
    both = on if base is None else lambda p: np.minimum(on(p), base(p))
    shape = lambda p: np.maximum(both(p @ q), greatest(abs(p)) - 1.38)  # noqa: E731
    d = sampled(shape, n)
    v, f = marching_cubes(d) if rng.random() < 0.3 else surface_nets(d)
    return v * h - EXTENT, f, shape, h, q


def _grid_faces(rows, columns, closed_rows=False, closed_columns=False):
    r, c = np.arange(rows if closed_rows else rows - 1), columns if closed_columns else columns - 1
    a = (r[:, None] * columns + np.arange(c)).reshape(-1)
    i, j = np.divmod(a, columns)
    down, right = (i + 1) % rows, (j + 1) % columns
    b, d, e = down * columns + j, i * columns + right, down * columns + right
    return np.concatenate([np.stack([a, b, e], 1), np.stack([a, e, d], 1)])


def _profile(rng):
    # A plane curve: straight runs and arcs of few segments, some corners beveled.
    n = int(rng.integers(3, 9))
    x = np.stack([rng.uniform(0.3, 1.0, n), np.sort(rng.uniform(-1, 1, n))], 1)
    if rng.random() < 0.6:  # bevels of one to four segments
        pieces, width = int(rng.integers(1, 5)), rng.uniform(0.02, 0.3)
        points = [x[:1]]
        for a, b, c in zip(x, x[1:], x[2:], strict=False):
            t = np.linspace(0, 1, pieces + 1)[:, None]
            p, q = b + width * (a - b), b + width * (c - b)
            points.append((1 - t) ** 2 * p + 2 * t * (1 - t) * b + t**2 * q)
        x = np.concatenate([*points, x[-1:]])
    elif rng.random() < 0.5:  # a smooth curve
        t = np.linspace(0, n - 1, int(rng.integers(10, 60)))
        x = np.stack([scipy.ndimage.gaussian_filter1d(np.interp(t, np.arange(n), k), 2.0)
                      for k in x.T], 1)  # fmt: skip
    if rng.random() < 0.6:  # even faces
        step = np.exp(rng.uniform(np.log(0.02), np.log(0.3)))
        pieces = [np.linspace(a, b, max(int(np.linalg.norm(b - a) / step), 1), endpoint=False)
                  for a, b in pairwise(x)]  # fmt: skip
        x = np.concatenate([*pieces, x[-1:]])
    return x


def _lathe(rng):
    x, n = _profile(rng), int(np.exp(rng.uniform(np.log(8), np.log(100))))
    a = np.arange(n) * 2 * np.pi / n
    v = np.stack([x[:, :1] * np.cos(a), x[:, :1] * np.sin(a), np.repeat(x[:, 1:], n, 1)], -1)
    return v.reshape(-1, 3), _grid_faces(len(x), n, False, True)


def _extruded(rng):
    x, n = _profile(rng), int(rng.integers(2, 40))
    t = np.linspace(-1, 1, n)
    bend = rng.uniform(0, 0.6) * np.sin(rng.uniform(0.5, 3) * t)
    v = np.stack([x[:, :1] + bend, np.repeat(x[:, 1:], n, 1), np.repeat(t[None], len(x), 0)], -1)
    return v.reshape(-1, 3), _grid_faces(len(x), n)


def _terrain(rng):
    n, m = rng.integers(12, 90, 2)
    x, y = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, m), indexing="ij")
    z = np.zeros(x.shape)
    for high in rng.uniform(0, 0.15, 4):
        k, j = rng.normal(size=2) * 8
        z += high * np.sin(x * k + y * j + rng.uniform(0, 6))
    return np.stack([x, y, z], -1).reshape(-1, 3), _grid_faces(n, m)


def _torus(rng):
    n, m = np.exp(rng.uniform(np.log(8), np.log(90), 2)).astype(int)
    a, b = np.arange(n)[:, None] * 2 * np.pi / n, np.arange(m) * 2 * np.pi / m
    r = rng.uniform(0.15, 0.7) * (1 + rng.uniform(0, 0.3) * np.cos(rng.integers(1, 6) * a))
    v = [(1 + r * np.cos(b)) * np.cos(a), (1 + r * np.cos(b)) * np.sin(a), r * np.sin(b) + 0 * a]
    return np.stack(v, -1).reshape(-1, 3), _grid_faces(n, m, True, True)


def _figure(rng):
    # A subdivided cage of some dozen vertices, as in models for animation.
    points = rng.normal(size=(rng.integers(8, 60), 3))
    points /= norm(points)[:, None]
    f = ConvexHull(points).simplices
    f = _outward(points, f)
    v = points * np.exp(rng.normal(size=(len(points), 1)) * rng.uniform(0, 0.45))
    for _ in range(rng.integers(1, 5 if len(points) < 30 else 4)):
        v, f = _subdivided(v, f, crisp=False)
    return v, f


def _few_faces(rng):
    # Eyes, knobs, wheels and tubes: balls, cones and rings of some dozen faces, open or closed.
    n, m = int(rng.integers(5, 25)), int(rng.integers(2, 13))
    a = np.arange(n) * 2 * np.pi / n
    if rng.random() < 0.5:
        t = np.linspace(rng.uniform(0.05, 1.0), rng.uniform(1.6, 3.1), m)
        x = np.stack([np.sin(t), -np.cos(t)], 1)
    else:
        x = np.stack([rng.uniform(0.3, 1.0, m), np.linspace(-1, 1, m)], 1)
    v = np.stack([x[:, :1] * np.cos(a), x[:, :1] * np.sin(a), np.repeat(x[:, 1:], n, 1)], -1)
    v, f = v.reshape(-1, 3), _grid_faces(m, n, False, True)
    around = np.arange(n)
    for row, up in ((0, x[0, 1]), (m - 1, x[-1, 1])):
        if rng.random() < 0.5:  # closed by a fan
            fan = np.stack([row * n + around, row * n + (around + 1) % n, np.full(n, len(v))], 1)
            bulge = 0.3 * rng.uniform(0, 1) * np.sign(row - 0.5)
            v = np.concatenate([v, [[0, 0, up + bulge]]])
            f = np.concatenate([f, fan if row else fan[:, ::-1]])
    return v, f


def _panel(rng):
    # A bent sheet with an outline and holes, triangulated from its borders and a few inner points,
    # like body panels and exports of design programs.
    count = int(np.exp(rng.uniform(np.log(12), np.log(70))))
    a = np.arange(count) * 2 * np.pi / count
    square = 1 / np.maximum(abs(np.cos(a)), abs(np.sin(a))) ** rng.uniform(0, 1)
    borders = [square[:, None] * np.stack([np.cos(a), np.sin(a)], 1)]
    for _ in range(rng.integers(0, 4)):
        k = int(rng.integers(6, 24))
        b, radius = np.arange(k) * 2 * np.pi / k, rng.uniform(0.08, 0.3)
        borders.append(rng.uniform(-0.5, 0.5, 2) + radius * np.stack([np.cos(b), np.sin(b)], 1))
    inner = rng.uniform(-0.7, 0.7, (int(np.exp(rng.uniform(0, np.log(300)))), 2))
    x = np.concatenate([*borders, inner])
    x = x + rng.normal(size=x.shape) * 1e-4
    f = Delaunay(x).simplices
    middle = x[f].mean(1)
    outside = np.zeros(len(f), bool)
    for border in borders[1:]:
        outside |= norm(middle - border.mean(0)) < norm(border[:1] - border.mean(0))
    f = f[~outside]
    a, b, c = (x[f[:, k]] for k in range(3))
    wound = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    f = np.where((wound < 0)[:, None], f[:, ::-1], f)
    z = np.zeros(len(x))
    for _ in range(rng.integers(1, 5)):
        along = x @ rng.normal(size=2) + rng.uniform(-0.5, 0.5)
        bend = rng.choice(["bow", "fold", "round"])
        if bend == "bow":
            z += rng.uniform(-0.4, 0.4) * along**2
        elif bend == "fold":
            z += rng.uniform(-1, 1) * np.maximum(along, 0)
        else:
            z += rng.uniform(-0.5, 0.5) * np.sqrt(along**2 + rng.uniform(0.02, 0.3) ** 2)
    return np.concatenate([x, z[:, None]], 1), f


def _plate(rng):
    # An extruded outline with holes: flat caps and walls, both of long triangles.
    v, f = _panel(rng)
    low, high = v * (1, 1, 0), v * (1, 1, 0) + (0, 0, rng.uniform(0.05, 1.0))
    ends = np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]])
    known = {tuple(e) for e in ends.tolist()}
    rim = np.array([e for e in ends.tolist() if (e[1], e[0]) not in known])
    n = len(v)
    walls = np.concatenate([np.stack([rim[:, 1], rim[:, 0], rim[:, 0] + n], 1),
                            np.stack([rim[:, 1], rim[:, 0] + n, rim[:, 1] + n], 1)])  # fmt: skip
    return np.concatenate([low, high]), np.concatenate([f[:, ::-1], f + n, walls[:, ::-1]])


def _horn(rng):
    # A profile swept along a bent line with changing size and uneven rows, then subdivided: horns,
    # claws, teeth, straps.
    n, m = int(rng.integers(4, 14)), int(rng.integers(4, 18))
    a = np.arange(n) * 2 * np.pi / n
    t = np.cumsum(rng.uniform(0.1, 1, m) ** rng.uniform(0, 3))
    t = t / t[-1]
    ring = 1 + rng.uniform(0, 0.7) * np.cos(rng.integers(1, 5) * a)
    size = (1 - t) ** rng.uniform(0, 1) * (1 + rng.uniform(0, 0.5) * rng.normal(size=m)) + 0.02
    wind, tilt = rng.uniform(0, 6), rng.uniform(0, 2)
    line = np.stack([np.cos(wind * t), np.sin(wind * t), tilt * t * 2], 1)
    side = line * (1, 1, 0)
    out = 0.35 * size[:, None] * ring
    v = (line[:, None] + (out * np.cos(a))[..., None] * side[:, None]
         + (out * np.sin(a))[..., None] * np.array([0, 0, 1.0]))  # fmt: skip
    v, f = v.reshape(-1, 3), _grid_faces(m, n, False, True)
    for _ in range(rng.integers(0, 4)):
        v, f = _subdivided(v, f, crisp=rng.random() < 0.1)
    return v, f


def _low_poly(rng):
    # A rough ball of which all edges are creases; some are subdivided once in place.
    points = rng.normal(size=(rng.integers(60, 700), 3))
    points /= norm(points)[:, None]
    f = _outward(points, ConvexHull(points).simplices)
    v = points * np.exp(rng.normal(size=(len(points), 1)) * rng.uniform(0, 0.25))
    return _subdivided(v, f, crisp=True) if rng.random() < 0.3 else (v, f)


def _outward(points, f):
    a, b, c = (points[f[:, k]] for k in range(3))
    wound = np.einsum("fx,fx->f", np.cross(b - a, c - a), a)
    return np.where((wound < 0)[:, None], f[:, ::-1], f)


def _subdivided(v, f, crisp):
    """Divide each face into four; unless `crisp`, smooth nearly as Loop subdivision does."""
    ends = np.sort(np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]), 1)
    unique, number = np.unique(ends, axis=0, return_inverse=True)
    a, b, c = number.reshape(3, -1) + len(v)
    middle = v[unique].mean(1)
    faces = np.concatenate([np.stack([f[:, 0], a, c], 1), np.stack([a, f[:, 1], b], 1),
                            np.stack([c, b, f[:, 2]], 1), np.stack([a, b, c], 1)])  # fmt: skip
    v = np.concatenate([v, middle])
    return (v if crisp else umbrella(v, faces, 1, 0.75)), faces


def _blocks(rng):
    # Boxes with even or uneven grids; sharp, or with one bevel.
    n = rng.integers(2, 14, 3)
    lines = [np.cumsum(rng.uniform(0.2, 1, k + 1) if rng.random() < 0.5 else np.ones(k + 1))
             for k in n]  # fmt: skip
    if rng.random() < 0.5:
        lines = [np.concatenate([x[:1] - rng.uniform(0.05, 0.3), x]) for x in lines]
    return _box_of(lines)


def _box_of(lines):
    # A box with grid lines at these coordinates.
    pieces, first = [], 0
    faces = []
    for axis in range(3):
        x, y = lines[(axis + 1) % 3], lines[(axis + 2) % 3]
        for side in (0, -1):
            v = np.empty((len(x), len(y), 3))
            v[..., (axis + 1) % 3], v[..., (axis + 2) % 3] = np.meshgrid(x, y, indexing="ij")
            v[..., axis] = lines[axis][side]
            g = _grid_faces(len(x), len(y))
            faces.append((g if side == -1 else g[:, ::-1]) + first)
            pieces.append(v.reshape(-1, 3))
            first += v[..., 0].size
    v, number = np.unique(np.concatenate(pieces).round(9), axis=0, return_inverse=True)
    return v / abs(v).max(), number.reshape(-1)[np.concatenate(faces)]


def _even_block(rng):
    n = rng.integers(8, 45, 3)
    lines = [np.arange(k + 1.0) for k in n]
    return _box_of(lines)


def _stairs(rng):
    # A profile of straight runs, extruded along an axis, with an even grid.
    runs = rng.integers(4, 16, rng.integers(2, 7))
    ways = np.cumsum(rng.choice([-1, 1], len(runs)) * np.radians(rng.uniform(30, 100, len(runs))))
    steps = np.concatenate([[np.zeros(2)], np.repeat(
        np.stack([np.cos(ways), np.sin(ways)], 1), runs, axis=0)])  # fmt: skip
    x, n = np.cumsum(steps, 0), int(rng.integers(12, 50))
    t = np.arange(n) * rng.uniform(0.8, 1.2)
    bend = rng.uniform(0, 0.02) * t**2
    v = np.stack([x[:, :1] + bend, np.repeat(x[:, 1:], n, 1), np.repeat(t[None], len(x), 0)], -1)
    return v.reshape(-1, 3), _grid_faces(len(x), n)


def _roof(rng):
    # A sheet with an uneven grid whose creases do not follow the edges.
    n, ridge, slope = int(rng.integers(16, 60)), rng.uniform(5, 15), rng.uniform(0, 0.5)
    x, y = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    x, y = (k + rng.uniform(-0.3, 0.3, k.shape) for k in (x, y))
    across = (x + slope * y) % (2 * ridge) - ridge
    z = rng.uniform(0, 0.03) * (y - n / 2) ** 2 - rng.uniform(0.4, 1.2) * abs(across)
    return np.stack([x, y, z], -1).reshape(-1, 3), _grid_faces(n, n)


def _faceted_ball(rng):
    # A shape between ball and polytope, whose faces do not follow the creases.
    n = int(np.exp(rng.uniform(np.log(700), np.log(12000))))
    k = np.arange(n) + 0.5
    up, around = 1 - 2 * k / n, np.pi * (1 + 5**0.5) * k
    points = np.stack([np.cos(around), np.sin(around)], 1) * np.sqrt(1 - up**2)[:, None]
    points = np.concatenate([points, up[:, None]], 1)
    f = _outward(points, ConvexHull(points).simplices)
    ways = np.concatenate([np.eye(3), -np.eye(3)])
    if rng.random() < 0.5:
        ways = np.array([_unit(rng) for _ in range(rng.integers(5, 12))])
    gauge = np.maximum((points @ ways.T).max(1), 0.4)
    return points / gauge[:, None] ** rng.uniform(0.4, 1.0), f


_CRISP = _even_block, _even_block, _stairs, _roof, _roof, _faceted_ball
_PIECES = (_lathe, _lathe, _extruded, _terrain, _torus, _figure, _figure, _blocks, _low_poly,
           _few_faces, _few_faces, _panel, _panel, _plate, _horn, _horn)  # fmt: skip
