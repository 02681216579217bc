# SPDX-License-Identifier: GPL-3.0-or-later
"""Compiled code on disk that is damaged, old, mixed up or not writable: results stay right."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from shock_filter.core.base import kernel_cache

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


def files(folder):
    return sorted((folder / "__pycache__").glob("*.nb[ic]"))


LASTING = ["a folder", "in a folder that is not writable"]


@pytest.fixture(scope="module")
def damaged(tmp_path_factory):
    """What two loads after each damage returned and how often they compiled, by its name."""
    folder = tmp_path_factory.mktemp("damaged")
    (folder / "doubling.py").write_text(SOURCE)
    command = [sys.executable, Path(__file__).with_name("damaged_kernel.py"), folder]
    if os.geteuid() == 0:  # for whom all files are readable and writable
        without = "--bounding-set=-dac_override,-dac_read_search"
        command[:0] = ["setpriv", "--inh-caps=-all", without]
    environment = {**os.environ, "NUMBA_CACHE_DIR": "", "XDG_CACHE_HOME": str(folder / "cache")}
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment)
    begun = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0, f"{done.returncode} after {begun[-1]}\n{done.stderr}"
    return {name: seen for name, *seen in begun if seen}


def test_whatever_is_damaged_is_compiled_again_and_mended(damaged):
    mended = {name: seen for name, seen in damaged.items() if name not in LASTING}
    assert len(mended) == 20
    assert all(seen == [[4, 1], [4, 0]] for seen in mended.values()), mended


@pytest.mark.parametrize("name", LASTING)
def test_what_cannot_be_mended_costs_time_only(damaged, name):
    first, second = damaged[name]
    assert first == [4, 1]
    assert second[0] == 4


def test_processes_that_fill_a_folder_at_once_do_not_disturb_each_other(tmp_path):
    (tmp_path / "doubling.py").write_text(SOURCE)
    code = "import doubling, sys; assert [doubling.double(x) for x in eval(sys.argv[1])] == [4, 5]"
    paths = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "NUMBA_CACHE_DIR": "", "PYTHONPATH": paths}
    started = [
        subprocess.Popen([sys.executable, "-c", code, values], env=environment)
        for values in ("(2, 2.5)", "(2.0, 2.5)", "(2, 2.5)")
    ]
    assert [process.wait(300) for process in started] == [0, 0, 0]
    assert len(files(tmp_path)) == 2


def test_an_edited_kernel_takes_the_place_of_the_old_one(package):
    folder, load = package
    assert load()(5) == 10
    before = files(folder)
    (folder / "scaled.py").write_text(PACKAGE["scaled.py"].replace("* value", "* value + 1"))
    assert load()(5) == 11
    assert files(folder) == before


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


def test_compiled_code_goes_to_the_folder_of_the_environment(package, tmp_path, monkeypatch):
    folder, load = package
    chosen = tmp_path / "chosen"  # made when needed
    monkeypatch.setattr("numba.config.CACHE_DIR", str(chosen))
    first = load()
    assert first(5) == 10
    assert list(chosen.rglob("scaled.*.nbc"))
    assert not list(folder.rglob("*.nb[ic]"))
    after = load()
    assert after(5) == 10
    assert misses(after) == 0
