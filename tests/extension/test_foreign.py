# SPDX-License-Identifier: GPL-3.0-or-later
"""The installed extension beside libraries of others that are broken: it uses none of them.

All paths hold spaces and letters beyond ASCII.
"""

import json
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("foreign_process.py")

FOREIGN = {
    "numba": "raise RuntimeError('no LLVM here')",
    "llvmlite": "__version__ = '0.20.0'",
    "scipy": "raise ValueError('numpy.dtype size changed')",
}


@pytest.fixture(scope="module")
def resources(extension_zip, run, tmp_path_factory) -> Path:
    """Return a folder of the user's, in which the extension is installed."""
    folder = tmp_path_factory.mktemp("Blender für 三角形 & co")
    run(SCRIPT, folder, folder / "report.json", "--install", extension_zip)
    return folder


@pytest.mark.parametrize("name", FOREIGN)
def test_foreign_libraries_do_no_harm(resources, run, tmp_path, name):
    before = tmp_path / "Früher gefunden"
    before.mkdir()
    (before / f"{name}.py").write_text(FOREIGN[name])
    run(SCRIPT, resources, tmp_path / "report.json", "--before", before)
    report = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert report["problem"] == ""
    assert report["result"] == ["FINISHED"], report["said"]
