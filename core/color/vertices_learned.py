# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening of signals at the vertices of a mesh by the learned recipe for images."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from ..base.progress import aside, ask, phase
from ..flow.borders import measured
from ..grid.borders import Borders
from ..grid.channels import brightness_weights
from ..mesh.triangle_mesh import Floats, TriangleMesh
from ..mixture.network import Network, digest, load
from ..settings import WIDTH_OF_SIGMA, ShockSettings
from .learned.first import SIGMAS
from .learned.images import detail_of, ends_of, span_of, typical_detail
from .learned.recipe import DEFINITION as DEFINITION_OF_IMAGES
from .learned.recipe import FAINT, STAGES, Wishes, sharpened
from .learned.report import tell_learned
from .learned.surroundings import WIDEST
from .vertex_planes import VertexPlanes, Vertices

WEIGHTS = Path(__file__).with_name("learned") / "vertices.npz"

DEFINITION = digest("vertices 1", DEFINITION_OF_IMAGES)
"""Digest of what the features mean: those of images, and how uneven the mesh is."""

_ROUNDING = 16 * float(np.finfo(np.float32).eps)
"""Changes up to this share of the signal's range count as none."""


@cache
def networks() -> list[Network]:
    """Load the networks that weigh the differences, one for each stage."""
    found = load(WEIGHTS, DEFINITION)
    return [found[name] for name in STAGES]


def is_learned(settings: ShockSettings) -> bool:
    """Return whether signals are sharpened by the learned recipe: if no time or What is given."""
    return settings.by_width and settings.what == "auto"


def sharpen_vertices_learned(
    vertices: Vertices,
    values: Floats,
    settings: ShockSettings,
    nets: list[Network] | None = None,
) -> Floats:
    """Sharpen channels that follow one flow: (n, c) -> (n, c).

    Values that do not change keep their bits. Each value stays in the range of the input within 7
    steps around, up to rounding to single precision.

    Parameters
    ----------
    vertices : Vertices
    values : (n, c) float64
    settings : ShockSettings
    nets : list of Network, optional
        One for each stage; by default the shipped ones.
    """
    nets = networks() if nets is None else nets
    low, high = values.min(axis=0), values.max(axis=0)
    middle, span = _middle_and_span(values)
    if not span > 0:
        return values
    ask()
    planes = VertexPlanes.of_vertices(vertices, (values - middle) / span)
    with phase(0.0, 0.2, "Sharpening"):
        detail = detail_at(planes)
        smooth = planes.smoothed(SIGMAS, 0, vertices.rows)[-1]
        spread = span_of(*ends_of(smooth, vertices.inside))
    brightness = np.zeros(0 if settings.channels != "luminance" else values.shape[1], np.float32)
    if len(brightness):
        weights = brightness_weights(values.shape[1])
        brightness[: len(weights)] = weights
    width = settings.width / WIDTH_OF_SIGMA / vertices.typical_unit
    nearest = settings.sampling == "nearest"
    square = min(width, WIDEST) ** 2
    wishes = Wishes(FAINT * detail, square, settings.smoothing_passes, nearest, spread)
    with phase(0.2, 1.0, "Sharpening"):
        sharp = sharpened(planes, brightness, wishes, nets=nets)
    change = vertices.values_of(sharp - planes.values).astype(np.float64)
    result = np.clip(values + span * change, low, high)
    return np.where(np.abs(change) > _ROUNDING, result, values)


def detail_at(planes: VertexPlanes) -> float:
    """Measure the mean squared difference to a smoothing, in cells all over the mesh."""
    vertices = planes.vertices
    smooth = planes.smoothed(SIGMAS, 0, vertices.rows)[-1]
    away = vertices.values_of(detail_of(planes.values, smooth)).mean(axis=1, dtype=np.float64)
    details, areas = vertices.means.of_large_cells(away)
    return typical_detail(details, areas) if len(details) else 0.0


def tell_sharpened(mesh: TriangleMesh, values: Floats, result: Floats | None) -> None:
    """Report what sharpening did."""
    with aside("Measuring borders"):
        vertices = Vertices(mesh)
        before, after = _measured(vertices, values, values), None
        if result is not None and not np.array_equal(result, values):
            after = _measured(vertices, result, values)
    tell_learned("edge lengths", before, after)


def _measured(vertices: Vertices, values: Floats, given: Floats) -> Borders:
    found = measured(vertices.mesh, values)
    middle, span = _middle_and_span(given)
    detail = 0.0
    if span > 0:
        detail = detail_at(VertexPlanes.of_vertices(vertices, (values - middle) / span))
    return Borders(width=found.width, number=found.seen, noise=found.noise, detail=detail)


def _middle_and_span(values: Floats) -> tuple[Floats, float]:
    low, high = values.min(axis=0), values.max(axis=0)
    return 0.5 * low + 0.5 * high, float((high - low).max())
