# SPDX-License-Identifier: GPL-3.0-or-later
import multiprocessing
import os
import threading

import numpy as np
import pytest
from shapes import icosphere
from shock_filter import core
from shock_filter.core.base import parallel


def test_every_index_is_visited_once():
    seen = np.zeros(10_007, dtype=int)

    def visit(start, stop, out):
        out[start:stop] += 1

    parallel.run(visit, len(seen), seen, chunk=100)
    assert (seen == 1).all()
    parallel.run(visit, 0, seen)
    assert (seen == 1).all()


def test_cancelling_stops_after_few_chunks_and_raises():
    visited = []
    stop_at_once = parallel.Progress(lambda fraction, message: False)
    with pytest.raises(core.Cancelled):
        parallel.run(lambda a, b: visited.append(a), 10_000, chunk=1, progress=stop_at_once)
    assert len(visited) < 10_000


def test_errors_of_kernels_reach_the_caller():
    def fail(start, stop):
        if start == 50:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        parallel.run(fail, 100, chunk=1)


def test_progress_is_reported_from_the_calling_thread_and_maps_parts():
    calls = []

    def callback(fraction, message):
        calls.append((fraction, message, threading.get_ident()))
        return True

    whole = parallel.Progress.of(callback)
    part = whole.part(0.5, 1.0, "Second half").part(0.5, 1.0, "Last quarter")
    parallel.run(lambda a, b: None, 10, chunk=1, progress=part)
    assert {ident for _, _, ident in calls} == {threading.get_ident()}
    assert calls[0][:2] == (0.5, "Second half")
    assert calls[1][:2] == (0.75, "Last quarter")
    assert all(0.75 <= fraction <= 1 for fraction, _, _ in calls[2:])
    assert parallel.Progress.of(whole) is whole


def test_a_callback_that_returns_nothing_goes_on():
    core.sharpen_geometry(
        core.TriangleMesh(np.eye(3), [[0, 1, 2]]), progress=lambda fraction, message: None
    )


def test_two_threads_may_run_at_once():
    vertices = np.random.default_rng(0).normal(size=(60, 3))
    faces = np.arange(60).reshape(-1, 3)
    expected = core.sharpen_geometry(core.TriangleMesh(vertices, faces))
    results = [None] * 4

    def work(i):
        results[i] = core.sharpen_geometry(core.TriangleMesh(vertices, faces))

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(result, expected) for result in results)


def fractions_of_a_run(_):
    mesh = core.TriangleMesh(*icosphere(4))
    return float(np.abs(core.sharpen_geometry(mesh) - mesh.vertices).max())


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork on this system")
def test_a_forked_process_makes_threads_of_its_own():
    expected = fractions_of_a_run(None)
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.map_async(fractions_of_a_run, [0]).get(timeout=60) == [expected]
