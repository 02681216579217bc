# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of smoothing the noise of rays at places on a surface."""

import numpy as np
import pytest
from shock_filter.core.maps.ray_noise import without_noise
from shock_filter.core.maps.tracing import Sites
from shock_filter.core.rays.directions import grid_codes, ray_of, ray_points

SIDE = 40
NOISE = 0.05


def sites(points, normals):
    points, normals = (np.asarray(each, dtype=np.float32) for each in (points, normals))
    count = len(points)
    numbers = np.arange(count)
    return Sites(points, normals, normals, numbers, numbers, np.ones(count, dtype=np.float32))


def plane(height=0.0, up=(0, 0, 1)):
    x, y = np.meshgrid(np.arange(SIDE) + 0.5, np.arange(SIDE) + 0.5)
    flat = np.stack([x, y, np.full_like(x, height)], axis=-1).reshape(-1, 3)
    return flat, np.broadcast_to(np.array(up, dtype=float), flat.shape)


def both(*sheets):
    return sites(*(np.concatenate(each) for each in zip(*sheets, strict=True)))


def noisy(values, seed=0):
    random = np.random.default_rng(seed)
    return (values[:, None] + NOISE * random.normal(size=(len(values), 2))).astype(np.float32)


def root_mean_square(values):
    return float(np.sqrt(np.mean(np.square(values))))


def test_what_is_even_loses_most_of_the_noise():
    flat = both(plane())
    found = without_noise(flat, noisy(np.full(SIDE * SIDE, 0.5)), 4.0)
    assert root_mean_square(found - 0.5) < 0.2 * NOISE / np.sqrt(2)


def test_slopes_and_tilts_are_kept():
    # The tilt of a round surface, and a slope in space.
    angle = np.arange(SIDE) / 16
    x, turn = np.meshgrid(np.arange(SIDE) + 0.5, angle)
    normals = np.stack([0 * x, np.sin(turn), np.cos(turn)], axis=-1).reshape(-1, 3)
    points = 16 * normals + np.stack([x, 0 * x, 0 * x], axis=-1).reshape(-1, 3)
    values = 0.01 * points[:, 0] + 0.3 * normals[:, 2]
    found = without_noise(sites(points, normals), np.stack([values] * 2, axis=1), 4.0)[:, 0]
    assert np.abs(found - values).max() < 3e-3


@pytest.mark.parametrize(
    "other",
    [
        ([0, 1, 0, 0, 0, 1, 1, 0, 0], 0.0),  # a wall along the floor's edge
        ([1, 0, 0, 0, 1, 0, 0, 0, 1], 1.5),  # a sheet above
        ([1, 0, 0, 0, -1, 0, 0, 0, -1], -0.5),  # the other side of a thin wall
    ],
)
def test_nothing_crosses_edges_and_gaps(other):
    turn, height = np.reshape(other[0], (3, 3)), other[1]
    flat, up = plane()
    second = flat @ turn.T + [0, SIDE if turn[1, 1] < 0 else 0, height]
    halves = np.concatenate([noisy(np.zeros(len(flat))), noisy(np.ones(len(flat)), 1)])
    found = without_noise(both((flat, up), (second, up @ turn.T)), halves, 4.0)[:, 0]
    alone = without_noise(both((flat, up)), halves[: len(flat)], 4.0)[:, 0]
    assert np.abs(found[: len(flat)] - alone).max() < 0.02
    assert root_mean_square(found[len(flat) :] - 1.0) < 0.2 * NOISE


def test_shadows_stay_crisp():
    points, normals = plane()
    values = np.where(points[:, 0] < SIDE / 2, 0.1, 0.9)
    found = without_noise(sites(points, normals), noisy(values), 4.0)[:, 0]
    columns = found.reshape(SIDE, SIDE).mean(axis=0)
    assert np.abs(columns - np.where(np.arange(SIDE) < SIDE / 2, 0.1, 0.9)).max() < 0.05


def test_the_same_in_any_order_and_for_each_value():
    points, normals = plane()
    values = np.sin(points[:, 0] / 5) * np.cos(points[:, 1] / 7)
    one, other = noisy(values), noisy(1 - values, 1)
    stacked = np.stack([one[:, 0], other[:, 0], one[:, 1], other[:, 1]], axis=1)
    found = without_noise(sites(points, normals), stacked, 4.0)
    assert np.array_equal(found, without_noise(sites(points, normals), stacked, 4.0))
    order = np.random.default_rng(2).permutation(len(points))
    mixed = without_noise(sites(points[order], normals[order]), stacked[order], 4.0)
    assert np.allclose(mixed, found[order], atol=1e-3)
    assert root_mean_square(found[:, 0] - values) < 0.4 * NOISE


def test_places_that_do_not_fit_are_left():
    assert without_noise(both(plane()), noisy(np.zeros(SIDE * SIDE)), 0.0).shape == (SIDE * SIDE, 1)
    none = sites(np.zeros((0, 3)), np.zeros((0, 3)))
    assert without_noise(none, np.zeros((0, 2), np.float32), 4.0).shape == (0, 1)
    # All in one spot, without normals or distances; and one alone.
    halves = noisy(np.ones(3000))
    spot = sites(np.zeros((3000, 3)), np.zeros((3000, 3)))
    assert np.allclose(without_noise(spot, halves, 4.0)[:, 0], halves.mean(axis=1), atol=1e-6)
    flat = sites(np.zeros((3000, 3)), np.broadcast_to([0.0, 0.0, 1.0], (3000, 3)))
    still = flat._replace(spacings=np.zeros(3000, np.float32))
    assert np.allclose(without_noise(still, halves, 4.0)[:, 0], halves.mean(axis=1), atol=1e-6)
    crowd = without_noise(flat, halves, 1000.0)
    assert np.abs(crowd - 1).max() < NOISE
    alone = without_noise(sites([[1, 2, 3]], [[0, 0, 1]]), halves[:1], 4.0)
    assert alone[0, 0] == pytest.approx(halves[0].mean())


@pytest.mark.parametrize("rays", [16, 24])
def test_neighbours_share_rays_out(rays):
    # Whether rays leave on one side of a slanted line: their share is that of the disk's segment.
    points = ray_points(rays)
    wanted = np.arccos(0.3) / np.pi - 0.3 * np.sqrt(1 - 0.09) / np.pi

    def error(turn):
        found = np.array([ray_of(points, rays, turn, i) for i in range(rays)])
        assert (np.linalg.norm(found, axis=1) < 1).all()
        return (found @ [0.8, 0.6] > 0.3).mean() - wanted

    errors = np.array([error(turn) for turn in range(256)])
    assert root_mean_square(errors) < 0.1
    apart = root_mean_square(errors) / 4
    assert (
        root_mean_square(errors.reshape(-1, 16).mean(axis=1)) < (0.75 if rays == 16 else 1) * apart
    )


def test_neighbours_in_a_grid_follow_each_other():
    codes = grid_codes(np.argwhere(np.ones((4, 4))))
    assert sorted(codes) == list(range(16))
    assert set(codes.reshape(4, 4)[:2, :2].ravel()) == {0, 1, 2, 3}
    assert grid_codes(np.array([[1 << 15, (1 << 15) + 1]]))[0] == (3 << 30) + 2
