# SPDX-License-Identifier: GPL-3.0-or-later
"""The table of filters and what is made from it."""

import importlib.util
import json
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import build_kernels
import numpy as np
import pytest
import write_stub
from shock_filter import core
from shock_filter.core import registry
from shock_filter.core.base import compiled

ROOT = Path(core.__file__).resolve().parents[1]


@pytest.mark.parametrize("name, module", registry.public_names().items())
def test_each_name_is_there(name, module):
    found = getattr(core, name)
    assert not isinstance(found, ModuleType)  # once loaded, a module hides a name like its own
    assert found.__module__.startswith(f"{core.__name__}.{module}")
    assert getattr(sys.modules[found.__module__], name) is found


@pytest.mark.parametrize("row", registry.FILTERS, ids=lambda row: row.name)
def test_each_row_loads_the_function_that_it_names(row):
    assert row.load() is getattr(core, row.name)
    for name, load in ((row.corners, row.load_corners), (row.vertices, row.load_vertices)):
        assert bool(name) == bool(load)
        assert not name or load() is getattr(core, name)


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
        "sharpen_texture",
    }


def test_a_row_gives_its_function_and_what_follows():
    image = np.random.default_rng(0).random((9, 8))
    row = registry.find("beltrami_image")
    settings = core.BeltramiSettings(beta=2.0)
    denoised = core.beltrami_image(image, settings)
    np.testing.assert_array_equal(row.function()(image, settings=settings), denoised)
    both = core.sharpen_image(denoised, core.ImageSettings(time=4.0))
    assert (both != denoised).any()
    np.testing.assert_array_equal(row.function(4.0)(image, settings=settings), both)
    with pytest.raises(core.InvalidSettings, match="time is -1"):
        row.function(-1.0)


def test_the_stub_is_as_the_table_says():
    written = (ROOT / "core" / "__init__.pyi").read_text(encoding="utf-8")
    assert written == write_stub.stub(registry.public_names()), "run python tools/write_stub.py"


NEW_SETTINGS = '''

@dataclass(kw_only=True, repr=False, eq=False)
class InvertSettings(_Settings):
    """Settings of :func:`shock_filter.core.invert_image`."""

    white: float = _setting(1.0, "The value that black becomes. 0 is no use", maximum=9.0)
'''
NEW_MODULE = """
def invert_image(image, settings=None, mask=None, progress=None):
    return (settings.white - image) if mask is None else image


def invert_vertex_signal(mesh, signal, settings=None, mask=None, progress=None):
    return settings.white - signal
"""
NEW_LOADERS = """
def _invert_image():
    from .color.invert import invert_image

    return invert_image


def _invert_vertex_signal():
    from .color.invert import invert_vertex_signal

    return invert_vertex_signal


"""
NEW_ROWS = """
    Filter("invert_image", "color.invert", _settings.InvertSettings, IMAGE, "invert-image",
           "turn images to their negatives", _invert_image),
    Filter("invert_vertex_signal", "color.invert", _settings.InvertSettings, COLORS,
           "invert-colors", "turn colors to their negatives", _invert_vertex_signal),
"""


def lend_kernels(core_copy, folder):
    """Let a copy of the core, whose kernels are the same, use compiled ones if there are any."""
    spec = importlib.util.find_spec(compiled.PACKAGE)
    if spec is not None:
        shutil.copytree(Path(spec.origin).parent, folder / compiled.PACKAGE)
        table = folder / compiled.PACKAGE / compiled.TABLE
        about = json.loads(table.read_text("utf-8"))
        about["sources"] = build_kernels.sources_digest(core_copy)
        table.write_text(json.dumps(about), "utf-8")


def test_a_new_filter_is_settings_a_module_and_a_row(tmp_path):
    package = tmp_path / "shock_filter"
    shutil.copytree(ROOT / "core", package / "core", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("__init__.py", "blender_manifest.toml"):
        shutil.copy(ROOT / name, package)
    with (package / "core" / "settings.py").open("a") as file:
        file.write(NEW_SETTINGS)
    (package / "core" / "color" / "invert.py").write_text(NEW_MODULE)
    table = package / "core" / "registry.py"
    before, start, after = table.read_text().partition("FILTERS: tuple[Filter, ...] = (")
    table.write_text(before + NEW_LOADERS + start + NEW_ROWS + after)
    lend_kernels(package / "core", tmp_path)

    np.save(tmp_path / "in.npy", np.full((4, 5), 0.25))
    rows = ["0 0 0 255 0 51", "1 0 0 255 0 51", "0 1 0 255 0 51", "3 0 1 2"]
    names = [f"property float {name}" for name in "xyz"]
    names += [f"property uchar {name}" for name in ("red", "green", "blue")]
    head = ["ply", "format ascii 1.0", "element vertex 3", *names]
    head += ["element face 1", "property list uchar int vertex_indices", "end_header"]
    (tmp_path / "in.ply").write_text("\n".join([*head, *rows]) + "\n")
    code = """
from shock_filter import core
from shock_filter.core import cli
print({"InvertSettings", "invert_image", "invert_vertex_signal"} <= set(core.__all__))
print(core.invert_image(1.0, core.InvertSettings(white=3)))
print(cli.main(["invert-image", "in.npy", "out.npy", "--white", "2", "--quiet"]))
print(cli.main(["invert-colors", "in.ply", "out.ply", "--quiet"]))
"""
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=300
    )
    assert run.stdout.split() == ["True", "2.0", "0", "0"], run.stderr
    np.testing.assert_array_equal(np.load(tmp_path / "out.npy"), np.full((4, 5), 1.75))
    assert "0 1 0 0 255 204\n" in (tmp_path / "out.ply").read_text()
