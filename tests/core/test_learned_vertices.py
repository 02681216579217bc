# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertex and corner colors are sharpened by the learned recipe as images are."""

import math

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import Delaunay, cKDTree
from shapes import fan, grid, icosphere, rotation, shuffled
from shock_filter import core
from shock_filter.core.base.findings import gathering
from shock_filter.core.color.learned.planes import Planes
from shock_filter.core.color.vertex_planes import VertexPlanes, Vertices
from shock_filter.core.mesh.calculus import smooth_vertices

SIZE = 96


def areas_of_color(size, seed=3):
    """Areas of one color each: (size, size, 3)."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[:size, :size]
    nearest = cKDTree(random.uniform(0, size, (25, 2))).query(np.stack([x, y], -1).reshape(-1, 2))
    return random.random((25, 3))[nearest[1]].reshape(size, size, 3)


def blurred(picture, sigma):
    return ndimage.gaussian_filter(picture, (sigma, sigma, 0), mode="mirror")


def pixels_as_mesh(size):
    """A mesh with a vertex for each pixel, row by row."""
    y, x = np.mgrid[:size, :size]
    vertices = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    first = (size * y + x)[:-1, :-1].reshape(-1, 1)
    faces = np.concatenate([first + [0, 1, size + 1], first + [0, size + 1, size]])
    return core.TriangleMesh(vertices, faces)


def scattered(size, seed=1):
    """An uneven flat mesh, and its places in a picture of some size."""
    random = np.random.default_rng(seed)
    places = random.uniform(1, size - 2, (size * size, 2))
    tree, kept = cKDTree(places), np.ones(size * size, dtype=bool)
    for i, near in enumerate(tree.query_ball_point(places, 0.6)):
        if kept[i]:
            kept[[j for j in near if j > i]] = False
    places = places[kept]
    faces = Delaunay(places).simplices
    inner = ((places[faces] > 2.5) & (places[faces] < size - 3.5)).all(axis=(1, 2))
    used = np.unique(faces[inner])
    number = np.zeros(len(places), dtype=int)
    number[used] = np.arange(len(used))
    return np.pad(places[used], ((0, 0), (0, 1))), number[faces[inner]]


def read(picture, vertices):
    return np.stack(
        [
            ndimage.map_coordinates(each, vertices[:, 1::-1].T, order=1)
            for each in picture.T.swapaxes(1, 2)
        ],
        axis=1,
    )


def at_vertices(mesh, values, mask=None, **words):
    settings = core.ShockSettings(what="auto", **words)
    return core.sharpen_vertex_signal(mesh, values, settings, mask=mask)


def at_corners(mesh, values):
    return core.sharpen_corner_signal(mesh, values, core.ShockSettings(what="auto"))


def error(values, truth):
    return math.sqrt(((values - truth) ** 2).mean())


def decibels(values, truth):
    return -20 * math.log10(error(values, truth))


@pytest.fixture(scope="module")
def uneven():
    vertices, faces = scattered(SIZE)
    picture = areas_of_color(SIZE)
    return vertices, faces, read(blurred(picture, 1.2), vertices), read(picture, vertices)


@pytest.mark.parametrize("sigma", [1.0, 2.0])
def test_pixels_as_vertices_gain_what_the_image_gains(sigma):
    picture = areas_of_color(SIZE)
    image = blurred(picture, sigma).astype(np.float32)
    out = at_vertices(pixels_as_mesh(SIZE), image.reshape(-1, 3))
    gained = [
        decibels(result, picture) - decibels(image, picture)
        for result in (out.reshape(image.shape), core.sharpen_image(image))
    ]
    assert gained[1] > 2.0
    assert gained[0] > gained[1] - 0.3


def test_smoothings_and_windows_of_a_grid_are_those_of_an_image():
    values = blurred(areas_of_color(64), 0.7).astype(np.float32)
    mesh = pixels_as_mesh(64)
    vertices = Vertices(mesh)
    ours = VertexPlanes.of_vertices(vertices, values.reshape(-1, 3))
    image = Planes(np.ascontiguousarray(np.moveaxis(values, 2, 0)), np.empty((0, 0), np.float32))
    sigmas = 0.6, 1.6, 4.5
    for one, other in zip(ours.smoothed(sigmas, 0, 64), image.smoothed(sigmas, 0, 64), strict=True):
        away = error(other, image.values)
        assert error(vertices.values_of(one), other.reshape(3, -1).T) < 0.12 * away
    for one, other in zip(
        ours.ranges((1, 2, 7), 0, 64), image.ranges((1, 2, 7), 0, 64), strict=True
    ):
        assert all(
            np.array_equal(vertices.values_of(a), b.reshape(3, -1).T)
            for a, b in zip(one, other, strict=True)
        )


def test_linear_signals_stay_where_heat_spreads():
    vertices, faces = scattered(64)
    mesh = core.TriangleMesh(vertices, faces)
    planes = VertexPlanes.of_vertices(Vertices(mesh), vertices[:, :1])
    smooth = planes.vertices.values_of(planes.smoothed((2.6,), 0, 64)[0])
    inner = (abs(vertices[:, :2] - 32) < 18).all(axis=1)
    assert abs(smooth - vertices[:, :1])[inner].max() < 1e-3


def test_needles_carry_nothing_to_their_ends():
    random = np.random.default_rng(0)
    y, x = np.mgrid[:40, :40] + random.uniform(-0.35, 0.35, (2, 40, 40))
    flat = np.stack([x.ravel(), y.ravel()], axis=1)
    faces = Delaunay(flat).simplices  # along the rim, as long as the sheet
    mesh = core.TriangleMesh(np.pad(flat, ((0, 0), (0, 1))), faces)
    truth = areas_of_color(40).reshape(-1, 3)
    soft = smooth_vertices(mesh, truth, 3)
    planes = VertexPlanes.of_vertices(Vertices(mesh), soft)
    smooth = planes.vertices.values_of(planes.smoothed((1.0,), 0, planes.vertices.rows)[0])
    rim = np.minimum(flat, 39 - flat).min(axis=1) < 1
    assert error(smooth[rim], soft[rim]) < 2 * error(smooth[~rim], soft[~rim])
    out = at_vertices(mesh, soft)
    assert decibels(out[rim], truth[rim]) > decibels(soft[rim], truth[rim])


def test_blurred_areas_come_closer_to_what_they_were(uneven):
    vertices, faces, soft, truth = uneven
    mesh = core.TriangleMesh(vertices, faces)
    out = at_vertices(mesh, soft)
    assert decibels(out, truth) > decibels(soft, truth) + 1.0


def test_a_result_depends_on_neither_order_nor_size_nor_place(uneven):
    vertices, faces, soft, _ = uneven
    out = at_vertices(core.TriangleMesh(vertices, faces), soft)
    change = error(out, soft)
    turned = 7.3 * vertices @ rotation(2).T + 100.0
    other = at_vertices(core.TriangleMesh(turned, faces), soft)
    assert error(other, out) < 0.3 * change  # cells lie elsewhere
    order = np.random.default_rng(0).permutation(len(vertices))
    number = np.argsort(order)
    mesh = core.TriangleMesh(vertices[order], number[faces[::-1]])
    other = at_vertices(mesh, soft[order])
    assert error(other, out[order]) < 0.01 * change


def test_scaling_and_shifting_of_values_commute(uneven):
    vertices, faces, soft, _ = uneven
    mesh = core.TriangleMesh(vertices, faces)
    out = at_vertices(mesh, soft)
    other = at_vertices(mesh, 40.0 * soft - 3000.0)
    assert error((other + 3000.0) / 40.0, out) < 0.01 * error(out, soft)


def test_nothing_leaves_the_range_nearby(uneven):
    vertices, faces, soft, _ = uneven
    mesh = core.TriangleMesh(vertices, faces)
    out = at_vertices(mesh, soft)
    planes = VertexPlanes.of_vertices(Vertices(mesh), soft)
    low, high = (planes.vertices.values_of(each[0]) for each in planes.ranges((7,), 0, 0))
    assert (out >= low - 1e-6).all()
    assert (out <= high + 1e-6).all()
    assert out.min() >= soft.min()
    assert out.max() <= soft.max()


@pytest.mark.parametrize("channels", ["coupled", "independent", "luminance"])
@pytest.mark.parametrize("sampling", ["linear", "nearest"])
def test_even_colors_stay_bit_for_bit(channels, sampling):
    mesh = core.TriangleMesh(*icosphere(3))
    words = {"channels": channels, "sampling": sampling}
    colors = np.tile([0.1, 0.37, 0.9], (mesh.vertex_count, 1))
    assert np.array_equal(at_vertices(mesh, colors, **words), colors)


def test_masks_and_amount_mix(uneven):
    vertices, faces, soft, _ = uneven
    mesh = core.TriangleMesh(vertices, faces)
    out = at_vertices(mesh, soft)
    half = at_vertices(mesh, soft, amount=0.5)
    assert np.allclose(half, 0.5 * (soft + out))
    mask = np.zeros(len(soft))
    mask[::2] = 1.0
    masked = at_vertices(mesh, soft, mask=mask)
    assert np.array_equal(masked[1::2], soft[1::2])
    assert np.array_equal(masked[::2], out[::2])


def test_corners_that_agree_are_a_vertex(uneven):
    vertices, faces, soft, _ = uneven
    mesh = core.TriangleMesh(vertices, faces)
    out = at_vertices(mesh, soft)
    corners = at_corners(mesh, soft[faces])
    assert error(corners, out[faces]) < 0.01 * error(out, soft)


def test_nothing_flows_across_jumps():
    vertices, faces = grid(30, 30)
    mesh = core.TriangleMesh(vertices, faces)
    corners = np.where(vertices[faces][:, :, :1].mean(axis=1, keepdims=True) > 14.5, 0.9, 0.2)
    corners = np.broadcast_to(corners, (*faces.shape, 1)).copy()
    assert np.array_equal(at_corners(mesh, corners), corners)


def test_bytes_are_as_good_as_floats(uneven):
    vertices, faces, soft, truth = uneven
    mesh = core.TriangleMesh(vertices, faces)
    rounded = np.rint(255 * soft) / 255
    results = [at_corners(mesh, each[faces]) for each in (soft, rounded)]
    floats, of_bytes = (decibels(result, truth[faces]) for result in results)
    assert of_bytes > floats - 0.1


@pytest.mark.parametrize("count", [1, 2, 4])
def test_odd_meshes_work(count):
    random = np.random.default_rng(0)
    torn = np.concatenate([grid(12, 12)[0], [[50.0, 50, 50]]])
    torn[17] = torn[18]  # faces without area
    sheets = grid(12, 12)[1], np.concatenate([grid(12, 12)[1], [[0, 40, 100]]])
    meshes = [(np.eye(3), [[0, 1, 2]]), *((torn, faces) for faces in sheets), fan(300)]
    for vertices, faces in meshes:
        mesh = core.TriangleMesh(vertices, faces)
        colors = random.random((mesh.vertex_count, count)).astype(np.float32)
        out = at_vertices(mesh, colors)
        assert out.dtype == np.float32
        assert np.isfinite(out).all()
        assert out.min() >= colors.min()
        assert out.max() <= colors.max()
        loose = np.setdiff1d(np.arange(mesh.vertex_count), mesh.faces)
        assert np.array_equal(out[loose], colors[loose])


def test_reports_say_what_was_done():
    mesh = pixels_as_mesh(48)
    away = mesh.vertices[:, :1] - 24
    with gathering() as found:
        at_vertices(mesh, 0.5 + 0.4 * np.tanh(away / 2))
    assert "edge lengths wide" in str(found[0])
    with gathering() as found:
        at_vertices(mesh, np.ones((mesh.vertex_count, 3)))
    assert str(found[0]) == "Nothing to sharpen was found."


def test_shuffled_faces_change_little():
    vertices, faces = icosphere(4)
    colors = 0.5 + 0.4 * np.tanh(6 * vertices)
    out = at_vertices(core.TriangleMesh(vertices, faces), colors)
    given = shuffled(vertices, faces)
    nearest = cKDTree(vertices).query(given[0])[1]
    other = at_vertices(core.TriangleMesh(given[0], given[1]), colors[nearest])
    assert abs(other - out[nearest]).mean() < 0.02 * abs(out - colors).mean() + 1e-6
