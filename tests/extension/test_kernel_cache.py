# SPDX-License-Identifier: GPL-3.0-or-later
"""The installed extension's compiled code: shared, damaged, or with foreign libraries about.

All paths hold spaces and letters beyond ASCII.
"""

import json
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("cache_process.py")


@pytest.fixture(scope="module")
def resources(extension_zip, run, tmp_path_factory) -> Path:
    """Return a folder of the user's, in which the extension is installed and was never used."""
    folder = tmp_path_factory.mktemp("Blender für 三角形 & co")
    run(SCRIPT, folder, folder / "report.json", "--install", extension_zip)
    return folder


def read(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def together(resources, start, finish) -> list[dict]:
    """Reports of two processes that fill the empty folder at the same time."""
    paths = [resources / "one.json", resources / "other.json"]
    processes = [start(SCRIPT, resources, path) for path in paths]
    for process in processes:
        finish(process)
    return [read(path) for path in paths]


def test_two_processes_share_an_empty_folder(resources, together):
    one, other = together
    for report in together:
        assert report["result"] == ["FINISHED"], report["said"]
        assert report["problem"] == ""
    assert one["pixels"] == other["pixels"]
    assert one["folder"] == other["folder"]
    folder = Path(one["folder"])
    assert resources in folder.parents
    assert list(folder.rglob("*.nbc"))
    assert not list(folder.rglob("*.tmp.*"))


def test_damaged_files_are_replaced(resources, together, run):
    folder = Path(together[0]["folder"])
    codes = sorted(folder.rglob("*.nbc"))
    for path in codes[::3]:
        path.write_bytes(path.read_bytes()[:-7])
    for path in codes[1::3]:
        path.write_bytes(b"")
    damaged = {path: path.stat().st_mtime_ns for path in codes[::3]}
    run(SCRIPT, resources, resources / "again.json")
    report = read(resources / "again.json")
    assert report["result"] == ["FINISHED"], report["said"]
    assert report["pixels"] == together[0]["pixels"]
    assert any(path.stat().st_mtime_ns != before for path, before in damaged.items())


FOREIGN = {
    "an empty numba": {"numba/__init__.py": "__version__ = '0.1'"},
    "a numba that raises": {"numba/__init__.py": "raise RuntimeError('no LLVM here')"},
    "an old llvmlite": {
        "llvmlite/__init__.py": "__version__ = '0.20.0'",
        "llvmlite/binding.py": "def parse_assembly(): pass",
    },
    "a broken scipy": {
        "scipy/__init__.py": "raise ValueError('numpy.dtype size changed')",
    },
}


@pytest.mark.parametrize("files", FOREIGN.values(), ids=FOREIGN)
def test_foreign_libraries_are_named(resources, run, tmp_path, files):
    for name, text in files.items():
        path = tmp_path / "Früher gefunden" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    before = tmp_path / "Früher gefunden"
    run(SCRIPT, resources, tmp_path / "report.json", "--before", before)
    report = read(tmp_path / "report.json")
    assert report["result"] == []
    assert "cannot be loaded" in report["problem"]
    assert "remove other copies" in report["problem"]
    assert str(before) in report["problem"]
    assert report["problem"] in report["said"]
