# SPDX-License-Identifier: GPL-3.0-or-later
"""Textured meshes for the benchmarks: from files and made by code, and their seams measured."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import map_coordinates
from shock_filter import core
from shock_filter.core.files.textures import read_textured_mesh

FILES = {
    "spot": ("spot/spot_triangulated.obj", "spot/spot_texture.png"),
    "blub": ("blub/blub_triangulated.obj", "blub/blub_texture.png"),
    "DamagedHelmet": ("DamagedHelmet/DamagedHelmet.obj", "DamagedHelmet/Default_albedo.jpg"),
    "WaterBottle": ("WaterBottle/WaterBottle.obj", "WaterBottle/WaterBottle_baseColor.png"),
}
"""Per model, the mesh and the image in the folder textured/."""

BALL = "ball"
"""Name of the model that needs no file."""

_WAVES = (38.0, 54.0, 70.0)  # lengths of the painted pattern's waves, in texels
_SOFT = 0.35  # of the pattern's amplitude: edges about six texels wide
_PER_TEXEL = 4  # samples along a seam


@dataclass(frozen=True)
class Model:
    """A mesh as a file holds it, with the texture coordinates of its corners and a texture.

    Attributes
    ----------
    vertices : (n, 3) float64
    faces : (m, 3) int
    uv : (m, 3, 2) float64
    image : (h, w, 3) uint8
        Row 0 at v = 0.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    image: np.ndarray

    def mesh(self) -> core.TriangleMesh:
        """Build the mesh."""
        return core.TriangleMesh(self.vertices, self.faces)

    def save(self, path: Path) -> None:
        """Write the model for `read_model`."""
        np.savez(path, **vars(self))


def read_model(path: Path) -> Model:
    """Read what `Model.save` wrote."""
    with np.load(path) as arrays:
        return Model(**arrays)


def names(data: Path | None) -> list[str]:
    """Return the models there are."""
    return list(FILES) if data else [BALL]


def load_model(data: Path | None, name: str, size: int | None = None) -> Model:
    """Load a model; its texture may be resized to `size` times `size` texels."""
    if name == BALL:
        return ball(size or 1024)
    assert data
    mesh_file, image_file = FILES[name]
    textured = read_textured_mesh(data / "textured" / mesh_file)
    faces = textured.mesh.faces.copy()
    turned = textured.mesh.flipped
    faces[turned] = faces[turned][:, [0, 2, 1]]
    picture = Image.open(data / "textured" / image_file).convert("RGB")
    if size and picture.size != (size, size):
        picture = picture.resize((size, size), Image.Resampling.LANCZOS)
    image = np.ascontiguousarray(np.array(picture)[::-1])
    return Model(textured.mesh.vertices, faces, textured.uv, image)


def save_model(path: Path, data: Path | None, name: str, size: int | None = None) -> None:
    """Load a model and write it to a file."""
    load_model(data, name, size).save(path)


def ball(size: int, steps: int = 40) -> Model:
    """Make a ball from a cube: each side is a chart, turned by an angle of its own."""
    ticks = np.linspace(-1.0, 1.0, steps + 1)
    across, up = np.meshgrid(ticks, ticks)
    flat = np.stack([across, up], axis=-1).reshape(-1, 2)
    first = (np.arange(steps) + (steps + 1) * np.arange(steps)[:, None]).reshape(-1, 1)
    square = np.array([[0, 1, steps + 2], [0, steps + 2, steps + 1]])
    quads = (first[:, None] + square).reshape(-1, 3)
    points, faces, coordinates = [], [], []
    for side in range(6):
        axis, sign = side % 3, 1.0 if side < 3 else -1.0
        corner = np.empty((len(flat), 3))
        corner[:, axis] = sign
        corner[:, (axis + 1) % 3] = sign * flat[:, 0]
        corner[:, (axis + 2) % 3] = flat[:, 1]
        faces.append(quads + side * len(flat))
        points.append(corner)
        angle = 0.35 * (side + 1)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        place = np.array([side % 3 + 0.5, side // 3 + 0.75]) / 3
        # The cube's coordinates, bent so that squares on the ball are about equally large.
        coordinates.append(place + (np.arctan(flat) / (np.pi / 4) @ turn.T) * 0.112)
    representatives, index = core.weld(np.round(np.concatenate(points), 9))
    vertices = np.concatenate(points)[representatives]
    vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    corners = np.concatenate(faces)
    uv = np.concatenate(coordinates)[corners]
    model = Model(vertices, index[corners], uv, np.zeros((size, size, 3), dtype=np.uint8))
    return painted(model)


def painted(model: Model) -> Model:
    """Return a model with a pattern in space for its texture, black around the charts."""
    height, width = model.image.shape[:2]
    atlas = core.TextureAtlas(model.mesh(), model.uv, size=(height, width))
    places = atlas.bake(model.vertices[model.faces]) / atlas.texel_size
    colors = np.where(atlas.inside[..., None], pattern(places), 0.0)
    image = np.rint(255.0 * colors).astype(np.uint8)
    return Model(model.vertices, model.faces, model.uv, image)


def pattern(places: np.ndarray) -> np.ndarray:
    """Colors with soft edges at points in space, given in texels: (..., 3) in [0, 1]."""
    channels = []
    for channel, length in enumerate(_WAVES):
        x, y, z = np.moveaxis(2 * np.pi / length * places + channel, -1, 0)
        level = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
        channels.append(0.5 + 0.4 * np.tanh(level / _SOFT))
    return np.stack(channels, axis=-1)


def sample(image: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Read an image (h, w, c) linearly at (row, column) in texels, repeating it: (..., c)."""
    rows, columns = np.moveaxis(places, -1, 0)
    return np.stack(
        [
            map_coordinates(np.float64(image[..., c]), [rows, columns], order=1, mode="grid-wrap")
            for c in range(image.shape[2])
        ],
        axis=-1,
    )


@dataclass(frozen=True)
class Seams:
    """Samples along all seams.

    Attributes
    ----------
    sides : (2, k, 2) float64
        (row, column) of each sample in the texture, on both sides.
    weights : (k,) float64
        Length of the seam that each stands for; the sum is 1.
    edges : (k,) int
        The half-edge on the first side.
    shares : (k,) float64
        Where on it.
    """

    sides: np.ndarray
    weights: np.ndarray
    edges: np.ndarray
    shares: np.ndarray

    def jumps(self, image: np.ndarray) -> np.ndarray:
        """Difference of linear samples on both sides, mean of the channels: (k,)."""
        one, other = (sample(image, side) for side in self.sides)
        return np.abs(one - other).mean(axis=-1)

    def jump(self, image: np.ndarray) -> float:
        """Mean difference of both sides along the seams."""
        return float(self.weights @ self.jumps(image))


def find_seams(atlas: core.TextureAtlas) -> Seams:
    """Place samples along the seams of an atlas."""
    mesh, points = atlas.mesh, atlas.charts.points
    edges = atlas.charts.borders
    twins = mesh.twins.ravel()[edges]
    edges, twins = edges[twins > edges], twins[twins > edges]  # each seam once

    def ends(corners: np.ndarray, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return corners[half // 3, half % 3], corners[half // 3, (half % 3 + 1) % 3]

    start, end = ends(points, edges)
    counts = np.ceil(_PER_TEXEL * np.linalg.norm(end - start, axis=1)).astype(int).clip(1)
    one, other = ends(mesh.vertices[mesh.faces], edges)
    lengths = np.repeat(np.linalg.norm(other - one, axis=1) / counts, counts)
    number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    share = ((number + 0.5) / np.repeat(counts, counts))[:, None]
    sides = []
    for half, part in ((edges, share), (twins, 1.0 - share)):
        start, end = ends(points, np.repeat(half, counts))
        sides.append(start + part * (end - start))
    return Seams(np.array(sides), lengths / lengths.sum(), np.repeat(edges, counts), share[:, 0])
