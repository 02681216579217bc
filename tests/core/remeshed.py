# SPDX-License-Identifier: GPL-3.0-or-later
"""What a voxel remesh makes of a shape: naive surface nets on a grid."""

import itertools

import numpy as np


def surface_net(distances, spacing):
    """Vertices and triangles of the surface where distances (k, l, m) are 0.

    A vertex in each cell that the surface cuts, at the mean of the cuts of the cell's edges.
    """
    inside = distances < 0
    cells = np.array(distances.shape) - 1
    counts, sums = np.zeros(cells), np.zeros((*cells, 3))
    for axis in range(3):
        others = [a for a in range(3) if a != axis]
        for steps in itertools.product((0, 1), repeat=2):
            shift = np.zeros(3, dtype=int)
            shift[others] = steps
            low = tuple(slice(s, s + c) for s, c in zip(shift, cells, strict=True))
            shift[axis] = 1
            high = tuple(slice(s, s + c) for s, c in zip(shift, cells, strict=True))
            cut = inside[low] != inside[high]
            change = np.where(cut, distances[low] - distances[high], 1.0)
            point = np.zeros((*cells, 3))
            point[..., others] = steps
            point[..., axis] = np.where(cut, distances[low] / change, 0.0)
            counts += cut
            sums += point * cut[..., None]
    used = counts > 0
    number = np.cumsum(used).reshape(used.shape) - 1
    vertices = (np.argwhere(used) + sums[used] / counts[used][:, None]) * spacing
    quads = []
    for axis in range(3):
        u, v = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
        ahead = np.roll(inside, -1, axis=axis)
        cut = inside != ahead
        cut[tuple(-1 if a == axis else slice(None) for a in range(3))] = False
        at = np.argwhere(cut)
        corners = [at - i * u - j * v for i, j in ((1, 1), (0, 1), (0, 0), (1, 0))]
        quad = np.stack([number[tuple(c.T)] for c in corners], axis=1)
        turned = ahead[tuple(at.T)]
        quad[turned] = quad[turned, ::-1]
        quads.append(quad)
    quads = np.concatenate(quads)
    return vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def turned_box(count=26, half=(1.0, 0.7, 0.5), graded=0.0):
    """A box that lies askew in the grid, its vertices, triangles, and axes (3, 3) in rows.

    With `graded`, the grid's lines lie closer together towards the ends, up to 1 + graded times.
    """
    q, _ = np.linalg.qr(np.array([[1.0, 0.3, 0.2], [-0.4, 1.0, 0.5], [0.1, -0.3, 1.0]]))
    line = np.linspace(-1.6, 1.6, count)
    line += graded * np.sin(np.pi * line / 1.6) * 1.6 / np.pi
    points = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1)
    beyond = np.abs(points @ q.T) - half
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    distances = outside + np.minimum(beyond.max(axis=-1), 0.0)
    vertices, faces = surface_net(distances, 1.0)
    return np.interp(vertices, np.arange(count), line), faces, q
