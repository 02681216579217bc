# SPDX-License-Identifier: GPL-3.0-or-later
"""What scripts rely on: public names, command lines and exit codes are as they were released."""

import argparse
import json
from pathlib import Path

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
