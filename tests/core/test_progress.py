# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress without a parameter that all hand on: phases, canceling, threads."""

import contextvars
import threading

import numpy as np
import pytest
from shapes import soft_cube
from shock_filter import core
from shock_filter.core.base import parallel, progress
from shock_filter.core.base.progress import aside, ask, phase, reporting


@pytest.fixture
def told():
    """Return the (fraction, message) that a callback was told; its `tell` is the callback."""

    class Told(list):
        def tell(self, fraction, message):
            self.append((fraction, message))
            return True

    return Told()


def test_what_cannot_be_called_is_no_progress():
    for wrong in ("progress", 0, []):
        with pytest.raises(core.InvalidSettings, match="give a function"), reporting(wrong):
            pass


def test_phases_nest(told):
    with reporting(told.tell), phase(0.5, 1.0, "Second half"):
        ask(0.2)
        with phase(0.5, 1.0, "Last quarter"):
            ask(0.4)
        ask(0.9)
    assert [message for _, message in told] == [
        "Second half", "Second half", "Last quarter", "Last quarter", "Second half", ""
    ]  # fmt: skip
    assert np.allclose([fraction for fraction, _ in told], [0.5, 0.6, 0.75, 0.85, 0.95, 1.0])


def test_fractions_never_fall(told):
    with reporting(told.tell):
        with phase(0.4, 0.6, "First"):
            ask(0.5)
            ask(0.1)
        with phase(0.0, 0.3, "Behind"):
            ask(1.0)
    assert [fraction for fraction, _ in told] == [0.4, 0.5, 0.5, 0.5, 0.5, 1.0]


def test_the_bar_rests_in_an_aside(told):
    with reporting(told.tell), phase(0.2, 0.4, "Main"):
        ask(0.5)
        with aside("Preparing"), phase(0.0, 1.0, "Deeper"):
            parallel.run(lambda a, b: None, 10, chunk=1)
    fractions = {fraction for fraction, message in told if message in {"Preparing", "Deeper"}}
    assert len(fractions) == 1
    assert fractions.pop() == pytest.approx(0.3)


def test_runs_and_blocks_fill_the_phase_that_they_stand_in(told, monkeypatch):
    monkeypatch.setattr(parallel, "most_threads", 1)  # others might run all chunks
    with reporting(told.tell):
        with phase(0.2, 0.4, "In chunks"):
            parallel.run(lambda a, b: None, 100, chunk=1)
        with phase(0.4, 0.6, "In order"):
            parallel.run_in_order(lambda a, b: None, 100, chunk=1)
        with phase(0.6, 0.8, "In blocks"):
            assert sum(part.stop - part.start for part in parallel.blocks(100, 7)) == 100
    for start, message in [(0.2, "In chunks"), (0.4, "In order"), (0.6, "In blocks")]:
        here = [fraction for fraction, said in told if said == message]
        assert len(here) > 10
        assert here == sorted(here)
        assert here[0] == pytest.approx(start)
        assert start + 0.18 <= here[-1] <= start + 0.2 + 1e-12


def test_nobody_is_asked_outside_of_a_report(told):
    with reporting(told.tell):
        pass
    told.clear()
    with phase(0.0, 1.0, "Alone"):
        ask(0.5)
    assert told == []


def test_a_function_without_a_callback_reports_to_its_callers(told):
    with reporting(told.tell), phase(0.5, 1.0, "Outer"), reporting(None), phase(0.0, 0.5, "Inner"):
        ask(1.0)
    assert (0.75, "Inner") in told


def test_a_callback_of_its_own_takes_a_function_out_of_its_callers_report(told):
    inner = []
    with reporting(told.tell), phase(0.5, 1.0, "Outer"):
        with reporting(lambda fraction, message: inner.append(fraction)):
            ask(0.25)
        ask(0.5)
    assert inner == [0.25, 1.0]
    assert (0.25, "") not in told
    assert (0.75, "Outer") in told


@pytest.mark.parametrize("answer", [False, np.False_, 0])
def test_the_callback_cancels(answer):
    reached = []

    def work():
        with phase(0.0, 1.0, "Work"):
            reached.append("inside")

    with pytest.raises(core.Cancelled), reporting(lambda fraction, message: answer):
        work()
    assert reached == []


def test_a_cancelled_block_leaves_no_report_behind(told):
    with pytest.raises(core.Cancelled), reporting(lambda fraction, message: False):
        ask()
    with reporting(told.tell):
        with pytest.raises(ZeroDivisionError), phase(0.2, 0.3, "Failing"):
            raise ZeroDivisionError
        ask(0.5)
    assert told[-2:] == [(0.5, ""), (1.0, "")]


def test_canceling_stops_after_few_chunks():
    visited = []
    with pytest.raises(core.Cancelled), reporting(lambda fraction, message: len(visited) < 3):
        parallel.run_in_order(lambda a, b: visited.append(a), 10_000, chunk=1)
    assert len(visited) == 3


def test_a_callback_may_call_the_core(told):
    """What it runs is not told to itself, and its own reports work."""
    inner = []

    def tell(fraction, message):
        if len(told) < 3:
            core.sharpen_image(np.zeros((4, 4), dtype=np.float32))
            with reporting(lambda fraction, message: inner.append(fraction)):
                ask(0.5)
        return told.tell(fraction, message)

    with reporting(tell), phase(0.0, 0.5, "Outer"):
        ask(0.25)
        ask(0.5)
    assert told == [(0.0, "Outer"), (0.125, "Outer"), (0.25, "Outer"), (1.0, "")]
    assert inner == [0.5, 1.0] * 3


def test_only_the_calling_thread_reports(monkeypatch):
    monkeypatch.setattr(parallel, "thread_count", lambda: 4)
    workers, reporters = set(), set()
    together = threading.Barrier(2)  # two threads at least

    def work(start, stop):
        workers.add(threading.get_ident())
        ask(0.5)  # as a kernel's Python does; on a helper nobody hears it
        if start < 2:
            together.wait(timeout=10)

    def tell(fraction, message):
        reporters.add(threading.get_ident())
        return True

    with reporting(tell):
        parallel.run(work, 100, chunk=1)
    assert len(workers) >= 2
    assert reporters == {threading.get_ident()}


def test_two_threads_report_each_their_own_run():
    together = threading.Barrier(2)
    heard = {"one": [], "other": []}

    def work(name):
        def tell(fraction, message):
            heard[name].append(message)
            return True

        with reporting(tell), phase(0.0, 1.0, name):
            for _ in range(20):
                together.wait(timeout=10)
                ask(0.5)

    threads = [threading.Thread(target=work, args=(name,)) for name in heard]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {name: set(messages) for name, messages in heard.items()} == {
        "one": {"one", ""}, "other": {"other", ""}
    }  # fmt: skip
    assert all(len(messages) == 22 for messages in heard.values())


@pytest.mark.parametrize(
    "settings",
    [core.GeometrySettings(), core.GeometrySettings.of_paper()],
    ids=["default", "paper"],
)
def test_the_bar_of_a_filter_rises_to_its_end(told, settings):
    mesh = core.TriangleMesh(*soft_cube())
    core.sharpen_geometry(mesh, settings, progress=told.tell)
    fractions = [fraction for fraction, _ in told]
    assert fractions == sorted(fractions)
    assert fractions[0] < 0.1
    assert fractions[-1] == 1.0
    assert len(set(fractions)) > 10
    assert len({message for _, message in told}) >= 3


def test_nothing_is_left_in_the_context():
    context = contextvars.copy_context()

    def work():
        with reporting(lambda fraction, message: True), phase(0.0, 0.5, "Work"):
            ask(1.0)
        return progress._current.get()

    assert context.run(work) is None
