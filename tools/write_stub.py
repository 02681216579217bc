# SPDX-License-Identifier: GPL-3.0-or-later
"""Write core/__init__.pyi, which tells editors and type checkers the public names of `core`.

Run it when `core/registry.py` has changed; a test fails while the file is old.
"""

from __future__ import annotations

import sys
from pathlib import Path

TARGET = Path(__file__).resolve().parent.parent / "core" / "__init__.pyi"

_HEAD = """\
# SPDX-License-Identifier: GPL-3.0-or-later
# Written by tools/write_stub.py from core/registry.py.
"""


def stub(names: dict[str, str]) -> str:
    """Say where each name comes from, for a mapping of names to modules."""
    modules: dict[str, list[str]] = {}
    for name, module in sorted(names.items()):
        modules.setdefault(module, []).append(name)
    lines = [_HEAD]
    for module in sorted(modules):
        lines += [f"from .{module} import (", *(f"    {name}," for name in modules[module]), ")"]
    lines += ["", "__all__ = [", *(f'    "{name}",' for name in sorted(names)), "]", ""]
    return "\n".join(lines)


def main() -> None:
    """Write the file."""
    sys.path.insert(0, str(TARGET.parents[1]))
    from core import registry

    TARGET.write_text(stub(registry.public_names()), encoding="utf-8")


if __name__ == "__main__":
    main()
