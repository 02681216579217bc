# SPDX-License-Identifier: GPL-3.0-or-later
"""The learned denoiser: noise of several kinds goes, what is clean stays bit for bit."""

from functools import partial

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from shapes import angles, cube, fan, grid, icosphere, rotation, shuffled
from shock_filter import core
from shock_filter.core.base import parallel
from shock_filter.core.mesh import order
from shock_filter.core.mesh.calculus import average_to_vertices, smooth_vertices
from shock_filter.core.mixture.choice import pair_count
from shock_filter.core.mixture.network import load
from shock_filter.core.shape import learned
from shock_filter.core.shape.learned import STAGES, WEIGHTS, found_in_stage, networks
from shock_filter.core.shape.noise import possible_noise
from shock_filter.core.shape.smoothings import (
    DEFINITION,
    FIRST,
    NEXT,
    NEXT_TOLD,
    TOLD,
    without_bumps,
)

EXPECTED = [
    [-0.0033096, -0.0002916, -0.3093156],
    [-0.004118, 0.0020514, -0.1984431],
    [0.0006338, 0.0014652, 0.359759],
    [0.0032862, 0.0079259, -0.0697426],
    [0.0076167, -0.0017036, -0.0357864],
    [-0.0204479, -0.0178499, -0.1744136],
]


def noisy(vertices, faces, amount, seed=0, passes=0):
    """A mesh with noise in all directions; after passes of smoothing, along the normals."""
    mesh = core.TriangleMesh(vertices, faces)
    rng = np.random.default_rng(seed)
    if passes == 0:
        return mesh.moved_to(
            vertices + amount * mesh.mean_edge_length * rng.normal(size=(len(vertices), 3))
        )
    steps = smooth_vertices(mesh, rng.normal(size=(len(vertices), 1)), passes)
    along = average_to_vertices(mesh, mesh.normals)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return mesh.moved_to(vertices + amount * mesh.mean_edge_length * steps / steps.std() * along)


def error(mesh, clean):
    return angles(mesh.normals, clean.normals).mean()


def denoised(mesh, settings=None, **options):
    return mesh.moved_to(core.denoise_geometry(mesh, settings, **options))


def folds(mesh):
    """Pairs of faces that close beyond 140 degrees."""
    here, there = np.arange(3 * mesh.face_count), mesh.twins.reshape(-1)
    pairs = np.stack([here, there], axis=1)[there >= 0] // 3
    cosines = (mesh.normals[pairs[:, 0]] * mesh.normals[pairs[:, 1]]).sum(axis=1)
    return {tuple(pair) for pair in pairs[cosines < np.cos(np.radians(140.0))].tolist()}


def rough_sheet():
    vertices, faces = grid(12, 12)
    rough = 0.2 * np.random.default_rng(0).normal(size=(len(vertices), 3))
    return core.TriangleMesh(vertices + rough, faces)


# ------------------------------------------------------------------------------- the networks


def test_the_shipped_networks_are_those_of_this_code():
    found = load(WEIGHTS, DEFINITION)
    assert set(found) == set(STAGES)
    for name, count, told in zip(
        STAGES, (FIRST, NEXT, NEXT), (TOLD, NEXT_TOLD, NEXT_TOLD), strict=True
    ):
        assert found[name].weights[0].shape[0] == told
        assert found[name].weights[-1].shape[1] == 2 * count
    assert WEIGHTS.stat().st_size < 300_000


def test_the_smoothings_stand_in_this_order():
    mesh = rough_sheet()
    found = found_in_stage(mesh, [])
    assert found.normals.shape == (mesh.face_count, FIRST, 3)
    first = found.normals.astype(float)
    assert np.allclose(first[:, 0], mesh.normals, atol=1e-6)
    up = [abs(first[:, k, 2]).mean() for k in range(FIRST)]
    assert up[1] < up[2] < up[3] < up[4]  # plain means, of more and more passes
    assert up[5] < up[6] < up[4]
    assert up[12] < up[13] < up[14] < up[19] < up[20]  # umbrella passes
    normals, told = found.told(mesh, np.arange(5))
    assert told.shape == (5, TOLD)
    far = np.linalg.norm(normals[:, 0] - normals[:, 1], axis=1)
    assert told[:, 0] == pytest.approx(np.log(far + 0.02) + 2, abs=1e-4)
    after = found_in_stage(mesh, networks()[:1])
    assert after.normals.shape[1] == NEXT
    assert np.allclose(after.normals[:, 4], mesh.normals, atol=1e-6)
    assert after.told(mesh, np.arange(5))[1].shape == (5, NEXT_TOLD)
    assert pair_count(NEXT) + after.around.shape[1] == NEXT_TOLD


def test_exact_numbers():
    mesh = rough_sheet()
    found = (core.denoise_geometry(mesh) - mesh.vertices)[20::29]
    assert np.allclose(found, EXPECTED, atol=1e-5), found.round(7).tolist()


def test_any_number_of_threads_gives_the_same_bits(monkeypatch):
    vertices, faces = cube(20)
    mesh = noisy(vertices, faces, 0.2)
    out = core.denoise_geometry(mesh)
    monkeypatch.setattr(parallel, "most_threads", 1)
    assert np.array_equal(core.denoise_geometry(core.TriangleMesh(mesh.vertices, faces)), out)


# ---------------------------------------------------------------------------- noise of all kinds


@pytest.mark.parametrize("amount", [0.1, 0.3, 0.5])
def test_white_noise_on_a_part_goes_and_creases_stay(amount):
    vertices, faces = cube(20)
    clean, mesh = core.TriangleMesh(vertices, faces), noisy(vertices, faces, amount)
    out = denoised(mesh)
    assert error(out, clean) < 0.25 * error(mesh, clean)
    beside = 10 - np.sort(abs(vertices[faces].mean(axis=1)), axis=1)[:, 1] < 0.7
    after, before = (angles(m.normals, clean.normals)[beside].mean() for m in (out, mesh))
    assert after < 0.45 * before


@pytest.mark.parametrize("amount", [0.04, 0.1, 0.3])
def test_white_noise_on_a_ball_goes(amount):
    vertices, faces = icosphere(5)
    clean, mesh = core.TriangleMesh(vertices, faces), noisy(vertices, faces, amount)
    assert error(denoised(mesh), clean) < 0.25 * error(mesh, clean)


def test_noise_of_scans_on_a_part_goes():
    vertices, faces = cube(24)
    clean, mesh = core.TriangleMesh(vertices, faces), noisy(vertices, faces, 0.15, passes=1)
    assert error(denoised(mesh), clean) < 0.5 * error(mesh, clean)


def test_terraces_of_a_depth_camera_go():
    vertices, faces = grid(48, 48)
    vertices[:, 2] = 0.12 * vertices[:, 0] + 0.05 * vertices[:, 1]
    clean = core.TriangleMesh(vertices, faces)
    rough = gaussian_filter(np.random.default_rng(0).normal(size=(49, 49))[:48, :48], 1.0)
    deep = vertices.copy()
    noise = np.resize(rough / rough.std(), len(vertices))
    deep[:, 2] = np.round(deep[:, 2] / 0.4 + 0.2 * noise) * 0.4
    mesh = core.TriangleMesh(deep, faces)
    assert error(denoised(mesh), clean) < 0.5 * error(mesh, clean)


def whole_voxels(inside):
    """The squares between voxels inside and outside, each as two triangles."""
    inside = np.pad(inside, 1)
    squares, steps = [], np.eye(3, dtype=int)
    for axis in range(3):
        a, b = steps[(axis + 1) % 3], steps[(axis + 2) % 3]
        corners = np.array([0 * a, a, a + b, b]) + steps[axis]
        beyond = np.roll(inside, -1, axis)
        squares.append(np.argwhere(inside & ~beyond)[:, None] + corners)
        squares.append(np.argwhere(~inside & beyond)[:, None] + corners[::-1])
    corners = np.concatenate(squares).reshape(-1, 3)
    vertices, index = np.unique(corners, axis=0, return_inverse=True)
    faces = index.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    return core.TriangleMesh(vertices.astype(float), faces)


def test_whole_voxels_of_a_turned_part_become_flat_sides():
    turn, size = rotation(3), np.array([14.0, 10.0, 7.0])
    middle = np.stack(np.meshgrid(*[np.arange(40) - 19.5] * 3, indexing="ij"), axis=-1) @ turn
    mesh = whole_voxels((abs(middle) < size).all(axis=-1))
    found = denoised(mesh)
    place = (mesh.vertices[mesh.faces].mean(axis=1) - 20.5) @ turn
    side = abs(abs(place) - size).argmin(axis=1)
    wanted = np.sign(place[np.arange(len(side)), side])[:, None] * turn.T[side]
    before, after = angles(mesh.normals, wanted), angles(found.normals, wanted)
    assert before.mean() > 25
    assert after.mean() < 0.25 * before.mean()
    assert not folds(found)


def test_steps_that_are_some_faces_wide_stay():
    heights = np.add.outer(np.arange(8), np.arange(6)) // 3 + 1
    stairs = np.arange(8) < heights[:, :, None]
    mesh = whole_voxels(stairs.repeat(4, 0).repeat(4, 1).repeat(4, 2))
    assert angles(denoised(mesh).normals, mesh.normals).mean() < 0.5


def test_models_of_some_squares_stay():
    few = whole_voxels(np.random.default_rng(3).random((3, 2, 2)) < 0.6)
    bracket = np.ones((12, 6, 12), bool)
    bracket[4:, :, 4:] = False
    for mesh in (few, whole_voxels(bracket)):
        np.testing.assert_allclose(denoised(mesh).vertices, mesh.vertices, rtol=0, atol=0.005)


def test_half_of_a_mesh_that_is_spoilt_leaves_the_other_half():
    vertices, faces = icosphere(5)
    spoilt = vertices[:, 0] > 0
    rough = vertices + 0.3 * 0.04 * spoilt[:, None] * np.random.default_rng(0).normal(
        size=vertices.shape
    )
    out = core.denoise_geometry(core.TriangleMesh(rough, faces))
    clean = core.TriangleMesh(vertices, faces)
    far = (vertices[faces][:, :, 0] < -0.2).all(axis=1)
    assert angles(core.TriangleMesh(out, faces).normals, clean.normals)[far].mean() < 0.3


# --------------------------------------------------------------------------------- what is clean


@pytest.mark.parametrize("shape", [cube(8), cube(1), icosphere(4), fan(40), grid(9, 9)])
def test_clean_meshes_stay_bit_for_bit(shape):
    mesh = core.TriangleMesh(*shape)
    assert np.array_equal(core.denoise_geometry(mesh), mesh.vertices)


@pytest.mark.parametrize("sound", [0, 1, 4])
def test_a_later_fit_that_misses_its_tolerance_is_left_out(sound, monkeypatch):
    calls, real = [], learned.displacement

    def failing(*given):
        calls.append(given)
        if len(calls) > sound:
            raise core.SolverError("It stopped.")
        return real(*given)

    monkeypatch.setattr(learned, "displacement", failing)
    mesh = rough_sheet()
    if sound == 0:
        with pytest.raises(core.SolverError):
            core.denoise_geometry(mesh)
        return
    out = core.denoise_geometry(mesh)
    assert len(calls) > sound
    assert np.isfinite(out).all() and not np.array_equal(out, mesh.vertices)


def test_a_clean_part_beside_a_noisy_one_stays_bit_for_bit():
    clean, clean_faces = cube(8)
    round_, round_faces = icosphere(3)
    noise = np.random.default_rng(0).normal(size=round_.shape)
    noisy = 4 * round_ + 0.1 * noise + (20, 0, 0)
    mesh = core.TriangleMesh(
        np.concatenate([clean, noisy]), np.concatenate([clean_faces, round_faces + len(clean)])
    )
    out = core.denoise_geometry(mesh)
    assert np.array_equal(out[: len(clean)], clean)
    assert abs(out[len(clean) :] - noisy).max() > 0.1


@pytest.mark.parametrize("thickness", [0.02, 0.002])
def test_thin_plates_stay(thickness):
    # Their sides are long thin faces, whose normals no fit meets after the vertices have moved.
    vertices, faces = cube(6)
    mesh = core.TriangleMesh(vertices * (1.0, 1.1, thickness) @ rotation(3).T, faces)
    assert angles(denoised(mesh).normals, mesh.normals).mean() < 0.5


def gear(teeth, thickness):
    """A gear out of long thin faces, as design programs export it: few share a size."""
    angle = np.linspace(0, 2 * np.pi, 4 * teeth, endpoint=False)
    count, radius = len(angle), np.where(np.arange(4 * teeth) % 4 < 2, 1.0, 0.85)
    rim = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle], axis=1)
    up = np.array([0, 0, thickness])
    vertices = np.concatenate([rim, rim + up, [0 * up, up]])
    a, middle = np.arange(count), np.full(count, 2 * count)
    b = np.roll(a, -1)
    sides = [(a, b, b + count), (a, b + count, a + count)]
    ends = [(b, a, middle), (a + count, b + count, middle + 1)]
    faces = np.concatenate([np.stack(each, axis=1) for each in sides + ends])
    return vertices @ rotation(3).T, faces


def terraces(height, step, size=60):
    """Depths in coarse steps, whose faces lie in planes and have edges of many lengths."""
    vertices, faces = grid(size, size)
    x, y = vertices[:, :2].T * (size / np.ptp(vertices[:, 0]))
    depth = step * np.round(height * np.sin(x / 20) * np.cos(y / 15) / step)
    return np.stack([x, y, depth], axis=1), faces


def test_what_design_programs_export_stays():
    mesh = core.TriangleMesh(*gear(20, 0.05))
    assert np.array_equal(core.denoise_geometry(mesh), mesh.vertices)
    rough = noisy(mesh.vertices, mesh.faces, 0.02)
    assert not np.array_equal(core.denoise_geometry(rough), rough.vertices)


def test_noise_is_impossible_only_in_planes_of_uneven_faces_and_parts_of_few_faces():
    for clean in (gear(20, 0.05), grid(3, 3), cube(1)):
        assert (possible_noise(core.TriangleMesh(*clean)) == 0).all()
    for open_to_noise in (cube(8), grid(20, 20), terraces(30, 3), terraces(30, 0.1)):
        assert (possible_noise(core.TriangleMesh(*open_to_noise)) == 1).all()
    vertices, faces = gear(40, 0.05)
    assert (possible_noise(noisy(vertices, faces, 0.02)) > 0.99).mean() > 0.95


def test_a_star_of_two_dozen_faces_stays():
    corners = np.array([[x, y, z] for x in (-1.0, 1) for y in (-1, 1) for z in (-1, 1)])
    faces = []
    for axis in range(3):
        for side in (-1, 1):  # four faces around the tip over each side of a cube
            (base,) = np.nonzero(corners[:, axis] == side)
            base = base[[0, 1, 3, 2]][:: side * (1 if axis != 1 else -1)]
            faces += [[base[i], base[(i + 1) % 4], 8 + len(faces) // 4] for i in range(4)]
    tips = np.repeat(np.eye(3), 2, axis=0) * np.tile([-4.0, 4.0], 3)[:, None]
    mesh = core.TriangleMesh(np.concatenate([corners, tips]), faces)
    assert np.array_equal(core.denoise_geometry(mesh), mesh.vertices)


def test_displacements_go_back_where_the_given_normals_are_nearer():
    mesh, rng = rough_sheet(), np.random.default_rng(1)
    moved = 0.2 * rng.normal(size=mesh.vertices.shape)
    there = mesh.moved_to(mesh.vertices + moved).normals
    nearer = partial(learned._nearer, mesh, ramp=learned._END_RAMP)
    assert np.array_equal(nearer(moved, there), moved)
    assert not nearer(moved, mesh.normals).any()
    left = mesh.vertices[mesh.faces][:, :, 0].max(axis=1) < 5.5
    mixed = nearer(moved, np.where(left[:, None], there, mesh.normals))
    x = mesh.vertices[:, 0]
    assert np.array_equal(mixed[x < 2.5], moved[x < 2.5])
    assert not mixed[x > 8.5].any()


def test_what_falls_short_of_the_targets_stays_after_the_fits_of_a_stage_but_not_before_them():
    mesh, rng = rough_sheet(), np.random.default_rng(1)
    moved = 0.2 * rng.normal(size=mesh.vertices.shape)
    there = mesh.moved_to(mesh.vertices + moved).normals
    short = 0.1 * moved  # four fifths of the squared distance are left
    assert np.array_equal(learned._nearer(mesh, short, there, learned._END_RAMP), short)
    kept = learned._nearer(mesh, short, there, learned._BEGIN_RAMP)
    assert np.linalg.norm(kept) < 0.9 * np.linalg.norm(short)


@pytest.mark.parametrize("sharp", [True, False])
def test_creases_are_sharpened_only_as_far_as_the_noisy_normals_agree(sharp):
    crisp = core.TriangleMesh(*cube(16))
    round_ = crisp.moved_to(smooth_vertices(crisp, crisp.vertices, 3))
    truth = crisp if sharp else round_
    mesh = noisy(truth.vertices, truth.faces, 0.15)
    state = learned._State(mesh, None)
    state.moved, state.normals = round_.vertices - mesh.vertices, round_.normals
    state.sharpen(0.0)
    assert state.normals is round_.normals
    state.sharpen(0.5)
    found = mesh.moved_to(mesh.vertices + state.moved)
    if sharp:
        assert error(found, truth) < 0.6 * error(round_, truth)
    else:
        assert error(found, truth) < 0.1 * error(round_, crisp)


def test_sharpening_that_leads_away_from_the_noisy_normals_is_undone(monkeypatch):
    crisp = core.TriangleMesh(*cube(16))
    mesh = crisp.moved_to(smooth_vertices(crisp, crisp.vertices, 3))
    near = noisy(mesh.vertices, mesh.faces, 0.01)
    state = learned._State(near, None)
    state.moved, state.normals = mesh.vertices - near.vertices, mesh.normals
    monkeypatch.setattr(learned, "_agreement", lambda mesh, *_: np.ones(mesh.vertex_count))
    state.sharpen(0.5)
    assert error(near.moved_to(near.vertices + state.moved), mesh) < 0.01 * error(mesh, crisp)


def test_noise_that_shortens_mean_normals_does_not_agree_with_sharper_creases():
    mesh, rng = core.TriangleMesh(*icosphere(5)), np.random.default_rng(0)
    denoised = mesh.normals
    c, s = np.cos(np.radians(20.0)), np.sin(np.radians(20.0))
    sharp = denoised @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    turn = 0.6 * rng.normal(size=denoised.shape)
    shares = []
    for truth in (denoised, sharp):
        seen = truth + turn
        seen /= np.linalg.norm(seen, axis=1, keepdims=True)
        shares.append(learned._agreement(mesh, sharp, seen).mean())
    assert shares[0] < 0.06
    assert shares[1] > 0.65


def test_relief_of_ten_edges_a_wave_stays():
    vertices, faces = icosphere(5)
    waves = 1 + 0.02 * np.sin(12 * vertices).sum(axis=1, keepdims=True)
    mesh = core.TriangleMesh(vertices * waves, faces)
    assert error(denoised(mesh), mesh) < 1.5


@pytest.mark.parametrize("wave", [8, 12, 20])
def test_high_relief_on_an_even_sheet_stays(wave):
    vertices, faces = grid(80, 80)
    at = 2 * np.pi / wave * vertices[:, :2]
    egg_box = np.sin(at).sum(axis=1)
    knurls = 2 * np.sin(at @ [[0.8, 0.6], [0.6, -0.8]]).prod(axis=1)
    for relief in (egg_box, knurls):
        high = vertices + 0.08 * wave * relief[:, None] * [0, 0, 1]
        mesh = core.TriangleMesh(high, faces)
        assert error(denoised(mesh), mesh) < 1.5


def lump(side=1.0):
    """A low lump of uneven faces on one side of x = 0."""
    vertices, faces = icosphere(3)
    vertices = vertices + 0.15 * np.sin(5 * vertices @ rotation(2) + 1) + [1.5, 0, 0]
    return (vertices, faces) if side > 0 else (vertices * [-1, 1, 1], faces[:, ::-1])


def test_what_was_modelled_in_halves_has_no_noise_but_two_of_a_kind_may():
    (right, faces), (left, turned) = lump(), lump(-1)
    both = lambda left, turned: (  # noqa: E731
        np.concatenate([right, left]), np.concatenate([faces, turned + len(right)])
    )  # fmt: skip
    halves = core.TriangleMesh(*both(left, turned))
    assert (possible_noise(halves) == 0).all()
    assert (possible_noise(halves, remeshed=True) == 1).all()
    assert np.array_equal(core.denoise_geometry(halves), halves.vertices)
    copies = core.TriangleMesh(*both(right + [4, 0, 0], faces))
    assert (possible_noise(copies) == 1).all()
    assert (possible_noise(noisy(*both(left, turned), 0.01)) == 1).all()


# ------------------------------------------------------------------------------------- the dials


def test_a_strength_of_0_returns_the_input_bit_for_bit_and_half_of_it_half():
    mesh = noisy(*cube(8), 0.2)
    moves = {}
    for strength in (0.0, 0.5, 1.0, 2.0):
        settings = core.BeltramiGeometrySettings(strength=strength)
        moves[strength] = core.denoise_geometry(mesh, settings) - mesh.vertices
    assert not moves[0.0].any()
    for strength in (0.5, 2.0):
        near = np.isclose(moves[strength], strength * moves[1.0], atol=1e-6).all(axis=1)
        assert near.mean() > 0.8
    kernel = {"method": "beltrami", "repeat": 1}
    half, whole = (
        core.denoise_geometry(mesh, core.BeltramiGeometrySettings(strength=s, **kernel))
        for s in (0.5, 1.0)
    )
    assert np.allclose(half - mesh.vertices, 0.5 * (whole - mesh.vertices), atol=1e-9)


def test_another_strength_is_quick(monkeypatch):
    mesh = noisy(*cube(8), 0.2)
    core.denoise_geometry(mesh)
    monkeypatch.setattr("shock_filter.core.shape.learned.mixed", None)
    core.denoise_geometry(mesh, core.BeltramiGeometrySettings(strength=0.7))


def bumpy(clean, passes, amount):
    return noisy(clean.vertices, clean.faces, amount, passes=passes)


def with_bump_size(width):
    return core.BeltramiGeometrySettings(bump_size=width)


def test_bumps_of_a_width_go_and_creases_stay():
    vertices, faces = cube(40)
    clean = core.TriangleMesh(vertices, faces)
    mesh = bumpy(clean, 6, 0.35)
    before = error(mesh, clean)
    found = error(denoised(mesh, with_bump_size(4.0)), clean)
    assert before > 8
    assert found < 0.4 * before
    assert found < error(denoised(mesh), clean)


@pytest.mark.slow
def test_a_bump_size_turns_the_result_evenly():
    vertices, faces = icosphere(5)
    clean = core.TriangleMesh(vertices, faces)
    mesh = bumpy(clean, 6, 0.35)
    errors = [error(denoised(mesh, with_bump_size(w)), clean) for w in np.arange(0, 4.1, 0.5)]
    assert abs(np.diff(errors)).max() < 0.35 * errors[0]
    near = denoised(mesh, with_bump_size(1e-3)).vertices - denoised(mesh).vertices
    assert np.linalg.norm(near, axis=1).max() < 1e-2 * mesh.mean_edge_length


def waves(high):
    """A sheet, one half with waves of 20 edges, the other flat; clean, and with bumps of 3."""
    vertices, faces = grid(120, 60)
    x = vertices[:, 0]
    vertices[:, 2] += high * np.sin(2 * np.pi * x / 20.0) * (x < 60.0)
    clean = core.TriangleMesh(vertices, faces)
    return clean, bumpy(clean, 4, 0.2), vertices[faces][:, :, 0].mean(axis=1)


def test_relief_wider_than_the_bumps_stays():
    clean, mesh, x = waves(2.0)
    off = angles(without_bumps(mesh, 3.0), clean.normals)
    before = angles(mesh.normals, clean.normals)
    wavy, flat = (x > 10) & (x < 50), (x > 70) & (x < 110)
    assert off[wavy].mean() < 0.75 * before[wavy].mean()
    assert off[flat].mean() < 0.2 * before[flat].mean()


def test_bumps_stay_where_the_mask_is_0():
    vertices, faces = icosphere(5)
    mesh = bumpy(core.TriangleMesh(vertices, faces), 6, 0.35)
    part = vertices[:, 0] > 0.9
    out = core.denoise_geometry(mesh, with_bump_size(4.0), mask=part.astype(float))
    assert np.array_equal(out[~part], mesh.vertices[~part])
    assert not np.array_equal(out[part], mesh.vertices[part])


def test_keep_creases_rounds_below_the_middle_and_leaves_flat_faces():
    vertices, faces = cube(20)
    clean, mesh = core.TriangleMesh(vertices, faces), noisy(vertices, faces, 0.2)
    found = []
    for keep in (0.0, 0.25, 0.5, 1.0):
        out = denoised(mesh, core.BeltramiGeometrySettings(keep_creases=keep))
        found.append(error(out, clean))
    assert found[0] > found[1] > found[2]
    assert found[3] < 1.2 * found[2]


def test_a_mask_keeps_bit_for_bit_and_a_part_is_filtered_as_the_whole():
    vertices, faces = icosphere(5)
    mesh = noisy(vertices, faces, 0.2)
    whole = core.denoise_geometry(mesh)
    for part in (vertices[:, 0] > 0, vertices[:, 0] > 0.9):
        out = core.denoise_geometry(mesh, mask=part.astype(float))
        assert np.array_equal(out[~part], mesh.vertices[~part])
        inner = vertices[:, 0] > np.where(part, vertices[:, 0], 2).min() + 0.05
        lengths = np.linalg.norm(out - whole, axis=1)[inner]
        assert lengths.mean() < 0.2 * mesh.mean_edge_length
    assert np.array_equal(core.denoise_geometry(mesh, mask=np.ones(len(vertices))), whole)
    assert np.array_equal(core.denoise_geometry(mesh, mask=np.zeros(len(vertices))), mesh.vertices)
    half = core.denoise_geometry(mesh, mask=np.full(len(vertices), 0.5)) - mesh.vertices
    near = np.isclose(half, 0.5 * (whole - mesh.vertices), atol=1e-6).all(axis=1)
    assert near.mean() > 0.95


# ------------------------------------------------------------------------------------ any meshes


def test_it_moves_turns_scales_and_reorders_with_the_mesh():
    mesh = noisy(*cube(12), 0.2)
    out = core.denoise_geometry(mesh)
    turn, shift, size = rotation(4), np.array([30.0, -20.0, 7.0]), mesh.mean_edge_length
    moved = core.TriangleMesh(40.0 * mesh.vertices @ turn.T + shift, mesh.faces)
    back = (core.denoise_geometry(moved) - shift) @ turn / 40.0
    assert np.linalg.norm(back - out, axis=1).mean() < 5e-3 * size
    for seed in (0, 1, 3):  # orders in which faces without area were turned over by rounding
        vertices, faces, v, _ = shuffled(mesh.vertices, mesh.faces, seed)
        other = core.denoise_geometry(core.TriangleMesh(vertices, faces))[v]
        far = np.linalg.norm(other - out, axis=1)
        assert far.max() < 0.02 * size and far.mean() < 1e-3 * size


def test_scattered_meshes_are_filtered_as_sorted_ones(monkeypatch):
    monkeypatch.setattr(order, "_SMALL", 10_000)
    vertices, faces = cube(50)
    mesh = noisy(vertices, faces, 0.2)
    rows = np.random.default_rng(0).permutation(len(vertices))
    number = np.argsort(rows)
    mixed = core.TriangleMesh(
        mesh.vertices[rows], number[faces][np.random.default_rng(1).permutation(len(faces))]
    )
    assert order.is_scattered(mixed) and not order.is_scattered(mesh)
    out = core.denoise_geometry(mixed)
    far = np.linalg.norm(out[number] - core.denoise_geometry(mesh), axis=1)
    assert far.mean() < 1e-2 * mesh.mean_edge_length


@pytest.mark.parametrize("amount", [0.2, 0.6, 1.0])
def test_folds_do_not_become_more(amount):
    for shape in (cube(12), icosphere(4)):
        mesh = noisy(*shape, amount)
        assert folds(denoised(mesh)) <= folds(mesh)


def test_needles_holes_and_faces_without_area_are_borne():
    vertices, faces = grid(20, 20)
    rng = np.random.default_rng(2)
    vertices = vertices + rng.normal(scale=0.1, size=vertices.shape)
    vertices[:40] = vertices[0]  # many at one place
    vertices[100] += 1e-9
    faces = faces[rng.random(len(faces)) > 0.2]
    faces = np.concatenate([faces, [[5, 5, 6], [300, 301, 300], [200, 201, 399]]])
    vertices = np.concatenate([vertices, [[1e3, 0, 0]]])  # loose
    mesh = core.TriangleMesh(vertices, faces)
    out = core.denoise_geometry(mesh)
    assert np.isfinite(out).all()
    assert np.array_equal(out[-1], vertices[-1])


def test_parts_of_very_different_sizes_are_filtered():
    one, faces = cube(10)
    two, more = icosphere(4)
    vertices = np.concatenate([one, 0.3 * two + 40])
    faces = np.concatenate([faces, more + len(one)])
    clean = core.TriangleMesh(vertices, faces)
    rough = (
        vertices
        + np.random.default_rng(0).normal(size=vertices.shape)
        * np.where(np.arange(len(vertices)) < len(one), 0.2, 0.2 * 0.02)[:, None]
    )
    mesh = core.TriangleMesh(rough, faces)
    before, after = (angles(m.normals, clean.normals) for m in (mesh, denoised(mesh)))
    first = np.arange(len(faces)) < len(faces) - len(more)
    assert after[first].mean() < 0.4 * before[first].mean()
    assert after[~first].mean() < 0.4 * before[~first].mean()


def test_a_single_triangle_stays():
    mesh = core.TriangleMesh(np.eye(3), [[0, 1, 2]])
    assert np.array_equal(core.denoise_geometry(mesh), mesh.vertices)


def test_cancelling_stops_it():
    mesh = noisy(*cube(20), 0.2)
    for stop in (0.05, 0.3, 0.7, 0.95):
        with pytest.raises(core.Cancelled):
            core.denoise_geometry(
                core.TriangleMesh(mesh.vertices, mesh.faces), progress=lambda f, _, s=stop: f < s
            )
