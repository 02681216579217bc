# SPDX-License-Identifier: GPL-3.0-or-later
"""Compiled code on disk that is damaged, old, mixed up or not writable: results stay right."""

import importlib.util
import os
import shutil
import sys

import pytest
from shock_filter.core.base import cache_folder, kernel_cache

SOURCE = """
from shock_filter.core.base.parallel import kernel


@kernel
def double(value):
    return value + value
"""

PACKAGE = {
    "__init__.py": "",
    "scaled.py": """
from shock_filter.core.base.parallel import kernel

from .below import (
    factor,
)


@kernel
def scaled(value):
    return factor() * value
""",
    "below/__init__.py": "from .deeper import factor",
    "below/deeper.py": """
from shock_filter.core.base.parallel import kernel

from .. import unrelated, numbers as its_numbers

FACTOR = its_numbers.FACTOR


@kernel
def factor():
    return FACTOR
""",
    "numbers.py": "FACTOR = 2",
    "unrelated.py": "",
}


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Return a function that imports a module with a kernel anew, as another process would."""
    monkeypatch.setattr("numba.config.CACHE_DIR", "")
    path = tmp_path / "doubling.py"
    path.write_text(SOURCE)

    def load():
        spec = importlib.util.spec_from_file_location("doubling", path)
        loaded = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(loaded)
        return loaded

    return load


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Return a package's folder, and a function that imports it anew, as another process would."""
    monkeypatch.setattr("numba.config.CACHE_DIR", "")
    monkeypatch.syspath_prepend(tmp_path)
    folder = tmp_path / "scaling"
    for name, text in PACKAGE.items():
        (folder / name).parent.mkdir(exist_ok=True, parents=True)
        (folder / name).write_text(text)

    def load():
        for name in [name for name in sys.modules if name.partition(".")[0] == "scaling"]:
            del sys.modules[name]
        for remembered in ("_stamp", "_imported", "_text"):
            getattr(kernel_cache, remembered).cache_clear()
        sys.dont_write_bytecode = True  # Python's own cache looks at dates and sizes only
        try:
            return importlib.import_module("scaling.scaled").scaled
        finally:
            sys.dont_write_bytecode = False

    yield folder, load
    for name in [name for name in sys.modules if name.partition(".")[0] == "scaling"]:
        del sys.modules[name]


def misses(function):
    return sum(function.stats.cache_misses.values())


def files(folder, ending):
    return sorted((folder / "__pycache__").glob(f"*.{ending}"))


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.999])
def test_a_file_that_was_cut_short_is_made_anew(tmp_path, module, caplog, ending, share):
    assert module().double(2) == 4
    (file,) = files(tmp_path, ending)
    data = file.read_bytes()
    for damaged in (data[: int(share * len(data))], bytes(len(data))):
        file.write_bytes(damaged)
        caplog.clear()
        again = module().double
        assert again(2) == 4
        assert misses(again) == 1
        assert "damaged" in caplog.text
        after = module().double
        assert after(2) == 4
        assert misses(after) == 0


def test_code_under_the_types_of_other_code_is_not_used(tmp_path, module):
    double = module().double
    assert double(2) == 4
    assert double(2.5) == 5.0
    whole, fraction = files(tmp_path, "nbc")
    fraction.write_bytes(whole.read_bytes())  # as when two processes number it alike
    again = module().double
    assert again(2.5) == 5.0
    assert again(2) == 4
    after = module().double
    assert after(2.5) == 5.0
    assert misses(after) == 0


def test_a_folder_that_is_gone_and_cannot_be_made_costs_time_only(tmp_path, module, caplog):
    double = module().double
    shutil.rmtree(tmp_path / "__pycache__")
    (tmp_path / "__pycache__").write_text("A file where the folder was.")
    assert double(2) == 4
    assert "cannot be kept" in caplog.text


def test_kernels_work_where_no_folder_can_be_written(tmp_path, module, monkeypatch, caplog):
    (tmp_path / "__pycache__").write_text("A file where the folder should be.")
    for name in ("HOME", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.setenv(name, str(tmp_path / "__pycache__" / "below"))
    assert module().double(2) == 4
    assert "not kept" in caplog.text


@pytest.mark.parametrize(
    ("name", "old", "new", "result"),
    [
        ("numbers.py", "2", "3", 15),  # imported by what is imported
        ("below/deeper.py", "return FACTOR", "return FACTOR + 5", 35),
        ("below/__init__.py", "from .deeper import factor", "from .deeper import factor  #", 10),
        ("scaled.py", "* value", "* value + 1", 11),
    ],
)
def test_an_edit_of_what_a_kernel_imports_compiles_it_anew(package, name, old, new, result):
    folder, load = package
    assert load()(5) == 10
    path = folder / name
    dates = path.stat()
    path.write_text(path.read_text().replace(old, new))
    os.utime(path, ns=(dates.st_atime_ns, dates.st_mtime_ns))
    after = load()
    assert after(5) == result
    assert misses(after) == 1
    again = load()
    assert again(5) == result
    assert misses(again) == 0


def test_new_dates_alone_compile_nothing(package):
    folder, load = package
    assert load()(5) == 10
    for path in folder.rglob("*.py"):
        os.utime(path, (1e9, 1e9))
    after = load()
    assert after(5) == 10
    assert misses(after) == 0


def test_files_that_a_kernel_does_not_import_are_left_out_of_it(package):
    folder, load = package
    (folder / "other.py").write_text("")
    assert load()(5) == 10
    (folder / "other.py").write_text("# edited")
    after = load()
    assert after(5) == 10
    assert misses(after) == 0


def test_compiled_code_goes_to_the_chosen_folder(package, tmp_path, monkeypatch):
    folder, load = package
    chosen = tmp_path / "chosen"  # made when needed
    monkeypatch.setattr(cache_folder, "chosen", str(chosen))
    first = load()
    assert first(5) == 10
    assert list(chosen.rglob("scaled.*.nbi"))
    assert not list(folder.rglob("*.nb[ic]"))
    after = load()
    assert after(5) == 10
    assert misses(after) == 0


def test_the_environment_comes_before_the_chosen_folder(package, tmp_path, monkeypatch):
    folder, load = package
    monkeypatch.setattr(cache_folder, "chosen", str(tmp_path / "chosen"))
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "environment"))
    assert load()(5) == 10
    assert list((tmp_path / "environment").rglob("scaled.*.nbi"))
    assert not (tmp_path / "chosen").exists()
    assert not list(folder.rglob("*.nb[ic]"))
