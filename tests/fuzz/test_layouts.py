# SPDX-License-Identifier: GPL-3.0-or-later
"""Bad layouts of textures through what works on surfaces: a finite result, or a named error."""

import numpy as np
import pytest
from checks import assert_sentence
from shapes import grid, icosphere
from shock_filter import core
from strategies import LONG

SIZES = [(1, 1), (1, 9), (16, 16)]


def ball():
    return core.TriangleMesh(*icosphere(1))


def sheet(n=6):
    return core.TriangleMesh(*grid(n, n))


def flat(mesh, low=0.05, high=0.95):
    """The mesh as seen along Z: of a ball, its halves over one another."""
    places = mesh.vertices[mesh.faces][..., :2]
    least, most = places.min(axis=(0, 1)), places.max(axis=(0, 1))
    return low + (high - low) * (places - least) / (most - least)


def islands(mesh):
    """Each face by itself, in a square of its own."""
    side = int(np.ceil(np.sqrt(mesh.face_count)))
    number = np.arange(mesh.face_count)
    cells = np.stack([number % side, number // side], axis=1)[:, None]
    return (cells + 0.1 + 0.8 * np.array([[0, 0], [1, 0], [0, 1]])) / side


def mixed(mesh):
    """Some of everything."""
    uv = islands(mesh)
    uv[::5] = uv[::5, :1]  # no area
    uv[1::5] = uv[1]  # over one another
    uv[2::5] += 3.0  # outside
    uv[3::5] = uv[3::5, ::-1]  # mirrored
    return uv


def spoiled(value):
    def layout(mesh):
        uv = flat(mesh)
        uv[3, 1, 0] = value
        return uv

    return layout


LAYOUTS = {
    "one over another": (ball, flat),
    "all at one place": (ball, lambda mesh: np.tile([[0.1, 0.1], [0.9, 0.1], [0.1, 0.9]],
                                                    (mesh.face_count, 1, 1))),
    "outside": (sheet, lambda mesh: flat(mesh) + [5.0, -7.0]),
    "across the border": (sheet, lambda mesh: flat(mesh) + 0.5),
    "far outside": (sheet, lambda mesh: flat(mesh) + 1e6),
    "tiled": (sheet, lambda mesh: 3.0 * flat(mesh)),
    "tiled much": (sheet, lambda mesh: 1e5 * flat(mesh)),
    "mirrored": (sheet, lambda mesh: flat(mesh) * [-1.0, 1.0]),
    "half mirrored": (sheet, lambda mesh: np.abs(flat(mesh) - [0.5, 0.0])),
    "a line": (sheet, lambda mesh: flat(mesh) * [1.0, 0.0]),
    "a point": (sheet, lambda mesh: 0.0 * flat(mesh) + 0.3),
    "one texel wide": (sheet, lambda mesh: flat(mesh) * [1.0 / 16, 1.0]),
    "far less than a texel": (sheet, lambda mesh: 0.5 + 1e-4 * flat(mesh)),
    "hardly any area": (sheet, lambda mesh: flat(mesh) * [1.0, 1e-9]),
    "tiny": (sheet, lambda mesh: 1e-30 * flat(mesh)),
    "NaN": (sheet, spoiled(np.nan)),
    "infinite": (sheet, spoiled(np.inf)),
    "one corner far away": (sheet, spoiled(50.0)),
    "one corner very far away": (sheet, spoiled(1e300)),
    "islands": (ball, islands),
    "thousands of islands": (lambda: sheet(32), islands),
    "some of everything": (ball, mixed),
    "random": (ball, lambda mesh: np.random.default_rng(0).random((mesh.face_count, 3, 2))),
    "half without area": (sheet, lambda mesh: np.where(
        np.arange(mesh.face_count)[:, None, None] % 2, flat(mesh), flat(mesh)[:, :1])),
}  # fmt: skip


def image_of(size):
    return np.random.default_rng(1).random((*size, 3))


def vectors_of(mesh):
    return np.random.default_rng(2).normal(size=(mesh.face_count, 3))


FILTERS = {
    "filter_texture": lambda mesh, uv, size: core.filter_texture(
        mesh, uv, image_of(size), gain=2.0 * image_of(size)[..., 0]
    ),
    "stitch_textures": lambda mesh, uv, size: core.stitch_textures(
        mesh, uv, [image_of(size), image_of(size)[::-1]],
        labels=(image_of(size)[..., 0] > 0.5).astype(int),
    ),
    "geodesic_distance": lambda mesh, uv, size: core.geodesic_distance(
        mesh, uv, core.DistanceSettings(look="gradient", smoothing=2.0), size=size, vertices=[0]
    ),
    "surface_line_convolution": lambda mesh, uv, size: core.surface_line_convolution(
        mesh, uv, size=size, directions=vectors_of(mesh), at="faces"
    ),
    "reaction_diffusion": lambda mesh, uv, size: core.reaction_diffusion(
        mesh, uv, core.ReactionSettings(steps=3, stretch=2.0), size=size,
        directions=vectors_of(mesh), rates=1.0 + image_of(size)[..., 0], at="faces",
    ),
    "advect_on_surface": lambda mesh, uv, size: np.stack(
        list(core.advect_on_surface(mesh, uv, vectors_of(mesh), size=size, frames=2, at="faces"))
    ),
    "dilate_texture": lambda mesh, uv, size: core.dilate_texture(mesh, uv, image_of(size)),
    "object_normals": lambda mesh, uv, size: core.object_normals(mesh, uv, image_of(size)),
    "sharpen_texture": lambda mesh, uv, size: core.sharpen_texture(mesh, uv, image_of(size)),
    "beltrami_texture": lambda mesh, uv, size: core.beltrami_texture(mesh, uv, image_of(size)),
}  # fmt: skip

_CASES = [(layout, size) for layout in LAYOUTS for size in SIZES + [(64, 48)] * LONG]


@pytest.mark.parametrize("name", FILTERS)
def test_bad_layouts_give_finite_results_or_named_errors(name):
    done = 0
    for layout, size in _CASES:
        make, coordinates = LAYOUTS[layout]
        mesh = make()
        try:
            result = FILTERS[name](mesh, coordinates(mesh), size)
        except core.ShockError as error:
            assert_sentence(error)
            continue
        assert np.isfinite(result).all(), (layout, size)
        done += 1
    assert done > len(_CASES) / 4
