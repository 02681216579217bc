# SPDX-License-Identifier: GPL-3.0-or-later
"""A script that compiles kernels in a process of its own, before a host program needs them.

Reads one line of JSON from stdin: the name under which the host imports this package, which
compiled code contains; the search path for modules; the folder for compiled code; and the kinds of
data to compile for. Prints the progress from 0 to 1, one number a line. Ends when stdin is closed,
and so with its host.
"""

import importlib
import importlib.util
import json
import os
import sys
import threading
from pathlib import Path
from types import ModuleType
from typing import Any

_ROOT = Path(__file__).resolve().parents[2]
_NICENESS = 10


def main() -> None:
    """Compile all kernels."""
    task = json.loads(sys.stdin.readline())
    threading.Thread(target=_end_with_host, daemon=True).start()
    if hasattr(os, "nice"):
        os.nice(_NICENESS)
    sys.path[:] = task["paths"]
    _import_as(task["package"])
    cache_folder = importlib.import_module(f"{task['package']}.core.base.cache_folder")
    cache_folder.chosen = task["folder"]  # type: ignore[attr-defined]
    rehearsal = importlib.import_module(f"{task['package']}.core.rehearsal.rehearse")

    def tell(*_: Any) -> bool:
        print(f"{rehearsal.share_ready():.3f}", flush=True)
        return True

    _tell_of_each_kernel(tell)
    rehearsal.rehearse(tell, task["kinds"])


def _end_with_host() -> None:
    sys.stdin.read()
    os._exit(1)  # at once: files are written whole, or not at all


def _import_as(package: str) -> None:
    *above, _ = package.split(".")
    for depth in range(len(above)):
        name = ".".join(above[: depth + 1])
        sys.modules[name] = ModuleType(name)
    spec: Any = importlib.util.spec_from_file_location(
        package, _ROOT / "__init__.py", submodule_search_locations=[str(_ROOT)]
    )
    sys.modules[package] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)


def _tell_of_each_kernel(tell: Any) -> None:
    from numba.core import event

    class Compiled(event.Listener):
        def on_start(self, event: Any) -> None:
            pass

        def on_end(self, event: Any) -> None:
            tell()

    event.register("numba:compile", Compiled())


if __name__ == "__main__":
    main()
