# SPDX-License-Identifier: GPL-3.0-or-later
"""List what a zip carries of others' work, and refuse what GPL-3.0-or-later cannot ship.

The list names each package with its version, licence and hash, and each picture of the manual with
the script that made it, what it shows and that one's licence, out of docs/images/sources.toml.
"""

from __future__ import annotations

import hashlib
import re
import tomllib
import zipfile
from email.parser import HeaderParser
from fnmatch import fnmatch
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
PICTURES = ROOT / "docs" / "images"
SOURCES = "sources.toml"
LIST = "BUNDLED.md"
PICTURE_KINDS = {".png", ".svg", ".webp", ".jpg", ".gif"}

# What may be part of a whole under GPL-3.0-or-later, by SPDX's names.
SHIPPABLE = {
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "CC-BY-4.0",
    "CC-BY-SA-4.0",
    "CC0-1.0",
    "GPL-2.0-or-later",
    "GPL-3.0-or-later",
    "GPL-3.0-or-later WITH GCC-exception-3.1",
    "ISC",
    "LGPL-2.1-or-later",
    "LGPL-3.0-or-later",
    "MIT",
    "public domain",
    "unrestricted use",
}

# Where a wheel's own words are none of SPDX's. Read in its licence files.
READ = {
    "mkdocs-material": "MIT",
}

# What the linker adds to the compiled kernels.
LINKED = "LLVM's compiler-rt (Apache-2.0 WITH LLVM-exception); on Windows parts of mingw-w64 (MIT)"


class Package(NamedTuple):
    """Another's work in a zip, as the list names it."""

    name: str
    version: str
    licence: str
    inside: str
    place: str
    digest: str


def check_licence(what: str, licence: str) -> None:
    """Refuse a licence that GPL-3.0-or-later cannot ship, or that nobody knows."""
    for part in licence.split(" AND "):
        if not any(option in SHIPPABLE for option in part.strip("()").split(" OR ")):
            raise SystemExit(
                f"{what} has the licence {licence or '(none)'!r}, which GPL-3.0-or-later cannot"
                " ship: replace it, or add the licence to tools/bundled.py if it fits."
            )


def package_of(wheel: Path) -> Package:
    """Read what a wheel says of itself."""
    with zipfile.ZipFile(wheel) as archive:
        (place,) = [n for n in archive.namelist() if re.fullmatch(r"[^/]+\.dist-info/METADATA", n)]
        about = HeaderParser().parsestr(archive.read(place).decode("utf-8"))
    name = about["Name"]
    licence = about["License-Expression"] or READ.get(name, "")
    check_licence(wheel.name, licence)
    digest = hashlib.sha256(wheel.read_bytes()).hexdigest()
    place = f"wheels/{wheel.name}"
    inside = LINKED if name.startswith("shock_filter_kernels") else ""
    return Package(name, about["Version"], licence, inside, place, digest)


def theme_of_manual() -> Package:
    """Tell of the styles, scripts and signs that the manual's pages use."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    pinned = settings["project"]["optional-dependencies"]["docs"]
    name, version = next(p.split("==") for p in pinned if p.startswith("mkdocs-material=="))
    check_licence(name, READ[name])
    return Package(name, version, READ[name], "", "manual/assets", "")


def pictures(folder: Path = PICTURES) -> list[dict[str, str]]:
    """Return rows of sources.toml with the pictures that each stands for.

    Raises
    ------
    SystemExit
        If a picture has no row or more than one, a row no picture, or a licence does not fit.
    """
    rows = tomllib.loads((folder / SOURCES).read_text(encoding="utf-8"))["pictures"]
    found = sorted(
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.suffix in PICTURE_KINDS
    )
    shown: list[list[str]] = [[] for _ in rows]
    for name in found:
        fitting = [i for i, row in enumerate(rows) if any(fnmatch(name, f) for f in row["files"])]
        if len(fitting) != 1:
            raise SystemExit(
                f"docs/images/{name} has {len(fitting)} rows in docs/images/{SOURCES}: give it one,"
                " with its script, what it shows, and that one's licence."
            )
        shown[fitting[0]].append(name)
    for row, names in zip(rows, shown, strict=True):
        if not names:
            raise SystemExit(f"docs/images/{SOURCES} names {row['files']}, which are not there.")
        check_licence(f"docs/images/{names[0]}", row["licence"])
    return [{**row, "files": names} for row, names in zip(rows, shown, strict=True)]


def listing(wheels: list[Path], manual: bool) -> str:
    """Return the list of a zip in Markdown."""
    packages = [package_of(wheel) for wheel in wheels]
    if manual:
        packages.append(theme_of_manual())
    lines = [
        "# What this zip carries of others' work",
        "",
        "Shock Filter itself is GPL-3.0-or-later, see LICENSE. Each wheel holds the full texts of",
        "its licences.",
        "",
        "| package | version | licence | in it | place | SHA-256 |",
        "|---|---|---|---|---|---|",
        *(f"| {' | '.join(package)} |" for package in packages),
    ]
    if manual:
        lines += [
            "",
            "The manual's pictures, in `manual/images/`:",
            "",
            "| pictures | made by | shows | licence |",
            "|---|---|---|---|",
            *(
                f"| {', '.join(row['files'])} | `{row['script']}` | {row['shows']} |"
                f" {row['licence']} |"
                for row in pictures()
            ),
        ]
    return "\n".join(lines) + "\n"
