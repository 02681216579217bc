# SPDX-License-Identifier: GPL-3.0-or-later
"""What the rehearsal runs is all that presses need."""

import json
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
def test_rehearsed_presses_compile_nothing():
    script = Path(__file__).with_name("presses.py")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=580)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == []
