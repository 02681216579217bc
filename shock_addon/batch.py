# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpen files with Blender from the command line.

Run as ``blender -b [FILE] -P shock_addon/batch.py -- sharpen-geometry IN... OUT [--time 64 ...]``.
IN may be ``-`` for FILE, the file that Blender opened. The script uses the enabled extension, or
else the source tree that contains it.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
import traceback
from pathlib import Path
from types import ModuleType

NAME = "shock_filter"


def enabled_extension() -> ModuleType | None:
    """Return the package of the extension if this Blender has enabled it."""
    for name, module in list(sys.modules.items()):
        # Blender marks enabled add-ons, also those enabled by --addons for this session only.
        if name.rpartition(".")[2] == NAME and getattr(module, "__addon_enabled__", False):
            return module
    return None


def load_source_tree() -> ModuleType:
    """Import the folder above this one as the package ``shock_filter``, whatever its name is."""
    root = Path(__file__).resolve().parent.parent
    spec = importlib.util.spec_from_file_location(
        NAME, root / "__init__.py", submodule_search_locations=[str(root)]
    )
    package = importlib.util.module_from_spec(spec)
    sys.modules[NAME] = package
    spec.loader.exec_module(package)
    return package


def run(arguments: list[str]) -> int:
    """Run the command line and return its exit code; register the extension for that time."""
    extension = enabled_extension()
    package = extension or load_source_tree()
    if extension is None:
        package.register()
    try:
        command_line = importlib.import_module(
            ".shock_addon.commands.command_line", package.__name__
        )
        return command_line.run(arguments, "blender -b -P shock_addon/batch.py --")
    finally:
        if extension is None:
            package.unregister()  # Blender may hang or crash at exit otherwise


def main() -> None:
    """Run the arguments after ``--``, and quit Blender with the exit code."""
    code = 1
    try:
        code = run(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else [])
    except BaseException:
        traceback.print_exc()
    sys.exit(code)  # Blender itself would exit with 0, even after an error


if __name__ == "__main__":
    main()
