# SPDX-License-Identifier: GPL-3.0-or-later
"""Examples for training to sharpen vertex colors: pictures of `image_examples` on flat meshes.

Each picture is sampled at the vertices of a mesh made from the same seed, and degraded: blurred
before sampling, smoothed from vertex to vertex, or interpolated from fewer vertices; then noise may
be added.
"""

from __future__ import annotations

import numpy as np
from image_examples import truth
from scipy import ndimage
from scipy.interpolate import LinearNDInterpolator
from scipy.sparse import csr_matrix, diags_array
from scipy.spatial import Delaunay, cKDTree

SIDE = 92
"""Number of vertices along a side of a mesh."""

SPOILED = 3
"""Number of degraded copies of each picture."""


def regular(random):
    y, x = np.mgrid[:SIDE, :SIDE]
    places = np.stack([x.ravel(), y.ravel()], 1).astype(float)
    a = (SIDE * y + x)[:-1, :-1].ravel()
    b, c, d = a + 1, a + SIDE + 1, a + SIDE
    kind = random.integers(3)
    one = [np.zeros(len(a), bool), random.random(len(a)) < 0.5, (x + y)[:-1, :-1].ravel() % 2 > 0]
    turned = one[kind][:, None]
    faces = np.concatenate([
        np.where(turned, np.stack([a, b, d], 1), np.stack([a, b, c], 1)),
        np.where(turned, np.stack([b, c, d], 1), np.stack([a, c, d], 1)),
    ])  # fmt: skip
    return places, faces


def jittered(random):
    places = regular(random)[0]
    return joined(places + random.uniform(0.05, 0.48) * random.uniform(-1, 1, places.shape))


def scattered(random):
    """Random points, some with a least distance between them."""
    least = random.uniform(0, 0.75)
    places = random.uniform(0, SIDE, ((2 if least < 0.5 else 5) * SIDE**2, 2))
    tree, kept = cKDTree(places), np.ones(len(places), bool)
    for i, near in enumerate(tree.query_ball_point(places, least)):
        if kept[i]:
            kept[[j for j in near if j > i]] = False
    return joined(places[kept][: SIDE**2])


def hexagonal(random):
    places = regular(random)[0]
    places[:, 0] += 0.5 * (places[:, 1] % 2)
    places[:, 1] *= np.sqrt(0.75)
    return joined(places + random.choice([0, 0.1]) * random.normal(size=places.shape))


def subdivided(random):
    """A coarse mesh whose faces are divided into four, twice."""
    coarse = random.uniform(0, SIDE, (SIDE**2 // 16, 2))
    coarse = coarse[cKDTree(coarse).query(coarse, 2)[0][:, 1] > random.uniform(0.5, 2)]
    places, faces = joined(coarse, 4.0)
    for _ in range(2):
        sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), 1)
        sides, own = np.unique(sides, axis=0, return_inverse=True)
        p, q, r = len(places) + own.reshape(3, -1)
        a, b, c = faces.T
        places = np.concatenate([places, places[sides].mean(1)])
        faces = np.concatenate([
            np.stack(each, 1) for each in ((a, p, r), (p, b, q), (r, q, c), (p, q, r))
        ])  # fmt: skip
    return places, faces


def cut(random):
    """A slanted plane meshed by marching cubes."""
    from skimage.measure import marching_cubes

    normal = np.abs(random.normal(size=3)) + 0.1
    normal = np.sort(normal / np.linalg.norm(normal))
    size = int(0.8 * SIDE)
    x, y, z = np.mgrid[:size, :size, : 2 * size].astype(np.float32)
    up = normal[0] * x + normal[1] * y + normal[2] * z
    vertices, faces, _, _ = marching_cubes(up - up[size // 2, size // 2, size] - 0.013, 0.0)
    across = np.cross(normal, [1, 0, 0])
    across /= np.linalg.norm(across)
    flat = np.stack([vertices @ across, vertices @ np.cross(normal, across)], 1)
    return flat.astype(float), faces


def joined(places, unit=1.0):
    """Triangulate points; slivers along the rim are left out."""
    faces = Delaunay(places).simplices
    sides = places[faces] - places[faces[:, [1, 2, 0]]]
    squares = (sides**2).sum((1, 2))
    areas = abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    low, high = places.min(0) + 1.5 * unit, places.max(0) - 1.5 * unit
    rim = ((places[faces] < low) | (places[faces] > high)).any((1, 2))
    thin = (areas < 0.12 * squares) | (squares > 12 * unit**2)
    return places, faces[~(rim & thin)]


MESHES = regular, regular, regular, jittered, jittered, scattered, hexagonal, subdivided, cut


def mesh_of(random):
    """Make a flat mesh; there is about one vertex per unit of area."""
    places, faces = MESHES[random.integers(len(MESHES))](random)
    stretch = np.exp(random.uniform(-0.5, 0.5)) if random.random() < 0.3 else 1.0
    places = places * [stretch, 1 / stretch]
    if random.random() < 0.25:  # edges become longer from one end to the other
        places = places * np.exp(random.uniform(0.2, 1.5) * places[:, :1] / np.ptp(places[:, 0]))
    used = np.unique(faces)
    number = np.zeros(len(places), int)
    number[used] = np.arange(len(used))
    return places[used] - places[used].min(0), number[faces]


def read(image, places, order=1):
    """Interpolate an image (h, w, 3) at positions in pixels."""
    return np.stack([
        ndimage.map_coordinates(image[..., c], places.T[::-1], order=order, mode="mirror")
        for c in range(3)
    ], 1)  # fmt: skip


def blurred(image, sigma):
    return ndimage.gaussian_filter(image, (sigma, sigma, 0), mode="mirror") if sigma else image


def painted(random, places):
    """Make vertex colors, in bytes, of plain areas with wavy borders, and strokes."""
    waves = random.normal(size=(2, 4, 2))
    size = np.ptp(places, axis=0).max()
    moved = places / size
    for turn, along in enumerate(waves[0]):
        bend = np.sin(2 * np.pi * moved @ (along * random.uniform(0.5, 4)))
        moved = moved + random.uniform(0, 0.04) * bend[:, None] * waves[1, turn]
    count = int(np.exp(random.uniform(np.log(3), np.log(90))))
    nearest = cKDTree(random.uniform(0, 1, (count, 2))).query(moved)[1]
    gray = random.choice([0.0, 0.0, 0.7, 1.0])
    palette = random.random((count if random.random() < 0.7 else 3, 3))
    palette = gray * palette[:, :1] + (1 - gray) * palette
    if random.random() < 0.3:
        palette = random.uniform(0, 0.6) + palette * random.uniform(0.05, 0.4)
    values = palette[nearest % len(palette)]
    for _ in range(random.integers(0, 4)):  # strokes
        begin, end = random.uniform(0, 1, (2, 2))
        way = end - begin
        share = np.clip((moved - begin) @ way / (way @ way), 0, 1)
        away = np.linalg.norm(moved - begin - share[:, None] * way, axis=1)
        values[away < random.uniform(0.5, 3) / SIDE] = random.choice(palette)
    return np.rint(255 * values).clip(0, 255)


def walk_of(faces, count):
    """Return the matrix of an umbrella pass: means over each vertex and its neighbours."""
    ends = (
        np.concatenate([faces, faces[:, [1, 2, 0]]]),
        np.concatenate([faces[:, [1, 2, 0]], faces]),
    )
    links = csr_matrix((np.ones(ends[0].size), (ends[0].ravel(), ends[1].ravel())), (count, count))
    links = (links > 0).astype(float) + diags_array(np.ones(count))
    return diags_array(1 / np.asarray(links.sum(1)).ravel()) @ links


def example(seed):
    """Make a mesh, true values of its vertices in bytes, and degraded ones.

    Returns
    -------
    vertices, faces : (n, 3), (m, 3)
    truth : (n, 3) uint8
    spoiled : list of ((n, 3) array, bool)
        Degraded values; True if they are the true ones.
    """
    random = np.random.default_rng([seed, 77])
    image = truth(random).astype(float)
    places, faces = mesh_of(random)
    one, two = (places[faces[:, k]] - places[faces[:, 0]] for k in (1, 2))
    areas = 0.5 * abs(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])
    unit = random.uniform(0.8, 1.2)  # square root of the area per vertex, in pixels
    where = places * (unit / np.sqrt(areas.sum() / len(places)))
    where = where + random.uniform(0, 1, 2) * np.maximum(len(image) - 1 - np.ptp(where, axis=0), 0)
    own = random.choice([0.0, 0.0, 0.3, 0.45])
    own_image, order = blurred(image, own * unit), 1 if own else 0
    right = np.rint(read(own_image, where, order)).clip(0, 255)
    by_hand = random.random() < 0.35
    if by_hand:
        right = painted(random, where)
    walk = walk_of(faces, len(places))
    found = []
    for _ in range(SPOILED):
        kind, given = random.random(), right
        if kind < 0.1 and random.random() < 0.7:
            found.append((right.astype(np.float32), True))
            continue
        if by_hand:
            kind = max(kind, 0.5)
        if 0.1 <= kind < 0.5:
            sigma = np.exp(random.uniform(np.log(0.4), np.log(3.8)))
            given = read(blurred(own_image, sigma * unit), where)
        elif 0.5 <= kind < 0.85:
            for _ in range(int(np.exp(random.uniform(0, np.log(30))))):
                given = walk @ given
        elif kind >= 0.85:
            some = random.random(len(places)) < random.uniform(0.1, 0.5)
            near = given[some][cKDTree(places[some]).query(places)[1]]
            between = LinearNDInterpolator(places[some], given[some])(places)
            given = np.where(np.isnan(between), near, between)
        if random.random() < 0.27:
            size = np.exp(random.uniform(np.log(0.5), np.log(10)))
            grain = random.normal(size=given.shape)
            if random.random() < 0.4:
                grain[:] = grain[:, :1]
            given = given + size * grain
        given = given.clip(0, 255)
        if random.random() < 0.8:
            given = np.rint(given)
        found.append((given.astype(np.float32), False))
    return np.pad(places, ((0, 0), (0, 1))), faces, right.astype(np.uint8), found
