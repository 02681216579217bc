# SPDX-License-Identifier: GPL-3.0-or-later
"""Flow maps: images whose red and green are a velocity to the right and up."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import as_array, by_keyword, checked_word
from ..errors import InvalidSignal

_CHANNELS = (2, 3, 4)


@by_keyword
def flow_map_velocity(image: npt.ArrayLike, *, y_axis: str = "up") -> npt.NDArray[np.float32]:
    """Convert a flow map to velocities.

    Parameters
    ----------
    image : (h, w, 2), (h, w, 3) or (h, w, 4) array of uint8, uint16 or float
        Rows go from top to bottom. Red is to the right and green is up; a velocity of 0 is 128 of
        255, 32768 of 65535, or 0.5. Blue is ignored; where opacity is 0, the velocity is
        undefined.
    y_axis : str
        ``"up"``, or ``"down"`` if green points down, as in maps for Unreal and DirectX.

    Returns
    -------
    (h, w, 2) float32
        From -1 to 1; NaN where undefined.

    Raises
    ------
    InvalidSignal
        If the image has too few channels, or floats outside 0 to 1.
    InvalidSettings
        If `y_axis` is another word.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> core.flow_map_velocity(np.array([[[255, 128, 0], [128, 1, 0]]], dtype=np.uint8)).tolist()
    [[[1.0, 0.0], [0.0, -1.0]]]
    """
    given = as_array(image, "flow map")
    if given.ndim != 3 or given.shape[2] not in _CHANNELS or given.size == 0:
        raise InvalidSignal(
            f"The flow map has the shape {given.shape}; give (h, w, 3) with the velocity in red"
            " and green."
        )
    if given.dtype in (np.uint8, np.uint16):
        middle = np.float32(1 << (8 * given.dtype.itemsize - 1))
        velocity = (given[..., :2].astype(np.float32) - middle) / (middle - np.float32(1))
        velocity = np.maximum(velocity, np.float32(-1))
    elif given.dtype.kind == "f":
        if (given[..., :2] < 0).any() or (given[..., :2] > 1).any():
            raise InvalidSignal(
                "The flow map leaves the range 0 to 1; bring it there with 0.5 for 0, or give"
                " velocities as an array."
            )
        velocity = np.float32(2) * given[..., :2].astype(np.float32) - np.float32(1)
    else:
        raise InvalidSignal(f"The flow map is of type {given.dtype}; give 8 or 16 bits, or floats.")
    if given.shape[2] == 4:
        velocity[given[..., 3] == 0] = np.nan
    return turned(velocity, y_axis)


def turned(velocity: npt.NDArray, y_axis: str) -> npt.NDArray:
    """Return velocities with the second component up."""
    if checked_word(y_axis, "y_axis", ("up", "down")) == "up":
        return velocity
    return velocity * np.array([1, -1], dtype=velocity.dtype)
