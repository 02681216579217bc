# SPDX-License-Identifier: GPL-3.0-or-later
"""The space in which a mesh is measured whose object has an uneven scale.

Needs numpy only, so that a host can read its data before the compiled kernels are loaded.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_CLEARLY = 0.01
"""By how much the quality of the triangles is higher in an object's own space than in the scaled
shape where its own space counts. Closer ones give equally good results in both, so that it does not
matter on which side of this limit a mesh lies."""

_SAMPLE = 1 << 16
"""Most triangles to look at."""


def even_lengths(
    positions: npt.NDArray[np.float32], triangles: npt.NDArray[np.int32], to_world: Floats
) -> Floats:
    """Choose whether lengths are measured in the scaled shape or in the object's own space: (3, 3).

    Filters take the mean edge length for the resolution of the mesh in all directions. That holds
    in the space in which the mesh was made: Blender's remeshes make triangles even in the object's
    own space, whatever its scale; scans and imports may be even in the scaled shape. So lengths
    are measured where the mean quality of the triangles is higher. The quality of a triangle is
    4 sqrt(3) times its area over the sum of its squared sides: 1 for equilateral ones, 0 for those
    without area. This is not in the papers.

    Parameters
    ----------
    positions : (n, 3) float32
        In the object's space.
    triangles : (m, 3) int32
    to_world : (3, 3) float64
        The object's scale, shear and rotation; the identity if the scale is even.

    Returns
    -------
    (3, 3) float64
        `to_world`, which also counts where there is little difference; or, for the object's own
        space, the multiple of the identity with which the mean edge is as long as after
        `to_world`, so that lengths in reports are those of the scene.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter.core.mesh.evenness import even_lengths
    >>> corners = np.float32([(0, 0, 0), (1, 0, 0), (0.5, 0.9, 0)])
    >>> squeezed = np.diag([1.0, 0.1, 1.0])
    >>> even_lengths(corners, np.int32([(0, 1, 2)]), squeezed).round(2)
    array([[0.66, 0.  , 0.  ],
           [0.  , 0.66, 0.  ],
           [0.  , 0.  , 0.66]])
    """
    if np.array_equal(to_world, np.identity(3)):
        return to_world
    if len(triangles) > _SAMPLE:  # at random, since regular meshes repeat themselves
        chosen = np.random.default_rng(0).integers(len(triangles), size=_SAMPLE)
        triangles = triangles[chosen]
    with np.errstate(invalid="ignore"):  # places that are no numbers are reported later
        points = positions[triangles].astype(np.float64)
        sides = points - np.roll(points, 1, axis=1)
        stretched = sides @ to_world.T
        if not _quality(sides) > _quality(stretched) + _CLEARLY:
            return to_world
    return np.identity(3) * (_mean_length(stretched) / _mean_length(sides))


def _quality(sides: Floats) -> float:
    # The mean over triangles, by their sides (m, 3, 3).
    areas = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    squares = np.einsum("ijk,ijk->i", sides, sides)
    return float((4.0 * np.sqrt(3.0) * areas / np.where(squares == 0.0, 1.0, squares)).mean())


def _mean_length(sides: Floats) -> float:
    return float(np.linalg.norm(sides, axis=2).mean())
