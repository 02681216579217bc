# SPDX-License-Identifier: GPL-3.0-or-later
"""Compile all kernels for all platforms, and make a wheel for each: needs no compiler installed.

    python tools/build_kernels.py [--platform NAME ...]

numba compiles the kernels in a rehearsal (tools/kernels/harvest.py), LLVM compiles them for each
platform (tools/kernels/compiler.py), and zig links them. Wheels of the same sources are kept in
``.kernels/``; one rehearsal gives the same bytes each time.
"""

from __future__ import annotations

import argparse
import base64
import contextlib
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parent.parent
PLACE = ROOT / ".kernels"
RUNTIME = ROOT / "tools" / "kernels" / "runtime.c"
KINDS = ["geometry", "colors", "flow", "image"], ["texture", "field"]
"""Kinds of data for each process of the harvest: few kernels twice."""

LONG_AGO = (1980, 1, 1, 0, 0, 0)


class Platform(NamedTuple):
    """How zig names a platform and its oldest system, and how a wheel does."""

    zig: str
    library: str
    tag: str


PLATFORMS = {
    "linux-x64": Platform("x86_64-linux-gnu.2.17", "kernels.so", "manylinux_2_17_x86_64"),
    "windows-x64": Platform("x86_64-windows-gnu", "kernels.dll", "win_amd64"),
    "macos-arm64": Platform("aarch64-macos.12.0", "kernels.dylib", "macosx_12_0_arm64"),
    "macos-x64": Platform("x86_64-macos.10.15", "kernels.dylib", "macosx_10_15_x86_64"),
    "linux-arm64": Platform("aarch64-linux-gnu.2.17", "kernels.so", "manylinux_2_17_aarch64"),
}


def version() -> str:
    """Return the version, which is in the extension's manifest."""
    return tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))["version"]


def package_name(of: str) -> str:
    """Return the name of the package of a version, as `core.base.compiled` looks for it."""
    return "shock_filter_kernels_" + re.sub(r"\W", "_", of)


def sources_digest(core: Path = ROOT / "core") -> str:
    """Digest the core's sources, as `core.base.compiled` does."""
    digest = hashlib.blake2b(digest_size=16)
    for path in sorted(core.rglob("*.py"), key=lambda path: path.relative_to(core).as_posix()):
        digest.update(path.relative_to(core).as_posix().encode() + b"\n" + path.read_bytes())
    return digest.hexdigest()


def harvest() -> list[Path]:
    """Return the files of `harvest.py` for these sources, made in processes side by side."""
    digest = sources_digest()
    made = [PLACE / f"harvest-{digest}-{number}.pickle" for number in range(len(KINDS))]
    with ThreadPoolExecutor() as pool:
        list(pool.map(_harvest, made, KINDS))
    return made


def _harvest(out: Path, kinds: Sequence[str]) -> None:
    if out.exists():
        return
    part = out.with_suffix(".part")
    _run("tools/kernels/harvest.py", str(part), *kinds)
    part.replace(out)


def _run(script: str, *words: str) -> None:
    # The package takes its name from a folder, and the root may be called anything.
    link = PLACE / "package" / "shock_filter"
    link.parent.mkdir(parents=True, exist_ok=True)
    with contextlib.suppress(FileExistsError):  # two harvests may come here at once
        link.symlink_to(ROOT, target_is_directory=True)
    paths = [str(link.parent), *filter(None, [os.environ.get("PYTHONPATH")])]
    # Without a fixed seed, numba writes its modules in another order each time.
    env = {**os.environ, "PYTHONHASHSEED": "0", "PYTHONPATH": os.pathsep.join(paths)}
    env["NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING"] = "1"  # of each overload that does not fit
    subprocess.run([sys.executable, str(ROOT / script), *words], check=True, env=env)


def build(platform: str) -> Path:
    """Return the wheel for a platform, built unless it is there for these sources."""
    target = PLACE / sources_digest() / wheel_name(platform)
    if target.exists():
        return target
    files = harvest()
    folder = PLACE / platform
    folder.mkdir(parents=True, exist_ok=True)
    _run("tools/kernels/compiler.py", platform, str(folder), *map(str, files))
    library = folder / PLATFORMS[platform].library
    objects = [folder / name for name in ("kernels.o", "wide.o")]
    link(platform, [each for each in objects if each.stat().st_size], library)
    table = json.loads((folder / "kernels.json").read_text(encoding="utf-8"))
    check_exports(library, table)
    target.parent.mkdir(exist_ok=True)
    about = {"sources": sources_digest(), "library": library.name, "kernels": table}
    write_wheel(target, version(), about, library.read_bytes())
    return target


def link(platform: str, objects: list[Path], library: Path) -> None:
    """Link object files with the runtime into a shared library."""
    command = [sys.executable, "-m", "ziglang", "cc", "-target", PLATFORMS[platform].zig]
    command += ["-shared", "-O2", "-s", "-fvisibility=hidden", *map(str, objects)]
    command += [
        str(RUNTIME),
        "-o",
        str(library),
        *(["-lm", "-Wl,-z,defs"] if "linux" in platform else []),
    ]
    cache = str(PLACE / "zig")
    env = {**os.environ, "ZIG_GLOBAL_CACHE_DIR": cache, "ZIG_LOCAL_CACHE_DIR": cache}
    subprocess.run(command, check=True, env=env, cwd=library.parent)


def check_exports(library: Path, table: dict[str, dict[str, list[Any]]]) -> None:
    """Refuse a library that lacks a function of the table."""
    code = library.read_bytes()
    for name, kernels in table.items():
        for types, (symbol, _, *wide) in kernels.items():
            if not all(each.encode() in code for each in (symbol, *wide)):
                raise SystemExit(f"{library} lacks {name} for {types}.")


def wheel_name(platform: str, of: str | None = None) -> str:
    """Return the name of a platform's wheel; any Python of 3 loads it."""
    of = of or version()
    return f"{package_name(of)}-{of}-py3-none-{PLATFORMS[platform].tag}.whl"


def write_wheel(path: Path, of: str, about: dict[str, Any], library: bytes) -> None:
    """Write a wheel of a version, always with the same bytes, with a library and its table."""
    package = package_name(of)
    place = f"{package}-{of}.dist-info"
    table = json.dumps(about, separators=(",", ":"), sort_keys=True).encode()
    tag = path.stem.partition(f"-{of}-")[2]
    metadata = [
        "Metadata-Version: 2.4",
        f"Name: {package}",
        f"Version: {of}",
        "Summary: Compiled kernels of Shock Filter",
        "License-Expression: GPL-3.0-or-later",
        "License-File: LICENSE",
    ]
    wheel = ["Wheel-Version: 1.0", "Generator: build_kernels", "Root-Is-Purelib: false"]
    files = {
        f"{package}/__init__.py": _INIT,
        f"{package}/kernels.json": table,
        f"{package}/{about['library']}": library,
        f"{place}/METADATA": "\n".join([*metadata, ""]).encode(),
        f"{place}/WHEEL": "\n".join([*wheel, f"Tag: {tag}", ""]).encode(),
        f"{place}/licenses/LICENSE": (ROOT / "LICENSE").read_bytes(),
    }
    record = [f"{name},sha256={_hash(data)},{len(data)}" for name, data in sorted(files.items())]
    files[f"{place}/RECORD"] = "\n".join([*record, f"{place}/RECORD,,", ""]).encode()
    part = path.with_suffix(".part")
    with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, data in files.items():
            entry = zipfile.ZipInfo(name, LONG_AGO)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o100644 << 16
            archive.writestr(entry, data)
    part.replace(path)


_INIT = b'''# SPDX-License-Identifier: GPL-3.0-or-later
"""Compiled kernels of Shock Filter."""
'''


def _hash(data: bytes) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()


def main() -> None:
    """Build the wheels that the command line asks for; all of them by default."""
    parser = argparse.ArgumentParser(description="Build wheels of compiled kernels.")
    parser.add_argument("--platform", nargs="+", choices=PLATFORMS, default=list(PLATFORMS))
    parser.add_argument("--install", type=Path, help="unpack this system's wheel into a folder")
    parser.add_argument("--rehearse", action="store_true", help="only run numba, and keep its IR")
    given = parser.parse_args()
    PLACE.mkdir(exist_ok=True)
    if given.rehearse:
        harvest()
        return
    for platform in given.platform:
        wheel = build(platform)
        print(f"{wheel.stat().st_size / 1e6:6.2f} MB  {wheel.name}", flush=True)
    if given.install:
        wheel = build("linux-x64")
        shutil.rmtree(given.install, ignore_errors=True)
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(given.install)


if __name__ == "__main__":
    main()
