# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise that moves with a flow (paper D, section 4)."""

import gc
import itertools
import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest
from flows import (
    angle_to_flow,
    correlation,
    haar_energies,
    rotation,
    saddle,
    source,
    uniform,
)
from shock_filter import core
from shock_filter.core.advection.noise import SHARES, Noise
from shock_filter.core.advection.velocity import Flow
from shock_filter.core.base import parallel

SIZE = (96, 128)
BARE = {"step": 0.0, "injection": 0.0, "divergence": 0.0}


def cells_of(velocity, frames, mask=None, **settings):
    """Yield the carried noise, 0 and 1, before the first frame and after each."""
    chosen = core.NoiseSettings(**settings)
    flow = Flow(velocity, None, mask, chosen.step, chosen.periodic)
    noise = Noise(flow.size, flow.longest, chosen)
    yield noise.cells.copy()
    for number in range(frames):
        noise.step(flow.at(number), number)
        yield noise.cells.copy()


@pytest.mark.parametrize("right, up", [(3, 0), (0, 2), (-4, -1)])
def test_whole_steps_shift_the_noise_exactly(right, up):
    before, *_, after = cells_of(uniform(SIZE, right, up), 3, **BARE)
    moved = np.roll(before, (-3 * up, 3 * right), axis=(0, 1))
    inner = slice(12, -12), slice(12, -12)
    np.testing.assert_array_equal(after[inner], moved[inner])


@pytest.mark.parametrize("right, up", [(5, 0), (0, -3), (7, 2), (300, 100)])
def test_joined_sides_wrap_bit_for_bit(right, up):
    before, after = cells_of(uniform(SIZE, right, up), 1, periodic="both", **BARE)
    np.testing.assert_array_equal(after, np.roll(before, (-up, right), axis=(0, 1)))


@pytest.mark.parametrize("periodic", ["x", "y"])
@pytest.mark.parametrize("right, up", [(9, 0), (0, 9)])
def test_one_pair_of_sides_may_be_joined(periodic, right, up):
    before, after = cells_of(uniform(SIZE, right, up), 1, periodic=periodic, **BARE)
    assert (after == np.roll(before, (-up, right), axis=(0, 1))).all() == (
        (periodic == "x") == (right > 0)
    )


def test_fractions_of_steps_add_up():
    first, *_, last = cells_of(uniform(SIZE, 0.25, -0.1), 40, periodic="both", **BARE)
    spectrum = np.fft.fft2(last - 0.5) * np.conj(np.fft.fft2(first - 0.5))
    peak = np.unravel_index(np.argmax(np.fft.ifft2(spectrum).real), SIZE)
    assert abs(np.subtract(peak, (4, 10))).max() <= 1


def test_nothing_is_frozen_where_the_flow_is_slow():
    """Figure 6: without fractions, what goes less than half a pixel a frame would stand still."""
    size = (128, 128)
    velocity = rotation(size)
    speeds = np.hypot(*np.moveaxis(velocity, -1, 0))
    first, *_, last = cells_of(
        velocity, 40, step=2.0, periodic="none", injection=0.0, divergence=0.0
    )
    pixels = speeds * 2.0 / speeds.max()
    for slow, fast in itertools.pairwise([0.05, 0.1, 0.2, 0.4]):
        ring = (pixels > slow) & (pixels < fast)
        assert (first != last)[ring].mean() > 0.35  # half of all, if nothing is left


@pytest.mark.parametrize("field", [rotation, saddle, source])
def test_noise_keeps_two_values_and_its_mean(field):
    size = (128, 128)
    for cells in itertools.islice(cells_of(field(size), 150, step=3.0), 0, None, 50):
        assert set(np.unique(cells)) == {0, 1}
        assert abs(cells.mean() - 0.5) < 0.02


@pytest.mark.parametrize("injection", [0.0, 0.02, 0.1])
def test_noise_keeps_its_spectrum(injection):
    """Figure 5: grains do not grow, even if nothing is injected."""
    first, *_, last = cells_of(
        rotation((256, 256)), 150, step=2.0, injection=injection, divergence=0.0
    )
    np.testing.assert_allclose(haar_energies(last)[:3], haar_energies(first)[:3], rtol=0.1)


@pytest.mark.parametrize("speed", [0.05, 0.1, 0.3, 0.5])
def test_slow_flow_goes_at_its_own_speed(speed):
    frames = round(12 / speed)
    first, *_, last = cells_of(uniform((32, 64), speed, 0.0), frames, periodic="both", **BARE)
    gone = [shift for shift in range(64) if (last == np.roll(first, shift, axis=1)).all()]
    assert abs(gone[0] - 12) <= 1


def test_more_is_injected_where_the_flow_spreads():
    fine = []
    for divergence in (0.0, 1.0):
        first, *_, last = cells_of(source((128, 128)), 60, step=4.0, divergence=divergence)
        fine.append(haar_energies(last)[0] / haar_energies(first)[0])
    assert fine[1] > fine[0] + 0.1
    assert fine[1] > 0.75


def test_frames_have_streaks_along_the_flow_that_move_along():
    size = (192, 192)
    velocity = rotation(size)
    *_, before, frame = core.advect_noise(velocity, core.NoiseSettings(step=3.0), frames=10)
    assert frame.shape == size and frame.dtype == np.float32
    assert frame.min() >= 0.0 and frame.max() <= 1.0
    y, x = np.mgrid[:192, :192] - 95.5
    ring = (np.hypot(x, y) > 40) & (np.hypot(x, y) < 85)
    assert angle_to_flow(frame, velocity, ring) < 5.0
    # Above the middle the flow goes to the left.
    part = np.s_[20:40, 80:112]
    along = correlation(before[part], np.roll(frame, 1, axis=1)[part])
    along = max(along, correlation(before[part], np.roll(frame, 2, axis=1)[part]))
    across = correlation(before[part], np.roll(frame, 2, axis=0)[part])
    assert along > 0.5 and along > 2 * across


def test_correlation_is_longer_along_the_flow_than_across():
    *_, frame = core.advect_noise(uniform(SIZE, 1.0, 0.0), frames=5)
    along, across = (correlation(frame, np.roll(frame, 4, axis=axis)) for axis in (1, 0))
    assert along > 0.5
    assert abs(across) < 0.15


def test_the_start_does_not_show():
    settings = core.NoiseSettings(step=2.0, blending=0.05)
    deviations = [frame.std() for frame in core.advect_noise(rotation(SIZE), settings, frames=60)]
    assert abs(deviations[0] / np.mean(deviations[40:]) - 1) < 0.05


def test_noise_of_undefined_places_stays_inside():
    """Streaks would come out of a place where noise stands still."""
    velocity = uniform(SIZE, 1.0, 0.0)
    velocity[:, 30:40] = np.nan
    history = np.array([*cells_of(velocity, 60, **BARE)])[20:]
    edge = history[:, :, 45].astype(float)
    free = history[:, :, 100].astype(float)
    assert abs(edge.mean(axis=0) - 0.5).mean() < 1.3 * abs(free.mean(axis=0) - 0.5).mean()


def test_undefined_places_show_the_background():
    velocity = rotation(SIZE)
    velocity[20:40, 30:50] = np.nan
    mask = np.ones(SIZE, bool)
    mask[:10] = False
    background = np.random.default_rng(0).random((*SIZE, 3))
    (frame,) = core.advect_noise(velocity, frames=1, mask=mask, background=background)
    hidden = ~mask
    hidden[20:40, 30:50] = True
    np.testing.assert_allclose(frame[hidden], background[hidden], atol=1e-6)
    assert abs(frame[~hidden] - background[~hidden]).mean() > 0.1
    (gray,) = core.advect_noise(velocity, frames=1, mask=mask)
    assert (gray[hidden] == 0).all()
    np.testing.assert_array_equal(frame[~hidden], gray[~hidden][:, None].repeat(3, axis=1))


def test_masks_show_what_is_fast_and_bright():
    """Equation 10."""
    velocity = rotation(SIZE)
    background = np.full(SIZE, 0.25)
    (plain,) = core.advect_noise(velocity, frames=1)
    masked = core.NoiseSettings(speed_mask=3.0, noise_mask=2.0)
    (frame,) = core.advect_noise(velocity, masked, frames=1, background=background)
    speeds = np.hypot(*np.moveaxis(velocity, -1, 0))
    opacity = (1 - (1 - speeds / speeds.max()) ** 3) * (1 - (1 - plain) ** 2)
    np.testing.assert_allclose(frame, opacity * plain + (1 - opacity) * 0.25, atol=1e-3)


def test_speeds_have_colors():
    velocity = rotation(SIZE)
    table = np.array([[0, 0, 1], [1, 1, 0], [1, 0, 0]], dtype=float)
    (frame,) = core.advect_noise(velocity, frames=1, colors=table)
    speeds = np.hypot(*np.moveaxis(velocity, -1, 0))
    share = speeds / speeds.max()
    expected = [np.interp(share, [0, 0.5, 1], table[:, c]) for c in range(3)]
    np.testing.assert_allclose(frame, np.stack(expected, axis=-1), atol=1e-5)


def test_convolution_smooths_along_the_flow():
    velocity = uniform(SIZE, 4.0, 0.0)
    rough = []
    for convolution in (0, 6):
        settings = core.NoiseSettings(step=4.0, convolution=convolution)
        (frame,) = core.advect_noise(velocity, settings, frames=1)
        rough.append([np.abs(np.diff(frame, axis=axis)).mean() for axis in (1, 0)])
    assert rough[1][0] < 0.4 * rough[0][0]
    assert rough[1][1] > 0.4 * rough[0][1]


def test_key_frames_are_linear_in_time():
    fields = np.stack([uniform(SIZE, 0.0, 0.0), uniform(SIZE, 4.0, 0.0), uniform(SIZE, 0.0, 2.0)])
    flow = Flow(fields, None, None, 0.0, frames=9)
    middle = 50, 60
    found = [(flow.at(t).right[middle], flow.at(t).down[middle]) for t in range(9)]
    expected = [(t, 0) for t in range(5)] + [(4 - t, -t / 2) for t in range(1, 5)]
    np.testing.assert_allclose(found, expected, atol=1e-6)
    loop = Flow(fields, None, None, 0.0, frames=9, loops=True)
    assert loop.at(9).right[middle] == loop.at(0).right[middle] == 0
    np.testing.assert_allclose(loop.at(-1.5).down[middle], -1.0)


def test_functions_of_time_are_asked_for_each_frame():
    asked = []

    def turning(moment):
        asked.append(moment)
        return uniform((8, 8), np.cos(3 * moment), np.sin(3 * moment))

    frames = core.advect_noise(turning, core.NoiseSettings(blending=1.0), frames=5, size=SIZE)
    assert [frame.shape for frame in frames] == [SIZE] * 5
    assert {0.25, 0.5, 0.75} <= set(asked)


def test_steps_are_as_long_as_said():
    assert Flow(rotation(SIZE), None, None, 3.0).longest == pytest.approx(3.0)
    motion = Flow(rotation(SIZE), None, None, 3.0).at(0)
    assert np.hypot(motion.right, motion.down).max() == pytest.approx(3.0)
    assert motion.right[0, 60] < 0 < motion.right[-1, 60]  # rows go down, velocities up
    assert motion.down[40, 0] > 0 > motion.down[40, -1]


def test_velocities_have_their_own_resolution():
    coarse = Flow(rotation((24, 32)), SIZE, None, 4.0).at(0)
    fine = Flow(rotation(SIZE), None, None, 4.0).at(0)
    inner = np.s_[4:-4, 4:-4]
    np.testing.assert_allclose(coarse.right[inner], fine.right[inner], atol=0.1)
    np.testing.assert_allclose(coarse.down[inner], fine.down[inner], atol=0.1)


def test_loops_close_without_a_jump():
    velocity = rotation(SIZE)
    settings = core.NoiseSettings(loop=10)
    frames = np.array([*core.advect_noise(velocity, settings, frames=25)])
    steps = [abs(b - a).mean() for a, b in itertools.pairwise(frames)]
    last = abs(frames[0] - frames[-1]).mean()
    assert last < 1.2 * max(steps)
    assert abs(frames[12] - frames[0]).mean() > 2 * last
    deviations = frames.std(axis=(1, 2))
    assert deviations.min() > 0.9 * deviations.max()


def test_loops_of_unsteady_flows_close():
    fields = np.stack([uniform(SIZE, 2.0, 0.0), uniform(SIZE, 0.0, 2.0)])
    settings = core.NoiseSettings(loop=12, periodic="both")
    frames = np.array([*core.advect_noise(fields, settings, frames=30)])
    steps = [abs(b - a).mean() for a, b in itertools.pairwise(frames)]
    assert abs(frames[0] - frames[-1]).mean() < 1.2 * max(steps)


def test_frames_do_not_depend_on_the_number_of_threads(monkeypatch):
    settings = core.NoiseSettings(step=5.0, convolution=4, speed_mask=2.0, seed=7)
    found = []
    for threads in (1, 2, 5):
        pool = ThreadPoolExecutor(max(threads - 1, 1))
        monkeypatch.setattr(parallel, "thread_count", lambda threads=threads: threads)
        monkeypatch.setattr(parallel, "_pool", cache(lambda pool=pool: pool))
        found.append([*core.advect_noise(rotation((200, 150)), settings, frames=3)])
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])


def test_seeds_give_other_noise():
    (a,), (b,), (c,) = (
        core.advect_noise(rotation(SIZE), core.NoiseSettings(seed=seed), frames=1)
        for seed in (1, 2, 1)
    )
    np.testing.assert_array_equal(a, c)
    assert abs(correlation(a, b)) < 0.1


def test_memory_does_not_grow_and_is_freed():
    velocity = rotation(SIZE)
    for _ in core.advect_noise(velocity, frames=20):  # loads and compiles all that later frames use
        pass
    gc.collect()
    tracemalloc.start()
    try:
        frames = core.advect_noise(velocity, frames=1000)
        for _ in range(10):
            next(frames)
        few, _ = tracemalloc.get_traced_memory()
        for _ in range(400):
            next(frames)
        gc.collect()
        many, _ = tracemalloc.get_traced_memory()
        frames.close()
        del frames
        gc.collect()
        left, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert many < few + 4_000_000  # of 20 million in 400 frames
    assert left < 50_000


def test_progress_is_told_and_may_cancel():
    told = []

    def progress(fraction, message):
        told.append((fraction, message))
        return len(told) < 1000 and fraction < 0.55

    frames = core.advect_noise(rotation(SIZE), frames=10, progress=progress)
    seen = []
    with pytest.raises(core.Cancelled):
        for frame in frames:
            seen.append(frame)
    assert 4 <= len(seen) <= 6
    fractions = [fraction for fraction, _ in told]
    assert fractions == sorted(fractions)
    assert {message for _, message in told} == {"Advecting noise"}


@pytest.mark.parametrize("velocity", [
    np.zeros((20, 30, 2)),
    np.full((20, 30, 2), np.nan),
    np.ones((1, 1, 2)),
    np.full((20, 30, 2), 1e-40),
    np.full((20, 30, 2), 1e30),
    np.ones((20, 30, 2), dtype=int),
])  # fmt: skip
@pytest.mark.parametrize("step", [0.5, 1000.0])
def test_odd_fields_give_sound_frames(velocity, step):
    settings = core.NoiseSettings(step=step, convolution=6, speed_mask=3.0, noise_mask=3.0)
    for frame in core.advect_noise(velocity, settings, frames=3, size=(9, 1)):
        assert np.isfinite(frame).all()
        assert frame.min() >= 0.0 and frame.max() <= 1.0


def test_a_mask_over_all_leaves_the_background():
    (frame,) = core.advect_noise(rotation(SIZE), frames=1, mask=np.zeros(SIZE))
    assert (frame == 0).all()


@pytest.mark.parametrize("words, message", [
    ({"velocity": np.ones((4, 4))}, "shape"),
    ({"velocity": np.ones((4, 4, 3))}, "shape"),
    ({"velocity": np.ones((0, 4, 2))}, "shape"),
    ({"velocity": np.full((4, 4, 2), np.inf)}, "infinity"),
    ({"velocity": np.full((4, 4, 2), "a")}, "type"),
    ({"velocity": [[1.0], [1.0, 2.0]]}, "velocity"),
    ({"velocity": np.full((4, 4, 2), 2000.0), "settings": core.NoiseSettings(step=0)}, "pixels a"),
    ({"mask": np.ones((3, 3))}, "mask"),
    ({"mask": np.full((4, 4), np.nan)}, "mask"),
    ({"frames": 0}, "frames"),
    ({"frames": 2.5}, "frames"),
    ({"frames": True}, "frames"),
    ({"size": (0, 4)}, "size"),
    ({"size": 4}, "size"),
    ({"background": np.ones((3, 3))}, "background"),
    ({"background": np.full((4, 4), np.nan)}, "background"),
    ({"colors": np.ones((4, 4))}, "color map"),
    ({"frames": 4, "settings": core.NoiseSettings(loop=5)}, "loop"),
])  # fmt: skip
def test_bad_input_is_named_at_once(words, message):
    given = {"velocity": np.ones((4, 4, 2))} | words
    with pytest.raises(core.ShockError, match=message):
        core.advect_noise(**given)


def test_functions_must_keep_their_shape():
    frames = core.advect_noise(lambda t: np.ones((4, 4, 2)) if t != 0.4 else np.ones((3, 4, 2)),
                               frames=11)  # fmt: skip
    with pytest.raises(core.InvalidSignal, match="shape"):
        list(frames)


def test_frames_of_the_papers_cylinder():
    velocity = np.full((5, 5, 2), [9.9, 0.0])
    assert [
        core.flow_frames(velocity, columns=n, width=8.0, duration=4.0, step=6.0)
        for n in (300, 600, 900)
    ] == [248, 495, 743]
    assert core.flow_frames(np.zeros((5, 5, 2)), columns=300, width=8.0, duration=4.0) == 1
    with pytest.raises(core.InvalidSettings, match="width"):
        core.flow_frames(velocity, columns=300, width=0.0, duration=4.0)


@pytest.mark.parametrize("spread", [0.05, 0.2, 1.0])
def test_as_many_cells_are_new_as_the_flow_spreads_over(spread):
    # Where a flow spreads, its cells come from fewer ones: 1 - 1 / (1 + spread) of them are copies,
    # and half of the noise that takes their place has the same value by chance.
    x = np.linspace(-spread * 16, spread * 16, 33)
    velocity = np.stack([np.tile(x, (33, 1)), np.zeros((33, 33))], axis=-1)
    chosen = core.NoiseSettings(step=0.0, injection=0.0, divergence=1.0)
    flow = Flow(velocity, None, None, 0.0)
    noise = Noise(flow.size, flow.longest, chosen)
    noise.step(flow.at(0), 0)
    shares = noise._rates[8:-8, 8:-8] / SHARES
    assert shares == pytest.approx(0.5 * spread / (1.0 + spread), abs=1e-3)


def test_steps_across_and_down_are_taken_independently():
    # At half a cell a frame each way, each of four steps is taken as often.
    cells = cells_of(uniform(SIZE, 0.5, 0.5), 64, periodic="both", **BARE)
    steps = [(-up, right) for up in (0, 1) for right in (0, 1)]
    taken = [
        [(np.roll(before, step, axis=(0, 1)) == after).all() for step in steps]
        for before, after in itertools.pairwise(cells)
    ]
    assert (np.sum(taken, axis=1) == 1).all()
    assert np.sum(taken, axis=0) == pytest.approx([16] * 4, abs=3)


def test_places_count_as_defined_where_at_least_half_of_what_they_read_is():
    velocity = np.full((2, 2, 2), [1.0, 0.5])
    velocity[:, 1] = np.nan
    for columns in (8, 9):
        motion = Flow(velocity, (4, columns), None, 0.0).at(0)
        assert motion.defined[0].tolist() == [(j + 0.5) / columns <= 0.5 for j in range(columns)]
        assert (motion.right[motion.defined] == 1.0).all()
        assert (motion.right[~motion.defined] == 0.0).all()


def test_between_the_moments_that_are_asked_for_no_step_is_longer_than_the_longest():
    def velocity(moment):
        return np.full((4, 4, 2), [3.0, 4.0]) * (1.0 if moment * 32 % 1 == 0 else 10.0)

    flow = Flow(velocity, None, None, 0.0, frames=65)
    assert flow.longest == 5.0
    for frame in (0, 1, 2, 3):
        motion = flow.at(frame)
        assert motion.right == pytest.approx(np.full((4, 4), 3.0))
        assert motion.down == pytest.approx(np.full((4, 4), -4.0))
