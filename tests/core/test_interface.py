# SPDX-License-Identifier: GPL-3.0-or-later
"""What scripts rely on: public names, command lines and exit codes are as they were released."""

import argparse
import inspect
import json
from pathlib import Path

import numpy as np
import pytest
from shock_filter import core
from shock_filter.core import cli

RELEASED = json.loads(Path(__file__).with_name("interface.json").read_text(encoding="utf-8"))
"""Of each command: each flag or place with its default, its number of words and its choices."""


def commands():
    """Return the parsers of all commands by name."""
    parser = cli.build_parser(cli.FileBackend())
    (found,) = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    return found.choices


def test_the_public_names_are_those_released():
    assert core.__all__ == dir(core) == RELEASED["names"]


def test_the_exit_codes_are_those_released():
    assert RELEASED["exit codes"] == [cli.DONE, cli.FAILED, cli.INTERRUPTED]


def test_the_commands_are_those_released_in_their_order():
    assert list(commands()) == list(RELEASED["commands"])


@pytest.mark.parametrize("command", RELEASED["commands"])
def test_the_flags_are_those_released(command):
    flags = {
        " ".join(action.option_strings) or action.dest: [
            action.default,
            None if action.nargs is None else str(action.nargs),
            list(action.choices) if action.choices else None,
        ]
        for action in commands()[command]._actions
        if not isinstance(action, argparse._HelpAction)
    }
    assert flags == RELEASED["commands"][command]
    assert list(flags) == list(RELEASED["commands"][command])


DATA = {
    *("axis", "embedding", "faces", "field", "gain", "image", "images", "mesh", "normals"),
    *("points", "signal", "sources", "uv", "velocity", "vertices"),
}

RESULTS = {"CreaseLine", "Curvatures", "LowPoly", "UVReport"}
"""Classes of which functions give objects, and nobody else makes any."""


@pytest.mark.parametrize("name", [name for name in core.__all__ if callable(getattr(core, name))])
def test_all_but_data_and_settings_are_given_by_keyword(name):
    function = getattr(core, name)
    if name in RESULTS or (isinstance(function, type) and issubclass(function, Exception)):
        return
    parameters = inspect.signature(function).parameters.values()
    placed = [each.name for each in parameters if each.kind is each.POSITIONAL_OR_KEYWORD]
    assert set(placed) <= DATA | {"settings"}
    assert "settings" not in placed[:-1]
    if "Settings" not in name and len(placed) < len(parameters):
        keyword = next(each.name for each in parameters if each.kind is each.KEYWORD_ONLY)
        with pytest.raises(TypeError, match=rf"by keyword; write .*\b{keyword}=\.\.\."):
            function(*[None] * (len(placed) + 1))


def test_a_method_names_its_keywords_as_well():
    with pytest.raises(TypeError, match=r"TextureSolver.filtered takes gain by position"):
        core.TextureSolver.filtered(None, None, None)


def test_an_array_where_settings_were_once_later_is_refused_in_a_sentence():
    image = np.zeros((4, 4, 2))
    with pytest.raises(core.InvalidSettings, match=r"give ConvolutionSettings, .* by keyword"):
        core.line_integral_convolution(image, image[..., 0])
