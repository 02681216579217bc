# SPDX-License-Identifier: GPL-3.0-or-later
import numpy as np
import pytest
import scipy.sparse.csgraph
from shapes import Counting, cube, fan, grid, icosphere, shuffled, subdivide
from shock_filter import core
from shock_filter.core.base.progress import reporting
from shock_filter.core.mesh import weld as weld_module
from shock_filter.core.mesh.adjacency import connected_parts, within_rings
from shock_filter.core.mesh.order import is_scattered, sorted_along_curve
from shock_filter.core.mesh.triangle_mesh import part_of
from shock_filter.core.mesh.weld import split_at_jumps

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])


def brute_twins(faces):
    """Half-edge pairs by a dictionary, for consistently wound faces."""
    edges = {}
    for f, face in enumerate(faces):
        for k in range(3):
            edges.setdefault(frozenset((face[k], face[(k + 1) % 3])), []).append(3 * f + k)
    twins = np.full(3 * len(faces), -1)
    for pair in edges.values():
        if len(pair) == 2:
            twins[pair[0]], twins[pair[1]] = pair[1], pair[0]
    return twins.reshape(-1, 3)


@pytest.mark.parametrize(
    ("vertices", "faces", "words"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3), int), "no vertices"),
        (TRIANGLE, np.zeros((0, 3), int), "no faces"),
        (TRIANGLE[:, :2], [[0, 1, 2]], "shape"),
        (TRIANGLE, [[0, 1, 2, 0]], "triangulate"),
        (TRIANGLE, [[0.0, 1.0, 2.0]], "integers"),
        (TRIANGLE, [[0, 1, 3]], "0 to 2"),
        (TRIANGLE, [[0, 1, -1]], "-1"),
        ([[0, 0, 0], [np.nan, 0, 0], [0, 1, 0]], [[0, 1, 2]], "Vertex 1"),
        ([[0, 0, 0], [np.inf, 0, 0], [0, 1, 0]], [[0, 1, 2]], "infinity"),
        ("abc", [[0, 1, 2]], "numbers"),
        ([["0", "0", "0"]] * 3, [[0, 1, 2]], "numbers"),
        (TRIANGLE * 1j, [[0, 1, 2]], "numbers"),
        ([[0, 0, 0], [1, 0]], [[0, 1, 2]], "numbers"),
        (TRIANGLE, [[0, 1, 2], [0, 1]], "triangulate"),
        (np.zeros((3, 3)), [[0, 1, 2]], "zero area"),
        (TRIANGLE, [[0, 1, 1]], "zero area"),
    ],
)
def test_bad_input_is_refused(vertices, faces, words):
    with np.errstate(all="ignore"), pytest.raises(core.InvalidMesh, match=words):
        core.TriangleMesh(vertices, faces)


@pytest.mark.parametrize("size", [1e200, 1e-200])
def test_sizes_whose_squares_leave_the_range_of_floats_are_refused(size):
    with pytest.raises(core.InvalidMesh, match="scale it"):
        core.TriangleMesh(TRIANGLE * size, [[0, 1, 2]])


def test_a_loose_vertex_far_away_does_not_matter():
    vertices, faces = icosphere(3)
    vertices *= [1, 1.5, 2]
    settings = core.GeometrySettings.of_paper()
    expected = core.sharpen_geometry(core.TriangleMesh(vertices, faces), settings)
    assert not np.array_equal(expected, vertices)
    far = core.TriangleMesh(np.vstack([vertices, [1e15, 0, 0]]), faces)
    assert np.allclose(core.sharpen_geometry(far, settings)[:-1], expected, atol=1e-9)
    assert is_scattered(far) is False
    assert len(sorted_along_curve(far)[1]) == len(vertices) + 1


@pytest.mark.parametrize("shape", [grid(7, 5), icosphere(2), cube(4)])
def test_twins_agree_with_brute_force(shape):
    mesh = core.TriangleMesh(*shape)
    assert np.array_equal(mesh.twins, brute_twins(shape[1]))
    assert not mesh.flipped.any()


def test_twins_at_a_vertex_of_many_faces():
    n = 500
    around = np.linspace(0, 2 * np.pi, n, endpoint=False)
    vertices = np.vstack([np.stack([np.cos(around), np.sin(around), 0 * around], 1), [0, 0, 1]])
    faces = np.stack([np.arange(n), (np.arange(n) + 1) % n, np.full(n, n)], 1)
    for hub_first in (False, True):
        if hub_first:  # the hub has the lowest number, so that all edges are matched there
            vertices, faces = np.roll(vertices, 1, axis=0), (faces + 1) % (n + 1)
        assert np.array_equal(core.TriangleMesh(vertices, faces).twins, brute_twins(faces))


def test_neighbours_agree_with_brute_force():
    vertices, faces = grid(6, 5)
    start, ring = core.TriangleMesh(vertices, faces).neighbours
    for v in range(len(vertices)):
        expected = set(faces[(faces == v).any(axis=1)].ravel()) - {v}
        found = ring[start[v] : start[v + 1]]
        assert set(found) == expected
        assert len(found) == len(expected)


def test_edge_of_three_faces_is_a_border():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0]])
    mesh = core.TriangleMesh(vertices, [[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    assert (mesh.twins == -1).all()


def test_flipped_faces_are_turned_by_majority():
    vertices, faces = icosphere(2)
    bad = np.arange(len(faces)) % 3 == 0
    faces = np.where(bad[:, None], faces[:, ::-1], faces)
    mesh = core.TriangleMesh(vertices, faces)
    assert np.array_equal(mesh.flipped, bad)
    assert (mesh.twins >= 0).all()
    centres = vertices[mesh.faces].mean(axis=1)
    assert ((mesh.normals * centres).sum(axis=1) > 0.9).all()


def test_a_moebius_strip_is_accepted():
    n = 30
    turn = np.linspace(0, np.pi, n, endpoint=False)
    direction = np.stack([np.cos(2 * turn), np.sin(2 * turn), 0 * turn], 1)
    up = direction * np.cos(turn)[:, None] + np.sin(turn)[:, None] * [0, 0, 1]
    vertices = np.concatenate([4 * direction - up, 4 * direction + up])
    i, j = np.arange(n - 1), np.arange(1, n)
    faces = np.concatenate([np.stack([i, j, i + n], 1), np.stack([j, j + n, i + n], 1)])
    faces = np.concatenate([faces, [[n - 1, n, 2 * n - 1], [n, 0, 2 * n - 1]]])
    mesh = core.TriangleMesh(vertices, faces)
    assert np.isfinite(core.sharpen_geometry(mesh)).all()
    out = core.sharpen_geometry(mesh, core.GeometrySettings.of_paper())
    assert np.isfinite(out).all()
    assert not np.array_equal(out, vertices)


def test_lengths_areas_and_normals():
    mesh = core.TriangleMesh(*grid(2, 2))
    # 12 sides of length 1 and 4 diagonals.
    length = (12 + 4 * 2**0.5) / 16
    assert mesh.mean_edge_length == pytest.approx(length)
    assert np.allclose(mesh.areas, 0.5 / length**2)
    assert np.allclose(mesh.normals, [0, 0, 1])


def test_zero_area_faces_measure_exactly_zero():
    vertices = np.vstack([TRIANGLE, [[0.5, 0, 0], [0, 0, 0]]])
    mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 3, 1], [0, 4, 2], [2, 2, 1]])
    assert (mesh.areas[1:] == 0).all()
    assert (mesh.normals[1:] == 0).all()


def test_input_is_neither_kept_nor_changed():
    vertices, faces = icosphere(1)
    faces[0] = faces[0, ::-1]
    before = vertices.copy(), faces.copy()
    mesh = core.TriangleMesh(vertices, faces)
    core.sharpen_geometry(mesh, core.GeometrySettings.of_paper())
    assert np.array_equal(vertices, before[0])
    assert np.array_equal(faces, before[1])
    vertices[:] = 0
    assert mesh.vertices.any()


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.int64, np.uint64])
def test_any_integer_type_of_faces(dtype):
    vertices, faces = icosphere(1)
    mesh = core.TriangleMesh(vertices.astype(np.float32), faces.astype(dtype))
    assert np.array_equal(mesh.faces, faces)


def test_weld_finds_the_first_of_equal_vertices():
    points = np.array([[1.0, 0, 0], [0, 0, 0], [1, 0, 0], [-0.0, 0, 0], [2, 0, 0]])
    representatives, index = core.weld(points)
    assert representatives.tolist() == [0, 1, 4]
    assert index.tolist() == [0, 1, 0, 1, 2]


def test_weld_agrees_with_sorting_points():
    rng = np.random.default_rng(0)
    points = rng.integers(-3, 4, (5000, 3)) * rng.choice([1.0, 1e-7, 1e9], (5000, 1))
    representatives, index = core.weld(points)
    assert np.array_equal(points[representatives][index], points)
    assert len(representatives) == len(np.unique(points + 0.0, axis=0))
    assert (np.diff(representatives) > 0).all()


@pytest.mark.parametrize("rings", [0, 1, 4, 50])
def test_vertices_within_rings_agree_with_brute_force(rings):
    vertices, faces = grid(12, 9)
    mesh = core.TriangleMesh(vertices, faces[5:])
    chosen = np.zeros(mesh.vertex_count, dtype=bool)
    chosen[[3, 60]] = True
    expected = chosen.copy()
    for _ in range(rings):
        touched = expected[mesh.faces].any(axis=1)
        expected[mesh.faces[touched]] = True
    before = chosen.copy()
    assert np.array_equal(within_rings(mesh.neighbours, chosen, rings), expected)
    assert np.array_equal(chosen, before)


def test_connected_parts_agree_with_scipy():
    one, two = grid(4, 3), cube()
    vertices, faces, _, _ = shuffled(
        np.concatenate([one[0], one[0], two[0], TRIANGLE[:1]]),
        np.concatenate([one[1], one[1] + len(one[0]), two[1] + 2 * len(one[0])]),
    )
    mesh = core.TriangleMesh(vertices, faces)
    part, count = connected_parts(mesh.neighbours)
    start, ring = mesh.neighbours
    graph = scipy.sparse.csr_matrix((np.ones(len(ring)), ring, start), (len(part), len(part)))
    expected, labels = scipy.sparse.csgraph.connected_components(graph, directed=False)
    assert count == expected == 4  # the loose vertex is a part
    assert (part == labels).all()


def test_sorting_along_a_curve_keeps_the_surface_and_brings_neighbours_together():
    vertices, faces = icosphere(7)
    vertices, faces, _, _ = shuffled(vertices, faces)
    mesh = core.TriangleMesh(vertices, faces)
    assert is_scattered(mesh)
    ordered, vertex_order, face_order = sorted_along_curve(mesh)
    assert not is_scattered(ordered)
    assert np.array_equal(ordered.vertices, vertices[vertex_order])
    assert np.array_equal(vertex_order[ordered.faces], faces[face_order])
    assert not is_scattered(core.TriangleMesh(*icosphere(3)))


def test_a_scattered_mesh_stays_scattered_when_it_is_subdivided():
    vertices, faces, _, _ = shuffled(*icosphere(6))
    assert is_scattered(core.TriangleMesh(*subdivide(vertices, faces)))
    assert not is_scattered(core.TriangleMesh(*icosphere(7)))


def two_sheets(apart):
    """Two squares of four triangles each, this far from each other; the second is turned over."""
    points = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], dtype=float)
    middle = np.array([(0.5, 0.5, 0.0)])
    fan = np.array([(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)])
    sheet = np.concatenate([points, middle])
    vertices = np.concatenate([sheet, sheet + (0, 0, apart)])
    return vertices, np.concatenate([fan, fan[:, ::-1] + len(sheet)])


def test_sheets_that_lie_on_each_other_are_joined_at_their_rims_only():
    vertices, faces = two_sheets(apart=0.0)
    joined = core.weld_borders(vertices, faces)
    np.testing.assert_array_equal(joined[:4], faces[:4])
    np.testing.assert_array_equal(np.unique(joined[4:]), [0, 1, 2, 3, 9])
    assert (core.TriangleMesh(vertices, joined).twins >= 0).all()
    vertices, faces = two_sheets(apart=1.0)
    np.testing.assert_array_equal(core.weld_borders(vertices, faces), faces)


def test_a_surface_split_along_a_seam_is_joined():
    vertices, faces = two_sheets(apart=1.0)
    fan = faces[:4]
    split = np.concatenate([vertices[:5], vertices[[0, 2, 4]]])
    cut = np.concatenate([fan[:2], [(6, 3, 7), (3, 5, 7)]])
    np.testing.assert_array_equal(core.weld_borders(split, cut), fan)
    assert (core.TriangleMesh(split, cut).twins < 0).sum() == 8


def cancel_after(count):
    """A callback that allows `count` questions, and keeps what it was told."""
    messages = []

    def progress(fraction, message):
        messages.append(message)
        assert fraction == 0.0
        return len(messages) <= count

    return progress, messages


@pytest.mark.parametrize("count", [0, 1, 2, 3])
@pytest.mark.parametrize("make", [core.TriangleMesh, core.weld_borders])
def test_building_a_mesh_can_be_cancelled(make, count):
    vertices, faces = icosphere(3)
    progress, messages = cancel_after(count)
    with pytest.raises(core.Cancelled):
        make(vertices, faces, progress=progress)
    assert messages == ["Preparing the mesh"] * (count + 1)


def test_welding_can_be_cancelled_between_chunks():
    points = np.random.default_rng(0).random((100_000, 3))
    progress, messages = cancel_after(2)
    with pytest.raises(core.Cancelled):
        core.weld(points, progress=progress)
    assert messages == ["Finding vertices at the same place"] * 3


def test_welding_numbers_places_in_the_order_of_the_input():
    rng = np.random.default_rng(2)
    places = np.concatenate([rng.random((500, 3)), np.mgrid[:8, :8, :8].reshape(3, -1).T - 4.0])
    points = places[rng.integers(0, len(places), 40_000)]
    points *= np.where(points == 0, rng.choice([-1.0, 1.0], points.shape), 1.0)  # -0.0, too
    representatives, index = core.weld(points)
    _, first = np.unique(points + 0.0, axis=0, return_index=True)
    np.testing.assert_array_equal(representatives, np.sort(first))
    np.testing.assert_array_equal(points[representatives][index], points)


def test_cutting_at_jumps_can_be_cancelled():
    vertices, faces = icosphere(2)
    mesh = core.TriangleMesh(vertices, faces)
    signal = np.repeat(np.arange(len(faces), dtype=float), 3)[:, None]
    progress, messages = cancel_after(1)
    with pytest.raises(core.Cancelled), reporting(progress):
        split_at_jumps(mesh, signal)
    assert messages == ["Finding jumps"] * 2


def test_a_moved_mesh_is_checked():
    mesh = core.TriangleMesh(*icosphere(1))
    moved = mesh.moved_to(2 * mesh.vertices)
    assert moved.mean_edge_length == pytest.approx(2 * mesh.mean_edge_length)
    assert moved.twins is mesh.twins
    line = mesh.vertices * [1.0, 0.0, 0.0]
    broken = mesh.vertices.copy()
    broken[3, 1] = np.nan
    for positions, words in (
        (0 * line, "shrunk"),
        (line, "shrunk"),
        (broken, "Vertex 3"),
        (1e200 * mesh.vertices, "units large"),
    ):
        with pytest.raises(core.InvalidMesh, match=words):
            mesh.moved_to(positions)


@pytest.mark.parametrize("values", ["random", "same", "two in turn"])
def test_work_of_splitting_at_a_hub_grows_with_its_corners_and_not_with_their_square(
    values, monkeypatch
):
    # By the kernels as Python, with a signal that counts how often it is read.
    monkeypatch.setattr(weld_module, "_keys", weld_module._keys.py_func)
    reads = []
    for count in (500, 4000):
        mesh = core.TriangleMesh(*fan(count))
        signal = np.zeros((3 * count, 1))
        if values == "random":
            signal = np.random.default_rng(0).random(signal.shape)
        elif values == "two in turn":
            signal[::6] = 1.0
        counting = Counting(signal)
        leaders = np.empty(len(signal), dtype=np.int32)
        weld_module._lead_corners.py_func(0, 1, *mesh.corners, counting, leaders)
        reads.append(counting.reads)
    assert 0 < reads[1] < 8.5 * reads[0]


def test_corners_at_a_hub_are_split_by_their_values():
    mesh = core.TriangleMesh(*fan(300))
    signal = np.random.default_rng(0).integers(-1, 2, size=(900, 2)) * 0.5
    signal[::7] *= -1  # 0.0 and -0.0 are equal
    signal[5::11] += np.random.default_rng(1).random((82, 2))
    cut, values = split_at_jumps(mesh, signal)
    assert np.array_equal(values[cut.faces].reshape(-1, 2), signal)
    different = np.column_stack([mesh.faces.reshape(-1), signal + 0.0])
    assert cut.vertex_count == len(np.unique(different, axis=0))


def test_a_part_of_a_mesh_is_the_mesh_of_its_faces_in_the_unit_of_the_whole():
    vertices, faces = icosphere(3)
    mesh = core.TriangleMesh(vertices * [1.0, 2.0, 0.5], faces)
    chosen = np.flatnonzero(mesh.normals[:, 2] > 0.1)
    part, index = part_of(mesh, chosen)
    np.testing.assert_array_equal(index[part.faces], mesh.faces[chosen])
    other = core.TriangleMesh(part.vertices, part.faces)
    np.testing.assert_array_equal(part.twins, other.twins)
    for mine, theirs in zip(
        (*part.corners, *part.neighbours), (*other.corners, *other.neighbours), strict=True
    ):
        np.testing.assert_array_equal(mine, theirs)
    assert part.mean_edge_length == mesh.mean_edge_length
    np.testing.assert_array_equal(part.normals, mesh.normals[chosen])
    np.testing.assert_array_equal(part.areas, mesh.areas[chosen])
