# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure sharpening of geometry: speed, memory, quality and tracing, beside other programs.

``python benchmarks/geometry.py --data FOLDER --write docs/benchmarks.md`` measures all and puts
tables and plots into the page. Without test meshes a shape made by code stands in for them.
"""

from __future__ import annotations

import argparse
import os
import platform
import tempfile
from pathlib import Path

import common
from geometry_quality import quality
from geometry_speed import growth_with_time, peer_speed, speed
from geometry_tracing import tracing
from report import Page
from shock_filter.core.parallel import thread_count

SECTIONS = {
    "speed": speed,
    "time": growth_with_time,
    "peers": peer_speed,
    "quality": quality,
    "tracing": tracing,
}


def machine() -> str:
    """Say in words what this runs on."""
    model = platform.processor() or platform.machine()
    about = Path("/proc/cpuinfo")
    if about.is_file():
        models = [line for line in about.read_text().splitlines() if line.startswith("model name")]
        model = models[0].partition(":")[2].strip() if models else model
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1024**3
    return (
        f"Measured on {thread_count()} cores of {model} with {memory:.0f} GiB of memory,"
        f" {platform.system()}, Python {platform.python_version()}."
    )


def main() -> None:
    """Run the benchmarks."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--data", type=Path, help="folder that holds meshes/; ../shared/data beside the checkout"
    )
    parser.add_argument("--write", type=Path, metavar="PAGE", help="put the tables into this page")
    parser.add_argument("--only", default=",".join(SECTIONS), help="parts to run: %(default)s")
    parser.add_argument("--all", action="store_true", help="also what takes minutes for others")
    arguments = parser.parse_args()
    chosen = arguments.only.split(",")
    if unknown := set(chosen) - set(SECTIONS):
        parser.error(f"--only knows {', '.join(SECTIONS)}; not {', '.join(sorted(unknown))}")
    data = common.find_data(arguments.data)
    if not data:
        if arguments.write:
            parser.error("--write needs the test meshes: give their folder with --data")
        print(
            "No test meshes: give the folder that holds meshes/ with --data. A creased sphere"
            " made by code stands in; noisy meshes are left out."
        )
    page = Page(arguments.write)
    page.write("machine", machine())
    with tempfile.TemporaryDirectory() as scratch:
        job = common.Job(data, Path(scratch), page, arguments.all)
        for name, section in SECTIONS.items():
            if name in chosen:
                section(job)


if __name__ == "__main__":
    main()
