# SPDX-License-Identifier: GPL-3.0-or-later
"""The modules that packages load when they are first used."""

import ast
import re
from pathlib import Path
from types import ModuleType

import pytest
from shock_filter import shock_addon
from shock_filter.shock_addon import data


@pytest.mark.parametrize("package", [data, data.image, data.mesh])
def test_all_modules_are_given_and_nothing_else(package):
    folder = Path(package.__file__).parent
    files = {path.stem for path in folder.glob("[a-z]*.py")}
    files |= {path.parent.name for path in folder.glob("*/__init__.py")}
    assert all(isinstance(getattr(package, name), ModuleType) for name in files)
    code = ast.parse(Path(package.__file__).read_text(encoding="utf-8"))
    listed = [n for n in ast.walk(code) if isinstance(n, ast.ImportFrom) and n.level == 1]
    assert {each.name for node in listed for each in node.names} == files  # for type checkers
    with pytest.raises(AttributeError, match=f"module '{package.__name__}' has no attribute 'no'"):
        _ = package.no


@pytest.mark.parametrize("package", [data])
def test_what_the_add_on_asks_for_is_there(package):
    front = package.__name__.rpartition(".")[2]
    used = set()
    for path in Path(shock_addon.__file__).parent.rglob("*.py"):
        code = path.read_text(encoding="utf-8")
        if re.search(rf"^from \.+[\w.]* import .*\b{front}\b", code, re.MULTILINE):
            used |= set(re.findall(rf"(?<![\w.]){front}\.([a-zA-Z]\w*)(?:\.(\w+))?", code))
    assert used
    for module, name in used:
        found = getattr(package, module)
        assert not name or not isinstance(found, ModuleType) or hasattr(found, name), (module, name)
