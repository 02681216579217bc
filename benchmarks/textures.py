# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure sharpening of textures: speed, memory, seams, layouts, against another program.

``python benchmarks/textures.py --data FOLDER --write docs/texture-benchmarks.md`` measures all
and puts tables and pictures into the page. Without data, generated shapes are used.
"""

from __future__ import annotations

import common
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


if __name__ == "__main__":
    parser = common.make_parser(__doc__, SECTIONS)
    common.measure(parser.parse_args(), SECTIONS, "textures")
