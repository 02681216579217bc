# SPDX-License-Identifier: GPL-3.0-or-later
"""Many runs of the filters leave no memory behind."""

import numpy as np
import pytest
from memory import assert_flat
from shapes import soft_cube
from shock_filter import core

VERTICES, FACES = soft_cube(40)  # its positions are 230 kB: one such array a run is found
IMAGE = np.random.default_rng(0).random((100, 100, 3))


def textured():
    mesh = core.TriangleMesh(VERTICES, FACES)
    uv = mesh.vertices[mesh.faces][..., :2] / 40 + 0.5
    core.sharpen_texture(mesh, uv, IMAGE, core.TextureSettings(time=4.0))


def denoised():
    mesh = core.TriangleMesh(VERTICES, FACES)
    settings = core.BeltramiGeometrySettings(repeat=1, iterations=1)
    core.denoise_geometry(mesh, settings)


RUNS = {
    "geometry": lambda: core.sharpen_geometry(core.TriangleMesh(VERTICES, FACES)),
    "colors": lambda: core.sharpen_corner_signal(
        core.TriangleMesh(VERTICES, FACES), VERTICES[FACES] / 40),
    "image": lambda: core.sharpen_image(IMAGE),
    "denoise": denoised,
    "texture": textured,
}  # fmt: skip


SLOW = ["colors", "denoise"]


@pytest.mark.parametrize(
    "run",
    [
        pytest.param(run, id=name, marks=[pytest.mark.slow] * (name in SLOW))
        for name, run in RUNS.items()
    ],
)
def test_memory_stays_flat(run):
    assert_flat(run)


@pytest.mark.slow
def test_memory_stays_flat_on_one_mesh():
    mesh = core.TriangleMesh(VERTICES, FACES)
    times = iter(np.linspace(1.0, 99.0, 1000))
    assert_flat(lambda: core.sharpen_geometry(mesh, core.GeometrySettings(time=next(times))))
