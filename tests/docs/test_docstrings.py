# SPDX-License-Identifier: GPL-3.0-or-later
"""The examples in the docstrings of public functions and classes give what they say."""

import doctest
import inspect

import pytest
from shock_filter import core

FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


def needs_example(name):
    """Whether a public name is a function, or a class that holds data of its own."""
    thing = getattr(core, name)
    is_error = inspect.isclass(thing) and issubclass(thing, Exception)
    return not (is_error or name.endswith("Settings"))


NAMES = [name for name in core.__all__ if needs_example(name)]


def examples(name):
    """Return the examples of a docstring, and of a class's methods."""
    found = doctest.DocTestFinder(exclude_empty=True).find(getattr(core, name), name, globs={})
    return [test for test in found if test.examples]


@pytest.mark.parametrize("name", NAMES)
def test_examples_give_what_they_say(name):
    said = []
    runner = doctest.DocTestRunner(verbose=False, optionflags=FLAGS)
    for test in examples(name):
        runner.run(test, out=said.append)
    assert not runner.failures, "".join(said)


def test_each_has_an_example():
    assert [name for name in NAMES if not examples(name)] == []
