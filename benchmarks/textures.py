# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure sharpening of textures: speed, memory, seams and layouts, beside another program.

``python benchmarks/textures.py --data FOLDER --write docs/texture-benchmarks.md`` measures all
and puts tables and pictures into the page. Without data, shapes made by code stand in.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import common
from report import Page
from texture_layouts import invariance
from texture_seams import seam_pictures, seams
from texture_speed import peer_speed, speed

SECTIONS = {
    "speed": speed,
    "peers": peer_speed,
    "seams": seams,
    "pictures": seam_pictures,
    "invariance": invariance,
}


def main() -> None:
    """Run the benchmarks."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--data",
        type=Path,
        help="folder that holds textured/ and meshes/; ../shared/data beside the checkout",
    )
    parser.add_argument("--write", type=Path, metavar="PAGE", help="put the results into this page")
    parser.add_argument("--only", default=",".join(SECTIONS), help="parts to run: %(default)s")
    parser.add_argument("--all", action="store_true", help="also what takes minutes for others")
    arguments = parser.parse_args()
    chosen = arguments.only.split(",")
    if unknown := set(chosen) - set(SECTIONS):
        parser.error(f"--only knows {', '.join(SECTIONS)}; not {', '.join(sorted(unknown))}")
    data = common.find_data(arguments.data)
    if not data:
        if arguments.write:
            parser.error("--write needs the textured meshes: give their folder with --data")
        print(
            "No textured meshes: give the folder that holds textured/ with --data. Shapes made by"
            " code stand in."
        )
    page = Page(arguments.write, "textures")
    page.write("machine", common.machine())
    with tempfile.TemporaryDirectory() as scratch:
        job = common.Job(data, Path(scratch), page, arguments.all)
        for name, section in SECTIONS.items():
            if name in chosen:
                section(job)


if __name__ == "__main__":
    main()
