# SPDX-License-Identifier: GPL-3.0-or-later
"""Compiling everything beforehand: in a process that may be ended at any time."""

import json
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from zlib import crc32

import pytest
import shock_filter
from shock_filter.core.rehearsal import rehearse as rehearsal

ROOT = Path(shock_filter.__file__).parent
SCRIPT = ROOT / "core" / "rehearsal" / "alone.py"
PACKAGE = "bl_ext.a_repository.shock_filter"
LIMIT = 120.0


@contextmanager
def process(folder):
    """Start the script as a host does, with a folder for its compiled code."""
    started = subprocess.Popen(
        [sys.executable, "-I", SCRIPT],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={"NUMBA_CACHE_DIR": ""},
        text=True,
    )
    task = {"package": PACKAGE, "paths": sys.path, "folder": str(folder), "kinds": ["colors"]}
    started.stdin.write(json.dumps(task) + "\n")
    started.stdin.flush()
    with started:
        yield started
        started.kill()


def wait_for_kernels(started, folder, count):
    """Wait until so many are on disk; return them with their dates."""
    end = time.monotonic() + LIMIT
    while len(found := list(folder.rglob("*.nbc"))) < count:
        assert started.poll() is None, started.stdout.read()
        assert time.monotonic() < end
        time.sleep(0.05)
    return {path: path.stat().st_mtime_ns for path in found}


def test_what_it_compiled_until_it_was_ended_is_whole_and_used_again(tmp_path):
    with process(tmp_path) as first:
        before = wait_for_kernels(first, tmp_path, 3)
        first.stdin.close()  # as at the end of a host that crashes
        assert first.wait(LIMIT) == 1
    with process(tmp_path) as second:
        wait_for_kernels(second, tmp_path, len(before) + 3)
        second.kill()
        fractions = [float(line) for line in second.stdout.read().splitlines()]
    assert fractions == sorted(fractions)
    assert 0.0 == fractions[0] < fractions[-1] < 0.5
    assert {path: path.stat().st_mtime_ns for path in before} == before
    for path in tmp_path.rglob("*.nbc"):
        content = path.read_bytes()
        assert int.from_bytes(content[16:20], "big") == crc32(content[20:])


def test_it_ends_when_it_is_told_to():
    asked = []

    def progress(fraction, message):
        asked.append(fraction)
        return len(asked) < 3

    rehearsal.rehearse(progress)
    assert len(asked) == 3


@pytest.mark.parametrize("kind", ["geometry", "colors", "image", "texture"])
def test_examples_are_changed_by_the_filters(kind):
    # Else some kernels are not called.
    row = next(row for row in rehearsal.FILTERS if row.kind.name == kind and not row.then)
    plain, *_ = rehearsal._examples(kind)
    result = plain(row.name, row.settings())
    if kind == "geometry":
        assert result.largest_move > 0.1
    elif kind == "texture":
        old = rehearsal._textured(len(result.recolored.colors))[0].picture.pixels
        assert (result.recolored.colors != old).any(axis=2).sum() > 100
    else:
        assert result.changed > 100
