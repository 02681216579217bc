# SPDX-License-Identifier: GPL-3.0-or-later
"""Patterns of two substances that react and diffuse on a surface, on paper B's elements."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..base.checks import Floats, as_array, by_keyword, checked_size
from ..base.parallel import kernel, run
from ..base.progress import ProgressCallback, aside, phase, reporting
from ..elements.matrices import TextureSpace
from ..elements.multigrid import SheetSolver
from ..elements.surface_values import painted_values
from ..errors import InvalidSignal
from ..mesh.directions import face_tensors
from ..mesh.nearest import nearest_point, point_tree, points_within
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import ReactionSettings, given_or_default
from .along_directions import checked_directions, clearness, stretched
from .texels import Texture, checked_atlas, drawn

_Single = npt.NDArray[np.float32]

_DIFFUSION = 0.2097, 0.105
"""Diffusivity of both substances at the scale `_SCALE`, in squared texels per step."""

_SCALE = 13.5

_TOLERANCE = 1e-4
"""Residual of each step relative to its right-hand side."""

_MOST_SWEEPS = 12
"""Sweeps of smoothing beyond which multigrid takes fewer operations."""

_COUNTED = 32
"""Sweeps are counted anew after this many steps, and after 1, 2, 4, 8... steps."""

_SPOT = 0.5
"""Radius of the spots from which patterns grow, relative to the scale."""

_APART = 0.9
"""Least distance between spots, relative to the scale."""

_CANDIDATES = 3.0
"""Number of candidates for spots per square of that distance."""

_LEAST_RATE = 0.1

_LEAST = np.float32(1e-12)
"""Values of the second substance below this become 0."""


@by_keyword
def reaction_diffusion(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    settings: ReactionSettings | None = None,
    *,
    size: tuple[int, int],
    start: npt.ArrayLike | None = None,
    rates: npt.ArrayLike | None = None,
    directions: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    at: str | None = None,
    atlas: TextureAtlas | None = None,
) -> _Single:
    """Generate stripes, spots or mazes on a surface by reaction-diffusion, across seams.

    Parameters
    ----------
    mesh, uv, progress, atlas
        As in `sharpen_texture`.
    size : (int, int)
        Rows and columns of the image.
    settings : ReactionSettings, optional
    start : (h, w, 2) array of float in [0, 1], optional
        Initial values of both substances, such as an earlier result to continue. Where they add up
        to more than 1, the first one is reduced. By default, the first one is everywhere, and the
        second one in random spots.
    rates : (h, w) array of float in [0, 10], optional
        Factors of the scale at each texel; values below 0.1 count as 0.1.
    directions : (m, 3) or (n, 3) array of float, optional
        At faces or at vertices; the pattern is stretched along them, see `stretch`. Signs and
        lengths do not matter; where a vector is zero, the pattern is isotropic.
    at : {"faces", "vertices"}, optional
        Where the directions are; needed where the mesh has as many faces as vertices.

    Returns
    -------
    (h, w, 2) float32
        Both substances, in [0, 1]. The second one shows the pattern, with values up to 0.4. The
        gutter around the charts is filled; the rest is 0.

    Raises
    ------
    InvalidUV, Cancelled
        As in `sharpen_texture`.
    InvalidSignal
        If start, rates or directions do not fit.
    InvalidSettings
        If the size cannot be used, or `at` is another word.
    SolverError
        If no solution is found.

    Notes
    -----
    The model of Gray and Scott (1984) with patterns after Pearson (1993):
    ``u' = D_u lap u - u v^2 + feed (1 - u)`` and ``v' = D_v lap v + u v^2 - (feed + kill) v``. Each
    step has the length 1, and is explicit in the reaction and implicit in the diffusion, whose
    systems are like those of paper B, section 6. The mass is lumped, so that steps keep the range
    of values where texels are not much stretched. A stripe must be about three texels wide: nothing
    grows in charts with longer texels.

    Patterns by feed and kill, and the steps after which they look finished:

    ========= ====== ====== ===== =============================================
    pattern   feed   kill   steps
    ========= ====== ====== ===== =============================================
    labyrinth 0.037  0.06    1000
    stripes   0.029  0.057   1500 a zebra's with directions and a stretch of 3
    dots      0.03   0.062   1500
    coral     0.0545 0.062   1500
    holes     0.039  0.058   1000 the reverse of dots
    ========= ====== ====== ===== =============================================

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = mesh.vertices[mesh.faces][..., :2]
    >>> settings = core.ReactionSettings(steps=200, scale=8.0)
    >>> image = core.reaction_diffusion(mesh, uv, size=(48, 48), settings=settings)
    >>> image.shape, bool(image[..., 1].max() > 0.2)
    ((48, 48, 2), True)
    """
    settings = given_or_default(settings, ReactionSettings)
    shape = checked_size(size)
    given = checked_directions(mesh, directions, at)
    first = _checked_start(start, shape)
    factors = _checked_rates(rates, shape)
    with reporting(progress):
        with phase(0.0, 0.05, "Finding texels"):
            pixels = np.zeros((*shape, 2), dtype=np.float32)
            texture = Texture(checked_atlas(atlas, mesh, uv, pixels), pixels)
            space = TextureSpace(texture.atlas)
            if first is None:
                first = _spots(texture.atlas, settings)
            values = painted_values(space, first)
        with phase(0.05, 0.97, "Growing a pattern"):
            if settings.steps:
                if given is not None:
                    space = space.diffusing(_tensors(mesh, given, settings.stretch))
                if factors is not None:
                    space = _varied(space, painted_values(space, factors[..., None])[:, 0])
                _grow(space, values, settings)
        with phase(0.97, 1.0, "Filling the gutter"):
            return np.clip(drawn(texture, space, values, settings.gutter), 0.0, 1.0)


class _Diffusion:
    # One step of one substance: solves (mass + diffusion stiffness) x = mass y for x from x = y.

    def __init__(self, space: TextureSpace, settings: ReactionSettings, diffusion: float) -> None:
        screen = (_SCALE / settings.scale) ** 2 / diffusion
        self._matrix = space.matrix(screen, lumped=True)
        self._smoother = SheetSolver(self._matrix, coarsen=False)
        self._solver: SheetSolver | None = None
        self._sweeps = 0  # that were enough when they were counted
        self.masses = self._matrix.screen

    def apply(self, rhs: _Single, x: _Single, count: bool) -> None:
        """Solve for (1, n), in place; `count` the sweeps that this takes, or do as many again."""
        if count:
            self._sweeps = 0
            while self._sweeps <= _MOST_SWEEPS and self._smoother.residual(rhs, x) > _TOLERANCE:
                self._smoother.relax(rhs, x)
                self._sweeps += 1
        elif self._sweeps <= _MOST_SWEEPS:
            for _ in range(self._sweeps):
                self._smoother.relax(rhs, x)
        if self._sweeps > _MOST_SWEEPS:
            self._solver = self._solver or SheetSolver(self._matrix)
            self._solver.solve(rhs.T, x.T, _TOLERANCE, message="Growing a pattern")


def _grow(space: TextureSpace, values: _Single, settings: ReactionSettings) -> None:
    # Steps in place.
    both = [_Diffusion(space, settings, diffusion) for diffusion in _DIFFUSION]
    substances = np.ascontiguousarray(values.T)
    sides = substances * np.stack([one.masses for one in both])
    steps = settings.steps
    for step in range(steps):
        count = step % _COUNTED == 0 or step & (step - 1) == 0
        with phase(step / steps, (step + 1) / steps, "Growing a pattern"):
            with aside("Growing a pattern"):
                run(_react, len(values), settings.feed, settings.kill, both[0].masses,
                    both[1].masses, substances, sides)  # fmt: skip
            for k, one in enumerate(both):
                with phase(0.5 * k, 0.5 * (k + 1), "Growing a pattern"):
                    one.apply(sides[k : k + 1], substances[k : k + 1], count)
    values[:] = substances.T


@kernel
def _react(start, stop, feed, kill, masses_u, masses_v, values, rhs):
    # One unit of time without diffusion; the right-hand sides are the masses times the result. The
    # initial guess adds the change by diffusion in the step before, whose right-hand sides are
    # still in `rhs`.
    feed, loss, one = np.float32(feed), np.float32(feed + kill), np.float32(1)
    us, vs = values[0, start:stop], values[1, start:stop]
    rhs_u, rhs_v = rhs[0, start:stop], rhs[1, start:stop]
    masses_u, masses_v = masses_u[start:stop], masses_v[start:stop]
    for i in range(len(us)):
        if masses_u[i] <= 0:
            continue
        u, v = us[i], vs[i]
        more_u, more_v = u - rhs_u[i] / masses_u[i], v - rhs_v[i] / masses_v[i]
        eaten = u * v * v
        u += feed * (one - u) - eaten
        v += eaten - loss * v
        # Far from patterns it would decrease forever, and arithmetic with denormal numbers is slow.
        v = v if v > _LEAST else np.float32(0)
        rhs_u[i], rhs_v[i] = masses_u[i] * u, masses_v[i] * v
        us[i], vs[i] = u + more_u, v + more_v


def _spots(atlas: TextureAtlas, settings: ReactionSettings) -> _Single:
    # At random places of the surface, however it is cut.
    mesh = atlas.mesh
    corners = mesh.vertices[mesh.faces]
    areas = np.linalg.norm(np.cross(*np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 0)), axis=1)
    distance = settings.scale * atlas.texel_size
    apart = _APART * distance
    count = int(np.clip(_CANDIDATES * 0.5 * areas.sum() / apart**2, 1, 1_000_000))
    random = np.random.default_rng(settings.seed)
    faces = np.searchsorted(np.cumsum(areas) / areas.sum(), random.random(count))
    shares = np.sort(random.random((count, 2)), axis=1)
    shares = np.stack([shares[:, 0], shares[:, 1] - shares[:, 0], 1.0 - shares[:, 1]], axis=1)
    places = np.einsum("sk,skx->sx", shares, corners[np.minimum(faces, len(corners) - 1)])
    # Of two close spots the first one stays (Matern 1960), which avoids clusters and large gaps.
    first, near = points_within(point_tree(places), places, apart)
    later = np.repeat(np.arange(len(places)), np.diff(first))
    places = np.delete(places, later[near < later], axis=0)
    texels = np.flatnonzero(atlas.inside)
    baked = atlas.bake(mesh.own_corners(corners)).reshape(-1, 3)
    away, _ = nearest_point(point_tree(places), baked[texels])
    inside = np.exp(-((away / (_SPOT * distance)) ** 4))
    start = np.zeros((atlas.height * atlas.width, 2), dtype=np.float32)
    start[:, 0] = 1.0
    start[texels] += inside[:, None] * np.array([-0.5, 0.25])
    return start.reshape(atlas.height, atlas.width, 2)


def _tensors(mesh: TriangleMesh, directions: Floats, stretch: float) -> Floats:
    # Diffusion is multiplied by the stretch along the direction, and divided by it across.
    tensors = face_tensors(mesh, directions)
    clear = clearness(tensors)
    return stretched(tensors, stretch**clear, stretch**-clear)


def _varied(space: TextureSpace, factors: _Single) -> TextureSpace:
    # Scales are proportional to the root of the diffusion.
    squares = np.maximum(factors, np.float32(_LEAST_RATE)).astype(np.float32) ** np.float32(2)
    other = space.weighted(space.means(squares.astype(np.float32)))
    other.cells[..., 3] = space.cells[..., 3]
    other.fans[:, 3] = space.fans[:, 3]
    return other


def _checked_start(start: npt.ArrayLike | None, shape: tuple[int, int]) -> _Single | None:
    if start is None:
        return None
    given = as_array(start, "start")
    if given.shape != (*shape, 2):
        raise InvalidSignal(f"The start has the shape {given.shape}; give {(*shape, 2)}.")
    if given.dtype.kind not in "biuf" or not np.isfinite(given).all():
        raise InvalidSignal("The start holds NaN, infinity or no numbers; give values in [0, 1].")
    if given.min() < 0 or given.max() > 1:
        raise InvalidSignal("The start leaves the range 0 to 1; clip or rescale it.")
    values = given.astype(np.float32)
    np.minimum(values[..., 0], 1.0 - values[..., 1], out=values[..., 0])
    return values


def _checked_rates(rates: npt.ArrayLike | None, shape: tuple[int, int]) -> _Single | None:
    if rates is None:
        return None
    given = as_array(rates, "rates")
    if given.shape != shape:
        raise InvalidSignal(f"The rates have the shape {given.shape}; give {shape}.")
    if given.dtype.kind not in "biuf" or not np.isfinite(given).all():
        raise InvalidSignal("The rates hold NaN, infinity or no numbers; give 1 for no change.")
    if given.min() < 0 or given.max() > 10:
        raise InvalidSignal("The rates leave the range 0 to 10; clip or rescale them.")
    return given.astype(np.float32)
