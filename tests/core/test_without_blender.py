# SPDX-License-Identifier: GPL-3.0-or-later
"""The core is for everyone: nothing in it may want Blender, and what hosts run no scipy."""

import ast
import json
import subprocess
import sys
from pathlib import Path

from shock_filter import core

IMPORT_ALL = """
import importlib, json, pkgutil, sys
for name in ("bpy", "mathutils", "gpu", "bmesh", "blf", "addon_utils", "bl_ext"):
    sys.modules[name] = None  # importing it fails
from shock_filter import core
names = [each.name for each in pkgutil.walk_packages(core.__path__, core.__name__ + ".")]
names.remove(core.__name__ + ".cli.__main__")  # which runs when it is imported
for name in names:
    importlib.import_module(name)
print(json.dumps(names))
"""


def test_all_of_the_core_is_imported_without_blender():
    done = subprocess.run([sys.executable, "-c", IMPORT_ALL], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    names = json.loads(done.stdout)
    root = Path(core.__file__).parent
    modules = {path.relative_to(root).with_suffix("").parts for path in root.rglob("*.py")}
    expected = {".".join(p for p in parts if p != "__init__") for parts in modules} - {
        "",
        "cli.__main__",
    }
    assert {name.removeprefix(f"{core.__name__}.") for name in names} == expected


IMPORT_DATA = """
import importlib, pkgutil, sys
for name in ("numba", "scipy"):
    sys.modules[name] = None
from shock_filter.core.host import edge_marks, inputs, mosaic, recolored
from shock_filter.core.preview import arrows, crop, dials, patch, screen_colors
"""


def test_what_a_host_reads_and_shows_needs_no_kernels():
    done = subprocess.run([sys.executable, "-c", IMPORT_DATA], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


IMPORT_KERNELS = """
import importlib, sys
sys.modules["scipy"] = None
from shock_filter.core import registry
for name in registry.kernel_modules():
    importlib.import_module(name)
"""


def test_what_filters_run_is_imported_without_scipy():
    done = subprocess.run([sys.executable, "-c", IMPORT_KERNELS], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_scipy_is_imported_only_for_matrices_that_callers_made_with_it():
    root = Path(core.__file__).parent
    users = []
    for path in root.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [each.name for each in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            if any(name.partition(".")[0] == "scipy" for name in names):
                users.append((path.relative_to(root).as_posix(), node.col_offset > 0))
    assert users == [("linear/system.py", True)]  # within a function
