# SPDX-License-Identifier: GPL-3.0-or-later
"""Compiled code on disk that is damaged, mixed up or cannot be written: results stay right."""

import importlib.util
import itertools

import pytest

SOURCE = """
from shock_filter.core.base.parallel import kernel


@kernel
def double(value):
    return value + value
"""

_numbers = itertools.count()


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
    (tmp_path / "__pycache__").rmdir()
    (tmp_path / "__pycache__").write_text("A file where the folder was.")
    assert double(2) == 4
    assert "cannot be kept" in caplog.text


def test_kernels_work_where_no_folder_can_be_written(tmp_path, module, monkeypatch, caplog):
    (tmp_path / "__pycache__").write_text("A file where the folder should be.")
    for name in ("HOME", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.setenv(name, str(tmp_path / "__pycache__" / "below"))
    assert module().double(2) == 4
    assert "not kept" in caplog.text
