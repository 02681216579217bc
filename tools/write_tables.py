# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the tables of settings, parameters and presets into ``docs/``, and pictures of the window.

``python tools/write_tables.py`` rewrites what stands between markers, ``<!-- begin NAME -->`` and
``<!-- end NAME -->``; ``--check`` only names the pages that would change. Needs Blender as a Python
module (bpy) and the package shock_filter.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import bpy
import shock_filter
from shock_filter.core import settings
from shock_filter.shock_addon.modes import choices
from shock_filter.shock_addon.ui.manual import heading

DOCS = Path(__file__).resolve().parent.parent / "docs"
WINDOW = DOCS / "images" / "window"
_SECTION = re.compile(r"<!-- begin ((\w+)(?: ([\w-]+))?) -->\n.*?<!-- end \1 -->", re.DOTALL)


def settings_table(name: str) -> str:
    """Return the table of a settings class; names on screen lead to their headings."""
    rows = []
    for field, (_, default, about) in settings.describe(getattr(settings, name)).items():
        on_screen = about.label or field.replace("_", " ").title()
        rows.append(
            (f"[{on_screen}](#{heading(field, on_screen)})", f"`{field}`", _value(default),
             _range(about), about.unit)
        )  # fmt: skip
    return _table(("on screen", "in scripts", "default", "from, to", "unit"), rows)


def operator_tables(_: str) -> str:
    """Return a section with a table for each operator that people call."""
    sections = []
    for name in sorted(dir(bpy.ops.shock_filter)):
        kind = getattr(bpy.ops.shock_filter, name).get_rna_type()
        if name.endswith("preset_add"):
            continue
        section = f"## {name}\n\n{kind.description}."
        rows = [_parameter(value) for value in kind.properties if _is_public(value)]
        if rows:
            section += "\n\n" + _table(("parameter", "default", "from, to", "meaning"), rows)
        sections.append(section)
    return "\n\n".join(sections)


def preset_tables(_: str) -> str:
    """Return a section with the shipped presets of each mode."""
    sections = []
    for mode in choices():
        rows = [
            (
                preset.name,
                preset.reason,
                ", ".join(_shown(mode.key, *pair) for pair in preset.values.items()),
            )
            for preset in mode.presets
        ]
        table = _table(("preset", "why", "what differs from the defaults"), rows)
        sections.append(f"## {mode.key.replace('_', ' ').title()}\n\n{table}")
    return "\n\n".join(sections)


def window_picture(name: str) -> str:
    """Show a picture of the window, in the newest Blender that there is one of."""
    pictures = sorted(WINDOW.glob("*.png"))
    named = [path for path in pictures if path.stem.partition("-")[2] == name]
    return "\n".join(map(_picture, named[-1:]))


def _picture(path: Path) -> str:
    version = path.stem.partition("-")[0]
    return f"![{_title(path)} in Blender {version}](images/window/{path.name})"


def _title(path: Path) -> str:
    words = path.stem.partition("-")[2].replace("-", " ").replace("_", " ")
    return words[:1].upper() + words[1:]


def _shown(mode: str, name: str, value: Any) -> str:
    """Say what is set to what, in the words on screen."""
    scene = bpy.types.Scene.bl_rna.properties["shock_filter"].fixed_type
    group = scene.properties[mode].fixed_type
    about = group.properties[name]
    if value is True:
        return about.name
    if about.type == "ENUM":
        return f"{about.name} {about.enum_items[value].name}"
    return f"{about.name} {_value(value)}"


def _is_public(value: bpy.types.Property) -> bool:
    return value.identifier != "rna_type" and not value.is_hidden


def _parameter(value: bpy.types.Property) -> tuple[str, str, str, str]:
    if value.type == "ENUM":
        bounds = ", ".join(f"`{item.identifier}`" for item in value.enum_items)
    elif value.type in {"INT", "FLOAT"}:
        bounds = f"{_number(value.hard_min)}, {_number(value.hard_max)}"
    else:
        bounds = {"BOOLEAN": "`True`, `False`", "STRING": "a name"}[value.type]
    default = "" if getattr(value, "is_array", False) else _value(_shortest(value.default))
    meaning = value.description.replace("\n", " ")
    if value.subtype == "ANGLE":
        meaning += ". Unit: radians"
    return f"`{value.identifier}`", default, bounds, meaning


def _shortest(value: Any) -> Any:
    # Blender keeps 0.1 as the float32 0.100000001.
    return float(f"{value:.7g}") if isinstance(value, float) else value


def _range(about: settings.Setting) -> str:
    if about.choices:
        return ", ".join(f"`{word}`" for word in about.choices)
    return f"{_number(about.minimum)}, {_number(about.maximum)}"


def _value(value: Any) -> str:
    if isinstance(value, (bool, str)):
        return f"`{value}`" if value != "" else ""
    return _number(value)


def _number(value: float) -> str:
    if math.isinf(value) or abs(value) > 3e38:  # the largest of Blender's numbers
        return "inf" if value > 0 else "-inf"
    return f"{value:.6g}"


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    lines = [list(head), *(list(row) for row in rows)]
    lines.insert(1, ["---"] * len(lines[0]))
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


_WRITERS: dict[str, Callable[[str], str]] = {
    "settings": settings_table,
    "operators": operator_tables,
    "presets": preset_tables,
    "window": window_picture,
}


def written(page: str) -> str:
    """Return a page with its tables as they should be; other generated sections stay."""

    def section(match: re.Match[str]) -> str:
        name, kind, of = match.groups()
        if kind not in _WRITERS:
            return match[0]
        return f"<!-- begin {name} -->\n\n{_WRITERS[kind](of)}\n\n<!-- end {name} -->"

    return _SECTION.sub(section, page)


def main() -> int:
    """Write all pages, or name those that differ."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing; fail if pages differ")
    check = parser.parse_args().check
    shock_filter.register()
    try:
        pages = {path: path.read_text(encoding="utf-8") for path in sorted(DOCS.glob("*.md"))}
        changed = {path: new for path, old in pages.items() if (new := written(old)) != old}
    finally:
        shock_filter.unregister()  # Blender may hang or crash at exit otherwise
    for path, new in changed.items():
        print(f"docs/{path.name}{' is out of date' if check else ''}")
        if not check:
            path.write_text(new, encoding="utf-8")
    if check and changed:
        print("Run: python tools/write_tables.py")
    return int(check and bool(changed))


if __name__ == "__main__":
    sys.exit(main())
