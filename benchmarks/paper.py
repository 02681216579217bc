# SPDX-License-Identifier: GPL-3.0-or-later
"""Repeat the shock filter paper's tables and figures on our data, with other programs.

``python benchmarks/paper.py --data FOLDER --write docs/paper.md`` takes some minutes; with
``--all``, an hour.
"""

from __future__ import annotations

import common
import paper_images
import paper_meshes

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


if __name__ == "__main__":
    parser = common.make_parser(__doc__, SECTIONS, needs_data=True)
    common.measure(parser.parse_args(), SECTIONS, "paper")
