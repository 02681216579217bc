# SPDX-License-Identifier: GPL-3.0-or-later
import math

import numpy as np
import pytest
from shapes import cube, grid, icosphere, rotation, shuffled
from shock_filter import core
from shock_filter.core.mesh import calculus

SCHEMES = [
    {},
    {"channels": "independent"},
    {"channels": "luminance"},
    {"sampling": "nearest"},
]


def soft_stripes(mesh, passes=3, waves=2.0):
    """Colors in soft bands around a mesh."""
    wave = np.sin(waves * mesh.vertices @ [[1.0, 0.2, 0.4], [0.3, 1, 0.1], [0, 0.5, 1]])
    return calculus.smooth_vertices(mesh, (wave > 0).astype(float), passes)


@pytest.fixture(scope="module")
def ball():
    mesh = core.TriangleMesh(*icosphere(4))
    return mesh, soft_stripes(mesh, waves=4.0)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(), (1,), (5,)])
def test_zero_time_and_zero_mask_return_the_input_bit_for_bit(ball, dtype, shape):
    mesh, _ = ball
    rng = np.random.default_rng(0)
    signal = rng.random((mesh.vertex_count, *shape)).astype(dtype)
    corners = rng.random((mesh.face_count, 3, *shape)).astype(dtype)
    none = np.zeros(mesh.vertex_count)
    for given, function in (
        (signal, core.sharpen_vertex_signal),
        (corners, core.sharpen_corner_signal),
    ):
        before = given.copy()
        for out in (
            function(mesh, given, core.ShockSettings(time=0)),
            function(mesh, given, mask=none),
        ):
            assert np.array_equal(out, before)
            assert out.dtype == dtype
            assert out is not given
        assert np.array_equal(given, before)


@pytest.mark.parametrize("settings", SCHEMES)
def test_values_stay_in_range_and_constants_stay(ball, settings):
    mesh, colors = ball
    settings = core.ShockSettings(time=50.0, **settings)
    out = core.sharpen_vertex_signal(mesh, colors, settings)
    assert (out.min(axis=0) >= colors.min(axis=0)).all()
    assert (out.max(axis=0) <= colors.max(axis=0)).all()
    flat = np.full_like(colors, 0.3)
    assert np.array_equal(core.sharpen_vertex_signal(mesh, flat, settings), flat)


@pytest.mark.parametrize("settings", SCHEMES)
def test_soft_edges_steepen(ball, settings):
    mesh, colors = ball
    out = core.sharpen_vertex_signal(mesh, colors, core.ShockSettings(time=200.0, **settings))

    def steepness(values):
        return np.sqrt((calculus.gradient(mesh, values) ** 4).sum(axis=(1, 2)).mean())

    assert steepness(out) > 1.1 * steepness(colors)


def test_nearest_sampling_makes_no_new_values_at_corners(ball):
    mesh, colors = ball
    settings = core.ShockSettings(time=300.0, sampling="nearest")
    out = core.sharpen_corner_signal(mesh, colors[mesh.faces], settings)
    known = {tuple(row) for row in colors}
    assert all(tuple(row) in known for row in out.reshape(-1, 3))
    assert (out != colors[mesh.faces]).any(axis=2).mean() > 0.1


def test_corners_that_agree_give_what_vertices_give(ball):
    mesh, colors = ball
    corners = core.sharpen_corner_signal(mesh, colors[mesh.faces], core.ShockSettings(time=80.0))
    vertices = core.sharpen_vertex_signal(mesh, colors, core.ShockSettings(time=80.0))
    sums = np.zeros_like(colors)
    np.add.at(sums, mesh.faces.reshape(-1), corners.reshape(-1, 3))
    counts = np.bincount(mesh.faces.reshape(-1))
    assert np.allclose(sums / counts[:, None], vertices, atol=1e-12)


def test_jumps_between_corners_stay_and_nothing_flows_across():
    mesh = core.TriangleMesh(*grid(16, 8))
    right = mesh.vertices[mesh.faces][:, :, 0].mean(axis=1) > 8
    ramp = np.clip((mesh.vertices[mesh.faces][:, :, 1] - 2) / 4, 0, 1) ** 2 * 0.3
    corners = np.where(right[:, None], 0.6 + ramp, ramp)
    out = core.sharpen_corner_signal(mesh, corners, core.ShockSettings(time=math.inf))
    assert out[~right].max() <= 0.3
    assert out[right].min() >= 0.6
    assert not np.array_equal(out, corners)


def test_turned_faces_keep_their_corners():
    vertices, faces = icosphere(3)
    mesh = core.TriangleMesh(vertices, faces)
    colors = soft_stripes(mesh, waves=4.0)
    settings = core.ShockSettings(time=80.0)
    expected = core.sharpen_corner_signal(mesh, colors[faces], settings)
    bad = np.arange(len(faces)) % 3 == 0
    faces = np.where(bad[:, None], faces[:, ::-1], faces)
    out = core.sharpen_corner_signal(core.TriangleMesh(vertices, faces), colors[faces], settings)
    assert np.allclose(out, np.where(bad[:, None, None], expected[:, ::-1], expected), atol=1e-9)


def test_loose_vertices_and_zero_area_faces_are_sound():
    vertices, faces = grid(10, 10)
    vertices = np.vstack([vertices, [[50.0, 0, 0], vertices[5]]])
    faces = np.vstack([faces, [[5, len(vertices) - 1, 6], [7, 7, 8]]])
    mesh = core.TriangleMesh(vertices, faces)
    signal = np.random.default_rng(1).random((len(vertices), 3))
    for settings in ({"time": math.inf}, {"time": 3.5}):
        out = core.sharpen_vertex_signal(mesh, signal, core.ShockSettings(**settings))
        assert np.isfinite(out).all()
        assert np.array_equal(out[-2], signal[-2])


def test_order_motion_and_scale_do_not_matter(ball):
    mesh, colors = ball
    settings = core.ShockSettings(time=60.0)
    expected = core.sharpen_vertex_signal(mesh, colors, settings)
    vertices, faces, place, _ = shuffled(mesh.vertices @ rotation().T * 1e5, mesh.faces)
    signal = np.empty_like(colors)
    signal[place] = colors
    out = core.sharpen_vertex_signal(core.TriangleMesh(vertices, faces), signal, settings)[place]
    assert np.mean(abs(out - expected) > 1e-4) < 0.01


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda m: core.sharpen_vertex_signal(m, np.zeros(5)), core.InvalidSignal, "shape"),
        (lambda m: core.sharpen_vertex_signal(m, np.zeros(98, np.uint8)), core.InvalidSignal,
         "float32"),
        (lambda m: core.sharpen_vertex_signal(m, np.full(98, np.nan)), core.InvalidSignal, "NaN"),
        (lambda m: core.sharpen_corner_signal(m, np.zeros((98, 3))), core.InvalidSignal,
         "(192, 3)"),
        (lambda m: core.sharpen_corner_signal(m, np.zeros((192, 3, 2)), mask=np.ones(192)),
         core.InvalidSignal, "mask"),
        (lambda m: core.ShockSettings(channels="red"), core.InvalidSettings, "choose"),
    ],
)  # fmt: skip
def test_bad_input_is_refused(call, error, words):
    mesh = core.TriangleMesh(*cube(4))
    assert (mesh.vertex_count, mesh.face_count) == (98, 192)
    with pytest.raises(error, match=words.replace("(", r"\(").replace(")", r"\)")):
        call(mesh)


@pytest.mark.parametrize("settings", [{}, {"channels": "independent"}])
def test_progress_rises_to_one_and_cancels(ball, settings):
    mesh, colors = ball
    calls = []
    settings = core.ShockSettings(time=3, **settings)
    core.sharpen_vertex_signal(mesh, colors, settings, progress=lambda f, m: calls.append(f) or 1)
    assert calls == sorted(calls)
    assert calls[-1] == 1
    with pytest.raises(core.Cancelled):
        core.sharpen_vertex_signal(mesh, colors, settings, progress=lambda f, m: f < 0.5)
