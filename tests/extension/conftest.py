# SPDX-License-Identifier: GPL-3.0-or-later
"""The repository's root, for all tests of the packaged extension."""

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def root() -> Path:
    """Return the repository's root."""
    return Path(__file__).resolve().parents[2]
