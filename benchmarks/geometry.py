# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure sharpening of geometry: speed, memory, quality, tracing, against other programs.

``python benchmarks/geometry.py --data FOLDER --write docs/benchmarks.md`` measures all and puts
tables and plots into the page. Without test meshes, a generated shape is used.
"""

from __future__ import annotations

import common
from geometry_quality import quality
from geometry_speed import growth_with_time, peer_speed, speed
from geometry_tracing import tracing

SECTIONS = {
    "speed": speed,
    "time": growth_with_time,
    "peers": peer_speed,
    "quality": quality,
    "tracing": tracing,
}


if __name__ == "__main__":
    parser = common.make_parser(__doc__, SECTIONS)
    common.measure(parser.parse_args(), SECTIONS, "benchmarks")
