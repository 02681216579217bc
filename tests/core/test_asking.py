# SPDX-License-Identifier: GPL-3.0-or-later
"""Each stage asks whether to go on: nothing runs over a whole mesh or image silently."""

import inspect
import sys

import numpy as np
import pytest
from shapes import grid, soft_cube
from shock_filter import core
from shock_filter.core.base import parallel
from shock_filter.core.base.progress import reporting
from shock_filter.core.mesh.order import sorted_along_curve
from shock_filter.core.mesh.weld import weld_borders
from shock_filter.core.registry import find
from shock_filter.core.shape.denoising import beltrami_joint_corners
from shock_filter.core.sparse.matrix import diagonal_matrix, product
from shock_filter.core.then_sharpen import sharpen_both, then_sharpen

CHUNK = 64
MOST = 4 * CHUNK
"""Indices that a kernel may run over between two questions."""

SHORT = {
    "_bound",
    "_sum_edges",
    "_apply",
    "_update_direction",
    "_reduce",
    "_dot",
    "_next_direction",
    "_go",
    "_find_nearest",
    "_list_near",
}
"""Kernels of sums and of searches, whose chunks have a size of their own: not above the largest of
others."""


@pytest.fixture
def silent(monkeypatch):
    """Return a function that names the kernels of some work that run on and on without asking."""
    monkeypatch.setattr(parallel, "LARGEST_CHUNK", CHUNK)
    monkeypatch.setattr(parallel, "thread_count", lambda: 1)

    def find(work):
        work(lambda fraction, message: True)  # compiles: kernels cannot call watched ones
        unasked, names = {}, set()

        def ask(fraction, message):
            unasked.clear()
            return True

        def watched(kernel):
            def call(start, stop, *arguments):
                name = kernel.py_func.__name__
                unasked[name] = unasked.get(name, 0) + int(stop) - int(start)
                if unasked[name] > MOST:
                    names.add(name)
                return kernel(start, stop, *arguments)

            return call

        with monkeypatch.context() as patches:
            for module, name, kernel in kernels():
                patches.setattr(module, name, watched(kernel))
            work(ask)
        return names

    return find


def kernels():
    """Find the kernels of a range, under each name that a module has for them."""
    return [
        (module, name, value)
        for path, module in sorted(sys.modules.items())
        if path.startswith("shock_filter.core.")
        for name, value in vars(module).items()
        if hasattr(value, "py_func")
        and list(inspect.signature(value.py_func).parameters)[:2] == ["start", "stop"]
    ]


def painted(mesh):
    """Colors of the corners that jump now and then, and a mask that is neither 0 nor 1."""
    colors = np.round(np.sin(mesh.vertices), 1)[mesh.own_corners(mesh.faces)]
    colors[::7] += 0.5
    return colors.astype(np.float32), np.full(mesh.vertex_count, 0.5)


BOTH = then_sharpen(beltrami_joint_corners, sharpen_both, core.ShockSettings(time=16.0))
RUNS = {
    "geometry": lambda mesh, colors, mask, ask: core.sharpen_geometry(
        mesh, core.GeometrySettings(mollify_passes=1), mask=mask, progress=ask
    ),
    "geometry as in the paper": lambda mesh, colors, mask, ask: core.sharpen_geometry(
        mesh, core.GeometrySettings.of_paper(), mask=mask, progress=ask
    ),
    "multigrid": lambda mesh, colors, mask, ask: core.sharpen_geometry(
        mesh, core.GeometrySettings(screening_radius=100.0), progress=ask
    ),
    "flow": lambda mesh, colors, mask, ask: core.geometry_flow(mesh, progress=ask),
    "colors of vertices": lambda mesh, colors, mask, ask: core.sharpen_vertex_signal(
        mesh,
        mesh.vertices / 20,
        core.ShockSettings(time=2.0),
        mask=mask,
        progress=ask,
    ),
    "colors of corners": lambda mesh, colors, mask, ask: core.sharpen_corner_signal(
        mesh, colors, None, mask=mask, progress=ask
    ),
    "colors of corners as learned": lambda mesh, colors, mask, ask: core.sharpen_corner_signal(
        mesh, colors, core.ShockSettings(what="auto"), mask=mask, progress=ask
    ),
    "denoising": lambda mesh, colors, mask, ask: find("denoise_geometry").function(16.0)(
        mesh, mask=mask, progress=ask
    ),
    "denoising both": lambda mesh, colors, mask, ask: BOTH(mesh, colors, mask=mask, progress=ask),
    "low poly": lambda mesh, colors, mask, ask: core.crisp_low_poly(
        mesh, core.GeometrySettings(amount=0.0), progress=ask
    ),
    "welding": lambda mesh, colors, mask, ask: core.weld(mesh.vertices, progress=ask),
    "welding borders": lambda mesh, colors, mask, ask: weld_borders(
        mesh.vertices, mesh.faces, progress=ask
    ),
    "sorting": lambda mesh, colors, mask, ask: sort(mesh, ask),
}


def sort(mesh, ask):
    with reporting(ask):
        sorted_along_curve(mesh)


@pytest.mark.parametrize("run", RUNS.values(), ids=RUNS)
def test_kernels_on_meshes_ask(silent, run):
    def work(ask):
        # A new mesh each time: meshes keep what was computed for them.
        mesh = core.TriangleMesh(*soft_cube(20), progress=ask)
        run(mesh, *painted(mesh), ask)

    assert silent(work) <= SHORT


def test_the_watch_names_kernels_that_do_not_ask(silent):
    sharpen = lambda ask: core.sharpen_geometry(core.TriangleMesh(*soft_cube(20)))  # noqa: E731
    assert "walk_exactly" in silent(sharpen)
    image = np.zeros((300, 20), dtype=np.float32)
    assert silent(lambda ask: core.sharpen_image(image, core.ImageSettings(time=16.0)))


@pytest.mark.parametrize(
    "settings",
    [
        {"background": "nearest"},
        {"channels": "luminance", "smoothing_passes": 2},
        {"content": "normals"},
        {"what": "photo", "width": 3.0},
        {"time": 16.0},
    ],
)
def test_kernels_on_textures_ask(silent, settings):
    vertices, faces = grid(40, 40)
    uv = 0.1 + 0.02 * vertices[faces][..., :2]
    rows = np.linspace(0, 1, 300)
    image = np.sin(7 * rows[:, None, None] + [1.0, 2.0, 3.0] * rows[None, :, None]) / 2 + 0.5
    weights = np.full((300, 300), 0.5)

    def work(ask):
        mesh = core.TriangleMesh(vertices, faces, progress=ask)
        core.sharpen_texture(
            mesh, uv, image, core.TextureSettings(**settings), mask=weights, progress=ask
        )

    assert silent(work) <= SHORT


@pytest.mark.parametrize("settings", [{}, {"content": "normals"}])
def test_kernels_that_denoise_textures_ask(silent, settings):
    vertices, faces = grid(40, 40)
    uv = 0.1 + 0.02 * vertices[faces][..., :2]
    image = 0.5 + 0.1 * np.random.default_rng(0).normal(size=(300, 300, 3))
    weights = np.full((300, 300), 0.5)

    def work(ask):
        mesh = core.TriangleMesh(vertices, faces, progress=ask)
        chosen = core.BeltramiTextureSettings(**settings)
        core.beltrami_texture(mesh, uv, image, chosen, mask=weights, progress=ask)

    assert silent(work) <= SHORT


def test_kernels_on_images_ask(silent):
    image = np.random.default_rng(0).random((300, 20, 4)).astype(np.float32)
    settings = core.ImageSettings(time=2.0)
    assert not silent(lambda ask: core.sharpen_image(image, settings, progress=ask))


@pytest.mark.parametrize("what", ["drawing", "photo"])
def test_kernels_on_images_ask_by_width(silent, what):
    image = np.random.default_rng(0).random((300, 20, 4)).astype(np.float32)
    settings = core.ImageSettings(what=what, width=4.0)
    assert not silent(lambda ask: core.sharpen_image(image, settings, progress=ask))


def test_kernels_that_denoise_images_ask(silent):
    image = np.random.default_rng(0).random((300, 20, 4)).astype(np.float32)
    settings = core.BeltramiSettings(time=0.2)
    denoise = find("beltrami_image").function(2.0)
    assert not silent(lambda ask: denoise(image, settings=settings, progress=ask))


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


def test_sparse_matrices_are_multiplied_in_blocks(monkeypatch):
    monkeypatch.setattr(parallel, "most_threads", 1)
    matrix = diagonal_matrix(np.ones(20 << 10))

    def multiply(count):
        with reporting(count):
            product(matrix, matrix)

    assert sum(questions(multiply).values()) >= 16
