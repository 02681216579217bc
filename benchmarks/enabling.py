# SPDX-License-Identifier: GPL-3.0-or-later
"""How much enabling the extension adds to the start of Blender, in fresh processes.

Needs bpy installed. The fastest of several starts counts, since other work only adds. Counted is
all that the extension imports and Blender's start has not, but not what Python's collector does
about objects that were there before. Enabling again, in one session, is the extension's own part:
Blender removes the unpacked wheels when an extension is disabled, and unpacks them again when it is
enabled, which takes seconds.
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
registered = time.perf_counter()
again = []
for _ in range(5):
    began_again = time.perf_counter()
    shock_filter.unregister()
    shock_filter.register()
    again.append(time.perf_counter() - began_again)
print("MS", 1e3 * (imported - began), 1e3 * (registered - imported), 1e3 * max(again))
shock_filter.unregister()
"""


def measure() -> tuple[float, float, float]:
    """Return milliseconds of a start: importing, registering, and doing so again at the slowest."""
    done = subprocess.run(
        [sys.executable, "-c", CODE], capture_output=True, text=True, check=True, timeout=120
    )
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("MS "))
    imports, registers, again = map(float, line.split()[1:])
    return imports, registers, again


def main() -> None:
    """Print the fastest start, or write it into a page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", type=Path, help="Markdown page to write the table into")
    arguments = parser.parse_args()
    measure()  # fills the caches
    starts = [measure() for _ in range(RUNS)]
    imports, registers, _ = min(starts, key=lambda start: sum(start[:2]))
    again = min(start[2] for start in starts)
    together = imports + registers
    values = {"importing": imports, "registering": registers, "together": together,
              "disabling and enabling again, the slowest of five": again}  # fmt: skip
    rows = [[name, f"{value:.1f}"] for name, value in values.items()]
    goal = Target("milliseconds for enabling", together, MOST, "{:.1f}")
    page = Page(arguments.write)
    page.write("enabling", table(["enabling", "ms"], rows) + "\n\n" + targets([goal]))
    page.write("machine", common.machine())


if __name__ == "__main__":
    main()
