# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the Blender extension: one validated zip per platform, in ``dist/``.

Each zip carries a wheel with the compiled kernels for its platform (tools/build_kernels.py), which
all supported Blenders load; numpy comes with Blender. Building and validating is done by Blender's
own ``blender_ext.py``, which is part of the bpy wheel, so no Blender needs to be installed.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from pathlib import Path

import build_kernels
import bundled
import check_zip

ROOT = Path(__file__).resolve().parent.parent
DIST = ROOT / "dist"
MANIFEST = "blender_manifest.toml"
CONTENT = ["__init__.py", "LICENSE", "README.md", "core", "shock_addon"]
MANUAL = "manual"
MEGABYTE = 1_000_000
SIZE_LIMIT = 13 * MEGABYTE

# Blender as a Python package, for tests, and the Python of each; see noxfile.py.
BLENDERS = {
    "bpy==4.2.23": "3.11",
    "bpy==4.5.15": "3.11",
    "bpy==5.0.1": "3.11",
    "bpy==5.2.3": "3.13",
}

PLATFORMS = ["linux-x64", "windows-x64", "macos-arm64", "macos-x64"]
"""Blender's names of the platforms."""

LONG_AGO = (1980, 1, 1, 0, 0, 0)
"""The date of all files in zips, so that two builds give the same bytes."""


def run(command: list[str]) -> None:
    """Run `command`, whose own output says what went wrong, and stop if it fails."""
    code = subprocess.run(command).returncode
    if code:
        raise SystemExit(f"Nothing was built: exit status {code} of `{' '.join(command)}`.")


def build_manual() -> None:
    """Build the manual, or say that the zips keep the last one or have none."""
    if importlib.util.find_spec("mkdocs"):
        run([sys.executable, str(ROOT / "tools" / "build_docs.py"), "--manual"])
    else:
        has = "an old manual" if (ROOT / MANUAL).is_dir() else "no manual"
        print(f"mkdocs is missing, so the zips have {has}; `python3 -m nox -s build` installs it.")


def copy_content(stage: Path) -> None:
    """Copy what Blender needs of the repository into `stage`."""
    manual = [MANUAL] if (ROOT / MANUAL).is_dir() else []
    for name in CONTENT + manual:
        if (ROOT / name).is_dir():
            shutil.copytree(
                ROOT / name, stage / name, ignore=shutil.ignore_patterns("__pycache__", ".*")
            )
        else:
            shutil.copy(ROOT / name, stage)


def complete_manifest(platform: str, wheels: list[Path]) -> str:
    """Return the manifest's text with what holds for one zip only."""
    text = (ROOT / MANIFEST).read_text(encoding="utf-8")
    minimum = 'blender_version_min = "4.2.0"\n'
    if text.count(minimum) != 1:
        raise SystemExit(f"{MANIFEST} must hold this line once: {minimum}")
    lines = [f'platforms = ["{platform}"]']
    lines += ["wheels = [", *(f'    "./wheels/{wheel.name}",' for wheel in wheels), "]"]
    return text.replace(minimum, minimum + "\n".join(lines) + "\n")


def blender_ext(*arguments: str) -> None:
    """Run Blender's command for extensions, which lies in the bpy package."""
    package = importlib.util.find_spec("bpy")
    found = (
        sorted(Path(package.origin).parent.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
        if package and package.origin
        else []
    )
    if not found:
        raise SystemExit(
            "Building needs the bpy package: run `python3 -m nox -s build`, or install it with"
            " `pip install bpy==4.5.15` (Python 3.11)."
        )
    run([sys.executable, str(found[-1]), *arguments])


def version() -> str:
    """Return the version, which stands in the manifest."""
    return tomllib.loads((ROOT / MANIFEST).read_text(encoding="utf-8"))["version"]


def zip_name(platform: str) -> str:
    """Name the zip for one platform."""
    return f"shock_filter-{version()}-{platform.replace('-', '_')}.zip"


def make_reproducible(path: Path) -> None:
    """Write an archive anew: sorted, without dates and the umask of who built it."""
    part = path.with_name(f".{path.name}")
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(part, "w", compresslevel=9) as new:
        for entry in sorted(old.infolist(), key=lambda entry: entry.filename):
            same = zipfile.ZipInfo(entry.filename, LONG_AGO)
            same.compress_type = entry.compress_type
            same.external_attr = 0o100644 << 16
            new.writestr(same, old.read(entry))
    part.replace(path)


def make_repository(folder: Path) -> None:
    """Make a folder of zips an extension repository, which Blender reads as files or from the web.

    Blender's own tool writes ``index.json``, in the order of the file system, which is sorted here.
    """
    blender_ext("server-generate", f"--repo-dir={folder}")
    index = folder / "index.json"
    listed = json.loads(index.read_text(encoding="utf-8"))
    listed["data"].sort(key=lambda entry: entry["archive_url"])
    index.write_text(json.dumps(listed, indent=2) + "\n", encoding="utf-8")


def build(platform: str, target: Path) -> Path:
    """Build and validate the zip for one platform."""
    wheels = [build_kernels.build(platform)]
    with tempfile.TemporaryDirectory() as folder:
        stage = Path(folder)
        copy_content(stage)
        (stage / "wheels").mkdir()
        for wheel in wheels:
            shutil.copy(wheel, stage / "wheels")
        has_manual = (stage / MANUAL).is_dir()
        (stage / bundled.LIST).write_text(bundled.listing(wheels, has_manual), encoding="utf-8")
        (stage / MANIFEST).write_text(complete_manifest(platform, wheels), encoding="utf-8")
        blender_ext("build", f"--source-dir={stage}", f"--output-filepath={target}")
    make_reproducible(target)
    blender_ext("validate", str(target))
    check_size(target)
    check_zip.check(target, platform)
    return target


def check_size(path: Path) -> None:
    """Refuse a zip that is too large to be downloaded and updated at ease."""
    if path.stat().st_size >= SIZE_LIMIT:
        raise SystemExit(
            f"{path.name} has {path.stat().st_size / MEGABYTE:.1f} MB; the limit is"
            f" {SIZE_LIMIT // MEGABYTE} MB: leave something out."
        )


def main() -> None:
    """Build the zips that the command line asks for; all of them by default."""
    parser = argparse.ArgumentParser(description="Build the Shock Filter extension's zips.")
    parser.add_argument("--platform", nargs="+", choices=PLATFORMS, default=PLATFORMS)
    arguments = parser.parse_args()
    DIST.mkdir(exist_ok=True)
    build_manual()
    for platform in arguments.platform:
        path = build(platform, DIST / zip_name(platform))
        print(f"{path.stat().st_size / MEGABYTE:6.1f} MB  {path.name}", flush=True)


if __name__ == "__main__":
    main()
