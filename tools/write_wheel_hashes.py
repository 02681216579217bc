# SPDX-License-Identifier: GPL-3.0-or-later
"""Write ``tools/wheels.txt`` anew after a version changed: ``python tools/write_wheel_hashes.py``.

It trusts what the index hands out: compare with what the packages' own pages say.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import build_extension
from wheel_hashes import HASHES, digest


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
    """Return all that is downloaded so: Blender as a Python package."""
    wanted: dict[str, list[list[str]]] = {}
    for requirement, python in build_extension.BLENDERS.items():
        for platform in ("manylinux_2_28_x86_64", "win_amd64", "macosx_12_0_arm64"):
            words = [f"--platform={platform}", f"--python-version={python}"]
            wanted.setdefault(requirement, []).append(words)
    return wanted


if __name__ == "__main__":
    write(in_use())
