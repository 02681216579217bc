# SPDX-License-Identifier: GPL-3.0-or-later
"""Wheels that are downloaded by version and hash, so that an index cannot hand out others.

``tools/wheels.txt`` has a line for each version, as pip reads them: the hashes of the wheels for
the platforms and Pythons in use. ``python tools/wheel_hashes.py`` writes it anew after a version
changed. It trusts what the index hands out then: compare with what the packages' own pages say.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

HASHES = Path(__file__).resolve().parent / "wheels.txt"


def line_of(requirement: str, hashes: Path = HASHES) -> str:
    """Return the line of a pinned requirement, such as ``scipy==1.15.3``, with its hashes."""
    for line in hashes.read_text(encoding="utf-8").splitlines():
        if line.split(" ")[0] == requirement:
            return line
    raise SystemExit(f"{hashes.name} has no hashes of {requirement}; run tools/wheel_hashes.py.")


def download(
    requirement: str,
    folder: Path,
    words: Sequence[str] = (),
    hashes: Path = HASHES,
    python: str = sys.executable,
) -> bool:
    """Download a pinned wheel by pip, which refuses one with another hash; whether it worked."""
    with tempfile.TemporaryDirectory() as temporary:
        file = Path(temporary, "requirement.txt")
        file.write_text(line_of(requirement, hashes) + "\n", encoding="utf-8")
        command = [python, "-m", "pip", "download", "--quiet", "--no-deps", "--require-hashes"]
        command += ["--only-binary=:all:", f"--dest={folder}", *words, "--requirement", str(file)]
        return not subprocess.run(command).returncode


def check(wheel: Path, requirement: str, hashes: Path = HASHES) -> None:
    """Refuse a wheel that lay there already, and is not one of those that are known."""
    if f"--hash=sha256:{digest(wheel)}" not in line_of(requirement, hashes).split():
        raise SystemExit(f"{wheel} is not the wheel of {requirement} that is known; remove it.")


def digest(path: Path) -> str:
    """Return a file's hash, as pip writes it."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def write(wanted: dict[str, list[list[str]]], hashes: Path = HASHES) -> None:
    """Download each requirement once for each list of pip's words, and write all hashes."""
    lines = []
    for requirement in sorted(wanted):
        found = set()
        for words in wanted[requirement]:
            with tempfile.TemporaryDirectory() as folder:
                command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps"]
                command += ["--only-binary=:all:", f"--dest={folder}", *words, requirement]
                subprocess.run(command, check=True)
                found |= {digest(wheel) for wheel in Path(folder).iterdir()}
        lines.append(" ".join([requirement, *(f"--hash=sha256:{each}" for each in sorted(found))]))
    hashes.write_text("\n".join(lines) + "\n", encoding="utf-8")


def in_use() -> dict[str, list[list[str]]]:
    """Return all that is downloaded: what zips carry, and Blender as a Python package."""
    import build_extension

    wanted: dict[str, list[list[str]]] = {}
    for platform in build_extension.PLATFORMS:
        requirements = build_extension.REQUIREMENTS_ON.get(platform, build_extension.REQUIREMENTS)
        for series in build_extension.SERIES.values():
            for requirement in requirements:
                words = build_extension.pip_words(platform, series.python)
                wanted.setdefault(requirement, []).append(words)
    for python, requirements in build_extension.REQUIREMENTS_IN_WINDOWS.items():
        for requirement in requirements:
            words = build_extension.pip_words("linux-x64", python)
            wanted.setdefault(requirement, []).append(words)
    for requirement, python in build_extension.BLENDERS.items():
        for platform in ("manylinux_2_28_x86_64", "win_amd64", "macosx_12_0_arm64"):
            words = [f"--platform={platform}", f"--python-version={python}"]
            wanted.setdefault(requirement, []).append(words)
    return wanted


if __name__ == "__main__":
    write(in_use())
