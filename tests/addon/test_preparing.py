# SPDX-License-Identifier: GPL-3.0-or-later
"""Kernels are compiled before the first press, by a process of their own."""

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest
from shock_filter.core import registry
from shock_filter.core.base import cache_folder
from shock_filter.shock_addon.running import compiling, kernels, preparing


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Choose a folder for compiled code, and forget afterwards what was prepared."""
    monkeypatch.setattr(cache_folder, "chosen", str(tmp_path))
    monkeypatch.setattr(kernels, "choose_folder", lambda: None)
    yield tmp_path
    preparing.unregister()


@pytest.fixture
def loaded(monkeypatch):
    """Return what is loaded, instead of loading it."""
    found = []
    monkeypatch.setattr(preparing, "Job", found.append)
    return found


def python(tmp_path, text):
    """Make a program that is named as Python."""
    path = tmp_path / "python3"
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


def watched():
    """Watch until the process has ended."""
    for process in preparing._processes:
        process.last_words()
    assert preparing._watch() is None


def test_all_kinds_of_data_are_prepared():
    kinds = [kind for share in preparing._SHARES for kind in share]
    assert sorted(kinds) == sorted({row.kind.name for row in registry.FILTERS})


def test_nothing_begins_by_itself_in_background_mode():
    assert bpy.app.background
    preparing.register()
    assert not bpy.app.timers.is_registered(preparing._begin)
    assert preparing.fraction() is None


def test_a_person_before_an_extension_has_it_begin(monkeypatch):
    monkeypatch.setattr(preparing, "_PACKAGE", "bl_ext.user_default.shock_filter")
    app = SimpleNamespace(background=False, timers=bpy.app.timers)
    monkeypatch.setattr(preparing, "bpy", SimpleNamespace(app=app))
    preparing.register()
    assert bpy.app.timers.is_registered(preparing._begin)
    preparing.unregister()
    assert not bpy.app.timers.is_registered(preparing._begin)


def test_once_for_each_installation(tmp_path, monkeypatch, loaded):
    monkeypatch.setattr(sys, "executable", python(tmp_path, "read task; echo 0.5; echo 1"))
    preparing._begin()
    assert preparing.fraction() is not None
    watched()
    assert preparing.fraction() is None
    preparing.unregister()
    preparing._begin()
    assert preparing.fraction() is None
    preparing.unregister()
    monkeypatch.setattr(preparing, "_installation", lambda: "another one")
    preparing._begin()
    assert preparing.fraction() is not None


def test_it_says_how_far_it_is(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "executable", python(tmp_path, "echo 0.25; echo words; echo 0.2"))
    process = compiling.Process("package", str(tmp_path), ["image"])
    assert process.last_words() == "words"
    assert process.fraction == 0.25


def test_it_is_loaded_once_it_is_compiled_and_the_tab_was_seen(tmp_path, monkeypatch, loaded):
    monkeypatch.setattr(sys, "executable", python(tmp_path, "read task"))
    preparing.tab_is_seen()
    preparing._begin()
    assert not loaded
    watched()
    assert loaded == [preparing._rehearse]
    preparing.tab_is_seen()
    assert len(loaded) == 1
    preparing.unregister()
    preparing._begin()
    assert len(loaded) == 1
    preparing.tab_is_seen()
    assert len(loaded) == 2


def test_what_fails_is_said_and_not_tried_again(tmp_path, monkeypatch, loaded, caplog):
    monkeypatch.setattr(sys, "executable", python(tmp_path, "echo No module named numba; exit 1"))
    preparing.tab_is_seen()
    preparing._begin()
    watched()
    assert "No module named numba" in caplog.text
    assert not loaded
    preparing._begin()
    assert preparing.fraction() is None


@pytest.mark.parametrize("name", ["", "/usr/bin/blender", "/nowhere/python3"])
def test_without_a_python_everything_is_as_before(name, monkeypatch, caplog):
    monkeypatch.setattr(sys, "executable", name)
    preparing._begin()
    assert preparing.fraction() is None
    assert "compiled on first use" in caplog.text


def test_what_has_to_be_compiled_again_is_left_to_the_next_session(monkeypatch):
    preparing._write_mark()
    assert preparing._mark() == preparing._installation()
    monkeypatch.setattr(kernels, "seconds_compiling", iter([0.0, 0.0, 3.0]).__next__)
    asked = []
    preparing._rehearse(lambda *about: asked.append(about) or True)
    assert len(asked) == 1
    assert preparing._mark() == ""


def test_disabling_ends_the_process(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "executable", python(tmp_path, "exec sleep 100"))
    preparing._begin()
    processes = list(preparing._processes)
    assert [process.code for process in processes] == [None, None]
    preparing.unregister()
    assert None not in [process.code for process in processes]
    assert not list(tmp_path.glob("prepared-*"))


def test_rehearsed_presses_compile_nothing():
    script = Path(__file__).with_name("presses.py")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=580)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == []
