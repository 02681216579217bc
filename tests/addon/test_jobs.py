# SPDX-License-Identifier: GPL-3.0-or-later
"""The modal run, driven by hand: the bpy module has no window that could send events."""

import threading
import time
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from shock_filter.core import Cancelled, GeometrySettings
from shock_filter.shock_addon import jobs, operators
from shock_filter.shock_addon.geometry_data import read_geometry, write_geometry
from shock_filter.shock_addon.mesh_data import read_positions, read_targets, write_positions
from shock_filter.shock_addon.sharpening import sharpen

ESC = SimpleNamespace(type="ESC", value="PRESS")
TIMER = SimpleNamespace(type="TIMER", value="NOTHING")
CLICK = SimpleNamespace(type="LEFTMOUSE", value="PRESS")
PARAMETERS = SimpleNamespace(vertex_group="", invert_mask=False, selected_only=True, output="MESH")


class Manager:
    """A window manager that counts what it is asked for."""

    def __init__(self):
        self.windows = []
        self.timers, self.handlers = [], []
        self.progress = None

    def event_timer_add(self, interval, window):
        self.timers.append(interval)
        return interval

    def event_timer_remove(self, timer):
        self.timers.remove(timer)

    def modal_handler_add(self, operator):
        self.handlers.append(operator)

    def progress_begin(self, low, high):
        self.progress = low

    def progress_update(self, value):
        self.progress = value

    def progress_end(self):
        self.progress = None


class Context(SimpleNamespace):
    """A window's context, as far as a modal run looks at it."""

    def __init__(self):
        self.status = []
        super().__init__(
            window=None,
            window_manager=Manager(),
            workspace=SimpleNamespace(status_text_set=self.status.append),
            object=bpy.context.object,
        )


class Operator(jobs.ModalJob):
    """Keeps what the work returned."""

    def __init__(self):
        self.outcome, self.reports = None, []

    def report(self, kind, text):
        self.reports.append((kind, text))

    def finish(self, context, compute):
        self.outcome = compute()
        return {"FINISHED"}


def waiting_work(progress):
    """Wait until cancelled."""
    while progress(0.25, "Waiting"):
        time.sleep(0.005)
    raise Cancelled("The run was cancelled; nothing was changed.")


def run_to_the_end(operator, context):
    for _ in range(500):
        answer = operator.modal(context, TIMER)
        if answer != {"PASS_THROUGH"}:
            return answer
        time.sleep(0.01)
    raise AssertionError("The run did not end.")


def test_a_run_ends_with_its_result_on_the_calling_thread():
    operator, context = Operator(), Context()
    threads = []

    def work(progress):
        threads.append(threading.current_thread())
        progress(0.5, "Working")
        return 42

    assert operator.start(context, work) == {"RUNNING_MODAL"}
    assert jobs.current() is not None
    assert run_to_the_end(operator, context) == {"FINISHED"}
    assert operator.outcome == 42
    assert threads[0] is not threading.current_thread()
    assert jobs.current() is None
    assert context.window_manager.timers == []
    assert context.window_manager.progress is None


def test_progress_is_shown_and_clicks_are_held_back():
    operator, context = Operator(), Context()
    operator.start(context, waiting_work)
    time.sleep(0.05)
    assert operator.modal(context, TIMER) == {"PASS_THROUGH"}
    assert operator.modal(context, CLICK) == {"RUNNING_MODAL"}
    assert context.window_manager.progress == 0.25
    assert context.status[-1] == "Waiting: 25% (Esc cancels)"
    assert operator.modal(context, ESC) == {"CANCELLED"}
    assert context.status[-1] is None


def test_esc_answers_at_once_and_stops_the_thread():
    operator, context = Operator(), Context()
    operator.start(context, waiting_work)
    job = operator._job
    began = time.perf_counter()
    assert operator.modal(context, ESC) == {"CANCELLED"}
    assert time.perf_counter() - began < 0.05
    assert operator.reports == [({"INFO"}, "Cancelled; nothing was changed.")]
    assert context.window_manager.timers == []
    job.wait()
    with pytest.raises(Cancelled):
        job.result()
    assert operator.outcome is None


def test_what_the_work_raises_reaches_finish():
    operator, context = Operator(), Context()

    def work(progress):
        raise ZeroDivisionError("a bug")

    operator.start(context, work)
    with pytest.raises(ZeroDivisionError):
        run_to_the_end(operator, context)
    assert jobs.current() is None
    assert context.window_manager.timers == []


def test_stop_all_waits_for_the_threads(monkeypatch):
    operator, context = Operator(), Context()
    monkeypatch.setattr(jobs, "bpy", SimpleNamespace(context=context))
    operator.start(context, waiting_work)
    job = operator._job
    jobs.stop_all()
    assert job.done
    assert jobs.current() is None
    assert context.window_manager.timers == []


def test_a_second_run_is_refused_meanwhile(rounded_box):
    rounded_box()
    operator, context = Operator(), Context()
    operator.start(context, waiting_work)
    assert not bpy.ops.shock_filter.sharpen_geometry.poll()
    operator.modal(context, ESC)
    assert bpy.ops.shock_filter.sharpen_geometry.poll()


@pytest.fixture
def target(rounded_box):
    box = rounded_box()
    (target,), _ = read_targets(bpy.context, read_geometry, PARAMETERS)
    return box, target


def sharpened(*targets, progress=lambda fraction, message: True):
    def function(surface, part):
        return sharpen(surface, GeometrySettings(), True, part)

    return operators.filter_targets(targets, function, None, progress)


def written(target, results):
    return operators.write_results([target], results, write_geometry)


def test_cancelling_the_filter_leaves_the_mesh_alone(target):
    box, read = target
    before = read_positions(box.data)
    cancelled = threading.Event()

    def work(progress):
        cancelled.wait(60)
        return sharpened(read, progress=progress)

    job = jobs.Job(work)
    job.cancel()
    cancelled.set()
    with pytest.raises(Cancelled):
        job.result()
    np.testing.assert_array_equal(read_positions(box.data), before)


def test_progress_stays_in_range_and_ends_at_one(target):
    _, read = target
    seen = []
    sharpened(read, read, progress=lambda *now: seen.append(now) or True)
    fractions = [fraction for fraction, _ in seen]
    assert min(fractions) >= 0.0
    assert max(fractions) <= 1.0
    assert fractions[-1] == pytest.approx(1.0)


def test_the_bar_never_goes_back():
    shown = []

    def work(progress):
        for fraction in (0.2, 0.6, 0.5, 0.9):
            progress(fraction, "Working")
            shown.append(job_box[0].fraction)

    job_box = []
    gate = threading.Event()
    job_box.append(jobs.Job(lambda progress: gate.wait() and work(progress)))
    gate.set()
    job_box[0].wait()
    assert shown == [0.2, 0.6, 0.6, 0.9]


def test_an_object_that_was_removed_meanwhile_is_skipped(target):
    box, read = target
    results = sharpened(read)
    bpy.data.objects.remove(box)
    done, skipped = written(read, results)
    assert done == []
    assert skipped == ["Skipped Cube: it was removed meanwhile."]


def test_an_object_that_was_changed_meanwhile_is_skipped(target):
    box, read = target
    results = sharpened(read)
    changed = read_positions(box.data) + np.float32(1)
    write_positions(box.data, changed)
    done, skipped = written(read, results)
    assert done == []
    assert skipped == ["Skipped Cube: it was changed meanwhile; run again."]
    np.testing.assert_array_equal(read_positions(box.data), changed)


def test_an_object_with_more_vertices_is_skipped(target):
    box, read = target
    results = sharpened(read)
    box.data.vertices.add(1)
    assert written(read, results)[0] == []


def test_an_object_with_another_mesh_is_skipped(target):
    box, read = target
    results = sharpened(read)
    other = box.data.copy()
    before = read_positions(other)
    box.data = other
    assert written(read, results)[0] == []
    np.testing.assert_array_equal(read_positions(other), before)
