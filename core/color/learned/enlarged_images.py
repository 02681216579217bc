# SPDX-License-Identifier: GPL-3.0-or-later
"""Learned enlarging of the pixels of an image, or of a part of one."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...base.checks import SCALES
from ...base.parallel import kernel, run
from ...base.progress import aside, phase
from ...grid.channels import Channels
from ...settings import ImageSettings
from .enlarging import STRIP, enlarged_planes, reach_of_enlarging
from .planes import Planes

STEPS = {2: (2,), 3: (3,), 4: (4,), 6: (3, 2), 8: (4, 2)}
"""Factors that are applied in turn for each total factor."""


def is_enlarged_as_learned(settings: ImageSettings, has_guide: bool) -> bool:
    """Return whether an image is enlarged by networks, without further sharpening.

    It is not if a time, What, a width or a guide is given, nor for the factors 5 and 7.
    """
    by_itself = settings.by_width and settings.what == "auto" and settings.width == 0
    return by_itself and settings.enlarge in STEPS and not has_guide


def reach_of_steps(times: int) -> int:
    """Return the radius in pixels within which an image affects a result."""
    return len(STEPS[times]) * reach_of_enlarging()


def enlarge_pixels(pixels: npt.NDArray, channels: Channels, times: int, out: npt.NDArray) -> None:
    """Enlarge some channels of an image.

    Parameters
    ----------
    pixels : (h, w, c) array
        Opacity is in [0, 1].
    channels : Channels
    times : int
        One of `STEPS`.
    out : (times * h, times * w, c) array of float
        Overwritten with values in the range of colors.
    """
    planes = Planes.of(pixels, channels)
    steps = STEPS[times]
    for number, factor in enumerate(steps):
        with phase(number / len(steps), (number + 1) / len(steps), "Enlarging"):
            values = enlarged_planes(planes, factor)
        opacity = planes.opacity.repeat(factor, 0).repeat(factor, 1)
        planes = Planes(values, opacity)
    scale = SCALES[pixels.dtype.name]
    with aside("Enlarging"):
        run(_put, len(out), pixels, planes.values, channels.start, times, scale, out,
            chunk=STRIP)  # fmt: skip


@kernel
def _put(start, stop, old, new, first, times, scale, out):
    # Unchanged values are copied from the image, which may have more bits than the planes.
    for y in range(start, stop):
        for c in range(len(new)):
            for x in range(out.shape[1]):
                value = old[y // times, x // times, first + c]
                if new[c, y, x] != np.float32(value):
                    out[y, x, first + c] = scale * new[c, y, x]
                else:
                    out[y, x, first + c] = scale * value
