# SPDX-License-Identifier: GPL-3.0-or-later
"""What, Width and Amount of colors on meshes; the default is tested in `test_learned_vertices`."""

import math
import re

import numpy as np
import pytest
from scipy.special import erf
from shapes import fan, grid, icosphere, rotation, shuffled
from shock_filter import core
from shock_filter.core.base.findings import gathering
from shock_filter.core.flow import advect, borders, potential, trace
from shock_filter.core.mesh import calculus

WIDTH_OF_SIGMA = 2.5631
DRAWING = {"what": "drawing"}
WAYS = [
    DRAWING,
    {"what": "photo"},
    DRAWING | {"channels": "independent"},
    DRAWING | {"channels": "luminance"},
]


class Meridian:
    """A mesh, and how far its vertices lie from a line across it, in mean edge lengths."""

    def __init__(self, vertices, faces, is_ball):
        self.mesh = core.TriangleMesh(vertices, faces)
        points = self.mesh.scaled_vertices
        across = np.array([0.8, 0.5, 0.33 if is_ball else 0.0])
        across /= np.linalg.norm(across)
        self.distance = points @ across
        self.inner = abs(points).max(axis=1) < 30
        if is_ball:
            radius = np.linalg.norm(points, axis=1).mean()
            self.distance = radius * np.arcsin(np.clip(self.distance / radius, -1, 1))
            self.inner[:] = True

    def border(self, width, contrast=1.0):
        step = erf(self.distance * WIDTH_OF_SIGMA / width / 2**0.5)
        return (0.5 + 0.5 * contrast * step)[:, None]

    def width(self, values):
        """From 10 to 90 percent of the rise of the mean values across the line."""
        place = np.round(self.distance[self.inner] / 0.25).astype(int)
        first = place.min()
        count = np.bincount(place - first)
        total = np.bincount(place - first, values[self.inner, 0])
        some = count > 0
        rise = np.maximum.accumulate(total[some] / count[some])
        rise = (rise - rise[0]) / (rise[-1] - rise[0])
        low, high = np.interp([0.1, 0.9], rise, 0.25 * np.flatnonzero(some))
        return high - low


@pytest.fixture(scope="module", params=["ball", "sheet"])
def meridian(request):
    if request.param == "ball":
        return Meridian(*icosphere(5), True)
    return Meridian(*grid(75, 75, 0.3), False)


@pytest.fixture(scope="module")
def striped():
    mesh = core.TriangleMesh(*icosphere(4))
    waves = np.sin(6.0 * mesh.vertices @ [[1.0, 0.2, 0.4], [0.3, 1, 0.1], [0, 0.5, 1]])
    hard = 0.2 + 0.6 * (waves > 0)
    return mesh, hard, calculus.smooth_vertices(mesh, hard, 4)


def sharpened(mesh, values, **settings):
    return core.sharpen_vertex_signal(mesh, values, core.ShockSettings(**(DRAWING | settings)))


def sharpened_corners(mesh, values):
    return core.sharpen_corner_signal(mesh, values, core.ShockSettings(**DRAWING))


@pytest.mark.parametrize("contrast", [1.0, 0.2, 0.05])
def test_borders_up_to_the_width_close_and_wide_ones_stay_whatever_the_contrast(meridian, contrast):
    mesh = meridian.mesh
    found = [
        meridian.width(sharpened(mesh, meridian.border(times * 5.0, contrast), width=5.0))
        / (times * 5.0)
        for times in (1.0, 3.0, 4.0)
    ]
    assert found[0] < 0.3
    assert found[1] > 0.8
    assert found[2] > 0.88


def test_photo_closes_half(meridian):
    out = sharpened(meridian.mesh, meridian.border(5.0), width=5.0, what="photo")
    assert 0.35 < meridian.width(out) / 5.0 < 0.6


@pytest.mark.parametrize("width", [2.5, 5.0, 8.0])
def test_width_is_measured_at_any_contrast(meridian, width):
    measured = [
        borders.borders_of(meridian.mesh, meridian.border(width, contrast)).width
        for contrast in (1.0, 0.15)
    ]
    assert measured == pytest.approx([width, width], rel=0.12)
    assert measured[0] == pytest.approx(measured[1], rel=1e-6)
    assert meridian.width(sharpened(meridian.mesh, meridian.border(width, 0.15))) < 2.0


def test_width_is_measured_of_a_border_that_widens_along_its_length():
    vertices, faces = grid(60, 60)
    x, y, _ = vertices.T
    sigma = 1.5 + 0.02 * y
    values = 0.5 + 0.5 * erf((x - 30.0) / (math.sqrt(2.0) * sigma))
    found = borders.borders_of(core.TriangleMesh(vertices, faces), values[:, None])
    assert found.seen > 30
    assert found.width == pytest.approx(2.5631 * np.median(sigma), rel=0.2)


def test_width_is_measured_where_edges_are_shorter_than_elsewhere():
    vertices, faces = grid(90, 90, 0.2)
    growing = Meridian(vertices * np.exp(2.0 * vertices[:, :1] / 90), faces, False)
    growing.distance = growing.mesh.scaled_vertices[:, 0]
    growing.distance = growing.distance - np.quantile(growing.distance, 0.2)
    for width in (1.5, 2.5):
        found = borders.borders_of(growing.mesh, growing.border(width)).width
        assert found == pytest.approx(width, rel=0.3)


def test_noise_is_measured_and_borders_are_no_noise(meridian):
    rng = np.random.default_rng(0)
    values = np.repeat(meridian.border(6.0), 3, axis=1)
    assert borders.noise_of(meridian.mesh, values) < 1e-3
    for noise in (0.005, 0.05):
        noisy = values + rng.normal(0, noise, values.shape)
        assert borders.noise_of(meridian.mesh, noisy) == pytest.approx(noise, rel=0.15)


def test_noisy_borders_are_still_found(meridian):
    values = np.repeat(meridian.border(5.0), 3, axis=1)
    noisy = values + np.random.default_rng(0).normal(0, 0.02, values.shape)
    assert borders.borders_of(meridian.mesh, noisy).width == pytest.approx(5.0, rel=0.3)


def test_what_is_sharp_or_even_already_stays_bit_for_bit(striped):
    mesh, hard, _ = striped
    for values in (hard, np.full_like(hard, 0.1), hard.astype(np.float32)):
        for way in WAYS:
            out = sharpened(mesh, values, **way)
            assert np.array_equal(out, values)
            assert out.dtype == values.dtype
            assert out is not values
        corners = values[mesh.faces]
        assert np.array_equal(sharpened_corners(mesh, corners), corners)
    even = np.full_like(hard, 0.1)
    assert np.array_equal(sharpened(mesh, even, width=5.0), even)


@pytest.mark.parametrize("way", WAYS)
def test_blurred_stripes_come_closer_to_what_they_were(striped, way):
    mesh, hard, soft = striped

    def error(values):
        return np.sqrt(((values - hard) ** 2).mean())

    assert error(sharpened(mesh, soft, **way)) < 0.85 * error(soft)


def test_a_second_run_finds_it_sharp(striped):
    mesh, _, soft = striped
    once = sharpened(mesh, soft)
    assert np.array_equal(sharpened(mesh, once), once)
    corners = sharpened_corners(mesh, soft[mesh.faces])
    assert np.array_equal(sharpened_corners(mesh, corners), corners)


@pytest.mark.parametrize("noise", [0.01, 0.03])
def test_noisy_stripes_come_closer_as_well(striped, noise):
    mesh, hard, soft = striped
    noisy = soft + np.random.default_rng(0).normal(0, noise, soft.shape)

    def error(values):
        return np.sqrt(((values - hard) ** 2).mean())

    assert error(sharpened(mesh, noisy)) < 0.85 * error(noisy)


@pytest.mark.parametrize("way", WAYS)
def test_values_stay_within_those_nearby(striped, way):
    mesh, _, soft = striped
    noisy = soft + np.random.default_rng(0).normal(0, 0.01, soft.shape)
    low, high = borders.nearby_range(mesh, noisy, 8.0)
    out = sharpened(mesh, noisy, width=5.0, **way)
    assert not np.array_equal(out, noisy)
    assert (out >= low - 1e-12).all()
    assert (out <= high + 1e-12).all()


@pytest.mark.parametrize("way", WAYS)
def test_order_motion_and_scale_do_not_matter(striped, way):
    mesh, _, soft = striped
    expected = sharpened(mesh, soft, **way)
    vertices, faces, place, _ = shuffled(mesh.vertices @ rotation().T * 1e5, mesh.faces)
    signal = np.empty_like(soft)
    signal[place] = soft
    out = sharpened(core.TriangleMesh(vertices, faces), signal, **way)[place]
    assert np.mean(abs(out - expected) > 1e-3) < 0.01


def test_amount_and_mask_mix_with_the_input(striped):
    mesh, _, soft = striped
    full = sharpened(mesh, soft)
    corners = soft[mesh.faces]
    full_corners = sharpened_corners(mesh, corners)
    mask = np.linspace(0, 1, mesh.vertex_count)
    for amount in (0.25, 0.6):
        settings = core.ShockSettings(amount=amount, **DRAWING)
        out = core.sharpen_vertex_signal(mesh, soft, settings)
        assert np.allclose(out, soft + amount * (full - soft), atol=1e-14)
        out = core.sharpen_vertex_signal(mesh, soft, settings, mask=mask)
        assert np.allclose(out, soft + amount * mask[:, None] * (full - soft), atol=1e-14)
        out = core.sharpen_corner_signal(mesh, corners, settings, mask=mask)
        weights = amount * mask[mesh.faces][:, :, None]
        assert np.allclose(out, corners + weights * (full_corners - corners), atol=1e-14)
        timed = sharpened(mesh, soft, time=50.0)
        out = sharpened(mesh, soft, time=50.0, amount=amount)
        assert np.allclose(out, soft + amount * (timed - soft), atol=1e-14)
    assert np.array_equal(sharpened(mesh, soft, amount=0.0), soft)


@pytest.mark.parametrize("time", [16.0, 256.0, math.inf])
def test_a_time_acts_as_in_the_paper_and_nothing_else_counts(striped, time):
    mesh, _, soft = striped
    points, coordinates = trace.corner_offsets(mesh)
    trace.trace(mesh, potential.flow_potential(mesh, soft, 1), time, points, coordinates)
    read = advect.read_points(mesh, soft, points, coordinates, False)
    expected = advect.average_corners(mesh, read, soft)
    for others in ({}, {"width": 9.0, "what": "photo"}):
        assert np.array_equal(sharpened(mesh, soft, time=time, **others), expected)
    corners = core.sharpen_corner_signal(mesh, soft[mesh.faces], core.ShockSettings(time=time))
    assert np.array_equal(corners.reshape(-1, 3), read)


def test_walks_may_each_have_a_time_of_their_own(striped):
    mesh, _, soft = striped
    field = potential.flow_potential(mesh, soft, 1)
    times = np.where(np.arange(3 * mesh.face_count) % 2 == 0, 16.0, 256.0)
    points, coordinates = trace.corner_offsets(mesh)
    trace.trace(mesh, field, times, points, coordinates)
    for time in (16.0, 256.0):
        faces, places = trace.corner_offsets(mesh)
        trace.trace(mesh, field, time, faces, places)
        assert np.array_equal(points[times == time], faces[times == time])
        assert np.array_equal(coordinates[times == time], places[times == time])


def test_corners_that_agree_give_what_vertices_give(striped):
    mesh, _, soft = striped
    for what in ("drawing", "photo"):
        settings = core.ShockSettings(what=what)
        corners = core.sharpen_corner_signal(mesh, soft[mesh.faces], settings)
        sums = np.zeros_like(soft)
        np.add.at(sums, mesh.faces.reshape(-1), corners.reshape(-1, 3))
        counts = np.bincount(mesh.faces.reshape(-1))
        vertices = core.sharpen_vertex_signal(mesh, soft, settings)
        assert np.allclose(sums / counts[:, None], vertices, atol=1e-12)


@pytest.mark.parametrize("what", ["drawing", "photo"])
def test_jumps_between_corners_stay_and_nothing_flows_across(what):
    mesh = core.TriangleMesh(*grid(24, 24))
    right = mesh.vertices[mesh.faces][:, :, 0].mean(axis=1) > 12
    step = 0.15 * (1 + erf((mesh.vertices[mesh.faces][:, :, 1] - 12) / 2.0))
    corners = np.where(right[:, None], 0.6 + step, step)
    out = core.sharpen_corner_signal(mesh, corners, core.ShockSettings(what=what))
    assert out[~right].max() <= 0.3
    assert out[right].min() >= 0.6
    rising = np.ptp(out, axis=1).max() / np.ptp(corners, axis=1).max()
    assert rising > (1.8 if what == "drawing" else 1.3)
    assert np.allclose(out[right].mean() - out[~right].mean(), 0.6, atol=0.01)


def test_reports_say_how_wide_borders_were_and_are(striped, meridian):
    def said(run):
        with gathering() as findings:
            run()
        return [str(finding) for finding in findings]

    mesh, hard, soft = striped
    text = said(lambda: sharpened(meridian.mesh, meridian.border(5.0)))
    widths = re.fullmatch(r"Borders (.*) edge lengths wide, closed to (.*)\.", *text).groups()
    assert float(widths[0]) == pytest.approx(5.0, rel=0.12)
    assert float(widths[1]) < 2.0
    text = said(lambda: sharpened_corners(mesh, soft[mesh.faces]))
    widths = re.fullmatch(r"Borders (.*) edge lengths wide, closed to (.*)\.", *text).groups()
    assert float(widths[0]) == pytest.approx(3.0, rel=0.2)
    assert float(widths[1]) < 2.0
    assert said(lambda: sharpened(mesh, hard))[0].startswith("Already sharp")
    assert said(lambda: sharpened(mesh, 0 * hard)) == ["No borders were found; give a Width."]
    assert not said(lambda: sharpened(mesh, soft, time=16.0))


def soups():
    vertices, faces = grid(10, 10)
    loose = np.vstack([vertices, [[50.0, 0, 0], vertices[5]]])
    flat = np.vstack([faces, [[5, len(loose) - 1, 6], [7, 7, 8]]])
    yield loose, flat
    yield np.eye(3), np.array([[0, 1, 2]])
    yield fan(300, 0.1)
    rng = np.random.default_rng(0)
    yield rng.random((30, 3)), rng.integers(0, 30, (60, 3))


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("width", [0.0, 0.3, 5.0, 30.0])
def test_messy_meshes_give_sound_values(way, width):
    settings = core.ShockSettings(width=width, **way)
    for vertices, faces in soups():
        mesh = core.TriangleMesh(vertices, faces)
        rng = np.random.default_rng(1)
        for scale in (1.0, 1e30, 1e-30):
            for signal in (
                scale * rng.random((mesh.vertex_count, 3)),
                np.where(rng.random((mesh.vertex_count, 3)) < 0.5, scale, -scale),
            ):
                out = core.sharpen_vertex_signal(mesh, signal, settings)
                assert (out >= signal.min(axis=0)).all()
                assert (out <= signal.max(axis=0)).all()
                corners = core.sharpen_corner_signal(mesh, signal[mesh.faces], settings)
                assert (corners >= signal.min(axis=0)).all()
                assert (corners <= signal.max(axis=0)).all()


def test_a_wide_smoothing_is_that_of_many_passes(meridian):
    mesh = meridian.mesh
    values = meridian.border(1.0)
    for passes in (2, 9, 60):
        sigma = math.sqrt(0.344 * passes)
        out = borders.diffused(mesh, values, sigma)
        assert abs(out - calculus.smooth_vertices(mesh, values, passes)).max() < 0.05


def test_progress_rises_to_one_and_cancels(striped):
    mesh, _, soft = striped
    for way in WAYS:
        settings, calls = core.ShockSettings(**way), []
        mesh = core.TriangleMesh(mesh.vertices, mesh.faces)
        core.sharpen_vertex_signal(mesh, soft, settings, progress=lambda f, m: calls.append(f) or 1)  # noqa: B023
        assert calls == sorted(calls)
        assert calls[-1] == 1
        with pytest.raises(core.Cancelled):
            core.sharpen_vertex_signal(mesh, soft, settings, progress=lambda f, m: f < 0.5)


def test_noise_counts_the_same_where_the_width_is_given(striped):
    mesh, _, soft = striped
    noisy = soft + np.random.default_rng(0).normal(0, 0.03, soft.shape)
    width = borders.borders_of(mesh, noisy).width
    np.testing.assert_array_equal(sharpened(mesh, noisy, width=width), sharpened(mesh, noisy))


@pytest.mark.parametrize("noise", [0.1, 0.2])
def test_noise_has_no_borders(striped, noise):
    mesh = striped[0]
    values = np.random.default_rng(0).normal(0.5, noise, (mesh.vertex_count, 1))
    assert borders.measured(mesh, values).seen == 0


def test_borders_stay_crisp_where_three_colors_meet(striped):
    mesh = striped[0]
    angles = np.arctan2(mesh.vertices[:, 1], mesh.vertices[:, 0])
    sectors = ((angles + np.pi) * 3 / (2 * np.pi)).astype(int).clip(0, 2)
    hard = np.array([[0.8, 0.1, 0.1], [0.1, 0.15, 0.8], [0.9, 0.8, 0.2]])[sectors]
    soft = calculus.smooth_vertices(mesh, hard, 6)
    near = np.hypot(*mesh.vertices.T[:2]) < 0.3

    def error(values):
        return np.sqrt(((values - hard)[near] ** 2).mean())

    assert error(sharpened(mesh, soft)) < 0.6 * error(soft)
