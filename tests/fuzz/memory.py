# SPDX-License-Identifier: GPL-3.0-or-later
"""How much memory this process holds, and whether it grows."""

import gc
from pathlib import Path

import pytest
from strategies import LONG

RUNS = 200 if LONG else 24
MOST_GROWTH = 5 * 1024**2
"""Above what allocators keep for themselves, in bytes."""


def resident():
    """Return the memory of this process in bytes (Linux)."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return 4096 * pages


def assert_flat(run):
    """Call ``run()`` many times; after the first ones, memory must not grow.

    What earlier tests have left in this process may grow once; what runs leave grows each time.
    """
    for _ in range(RUNS // 4):
        run()
    grown = []
    while len(grown) < 3:
        before = resident()
        for _ in range(RUNS):
            run()
        grown.append(resident() - before)
        if grown[-1] <= MOST_GROWTH:
            return
    megabytes = ", ".join(f"{each / 1024**2:.1f}" for each in grown)
    pytest.fail(f"{RUNS} runs left {megabytes} MB behind, one time after the other")
