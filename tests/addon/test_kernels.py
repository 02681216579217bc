# SPDX-License-Identifier: GPL-3.0-or-later
"""Where compiled code is kept when the add-on is an installed extension."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import shock_filter
from shock_filter.shock_addon.running import kernels

ROOT = Path(shock_filter.__file__).parent
MODULE = "bl_ext.user_default.shock_filter"

RUN = """
import json, os, sys
import bpy
import addon_utils  # bpy puts it within reach
addon_utils.extensions_refresh(ensure_wheels=False)
assert addon_utils.enable(NAME, default_set=True) is not None
bpy.ops.wm.read_homefile(use_empty=True)
import importlib
kernels = importlib.import_module(NAME + ".shock_addon.running.kernels")
cache = importlib.import_module(NAME + ".core.base.cache_folder")
result = []
if sys.argv[1:] == ["load only"]:
    kernels.choose_folder()
    kernels.load()
elif sys.argv[1:] == ["console"]:
    osher_rudin = importlib.import_module(NAME + ".core.color.osher_rudin")
    import numpy as np
    osher_rudin.osher_rudin_image(np.eye(8), steps=1)
else:
    bpy.ops.mesh.primitive_uv_sphere_add()
    result = bpy.ops.shock_filter.sharpen_geometry(feature_threshold=0.0)
base = importlib.import_module(NAME + ".shock_addon.operators.base")
mesh = importlib.import_module(NAME + ".core.mesh.adjacency")
import numba
state = {
    "result": list(result),
    "folder": cache.chosen,
    "kept": mesh._pair.stats.cache_path,
    "misses": sum(mesh._pair.stats.cache_misses.values()),
    "setting": numba.config.CACHE_DIR,
    "temporary": bpy.app.tempdir,
    "said": base.summaries.get("geometry", ""),
    "seconds": kernels.seconds_compiling(),
}
addon_utils.disable(NAME)
state["after"] = cache.chosen
print(json.dumps(state))
"""


@pytest.fixture(scope="module")
def resources(tmp_path_factory):
    """A user folder of Blender in which the add-on lies as an extension."""
    folder = tmp_path_factory.mktemp("resources")
    extension = folder / "extensions" / "user_default" / "shock_filter"
    ignored = shutil.ignore_patterns("__pycache__", "batch.py")
    shutil.copytree(ROOT / "core", extension / "core", ignore=ignored)
    shutil.copytree(ROOT / "shock_addon", extension / "shock_addon", ignore=ignored)
    for name in ("__init__.py", "blender_manifest.toml"):
        shutil.copy(ROOT / name, extension / name)
    return folder


def run(resources, *arguments):
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(resources)}
    environment.pop("NUMBA_CACHE_DIR", None)
    done = subprocess.run(
        [sys.executable, "-c", f"NAME = {MODULE!r}\n{RUN}", *arguments],
        capture_output=True,
        text=True,
        timeout=300,
        env=environment,
        cwd=resources,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def written(folder):
    return sorted(
        str(path.relative_to(folder))
        for path in folder.rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    )


def test_compiled_code_goes_to_the_user_folder_and_is_used_again(resources):
    extension = resources / "extensions" / "user_default" / "shock_filter"
    before = written(extension)
    first = run(resources)
    assert first["result"] == ["FINISHED"]
    folder = Path(first["folder"])
    assert folder.name == f"kernels-{shock_filter.__version__}"
    assert resources in folder.parents
    assert extension not in folder.parents
    assert folder == Path(first["kept"])
    assert first["misses"] == 1
    assert f"Compiling took {first['seconds']:.1f} s of it" in first["said"]
    assert first["setting"] == ""
    assert first["after"] is None
    assert any(name.endswith(".nbc") for name in written(folder))
    assert written(extension) == before

    second = run(resources)
    assert second["misses"] == 0
    assert second["seconds"] == 0
    assert "Compiling" not in second["said"]
    assert written(extension) == before


def test_kernels_that_the_console_imports_go_there_too(resources):
    extension = resources / "extensions" / "user_default" / "shock_filter"
    before = written(extension)
    state = run(resources, "console")
    assert resources in Path(state["folder"]).parents
    assert any("pde" in name for name in written(Path(state["folder"])))
    assert written(extension) == before


def test_a_folder_that_cannot_be_made_is_replaced_by_a_temporary_one(resources):
    user = resources / "extensions" / ".user"
    shutil.rmtree(user, ignore_errors=True)
    user.write_text("A file where the folder should be.")
    extension = resources / "extensions" / "user_default" / "shock_filter"
    before = written(extension)
    state = run(resources, "load only")
    assert state["kept"].startswith(state["temporary"])
    assert written(extension) == before


@pytest.mark.parametrize(
    ("there", "kept"),
    [
        ([], None),
        (["kernels-1"], "kernels-1"),
        (["kernels-1", "kernels-2"], "kernels-2"),  # the one that was used last
        (["kernels-2", "kernels-3"], "kernels-3"),
    ],
)
def test_a_version_goes_on_with_what_another_has_compiled(tmp_path, there, kept):
    for age, name in enumerate(there):
        (tmp_path / name).mkdir()
        (tmp_path / name / "code").write_text(name)
        os.utime(tmp_path / name, (age, age))
    (tmp_path / "other").mkdir()
    kernels._take_over(str(tmp_path / "kernels-3"))
    left = {path.name for path in tmp_path.iterdir()}
    assert left == ({"kernels-3", "other"} if kept else {"other"})
    assert kept is None or (tmp_path / "kernels-3" / "code").read_text() == kept


def test_without_a_user_folder_nothing_is_taken_over(tmp_path):
    kernels._take_over(str(tmp_path / "nowhere" / "kernels-3"))
    assert list(tmp_path.iterdir()) == []
