# SPDX-License-Identifier: GPL-3.0-or-later
"""The manifest agrees with the package and with what each zip carries."""

import tomllib
from pathlib import Path

import build_extension
import build_kernels
import pytest


def test_every_package_is_installed_by_pip(root):
    settings = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    sources = [*root.glob("core/**/*.py"), *root.glob("shock_addon/**/*.py")]
    folders = {source.parent.relative_to(root) for source in sources}
    packages = {".".join(("shock_filter", *folder.parts)) for folder in folders}
    assert set(settings["tool"]["setuptools"]["packages"]) == {"shock_filter", *packages}


@pytest.mark.parametrize("platform", ["linux-x64", "windows-x64", "macos-arm64", "macos-x64"])
def test_each_zip_names_its_platform_blender_and_wheels(platform):
    wheels = [Path(build_kernels.wheel_name(platform))]
    manifest = tomllib.loads(build_extension.complete_manifest(platform, wheels))
    assert manifest["blender_version_min"] == "4.2.0"
    assert "blender_version_max" not in manifest
    assert manifest["platforms"] == [platform]
    assert manifest["wheels"] == [f"./wheels/{wheel.name}" for wheel in wheels]
    assert manifest["permissions"].keys() == {"files"}
