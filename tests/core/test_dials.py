# SPDX-License-Identifier: GPL-3.0-or-later
"""What, Width and noise say how strong each part is; see `dials`."""

import numpy as np
import pytest
from shock_filter.core.color.by_width.dials import (
    WIDEST,
    contrast,
    counted_width,
    flow_only,
    flow_times,
    plan_of,
)

KINDS = pytest.mark.parametrize("what", ["drawing", "photo"])
NOISES = (0.0, 0.004, 0.007, 0.015, 0.03, 0.1)


@KINDS
def test_the_more_noise_the_less_is_added(what):
    added = [plan_of(what, 4.0, noise).unsharp for noise in NOISES]
    assert np.all(np.diff(added) < 0)
    assert added[-1] < 0.05 * added[0]


@pytest.mark.parametrize(("what", "noise"), [("drawing", 0.02), ("photo", 0.008)])
def test_half_as_much_is_added_at_the_stated_noise(what, noise):
    assert plan_of(what, 4.0, noise).unsharp == 0.5 * plan_of(what, 4.0).unsharp


def test_in_noise_the_flow_does_what_is_no_longer_added():
    squares = [plan_of("drawing", 4.0, noise).square for noise in NOISES]
    assert np.all(np.diff(squares) > 0)


@KINDS
def test_the_more_noise_the_more_contrast_a_border_needs(what):
    faint = [plan_of(what, 4.0, noise).faint for noise in NOISES]
    assert np.all(np.diff(faint) >= 0)
    assert faint[-1] > 3 * faint[0]
    # So that the flow leaves alone what differs by no more than noise does.
    times = [flow_times(plan_of(what, 4.0, noise), np.array(0.05)) for noise in (0.04, 0.08)]
    assert times[1] < 0.7 * times[0]


@KINDS
def test_each_further_smoothing_pass_closes_as_much_as_it_widens(what):
    plans = [plan_of(what, 5.0, passes=passes) for passes in (1, 2, 4)]
    assert [plan.passes for plan in plans] == [1, 2, 4]
    assert np.diff([plan.square for plan in plans]) == pytest.approx([1.0, 2.0])


@pytest.mark.parametrize(
    ("width", "noise", "passes"), [(10.0, 0.02, 2), (10.0, 0.0, 1), (4.0, 0.02, 1)]
)
def test_wide_borders_in_noise_are_smoothed_twice(width, noise, passes):
    assert plan_of("photo", width, noise).passes == passes
    assert plan_of("photo", width, noise, passes=3).passes == 3


@KINDS
def test_measured_widths_are_bounded_in_pixels_before_enlarging(what):
    assert counted_width(0.0, 1000.0, what) == WIDEST[what]
    assert counted_width(0.0, 1000.0, what, enlarge=4) == 4 * WIDEST[what]
    assert counted_width(30.0, 1000.0, what) == 30.0


def test_a_plan_of_the_flow_alone_adds_nothing():
    plan = flow_only(plan_of("drawing", 5.0, 0.03), 5.0)
    assert (plan.unsharp, plan.share) == (0.0, 1.0)
    assert plan.faint == plan_of("drawing", 5.0, 0.03).faint


def test_channels_add_up_to_one_contrast():
    low, high = np.zeros((2, 3)), np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 2.0]])
    assert contrast(low, high).tolist() == [5.0, 2.0]
