# SPDX-License-Identifier: GPL-3.0-or-later
"""Wrong values for each argument of each public function: a named error, or a finite result."""

import inspect
import itertools

import numpy as np
import pytest
from calls import CALLS, function_of, wrong_settings, wrong_values
from checks import assert_sentence
from shock_filter import core
from shock_filter.core.settings import describe
from strategies import LONG

_SHARE = 1 if LONG else 3
"""One of so many wrong values is tried, another one for each argument."""


def call(name, **changed):
    """Call a function, and look at the result."""
    row = CALLS[name]
    words = {**row.words, **({"settings": row.settings(**row.short)} if row.settings else {})}
    try:
        result = function_of(name)(**{**words, **changed})
        if inspect.isgenerator(result):
            result = tuple(itertools.islice(result, 2))
    except core.ShockError as error:
        assert_sentence(error)
        return
    if row.infinite:
        return
    for array in result if isinstance(result, tuple) else (result,):
        if isinstance(array, np.ndarray):
            assert np.isfinite(array).all()


def parameters(name):
    return set(inspect.signature(function_of(name)).parameters)


def is_error(thing):
    return isinstance(thing, type) and issubclass(thing, Exception)


def test_all_functions_and_arguments_are_in_the_table():
    exempt = ("Settings", "UVReport", "CreaseLine", "LowPoly", "Curvatures")
    names = {
        name
        for name in core.__all__
        if not name.endswith(exempt) and not is_error(getattr(core, name))
    }
    assert names == {name.split()[0] for name in CALLS if "." not in name}
    for name, row in CALLS.items():
        expected = parameters(name) - {"progress"}
        assert expected == {*row.words, *(["settings"] if row.settings else [])}, name


@pytest.mark.parametrize("name", CALLS)
def test_the_calls_of_the_table_are_right(name):
    row = CALLS[name]
    words = {**row.words, **({"settings": row.settings(**row.short)} if row.settings else {})}
    result = function_of(name)(**words)
    if inspect.isgenerator(result):
        assert len(list(result)) == 2


@pytest.mark.parametrize("name", CALLS)
def test_wrong_arguments_are_refused_or_do_no_harm(name):
    random = np.random.default_rng(len(name))
    for argument in sorted(parameters(name)):
        values = list(wrong_values(CALLS[name].words.get(argument)))
        for value in values[random.integers(_SHARE) :: _SHARE]:
            call(name, **{argument: value})


@pytest.mark.parametrize("name", [name for name, row in CALLS.items() if row.settings])
def test_wrong_settings_are_refused_or_do_no_harm(name):
    row = CALLS[name]
    random = np.random.default_rng(len(name))
    for field, (kind, default, _) in describe(row.settings).items():
        values = list(wrong_settings(kind, default))
        for value in values[random.integers(_SHARE) :: _SHARE]:
            try:
                settings = row.settings(**{**row.short, field: value})
            except core.InvalidSettings as error:
                assert_sentence(error)
                continue
            call(name, settings=settings)


@pytest.mark.parametrize("name", [name for name, row in CALLS.items() if row.settings])
def test_extreme_settings_do_no_harm_together(name):
    row = CALLS[name]
    random = np.random.default_rng(len(name))
    for _ in range(400 if LONG else 20):
        chosen = dict(row.short)
        for field, (kind, default, about) in describe(row.settings).items():
            values = list(about.choices) or list(wrong_settings(kind, default))
            value = values[random.integers(len(values))]
            if random.random() < 0.5 and is_taken(row.settings, field, value):
                chosen[field] = value
        try:
            settings = row.settings(**chosen)
        except core.InvalidSettings as error:  # they contradict each other
            assert_sentence(error)
            continue
        call(name, settings=settings)


def is_taken(settings, field, value):
    try:
        settings(**{field: value})
    except core.InvalidSettings:
        return False
    return True
