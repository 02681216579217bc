# SPDX-License-Identifier: GPL-3.0-or-later
import itertools
import math
import subprocess
import sys
import time

import numpy as np
import pytest
from shapes import angles, cube, grid, icosphere, rotation, shuffled
from shock_filter import core
from shock_filter.core.mesh import calculus, order
from shock_filter.core.settings import OF_PAPER
from shock_filter.core.shape import fit
from shock_filter.core.shape import sharpening as shock


def softened(vertices, faces, passes=3):
    mesh = core.TriangleMesh(vertices, faces)
    return core.TriangleMesh(calculus.smooth_vertices(mesh, mesh.vertices, passes), faces)


@pytest.fixture(scope="module")
def soft_cube():
    return softened(*cube(16))


def displacement(mesh, **settings):
    return core.sharpen_geometry(mesh, core.GeometrySettings(**settings)) - mesh.vertices


@pytest.fixture(params=[{}, OF_PAPER], ids=["default", "paper"])
def which(request):
    """The settings beyond the paper: as by default, and without."""
    return request.param


@pytest.mark.parametrize("sampling", ["detail", "linear", "nearest"])
def test_zero_time_returns_the_input_bit_for_bit(soft_cube, sampling):
    settings = core.GeometrySettings(time=0, sampling=sampling)
    out = core.sharpen_geometry(soft_cube, settings)
    assert np.array_equal(out, soft_cube.vertices)
    assert out is not soft_cube.vertices


def test_detail_sampling_begins_at_the_identity(soft_cube):
    tiny = core.sharpen_normals(soft_cube, core.GeometrySettings.of_paper(time=1e-9))
    assert np.allclose(tiny, soft_cube.normals, atol=1e-6)
    settings = core.GeometrySettings.of_paper(time=1e-9, sampling="linear")
    linear = core.sharpen_normals(soft_cube, settings)
    assert angles(linear, soft_cube.normals).max() > 1


def test_nearest_sampling_takes_normals_of_other_faces(soft_cube):
    settings = core.GeometrySettings.of_paper(sampling="nearest", time=math.inf)
    out = core.sharpen_normals(soft_cube, settings)
    known = {tuple(n) for n in soft_cube.normals}
    assert all(tuple(n) in known for n in out)
    assert not np.array_equal(out, soft_cube.normals)


@pytest.mark.parametrize("time", [256.0, 4096.0, math.inf])
def test_softened_creases_become_sharp_again(soft_cube, time):
    sharp = core.TriangleMesh(*cube(16))
    out = core.sharpen_geometry(soft_cube, core.GeometrySettings(time=time))
    before = angles(soft_cube.normals, sharp.normals).mean()
    after = angles(core.TriangleMesh(out, sharp.faces).normals, sharp.normals).mean()
    assert after < 0.5 * before


def test_normals_never_leave_the_range_of_the_input(soft_cube):
    # A cube's normals fill the octants between its sides; with sampling by interpolation, no
    # coordinate can leave what is there already.
    for sampling, of_paper in itertools.product(("linear", "nearest"), (False, True)):
        make = core.GeometrySettings.of_paper if of_paper else core.GeometrySettings
        out = core.sharpen_normals(soft_cube, make(time=math.inf, sampling=sampling))
        assert np.allclose(np.linalg.norm(out, axis=1), 1)
        assert abs(out).max() <= abs(soft_cube.normals).max() + 1e-12


def test_planes_and_spheres_stay(which):
    flat = core.TriangleMesh(*grid(10, 10, jitter=0.3))
    assert abs(displacement(flat, feature_threshold=0, time=math.inf, **which)).max() < 1e-12
    ball = core.TriangleMesh(*icosphere(4))
    # In mean edge lengths; the sphere is a polyhedron, whose own corners are a little sharper.
    assert abs(displacement(ball, **which)).max() < 0.01 * ball.mean_edge_length


def test_a_mask_keeps_vertices_bit_for_bit(soft_cube):
    mask = (soft_cube.vertices[:, 0] > 0).astype(float)
    out = core.sharpen_geometry(soft_cube, mask=mask)
    assert np.array_equal(out[mask == 0], soft_cube.vertices[mask == 0])
    moved = np.linalg.norm(out - soft_cube.vertices, axis=1)[mask == 1]
    assert moved.max() > 0.1
    ones = core.sharpen_geometry(soft_cube, mask=np.ones(soft_cube.vertex_count))
    assert np.array_equal(ones, core.sharpen_geometry(soft_cube))
    none = core.sharpen_geometry(soft_cube, mask=np.zeros(soft_cube.vertex_count))
    assert np.array_equal(none, soft_cube.vertices)


@pytest.mark.parametrize(
    ("mask", "words"),
    [(np.ones(3), "shape"), (np.full(1538, 1.5), "0 to 1"), (np.full(1538, np.nan), "NaN")],
)
def test_bad_masks_are_refused(soft_cube, mask, words):
    assert soft_cube.vertex_count == 1538
    with pytest.raises(core.InvalidSignal, match=words):
        core.sharpen_geometry(soft_cube, mask=mask)


def test_displacement_limit(soft_cube):
    free = np.linalg.norm(displacement(soft_cube), axis=1) / soft_cube.mean_edge_length
    held = displacement(soft_cube, max_displacement=0.1, repeat=3)
    held = np.linalg.norm(held, axis=1) / soft_cube.mean_edge_length
    assert free.max() > 0.2
    assert held.max() == pytest.approx(0.1)


def test_repeating_is_filtering_the_result_again(soft_cube):
    twice = soft_cube.vertices + displacement(soft_cube, repeat=2)
    once = soft_cube.vertices + displacement(soft_cube)
    again = core.sharpen_geometry(core.TriangleMesh(once, soft_cube.faces))
    assert np.allclose(twice, again, atol=1e-5)


def test_mollifying_helps_on_noise():
    sharp = core.TriangleMesh(*cube(20))
    noise = 0.15 * np.random.default_rng(0).normal(size=sharp.vertices.shape)
    noisy = core.TriangleMesh(sharp.vertices + noise, sharp.faces)

    def error(**settings):
        out = core.sharpen_geometry(noisy, core.GeometrySettings.of_paper(**settings))
        return angles(core.TriangleMesh(out, sharp.faces).normals, sharp.normals).mean()

    assert error(mollify_passes=3) < 0.7 * error()


def bumpy():
    """A closed surface without symmetries, with soft creases."""
    vertices, faces = cube(12)
    vertices = vertices * [1.0, 1.3, 0.8] + 0.07 * np.sin(vertices[:, [1, 2, 0]] * 1.7 + [0, 1, 2])
    return softened(vertices, faces).vertices, faces


@pytest.mark.parametrize(
    ("move", "scale"),
    [
        (lambda x: x @ rotation(3).T, 1.0),
        (lambda x: x * 1e-6, 1e-6),
        (lambda x: x * 1e6, 1e6),
        (lambda x: x + [1e6, -1e6, 1e6], 1.0),
        (lambda x: x * [-1, 1, 1], 1.0),
    ],
    ids=["rotated", "small", "large", "far", "mirrored"],
)
def test_motion_and_scale_do_not_matter(move, scale):
    vertices, faces = bumpy()
    expected = move(core.sharpen_geometry(core.TriangleMesh(vertices, faces)))
    mesh = core.TriangleMesh(move(vertices), faces)
    found = core.sharpen_geometry(mesh)
    distance = np.linalg.norm(found - expected, axis=1) / mesh.mean_edge_length
    # What lies around is averaged over cells along the axes, so that turning changes a little.
    assert distance.mean() < 0.025
    assert distance.max() < 0.3


def test_order_of_vertices_faces_and_corners_does_not_matter():
    vertices, faces = bumpy()
    expected = core.sharpen_geometry(core.TriangleMesh(vertices, faces))
    new_vertices, new_faces, place, _ = shuffled(vertices, faces)
    mesh = core.TriangleMesh(new_vertices, new_faces)
    distance = np.linalg.norm(core.sharpen_geometry(mesh)[place] - expected, axis=1)
    assert np.mean(distance > 1e-5 * mesh.mean_edge_length) < 0.01
    assert distance.max() < 0.05 * mesh.mean_edge_length


def test_scattered_meshes_take_the_sorted_way_to_the_same_result(monkeypatch):
    vertices, faces = bumpy()
    faces[::5] = faces[::5, ::-1]
    mesh = core.TriangleMesh(vertices, faces)
    mask = (vertices[:, 0] > 0).astype(float)
    positions, normals = core.sharpen_geometry(mesh, mask=mask), core.sharpen_normals(mesh)
    for module in (shock, order):
        monkeypatch.setattr(module, "is_scattered", lambda mesh: True)
    assert np.allclose(core.sharpen_geometry(mesh, mask=mask), positions, atol=1e-5)
    assert np.allclose(core.sharpen_normals(mesh), normals, atol=1e-9)


def test_normals_of_a_scattered_moebius_strip_are_those_of_its_faces_as_given(monkeypatch):
    # Without two sides, which faces are turned for consistency depends on their order.
    n = 60
    angle = np.arange(n) * 2 * np.pi / n
    across = np.stack([np.cos(angle / 2) * np.cos(angle), np.cos(angle / 2) * np.sin(angle),
                       np.sin(angle / 2)], axis=1)  # fmt: skip
    middle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    vertices = np.concatenate([middle - 0.3 * across, middle + 0.3 * across])
    a, b = np.arange(n), (np.arange(n) + 1) % n
    low, high = np.where(b == 0, n, b), np.where(b == 0, 0, b + n)  # joined the other way round
    faces = np.concatenate([np.stack([a, low, a + n], 1), np.stack([a + n, low, high], 1)])
    faces = np.random.default_rng(0).permutation(faces)
    for module in (shock, order):
        monkeypatch.setattr(module, "is_scattered", lambda mesh: True)
    still = core.GeometrySettings(time=0.0, align_passes=0, where="everywhere")
    found = core.sharpen_normals(core.TriangleMesh(vertices, faces), still)
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    wound = np.cross(b - a, c - a)
    assert (np.einsum("ij,ij->i", found, wound) > 0).all()


def test_flipped_faces_change_nothing_but_their_normals():
    vertices, faces = bumpy()
    expected = core.sharpen_geometry(core.TriangleMesh(vertices, faces))
    normals = core.sharpen_normals(core.TriangleMesh(vertices, faces))
    bad = np.arange(len(faces)) % 4 == 0
    mesh = core.TriangleMesh(vertices, np.where(bad[:, None], faces[:, ::-1], faces))
    assert np.allclose(core.sharpen_geometry(mesh), expected, atol=1e-6)
    assert np.allclose(
        core.sharpen_normals(mesh), np.where(bad[:, None], -normals, normals), atol=1e-9
    )


def test_float32_input_far_from_the_origin_is_sound():
    vertices, faces = bumpy()
    far = (vertices + 1e6).astype(np.float32)
    distinct = core.TriangleMesh(far, faces)  # positions are rounded to 1/16
    out = core.sharpen_geometry(distinct)
    assert out.dtype == np.float64
    assert np.isfinite(out).all()
    assert np.linalg.norm(out - far, axis=1).max() < 3 * distinct.mean_edge_length


def messy():
    """Soft creases with everything that real files bring along."""
    vertices, faces = bumpy()
    n = len(vertices)
    faces = np.delete(faces, [3, 4, 5, 400], axis=0)  # holes
    far = vertices + [40.0, 0, 0]  # a second component, with flipped faces
    extra = np.array([[100.0, 0, 0], vertices[7], vertices[faces[50]].mean(axis=0) + [0, 0, 5]])
    vertices = np.concatenate([vertices, far, extra])
    loose, same, fin = 2 * n, 2 * n + 1, 2 * n + 2
    other = faces + n
    other[::7] = other[::7, ::-1]
    special = [
        [faces[50][0], faces[50][1], fin],  # three faces on an edge
        [7, same, faces[faces[:, 0] == 7][0][1]],  # zero area: two corners at one place
        [9, 9, 10],  # zero area: one corner twice
    ]
    return vertices, np.concatenate([faces, other, special]), loose, n


@pytest.mark.parametrize(
    "settings",
    [{}, {"feature_threshold": 0, "time": math.inf}, {"sampling": "nearest"},
     {"sampling": "linear", "mollify_passes": 2, "repeat": 2}, {"smoothing_passes": 0}],
)  # fmt: skip
def test_messy_meshes_give_sound_results(settings):
    vertices, faces, loose, n = messy()
    mesh = core.TriangleMesh(vertices, faces)
    out = core.sharpen_geometry(mesh, core.GeometrySettings(**settings))
    assert np.isfinite(out).all()
    assert np.array_equal(out[loose], vertices[loose])
    moved = np.linalg.norm(out - vertices, axis=1) / mesh.mean_edge_length
    assert 0.01 < moved[:n].max() < 3
    assert moved[n : 2 * n].max() < 3  # coarse bumps may stay


def test_a_second_component_does_not_touch_the_first():
    vertices, faces = bumpy()
    alone = core.sharpen_geometry(core.TriangleMesh(vertices, faces))
    both = core.sharpen_geometry(
        core.TriangleMesh(
            np.concatenate([vertices, vertices + 50]),
            np.concatenate([faces, faces + len(vertices)]),
        )
    )
    # The solver's tolerance is shared between components, and cells lie elsewhere.
    assert np.allclose(both[: len(vertices)], alone, atol=0.15)
    assert abs(both[: len(vertices)] - alone).mean() < 5e-3


def test_progress_rises_to_one_and_cancels_anywhere(soft_cube):
    calls = []
    settings = core.GeometrySettings(repeat=2, mollify_passes=1)
    core.sharpen_geometry(soft_cube, settings, progress=lambda f, m: calls.append((f, m)) or True)
    fractions = [f for f, _ in calls]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1
    assert all(message for _, message in calls[:-1])
    for stop_at in np.linspace(0, 1, 12):
        with pytest.raises(core.Cancelled):
            core.sharpen_geometry(soft_cube, settings, progress=lambda f, m, at=stop_at: f < at)


@pytest.mark.parametrize("scattered", [False, True])
def test_progress_is_asked_often_on_a_large_mesh(scattered, which):
    core.sharpen_geometry(core.TriangleMesh(*creased_sphere(4)))  # compiled before the clock runs
    vertices, faces = creased_sphere(6)  # 41 K vertices
    if scattered:
        vertices, faces, _, _ = shuffled(vertices, faces)
    mesh = core.TriangleMesh(vertices, faces)
    times = [time.process_time()]  # of this process alone, whatever else is running
    settings = core.GeometrySettings(mollify_passes=40, smoothing_passes=40, repeat=2, **which)
    core.sharpen_geometry(mesh, settings, progress=lambda f, m: times.append(time.process_time()))
    assert max(np.diff(times)) < 0.2 * (times[-1] - times[0])


def test_coordinates_that_do_not_move_keep_the_sign_of_zero():
    vertices, faces = grid(6, 6)
    vertices[:, 2] = -0.0
    out = core.sharpen_geometry(core.TriangleMesh(vertices, faces))
    assert np.signbit(out[:, 2]).all()


def test_importing_and_settings_need_neither_numba_nor_scipy():
    code = (
        "import sys; from shock_filter import core; core.GeometrySettings(time=1);"
        "assert not {'numba', 'scipy', 'bpy'} & set(sys.modules), set(sys.modules);"
        "assert 'sharpen_geometry' in dir(core); core.sharpen_geometry;"
        "assert 'numpy' in sys.modules and 'bpy' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)


def creased_sphere(subdivisions):
    """Half way between a sphere and a cube: curved faces between creases."""
    vertices, faces = icosphere(subdivisions)
    return vertices / np.sqrt(abs(vertices).max(axis=1, keepdims=True)), faces


def roof(ridge, slope, bend, size=24):
    """An open, unevenly cut sheet, bent along its creases, which run across its edges."""
    vertices, faces = grid(size, size, jitter=0.3)
    x, y = vertices[:, 0] + slope * vertices[:, 1], vertices[:, 1] - size / 2
    vertices[:, 2] = bend * y**2 - abs(x % (2 * ridge) - ridge)
    return vertices, faces


SHAPES = {
    "cube": cube(16),
    "creased sphere": creased_sphere(4),
    "fine creased sphere": creased_sphere(5),
    "roof": roof(12, 0, 0.02),
    "slanting roofs": roof(8, 0.3, 0),
}


@pytest.mark.parametrize(
    ("name", "most"),
    [("cube", 0.06), ("creased sphere", 0.15), ("roof", 0.3), ("slanting roofs", 0.4)],
)
def test_the_fit_finds_known_normals_again(name, most):
    clean = core.TriangleMesh(*SHAPES[name])
    soft = softened(clean.vertices, clean.faces)
    out = core.fit_to_normals(soft, clean.normals, core.FitSettings(screening_radius=30))
    fitted = core.TriangleMesh(out, clean.faces)
    before = angles(soft.normals, clean.normals).mean()
    assert angles(fitted.normals, clean.normals).mean() < most * before


@pytest.mark.parametrize(
    ("name", "most"),
    [("cube", 0.15), ("fine creased sphere", 0.4), ("roof", 0.4), ("slanting roofs", 0.7)],
)
def test_default_settings_bring_shapes_nearer_to_what_they_were(name, most):
    assert_nearer(core.GeometrySettings(), name, most)


@pytest.mark.parametrize(
    ("name", "most"),
    [("cube", 0.5), ("creased sphere", 0.55), ("roof", 0.65), ("slanting roofs", 0.8)],
)
def test_settings_of_the_paper_bring_shapes_nearer_to_what_they_were(name, most):
    assert_nearer(core.GeometrySettings.of_paper(), name, most)


def assert_nearer(settings, name, most):
    clean = core.TriangleMesh(*SHAPES[name])
    soft = softened(clean.vertices, clean.faces)
    out = core.sharpen_geometry(soft, settings)
    sharpened = core.TriangleMesh(out, clean.faces)
    before = angles(soft.normals, clean.normals).mean()
    assert angles(sharpened.normals, clean.normals).mean() < most * before

    def rms(vertices):
        return np.sqrt(((vertices - clean.vertices) ** 2).sum(axis=1).mean())

    assert rms(out) < 1.3 * rms(soft.vertices)


def test_a_mesh_that_repeating_collapses_is_an_error(soft_cube, monkeypatch):
    shrink = lambda mesh, *rest: (-mesh.vertices, None)  # noqa: E731
    monkeypatch.setattr(fit, "displacement", shrink)
    with pytest.raises(core.InvalidMesh, match="shrunk"):
        core.sharpen_geometry(soft_cube, core.GeometrySettings(repeat=2, where="everywhere"))
