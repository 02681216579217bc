# SPDX-License-Identifier: GPL-3.0-or-later
import multiprocessing
import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest
from shapes import soft_cube
from shock_filter import core
from shock_filter.core.base import parallel
from shock_filter.core.base.progress import reporting


def test_every_index_is_visited_once():
    seen = np.zeros(10_007, dtype=int)

    def visit(start, stop, out):
        out[start:stop] += 1

    parallel.run(visit, len(seen), seen, chunk=100)
    assert (seen == 1).all()
    parallel.run(visit, 0, seen)
    assert (seen == 1).all()


def test_errors_of_kernels_reach_the_caller():
    def fail(start, stop):
        if start == 50:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        parallel.run(fail, 100, chunk=1)


def test_an_error_is_raised_only_when_all_threads_have_stopped(monkeypatch):
    """The caller owns the arrays again: nobody writes into them any more."""
    monkeypatch.setattr(parallel, "thread_count", lambda: 4)
    monkeypatch.setattr(parallel, "_pool", cache(lambda: ThreadPoolExecutor(3)))
    for failing in range(4):
        together = threading.Barrier(4)
        written = np.zeros(4)

        def work(start, stop, failing=failing, together=together, written=written):
            together.wait(timeout=10)  # each chunk has a thread of its own
            if start == failing:
                raise ZeroDivisionError
            time.sleep(0.05 * (start + 1))
            written[start] = 1.0

        with pytest.raises(ZeroDivisionError):
            parallel.run(work, 4, chunk=1)
        assert written.sum() == 3


def test_what_runs_beside_ends_when_the_run_is_cancelled():
    questions = []

    def work():
        for _ in range(2000):
            parallel.ask()
            time.sleep(0.005)
        return "to the end"

    def progress(fraction, message):
        questions.append(threading.current_thread())
        return len(questions) < 3

    with pytest.raises(core.Cancelled), reporting(progress), parallel.beside() as begin:
        future = begin(work)
    assert isinstance(future.exception(), core.Cancelled)
    assert set(questions) == {threading.current_thread()}


def test_leaving_waits_for_what_runs_beside():
    with parallel.beside() as begin:
        future = begin(time.sleep, 0.15)
    assert future.done()


def test_canceling_waits_for_all_threads(monkeypatch):
    monkeypatch.setattr(parallel, "thread_count", lambda: 4)
    monkeypatch.setattr(parallel, "_pool", cache(lambda: ThreadPoolExecutor(3)))
    together = threading.Barrier(4)
    caller = threading.get_ident()
    written = []

    def work(start, stop):
        together.wait(timeout=10)
        if threading.get_ident() != caller:
            time.sleep(0.1)
            written.append(start)

    with pytest.raises(core.Cancelled), reporting(lambda fraction, message: False):
        parallel.run(work, 400, chunk=1)
    assert len(written) == 3


def test_chunks_that_ask_end_in_all_threads_when_the_run_is_cancelled(monkeypatch):
    monkeypatch.setattr(parallel, "thread_count", lambda: 4)
    monkeypatch.setattr(parallel, "_pool", cache(lambda: ThreadPoolExecutor(3)))
    together = threading.Barrier(4)
    to_the_end = []

    def work(start, stop):
        together.wait(timeout=10)  # each chunk has a thread of its own
        for _ in range(2000):
            parallel.ask()
            time.sleep(0.005)
        to_the_end.append(start)

    questions = iter(range(20))
    with pytest.raises(core.Cancelled), reporting(lambda *_: next(questions) < 10):
        parallel.run(work, 4, chunk=1)
    assert to_the_end == []


def test_a_callback_that_returns_nothing_goes_on():
    core.sharpen_geometry(
        core.TriangleMesh(np.eye(3), [[0, 1, 2]]), progress=lambda fraction, message: None
    )


def test_two_threads_may_run_at_once(monkeypatch):
    monkeypatch.setattr(parallel, "thread_count", lambda: 3)
    pool = ThreadPoolExecutor(2, thread_name_prefix="shared")
    monkeypatch.setattr(parallel, "_pool", lambda: pool)
    submitted = []
    monkeypatch.setattr(pool, "submit", watched(pool.submit, submitted))
    vertices, faces = soft_cube(40)
    mesh = core.TriangleMesh(vertices, faces)
    expected = core.sharpen_geometry(mesh)
    assert not np.array_equal(expected, vertices)
    submitted.clear()
    results = [None] * 4
    together = threading.Barrier(4)

    def work(i):
        together.wait(timeout=60)
        results[i] = core.sharpen_geometry(core.TriangleMesh(vertices, faces))

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(result, expected) for result in results)
    assert set(submitted) == {thread.ident for thread in threads}  # all shared the pool


def watched(function, callers):
    """Note the threads that call a function."""

    def call(*arguments):
        callers.append(threading.get_ident())
        return function(*arguments)

    return call


def fractions_of_a_run(_):
    mesh = core.TriangleMesh(*soft_cube(20))
    return float(np.abs(core.sharpen_geometry(mesh) - mesh.vertices).max())


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork on this system")
def test_a_forked_process_makes_threads_of_its_own():
    expected = fractions_of_a_run(None)
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.map_async(fractions_of_a_run, [0]).get(timeout=60) == [expected]


def test_no_chunk_begins_after_an_error(monkeypatch):
    monkeypatch.setattr(parallel, "thread_count", lambda: 2)
    monkeypatch.setattr(parallel, "_pool", cache(lambda: ThreadPoolExecutor(1)))
    begun = []

    def work(start, stop):
        begun.append(start)
        if start == 3:
            raise ZeroDivisionError
        time.sleep(0.002)

    with pytest.raises(ZeroDivisionError):
        parallel.run(work, 300, chunk=1)
    assert len(begun) < 50
