# SPDX-License-Identifier: GPL-3.0-or-later
"""How much enabling the extension adds to the start of Blender, in fresh processes.

Needs bpy installed. The fastest of several starts counts, since other work only adds. Counted is
all that the extension imports and Blender's start has not, but not what Python's collector does
about objects that were there before.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import common
from report import Page, Target, table, targets

RUNS = 15
MOST = 20.0

CODE = """
import gc, sys, time, bpy
sys.dont_write_bytecode = False  # as in Blender; the bpy module turns it on
import bl_operators.presets, bl_ui
gc.collect()
began = time.perf_counter()
import shock_filter.shock_addon
imported = time.perf_counter()
shock_filter.register()
print("MS", 1e3 * (imported - began), 1e3 * (time.perf_counter() - imported))
shock_filter.unregister()
"""


def measure() -> tuple[float, float]:
    """Return the milliseconds that importing and registering take in one start."""
    done = subprocess.run(
        [sys.executable, "-c", CODE], capture_output=True, text=True, check=True, timeout=120
    )
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("MS "))
    imports, registers = map(float, line.split()[1:])
    return imports, registers


def main() -> None:
    """Print the fastest start, or write it into a page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", type=Path, help="Markdown page to write the table into")
    arguments = parser.parse_args()
    measure()  # fills the caches
    starts = [measure() for _ in range(RUNS)]
    names = ["importing", "registering", "together"]
    fastest = min(starts, key=sum)
    rows = [
        [name, f"{value:.1f}"] for name, value in zip(names, [*fastest, sum(fastest)], strict=True)
    ]
    goal = Target("milliseconds for enabling", sum(fastest), MOST, "{:.1f}")
    page = Page(arguments.write)
    page.write("enabling", table(["enabling", "ms"], rows) + "\n\n" + targets([goal]))
    page.write("machine", common.machine())


if __name__ == "__main__":
    main()
