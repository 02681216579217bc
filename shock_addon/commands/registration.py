# SPDX-License-Identifier: GPL-3.0-or-later
"""Registers ``blender --command shock_filter``; the command line is imported when called."""

from __future__ import annotations

from typing import Any

import bpy

_NAME = "shock_filter"

_handle: Any = None


def register() -> None:
    """Add the command."""
    global _handle
    _handle = bpy.utils.register_cli_command(_NAME, run)


def unregister() -> None:
    """Remove it."""
    global _handle
    bpy.utils.unregister_cli_command(_handle)
    _handle = None


def run(arguments: list[str]) -> int:
    """Run the command line; returns the exit code."""
    from . import command_line

    return command_line.run(arguments, f"blender --command {_NAME}")
