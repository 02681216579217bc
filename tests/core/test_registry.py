# SPDX-License-Identifier: GPL-3.0-or-later
"""The table of filters and what is made from it."""

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from shock_filter import core
from shock_filter.core import registry

ROOT = Path(core.__file__).resolve().parents[1]


@pytest.mark.parametrize("name, module", registry.public_names().items())
def test_each_name_is_there(name, module):
    found = getattr(core, name)
    assert not isinstance(found, ModuleType)  # once loaded, a module hides a name like its own
    assert found.__module__.startswith(f"{core.__name__}.{module}")
    assert found.__name__ == name


def test_other_names_are_refused():
    with pytest.raises(AttributeError, match=f"module '{core.__name__}' has no attribute 'no'"):
        _ = core.no


def test_no_name_is_given_twice():
    given = [name for names in registry.OTHERS.values() for name in names]
    given += [row.name for row in registry.FILTERS]
    given += [row.corners for row in registry.FILTERS if row.corners]
    assert len(set(given)) == len(given)
    commands = [row.command for row in registry.FILTERS]
    assert len(set(commands)) == len(commands)


def test_the_table_loads_no_numerics():
    code = (
        "import sys; from shock_filter.core import registry; registry.kernel_modules()\n"
        "print({'numpy', 'numba', 'scipy'} & set(sys.modules))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert run.stdout == "set()\n", run.stderr


def test_modules_with_kernels_bring_up_the_baseline_too():
    code = (
        "import importlib, sys; from shock_filter.core import registry\n"
        "for name in registry.kernel_modules(): importlib.import_module(name)\n"
        "print(*sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    loaded = {name.partition(".core.")[2] for name in run.stdout.split()}
    folder = Path(core.__file__).parent
    with_kernels = {
        ".".join(path.relative_to(folder).with_suffix("").parts)
        for path in folder.rglob("*.py")
        if "@kernel" in path.read_text(encoding="utf-8")
    }
    assert with_kernels - loaded == set()


def test_what_follows_sharpens_the_same_kind_of_data():
    following = {row.name: registry.find(row.then) for row in registry.FILTERS if row.then}
    assert [registry.find(name).kind for name in following] == [f.kind for f in following.values()]
    assert {row.name for row in following.values()} == {
        "sharpen_geometry",
        "sharpen_vertex_signal",
        "sharpen_image",
    }


def test_a_row_applies_its_settings_and_what_follows():
    image = np.random.default_rng(0).random((9, 8))
    row = registry.find("beltrami_image")
    settings = core.BeltramiSettings(beta=2.0)
    denoised = core.beltrami_image(image, settings)
    np.testing.assert_array_equal(row.applied(settings)(image), denoised)
    both = core.sharpen_image(denoised, core.ImageSettings(time=4.0))
    assert (both != denoised).any()
    np.testing.assert_array_equal(row.applied(settings, 4.0)(image), both)
    with pytest.raises(core.InvalidSettings, match="time is -1"):
        row.applied(settings, -1.0)


def test_the_stub_is_as_the_table_says():
    path = ROOT / "tools" / "write_stub.py"
    spec = importlib.util.spec_from_file_location("write_stub", path)
    write_stub = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(write_stub)
    written = (ROOT / "core" / "__init__.pyi").read_text(encoding="utf-8")
    assert written == write_stub.stub(registry.public_names()), "run python tools/write_stub.py"
