# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the rooms of the add-on and the core into ``docs/images/house.svg``.

Arrows are imports, counted in the sources: from who uses to who is used, the wider the more. What
all rooms use has none. Which arrows may be there is checked by import-linter, see pyproject.toml.
"""

from __future__ import annotations

import ast
import math
from collections import Counter
from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TARGET = ROOT / "docs" / "images" / "house.svg"

# Each room with the middle and the row of its box, and what is in it.
PLACES = {
    "shock_addon.ui": (300, 0, "panels, menus, presets"),
    "shock_addon.commands": (720, 0, "Blender's command line"),
    "shock_addon.preview": (150, 1, "while the mouse moves"),
    "shock_addon.flow": (400, 1, "Show Flow"),
    "shock_addon.live": (620, 1, "Update, Auto Update"),
    "shock_addon.operators": (300, 2, "what buttons run: read, filter, write, tell"),
    "shock_addon.running": (160, 3, "jobs on a thread, Esc, kernels"),
    "shock_addon.data": (410, 3, "Blender's data in and out"),
    "shock_addon.modes": (620, 3, "one row per button"),
    "shock_addon.kinds": (800, 3, "one row per kind of data"),
    "core.cli": (720, 4, "shock-filter"),
    "core.rehearsal": (235, 4, "compiles kernels before"),
    "core.preview": (400, 4, "patches, crops, arrows"),
    "core.host": (300, 5, "what a host program keeps, as arrays"),
    "core.files": (760, 5, "PLY, OBJ, glTF, PNG, TIFF, EXR"),
    "core.registry": (540, 5, "one row per filter"),
    "core.advection": (760, 6, "flows as moving textures"),
    "core.maps": (330, 6, "curvature, occlusion"),
    "core.repair": (560, 7, "fill, tile, enlarge, repair"),
    "core.stitch": (740, 8, "seams and pictures meet"),
    "core.texture": (620, 9, "sharpen, filter, generate"),
    "core.shape": (200, 9, "geometry: sharpen, denoise, refit"),
    "core.color": (400, 10, "images, signals on meshes"),
    "core.beltrami": (330, 11, "the short-time kernel"),
    "core.elements": (720, 11, "finite elements on texels"),
    "core.mixture": (160, 12, "learned shares of results"),
    "core.flow": (400, 13, "flow-lines on meshes"),
    "core.atlas": (660, 13, "textures on their surface"),
    "core.linear": (110, 14, "CG, multigrid"),
    "core.mesh": (330, 14, "the mesh, calculus, geodesics"),
    "core.grid": (570, 14, "images: walk, sample"),
    "core.rays": (780, 14, "rays against triangles"),
    "core.sparse": (240, 15, "sparse matrices, graphs"),
    "core.base": (460, 16, "kernels, threads, progress, checks; settings, errors: all use these"),
}
TABLES = {"shock_addon.modes", "shock_addon.kinds", "core.registry"}
STEP, HEIGHT, TOP = 92, 46, 50
BORDER = 4  # the core's first row


def rooms_used() -> Counter[tuple[str, str]]:
    """Count the names that modules of one room import from another."""
    counts: Counter[tuple[str, str]] = Counter()
    for path in sorted([*ROOT.glob("core/**/*.py"), *ROOT.glob("shock_addon/**/*.py")]):
        parts = path.relative_to(ROOT).with_suffix("").parts
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.level:
                package = parts[: len(parts) - node.level]
                inside = tuple(node.module.split(".")) if node.module else ()
                for alias in node.names:
                    used = (*package, *inside, alias.name)
                    counts[".".join(parts[:2]), ".".join(used[:2])] += 1
    return counts


def drawing(counts: Counter[tuple[str, str]]) -> str:
    """Return the picture as SVG."""
    arrows = [
        _arrow(*pair, count)
        for pair, count in sorted(counts.items())
        if pair[0] != pair[1] and set(pair) <= PLACES.keys() and pair[1] != "core.base"
    ]
    boxes = [_box(room, *place) for room, place in PLACES.items()]
    line = TOP + BORDER * STEP - (STEP - HEIGHT) / 2
    rows = 1 + max(row for _, row, _ in PLACES.values())
    height = TOP + rows * STEP - STEP + HEIGHT + 20
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 900 {height}"'
        ' font-family="DejaVu Sans, Verdana, sans-serif" text-anchor="middle">',
        "<!-- SPDX-License-Identifier: GPL-3.0-or-later; written by tools/draw_house.py -->",
        '<marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="9" markerHeight="9"'
        ' markerUnits="userSpaceOnUse" orient="auto">',
        '<path d="M0 0 8 4 0 8z" fill="#556"/></marker>',
        f'<rect width="900" height="{height}" fill="#fff"/>',
        f'<rect width="900" height="{line}" fill="#fdf1e3"/>',
        f'<rect y="{line}" width="900" height="{height - line}" fill="#e9f1fa"/>',
        *(f'<text x="12" y="{y:g}" font-size="15" font-weight="bold" text-anchor="start"'
          f' fill="#556">{words}</text>'
          for y, words in ((24, "shock_addon: knows Blender"), (line + 22, "core: arrays only"))),
        *arrows,
        *boxes,
        "</svg>\n",
    ])  # fmt: skip


def _box(room: str, middle: float, row: int, about: str) -> str:
    name, width = room.partition(".")[2], _width(room)
    top = TOP + row * STEP
    fill = "#fff7c9" if room in TABLES else "#fff"
    return (
        f'<rect x="{middle - width / 2:g}" y="{top}" width="{width:g}" height="{HEIGHT}" rx="6"'
        f' fill="{fill}" stroke="#334" stroke-width="1.3"/>'
        f'<text x="{middle}" y="{top + 19}" font-size="15" font-weight="bold">{name}</text>'
        f'<text x="{middle}" y="{top + 36}" font-size="11" fill="#445">{escape(about)}</text>'
    )


def _width(room: str) -> float:
    return 10 + max(6.3 * len(PLACES[room][2]), 10 * len(room.partition(".")[2]))


def _arrow(user: str, used: str, count: int) -> str:
    x, row, _ = PLACES[user]
    to_x, to_row, _ = PLACES[used]
    width = 0.8 + 0.8 * math.log(count)
    if row == to_row:  # beside each other
        side = 1 if to_x > x else -1
        y = TOP + row * STEP + HEIGHT / 2
        half = 5 + 3.15 * len(PLACES[used][2])
        path = f"M{x} {y}H{to_x - side * half:g}"
    else:
        y, to_y = TOP + row * STEP + HEIGHT, TOP + to_row * STEP
        most = min(_width(user), _width(used)) / 2 - 8
        shift = min(max(0.12 * (x - to_x), -most), most)  # so that not all end in one point
        bend = 0.5 * (to_y - y)
        path = (
            f"M{x - shift:g} {y}C{x - shift:g} {y + bend:g}"
            f" {to_x + shift:g} {to_y - bend:g} {to_x + shift:g} {to_y}"
        )
    return (
        f'<path d="{path}" fill="none" stroke="#556" stroke-width="{width:.1f}"'
        f' stroke-opacity="0.6" marker-end="url(#tip)"><title>{user} uses {used}: {count}</title>'
        "</path>"
    )


if __name__ == "__main__":
    TARGET.write_text(drawing(rooms_used()), encoding="utf-8")
