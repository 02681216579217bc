# SPDX-License-Identifier: GPL-3.0-or-later
"""What all fuzz tests share."""

import numpy as np
import pytest


@pytest.fixture(autouse=True)
def short_arrays():
    """Print arrays in failures shortly."""
    with np.printoptions(threshold=20, edgeitems=2):
        yield
