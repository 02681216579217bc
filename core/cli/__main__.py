# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs the command line: ``python -m shock_filter.core.cli``."""

import sys

from . import main

sys.exit(main())
