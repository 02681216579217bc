# SPDX-License-Identifier: GPL-3.0-or-later
"""Output files that appear complete or not at all, and what to say about them.

Needs no numerics, since Blender's command line chooses where kernels are kept before they load.
"""

from __future__ import annotations

import contextlib
import filecmp
import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from .errors import ShockError


@dataclass(frozen=True)
class Outcome:
    """What was done with a file.

    Attributes
    ----------
    total, changed : int
        Number of vertices or pixels, and of those that are not as they were.
    notes : tuple of str
        What a person should know: what did not survive, what was computed anew.
    done : str
        Says what was done, with places for both numbers.
    """

    total: int
    changed: int
    notes: tuple[str, ...] = ()
    done: str = "moved {changed} of {total} vertices"

    def __str__(self) -> str:
        """Say what was done."""
        return self.done.format(changed=self.changed, total=self.total)


@contextlib.contextmanager
def staged(target: Path, overwrite: bool) -> Iterator[Path]:
    """Give a path to write to, and move what was written there to `target` at the end.

    Files written beside it (materials, textures) come along. If writing fails, nothing of it is
    left and `target` is as it was.
    """
    target = target.absolute()
    if not os.access(target.parent, os.W_OK | os.X_OK):
        raise ShockError(f"Cannot write to the folder {target.parent}; choose another output.")
    with tempfile.TemporaryDirectory(prefix=".shock-filter-", dir=target.parent) as folder:
        stage = Path(folder) / target.name
        yield stage
        written = sorted(path for path in Path(folder).rglob("*") if path.is_file())
        written.sort(key=stage.__eq__)  # the file itself comes last
        pairs = [(path, target.parent / path.relative_to(folder)) for path in written]
        pairs = [(new, old) for new, old in pairs if new == stage or not _same(new, old)]
        if not overwrite:
            for _, old in pairs:
                if old.exists():
                    raise ShockError(
                        f"{old} exists already; add --overwrite or choose another output."
                    )
        for _, old in pairs:
            old.parent.mkdir(parents=True, exist_ok=True)
        for new, old in pairs:
            os.replace(new, old)


def _same(new: Path, old: Path) -> bool:
    return old.is_file() and filecmp.cmp(new, old, shallow=False)
