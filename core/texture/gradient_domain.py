# SPDX-License-Identifier: GPL-3.0-or-later
"""Gradient-domain filters of textures, across seams (paper B, sections 6 and 7)."""

from __future__ import annotations

from functools import cached_property
from threading import Lock

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.ghosts import fill_ghosts
from ..atlas.gutter import unit_normals
from ..atlas.sheet import ROWS
from ..base.checks import LARGEST, as_array, by_keyword, checked_image, checked_weights
from ..base.parallel import kernel, run
from ..base.progress import ProgressCallback, phase, reporting
from ..elements.matrices import CellWeights, TextureSpace
from ..elements.multigrid import SheetSolver
from ..elements.surface_values import (
    added_to_sheet,
    corner_values,
    painted_values,
    surface_values,
)
from ..errors import InvalidSignal
from ..grid.channels import opacity_channel
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import FilterSettings, given_or_default
from .normal_maps import checked_normals
from .texels import (
    Output,
    Texture,
    check_content,
    checked_atlas,
    gathered,
    mix_texels,
    normals_of,
)

_TOLERANCE = 1e-3
"""Residual of the solution relative to the right-hand side; the error is far below one 8-bit level.
"""

_LEAST_OPACITY = 1e-4
"""Weight of transparent texels, so that they get colors."""

_MOST_GAIN = 100.0


@by_keyword
def filter_texture(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    image: npt.ArrayLike,
    settings: FilterSettings | None = None,
    *,
    gain: npt.ArrayLike | None = None,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    normals: npt.ArrayLike | None = None,
    atlas: TextureAtlas | None = None,
) -> npt.NDArray:
    """Raise or smooth the detail of a texture on its surface, across seams.

    The gradients of the texture are multiplied by a gain. Structures larger than the radius in the
    settings stay, as screening keeps values near those of the input.

    Parameters
    ----------
    mesh, uv, image, progress, atlas
        As in `sharpen_texture`.
    settings : FilterSettings, optional
    gain : (h, w) array of float in [0, 100], optional
        The gain of each texel, instead of that in the settings; 1 where nothing is to change.
    mask : (h, w) array of float in [0, 1], optional
        1 applies the full change, less mixes with the input, 0 keeps the input bit for bit.
    normals : (m, 3, 3) array of float, optional
        The mesh's shading normals at the corners of its faces, for textures of tangent-space
        normals. Default: smooth normals.

    Returns
    -------
    array like `image`
        Opacity stays. Whole numbers are clipped to their range; floats may go beyond the input's.
        The gutter around the charts is filled anew, whatever the image holds there. A gain of 1
        returns the input bit for bit.

    Raises
    ------
    InvalidUV, InvalidSignal, Cancelled
        As in `sharpen_texture`; also if gains do not fit the image, or if a normal map does not
        have three or four channels.
    SolverError
        If no solution is found.

    Notes
    -----
    Paper B, sections 6 and 7.1: x minimizes ``|x - y|^2 / radius^2 + |grad x - gain grad y|^2`` on
    the surface, lengths in mean texel sizes, for the texture y. It is solved for the correction
    x - y. Normals are solved for as vectors of the object's space, in the frames of MikkTSpace
    (Mikkelsen 2008), and then normalized. `core.elements.matrices` says how its elements differ
    from the paper's. Both terms are weighted by the opacity of the texels.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = mesh.vertices[mesh.faces][..., :2]
    >>> image = np.tile(0.5 + 0.2 * np.sin(np.arange(32.0)), (32, 1))
    >>> strong = core.filter_texture(mesh, uv, image, core.FilterSettings(gain=2.0))
    >>> [round(float(np.ptp(rows[16])), 1) for rows in (image, strong)]
    [0.4, 0.8]
    """
    given = checked_image(image, LARGEST)
    settings = given_or_default(settings, FilterSettings)
    gains = _checked_gain(gain, given)
    weights = checked_weights(mask, given)
    with reporting(progress):
        with phase(0.0, 0.6, "Finding texels"):
            if gains is None and settings.is_neutral:
                pixels = given.reshape(*given.shape[:2], -1)
                check_content(pixels, settings)
                checked_atlas(atlas, mesh, uv, pixels)
                return given.copy()
            solver = TextureSolver(mesh, uv, given, settings, normals=normals, atlas=atlas)
        with phase(0.6, 1.0, "Filtering"):
            return solver.filtered(gains, mask=weights)


class TextureSolver:
    """The gradient-domain filter of one texture, set up once for many gains.

    The first result takes as long as `filter_texture`; each further one, for other gains, takes a
    fraction of that. A gain for all texels needs no new solution, as the change is proportional to
    gain - 1.

    Parameters
    ----------
    mesh, uv, image, progress, normals, atlas
        As in `filter_texture`.
    settings : FilterSettings, optional

    Raises
    ------
    InvalidUV, InvalidSignal, SolverError, Cancelled
        As in `filter_texture`.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = mesh.vertices[mesh.faces][..., :2]
    >>> image = np.tile(0.5 + 0.2 * np.sin(np.arange(32.0)), (32, 1))
    >>> solver = core.TextureSolver(mesh, uv, image)
    >>> [round(float(np.ptp(solver.filtered(gain)[16])), 1) for gain in (0.0, 1.0, 2.0)]
    [0.0, 0.4, 0.8]
    """

    @by_keyword
    def __init__(
        self,
        mesh: TriangleMesh,
        uv: npt.ArrayLike,
        image: npt.ArrayLike,
        settings: FilterSettings | None = None,
        *,
        progress: ProgressCallback | None = None,
        normals: npt.ArrayLike | None = None,
        atlas: TextureAtlas | None = None,
    ) -> None:
        given = checked_image(image, LARGEST).copy()
        self._image = given
        self._settings = settings = given_or_default(settings, FilterSettings)
        pixels = given.reshape(*given.shape[:2], -1)
        check_content(pixels, settings)
        corners = checked_normals(mesh, normals)
        alpha = opacity_channel(pixels.shape[2], settings.alpha)
        with reporting(progress):
            with phase(0.0, 0.4, "Finding texels"):
                texture = Texture(checked_atlas(atlas, mesh, uv, pixels), pixels, alpha)
                texture = normals_of(texture, settings, corners)
                self._texture, self._values = gathered(texture, settings)
            with phase(0.4, 0.7, "Measuring texels"):
                sheet = self._texture.atlas.sheet
                known = fill_ghosts(sheet, self._texture.atlas.sources, self._values, alpha)
                space = TextureSpace(self._texture.atlas)
                at_corners = corner_values(space, self._values, known, alpha)
                values = surface_values(space, self._values, at_corners)
                if alpha >= 0:
                    opacity = np.maximum(values[:, alpha], _LEAST_OPACITY)
                    space = space.weighted(space.least(opacity))
                    values = np.delete(values, alpha, axis=1)
                self._space, self._input = space, np.ascontiguousarray(values)
            with phase(0.7, 1.0, "Coarsening"):
                matrix = space.matrix(settings.radius**-2.0)
                self._solver, self._masses = SheetSolver(matrix), matrix.screen
        self._change = np.zeros_like(self._input)
        self._shares = np.zeros(len(self._input), dtype=np.float32)
        self._one_at_a_time = Lock()

    @by_keyword
    def filtered(
        self,
        gain: npt.ArrayLike | None = None,
        *,
        mask: npt.ArrayLike | None = None,
        progress: ProgressCallback | None = None,
    ) -> npt.NDArray:
        """Return the texture with its gradients multiplied.

        Parameters
        ----------
        gain : float or (h, w) array of float in [0, 100], optional
            For all texels, or for each. Default: the gain in the settings.
        mask, progress
            As in `filter_texture`.

        Raises
        ------
        InvalidSignal, SolverError, Cancelled
            As in `filter_texture`.
        """
        if gain is None:
            gain = self._settings.gain
        gains = _checked_gain(gain, self._image)
        assert gains is not None
        weights = checked_weights(mask, self._image)
        if (gains == 1).all():
            return self._image.copy()
        with reporting(progress):
            with phase(0.0, 0.7, "Filtering"), self._one_at_a_time:
                result = self._changed(gains)
            with phase(0.7, 1.0, "Filling the gutter"):
                return self._written(result, weights)

    def _changed(self, gains: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        # The filtered values of nodes.
        change, factor = self._change, 1.0
        if gains.ndim:
            shares = painted_values(self._space, (gains - np.float32(1.0))[..., None])[:, 0]
            if "_of_unit" in vars(self):
                run(_warm_start, len(shares), shares, self._shares, self._of_unit, change)
            self._shares = shares
            self._solve(self._space.means(shares), change)
        else:
            change, factor = self._of_unit, float(gains) - 1.0
        alpha = self._texture.alpha
        return added_to_sheet(self._space, self._values, self._input, change, factor, alpha)

    @cached_property
    def _of_unit(self) -> npt.NDArray[np.float32]:
        # The change for a gain of 2.
        change = np.zeros_like(self._input)
        self._solve(self._space.alike, change)
        return change

    @cached_property
    def _output(self) -> Output:
        return Output(self._texture, self._settings)

    def _solve(self, gains: CellWeights, change: npt.NDArray[np.float32]) -> None:
        rhs = self._space.apply_stiffness(self._input, gains)
        self._solver.solve(rhs, change, _TOLERANCE, message="Filtering")
        # The exact change has a mean of 0. An error of the mean hardly shows in the residual.
        self._space.without_means(change, self._masses, change)

    def _written(
        self, result: npt.NDArray[np.float32], weights: npt.NDArray[np.float64] | None
    ) -> npt.NDArray:
        keep = None
        if self._texture.unit:
            run(unit_normals, len(result), result, chunk=ROWS)
        if weights is not None:
            mix_texels(self._texture.atlas, self._values, 1.0, weights, result)
            keep = weights == 0
        return self._output.written(result, keep).reshape(self._image.shape)


@kernel
def _warm_start(start, stop, shares, before, unit, change):
    # The solution for the previous gains, corrected, is the initial guess for new ones. Where the
    # gain is constant over a wide area, the change is that of a uniform gain, times gain - 1.
    for i in range(start, stop):
        more = shares[i] - before[i]
        if more != 0:
            for c in range(change.shape[1]):
                change[i, c] += more * unit[i, c]


def _checked_gain(gain: npt.ArrayLike | None, given: npt.NDArray) -> npt.NDArray | None:
    # As float32: (), or (h, w) of the image.
    if gain is None:
        return None
    gains = as_array(gain, "gain")
    if gains.ndim and gains.shape != given.shape[:2]:
        raise InvalidSignal(f"The gain has the shape {gains.shape}; give {given.shape[:2]}.")
    if gains.dtype.kind not in "fiu" or not np.isfinite(gains).all():
        raise InvalidSignal("The gain holds NaN, infinity or no numbers; give 1 for no change.")
    if gains.min() < 0 or gains.max() > _MOST_GAIN:
        raise InvalidSignal(f"The gain leaves the range 0 to {_MOST_GAIN:g}; clip or rescale it.")
    return gains.astype(np.float32)
