# SPDX-License-Identifier: GPL-3.0-or-later
"""Extension repositories for tests: of zips that were built, and of one with a raised version."""

import json
import zipfile
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory

import build_extension
import build_kernels

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
    with TemporaryDirectory() as made, zipfile.ZipFile(old) as given:
        stage = Path(made)
        given.extractall(stage)
        with (stage / CHANGED).open("a") as file:
            file.write("# changed\n")
        (wheel,) = stage.glob("wheels/*.whl")
        newer = raise_version(wheel, stage / "core")
        manifest = stage / build_extension.MANIFEST
        text = manifest.read_text(encoding="utf-8")
        line = f'\nversion = "{build_extension.version()}"\n'
        assert line in text
        text = text.replace(line, f'\nversion = "{NEWER}"\n').replace(wheel.name, newer.name)
        manifest.write_text(text, encoding="utf-8")
        with zipfile.ZipFile(folder / "newer.zip", "w", zipfile.ZIP_DEFLATED) as new:
            for path in sorted(stage.rglob("*")):
                new.write(path, path.relative_to(stage))
    build_extension.make_repository(folder)


def raise_version(wheel: Path, core: Path) -> Path:
    """Replace a wheel of kernels by that of the newer version, for these sources."""
    with zipfile.ZipFile(wheel) as archive:
        (table,) = [name for name in archive.namelist() if name.endswith("/kernels.json")]
        about = json.loads(archive.read(table))
        library = archive.read(table.replace("kernels.json", about["library"]))
    about["sources"] = build_kernels.sources_digest(core)
    newer = wheel.with_name(build_kernels.wheel_name("linux-x64", NEWER))
    wheel.unlink()
    build_kernels.write_wheel(newer, NEWER, about, library)
    return newer
