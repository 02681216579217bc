# SPDX-License-Identifier: GPL-3.0-or-later
"""Each stage asks whether to go on: nothing runs over a whole mesh or image silently."""

import sys

import numpy as np
import pytest
from shapes import cube, grid
from shock_filter import core
from shock_filter.core.base import parallel
from shock_filter.core.base.progress import _current as current
from shock_filter.core.base.progress import reporting
from shock_filter.core.filters.denoising import denoise_geometry, denoise_image, denoise_jointly
from shock_filter.core.linear import multigrid
from shock_filter.core.mesh.order import sorted_along_curve

CHUNK = 64

SHORT = {"_bound", "_sum_edges", "_make_unit", "_scale_weights", "_reduce", "_direct", "_apply"}
SHORT |= {"_move", "_find_inside", "_measure_faces"}
SHORT |= {"_residual", "_multiply", "_multiply_add"}
"""Kernels that may be silent: what is asked before and after them lies close together."""


@pytest.fixture
def silent(monkeypatch):
    """Names of the kernels that ran over more than a few chunks without asking."""
    monkeypatch.setattr(parallel, "LARGEST_CHUNK", CHUNK)
    names = set()

    def watched(original):
        def call(function, count, *arguments, progress=None, chunk=None):
            asks = current.get() is not None
            asks |= progress is not None and progress._callback is not None  # transition
            if not asks and -(-count // (chunk or parallel.chunk_size(count))) > 4:
                names.add(function.__name__)
            original(function, count, *arguments, progress=progress, chunk=chunk)

        return call

    modules = [
        module
        for name, module in sys.modules.items()
        if name.startswith("shock_filter.core.") and module is not parallel
    ]
    for original in (parallel.run, parallel.run_in_order):
        for module in modules:
            if getattr(module, original.__name__, None) is original:
                monkeypatch.setattr(module, original.__name__, watched(original))
    return names


def ask(fraction, message):
    """Go on."""
    return True


def painted(mesh):
    """Colors of the corners that jump now and then, and a mask that is neither 0 nor 1."""
    colors = np.round(np.sin(mesh.vertices), 1)[mesh.own_corners(mesh.faces)]
    colors[::7] += 0.5
    return colors.astype(np.float32), np.full(mesh.vertex_count, 0.5)


def sort(mesh):
    """Sort a mesh, asking whether to go on."""
    with reporting(ask):
        sorted_along_curve(mesh)


RUNS = {
    "geometry": lambda mesh, colors, mask: core.sharpen_geometry(
        mesh, core.GeometrySettings(mollify_passes=1), mask, ask
    ),
    "multigrid": lambda mesh, colors, mask: core.sharpen_geometry(
        mesh, core.GeometrySettings(screening_radius=100.0), progress=ask
    ),
    "flow": lambda mesh, colors, mask: core.geometry_flow(mesh, progress=ask),
    "colors of vertices": lambda mesh, colors, mask: core.sharpen_vertex_signal(
        mesh, mesh.vertices / 20, core.ShockSettings(time=2.0, scheme="naive"), mask, ask
    ),
    "colors of corners": lambda mesh, colors, mask: core.sharpen_corner_signal(
        mesh, colors, None, mask, ask
    ),
    "denoising": lambda mesh, colors, mask: denoise_geometry(
        mesh, core.BeltramiGeometrySettings(), 16.0, mask, ask
    ),
    "denoising both": lambda mesh, colors, mask: denoise_jointly(
        mesh, colors, core.BeltramiMeshSettings(), 16.0, mask, ask
    ),
    "building": lambda mesh, colors, mask: core.TriangleMesh(mesh.vertices, mesh.faces, ask),
    "welding": lambda mesh, colors, mask: core.weld(mesh.vertices, ask),
    "welding borders": lambda mesh, colors, mask: core.weld_borders(mesh.vertices, mesh.faces, ask),
    "sorting": lambda mesh, colors, mask: sort(mesh),
}


@pytest.mark.parametrize("run", RUNS.values(), ids=RUNS)
def test_kernels_on_meshes_ask(silent, run):
    mesh = core.TriangleMesh(*cube(20))
    inputs = painted(mesh)
    silent.clear()
    run(mesh, *inputs)
    assert silent <= SHORT


@pytest.mark.parametrize(
    "settings",
    [
        {"background": "nearest"},
        {"channels": "luminance", "smoothing_passes": 2},
        {"content": "normals"},
    ],
)
def test_kernels_on_textures_ask(silent, settings):
    vertices, faces = grid(40, 40)
    mesh = core.TriangleMesh(vertices, faces, ask)
    uv = 0.1 + 0.02 * vertices[faces][..., :2]
    rows = np.linspace(0, 1, 300)
    image = np.sin(7 * rows[:, None, None] + [1.0, 2.0, 3.0] * rows[None, :, None]) / 2 + 0.5
    core.sharpen_texture(
        mesh, uv, image, core.TextureSettings(**settings), np.full((300, 300), 0.5), ask
    )
    assert silent <= SHORT


@pytest.mark.parametrize("scheme", ["fixed", "naive", "composed"])
def test_kernels_on_images_ask(silent, scheme):
    image = np.random.default_rng(0).random((300, 20, 4)).astype(np.float32)
    core.sharpen_image(image, core.ImageSettings(time=2.0, scheme=scheme), progress=ask)
    assert not silent


@pytest.mark.parametrize("measure", ["space", "surface"])
def test_kernels_that_denoise_images_ask(silent, measure):
    image = np.random.default_rng(0).random((300, 20, 4)).astype(np.float32)
    denoise_image(image, core.BeltramiSettings(measure=measure, time=0.2), 2.0, progress=ask)
    assert not silent


def questions(work):
    """How often the work asks under each message."""
    counts = {}

    def count(fraction, message):
        counts[message] = counts.get(message, 0) + 1
        return True

    work(count)
    return counts


def test_numpy_works_on_blocks_of_rows_of_an_image():
    def denoise(rows):
        image = np.zeros((rows, 8, 4), dtype=np.float32)
        settings = core.BeltramiSettings(time=0.05)
        return questions(lambda count: core.beltrami_image(image, settings, progress=count))

    small, large = denoise(300), denoise(3000)
    # Reading, preparing, dividing by opacity, copying and writing: each asks for every 256 rows.
    kernel = (3000 - 300) / 16
    assert large["Smoothing"] - small["Smoothing"] >= 0.9 * kernel / 2 + 5 * 8


def test_multigrid_multiplies_matrices_in_blocks(monkeypatch):
    mesh = core.TriangleMesh(*cube(30))
    settings = core.GeometrySettings(screening_radius=100.0)
    sharpen = lambda count: core.sharpen_geometry(mesh, settings, progress=count)  # noqa: E731
    few = questions(sharpen)["Coarsening"]
    mesh = core.TriangleMesh(*cube(30))
    monkeypatch.setattr(multigrid, "_ROWS", 512)
    assert questions(sharpen)["Coarsening"] >= few + 2 * (mesh.vertex_count // 512)
