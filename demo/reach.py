# SPDX-License-Identifier: GPL-3.0-or-later
"""Show how wide a rounding a given time pulls together.

``python demo/reach.py`` prints, for fillets of 90 degrees and growing radius, the share of all
bending that sits in sharp edges after sharpening. Needs numpy and the package, not Blender.
"""

from __future__ import annotations

import math

import measure
import numpy as np
import numpy.typing as npt
from shock_filter import core

RADII = (2, 3, 4, 6, 8, 12)
TIMES = (64, 256, 1024, 4096, 16384, math.inf)
FLAT, WIDTH = 25, 40


def fillet(radius: float) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.intp]]:
    """Two flat strips that meet in a quarter of a cylinder; edges along the arc are 1 long."""
    arc = 0.5 * np.pi * radius
    places = np.arange(-FLAT - 0.5 * arc, FLAT + 0.5 * arc + 1e-9)
    turned = np.interp(places, [-0.5 * arc, 0.5 * arc], [0.0, 0.5 * np.pi])
    middle = 0.5 * (turned[1:] + turned[:-1])
    x = np.concatenate([[0.0], np.cumsum(np.cos(middle))])
    z = np.concatenate([[0.0], np.cumsum(-np.sin(middle))])
    count = len(places)
    y = np.tile(np.arange(WIDTH, dtype=float), count)
    vertices = np.stack([np.repeat(x, WIDTH), y, np.repeat(z, WIDTH)], axis=1)
    i, j = np.meshgrid(np.arange(count - 1), np.arange(WIDTH - 1), indexing="ij")
    a = (i * WIDTH + j).ravel()
    b, c, d = a + WIDTH, a + WIDTH + 1, a + 1
    one, other = np.stack([a, b, c, a, c, d], axis=1), np.stack([a, b, d, b, c, d], axis=1)
    odd = ((i + j) % 2).ravel().astype(bool)
    return vertices, np.where(odd[:, None], one, other).reshape(-1, 3)


def main() -> None:
    """Print the table."""
    print("| radius in edges | before | " + " | ".join(f"time {time:g}" for time in TIMES) + " |")
    print("|" + "---|" * (len(TIMES) + 2))
    for radius in RADII:
        vertices, faces = fillet(radius)
        mesh = core.TriangleMesh(vertices, faces)
        shares = [measure.crease_share(vertices, faces)]
        for time in TIMES:
            sharp = core.sharpen_geometry(mesh, core.GeometrySettings(time=time))
            shares.append(measure.crease_share(sharp, faces))
        print(f"| {radius} | " + " | ".join(f"{100 * share:.0f} %" for share in shares) + " |")


if __name__ == "__main__":
    main()
