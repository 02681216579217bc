# SPDX-License-Identifier: GPL-3.0-or-later
"""The names that packages load when they are first used."""

import re
from pathlib import Path
from types import ModuleType

import pytest
from shock_filter import shock_addon
from shock_filter.core import host as filters
from shock_filter.shock_addon import data

NAMES = [
    (package, module, name)
    for package in (data, filters)
    for module, names in package._MODULES.items()
    for name in names
]


@pytest.mark.parametrize(
    ("package", "module", "name"), NAMES, ids=[f"{module}.{name}" for _, module, name in NAMES]
)
def test_each_name_is_there(package, module, name):
    found = getattr(package, name)
    assert not isinstance(found, ModuleType)  # once loaded, a module hides a name like its own
    defined_in = getattr(found, "__module__", "").removeprefix(f"{package.__name__}.")
    assert defined_in.startswith(module) or not isinstance(found, type)


@pytest.mark.parametrize("package", [data, filters])
def test_no_name_is_given_twice_and_others_are_refused(package):
    names = [name for names in package._MODULES.values() for name in names]
    assert len(set(names)) == len(names)
    with pytest.raises(AttributeError, match=f"module '{package.__name__}' has no attribute 'no'"):
        _ = package.no


@pytest.mark.parametrize("package", [data, filters])
def test_what_the_add_on_uses_is_what_is_given(package):
    front = package.__name__.rpartition(".")[2]
    used = set()
    for path in Path(shock_addon.__file__).parent.rglob("*.py"):
        code = path.read_text(encoding="utf-8")
        if re.search(rf"^from \.+ import .*\b{front}\b", code, re.MULTILINE):
            used |= set(re.findall(rf"(?<![\w.]){front}\.([A-Za-z]\w*)", code))
    assert used == {name for names in package._MODULES.values() for name in names}
