# SPDX-License-Identifier: GPL-3.0-or-later
"""Random meshes, signals and settings through the filters of meshes."""

import numpy as np
import pytest
from checks import assert_alike, assert_same_bits, assert_sentence, assert_within, call
from hypothesis import assume, given
from hypothesis import strategies as st
from shock_filter import core
from shock_filter.core.registry import find
from shock_filter.core.shape.denoising import beltrami_joint_corners
from shock_filter.core.then_sharpen import sharpen_both, then_sharpen
from strategies import broken, examples, masks, meshes, settings_of, signals, triangles

pytestmark = pytest.mark.timeout(1800, method="thread")  # a thread can end compiled code, too

STOPS = st.floats(0, 1)
SIGNALS = find("beltrami_vertex_signal")
SHARPEN_TIMES = st.sampled_from([None, 0.0, 16.0, 1e3, np.inf])


def given_faces(mesh):
    return mesh.own_corners(mesh.faces)


def new_mesh(mesh):
    return core.TriangleMesh(mesh.vertices, given_faces(mesh))


def call_on(mesh, function, *arrays, stop_at):
    """`call`, on a mesh that is new each time: nothing is kept from the run before."""

    def on_new_mesh(watch):
        new = new_mesh(mesh)
        kept = new.vertices.copy(), new.faces.copy()
        try:
            return function(new, watch)
        finally:
            assert_same_bits(new.vertices, kept[0])
            assert_same_bits(new.faces, kept[1])

    given = [array for array in arrays if array is not None]
    try:
        return call(on_new_mesh, mesh.vertices, *given, stop_at=stop_at)
    except core.SolverError:  # needles can be too much for a refit, which says so
        assume(False)


def check_positions(positions, mesh, mask, keeps_all):
    assert_alike(positions, mesh.vertices)
    if mask is not None:
        assert_same_bits(positions[mask == 0], mesh.vertices[mask == 0])
    if keeps_all:
        assert_same_bits(positions, mesh.vertices)


def check_signal(result, signal, weights, keeps_all, corner=False):
    assert_alike(result, signal)
    if weights is not None:
        assert_same_bits(result[weights == 0], signal[weights == 0])
    if keeps_all:
        assert_same_bits(result, signal)
    channels = signal.shape[2 if corner else 1 :]
    flat = (-1, *channels)
    assert_within(result.reshape(flat), signal.reshape(flat), slack=1e-6)


def corner_weights(mesh, mask):
    return None if mask is None else mask[given_faces(mesh)]


@examples(60)
@given(st.data())
def test_any_triangles_make_a_mesh_or_are_refused(data):
    vertices, faces = data.draw(triangles())
    if data.draw(st.booleans()):
        vertices = data.draw(broken(vertices))
    if data.draw(st.integers(0, 3)) == 0:
        faces = data.draw(broken(faces))
    if data.draw(st.integers(0, 3)) == 0 and getattr(faces, "dtype", np.dtype("O")).kind in "iuf":
        faces = faces + data.draw(st.sampled_from([-1, 1, 2**31, -(2**40)]))
    for function in (core.TriangleMesh, core.weld_borders):
        try:
            function(vertices, faces)
        except core.InvalidMesh as error:
            assert_sentence(error)
    try:
        representatives, index = core.weld(vertices)
    except core.InvalidMesh as error:
        assert_sentence(error)
    else:
        assert (np.asarray(vertices)[representatives][index] == vertices).all()


@examples(60)
@given(meshes())
def test_connectivity_is_sound(mesh):
    twins = mesh.twins.reshape(-1)
    paired = np.flatnonzero(twins >= 0)
    assert (twins[twins[paired]] == paired).all()
    first, last = mesh.faces.reshape(-1), np.roll(mesh.faces, -1, axis=1).reshape(-1)
    assert (first[paired] == last[twins[paired]]).all()
    start, ring = mesh.neighbours
    assert start[-1] == len(ring)
    assert mesh.mean_edge_length > 0
    assert np.isfinite(mesh.scaled_vertices[np.unique(mesh.faces)]).all()
    assert np.isfinite(mesh.areas).all()
    assert np.allclose(np.linalg.norm(mesh.normals, axis=1), mesh.areas > 0)


@examples(50)
@given(st.data(), settings_of(core.GeometrySettings), STOPS)
def test_sharpen_geometry(data, settings, stop_at):
    mesh = data.draw(meshes())
    mask = data.draw(masks(mesh.vertex_count))
    positions = call_on(
        mesh, lambda m, watch: core.sharpen_geometry(m, settings, mask=mask, progress=watch), mask,
        stop_at=stop_at)  # fmt: skip
    check_positions(positions, mesh, mask, settings.time == 0 == settings.mollify_passes)
    if settings.max_displacement > 0:
        farthest = np.linalg.norm(positions - mesh.vertices, axis=1).max()
        rounding = 1e-9 * abs(mesh.vertices).max()
        most = settings.max_displacement * mesh.mean_edge_length
        assert farthest <= most * (1 + 1e-9) + rounding


@examples(30)
@given(meshes(), settings_of(core.GeometrySettings), STOPS)
def test_sharpen_normals(mesh, settings, stop_at):
    normals = call_on(
        mesh, lambda m, watch: core.sharpen_normals(m, settings, progress=watch), stop_at=stop_at
    )
    assert normals.shape == (mesh.face_count, 3)
    lengths = np.linalg.norm(normals, axis=1)
    assert np.allclose(lengths[mesh.areas > 0], 1.0)
    assert (lengths[mesh.areas == 0] == 0).all()


@examples(40)
@given(st.data(), settings_of(core.FitSettings), STOPS)
def test_fit_to_normals(data, settings, stop_at):
    mesh = data.draw(meshes())
    mask = data.draw(masks(mesh.vertex_count))
    rng = np.random.default_rng(data.draw(st.integers(0, 99)))
    normals = rng.normal(size=(mesh.face_count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    own = data.draw(st.sampled_from(["own", "zero", "random"]))
    if own == "own":
        normals = np.where(mesh.flipped[:, None], -mesh.normals, mesh.normals)
    normals[rng.random(len(normals)) < 0.2] = 0.0
    if own == "zero":
        normals[:] = 0.0
    positions = call_on(
        mesh,
        lambda m, watch: core.fit_to_normals(m, normals, settings, mask=mask, progress=watch),
        normals,
        mask,
        stop_at=stop_at,
    )
    tight = settings.screening_radius < 100  # else rounding grows
    check_positions(positions, mesh, mask, own != "random" and tight)


@examples(40)
@given(st.data(), settings_of(core.ShockSettings), STOPS)
def test_sharpen_vertex_signal(data, settings, stop_at):
    mesh = data.draw(meshes())
    signal, mask = data.draw(signals(mesh.vertex_count)), data.draw(masks(mesh.vertex_count))
    result = call_on(
        mesh,
        lambda m, watch: core.sharpen_vertex_signal(m, signal, settings, mask=mask, progress=watch),
        signal,
        mask,
        stop_at=stop_at,
    )
    check_signal(result, signal, mask, settings.is_neutral)


@examples(40)
@given(st.data(), settings_of(core.ShockSettings), STOPS)
def test_sharpen_corner_signal(data, settings, stop_at):
    mesh = data.draw(meshes())
    signal, mask = data.draw(signals(mesh.face_count, 3)), data.draw(masks(mesh.vertex_count))
    result = call_on(
        mesh,
        lambda m, watch: core.sharpen_corner_signal(m, signal, settings, mask=mask, progress=watch),
        signal,
        mask,
        stop_at=stop_at,
    )
    check_signal(result, signal, corner_weights(mesh, mask), settings.is_neutral, corner=True)


@examples(30)
@given(st.data(), settings_of(core.ShockSettings), STOPS)
def test_flow_field(data, settings, stop_at):
    mesh = data.draw(meshes())
    signal = data.draw(signals(mesh.vertex_count))
    potential, flow = call_on(
        mesh, lambda m, watch: core.flow_field(m, signal, settings, progress=watch), signal,
        stop_at=stop_at)  # fmt: skip
    assert (potential >= 0).all()
    assert potential.shape == (mesh.vertex_count,)
    assert flow.shape == (mesh.face_count, 3)
    assert not flow[mesh.areas == 0].any()


@examples(40)
@given(st.data(), settings_of(core.BeltramiGeometrySettings), SHARPEN_TIMES, STOPS)
def test_denoise_geometry(data, settings, sharpen_time, stop_at):
    mesh = data.draw(meshes())
    mask = data.draw(masks(mesh.vertex_count))
    function = find("denoise_geometry").function(sharpen_time)
    positions = call_on(
        mesh, lambda m, watch: function(m, settings=settings, mask=mask, progress=watch), mask,
        stop_at=stop_at)  # fmt: skip
    check_positions(positions, mesh, mask, settings.is_neutral and not sharpen_time)


@examples(40)
@given(st.data(), settings_of(core.BeltramiMeshSettings), SHARPEN_TIMES, STOPS)
def test_denoise_signals(data, settings, sharpen_time, stop_at):
    mesh = data.draw(meshes())
    mask = data.draw(masks(mesh.vertex_count))
    keeps_all = settings.time == 0 and not sharpen_time
    corner = data.draw(st.booleans())
    signal = data.draw(signals(mesh.face_count, 3) if corner else signals(mesh.vertex_count))
    function = SIGNALS.function(sharpen_time, corners=corner)
    result = call_on(
        mesh, lambda m, watch: function(m, signal, settings=settings, mask=mask, progress=watch),
        signal, mask, stop_at=stop_at)  # fmt: skip
    weights = corner_weights(mesh, mask) if corner else mask
    check_signal(result, signal, weights, keeps_all, corner)


@examples(40)
@given(st.data(), settings_of(core.BeltramiMeshSettings), SHARPEN_TIMES, STOPS)
def test_denoise_both(data, settings, sharpen_time, stop_at):
    mesh = data.draw(meshes())
    mask = data.draw(masks(mesh.vertex_count))
    keeps_all = settings.time == 0 and not sharpen_time
    if data.draw(st.booleans()):
        signal = data.draw(signals(mesh.face_count, 3))
        function = then_sharpen(
            beltrami_joint_corners, sharpen_both, SIGNALS.sharpening(sharpen_time)
        )
        positions, result = call_on(
            mesh,
            lambda m, watch: function(m, signal, settings=settings, mask=mask, progress=watch),
            signal, mask, stop_at=stop_at)  # fmt: skip
        check_signal(result, signal, corner_weights(mesh, mask), keeps_all, corner=True)
    else:
        signal = data.draw(signals(mesh.vertex_count))
        positions, result = call_on(
            mesh,
            lambda m, watch: core.beltrami_joint(m, signal, settings, mask=mask, progress=watch),
            signal,
            mask,
            stop_at=stop_at,
        )
        check_signal(result, signal, mask, settings.time == 0)
    check_positions(positions, mesh, mask, keeps_all)


@examples(30)
@given(st.data())
def test_a_mesh_that_was_used_gives_the_same_as_a_new_one(data):
    used = data.draw(meshes())
    count = used.vertex_count
    pair = data.draw(signals(count)), data.draw(signals(count))
    corner_pair = [data.draw(signals(used.face_count, 3)) for _ in range(2)]
    mask_pair = data.draw(masks(count)), None
    for _ in range(4):
        signal, corners, mask = [
            data.draw(st.sampled_from(two)) for two in (pair, corner_pair, mask_pair)
        ]
        geometry = data.draw(settings_of(core.GeometrySettings))
        shock = data.draw(settings_of(core.ShockSettings))
        filters = {
            "geometry": lambda mesh: core.sharpen_geometry(mesh, geometry, mask=mask),  # noqa: B023
            "normals": lambda mesh: core.sharpen_normals(mesh, geometry),  # noqa: B023
            "vertices": lambda mesh: core.sharpen_vertex_signal(mesh, signal, shock, mask=mask),  # noqa: B023
            "corners": lambda mesh: core.sharpen_corner_signal(mesh, corners, shock, mask=mask),  # noqa: B023
        }
        function = filters[data.draw(st.sampled_from(list(filters)))]
        assert_same_bits(function(used), function(new_mesh(used)))


@examples(60)
@given(st.data())
def test_what_does_not_fit_is_refused(data):
    mesh = data.draw(meshes())
    count = mesh.vertex_count
    signal = data.draw(signals(count))
    corners = data.draw(signals(mesh.face_count, 3))
    bad_signal, bad_corners = data.draw(broken(signal)), data.draw(broken(corners))
    bad_mask = data.draw(st.one_of(broken(np.ones(count)), st.just(np.full(count, 1.5))))
    filters = [
        lambda: core.sharpen_vertex_signal(mesh, bad_signal),
        lambda: core.sharpen_corner_signal(mesh, bad_corners),
        lambda: core.flow_field(mesh, bad_signal),
        lambda: core.beltrami_vertex_signal(mesh, bad_signal),
        lambda: core.beltrami_corner_signal(mesh, bad_corners),
        lambda: core.beltrami_joint(mesh, bad_signal),
        lambda: beltrami_joint_corners(mesh, bad_corners),
        lambda: core.fit_to_normals(mesh, bad_signal),
        lambda: core.sharpen_vertex_signal(mesh, signal, mask=bad_mask),
        lambda: core.sharpen_corner_signal(mesh, corners, mask=bad_mask),
        lambda: core.beltrami_vertex_signal(mesh, signal, mask=bad_mask),
        lambda: core.sharpen_geometry(mesh, mask=bad_mask),
        lambda: core.denoise_geometry(mesh, mask=bad_mask),
    ]
    function = data.draw(st.sampled_from(filters))
    try:
        function()
    except core.InvalidSignal as error:
        assert_sentence(error)
