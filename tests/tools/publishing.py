# SPDX-License-Identifier: GPL-3.0-or-later
"""Extension repositories for tests: of zips that were built, and of one with a raised version."""

import zipfile
from collections.abc import Iterable
from pathlib import Path

import build_extension

NEWER = "99.0.0"
CHANGED = "core/grid/walk.py"


def publish(zips: Iterable[Path], folder: Path) -> None:
    """Have a repository hold these zips."""
    for path in folder.glob("*.zip"):
        path.unlink()
    for path in zips:
        (folder / path.name).symlink_to(path)
    build_extension.make_repository(folder)


def publish_newer(old: Path, folder: Path) -> None:
    """Have a repository hold a zip with a raised version and one changed kernel."""
    publish([], folder)
    with zipfile.ZipFile(old) as given, zipfile.ZipFile(folder / "newer.zip", "w") as new:
        for name in given.namelist():
            content = given.read(name)
            if name == build_extension.MANIFEST:
                line = f'\nversion = "{build_extension.version()}"\n'
                content = content.replace(line.encode(), f'\nversion = "{NEWER}"\n'.encode())
            if name == CHANGED:
                content += b"\n# changed\n"
            new.writestr(name, content)
    build_extension.make_repository(folder)
