# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the Blender extension: one validated zip per platform and Blender series, in ``dist/``.

Each zip carries the wheels of scipy, numba and llvmlite for its platform and for the Python of
its Blender series; numpy comes with Blender. Building and validating is done by Blender's own
``blender_ext.py``, which is part of the bpy wheel, so no Blender needs to be installed.
"""

from __future__ import annotations

import argparse
import importlib.util
import shutil
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

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

# Blender's name of each platform, and the wheel tags that its oldest supported system can load.
PLATFORMS = {
    "linux-x64": ["manylinux_2_17_x86_64", "manylinux2014_x86_64"],
    "windows-x64": ["win_amd64"],
    "macos-arm64": ["macosx_12_0_arm64"],
    "macos-x64": ["macosx_10_15_x86_64"],
}


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


def run(command: list[str], tries: int = 1) -> None:
    """Run `command`, whose own output says what went wrong, and stop if it fails each time."""
    for _ in range(tries):
        code = subprocess.run(command).returncode
        if not code:
            break
    else:
        raise SystemExit(f"No zip was built: exit status {code} of `{' '.join(command)}`.")


def download_wheels(platform: str, python: str, requirements: list[str]) -> list[Path]:
    """Return the pinned wheels, fetched by pip unless they are in ``.wheels/`` already."""
    folder = WHEELS / f"{platform}-python{python}"
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps"]
    command += ["--only-binary=:all:", f"--dest={folder}"]
    command += ["--implementation=cp", f"--python-version={python}"]
    command += [f"--platform={tag}" for tag in PLATFORMS[platform]]
    wheels = []
    for requirement in requirements:
        pattern = requirement.replace("==", "-") + "-*.whl"
        if not list(folder.glob(pattern)):
            run([*command, requirement], tries=3)  # downloads break off
        wheels += folder.glob(pattern)
    return wheels


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


def zip_path(platform: str, name: str) -> Path:
    """Return where the zip for one platform and one Blender series goes."""
    version = tomllib.loads((ROOT / MANIFEST).read_text(encoding="utf-8"))["version"]
    label = f"{platform.replace('-', '_')}-blender{name.replace('.', '')}"
    return DIST / f"shock_filter-{version}-{label}.zip"


def build(platform: str, series: Series, requirements: list[str], target: Path) -> Path:
    """Build and validate the zip for one platform and one Blender series."""
    wheels = download_wheels(platform, series.python, requirements)
    with tempfile.TemporaryDirectory() as folder:
        stage = Path(folder)
        copy_content(stage)
        (stage / "wheels").mkdir()
        for wheel in wheels:
            shutil.copy(wheel, stage / "wheels")
        (stage / MANIFEST).write_text(complete_manifest(platform, series, wheels), encoding="utf-8")
        blender_ext("build", f"--source-dir={stage}", f"--output-filepath={target}")
    blender_ext("validate", str(target))
    if target.stat().st_size >= SIZE_LIMIT:
        raise SystemExit(
            f"{target.name} has {target.stat().st_size / MEGABYTE:.1f} MB; the limit is"
            f" {SIZE_LIMIT // MEGABYTE} MB: leave something out."
        )
    return target


def main() -> None:
    """Build the zips that the command line asks for; all of them by default."""
    parser = argparse.ArgumentParser(description="Build the Shock Filter extension's zips.")
    parser.add_argument("--platform", nargs="+", choices=PLATFORMS, default=list(PLATFORMS))
    parser.add_argument("--series", nargs="+", choices=SERIES, default=list(SERIES))
    arguments = parser.parse_args()
    DIST.mkdir(exist_ok=True)
    build_manual()
    zips = [
        build(p, SERIES[s], REQUIREMENTS_ON.get(p, REQUIREMENTS), zip_path(p, s))
        for p in arguments.platform
        for s in arguments.series
    ]
    for path in zips:
        print(f"{path.stat().st_size / MEGABYTE:6.1f} MB  {path.name}")


if __name__ == "__main__":
    main()
