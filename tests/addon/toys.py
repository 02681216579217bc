# SPDX-License-Identifier: GPL-3.0-or-later
"""A copy of the package to which a filter is added as docs/developing.md says, and runs in it."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import build_kernels
import shock_filter
from shock_filter.core.base import compiled

ROOT = Path(shock_filter.__file__).parent


def tree_with(folder, module, function, settings, filters, modes):
    """Copy the package, and add a filter: a new module and additions to three files.

    Parameters
    ----------
    folder : path
        Where the package is put.
    module : str
        The new module, inside `core`.
    function, settings, filters, modes : str
        Code: of the new module, and what is added to `core/settings.py`, `core/registry.py` and
        `shock_addon/modes.py`.

    Returns
    -------
    path
        The package.
    """
    root = folder / "shock_filter"
    root.mkdir()
    for name in ("__init__.py", "blender_manifest.toml"):
        shutil.copy(ROOT / name, root)
    for name in ("core", "shock_addon"):
        # Compiled kernels come along: their files know which sources they are for.
        shutil.copytree(ROOT / name, root / name, ignore=shutil.ignore_patterns("*.pyc"))
    (root / "core" / f"{module.replace('.', '/')}.py").write_text(function)
    for path, words in (
        ("core/settings.py", settings),
        ("core/registry.py", filters),
        ("shock_addon/modes.py", modes),
    ):
        with open(root / path, "a") as file:
            file.write(words)
    if compiled.library() is not None:
        _lend_kernels(root)
    return root


def _lend_kernels(root):
    # The library serves the copy too; what a toy's kernels need beyond it, numba compiles.
    folder = Path(importlib.util.find_spec(compiled.PACKAGE).origin).parent
    lent = shutil.copytree(folder, root.parent / compiled.PACKAGE)
    about = json.loads((lent / compiled.TABLE).read_text())
    about["sources"] = build_kernels.sources_digest(root / "core")
    (lent / compiled.TABLE).write_text(json.dumps(about))


def run(tree, code, *arguments):
    """Run code in a process of its own that imports the copy; return what it printed."""
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=600,
        env={**os.environ, "PYTHONPATH": str(tree.parent)},
        cwd=tree.parent,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


OUTSIDE = """
import sys
from shock_filter.core import cli
sys.exit(cli.main(sys.argv[1:]))
"""
"""What ``shock-filter`` does."""

IN_BATCH = """
import sys
import bpy, shock_filter
bpy.ops.wm.read_homefile(use_empty=True)
shock_filter.register()
from shock_filter.shock_addon.commands import command_line
code = command_line.run(sys.argv[1:], "blender")
shock_filter.unregister()
sys.exit(code)
"""
"""What ``blender --command shock_filter`` does."""
