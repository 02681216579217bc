# SPDX-License-Identifier: GPL-3.0-or-later
"""The recipe by width on a domain that is made here: a line of values, by numpy alone."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, minimum_filter1d
from shock_filter.core.color.by_width.dials import plan_of
from shock_filter.core.color.by_width.domain import Domain, Nearby, flow_for_time
from shock_filter.core.color.by_width.recipe import Lead, sharpen_by_width

WIDTH = 8.0
X = np.arange(64.0)


class Line(Domain):
    """Values at the places 0, 1, ..., as columns: (n, d). They are handed out in two pieces."""

    def each_nearby(self, values, sigma, distance, use):
        size = 2 * int(np.ceil(distance)) + 1
        floats = values.astype(float)
        smooth = gaussian_filter1d(floats, sigma, axis=0)
        low, high = (f(floats, size, axis=0) for f in (minimum_filter1d, maximum_filter1d))
        for piece in (slice(0, 30), slice(30, None)):
            use(piece, Nearby(*(each[piece] for each in (floats, smooth, low, high))))

    def contrasts(self, values, presmooth, reach):
        smooth = gaussian_filter1d(values.astype(float), presmooth, axis=0)
        size = 2 * round(reach) + 1
        ranges = maximum_filter1d(smooth, size, axis=0) - minimum_filter1d(smooth, size, axis=0)
        return gaussian_filter1d(np.linalg.norm(ranges, axis=1), reach / 2)

    def potential(self, values, passes):
        return (np.gradient(values.astype(float), axis=0) ** 2).sum(axis=1)

    def advect(self, values, potential, times, out):
        x, left = X.copy(), np.broadcast_to(times, X.shape).copy()
        slope = np.gradient(potential)
        for _ in range(400):
            speed = -0.5 * np.interp(x, X, slope)
            step = np.minimum(0.1 / np.maximum(np.abs(speed), 1e-9), left)
            x, left = np.clip(x + step * speed, 0, X[-1]), left - step
        moved = np.stack([np.interp(x, X, column) for column in values.T], axis=1)
        out[...] = np.rint(moved) if out.dtype.kind == "u" else moved


def border(middle=32.0):
    """A soft border between 0.2 and 0.8."""
    return 0.5 + 0.3 * np.tanh((X[:, None] - middle) / (WIDTH / 2.2))


def steepest(values):
    steps = np.abs(np.diff(values[:, 0].astype(float)))
    return steps.argmax(), steps.max()


@pytest.mark.parametrize("what, least", [("drawing", 3.0), ("photo", 1.7)])
def test_another_domain_costs_one_class(what, least):
    values = border()
    result = values.copy()
    sharpen_by_width(Line(), plan_of(what, WIDTH), values, result)
    assert steepest(result)[1] > least * steepest(values)[1]
    assert values.min() <= result.min() and result.max() <= values.max()
    np.testing.assert_array_equal(values, border())  # was only read


@pytest.mark.parametrize("what", ["drawing", "photo"])
def test_whole_numbers_are_rounded_once(what):
    scaled = np.rint(255 * border())
    plan, whole, exact = plan_of(what, WIDTH), scaled.astype(np.uint8), scaled.copy()

    class Scaled(Line):
        def contrasts(self, values, presmooth, reach):
            return super().contrasts(values / 255, presmooth, reach)

        def potential(self, values, passes):
            return super().potential(values / 255, passes)

    sharpen_by_width(Scaled(), plan, whole.copy(), whole)
    sharpen_by_width(Scaled(), plan, scaled, exact)
    assert steepest(whole)[1] > 1.5 * steepest(scaled)[1]
    assert np.abs(whole - exact).max() < 0.501  # by whole numbers floats of single precision flow


@pytest.mark.parametrize("what", ["drawing", "photo"])
def test_values_flow_where_those_of_the_lead_do(what):
    values, lead, plan = border(26.0), border(29.0), plan_of(what, WIDTH)
    alone, led = values.copy(), values.copy()
    sharpen_by_width(Line(), plan, values, alone)
    sharpen_by_width(Line(), plan, values, led, Lead(Line(), lead, plan))
    assert abs(steepest(alone)[0] - 25.5) < 1
    assert abs(steepest(led)[0] - 28.5) < 1


def test_a_plan_of_the_flow_alone_leaves_the_flowing_result():
    values = border()
    plan = plan_of("photo", WIDTH)._replace(share=1.0)
    result, expected = values.copy(), values.copy()
    sharpen_by_width(Line(), plan, values, result)
    half = values.copy()
    sharpen_by_width(Line(), plan._replace(share=0.5), values, half)
    unsharp = values.copy()
    sharpen_by_width(Line(), plan._replace(share=0.0), values, unsharp)
    np.testing.assert_allclose(half, 0.5 * (result + unsharp), atol=1e-12)
    flow_for_time(Line(), values, Line(), values, 1, 0.0, expected)
    np.testing.assert_array_equal(expected, values)
