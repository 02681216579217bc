# SPDX-License-Identifier: GPL-3.0-or-later
"""Wheels that are downloaded by version and hash, so that an index cannot hand out others.

``tools/wheels.txt`` has a line for each version, as pip reads them: the hashes of the wheels for
the platforms and Pythons in use; `write_wheel_hashes` writes it.
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
    raise SystemExit(
        f"{hashes.name} has no hashes of {requirement}; run tools/write_wheel_hashes.py."
    )


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
