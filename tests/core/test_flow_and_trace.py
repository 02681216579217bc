# SPDX-License-Identifier: GPL-3.0-or-later
import math

import literal_walk
import numpy as np
import pytest
from shapes import cube, fan, grid, icosphere
from shock_filter import core
from shock_filter.core.flow import potential as flow
from shock_filter.core.flow import trace
from shock_filter.core.flow.walk import MOST_AROUND
from shock_filter.core.mesh import calculus


def trace_faces(mesh, potential, time, step=None):
    """Ends of the exact walk, or of the literal one in steps of some length."""
    if step is None:
        return trace.trace_faces(mesh, potential, time)
    return literal_walk.trace_faces(mesh, potential, time, step)


def points(mesh, faces, coordinates):
    return (mesh.vertices[mesh.faces[faces]] * coordinates[:, :, None]).sum(axis=1)


def centres(mesh):
    return mesh.vertices[mesh.faces].mean(axis=1)


def unit_grid(*args, **kwargs):
    """A grid whose mean edge length is 1, so that units agree with coordinates."""
    vertices, faces = grid(*args, **kwargs)
    return core.TriangleMesh(vertices / core.TriangleMesh(vertices, faces).mean_edge_length, faces)


def test_potential_and_flow_of_a_linear_and_a_quadratic_signal():
    mesh = unit_grid(20, 20)
    x = mesh.vertices[:, 0]
    potential, field = core.flow_field(mesh, 3 * x, core.ShockSettings(smoothing_passes=0))
    assert np.allclose(potential, 9)
    assert np.allclose(field, 0)
    # I = x^2 / 2: P = x^2 and u = x, up to the averaging over faces, away from the border.
    potential, field = core.flow_field(mesh, x * x / 2, core.ShockSettings(smoothing_passes=0))
    inside = (abs(centres(mesh)[:, :2] - x.max() / 2) < x.max() / 2 - 3).all(axis=1)
    assert np.allclose(field[inside, 0], centres(mesh)[inside, 0], atol=0.3)
    assert np.allclose(field[inside, 1], 0, atol=0.01)


def test_channels_add_up():
    mesh = unit_grid(8, 8, jitter=0.3)
    signal = np.random.default_rng(0).normal(size=(mesh.vertex_count, 3))
    both = core.flow_field(mesh, signal)[0]
    apart = sum(core.flow_field(mesh, signal[:, j])[0] for j in range(3))
    assert np.allclose(both, apart)


def test_normals_of_a_sphere_have_the_potential_of_its_curvatures():
    errors = []
    for level in (3, 4, 5):
        mesh = core.TriangleMesh(*icosphere(level, radius=7.0))
        potential, _ = core.flow_field(mesh, mesh.vertices / 7, core.ShockSettings())
        # Both principal curvatures are 1 / radius (paper 4.1, first remark).
        exact = 2 * (mesh.mean_edge_length / 7) ** 2
        errors.append(np.sqrt(np.mean((potential / exact - 1) ** 2)))
    assert errors[2] < 0.02
    assert errors[0] > 1.7 * errors[1] > 1.7**2 * errors[2]


@pytest.mark.parametrize("step", [None, 0.05])
def test_traces_in_a_uniform_flow_are_straight(step):
    mesh = unit_grid(20, 20, jitter=0.3)
    slope = np.array([0.6, -0.4])
    potential = mesh.vertices[:, :2] @ slope
    faces, coordinates = trace_faces(mesh, potential, 7.0, step)
    end = points(mesh, faces, coordinates)[:, :2]
    expected = centres(mesh)[:, :2] - 0.5 * slope * 7.0
    side = mesh.vertices.max()
    inside = ((expected > 0) & (expected < side)).all(axis=1)
    assert inside.sum() > 400
    assert np.allclose(end[inside], expected[inside])
    # The others end on the border, on their straight line.
    out = end[~inside]
    assert np.isclose(np.minimum(abs(out), abs(out - side)).min(axis=1), 0).all()
    offset = out - centres(mesh)[~inside, :2]
    assert np.allclose(offset[:, 0] * slope[1] - offset[:, 1] * slope[0], 0)


@pytest.mark.parametrize("step", [None, 0.05])
def test_folding_the_surface_does_not_bend_traces(step):
    straight = unit_grid(12, 12)
    x, y, _ = straight.vertices.T
    fold = np.unique(x)[6]
    bent = np.stack([np.minimum(x, fold), y, np.maximum(x - fold, 0)], axis=1)
    folded = core.TriangleMesh(bent, straight.faces)
    potential = 0.7 * x + 0.2 * y + 0.05 * x * y
    a = trace_faces(straight, potential, 9.0, step)
    b = trace_faces(folded, potential, 9.0, step)
    assert np.array_equal(a[0], b[0])
    assert np.allclose(a[1], b[1])


def test_zero_time_and_zero_flow_stay_at_the_centre():
    mesh = unit_grid(4, 4)
    for potential, time in ((mesh.vertices[:, 0], 0.0), (np.ones(mesh.vertex_count), math.inf)):
        faces, coordinates = trace_faces(mesh, potential, time)
        assert np.array_equal(faces, np.arange(mesh.face_count))
        assert np.array_equal(coordinates, np.full((mesh.face_count, 3), 1 / 3))


def test_the_exact_walk_slides_down_a_valley():
    # P falls towards the line y = 0, which is an edge of the grid, and gently along it: traces
    # reach the line and then slide with half the slope along it.
    mesh = unit_grid(20, 10)
    x, y, _ = mesh.vertices.T
    middle = np.unique(y)[5]
    potential = 0.2 * abs(y - middle) + 0.4 * x + 10
    seeds = centres(mesh)
    time = 30.0
    faces, coordinates = trace_faces(mesh, potential, time)
    end = points(mesh, faces, coordinates)
    near = (abs(seeds[:, 1] - middle) < 2.5) & (seeds[:, 0] > 0.2 * time + 1)
    assert near.sum() > 20
    assert np.allclose(end[near, 1], middle)
    assert np.allclose(end[near, 0], seeds[near, 0] - 0.2 * time)


def test_a_flow_that_turns_back_stops_the_walk():
    mesh = unit_grid(20, 10)
    _, y, _ = mesh.vertices.T
    middle = np.unique(y)[5]
    faces, coordinates = trace_faces(mesh, abs(y - middle), math.inf)
    assert np.allclose(points(mesh, faces, coordinates)[:, 1], middle)


def random_landscape():
    mesh = core.TriangleMesh(*icosphere(4))
    rng = np.random.default_rng(4)
    noise = calculus.smooth_vertices(mesh, rng.normal(size=(mesh.vertex_count, 1)), 3)
    return mesh, 20 * noise[:, 0] ** 2 / (noise**2).max()


def test_walks_go_downhill_and_further_with_time():
    mesh, potential = random_landscape()
    last = potential[mesh.faces].mean(axis=1)
    for time in (0.01, 0.1, 1.0, 10.0, math.inf):
        faces, coordinates = trace_faces(mesh, potential, time)
        assert coordinates.min() >= 0
        assert np.allclose(coordinates.sum(axis=1), 1)
        height = (potential[mesh.faces[faces]] * coordinates).sum(axis=1)
        assert (height <= last + 1e-9).all()
        last = height


def test_the_exact_walk_is_the_limit_of_small_steps():
    mesh, potential = random_landscape()
    exact = points(mesh, *trace_faces(mesh, potential, 3.0)) / mesh.mean_edge_length
    medians = []
    for step in (0.1, 0.02, 0.004):
        literal = trace_faces(mesh, potential, 3.0, step)
        distances = np.linalg.norm(points(mesh, *literal) / mesh.mean_edge_length - exact, axis=1)
        medians.append(np.median(distances))
    assert medians[0] < 0.05
    # First order: five times smaller steps come about five times closer.
    assert medians[1] < medians[0] / 3
    assert medians[2] < medians[1] / 3


def test_zero_area_faces_end_traces_without_nan():
    vertices, faces = grid(6, 6)
    # A sliver of no area between the two halves of one square.
    vertices = np.vstack([vertices, 0.5 * (vertices[faces[20, 0]] + vertices[faces[20, 2]])])
    a, b, c = faces[20]
    faces = np.vstack([np.delete(faces, 20, axis=0), [[a, b, c], [a, len(vertices) - 1, c]]])
    mesh = core.TriangleMesh(vertices, faces)
    potential = vertices[:, 0] ** 2 + vertices[:, 1]
    for step in (None, 0.1):
        _, coordinates = trace_faces(mesh, potential, math.inf, step)
        assert np.isfinite(coordinates).all()


def test_surroundings_silence_a_sphere_and_keep_a_crease():
    sphere = core.TriangleMesh(*icosphere(4))
    bumps = 0.03 * np.random.default_rng(5).normal(size=sphere.vertices.shape)
    sphere = sphere.moved_to(sphere.vertices + bumps * sphere.mean_edge_length)
    signal = calculus.average_to_vertices(sphere, sphere.normals)
    plain = flow.flow_potential(sphere, signal, 1)
    gated = flow.above_surroundings(sphere, plain, 1.5, 256.0)
    assert np.count_nonzero(gated) < 0.02 * len(gated)

    box = core.TriangleMesh(*cube(12))
    signal = calculus.average_to_vertices(box, box.normals)
    plain = flow.flow_potential(box, signal, 1)
    gated = flow.above_surroundings(box, plain, 1.1, 256.0)
    on_edge = (abs(box.vertices) > 5.9).sum(axis=1) == 2
    assert np.median(gated[on_edge] / plain[on_edge]) > 0.2
    assert (gated[on_edge] > 0).all()
    assert np.array_equal(flow.above_surroundings(box, plain, 0.0, 1.0), plain)
    assert (gated <= plain).all()


def test_walks_that_are_cut_off_are_counted(monkeypatch, caplog):
    mesh, potential = random_landscape()
    trace_faces(mesh, potential, 10.0)
    assert not caplog.records
    monkeypatch.setattr(trace, "MOST_STEPS", 2)
    _, coordinates = trace_faces(mesh, potential, 10.0)
    (record,) = caplog.records
    assert 100 < record.args[0] <= mesh.face_count
    assert np.isfinite(coordinates).all()


@pytest.mark.parametrize("count, ends", [(600, False), (1400, True)])
def test_a_walk_ends_at_a_vertex_with_more_than_a_thousand_faces(count, ends):
    # Down a valley along the x axis, whose middle is the hub.
    mesh = core.TriangleMesh(*fan(count))
    x, y, _ = mesh.vertices.T
    faces, coordinates = trace.trace_faces(mesh, x + 0.3 * abs(y), math.inf)
    beside = (centres(mesh)[:, 0] > 0.6) & (abs(centres(mesh)[:, 1]) < 0.1)
    end = points(mesh, faces, coordinates)[beside]
    assert len(end) > 10
    np.testing.assert_allclose(end[:, 0], 0.0 if ends else -1.0, atol=1e-6)


@pytest.mark.parametrize("count", [4000, 40_000])
def test_work_around_a_hub_grows_with_its_faces_and_not_with_their_square(count, caplog):
    # Straight lines across the fan, past its hub.
    mesh = core.TriangleMesh(*fan(count))
    beginnings, _ = trace.face_centres(mesh)
    with caplog.at_level("INFO"):
        ends, coordinates = trace.trace_faces(mesh, mesh.vertices[:, 0], 4.0)
    crossed = abs(ends - beginnings)
    crossed = np.minimum(crossed, count - crossed)
    assert 300 < crossed.max() <= MOST_AROUND
    assert np.isfinite(coordinates).all()
    told = [record for record in caplog.records if "ended around vertices" in record.message]
    assert len(told) == (count > 4000)


def test_sharpening_around_a_hub_asks_often_and_stays_in_range():
    mesh = core.TriangleMesh(*fan(20_000))
    colors = 0.5 + 0.4 * np.sin(3 * np.arctan2(mesh.vertices[:, 1:2], mesh.vertices[:, :1]))
    asked = []
    drawing = core.ShockSettings(what="drawing")
    ask = lambda *_: asked.append(1) or True  # noqa: E731
    out = core.sharpen_vertex_signal(mesh, colors, drawing, progress=ask)
    assert len(asked) > 100
    assert colors.min() <= out.min() and out.max() <= colors.max()
    assert out.std() > 1.02 * colors.std()


def test_the_longer_the_time_the_wider_are_features_that_stand_out():
    mesh = core.TriangleMesh(*grid(40, 40))
    ridge = (abs(mesh.vertices[:, 0] - 20) <= 4).astype(float)
    middle = abs(mesh.vertices[:, 0] - 20) <= 1
    kept = [
        flow.above_surroundings(mesh, ridge, 1.0, time)[middle].min() for time in (256.0, 65536.0)
    ]
    assert kept == pytest.approx([0.0, 1.0])
