# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes made by code for the tests."""

import numpy as np


def grid(nx=12, ny=12, jitter=0.0, seed=0):
    """A flat sheet of nx x ny squares of size 1, each cut in two; interior points jittered."""
    x, y = np.meshgrid(np.arange(nx + 1.0), np.arange(ny + 1.0), indexing="ij")
    vertices = np.stack([x, y, np.zeros_like(x)], axis=-1)
    noise = np.random.default_rng(seed).uniform(-jitter, jitter, (nx - 1, ny - 1, 2))
    vertices[1:-1, 1:-1, :2] += noise
    index = np.arange((nx + 1) * (ny + 1)).reshape(nx + 1, ny + 1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )
    return vertices.reshape(-1, 3), faces


def icosphere(subdivisions=3, radius=1.0):
    """A sphere from a subdivided icosahedron."""
    t = (1 + 5**0.5) / 2
    vertices = np.array(
        [(-1, t, 0), (1, t, 0), (-1, -t, 0), (1, -t, 0), (0, -1, t), (0, 1, t), (0, -1, -t),
         (0, 1, -t), (t, 0, -1), (t, 0, 1), (-t, 0, -1), (-t, 0, 1)]
    )  # fmt: skip
    faces = np.array(
        [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4),
         (11, 10, 2), (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8),
         (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    )  # fmt: skip
    for _ in range(subdivisions):
        vertices, faces = subdivide(vertices, faces)
    return radius * vertices / np.linalg.norm(vertices, axis=1, keepdims=True), faces


def subdivide(vertices, faces):
    """Cut each triangle in four."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, number = np.unique(edges, axis=0, return_inverse=True)
    middle = len(vertices) + number.reshape(-1, 3)
    a, b, c = faces.T
    ab, bc, ca = middle.T
    finer = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=-1).reshape(-1, 3)
    return np.concatenate([vertices, vertices[unique].mean(axis=1)]), finer


def cube(cells=10):
    """A cube of cells x cells squares a side (length 1 each), with sharp edges, closed."""
    sheet, triangles = grid(cells, cells)
    vertices, faces = [], []
    for axis in range(3):
        for sign in (1, -1):
            # A cyclic exchange of axes keeps the winding.
            side = np.roll(sheet - [cells / 2, cells / 2, -sign * cells / 2], axis + 1, axis=1)
            faces.append(triangles[:, ::sign] + len(vertices) * len(sheet))
            vertices.append(side)
    unique, index = np.unique(np.concatenate(vertices), axis=0, return_inverse=True)
    return unique, index.reshape(-1)[np.concatenate(faces)]


def smoothed(vertices, faces, passes=3):
    """Positions moved half-way to the mean of their neighbors, some times: rounds creases."""
    edges = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    edges = np.concatenate([edges, edges[:, ::-1]])
    degree = np.bincount(edges[:, 0])[:, None]
    for _ in range(passes):
        total = np.zeros_like(vertices)
        np.add.at(total, edges[:, 0], vertices[edges[:, 1]])
        vertices = 0.5 * (vertices + total / degree)
    return vertices


def soft_cube(cells=10, passes=3):
    """A cube whose edges were smoothed away."""
    vertices, faces = cube(cells)
    return smoothed(vertices, faces, passes), faces


def rotation(seed=0):
    """A random rotation matrix."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def shuffled(vertices, faces, seed=0):
    """The same surface with vertices, faces and corners in another order, and the new places.

    Returns vertices, faces, and the arrays `v` and `f` with ``new_vertices[v] == vertices``
    and face i standing at ``f[i]``.
    """
    rng = np.random.default_rng(seed)
    v = rng.permutation(len(vertices))
    f = rng.permutation(len(faces))
    new_vertices = np.empty_like(vertices)
    new_vertices[v] = vertices
    turned = np.take_along_axis(
        v[faces], (np.arange(3) + rng.integers(0, 3, len(faces))[:, None]) % 3, axis=1
    )
    new_faces = np.empty_like(faces)
    new_faces[f] = turned
    return new_vertices, new_faces, v, f


def angles(a, b):
    """Angles between rows, in degrees."""
    return np.degrees(np.arccos(np.clip((a * b).sum(axis=1), -1, 1)))


def fan(n, roughness=0.0):
    """A disc of n triangles around vertex 0, with random heights."""
    angle = 2 * np.pi * np.arange(n) / n
    height = roughness * np.random.default_rng(0).normal(size=n)
    rim = np.stack([np.cos(angle), np.sin(angle), height], axis=1)
    near = np.arange(1, n + 1)
    faces = np.stack([np.zeros(n, dtype=int), near, np.roll(near, -1)], axis=1)
    return np.concatenate([np.zeros((1, 3)), rim]), faces


class Counting:
    """An array that counts how often something is read from it."""

    def __init__(self, array):
        self.array, self.shape, self.reads = array, array.shape, 0

    def __getitem__(self, place):
        self.reads += 1
        return self.array[place]
