# SPDX-License-Identifier: GPL-3.0-or-later
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_each_fault_can_be_made():
    """A text that the code no longer has would make no fault, and seem unnoticed."""
    faults = tomllib.loads((ROOT / "tools" / "mutants.toml").read_text(encoding="utf-8"))["fault"]
    stale = [
        fault["name"]
        for fault in faults
        if (ROOT / fault["file"]).read_text(encoding="utf-8").count(fault["before"].strip("\n"))
        != 1
    ]
    assert faults and not stale
