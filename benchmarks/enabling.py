# SPDX-License-Identifier: GPL-3.0-or-later
"""How much enabling the extension adds to the start of Blender, in fresh processes.

Needs bpy installed. numpy and what Blender's own scripts import are imported before.
"""

from __future__ import annotations

import statistics
import subprocess
import sys

RUNS = 7
TARGET = 20.0

CODE = """
import sys, time, bpy
sys.dont_write_bytecode = False  # as in Blender; the bpy module turns it on
import bl_operators.presets, bl_ui, numpy
began = time.perf_counter()
import shock_filter
shock_filter.register()
print("MS", 1e3 * (time.perf_counter() - began))
shock_filter.unregister()
"""


def measure() -> float:
    """Return the milliseconds of one start."""
    done = subprocess.run(
        [sys.executable, "-c", CODE], capture_output=True, text=True, check=True, timeout=120
    )
    return float(
        next(line for line in done.stdout.splitlines() if line.startswith("MS ")).split()[1]
    )


def main() -> None:
    """Print the median."""
    measure()  # fills the caches
    milliseconds = statistics.median(measure() for _ in range(RUNS))
    met = "yes" if milliseconds <= TARGET else "**no**"
    print("| | target, ms | measured, ms | met |\n| --- | ---: | ---: | ---: |")
    print(f"| enabling | at most {TARGET:.0f} | {milliseconds:.0f} | {met} |")


if __name__ == "__main__":
    main()
