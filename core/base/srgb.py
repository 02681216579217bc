# SPDX-License-Identifier: GPL-3.0-or-later
"""The curve of sRGB values (IEC 61966-2-1), between values as they are stored and light."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.float32]


def decoded(values: npt.NDArray) -> Values:
    """Convert sRGB values to linear ones."""
    curved = ((np.maximum(values, 0.0) + 0.055) / 1.055) ** 2.4
    return np.where(values <= 0.04045, values / 12.92, curved).astype(np.float32)


def encoded(values: npt.NDArray) -> Values:
    """Convert linear values to sRGB ones."""
    curved = 1.055 * np.maximum(values, 0.0) ** (1.0 / 2.4) - 0.055
    return np.where(values <= 0.0031308, values * 12.92, curved).astype(np.float32)
