# SPDX-License-Identifier: GPL-3.0-or-later
"""Streaks along a field of directions, in a texture, across seams (paper B, section 7.4)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..base.checks import Floats, by_keyword, checked_size
from ..base.parallel import kernel, run
from ..base.progress import ProgressCallback, aside, phase, reporting
from ..elements.matrices import TextureSpace
from ..elements.multigrid import SheetSolver
from ..mesh.directions import face_tensors, principal_directions
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import StreakSettings, given_or_default
from .along_directions import checked_directions, clearness, stretched
from .texels import Texture, checked_atlas, drawn

_Single = npt.NDArray[np.float32]

_TOLERANCE = 3e-3
"""Residual of the solution relative to the right-hand side."""

_ROUGHLY = 0.02
"""The same for the measurement of contrast."""

_DEVIATION = 0.18
"""Standard deviation of the values at a contrast of 1."""

_AROUND, _LEAST_AROUND = 10.0, 10.0
"""Radius within which contrast is measured, in widths of a streak, and its least value in texels.
"""

_FAINTEST = 0.01
"""Squared contrasts below this share of their mean are not raised further."""

_LEAST_WIDTH = 0.02
"""Least ratio of the width of streaks to their length; below it, the system cannot be solved."""


@by_keyword
def surface_line_convolution(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    settings: StreakSettings | None = None,
    *,
    size: tuple[int, int],
    directions: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    at: str | None = None,
    atlas: TextureAtlas | None = None,
) -> _Single:
    """Draw noise as streaks along directions on the surface, across seams.

    Parameters
    ----------
    mesh, uv, progress, atlas
        As in `sharpen_texture`.
    size : (int, int)
        Rows and columns of the image.
    directions : (m, 3) or (n, 3) array of float, optional
        At faces or at vertices, such as from `gradient_directions` or `axis_directions`. Signs and
        lengths do not matter; where a vector is zero, there are grains instead of streaks. Default:
        the directions of least curvature, see `principal_directions`.
    settings : StreakSettings, optional
    at : {"faces", "vertices"}, optional
        Where the directions are; needed where the mesh has as many faces as vertices.

    Returns
    -------
    (h, w) float32
        In [0, 1], with a mean of 0.5. The gutter around the charts is filled; the rest is 0.

    Raises
    ------
    InvalidUV, Cancelled
        As in `sharpen_texture`.
    InvalidSignal
        If the directions do not fit the mesh.
    InvalidSettings
        If the size cannot be used, or `at` is another word.
    SolverError
        If no solution is found.

    Notes
    -----
    White noise is diffused, in one implicit step, by a tensor that is 1 along the direction and
    (width / length)^2 across. Paper B smooths a random value of each texel; here the variance of
    the noise depends on the area, so that streaks do not change at seams or with the texel density.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = mesh.vertices[mesh.faces][..., :2] / 4
    >>> along = core.axis_directions(mesh, [1, 0, 0])
    >>> image = core.surface_line_convolution(mesh, uv, size=(64, 64), directions=along)
    >>> rough = [float(np.abs(np.diff(image, axis=axis)).mean()) for axis in (0, 1)]
    >>> rough[0] > 4 * rough[1]
    True
    """
    settings = given_or_default(settings, StreakSettings)
    shape = checked_size(size)
    given = checked_directions(mesh, directions, at)
    with reporting(progress):
        with phase(0.0, 0.1, "Finding directions"):
            tensors = _tensors(mesh, given, settings)
        with phase(0.1, 0.4, "Finding texels"):
            pixels = np.zeros((*shape, 1), dtype=np.float32)
            texture = Texture(checked_atlas(atlas, mesh, uv, pixels), pixels)
            space = TextureSpace(texture.atlas)
        with phase(0.4, 0.75, "Drawing streaks"):
            values = _streaks(space.diffusing(tensors), settings)
        with phase(0.75, 0.9, "Drawing streaks"):
            _even_out(space, settings, values)
        with phase(0.9, 1.0, "Filling the gutter"):
            image = drawn(texture, space, values, settings.gutter)
            return np.clip(image[..., 0], 0.0, 1.0)


def _streaks(space: TextureSpace, settings: StreakSettings) -> _Single:
    screen = 2.0 / settings.length**2
    matrix = space.matrix(screen)
    solver = SheetSolver(matrix)
    with aside("Drawing streaks"):
        noise = np.zeros((space.size, 1), dtype=np.float32)
        masses = matrix.screen.astype(np.float64) / screen
        used = np.concatenate(
            [space.labels.reshape(-1) >= 0, np.ones(space.size - space.labels.size, dtype=np.bool_)]
        )
        run(_make_noise, space.size, used, masses, np.uint64(settings.seed), noise[:, 0])
    values = np.zeros_like(noise)
    solver.solve(noise, values, _TOLERANCE, message="Drawing streaks")
    return values


def _even_out(space: TextureSpace, settings: StreakSettings, values: _Single) -> None:
    # Equalizes the local contrast, in place: streaks nearly as long as a limb have little contrast.
    screen = max(_AROUND * settings.width, _LEAST_AROUND) ** -2.0
    matrix = space.matrix(screen)
    solver, masses = SheetSolver(matrix), matrix.screen[:, None]
    used = masses[:, 0] > 0

    def around(squares: _Single) -> _Single:
        found = np.zeros_like(squares)
        solver.solve(masses * squares, found, _ROUGHLY, message="Drawing streaks")
        return found

    values -= around(values)
    squares = values * values
    with aside("Drawing streaks"):
        weights = masses[used, 0].astype(np.float64) / masses.sum(dtype=np.float64)
        mean = weights @ squares[used, 0]
    local = np.maximum(around(squares), np.float32(max(_FAINTEST * mean, 1e-30)))
    with aside("Drawing streaks"):
        flat = (values / np.sqrt(local))[used, 0].astype(np.float64)
        flat -= weights @ flat
        scale = settings.contrast * _DEVIATION / max(np.sqrt(weights @ flat**2), 1e-30)
        values[used, 0] = np.clip(0.5 + scale * flat, 0.0, 1.0)


def _tensors(mesh: TriangleMesh, given: Floats | None, settings: StreakSettings) -> Floats:
    # Diffusion tensors: in each direction, the squared reach relative to the length.
    directions = principal_directions(mesh)[mesh.faces] if given is None else given
    tensors = face_tensors(mesh, directions)
    clear = clearness(tensors)
    if given is None:
        trace = tensors[:, 0] + tensors[:, 2]
        clear *= np.minimum(np.sqrt(trace) * 2.0, 1.0)
    across = max(settings.width / settings.length, _LEAST_WIDTH)
    # The area of smoothing is the same everywhere, so the variance of the noise is, too.
    return stretched(tensors, across ** (1.0 - clear), across ** (1.0 + clear))


@kernel
def _mix(x):
    # The finalizer of splitmix64 (Steele, Lea, Flood 2014).
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@kernel
def _make_noise(start, stop, used, masses, seed, out):
    # The integral of white noise around each unknown: its variance is the area there.
    step = np.uint64(0x9E3779B97F4A7C15)
    for i in range(start, stop):
        if used[i]:
            bits = _mix(_mix(seed * step + step) + np.uint64(i) * step)
            even = np.float64(bits >> np.uint64(11)) * 2.0**-53
            out[i] = np.sqrt(12.0 * masses[i]) * (even - 0.5)
