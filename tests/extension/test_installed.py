# SPDX-License-Identifier: GPL-3.0-or-later
"""The zip, installed into a Blender that has neither scipy nor numba."""

import json
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import build_kernels
import pytest

PACKAGE = build_kernels.package_name(build_kernels.version())
MANUAL = "manual"


@pytest.fixture(scope="module")
def processes(extension_zip: Path, run: Callable[..., str]):
    """Reports of two Blender processes: the first installs the zip, the second finds it there."""
    script = Path(__file__).with_name("blender_process.py")
    with tempfile.TemporaryDirectory() as folder:
        resources = Path(folder) / "resources"
        reports = [Path(folder) / "first.json", Path(folder) / "second.json"]
        resources.mkdir()
        run(script, resources, reports[0], extension_zip)
        run(script, resources, reports[1])
        yield [json.loads(report.read_text(encoding="utf-8")) for report in reports]


@pytest.fixture(scope="module")
def first(processes):
    return processes[0]


@pytest.fixture(scope="module")
def second(processes):
    return processes[1]


def test_zip_holds_the_extension_and_nothing_else(extension_zip):
    with zipfile.ZipFile(extension_zip) as archive:
        names = archive.namelist()
    assert len(names) == len(set(names))
    assert {name.split("/")[0] for name in names} == {
        "BUNDLED.md",
        "LICENSE",
        "README.md",
        "__init__.py",
        "blender_manifest.toml",
        "core",
        "manual",
        "shock_addon",
        "wheels",
    }
    wheels = [Path(name).name.split("-")[0] for name in names if name.endswith(".whl")]
    assert wheels == [PACKAGE]
    assert not [name for name in names if "__pycache__" in name]


def test_environment_was_bare(first):
    assert first["found_before"] == [], "run this test with `nox -s test_blender`"


def test_enabling_registers_the_operator_and_imports_nothing_heavy(first, second):
    for process in (first, second):
        assert process["enabled"]
        assert process["imported_by_enabling"] == []


def test_operator_sharpens_the_rounded_edges(first, second):
    for run_ in (first["first"], first["second"], first["after_enabling_again"], second["first"]):
        assert run_["result"] == ["FINISHED"]
        before, after = run_["roundness"]
        assert after < 0.7 * before
        assert 0.01 < run_["farthest"] < 0.2  # corners go back farthest, less than two edges
    assert second["first"]["farthest"] == pytest.approx(first["first"]["farthest"], rel=1e-3)


@pytest.mark.parametrize("what", ["colors", "image", "texture"])
def test_operators_steepen_soft_edges(first, second, what):
    for process in (first, second):
        assert process[what]["result"] == ["FINISHED"]
        before, after = process[what]["steepest"]
        assert after > 1.5 * before


@pytest.mark.parametrize("what", ["denoise", "denoise_image"])
def test_operators_remove_noise(first, second, what):
    for process in (first, second):
        assert process[what]["result"] == ["FINISHED"]
        for before, after in zip(*process[what]["noises"], strict=True):
            assert after < 0.5 * before


def test_kernels_come_from_the_extensions_own_wheel(first):
    assert "/extensions/.local/lib/" in first["kernels_at"]
    assert first["heavy_in_use"] == []


def test_right_click_leads_into_the_extensions_own_manual(first, second):
    for process in (first, second):
        for url in process["manual"].values():
            assert url.isascii() and url.startswith("file:///")
            assert f"/{MANUAL}/" in url
    assert all(process["manual_is_there"] for process in (first, second))


def test_disabling_leaves_nothing_registered(first):
    assert not first["left_registered"]


def test_extension_folder_is_left_alone(first, second):
    for process in (first, second):
        before, after = process["extension_before"], process["extension_after"]
        changed = [name for name in after if after[name] != before.get(name)]
        assert [name for name in changed if not name.endswith(".pyc")] == []
        assert before.keys() <= after.keys()


def test_nothing_is_kept_in_the_user_folder(first, second, capsys):
    assert first["user_folder"] == second["user_folder"] == {}
    with capsys.disabled():
        print(f"\nfirst call: {first['first']['seconds']:.2f} s")
