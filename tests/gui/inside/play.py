# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender is started with: ``blender --python play.py -- SCENARIO REPORT PICTURES``."""

import sys
from importlib import import_module
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
name = sys.argv[sys.argv.index("--") + 1]
import_module("harness").play(import_module(name).scenario)
