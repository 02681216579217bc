# SPDX-License-Identifier: GPL-3.0-or-later
"""The modal run, driven by hand: the bpy module has no window that could send events."""

import threading
import time
from contextlib import contextmanager
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from shock_filter.core import Cancelled, GeometrySettings
from shock_filter.shock_addon import data
from shock_filter.shock_addon.data.mesh.geometry import read_geometry, write_geometry
from shock_filter.shock_addon.data.mesh.meshes import read_positions, read_targets, write_positions
from shock_filter.shock_addon.kinds import DATA, Data
from shock_filter.shock_addon.modes import find
from shock_filter.shock_addon.operators import base as operators
from shock_filter.shock_addon.running import jobs
from shock_filter.shock_addon.running import status as status_text

ESC = SimpleNamespace(type="ESC", value="PRESS", mouse_x=0, mouse_y=0)
TIMER = SimpleNamespace(type="TIMER", value="NOTHING", mouse_x=0, mouse_y=0)
PARAMETERS = SimpleNamespace(vertex_group="", invert_mask=False, selected_only=True, output="MESH",
                             custom_normals="KEEP", mark_sharp=False)  # fmt: skip


def press(kind, x=0, y=0):
    return SimpleNamespace(type=kind, value="PRESS", mouse_x=x, mouse_y=y)


class Workspace:
    """Keeps what its status bar says; as Blender's, it sets that of the context's workspace."""

    def __init__(self, uid, context):
        self.session_uid, self._context = uid, context
        self.status = None

    def status_text_set(self, text):
        self._context.workspace.status = text


class Window:
    """A window with a sidebar at its right."""

    def __init__(self, uid, workspace):
        self.uid, self.workspace = uid, workspace
        self.redraws = 0
        sidebar = SimpleNamespace(
            type="UI", x=800, y=0, width=200, height=500, tag_redraw=self._redraw
        )
        area = SimpleNamespace(type="VIEW_3D", regions=[sidebar])
        self.screen = SimpleNamespace(areas=[area])

    def _redraw(self):
        self.redraws += 1

    def as_pointer(self):
        return self.uid


class Manager:
    """A window manager that counts what it is asked for."""

    def __init__(self, windows):
        self.windows = windows
        self.timers, self.handlers = [], []

    def event_timer_add(self, interval, window):
        assert window in self.windows
        self.timers.append((interval, window))
        return self.timers[-1]

    def event_timer_remove(self, timer):
        self.timers.remove(timer)

    def modal_handler_add(self, operator):
        self.handlers.append(operator)


class Context(SimpleNamespace):
    """A window's context, as far as a modal run looks at it; two windows are open."""

    def __init__(self):
        self.workspaces = [Workspace(uid, self) for uid in range(3)]
        windows = [Window(uid, self.workspaces[uid]) for uid in range(2)]
        super().__init__(
            window=windows[0],
            workspace=windows[0].workspace,
            window_manager=Manager(windows),
            object=bpy.context.object,
        )

    @contextmanager
    def temp_override(self, window=None, workspace=None):
        before = self.workspace
        self.workspace = workspace if window is None else window.workspace  # as Blender does
        yield
        self.workspace = before

    def is_clean(self):
        return not self.window_manager.timers and not any(w.status for w in self.workspaces)


class Blender(SimpleNamespace):
    """What a modal run asks of the bpy module."""

    types = bpy.types

    def __init__(self, context):
        self.jobs, self.timers = set(), []
        app = SimpleNamespace(
            is_job_running=lambda kind: kind in self.jobs,
            timers=SimpleNamespace(register=lambda function, **_: self.timers.append(function)),
        )
        data = SimpleNamespace(workspaces=context.workspaces)
        super().__init__(app=app, context=context, data=data)


@pytest.fixture
def context(monkeypatch):
    """A window; nothing may be left behind in it."""
    context = Context()
    context.blender = Blender(context)
    monkeypatch.setattr(jobs, "bpy", context.blender)
    monkeypatch.setattr(jobs, "_CALM", 0.0)
    monkeypatch.setattr(status_text, "bpy", context.blender)
    yield context
    assert context.is_clean()
    assert jobs.current() is None


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


def test_a_run_ends_with_its_result_on_the_calling_thread(context):
    operator = Operator()
    threads = []

    def work(progress):
        threads.append(threading.current_thread())
        progress(0.5, "Working")
        return 42

    assert operator.run_job(context, work) == {"RUNNING_MODAL"}
    assert context.window_manager.handlers == [operator]
    assert jobs.current() is not None
    assert run_to_the_end(operator, context) == {"FINISHED"}
    assert operator.outcome == 42
    assert threads[0] is not threading.current_thread()


def wait_for(condition):
    for _ in range(1000):
        if condition():
            return
        time.sleep(0.005)
    raise AssertionError("It did not come.")


def test_progress_is_shown_in_all_windows(context):
    operator = Operator()
    operator.run_job(context, waiting_work)
    wait_for(lambda: jobs.current().fraction > 0)
    assert operator.modal(context, TIMER) == {"PASS_THROUGH"}
    shown = [workspace.status for workspace in context.workspaces]
    assert shown == ["Waiting: 25% (Esc cancels)"] * 2 + [None]
    redraws = [window.redraws for window in context.window_manager.windows]
    operator.modal(context, TIMER)
    assert [window.redraws for window in context.window_manager.windows] == redraws
    assert min(redraws) > 0
    assert operator.modal(context, ESC) == {"CANCELLED"}


def test_keys_and_clicks_are_held_back_but_not_in_the_sidebar(context):
    operator = Operator()
    operator.run_job(context, waiting_work)
    for held in (press("Z"), press("LEFTMOUSE"), press("RIGHTMOUSE", 900, 100), press("F3")):
        assert operator.modal(context, held) == {"RUNNING_MODAL"}
    for passed in (press("LEFTMOUSE", 900, 100), press("MIDDLEMOUSE"), press("WHEELUPMOUSE")):
        assert operator.modal(context, passed) == {"PASS_THROUGH"}
    released = SimpleNamespace(type="LEFTMOUSE", value="RELEASE", mouse_x=0, mouse_y=0)
    assert operator.modal(context, released) == {"PASS_THROUGH"}  # a slider would go on else
    playback = SimpleNamespace(type="TIMER0", value="NOTHING", mouse_x=0, mouse_y=0)
    assert operator.modal(context, playback) == {"PASS_THROUGH"}
    operator.modal(context, ESC)


def test_keys_pass_beside_an_auto_update_whose_result_waits_for_what_they_do(context):
    operator = Operator()
    operator.run_job(context, lambda progress: 42)
    job = jobs.current()
    job.keys_pass, job.is_welcome = True, lambda: False
    for held in (press("LEFTMOUSE"), press("RIGHTMOUSE"), press("PEN")):
        assert operator.modal(context, held) == {"RUNNING_MODAL"}
    for passed in (press("G"), press("F3"), press("LEFTMOUSE", 900, 100)):
        assert operator.modal(context, passed) == {"PASS_THROUGH"}
    job.wait()
    assert operator.modal(context, TIMER) == {"PASS_THROUGH"} and operator.outcome is None
    assert "render" not in (context.window.workspace.status or "")
    job.is_welcome = lambda: True
    assert operator.modal(context, TIMER) == {"FINISHED"}
    assert operator.outcome == 42


def test_a_drag_makes_the_artist_busy_and_a_run_does_not(context):
    operator = Operator()
    operator.bl_idname = "SHOCK_FILTER_OT_sharpen_geometry"
    operator.run_job(context, waiting_work)
    windows = context.window_manager.windows
    for window in windows:
        window.screen.is_animation_playing = False
    windows[0].modal_operators = [SimpleNamespace(bl_idname=operator.bl_idname)]
    assert not jobs.is_artist_busy(60.0)
    windows[1].modal_operators = [SimpleNamespace(bl_idname="TRANSFORM_OT_translate")]
    assert jobs.is_artist_busy(60.0)
    windows[1].modal_operators = []
    windows[1].screen.is_animation_playing = True
    assert jobs.is_artist_busy(60.0)
    operator.cancel(context)


class EXAMPLE_OT_stays(bpy.types.Operator):
    """One of another add-on, which some keep under way as long as Blender is."""

    bl_idname = "example.stays"
    bl_label = "Stays"


def test_an_operator_of_another_addon_is_waited_for_only_for_a_while(context):
    windows = context.window_manager.windows
    for window in windows:
        window.screen.is_animation_playing = False
    bpy.utils.register_class(EXAMPLE_OT_stays)
    try:
        windows[0].modal_operators = [SimpleNamespace(bl_idname="EXAMPLE_OT_stays")]
        assert jobs.is_artist_busy(1.0)
        assert not jobs.is_artist_busy(60.0)
        own = ("SHOCK_FILTER_OT_preview", "VIEW3D_OT_edit_mesh_extrude_move_normal")
        for name in ("TRANSFORM_OT_translate", "SCULPT_OT_brush_stroke", *own):
            windows[1].modal_operators = [SimpleNamespace(bl_idname=name)]
            assert jobs.is_artist_busy(60.0)
    finally:
        bpy.utils.unregister_class(EXAMPLE_OT_stays)


def test_esc_answers_at_once_and_stops_the_thread(context):
    may_end = threading.Event()

    def work(progress):
        may_end.wait(60)
        waiting_work(progress)

    operator = Operator()
    operator.run_job(context, work)
    job = operator._wait.job
    assert operator.modal(context, ESC) == {"CANCELLED"}
    assert not job.done
    assert operator.reports == [({"INFO"}, "Cancelled; nothing was changed.")]
    assert context.is_clean()
    may_end.set()
    job.wait()
    with pytest.raises(Cancelled):
        job.result()
    assert operator.outcome is None


def test_the_cancel_operator_ends_the_run_at_the_next_tick(context):
    assert not bpy.ops.shock_filter.cancel.poll()
    operator = Operator()
    operator.run_job(context, waiting_work)
    assert bpy.ops.shock_filter.cancel() == {"FINISHED"}
    assert operator.modal(context, TIMER) == {"CANCELLED"}
    assert operator.outcome is None
    assert not bpy.ops.shock_filter.cancel.poll()


def test_a_cancelled_run_is_dropped_even_if_its_work_has_ended(context):
    operator = Operator()
    operator.run_job(context, lambda progress: 42)
    jobs.current().wait()
    jobs.current().cancel()
    assert operator.modal(context, TIMER) == {"CANCELLED"}
    assert operator.outcome is None


def test_the_status_bar_is_cleared_in_a_workspace_that_was_left(context):
    operator = Operator()
    operator.run_job(context, waiting_work)
    operator.modal(context, TIMER)
    context.window.workspace = context.workspaces[2]
    wait_for(lambda: jobs.current().fraction > 0)
    operator.modal(context, TIMER)
    assert context.workspaces[2].status
    operator.modal(context, ESC)
    assert context.is_clean()


def test_a_window_that_closes_ends_its_run(context):
    operator = Operator()
    operator.run_job(context, waiting_work)
    job = operator._wait.job
    operator.cancel(context)  # so does Blender, then and before a file is loaded
    operator.cancel(context)
    job.wait()
    assert context.is_clean()


def test_what_the_work_raises_reaches_finish(context):
    operator = Operator()

    def work(progress):
        raise ZeroDivisionError("a bug")

    operator.run_job(context, work)
    with pytest.raises(ZeroDivisionError):
        run_to_the_end(operator, context)
    assert jobs.current() is None


def test_an_error_while_waiting_ends_the_run(context, monkeypatch):
    def broken(wait, context):
        raise ZeroDivisionError("a bug")

    operator = Operator()
    operator.run_job(context, waiting_work)
    job = jobs.current()
    with monkeypatch.context() as patch:
        patch.setattr(jobs._Wait, "show", broken)
        with pytest.raises(ZeroDivisionError):  # Blender shows it, and ends the operator
            operator.modal(context, TIMER)
    assert jobs.current() is None
    job.wait()
    assert operator.modal(context, TIMER) == {"CANCELLED"}


class Freed(Operator):
    """Like an operator that Blender has freed, once it is."""

    freed = False

    def __getattribute__(self, name):
        if object.__getattribute__(self, "__dict__").get("freed"):
            raise ReferenceError("StructRNA of type SHOCK_FILTER_OT_x has been removed")
        return object.__getattribute__(self, name)


def test_an_operator_that_blender_has_freed_stands_in_nobodys_way(context):
    freed = Freed()
    freed.run_job(context, waiting_work)
    job = jobs.current()
    freed.freed = True
    assert jobs.current() is None
    again = Operator()
    again.run_job(context, waiting_work)
    job.wait()
    assert len(context.window_manager.timers) == 1
    again.modal(context, ESC)


def test_stop_all_ends_the_run_of_an_operator_that_blender_has_freed(context):
    freed = Freed()
    freed.run_job(context, waiting_work)
    job = jobs.current()
    freed.freed = True
    jobs.stop_all()
    assert job.done
    for function in context.blender.timers:
        function()


@pytest.mark.parametrize("kind", ["RENDER", "OBJECT_BAKE"])
def test_nothing_is_written_while_a_render_reads_the_scene(context, kind, rounded_box):
    rounded_box()
    context.blender.jobs.add(kind)
    assert not bpy.ops.shock_filter.sharpen_geometry.poll()
    context.blender.jobs.clear()
    assert bpy.ops.shock_filter.sharpen_geometry.poll()
    operator = Operator()
    operator.run_job(context, lambda progress: 42)
    jobs.current().wait()
    context.blender.jobs.add(kind)
    assert operator.modal(context, TIMER) == {"PASS_THROUGH"}
    assert operator.outcome is None
    assert "render" in context.window.workspace.status
    context.blender.jobs.clear()
    assert operator.modal(context, TIMER) == {"FINISHED"}


def test_blender_knows_the_jobs_that_are_asked_for():
    assert not any(bpy.app.is_job_running(kind) for kind in jobs._READ_BY_OTHERS)


def test_stop_all_ends_runs_and_their_threads(context):
    operator = Operator()
    operator.run_job(context, waiting_work)
    job = operator._wait.job
    jobs.stop_all()
    assert job.done
    assert operator.modal(context, TIMER) == {"CANCELLED"}
    assert jobs.current() is None

    # Blender's handler is gone only after the next event.
    again = Operator()
    assert len(context.window_manager.timers) == 2  # each window gets events
    assert again.run_job(context, waiting_work) == {"CANCELLED"}
    assert again.reports == [({"WARNING"}, "The last run is still being put away; run again.")]
    context.window_manager.windows.pop()  # with its timers
    context.window_manager.timers.pop()
    for function in context.blender.timers:
        assert function() is None
    assert context.is_clean()
    assert again.run_job(context, waiting_work) == {"RUNNING_MODAL"}
    again.modal(context, ESC)


def test_stop_all_leaves_no_timer_behind_without_a_run(context):
    jobs.stop_all()
    assert context.blender.timers == []


def test_a_second_run_is_refused_meanwhile(rounded_box, context):
    rounded_box()
    operator = Operator()
    operator.run_job(context, waiting_work)
    assert not bpy.ops.shock_filter.sharpen_geometry.poll()
    operator.modal(context, ESC)
    assert bpy.ops.shock_filter.sharpen_geometry.poll()


@pytest.mark.parametrize(
    ("kind", "words", "reason"),
    [(ZeroDivisionError, ["a bug"], "a bug"), (MemoryError, [], "MemoryError")],
)
def test_an_unexpected_error_ends_the_run_with_a_sentence(
    rounded_box, monkeypatch, caplog, kind, words, reason
):
    box = rounded_box()
    before = read_positions(box.data)

    def broken(*arguments, **settings):
        raise kind(*words)

    monkeypatch.setattr("shock_filter.core.shape.sharpening.sharpen_geometry", broken)
    with pytest.raises(RuntimeError, match=f"Sharpen Geometry failed: {reason}; the console has"):
        bpy.ops.shock_filter.sharpen_geometry()
    np.testing.assert_array_equal(read_positions(box.data), before)
    (record,) = caplog.records
    assert record.exc_info[0] is kind


def test_an_unexpected_error_while_reading_changes_nothing(rounded_box, monkeypatch, caplog):
    box = rounded_box()
    before = read_positions(box.data)

    def broken(*arguments, **settings):
        raise MemoryError

    monkeypatch.setattr(data.mesh.geometry, "read_geometry", broken)
    with pytest.raises(RuntimeError, match="Sharpen Geometry failed: MemoryError; the console"):
        bpy.ops.shock_filter.sharpen_geometry()
    np.testing.assert_array_equal(read_positions(box.data), before)
    assert len(caplog.records) == 1


def test_an_unexpected_error_while_writing_can_be_undone(rounded_box, select, monkeypatch, caplog):
    names = [rounded_box().name, rounded_box(location=(5.0, 0.0, 0.0)).name]

    def positions():
        return [read_positions(bpy.data.objects[name].data) for name in names]

    def changed():
        return [(now != then).any() for now, then in zip(positions(), before, strict=True)]

    def broken(target, result, key_name):
        if target.name == names[1]:
            raise MemoryError
        return write_geometry(target, result, key_name)

    select(*(bpy.data.objects[name] for name in names))
    bpy.ops.ed.undo_push(message="Start")
    before = positions()
    monkeypatch.setattr(data.mesh.geometry, "write_geometry", broken)
    with pytest.raises(RuntimeError, match="failed while writing: MemoryError; undo it, and see"):
        bpy.ops.shock_filter.sharpen_geometry("EXEC_DEFAULT", True)
    assert changed() == [True, False]
    assert len(caplog.records) == 1
    bpy.ops.ed.undo_push(message="Later")
    bpy.ops.ed.undo()
    assert changed() == [True, False]
    bpy.ops.ed.undo()
    assert changed() == [False, False]


class Sharpening(operators.FilterOperator):
    """As much of an operator as a modal run needs."""

    bl_label, row = "Sharpen", find("geometry")
    reports = []

    def __init__(self):
        self.targets = ["much"]

    def report(self, kind, text):
        self.reports.append(text)


def test_a_run_that_ends_lets_go_of_what_it_has_read(context, monkeypatch):
    monkeypatch.setattr(operators, "summaries", {})
    cancelled, failed = Sharpening(), Sharpening()
    cancelled.run_job(context, waiting_work)
    assert cancelled.modal(context, ESC) == {"CANCELLED"}
    failed.run_job(context, lambda progress: 1 / 0)
    assert run_to_the_end(failed, context) == {"CANCELLED"}
    assert vars(cancelled) == vars(failed) == {}
    cancelled.cancel(context)  # so does Blender when a window closes


@pytest.fixture
def target(rounded_box):
    box = rounded_box()
    (target,), _ = read_targets(bpy.context, read_geometry, PARAMETERS)
    return box, target


def sharpened(*targets, progress=lambda fraction, message: True):
    kind, settings = DATA["geometry"], GeometrySettings()
    return operators.Task(targets, kind, "sharpen_geometry", settings, True, []).run(progress)


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


def test_progress_counts_targets_by_their_size():
    targets = [SimpleNamespace(name="", surface=SimpleNamespace(size=size)) for size in (10, 30)]
    seen = []

    def halfway(surface, name, settings, weld, progress):
        progress(0.5, "Half")
        progress(1.0, "All")

    task = operators.Task(targets, Data("meshes", (), halfway), "", None, True, [])
    task.run(lambda *now: seen.append(now) or True)
    steps = [fraction for fraction, message in seen if message in {"Half", "All"}]
    assert steps == pytest.approx([0.125, 0.25, 0.625, 1.0])


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


def test_a_quiet_run_is_shown_later(context, monkeypatch):
    operator = Operator()
    operator.run_job(context, waiting_work)
    job = jobs.current()
    job.quiet_until = time.monotonic() + 60.0
    operator.modal(context, TIMER)
    assert jobs.shown() is None and not context.window.workspace.status
    job.quiet_until = 0.0
    operator.modal(context, TIMER)
    assert jobs.shown() is job and context.window.workspace.status
    operator.cancel(context)
