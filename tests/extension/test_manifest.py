# SPDX-License-Identifier: GPL-3.0-or-later
"""The manifest agrees with the package and with what each zip carries."""

import tomllib
from pathlib import Path

import build_extension
import pytest


def test_every_package_is_installed_by_pip(root):
    settings = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    sources = [*root.glob("core/**/*.py"), *root.glob("shock_addon/**/*.py")]
    folders = {source.parent.relative_to(root) for source in sources}
    packages = {".".join(("shock_filter", *folder.parts)) for folder in folders}
    assert set(settings["tool"]["setuptools"]["packages"]) == {"shock_filter", *packages}


def test_tests_use_the_libraries_that_the_zips_carry(root):
    settings = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    tested = settings["project"]["optional-dependencies"]["blender"]
    assert set(build_extension.REQUIREMENTS) <= set(tested)


@pytest.mark.parametrize("platform", ["linux-x64", "windows-x64", "macos-arm64", "macos-x64"])
@pytest.mark.parametrize(
    ("series", "oldest", "end"), [("4.2", "4.2.0", "5.1.0"), ("5.1", "5.1.0", None)]
)
def test_each_zip_names_its_platform_blender_and_wheels(platform, series, oldest, end):
    wheels = [Path("scipy-1.15.3-cp311-cp311-any.whl"), Path("numba-0.62.1-cp311-cp311-any.whl")]
    text = build_extension.complete_manifest(platform, build_extension.SERIES[series], wheels)
    manifest = tomllib.loads(text)
    assert manifest["blender_version_min"] == oldest
    assert manifest.get("blender_version_max") == end
    assert manifest["platforms"] == [platform]
    assert manifest["wheels"] == [f"./wheels/{wheel.name}" for wheel in wheels]
    assert manifest["permissions"].keys() == {"files"}
