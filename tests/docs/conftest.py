# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tests of the documentation share."""

import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def build_docs():
    """Return the module tools/build_docs.py."""
    path = ROOT / "tools" / "build_docs.py"
    spec = importlib.util.spec_from_file_location("build_docs", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
