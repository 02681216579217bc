# SPDX-License-Identifier: GPL-3.0-or-later
"""Remake the shock filter paper's tables and figures on our data, beside other programs.

``python benchmarks/paper.py --data FOLDER --write docs/paper.md`` takes some minutes; with
``--all``, an hour.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import common
import paper_images
import paper_meshes
from report import Page

SECTIONS = {
    "table1": paper_images.table1,
    "table2": paper_meshes.table2,
    "table3": paper_meshes.table3,
    "figure3": paper_images.figure3,
    "figure7": paper_meshes.figure7,
    "figure8": paper_meshes.figure8,
    "figure9": paper_images.figure9,
    "figure10": paper_images.figure10,
    "figure11": paper_meshes.figure11,
    "reach": paper_images.reach,
    "peers": paper_images.peers,
    "colors": paper_meshes.color_peers,
}


def main() -> None:
    """Run the benchmarks."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--data",
        type=Path,
        help="folder that holds meshes/ and images/; ../shared/data beside the checkout",
    )
    parser.add_argument("--write", type=Path, metavar="PAGE", help="put the results into this page")
    parser.add_argument("--only", default=",".join(SECTIONS), help="parts to run: %(default)s")
    parser.add_argument(
        "--all", action="store_true", help="also the slow schemes at long times: many minutes"
    )
    arguments = parser.parse_args()
    chosen = arguments.only.split(",")
    if unknown := set(chosen) - set(SECTIONS):
        parser.error(f"--only knows {', '.join(SECTIONS)}; not {', '.join(sorted(unknown))}")
    data = common.find_data(arguments.data)
    if not data:
        parser.error("the photos and meshes are needed: give their folder with --data")
    page = Page(arguments.write, "paper")
    page.write("machine", common.machine())
    with tempfile.TemporaryDirectory() as scratch:
        job = common.Job(data, Path(scratch), page, arguments.all)
        for name, section in SECTIONS.items():
            if name in chosen:
                section(job)


if __name__ == "__main__":
    main()
