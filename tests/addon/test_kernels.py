# SPDX-License-Identifier: GPL-3.0-or-later
"""Loading of the kernels, and what earlier versions have left in the user folder."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import shock_filter
from shock_filter.core.base import compiled
from shock_filter.shock_addon.running import jobs, kernels

ROOT = Path(shock_filter.__file__).parent
MODULE = "bl_ext.user_default.shock_filter"

RUN = """
import json
import bpy
import addon_utils  # bpy puts it within reach
from pathlib import Path
addon_utils.extensions_refresh(ensure_wheels=False)
user = Path(bpy.utils.extension_path_user(NAME, create=True))
for name in ("kernels-0.0.9", "kernels-0.1.0-nightly", "kernels-own", "other"):
    (user / name).mkdir()
    (user / name / "code").write_text("")
(user / "kernels-1.0").write_text("a file")
(user / "kernels-2.0").symlink_to(user / "other")
assert addon_utils.enable(NAME, default_set=True) is not None
print(json.dumps([str(user), sorted(str(path.relative_to(user)) for path in user.rglob("*"))]))
addon_utils.disable(NAME)
"""


@pytest.fixture(autouse=True)
def forgotten():
    """Forget what was found about kernels."""
    kernels.unregister()
    yield
    jobs.stop_all()
    kernels.unregister()


def test_folders_of_earlier_versions_are_removed_and_nothing_else(tmp_path):
    extension = tmp_path / "extensions" / "user_default" / "shock_filter"
    ignored = shutil.ignore_patterns("__pycache__", "batch.py")
    shutil.copytree(ROOT / "core", extension / "core", ignore=ignored)
    shutil.copytree(ROOT / "shock_addon", extension / "shock_addon", ignore=ignored)
    for name in ("__init__.py", "blender_manifest.toml"):
        shutil.copy(ROOT / name, extension / name)
    done = subprocess.run(
        [sys.executable, "-c", f"NAME = {MODULE!r}\n{RUN}"],
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "BLENDER_USER_RESOURCES": str(tmp_path)},
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    user, left = json.loads(done.stdout.splitlines()[-1])
    assert tmp_path in Path(user).parents
    assert left == ["kernels-1.0", "kernels-2.0", "kernels-own", "kernels-own/code", "other",
                    "other/code"]  # fmt: skip


def test_without_a_user_folder_nothing_happens(tmp_path):
    kernels._remove_old(str(tmp_path / "nowhere"))
    assert list(tmp_path.iterdir()) == []


def test_what_is_wrong_with_the_library_is_said_and_nothing_is_imported(monkeypatch):
    monkeypatch.setattr(compiled, "library_problem", lambda: "It is for another system.")
    monkeypatch.setattr(kernels.registry, "kernel_modules", lambda: pytest.fail("imported"))
    assert kernels.problem() == "It is for another system."
    with pytest.raises(kernels.KernelsUnavailable, match="It is for another system"):
        kernels.load()


def test_a_module_that_cannot_be_imported_is_said_until_it_can(monkeypatch, caplog):
    monkeypatch.setattr(kernels.registry, "kernel_modules", lambda: ["no_such_module"])
    assert kernels.problem() == ""
    with pytest.raises(kernels.KernelsUnavailable, match="No module named 'no_such_module'"):
        kernels.load()
    assert "install the Shock Filter zip" in kernels.problem()
    monkeypatch.undo()
    kernels.load()
    assert kernels.problem() == ""


def test_kernels_are_loaded_once_when_the_tab_is_first_seen(monkeypatch):
    loaded = []
    monkeypatch.setattr(kernels, "load", lambda: loaded.append(1))
    for _ in range(3):
        kernels.tab_is_seen()
    jobs.stop_all()  # as disabling does: it waits
    assert loaded == [1]
    kernels.unregister()
    kernels.tab_is_seen()
    jobs.stop_all()
    assert loaded == [1, 1]
