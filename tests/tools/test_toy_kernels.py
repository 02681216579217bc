# SPDX-License-Identifier: GPL-3.0-or-later
"""Kernels through the whole way: harvested, compiled, linked, loaded and called without numba."""

import os
import resource
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import build_kernels
import numpy as np
import pytest
from shock_filter.core.base import compiled

HERE = Path(__file__).parent
TOOLS = build_kernels.ROOT / "tools" / "kernels"
sys.path.insert(0, str(TOOLS))
import compiler  # noqa: E402
import replay  # noqa: E402
import toy_kernels  # noqa: E402
from records import read  # noqa: E402

HARVEST = """
import sys
from pathlib import Path
sys.path += sys.argv[1:3]
import harvest
harvest.record()
import toy_kernels
from records import write
for kernel, arguments in toy_kernels.calls():
    kernel(*arguments)
write(Path(sys.argv[3]), harvest.recorded())
"""


def harvested(folder, path):
    """Harvest the toy kernels of a folder, as `build_kernels` does."""
    words = [sys.executable, "-c", HARVEST, str(folder), str(TOOLS), str(path)]
    subprocess.run(words, check=True, env={**os.environ, "PYTHONHASHSEED": "0"})
    return read(path)


@pytest.fixture(scope="module")
def harvest(tmp_path_factory):
    """Return the harvest of the toy kernels."""
    return harvested(HERE, tmp_path_factory.mktemp("harvest") / "toys.pickle")


@pytest.fixture(scope="module")
def library(harvest, tmp_path_factory):
    """Return the library of the toy kernels."""
    folder = tmp_path_factory.mktemp("library")
    entries = harvest.entries
    objects = [folder / "kernels.o", folder / "wide.o"]
    for path, wide in zip(objects, (False, True), strict=True):
        path.write_bytes(compiler.compile_entries(entries, "linux-x64", wide=wide))
    build_kernels.link("linux-x64", objects, folder / "kernels.so")
    about = {
        "sources": compiled.sources_digest(),
        "library": "kernels.so",
        "kernels": compiler.table_of(entries, "linux-x64"),
    }
    wheel = folder / build_kernels.wheel_name("linux-x64")
    build_kernels.write_wheel(wheel, build_kernels.version(), about, b"")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    (folder / "kernels.so").replace(folder / compiled.PACKAGE / "kernels.so")
    return compiled.Library(folder / compiled.PACKAGE)


@pytest.fixture
def kernels(library, monkeypatch):
    """Return the toy kernels as they are where numba is missing."""
    monkeypatch.setattr(compiled, "library", lambda: library)
    monkeypatch.setitem(sys.modules, f"{compiled.__package__}.kernel_cache", None)
    return {kernel.__name__: compiled.Kernel(kernel.py_func) for kernel, _ in toy_kernels.calls()}


@pytest.mark.parametrize("newer", [False, True])
def test_results_are_those_of_numba(harvest, library, newer, monkeypatch):
    monkeypatch.setattr(library, "is_wide", newer and library.is_wide)
    calls = harvest.calls
    assert len(calls) == len(toy_kernels.calls())
    assert {replay.replay(call, library) for call in calls} == {0.0}


@pytest.mark.slow
def test_another_process_and_folder_give_the_same_bytes(harvest, tmp_path):
    shutil.copy(HERE / "toy_kernels.py", tmp_path)
    again = harvested(tmp_path, tmp_path / "toys.pickle")
    one, other = (compiler.compile_entries(each.entries, "linux-x64") for each in (harvest, again))
    assert one == other


def test_chunks_of_a_bound_kernel_write_their_own_part(kernels):
    values, out = np.arange(9.0), np.zeros(9)
    call = kernels["doubled"].bind(values, out)
    call(2, 5)
    call(7, 9)
    assert out.tolist() == [0, 0, 4, 6, 8, 0, 0, 14, 16]


def test_arrays_that_a_kernel_takes_as_views_are_read_in_place(kernels):
    values, out = np.arange(12.0).reshape(4, 3), np.zeros(4)
    kernels["doubled"](0, 4, values[:, 1], out)
    assert out.tolist() == [2, 8, 14, 20]


def test_a_kernel_that_raises_raises_here(kernels):
    assert kernels["refuses"](np.ones(1)) == 1.0
    for _ in range(3):
        with pytest.raises(ValueError, match=r"^negative$"):
            kernels["refuses"](-np.ones(1))


def test_an_error_names_no_file_of_the_machine_that_compiled(kernels):
    with pytest.raises(ValueError, match=r"^unable to broadcast argument 1 to output array$"):
        kernels["combined"](np.ones(3), np.ones(2), np.ones(3))


def test_types_that_were_not_compiled_are_named(kernels):
    with pytest.raises(compiled.KernelMissing, match=r"toy_kernels:total was compiled .* <i81C:"):
        kernels["total"](np.arange(3))


def test_nothing_leaks(kernels):
    # 10,000 times 1.6 MB; half a percent of that lost would show.
    values = np.linspace(0.0, 1.0, 100_000)
    out = np.zeros(100_000)

    def use(times):
        for _ in range(times):
            kernels["sorted_copy"](values[:1000])
            kernels["found_and_count"](values, 2.0)
            kernels["listed"](values[:100], out[:100])
            with pytest.raises(ValueError, match="negative"):
                kernels["refuses"](-values[1:2])

    use(100)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    use(10_000)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000
