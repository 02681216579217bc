# SPDX-License-Identifier: GPL-3.0-or-later
"""Texture layouts made by code for the tests: one signal, cut into charts in different ways."""

import numpy as np
from scipy.ndimage import map_coordinates
from shapes import grid


def sample(image, uv):
    """Read an image linearly at texture coordinates (..., 2)."""
    height, width = image.shape[:2]
    places = [uv[..., 1] * height - 0.5, uv[..., 0] * width - 0.5]
    return np.stack(
        [
            map_coordinates(image[..., c].astype(np.float64), places, order=1, mode="grid-wrap")
            for c in range(image.shape[2])
        ],
        axis=-1,
    )


class Blocks:
    """A square picture on a plane of squares, cut into 4 x 4 charts that are turned and moved.

    Parameters
    ----------
    picture : (n, n, c) array
        n a multiple of 32.
    angle : float, optional
        Turns chart b by (b + 1) times this; None turns by right angles and mirrors every third
        chart, so that texels fall on texels.
    """

    def __init__(self, picture, angle=None):
        self.picture = picture
        self.size = len(picture)
        self.block = self.size // 4
        self.vertices, self.faces = grid(8, 8)
        self.vertices = self.vertices * self.size / 8
        corners = self.vertices[self.faces][..., :2]
        number = self._number(corners.mean(axis=1))
        pitch = 2 * self.block + 16
        self.width = 4 * pitch
        self.turns, self.centres, self.places = [], [], []
        for b in range(16):
            c, s = (
                ([1, 0, -1, 0][b % 4], [0, 1, 0, -1][b % 4])
                if angle is None
                else (np.cos(angle * (b + 1)), np.sin(angle * (b + 1)))
            )
            turn = np.array([[c, -s], [s, c]], dtype=np.float64)
            if angle is None and b % 3 == 1:
                turn = turn @ np.diag([1.0, -1.0])
            self.turns.append(turn)
            self.centres.append((np.array([b % 4, b // 4]) + 0.5) * self.block)
            self.places.append((np.array([b % 4, b // 4]) + 0.5) * pitch)
        self.uv = self.to_uv(corners, number[:, None])

    def _number(self, points):
        cell = np.clip(points // self.block, 0, 3).astype(int)
        return cell[..., 0] + 4 * cell[..., 1]

    def to_uv(self, points, number=None):
        """Where points (..., 2) of the plane lie in the texture."""
        number = self._number(points) if number is None else number
        number = np.broadcast_to(number, points.shape[:-1])
        turn, centre = np.array(self.turns)[number], np.array(self.centres)[number]
        moved = np.einsum("...ij,...j->...i", turn, points - centre)
        return (moved + np.array(self.places)[number]) / self.width

    def texture(self, background=0.0):
        """The picture in the layout; `background` where there is no chart."""
        shape = (self.width, self.width, self.picture.shape[2])
        image = np.full(shape, background, dtype=self.picture.dtype)
        y, x = np.mgrid[: self.width, : self.width] + 0.5
        for turn, centre, place in zip(self.turns, self.centres, self.places, strict=True):
            there = (np.stack([x, y], axis=-1) - place) @ turn + centre
            inside = (np.abs(there - centre) <= self.block / 2 + 1e-9).all(axis=-1)
            image[inside] = sample(self.picture, there[inside] / self.size)
        return image

    def read(self, image, points):
        """Read a texture in the layout at points (..., 2) of the plane."""
        return sample(image, self.to_uv(points))


def apart(mesh, margin=2.0, texels_per_length=8.0):
    """Lay each face out by itself, undistorted: returns uv (m, 3, 2) and the image's size."""
    corners = mesh.vertices[mesh.faces] * texels_per_length
    along = corners[:, 1] - corners[:, 0]
    other = corners[:, 2] - corners[:, 0]
    length = np.linalg.norm(along, axis=1)
    x = np.einsum("fx,fx->f", other, along) / length
    y = np.sqrt(np.maximum(np.einsum("fx,fx->f", other, other) - x * x, 0.0))
    flat = np.zeros((len(corners), 3, 2))
    flat[:, 1, 0] = length
    flat[:, 2, 0] = x
    flat[:, 2, 1] = y
    flat -= flat.min(axis=1, keepdims=True)
    pitch = np.ceil(flat.max(axis=(0, 1)) + 2 * margin).astype(int)
    columns = int(np.ceil(np.sqrt(len(corners) * pitch[1] / pitch[0])))
    number = np.arange(len(corners))
    start = np.stack([number % columns, number // columns], axis=-1) * pitch + margin
    size = max(columns * pitch[0], (-(-len(corners) // columns)) * pitch[1])
    # TriangleMesh keeps turned faces with two corners exchanged; these meshes have none.
    assert not mesh.flipped.any()
    return (flat + start[:, None]) / size, int(size)
