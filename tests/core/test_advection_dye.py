# SPDX-License-Identifier: GPL-3.0-or-later
"""Dye that is released into a flow (paper D, section 5)."""

import itertools
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest
from flows import rotation, uniform
from shock_filter import core
from shock_filter.core.advection.sharpening import sharpen_dye
from shock_filter.core.base import parallel

SIZE = (80, 96)
PLAIN = {"sharpness": 0.0}


def spot(x=0.5, y=0.75, width=12.0, **words):
    """Red dye, released once."""
    return core.DyeSource([(x, y)], width=width, **({"colors": [(1, 0, 0)], "every": 0} | words))


def last_of(velocity, sources, frames, **settings):
    """Return the last frame."""
    given = core.advect_dye(velocity, sources, core.DyeSettings(**settings), frames=frames)
    return deque(given, maxlen=1)[0]


def centroid(frame):
    """Where the dye is on the mean: (column, row)."""
    rows, columns = np.indices(frame.shape[:2])
    weights = frame[..., 3] / frame[..., 3].sum()
    return np.array([(weights * columns).sum(), (weights * rows).sum()])


def turned(frames, size=(128, 128)):
    """Return how far a spot is from its start after a turn in so many steps, in pixels."""
    velocity = rotation(size) * 2 * np.pi / frames
    given = core.advect_dye(
        velocity,
        spot(),
        core.DyeSettings(step=0, sharpness=0),
        frames=frames + 1,
    )
    first = next(given)
    last = deque(given, maxlen=1)[0]
    return np.linalg.norm(centroid(last) - centroid(first))


def test_whole_steps_move_dye_exactly():
    first = last_of(uniform(SIZE, 3, -2), spot(0.3), 1, step=0.0)
    last = last_of(uniform(SIZE, 3, -2), spot(0.3), 6, step=0.0, sharpness=0.0)
    np.testing.assert_allclose(last, np.roll(first, (10, 15), axis=(0, 1)), atol=1e-6)
    sharp = last_of(uniform(SIZE, 3, -2), spot(0.3), 6, step=0.0)
    assert np.linalg.norm(centroid(sharp) - centroid(last)) < 0.05


def test_circles_close_in_second_order():
    """Figure 11."""
    apart = [turned(steps) for steps in (24, 48)]
    assert 1.7 < np.log2(apart[0] / apart[1]) < 2.4
    assert apart[1] < 0.7


def test_steps_halfway_use_the_velocity_halfway_in_time():
    # The acceleration is constant: midpoint steps are exact.
    fields = np.stack([uniform(SIZE, 0.0, 0.0), uniform(SIZE, 4.0, 0.0)])
    first = last_of(fields, spot(0.2), 1, step=0.0, sharpness=0.0)
    last = last_of(fields, spot(0.2), 9, step=0.0, sharpness=0.0)
    np.testing.assert_allclose(centroid(last) - centroid(first), [16.0, 0.0], atol=1e-3)


def test_thin_dye_is_kept_and_wide_dye_stays_sharp():
    """Figure 13: a spot after a turn, against what it was."""
    size = (128, 128)
    velocity = rotation(size)
    frames = round(2 * np.pi * np.hypot(64, 64) / 4.0)
    kept, sharp = {}, {}
    for sharpening in ("shock", None):
        how = {} if sharpening else PLAIN
        for width in (5.0, 12.0):
            given = core.advect_dye(velocity, spot(width=width),
                                    core.DyeSettings(step=4.0, **how),
                                    frames=frames)  # fmt: skip
            first = next(given)[..., 3]
            last = deque(given, maxlen=1)[0][..., 3]
            kept[sharpening, width] = last.sum() / first.sum()
            sharp[sharpening, width] = ((last > 0.1) & (last < 0.9)).sum() / (first > 0.1).sum()
    assert kept["shock", 5.0] == pytest.approx(1.0, abs=0.02)
    assert kept["shock", 12.0] == pytest.approx(1.0, abs=0.02)
    assert sharp["shock", 12.0] < 1.2 < 2.5 < sharp[None, 12.0]


@pytest.mark.parametrize("sharpness", [0.2, 1.0])
def test_the_shock_filter_keeps_the_sum_and_the_range(sharpness):
    random = np.random.default_rng(0).random((2, 30, 40), dtype=np.float32)
    for joined in itertools.product([False, True], repeat=2):
        found = random.copy()
        for _ in range(10):
            found = sharpen_dye(found, core.DyeSettings(sharpness=sharpness), joined)
        np.testing.assert_allclose(found.sum(axis=(1, 2)), random.sum(axis=(1, 2)), rtol=1e-5)
        assert found.min() >= 0 and found.max() <= 1 + 1e-6
    ramp = np.clip(np.arange(40, dtype=np.float32) - 16.5, 0, 6) / 6
    edge = np.tile(ramp, (1, 9, 1))
    for _ in range(round(20 / sharpness)):
        edge = sharpen_dye(edge, core.DyeSettings(sharpness=sharpness), (False, False))
    assert ((edge > 0.1) & (edge < 0.9)).sum() <= 9


def test_unsharpened_dye_is_neither_made_nor_lost_inside():
    first = last_of(rotation(SIZE), spot(), 1, **PLAIN)
    last = last_of(rotation(SIZE), spot(), 60, step=1.0, **PLAIN)
    assert abs(last[..., 3].sum() / first[..., 3].sum() - 1) < 0.02


def test_releases_once_always_and_in_turns():
    velocity = uniform(SIZE, 2.0, 0.0)
    red, blue = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    sources = {
        "once": spot(0.1, 0.5, every=0),
        "always": spot(0.1, 0.5, every=1),
        "pulsed": spot(0.1, 0.5, colors=[red, blue], every=16, lasting=4),
    }
    row = {
        name: last_of(velocity, each, 36, step=0.0, **PLAIN)[40] for name, each in sources.items()
    }
    spots = {
        name: (np.diff((each[:, 3] > 0.5).astype(int)) == 1).sum() for name, each in row.items()
    }
    assert spots == {"once": 1, "always": 1, "pulsed": 3}
    assert (row["once"][:, 3] > 0.5).sum() in (11, 12, 13)
    assert (row["always"][:, 3] > 0.5).sum() > 75
    colors = [row["pulsed"][column, :3] for column in (80, 50, 16)]
    np.testing.assert_allclose(colors, [red, blue, red], atol=1e-5)


def test_strips_and_curves_cover_what_they_say():
    (frame,) = core.advect_dye(
        uniform(SIZE, 0, 0), core.DyeSource([(0.25, 0.25), (0.75, 0.25)], width=8.0), frames=1
    )
    assert frame[..., 3].sum() == pytest.approx(48 * 8 + np.pi * 16, rel=0.01)
    rows = np.flatnonzero(frame[..., 3].any(axis=1))
    assert abs(rows.mean() - (0.75 * SIZE[0] - 0.5)) < 0.51  # a quarter of the height from below
    bent = core.DyeSource([(0.2, 0.2), (0.2, 0.8), (0.8, 0.8)], width=4.0)
    (frame,) = core.advect_dye(uniform(SIZE, 0, 0), bent, frames=1)
    opacity = frame[..., 3]
    assert opacity[40, 19] == 1 and opacity[16, 60] == 1 and opacity[40, 60] == 0


def test_colors_stay_as_they_are():
    orange = (0.9, 0.4, 0.1)
    source = core.DyeSource([(0.5, 0.75)], width=12, colors=[orange], every=0)
    frame = last_of(rotation(SIZE), source, 30)
    inside = frame[..., 3] > 0
    np.testing.assert_allclose(frame[inside][:, :3], np.tile(orange, (inside.sum(), 1)), atol=1e-5)


def test_joined_sides_let_dye_through():
    settings = {"step": 0.0, "periodic": "both", "sharpness": 0.0}
    first = last_of(uniform(SIZE, 4, 5), spot(), 1, **settings)
    last = last_of(uniform(SIZE, 4, 5), spot(), 31, **settings)
    np.testing.assert_allclose(last, np.roll(first, (-150, 120), axis=(0, 1)), atol=1e-6)
    gone = last_of(uniform(SIZE, 4, 5), spot(), 31, step=0.0, sharpness=0.0)
    assert gone[..., 3].sum() == 0


def test_no_dye_where_the_flow_is_undefined():
    velocity = uniform(SIZE, 2.0, 0.0)
    velocity[:, 48:60] = np.nan
    for settings in ({"sharpness": 0.0}, {}):
        frame = last_of(velocity, spot(0.3, 0.5, every=1), 40, step=0.0, **settings)
        assert np.isfinite(frame).all()
        assert frame[:, 48:60, 3].max() == 0
        assert frame[:, 62:, 3].max() == 0


def test_dye_lies_over_noise_and_backgrounds():
    velocity = rotation(SIZE)
    below = core.NoiseSettings(seed=3)
    frames = [*core.advect_dye(velocity, spot(), frames=5, noise=below)]
    noise = [*core.advect_noise(velocity, below, frames=5)]
    alone = [*core.advect_dye(velocity, spot(), frames=5)]
    for frame, gray, dye in zip(frames, noise, alone, strict=True):
        opacity = dye[..., 3:]
        expected = opacity * dye[..., :3] + (1 - opacity) * gray[..., None]
        np.testing.assert_allclose(frame[..., :3], expected, atol=1e-5)
        assert (frame[..., 3] == 1).all()
    picture = np.random.default_rng(0).random((*SIZE, 3))
    frame = [*core.advect_dye(velocity, spot(), frames=5, background=picture)][-1]
    opacity = alone[-1][..., 3:]
    np.testing.assert_allclose(frame[..., :3], opacity * alone[-1][..., :3]
                               + (1 - opacity) * picture, atol=1e-5)  # fmt: skip


def test_loops_close_without_a_jump():
    source = spot(0.1, 0.5, every=10, lasting=4, colors=[(1, 0, 0), (0, 1, 0)])
    settings = core.DyeSettings(step=3.0, loop=8)
    frames = np.array([*core.advect_dye(uniform(SIZE, 1, 0), source, settings, frames=40)])
    steps = [abs(b - a).mean() for a, b in itertools.pairwise(frames)]
    assert abs(frames[0] - frames[-1]).mean() < 1.2 * max(steps)
    assert frames[0, ..., 3].sum() > 100
    with pytest.raises(core.InvalidSettings, match="repeats after 20 frames"):
        core.advect_dye(uniform(SIZE, 1, 0), source, settings, frames=30)


def test_frames_do_not_depend_on_the_number_of_threads(monkeypatch):
    found = []
    for threads in (1, 3):
        pool = ThreadPoolExecutor(max(threads - 1, 1))
        monkeypatch.setattr(parallel, "thread_count", lambda threads=threads: threads)
        monkeypatch.setattr(parallel, "_pool", cache(lambda pool=pool: pool))
        found.append(last_of(rotation(SIZE), spot(), 10))
    np.testing.assert_array_equal(*found)


def test_progress_may_cancel():
    frames = core.advect_dye(
        rotation(SIZE), spot(), frames=9, progress=lambda fraction, _: fraction < 0.5
    )
    seen = []
    with pytest.raises(core.Cancelled):
        for frame in frames:
            seen.append(frame)
    assert len(seen) == 4


@pytest.mark.parametrize("velocity", [np.zeros((7, 9, 2)), np.full((7, 9, 2), np.nan),
                                      np.ones((1, 1, 2))])  # fmt: skip
def test_odd_fields_give_sound_frames(velocity):
    for step in (0.5, 1000.0):
        settings = core.DyeSettings(step=step)
        for frame in core.advect_dye(velocity, [spot()], settings, frames=3):
            assert np.isfinite(frame).all()
    (frame,) = core.advect_dye(velocity, [], frames=1)
    assert (frame == 0).all()


@pytest.mark.parametrize("words, message", [
    ({"points": [(0.5, 0.5, 0.5)]}, "points"),
    ({"points": [(np.nan, 0.5)]}, "points"),
    ({"points": np.empty((0, 2))}, "points"),
    ({"width": 0.0}, "width"),
    ({"width": np.nan}, "width"),
    ({"colors": [(1.0, 2.0, 0.0)]}, "colors"),
    ({"colors": [(1.0, 0.0)]}, "colors"),
    ({"every": -1}, "every"),
    ({"every": 1.5}, "every"),
    ({"lasting": 0}, "lasting"),
])  # fmt: skip
def test_bad_sources_are_named(words, message):
    with pytest.raises(core.ShockError, match=message):
        core.DyeSource(**({"points": [(0.5, 0.5)]} | words))


def test_what_is_no_source_is_named():
    with pytest.raises(core.InvalidSettings, match="DyeSource"):
        core.advect_dye(rotation(SIZE), [(0.5, 0.5)])
