# SPDX-License-Identifier: GPL-3.0-or-later
"""Check a zip as far as that goes without its system: compiled files, imports, names of files.

``python tools/check_zip.py FOLDER`` checks all zips in a folder; ``build_extension.py`` checks each
that it builds.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tomllib
import zipfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

# What compiled files begin with; ELF and PE name their processor further on.
PROCESSORS = {
    "linux-x64": "ELF x64",
    "windows-x64": "PE x64",
    "macos-arm64": "Mach-O arm64",
    "macos-x64": "Mach-O x64",
}

BLENDERS = {
    "bpy",
    "bmesh",
    "mathutils",
    "blf",
    "gpu",
    "gpu_extras",
    "bl_operators",
    "bl_ui",
    "numpy",
}
"""What Blender's Python has."""

# What `shock-filter` reads and writes files with, and spreads work with: extras of the package.
# The core imports them where they are needed, and an error names the extra.
OPTIONAL = {
    "trimesh",
    "PIL",
    "tifffile",
    "imagecodecs",
    "OpenEXR",
    "xarray",
    "netCDF4",
    "h5py",
    "zarr",
    "numcodecs",
    "imageio_ffmpeg",
    "dask",
    "distributed",
    "cryptography",
}

# What serves the core where no library of kernels is, and scipy's matrices given by callers.
ELSEWHERE = {"numba", "scipy"}

HEAVY = {"numba", "llvmlite", "scipy"}
"""What the zips do without."""

RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
FORBIDDEN = re.compile(r'[<>:"|?*\\\x00-\x1f]')

# Windows allows 260 characters; before those of a zip stand up to 20 of a user's name in
# C:\Users\...\AppData\Roaming\Blender Foundation\Blender\5.1\extensions\.local\lib\python3.13\
# site-packages\, which wheels go to.
LONGEST = 260 - 125


def check(path: Path, platform: str) -> None:
    """Stop with all that is wrong with the zip for a platform, each in a sentence."""
    problems = list(problems_of(path, platform))
    if problems:
        raise SystemExit(f"{path.name} cannot be released:\n" + "\n".join(problems))


def problems_of(path: Path, platform: str) -> Iterator[str]:
    """List what is wrong with a zip."""
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        yield from names_that_fail(names)
        yield from foreign_files(archive, platform)
        wheels = [name for name in names if name.endswith(".whl")]
        carried = set()
        for name in wheels:
            with zipfile.ZipFile(io.BytesIO(archive.read(name))) as wheel:
                yield from names_that_fail(wheel.namelist(), f"{name}: ")
                yield from foreign_files(wheel, platform, f"{name}: ")
                carried |= {entry.split("/")[0].removesuffix(".py") for entry in wheel.namelist()}
        yield from (f"It carries {name}: leave it out." for name in sorted(HEAVY & carried))
        if not any(name.startswith("shock_filter_kernels_") for name in carried):
            yield "It lacks the compiled kernels."
        yield from lost_imports(archive, carried)
        listed = tomllib.loads(archive.read("blender_manifest.toml").decode("utf-8"))["wheels"]
        if sorted(listed) != sorted(f"./{name}" for name in wheels):
            yield "The manifest does not list the wheels that are there."


def names_that_fail(names: list[str], where: str = "") -> Iterator[str]:
    """List names of files that Windows or macOS cannot hold, alone or beside another."""
    counted = Counter(name.casefold() for name in names)
    for name in names:
        if counted[name.casefold()] > 1:
            yield f"{where}{name} has a twin that differs in case only; rename one."
        if len(name) > LONGEST:
            yield f"{where}{name} has {len(name)} characters, and Windows allows {LONGEST} here."
        for part in PurePosixPath(name).parts:
            if RESERVED.fullmatch(part) or FORBIDDEN.search(part) or part[-1] in " .":
                yield f"{where}{name} is no name of a file on Windows; rename it."


def processor_of(content: bytes) -> str | None:
    """Tell what a compiled file is for; None for all else."""
    if content.startswith(b"\x7fELF"):
        return "ELF x64" if content[18:20] == b"\x3e\0" else "ELF of another processor"
    if content.startswith(b"\xcf\xfa\xed\xfe"):
        processors = {b"\x07\0\0\x01": "x64", b"\x0c\0\0\x01": "arm64"}
        return f"Mach-O {processors.get(content[4:8], 'of another processor')}"
    if content.startswith(b"MZ"):
        start = int.from_bytes(content[60:64], "little")
        fits = content[start : start + 6] == b"PE\0\0\x64\x86"
        return "PE x64" if fits else "PE of another processor"
    return None


def foreign_files(archive: zipfile.ZipFile, platform: str, where: str = "") -> Iterator[str]:
    """List compiled files for other platforms."""
    for entry in archive.infolist():
        if entry.filename.endswith((".py", ".html", ".json", ".whl")):
            continue
        with archive.open(entry) as file:
            processor = processor_of(file.read(4096))
        if processor not in (None, PROCESSORS[platform]):
            yield f"{where}{entry.filename} is compiled for {processor}, not for {platform}."


def lost_imports(archive: zipfile.ZipFile, carried: set[str]) -> Iterator[str]:
    """List imports that neither the zip, nor its wheels, nor Blender's Python can satisfy."""
    names = set(archive.namelist())
    known = {*sys.stdlib_module_names, *BLENDERS, *carried}
    for name in sorted(names):
        if not name.endswith(".py"):
            continue
        found = known | OPTIONAL | ELSEWHERE if name.startswith("core/") else known
        for node in ast.walk(ast.parse(archive.read(name))):
            if isinstance(node, ast.Import):
                modules = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and not node.level:
                modules = [node.module or ""]
            elif isinstance(node, ast.ImportFrom):
                place = "/".join([*name.split("/")[: -node.level], *(node.module or "").split(".")])
                place = place.strip("/")
                files = {f"{place}.py", f"{place}/__init__.py".strip("/")}
                modules = [] if files & names else [place]
            else:
                continue
            for module in modules:
                if module.partition(".")[0] not in found:
                    yield f"{name} imports {module}, which is neither in the zip nor in Blender."


def main() -> None:
    """Check the zips in the folders that the command line names."""
    for folder in sys.argv[1:]:
        for path in sorted(Path(folder).glob("*.zip")):
            with zipfile.ZipFile(path) as archive:
                manifest = archive.read("blender_manifest.toml").decode("utf-8")
            check(path, tomllib.loads(manifest)["platforms"][0])
            print(f"{path.name}: checked")


if __name__ == "__main__":
    main()
