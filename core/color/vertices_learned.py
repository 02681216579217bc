# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening of signals at the vertices of a mesh by the recipe that images have learned."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.progress import aside, phase
from ..grid.channels import brightness_weights
from ..mesh.triangle_mesh import Floats, TriangleMesh
from ..mixture.network import Network
from ..settings import WIDTH_OF_SIGMA, ShockSettings
from .learned.first import SIGMAS
from .learned.images import detail_of, typical_detail
from .learned.recipe import FAINT, Wishes, sharpened
from .learned.surroundings import WIDEST
from .vertex_planes import VertexPlanes, Vertices

_ROUNDING = 16 * float(np.finfo(np.float32).eps)
"""Relative changes, of the signal's range, that count as none."""


def sharpen_vertices_learned(
    vertices: Vertices,
    values: Floats,
    settings: ShockSettings,
    nets: list[Network] | None = None,
) -> Floats:
    """Sharpen channels that follow one flow: (n, c) -> (n, c).

    Values that do not change keep their bits.
    """
    low, high = values.min(axis=0), values.max(axis=0)
    middle, span = 0.5 * low + 0.5 * high, float((high - low).max())
    if not span > 0:
        return values
    planes = VertexPlanes.of_vertices(vertices, (values - middle) / span)
    with phase(0.0, 0.2, "Sharpening"):
        detail = detail_at(planes)
    brightness = np.empty(0, np.float32)
    if settings.channels == "luminance":
        brightness = brightness_weights(values.shape[1]).astype(np.float32)
        planes_of_color = len(brightness)
        brightness = np.pad(brightness, (0, values.shape[1] - planes_of_color))
    width = settings.width / WIDTH_OF_SIGMA / vertices.typical_unit
    wishes = Wishes(
        FAINT * detail, min(width, WIDEST) ** 2, settings.smoothing_passes,
        settings.sampling == "nearest",
    )  # fmt: skip
    with phase(0.2, 1.0, "Sharpening"):
        sharp = sharpened(planes, brightness, wishes, nets=nets)
    change = np.float64(vertices.values_of(sharp - planes.values))
    result = np.clip(values + span * change, low, high)
    return np.where(np.abs(change) > _ROUNDING, result, values)


def detail_at(planes: VertexPlanes) -> float:
    """Measure how much a smoothing takes away, as a mean square, in cells all over the mesh."""
    vertices = planes.vertices
    smooth = planes.smoothed(SIGMAS, 0, vertices.rows)[-1]
    away = vertices.values_of(detail_of(planes, smooth)).mean(axis=1, dtype=np.float64)
    details, areas = vertices.means.of_large_cells(away)
    return typical_detail(details, areas) if len(details) else 0.0


def is_learned(settings: ShockSettings) -> bool:
    """Whether signals are sharpened by the learned recipe: not if a time or What is given."""
    return settings.by_width and settings.what == "auto"
