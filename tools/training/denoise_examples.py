# SPDX-License-Identifier: GPL-3.0-or-later
"""Training examples for denoising: noisy and clean meshes with the true normals of their faces.

All are made from seeds. Angles and heights alone do not tell noise from relief: which of it is
removed depends on the shares of the kinds of examples, and on how high noise of each width may be.
"""

from __future__ import annotations

from typing import NamedTuple

import crease_examples
import numpy as np
import scipy.ndimage
from depth_cameras import fused, one_view, some_camera
from distances import (
    Floats,
    Solid,
    ball,
    blend,
    cylinder,
    gradient,
    greatest,
    grown,
    minus,
    nearest,
    norm,
    placed,
    polytope,
    torus,
    turn,
    union,
)
from distances import box as box_at
from even_meshes import even, halved, heights, wavy
from exports import exported
from meshings import EXTENT, marching_cubes, mean_edge, surface_nets, umbrella
from shock_filter import core

KINDS = {"clean": 0.12, "crisp": 0.06, "white": 0.21, "field": 0.23, "both": 0.04, "binary": 0.05,
         "range": 0.07, "low": 0.22}  # fmt: skip
"""Shares of the kinds. Solids meshed from voxels: without noise, with crisp edges, with white noise
of the vertices, with correlated noise of the voxels, with both, from voxels of 0 and 1, and as
depth cameras see them. "low": modelled, decimated, subdivided, uneven or coarse meshes, clean or
noisy."""

RELIEF = {"clean": 0.75, "crisp": 0.5, "white": 0.2, "field": 0.1, "both": 0.15, "binary": 0.05,
          "range": 0.12, "low": 0.05}  # fmt: skip
"""Share of the examples of each kind whose whole surface has waves."""

LOW = {"modelled": 0.4, "decimated": 0.28, "subdivided": 0.14, "uneven": 0.12, "even": 0.06}

UNTOUCHED, UNTOUCHED_FIGURES = 0.5, 0.65
"""Shares of meshes without noise: among the kinds of `LOW`, and among `figure`s."""

CAGES, UNTOUCHED_CAGES = {"modelled": 0.3, "decimated": 0.35, "subdivided": 0.35}, 0.6
"""Shares of the kinds among `cage`s; and the share of `cage` and `divided` without noise."""

UNTOUCHED_EXPORTS = 0.9
"""Share of `export`s without noise."""

FIGURES = {"scanned": 0.5, "sculpted": 0.4, "relief": 0.1}
"""Shares of the kinds among `figure`s; see `crease_examples`."""

DISPLACED = {"clean": 0.6, "white": 0.25, "wide": 0.15}
"""Shares among `displaced` meshes: without noise, with white noise, and with correlated noise."""

STEEP_FIRST, SHORT_FIRST, SCAN_FIRST = 1_000_000, 2_000_000, 3_000_000
"""First seeds of `steep`, `short` and `scan`; those of the other makers begin at 0."""

SCANNED_WAVES, FUSED = 0.15, 0.65
"""Share of the solids of `scan` whose whole surface has waves; share fused from several views."""


class Example(NamedTuple):
    """A mesh, the true normals (m, 3) of its faces, and its kind."""

    mesh: core.TriangleMesh
    truth: Floats
    kind: str


def example(seed: int, kind: str | None = None) -> Example:
    """Make a mesh of a random or a given kind from a seed."""
    rng = np.random.default_rng(seed)
    cells = int(np.exp(rng.uniform(np.log(34), np.log(72))))
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values()))) if kind is None else kind
    shape = solid(rng, cells, rng.random() < RELIEF[kind])
    if kind == "low":
        return _low(rng, shape, cells)
    if kind == "range":
        return _range_image(rng, shape, int(1.6 * cells))
    d, h = _grid(shape, cells)
    if kind in ("field", "both") or (kind == "binary" and rng.random() < 0.4):
        width = np.exp(rng.uniform(np.log(0.4), np.log(3.2)))
        noise = scipy.ndimage.gaussian_filter(rng.normal(size=d.shape), width)
        most = 0.6 * min(1.0, 0.85 / width) ** 0.9  # wide and high bumps count as relief
        d = d + np.exp(rng.uniform(np.log(0.03), np.log(most))) * h * noise / noise.std()
    if kind == "binary":
        d = np.where(d < 0, -1.0, 1.0)
        if rng.random() < 0.3:
            d = scipy.ndimage.gaussian_filter(d, rng.uniform(0.3, 0.9))
    v, f = _meshed(rng, d, h)
    if kind == "crisp" or (kind == "white" and rng.random() < 0.7):
        v = _crisp(rng, shape, v, f, h)
        truth = core.TriangleMesh(v, f).normals
    else:
        truth = gradient(shape, nearest(shape, v[f].mean(1), h))
    if kind == "white" and rng.random() < 0.4:  # faces of all sizes and shapes
        v, f = _thinned(v, f, 1 - rng.uniform(0.2, 0.85))
        truth = core.TriangleMesh(v, f).normals
    if kind in ("white", "both"):
        v = _moved(rng, v, f, truth)
    return Example(core.TriangleMesh(v, f), truth, kind)


def rough(seed: int) -> Example:
    """Make a solid with white noise at its vertices, another one than `example` does."""
    return example(10_000 + seed, "white")


def figure(seed: int) -> Example:
    """Make a sculpture with folds and ridges a few edges wide; most have no noise."""
    rng = np.random.default_rng(seed)
    how = str(rng.choice(list(FIGURES), p=list(FIGURES.values())))
    made = getattr(crease_examples, how)(int(rng.integers(1 << 40)))
    mesh, (truth, _) = made.mesh, made.targets(np.arange(made.mesh.face_count))
    if rng.random() < 0.35:  # faces of all sizes and shapes
        mesh = core.TriangleMesh(*_thinned(mesh.vertices, mesh.faces, rng.uniform(0.1, 0.8)))
        truth = mesh.normals
    if rng.random() < UNTOUCHED_FIGURES:
        return Example(mesh, truth, "figure")
    noisy = mesh.moved_to(_moved(rng, mesh.vertices, mesh.faces, truth))
    return Example(noisy, truth, "noisy figure")


def scan(seed: int) -> Example:
    """Scan a solid as depth cameras do: from one side, or fused from several into voxels."""
    rng = np.random.default_rng(SCAN_FIRST + seed)
    cells = int(np.exp(rng.uniform(np.log(48), np.log(96))))
    shape = solid(rng, cells, rng.random() < SCANNED_WAVES)
    camera = some_camera(rng)
    if rng.random() < FUSED:
        exact, h = _grid(shape, cells)
        d, known = fused(rng, shape, exact, h, camera)
        v, f = _meshed(rng, d, h)
        cell = np.clip(np.round((v + EXTENT) / h).astype(int), 0, cells - 1)
        f = f[known[tuple(cell.T)][f].all(1)]
    else:
        v, f, h = one_view(rng, shape, int(1.6 * cells), camera)
    near = abs(shape(v[f].mean(1))) < 2 * h  # without what is left floating
    used, f = np.unique(f[near], return_inverse=True)
    v, f = v[used], np.ascontiguousarray(f.reshape(-1, 3), np.int32)
    truth = gradient(shape, nearest(shape, v[f].mean(1), h))
    return Example(core.TriangleMesh(v, f), truth, "scan")


def cage(seed: int) -> Example:
    """Make a mesh of few faces, or one subdivided from few faces; most have no noise."""
    rng = np.random.default_rng(seed)
    how = str(rng.choice(list(CAGES), p=list(CAGES.values())))
    mesh = getattr(crease_examples, how)(int(rng.integers(1 << 40))).mesh
    v = mesh.vertices
    for _ in range(rng.integers(0, 3)):  # stretch and squeeze smoothly
        v = v + rng.uniform(0, 0.25) * np.sin(v @ rng.normal(size=(3, 3)) * 2)
    return _low_noisy(rng, v, mesh.faces, how, UNTOUCHED_CAGES, 0.01)


def divided(seed: int) -> Example:
    """Make a mesh of few faces, each divided into many in its plane; most have no noise."""
    rng = np.random.default_rng(seed)
    kind = rng.random()
    if kind < 0.4:
        v, f = _ring(rng)
    elif kind < 0.7:
        v, f = _turned(rng)
    else:
        how = str(rng.choice(["modelled", "decimated"]))
        mesh = getattr(crease_examples, how)(int(rng.integers(1 << 40))).mesh
        v, f = mesh.vertices, mesh.faces
    for _ in range(rng.integers(0, 4)):
        if len(f) < 1500:
            v, f = halved(v, f)
    return _low_noisy(rng, v, f, "divided", UNTOUCHED_CAGES, 0.01)


def displaced(seed: int, *relief) -> Example:
    """Make an even mesh with relief, its vertices moved along the normals; most have no noise.

    The relief is what `even_meshes.wavy` makes of `relief`; by default its waves have at least 4
    edges.
    """
    rng = np.random.default_rng(seed)
    v, f, n, edge = even(rng)
    v = v + heights(rng, v, edge, *(relief or (4,))) * n
    truth = core.TriangleMesh(v, f).normals
    kind = str(rng.choice(list(DISPLACED), p=list(DISPLACED.values())))
    if kind == "clean":
        return Example(core.TriangleMesh(v, f), truth, "displaced")
    if kind == "white":
        return Example(core.TriangleMesh(_moved(rng, v, f, truth), f), truth, "noisy displaced")
    passes = int(rng.integers(1, 12))
    noise = umbrella(rng.normal(size=(len(v), 1)), f, passes)
    width = 0.6 * np.sqrt(passes)
    most = 0.6 * min(1.0, 0.85 / width) ** 0.9  # wide and high bumps count as relief
    amount = np.exp(rng.uniform(np.log(0.03), np.log(most))) * edge
    v = v + amount * noise / noise.std() * n
    return Example(core.TriangleMesh(v, f), truth, "noisy displaced")


def steep(seed: int) -> Example:
    """Make an even mesh with relief steeper than 30 degrees; most have no noise."""
    return displaced(STEEP_FIRST + seed, 5, 40, 7, (0.6, 3), 8)


def short(seed: int) -> Example:
    """Make an even mesh with relief of 3.5 to 8 edges a wave; most have no noise."""
    return displaced(SHORT_FIRST + seed, 3.5, 8, 7)


def export(seed: int) -> Example:
    """Make a mesh with small details on large faces, like an export; most have no noise."""
    rng = np.random.default_rng(seed)
    return _low_noisy(rng, *exported(rng), "export", UNTOUCHED_EXPORTS, 0.01)


def drawn(seed: int) -> Example:
    """Make a mesh of few faces, like a hand-made one: a lathed body, or one of uneven quads."""
    rng = np.random.default_rng(seed)
    if rng.random() < 0.5:
        v, f = _turned(rng)
    else:
        shape = solid(rng, 60, False)
        d, h = _grid(shape, int(rng.integers(10, 26)))
        v, f = _meshed(rng, d, h)
        v = nearest(shape, v, h)
        for _ in range(rng.integers(0, 4)):  # stretch and squeeze smoothly
            v = v + rng.uniform(0, 0.25) * np.sin(v @ rng.normal(size=(3, 3)) * 2)
    return _low_noisy(rng, v, f, "drawn")


def solid(rng, cells: int, waves: bool) -> Solid:
    """Make a random solid in a box: simple parts joined, cut or blended, perhaps with waves."""
    organic = rng.random() < 0.45
    smooth = organic and rng.random() < 0.6  # without any crease
    shape = _primitive(rng, rng.uniform(1.2, 1.7), smooth)
    for _ in range(rng.integers(1, 7) if organic else rng.integers(0, 6)):
        at, size = rng.uniform(-0.75, 0.75, 3), rng.uniform(0.3, 1.1)
        q = turn(rng) if rng.random() < 0.5 else np.eye(3)
        part = placed(_primitive(rng, size, smooth), at, q)
        way = rng.choice(3, p=(0.25, 0.15, 0.6) if organic else (0.4, 0.5, 0.1))
        width = rng.uniform(0.1, 0.5 if smooth else 0.4)
        if smooth or way == 2:
            shape = blend(shape, part, width)
        else:
            shape = union(shape, part) if way == 0 else minus(shape, part)
    if waves:
        shape = _added(shape, wavy(rng, 2 * EXTENT / cells, 5))
    elif rng.random() < (0.3 if smooth else 0.7 if organic else 0.1):
        shape = _added(shape, _features(rng))
    whole, q = shape, turn(rng)
    return lambda p: np.maximum(whole(p @ q), greatest(abs(p)) - 1.35)


def _primitive(rng, size, smooth):
    # A random simple solid around the origin.
    a, b, c = rng.uniform(0.25, 0.65, 3) * size
    kind = rng.choice([2, 5, 5, 6]) if smooth else rng.integers(0, 8)
    if kind <= 2:  # a box, perhaps rounded
        share = rng.uniform(0.4, 0.95) if smooth else 0.0 if kind < 2 else rng.uniform(0.05, 0.45)
        r = share * min(a, b, c)
        return grown(box_at((0, 0, 0), np.array([a, b, c]) - r), r)
    if kind <= 4:
        return cylinder((0, 0, 0), a, b, slope=0.0 if kind == 3 else rng.uniform(0.1, 0.6))
    if kind == 5:
        return ball((0, 0, 0), a)
    return torus((0, 0, 0), 1.1 * a, 0.45 * a) if kind == 6 else polytope(rng, 0.5 * size)


def _added(shape, relief):
    return lambda p: shape(p) + relief(p)


def _features(rng):
    # Relief of power falling with frequency. Fine relief is local, unlike noise.
    local = rng.random() < 0.6
    waves = [(f, f * rng.normal(size=(5, 3)), rng.uniform(0, 6.3, 5)) for f in (3, 6, 10)]
    waves = waves[: 2 + local]
    high, where, off = rng.uniform(0.02, 0.12), 2.5 * rng.normal(size=3), rng.uniform(0, 6.3)

    def relief(p):
        gate = np.clip(0.5 + 2 * np.sin(p @ where + off), 0, 1) if local else 1
        return high * gate * sum(np.sin(p @ w.T + o).mean(1) / f**0.7 for f, w, o in waves)

    return relief


def _grid(shape, cells):
    line = np.linspace(-EXTENT, EXTENT, cells)
    p = np.stack(np.meshgrid(line, line, line, indexing="ij"), -1).reshape(-1, 3)
    return shape(p).reshape((cells,) * 3), line[1] - line[0]


def _meshed(rng, d, h):
    v, f = marching_cubes(d) if rng.random() < 0.3 else surface_nets(d)
    return v * h - EXTENT, f


def _crisp(rng, shape, v, f, h):
    # Makes faces even and moves edges onto the creases, as in meshes of design programs.
    for _ in range(rng.integers(2, 6)):
        v = nearest(shape, umbrella(v, f, 1, 0.7), h)
    mesh = core.TriangleMesh(v, f)
    for _ in range(2):
        normals = gradient(shape, nearest(shape, mesh.vertices[f].mean(1), h))
        settings = core.FitSettings(screening_radius=8.0)
        mesh = mesh.moved_to(core.fit_to_normals(mesh, normals, settings))
    return mesh.vertices


def _thinned(v, f, share):
    import fast_simplification  # only for this

    v, f = fast_simplification.simplify(v, f, target_reduction=1 - share)
    return np.asarray(v, float), np.ascontiguousarray(f, np.int32)


def _moved(rng, v, f, normals):
    # Adds white noise: in all directions or along the normals, of all or few vertices.
    amount = np.exp(rng.uniform(np.log(0.03), np.log(0.65))) * mean_edge(v, f)
    move = rng.normal(size=v.shape) * amount
    if rng.random() < 0.4:
        along = np.zeros_like(v)
        for k in range(3):
            np.add.at(along, f[:, k], normals)
        along /= np.maximum(norm(along), 1e-9)[:, None]
        move = rng.normal(size=(len(v), 1)) * amount * along
    if rng.random() < 0.2:
        share = rng.uniform(0.05, 0.7)
        move *= (rng.random(len(v)) < share)[:, None] * min(1.5, share**-0.5)
    return v + move


def _range_image(rng, shape, cells):
    # Depths along parallel rays, with noise, and mostly rounded to steps.
    line = (np.arange(cells) - cells / 2 + 0.5) * 2.6 / cells
    x, y = np.meshgrid(line, line, indexing="ij")
    z, hit, h = np.full(x.shape, 1.6), np.zeros(x.shape, bool), line[1] - line[0]
    for _ in range(60):
        d = shape(np.stack([x, y, z], -1).reshape(-1, 3)).reshape(x.shape)
        hit, z = abs(d) < 2e-3, z - np.maximum(d, 0) * 0.8
    width = rng.uniform(0, 3.5)
    amount = min(np.exp(rng.uniform(np.log(0.04), np.log(1.2))) * (width + 0.6), 1.6)
    noise = scipy.ndimage.gaussian_filter(rng.normal(size=x.shape), width)
    noisy = z + amount * h * noise / noise.std()
    if rng.random() < 0.8:
        step = amount * h * rng.choice([0.5, 1, 2, 3])
        noisy = step * np.round(noisy / step)
    at = np.arange(x.size).reshape(x.shape)
    a, b = at[:-1, :-1].reshape(-1), at[1:, :-1].reshape(-1)
    c, d = at[1:, 1:].reshape(-1), at[:-1, 1:].reshape(-1)
    f = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    f = f[hit.reshape(-1)[f].all(1) & (np.ptp(z.reshape(-1)[f], axis=1) < 3 * h)]
    used, f = np.unique(f, return_inverse=True)
    f = np.ascontiguousarray(f.reshape(-1, 3), np.int32)
    clean, spoilt = (np.stack([x, y, w], -1).reshape(-1, 3)[used] for w in (z, noisy))
    return Example(core.TriangleMesh(spoilt, f), core.TriangleMesh(clean, f).normals, "range")


def _low(rng, shape, cells):
    # A mesh of a kind in `LOW`, whose own normals without noise are the truth.
    how = str(rng.choice(list(LOW), p=list(LOW.values())))
    if how in ("modelled", "decimated", "subdivided"):
        mesh = getattr(crease_examples, how)(int(rng.integers(1 << 40))).mesh
        v, f = mesh.vertices, mesh.faces
    elif how == "uneven":
        v, f = _uneven(rng, shape, cells // 2)
    else:
        d, h = _grid(shape, max(cells // 3, 14))
        v, f = _meshed(rng, d, h)
        v = nearest(shape, v, h)
    return _low_noisy(rng, v, f, how)


def _low_noisy(rng, v, f, how, untouched=UNTOUCHED, least=0.05):
    # Cuts away a part of some meshes, and adds noise to some.
    if how != "even" and rng.random() < 0.3:  # a part is cut away
        d = v[f].mean(1) @ rng.normal(size=3)
        used, f = np.unique(f[d < np.quantile(d, rng.uniform(0.6, 0.97))], return_inverse=True)
        v, f = v[used], np.ascontiguousarray(f.reshape(-1, 3), np.int32)
    mesh = core.TriangleMesh(v, f)
    if rng.random() < untouched:
        return Example(mesh, mesh.normals, how)
    lengths = norm(v[f] - v[f[:, [1, 2, 0]]], 2)
    if (
        how in ("modelled", "drawn", "export") or rng.random() < 0.3
    ):  # noise relative to the shortest edge
        local = np.full(len(v), np.inf)
        for k in range(3):
            np.minimum.at(local, f[:, k], lengths.min(1))
    elif rng.random() < 0.5:  # relative to the mean edge around the vertex
        total, count = np.zeros(len(v)), np.zeros(len(v))
        for k in range(3):
            np.add.at(total, f[:, k], lengths.mean(1))
            np.add.at(count, f[:, k], 1)
        local = total / np.maximum(count, 1)
    else:
        local = np.full(len(v), lengths.mean())
    strong = rng.random() < 0.5
    amount = rng.uniform(0.1, 0.65) if strong else np.exp(rng.uniform(np.log(least), np.log(0.5)))
    move = amount * np.where(np.isfinite(local), local, 0)[:, None]
    noisy = core.TriangleMesh(v + rng.normal(size=v.shape) * move, f)
    return Example(noisy, mesh.normals, "noisy " + how)


def _uneven(rng, shape, cells):
    # Meshes a solid on a grid with uneven spacing.
    steps = scipy.ndimage.gaussian_filter(rng.normal(size=(3, cells)), (0, rng.uniform(0.3, 3)))
    lines = np.cumsum(np.exp(3 * rng.uniform(0.3, 1.2) * steps), axis=1)
    lines -= lines[:, :1]
    axes = [EXTENT * (2 * line / line[-1] - 1) for line in lines]
    p = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    v, f = surface_nets(shape(p).reshape((cells,) * 3))
    v = np.stack([np.interp(v[:, x], np.arange(cells), axes[x]) for x in range(3)], 1)
    return nearest(shape, v, 2 * EXTENT / cells), f


def _ring(rng):
    # A ring: a polygon rotated around an axis beside it.
    corners, sides = int(rng.integers(3, 8)), int(np.exp(rng.uniform(*np.log((5, 90)))))
    if rng.random() < 0.4:
        angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
    else:
        angle = 2 * np.pi * (np.arange(corners) + rng.random()) / corners
    size = rng.uniform(0.1, 0.6, 2)
    r, z = 1 + size[0] * np.cos(angle), size[1] * np.sin(angle)
    a = np.arange(sides) * 2 * np.pi / sides
    v = np.stack([r * np.cos(a)[:, None], r * np.sin(a)[:, None], 0 * a[:, None] + z], -1)
    i, j = np.mgrid[:sides, :corners]
    first = lambda x, y: ((x % sides) * corners + y % corners).reshape(-1)  # noqa: E731
    quads = first(i, j), first(i + 1, j), first(i + 1, j + 1), first(i, j + 1)
    f = np.concatenate([np.stack([quads[0], *quads[1:3]], 1), np.stack([quads[0], *quads[2:]], 1)])
    return v.reshape(-1, 3) * rng.uniform(0.5, 1.5, 3) @ turn(rng), f.astype(np.int32)


def _turned(rng):
    # Cones, cylinders, lathed bodies and balls of few rings, closed by fans, with long thin faces.
    sides, rings = (int(np.exp(rng.uniform(*np.log(ends)))) for ends in ((3, 70), (2, 30)))
    t, kind = np.linspace(0, 1, rings), rng.integers(0, 4)
    z = rng.uniform(0.1, 3) * t
    if kind == 0:
        r = rng.uniform(0.2, 1) + rng.uniform(-0.9, 1) * t * rng.choice([0, 1])
    elif kind == 1:
        r = 0.5 + 0.3 * np.sin(rng.uniform(2, 9) * t + rng.uniform(0, 6.3))
    elif kind == 2:
        r, z = rng.uniform(0.2, 1, rings), np.cumsum(rng.uniform(0, 0.4, rings))
    else:
        r, z = (
            0.5 * np.sin(np.pi * (t + 0.5 / rings) * rings / (rings + 1)),
            -0.5 * np.cos(np.pi * t),
        )
    a = np.arange(sides) * 2 * np.pi / sides
    ends = np.maximum(abs(r), 0.02)[:, None]
    v = np.stack([ends * np.cos(a), ends * np.sin(a), np.repeat(z[:, None], sides, 1)], -1)
    i, j = np.mgrid[: rings - 1, :sides]
    k, first = (j + 1) % sides, lambda x, y: (x * sides + y).reshape(-1)
    quads = first(i, j), first(i, k), first(i + 1, k), first(i + 1, j)
    f = np.concatenate([np.stack([quads[0], *quads[1:3]], 1), np.stack([quads[0], *quads[2:]], 1)])
    low, high = rng.choice([0.0, rng.uniform(0, 1.5)], 2)
    v = np.concatenate([v.reshape(-1, 3), [[0, 0, z[0] - low], [0, 0, z[-1] + high]]])
    here, top, n = np.arange(sides), (rings - 1) * sides, len(v)
    ahead, bottom, middle = (here + 1) % sides, np.full(sides, n - 2), np.full(sides, n - 1)
    fans = np.stack([ahead, here, bottom], 1), np.stack([here + top, ahead + top, middle], 1)
    f = np.concatenate([f, *fans])
    return v * rng.uniform(0.5, 1.5, 3) @ turn(rng), np.ascontiguousarray(f, np.int32)
