# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the Blender extension: one validated zip per platform and Blender series, in ``dist/``.

Each zip carries the wheels of scipy, numba and llvmlite for its platform and for the Python of
its Blender series; numpy comes with Blender. Building and validating is done by Blender's own
``blender_ext.py``, which is part of the bpy wheel, so no Blender needs to be installed.
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
from dataclasses import dataclass
from pathlib import Path

import bundled
import check_zip
import wheel_hashes

ROOT = Path(__file__).resolve().parent.parent
WHEELS = ROOT / ".wheels"
DIST = ROOT / "dist"
MANIFEST = "blender_manifest.toml"
CONTENT = ["__init__.py", "LICENSE", "README.md", "core", "shock_addon"]
MANUAL = "manual"
MEGABYTE = 1_000_000
SIZE_LIMIT = 110 * MEGABYTE

# numpy is Blender's own: all extensions share one site-packages, and Blender needs its version.
# llvmlite before 0.46 crashes a Blender with a window on Linux: its LLVM clashes with the one of
# the graphics driver. There are no later wheels for Macs with Intel processors.
REQUIREMENTS = ["scipy==1.15.3", "numba==0.63.1", "llvmlite==0.46.0"]
REQUIREMENTS_ON = {"macos-x64": ["scipy==1.15.3", "numba==0.62.1", "llvmlite==0.45.1"]}

# For windows of Blenders whose Python no series has: Debian's 5.2, whose numpy is 2.4.
REQUIREMENTS_IN_WINDOWS = {"3.14": ["scipy==1.16.3", "numba==0.64.0", "llvmlite==0.46.0"]}

# Blender as a Python package, for tests, and the Python of each; see noxfile.py.
BLENDERS = {
    "bpy==4.2.23": "3.11",
    "bpy==4.5.15": "3.11",
    "bpy==5.0.1": "3.11",
    "bpy==5.2.3": "3.13",
}

# Blender's name of each platform, and the wheel tags that its oldest supported system can load.
PLATFORMS = {
    "linux-x64": ["manylinux_2_17_x86_64", "manylinux2014_x86_64"],
    "windows-x64": ["win_amd64"],
    "macos-arm64": ["macosx_12_0_arm64"],
    "macos-x64": ["macosx_10_15_x86_64"],
}

LONG_AGO = (1980, 1, 1, 0, 0, 0)
"""The date of all files in zips, so that two builds give the same bytes."""


@dataclass(frozen=True)
class Series:
    """Blender versions that share one Python: from ``first`` up to, but without, ``end``."""

    first: str
    end: str | None
    python: str


SERIES = {
    "4.2": Series(first="4.2.0", end="5.1.0", python="3.11"),
    "5.1": Series(first="5.1.0", end=None, python="3.13"),
}


def run(command: list[str]) -> None:
    """Run `command`, whose own output says what went wrong, and stop if it fails."""
    code = subprocess.run(command).returncode
    if code:
        raise SystemExit(f"Nothing was built: exit status {code} of `{' '.join(command)}`.")


def pip_words(platform: str, python: str) -> list[str]:
    """Return what tells pip to take wheels for a platform and a Python."""
    tags = [f"--platform={tag}" for tag in PLATFORMS[platform]]
    return ["--implementation=cp", f"--python-version={python}", *tags]


def download_wheels(platform: str, python: str, requirements: list[str]) -> list[Path]:
    """Return the pinned wheels, fetched by pip unless they are in ``.wheels/`` already."""
    folder = WHEELS / f"{platform}-python{python}"
    wheels = []
    for requirement in requirements:
        pattern = requirement.replace("==", "-") + "-*.whl"
        for _ in range(3):  # downloads break off
            if list(folder.glob(pattern)):
                break
            wheel_hashes.download(requirement, folder, pip_words(platform, python))
        else:
            raise SystemExit(f"Nothing was built: {requirement} cannot be downloaded.")
        for wheel in folder.glob(pattern):
            wheel_hashes.check(wheel, requirement)
            wheels.append(wheel)
    return wheels


def check_wheel(wheel: Path, platform: str, python: str) -> None:
    """Refuse a wheel that is for another platform, or for another Python than the series has."""
    *_, tag, _, systems = wheel.stem.split("-")
    fitting = f"cp{python.replace('.', '')}"
    if tag != fitting or not any(_loads(platform, system) for system in systems.split(".")):
        raise SystemExit(
            f"{wheel.name} is not for {platform} and Python {python}: take one for {fitting} and"
            f" {' or '.join(PLATFORMS[platform])}."
        )


def _loads(platform: str, system: str) -> bool:
    """Tell whether the oldest supported system of a platform loads wheels for `system`."""
    newest = PLATFORMS[platform][0]
    if not platform.startswith("macos"):
        return system in PLATFORMS[platform]
    kind, *version, processor = system.split("_", 3)
    newest_kind, *newest_version, newest_processor = newest.split("_", 3)
    return (kind, processor) == (newest_kind, newest_processor) and [*map(int, version)] <= [
        *map(int, newest_version)
    ]


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


def complete_manifest(platform: str, series: Series, wheels: list[Path]) -> str:
    """Return the manifest's text with what holds for one zip only."""
    text = (ROOT / MANIFEST).read_text(encoding="utf-8")
    minimum = 'blender_version_min = "4.2.0"\n'
    if text.count(minimum) != 1:
        raise SystemExit(f"{MANIFEST} must hold this line once: {minimum}")
    lines = [f'blender_version_min = "{series.first}"']
    if series.end:
        lines.append(f'blender_version_max = "{series.end}"')
    lines.append(f'platforms = ["{platform}"]')
    lines += ["wheels = [", *(f'    "./wheels/{wheel.name}",' for wheel in wheels), "]"]
    return text.replace(minimum, "\n".join(lines) + "\n")


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


def zip_name(platform: str, name: str) -> str:
    """Name the zip for one platform and one Blender series."""
    label = f"{platform.replace('-', '_')}-blender{name.replace('.', '')}"
    return f"shock_filter-{version()}-{label}.zip"


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


def build(platform: str, series: Series, requirements: list[str], target: Path) -> Path:
    """Build and validate the zip for one platform and one Blender series."""
    wheels = download_wheels(platform, series.python, requirements)
    with tempfile.TemporaryDirectory() as folder:
        stage = Path(folder)
        copy_content(stage)
        (stage / "wheels").mkdir()
        for wheel in wheels:
            check_wheel(wheel, platform, series.python)
            shutil.copy(wheel, stage / "wheels")
        has_manual = (stage / MANUAL).is_dir()
        (stage / bundled.LIST).write_text(bundled.listing(wheels, has_manual), encoding="utf-8")
        (stage / MANIFEST).write_text(complete_manifest(platform, series, wheels), encoding="utf-8")
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
    parser.add_argument("--platform", nargs="+", choices=PLATFORMS, default=list(PLATFORMS))
    parser.add_argument("--series", nargs="+", choices=SERIES, default=list(SERIES))
    arguments = parser.parse_args()
    DIST.mkdir(exist_ok=True)
    build_manual()
    zips = [
        build(p, SERIES[s], REQUIREMENTS_ON.get(p, REQUIREMENTS), DIST / zip_name(p, s))
        for p in arguments.platform
        for s in arguments.series
    ]
    for path in zips:
        print(f"{path.stat().st_size / MEGABYTE:6.1f} MB  {path.name}")


if __name__ == "__main__":
    main()
