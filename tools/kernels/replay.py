# SPDX-License-Identifier: GPL-3.0-or-later
"""Call each kernel of a library with what the rehearsal gave numba, and compare the results.

usage: replay.py FOLDER HARVEST ...      FOLDER: where `build_kernels.py --install` put the package

Where numba compiled for the library's processor (``NUMBA_CPU_NAME=x86-64-v2``), all bits must
agree. Otherwise kernels that sum may differ by rounding.
"""

from __future__ import annotations

import argparse
import copy
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from records import Call, read
from shock_filter.core.base import compiled

ROUNDING = 1e-5
"""Largest difference, relative to the largest value, that counts as rounding: of single precision
sums over cancelling terms."""


def difference(found: Any, wanted: Any) -> float:
    """Return 0 where all bits agree, and otherwise the largest difference."""
    if isinstance(wanted, tuple):
        return max([difference(*pair) for pair in zip(found, wanted, strict=True)], default=0.0)
    found, wanted = np.asarray(found), np.asarray(wanted)
    if found.dtype != wanted.dtype or found.shape != wanted.shape:
        return np.inf
    if found.tobytes() == wanted.tobytes():
        return 0.0
    if wanted.dtype.kind != "f" or (np.isfinite(found) != np.isfinite(wanted)).any():
        return np.inf
    finite = np.isfinite(wanted)
    scale = max(float(np.abs(wanted[finite]).max(initial=0.0)), 1e-300)
    return float(np.abs(found - wanted)[finite].max(initial=0.0)) / scale


def replay(call: Call, library: compiled.Library) -> float | None:
    """Return the difference of a call's results; None if the library lacks the kernel."""
    arguments = copy.deepcopy(call.before)
    types = [compiled.type_name(each) for each in arguments]
    entry = library.find(call.name, types)
    if entry is None:
        return None
    result = compiled._Call(call.name, arguments, *entry, library.free)(arguments)
    return max(difference(arguments, call.after), difference(result, call.result))


def main() -> None:
    """Print how many calls have the same bits, and name the others."""
    parser = argparse.ArgumentParser(description="Compare a library's results with numba's.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("harvests", type=Path, nargs="+")
    parser.add_argument("--oldest", action="store_true", help="as on the oldest processor")
    given = parser.parse_args()
    library = compiled.Library(given.folder / compiled.PACKAGE)
    library.is_wide = library.is_wide and not given.oldest
    counts: Counter[str] = Counter()
    for path in given.harvests:
        for call in read(path).calls:
            found = replay(call, library)
            what = "missing" if found is None else "same bits" if not found else "rounding"
            if found is not None and found > ROUNDING:
                what = "other"
            counts[what] += 1
            if found != 0.0:
                print(f"{what:10} {found}  {call.name}")
    print(", ".join(f"{count} {what}" for what, count in sorted(counts.items())))
    if counts["missing"] or counts["other"]:
        sys.exit(1)


if __name__ == "__main__":
    main()
