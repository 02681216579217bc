# SPDX-License-Identifier: GPL-3.0-or-later
"""The manifest agrees with the package and with what each zip carries."""

import importlib.util
import re
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="module")
def build_extension(root: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(
        "build_extension", root / "tools" / "build_extension.py"
    )
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def test_version_is_the_package_version(root):
    manifest = tomllib.loads((root / "blender_manifest.toml").read_text(encoding="utf-8"))
    source = (root / "__init__.py").read_text(encoding="utf-8")
    assert manifest["version"] == re.search(r'^__version__ = "(.+)"$', source, re.M)[1]
    assert manifest["id"] == "shock_filter"


def test_every_package_is_installed_by_pip(root):
    settings = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    sources = [*root.glob("core/**/*.py"), *root.glob("shock_addon/**/*.py")]
    folders = {source.parent.relative_to(root) for source in sources}
    packages = {".".join(("shock_filter", *folder.parts)) for folder in folders}
    assert set(settings["tool"]["setuptools"]["packages"]) == {"shock_filter", *packages}


def test_tests_use_the_libraries_that_the_zips_carry(root, build_extension):
    settings = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    tested = settings["project"]["optional-dependencies"]["blender"]
    assert set(build_extension.REQUIREMENTS) <= set(tested)


@pytest.mark.parametrize("platform", ["linux-x64", "windows-x64", "macos-arm64", "macos-x64"])
@pytest.mark.parametrize(
    ("series", "oldest", "end"), [("4.2", "4.2.0", "5.1.0"), ("5.1", "5.1.0", None)]
)
def test_each_zip_names_its_platform_blender_and_wheels(
    build_extension, platform, series, oldest, end
):
    wheels = [Path("scipy-1.15.3-cp311-cp311-any.whl"), Path("numba-0.62.1-cp311-cp311-any.whl")]
    text = build_extension.complete_manifest(platform, build_extension.SERIES[series], wheels)
    manifest = tomllib.loads(text)
    assert manifest["blender_version_min"] == oldest
    assert manifest.get("blender_version_max") == end
    assert manifest["platforms"] == [platform]
    assert manifest["wheels"] == [f"./wheels/{wheel.name}" for wheel in wheels]
    assert manifest["permissions"].keys() == {"files"}
