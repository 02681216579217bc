# SPDX-License-Identifier: GPL-3.0-or-later
"""Function spaces on textured surfaces for the tests: matrices in full, and where unknowns lie."""

import numpy as np
import scipy.sparse
from atlases import Blocks
from shapes import grid
from shock_filter import core
from shock_filter.core.elements.matrices import TextureSpace


def square(n, charts=True, angle=0.4, change=lambda uv: uv):
    """A square of n x n texels in one chart, or in 4 x 4 that are turned: mesh, uv, image size."""
    if charts:
        blocks = Blocks(np.zeros((n, n, 1)), angle)
        return core.TriangleMesh(blocks.vertices, blocks.faces), change(blocks.uv), blocks.width
    vertices, faces = grid(8, 8)
    vertices = vertices * n / 8
    c, s = np.cos(angle or 0.0), np.sin(angle or 0.0)
    size = 2 * n
    flat = (vertices[faces][..., :2] - n / 2) @ np.array([[c, s], [-s, c]])
    return core.TriangleMesh(vertices, faces), change((flat + size / 2) / size), size


def space_of(mesh, uv, size, closed=False):
    """The space on the texels of a square image."""
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    if closed:
        starts = np.zeros(3 * mesh.face_count + 1, dtype=np.int32)
        starts[1:][atlas.charts.borders] = 1
        starts = np.cumsum(starts, dtype=np.int32)
        atlas = atlas.closed(starts, np.ones(starts[-1], dtype=bool))
    return TextureSpace(atlas)


def in_full(space, screen):
    """The matrix of a space, of the unknowns alone, and these."""
    matrix = space.matrix(screen)
    _, rows, columns = matrix.stencil.shape
    first, second, values = [], [], []
    for k, (down, right) in enumerate([(0, 1), (1, -1), (1, 0), (1, 1)]):
        y, x = np.nonzero(matrix.stencil[k])
        here, there = y * columns + x, (y + down) * columns + x + right
        first += [here, there]
        second += [there, here]
        values += 2 * [matrix.stencil[k][y, x].astype(np.float64)]
    first.append(matrix.seam[np.repeat(np.arange(len(matrix.seam)), np.diff(matrix.start))])
    second.append(matrix.seam[matrix.columns_])
    values.append(matrix.values)
    entries = np.concatenate(values), (np.concatenate(first), np.concatenate(second))
    couplings = scipy.sparse.csr_matrix(entries, shape=2 * (space.size,))
    diagonal = matrix.screen.astype(np.float64) - couplings.sum(axis=1).A1
    used = np.concatenate(
        [np.flatnonzero(space.labels >= 0), np.arange(rows * columns, space.size)]
    )
    full = (couplings + scipy.sparse.diags(diagonal)).tocsr()
    return full[used][:, used], used


def mass_matrix(space):
    """The mass matrix of a space, of the unknowns alone."""
    return in_full(space, 1.0)[0] - in_full(space, 0.0)[0]


def positions(space):
    """Where the unknowns lie in space, in the mesh's unit: (n, 3), NaN at what is none."""
    atlas, cut = space.atlas, space.cut_cells
    result = np.full((space.size, 3), np.nan)
    y, x = np.nonzero(space.labels >= 0)
    faces = atlas.sheet.nodes[y, x]
    inside = faces >= 0
    rows = y[inside] * space.labels.shape[1] + x[inside]
    result[rows] = _on_faces(atlas, faces[inside], y[inside], x[inside])
    pieces = cut.pieces
    at_points = np.empty((len(cut.kinds), 3))
    corners = atlas.mesh.vertices[atlas.mesh.faces[np.repeat(pieces.faces, np.diff(pieces.start))]]
    along, side = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = side - np.einsum("vx,vx->v", side, along)[:, None] * along
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    frame = pieces.frame * atlas.texel_size
    at_points[pieces.points] = corners[:, 0] + frame[:, :1] * along + frame[:, 1:] * across
    result[cut.unknowns] = at_points[cut.free]
    return result


def _on_faces(atlas, faces, y, x):
    a, b, c = np.moveaxis(atlas.sheet.points[faces], 1, 0)
    (py, px), (qy, qx) = (b - a).T, (c - a).T
    dy, dx = y - a[:, 0], x - a[:, 1]
    det = py * qx - px * qy
    second, third = (dy * qx - dx * qy) / det, (py * dx - px * dy) / det
    shares = np.stack([1 - second - third, second, third], axis=1)
    return np.einsum("fk,fkx->fx", shares, atlas.mesh.vertices[atlas.mesh.faces[faces]])
