# SPDX-License-Identifier: GPL-3.0-or-later
"""Flow round a cylinder, solved by a lattice Boltzmann method, for pictures of unsteady flows.

A row of vortices comes off the cylinder, alternately on both sides. Nine directions, one time of
relaxation (Bhatnagar, Gross, Krook); the fluid comes in at the left at a given speed, and bounces
back from the cylinder.
"""

from __future__ import annotations

import numpy as np
from numba import njit

ROWS, COLUMNS = 128, 320
RADIUS = 8.0
CENTER = 64.3, 70.0  # off the middle, so that the vortices begin
SPEED = 0.09
REYNOLDS = 120.0

_DOWN = np.array([0, 0, 1, 0, -1, 1, 1, -1, -1])
_RIGHT = np.array([0, 1, 0, -1, 0, 1, -1, -1, 1])
_BACK = np.array([0, 3, 4, 1, 2, 7, 8, 5, 6])
_WEIGHTS = np.array([4 / 9, *[1 / 9] * 4, *[1 / 36] * 4])


def key_frames(count: int = 32, steps: int = 120, start: int = 12_000) -> np.ndarray:
    """Solve; return velocities (count, h, w, 2), right and up, NaN in the cylinder."""
    y, x = np.mgrid[:ROWS, :COLUMNS]
    solid = np.hypot(y - CENTER[0], x - CENTER[1]) < RADIUS
    relaxation = 1.0 / (0.5 + 3.0 * SPEED * 2 * RADIUS / REYNOLDS)
    right = np.where(solid, 0.0, SPEED)
    parts = _WEIGHTS[:, None, None] * (
        1 + 3 * _RIGHT[:, None, None] * right + 4.5 * (_RIGHT[:, None, None] * right) ** 2
    ) - _WEIGHTS[:, None, None] * 1.5 * right**2  # fmt: skip
    other = np.empty_like(parts)
    found = []
    for number in range(count):
        for _ in range(steps if number else start):
            _step(parts, other, solid, relaxation, SPEED)
            parts, other = other, parts
        total = parts.sum(axis=0)
        flow = [np.tensordot(way, parts, 1) / total for way in (_RIGHT, -_DOWN)]
        found.append(np.where(solid[..., None], np.nan, np.stack(flow, axis=-1)))
    return np.array(found).astype(np.float32)


@njit(cache=True)
def _step(parts, other, solid, relaxation, speed):
    rows, columns = solid.shape
    here = np.empty(9)
    for i in range(rows):
        for j in range(columns):
            total = u = v = 0.0
            for k in range(9):
                from_row, from_column = (i - _DOWN[k]) % rows, j - _RIGHT[k]
                if from_column < 0 or from_column >= columns:
                    here[k] = parts[k, i, j]  # free to leave
                elif solid[from_row, from_column]:
                    here[k] = parts[_BACK[k], i, j]
                else:
                    here[k] = parts[k, from_row, from_column]
                total += here[k]
                u += here[k] * _RIGHT[k]
                v += here[k] * _DOWN[k]
            u /= total
            v /= total
            rate = relaxation
            if j == 0:
                u, v, total, rate = speed, 0.0, 1.0, 1.0
            for k in range(9):
                along = _RIGHT[k] * u + _DOWN[k] * v
                rest = (
                    _WEIGHTS[k] * total * (1 + 3 * along + 4.5 * along**2 - 1.5 * (u * u + v * v))
                )
                other[k, i, j] = here[k] + rate * (rest - here[k])
