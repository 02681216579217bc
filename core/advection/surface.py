# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise that moves with a flow on a surface, as frames of its texture, across seams.

Charts are separate in the sheet of an atlas, where noise moves as in the plane. Steps that leave
their chart are computed once; each frame moves their nodes one by one.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.ghosts import nearest_nodes
from ..atlas.gutter import nodes_of_texels
from ..atlas.sheet import NOTHING, shares_of_corners
from ..atlas.steps import steps_beyond
from ..atlas.walk import face_axes, given_flow
from ..base.checks import Floats, as_array, by_keyword, checked_size
from ..base.parallel import kernel, run
from ..base.progress import ProgressCallback, part_of, phase, reporting
from ..errors import InvalidSettings, InvalidSignal
from ..mesh.directions import at_corners
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import DilateSettings, NoiseSettings, given_or_default
from ..texture.texels import checked_atlas
from .loops import Frames, repeating
from .noise import Noise, grays, mixed, reported
from .opacity import Look, checked_background, checked_colors
from .randomness import BEYOND, random_bits, row_key, stream
from .velocity import MOST_PIXELS, ROWS, Motion, checked_frames

_Singles = npt.NDArray[np.float32]

_LARGEST = 1e30

_ANALYSIS = 0.2
"""Share of the progress before the first frame."""


@by_keyword
def advect_on_surface(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    field: npt.ArrayLike,
    settings: NoiseSettings | None = None,
    *,
    size: tuple[int, int],
    frames: int = 100,
    at: str | None = None,
    background: npt.ArrayLike | None = None,
    colors: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    atlas: TextureAtlas | None = None,
) -> Frames:
    """Show a flow on a surface as moving noise: frames of its texture, across seams.

    Parameters
    ----------
    mesh, uv, atlas
        As in `sharpen_texture`.
    field : (m, 3) or (n, 3) array of float
        The velocity in space at faces or at vertices, in mean edge lengths a frame; its normal
        component is ignored. NaN where the flow is undefined.
    size : (int, int)
        Rows and columns of the frames.
    settings : NoiseSettings, optional
        Pixels are texels. `step` is the longest step in mean texel sizes; with 0, velocities are
        used unchanged. `periodic` is not for surfaces.
    frames, colors, progress
        As in `advect_noise`.
    at : {"faces", "vertices"}, optional
        Where the velocity is; needed where the mesh has as many faces as vertices.
    background : (h, w) or (h, w, 3) array of float, optional
        As in `advect_noise`; a texture of the surface.

    Yields
    ------
    (h, w) float32
        In [0, 1]; (h, w, 3) with a colored background or `colors`. The gutter around the charts is
        filled; the rest is 0, or the background.

    Raises
    ------
    InvalidUV
        As in `sharpen_texture`.
    InvalidSignal, InvalidSettings, Cancelled
        As in `advect_noise`.

    Notes
    -----
    Paper D, section 4, on a surface. Noise flows in at borders of the surface as at those of an
    image. The flow is the same in all frames.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]]
    >>> mesh = core.TriangleMesh(vertices, [[0, 1, 2], [0, 2, 3]])
    >>> uv = mesh.vertices[mesh.faces][..., :2] / 4
    >>> along = np.tile([1.0, 0.0, 0.0], (2, 1))
    >>> frames = list(core.advect_on_surface(mesh, uv, along, size=(32, 32), frames=3))
    >>> frames[0].shape, bool(np.abs(frames[1][:, 2:] - frames[0][:, :-2]).mean() < 0.1)
    ((32, 32), True)
    """
    settings = given_or_default(settings, NoiseSettings)
    if settings.periodic != "none":
        raise InvalidSettings("A surface has no sides that could be joined; leave periodic out.")
    count = checked_frames(frames, settings.loop)
    shape = checked_size(size)
    given = checked_vectors(mesh, field, at)
    behind = checked_background(background, shape)
    palette = checked_colors(colors)
    with reporting(part_of(progress, 0.0, _ANALYSIS)):
        with phase(0.0, 0.8, "Finding texels"):
            pixels = np.zeros((*shape, 1), dtype=np.float32)
            atlas = checked_atlas(atlas, mesh, uv, pixels)
        with phase(0.8, 1.0, "Finding seams"):
            flow = _SurfaceFlow(atlas, given, settings.step)
            texture = _Texture(atlas)
            look = Look(flow.longest, settings, behind, palette)
    shown = _shown(flow, texture, look, settings, count)
    return reported(shown, count, part_of(progress, _ANALYSIS, 1.0))


def _shown(
    flow: _SurfaceFlow, texture: _Texture, look: Look, settings: NoiseSettings, count: int
) -> Frames:
    def begin(first: int) -> Frames:
        noise = _SurfaceNoise(flow, settings)
        return grays(noise, lambda number: flow.motion, settings, first)

    speeds = texture.drawn(flow.speeds)
    defined = texture.drawn(flow.motion.defined.astype(np.float32)) > 0.5
    seen = Motion(speeds, np.zeros_like(speeds), defined)
    for gray in repeating(begin, count, settings.loop, mixed):
        yield look.shown(texture.drawn(gray), seen)


def checked_vectors(mesh: TriangleMesh, field: npt.ArrayLike, at: str | None) -> Floats:
    """Return velocities at the corners of faces; undefined vectors are NaN."""
    given = as_array(field, "field")
    at_corners(mesh, given, at, "field has")
    if given.dtype.kind not in "iuf":
        raise InvalidSignal(f"The field is of type {given.dtype}; give floats.")
    vectors = given.astype(np.float64)
    if (np.abs(vectors) > _LARGEST).any():
        raise InvalidSignal(
            "The field holds infinity or values beyond 1e30; give NaN where it is undefined."
        )
    vectors[np.isnan(vectors).any(axis=1)] = np.nan
    return at_corners(mesh, vectors, at, "field has")


class _SurfaceFlow:
    """A flow on a surface as steps in the sheet of its atlas.

    Attributes
    ----------
    motion : Motion
        Steps of the nodes; those that leave their chart are shortened here, and are in `beyond`.
    beyond : StepsBeyond
    ghosts : (k, 2) int32
        Ghosts, and the nodes whose noise they show.
    speeds : (rows, columns) float32
        On the surface, in mean texel sizes a frame.
    longest : float
        The greatest of these.
    reach : float
        The longest step inside a chart, in nodes of the sheet.
    """

    def __init__(self, atlas: TextureAtlas, field: Floats, step: float) -> None:
        mesh, nodes = atlas.mesh, atlas.sheet.nodes
        texels = mesh.mean_edge_length / atlas.texel_size
        tangential = _projected(mesh, field * texels)
        fastest = float(np.sqrt(np.nanmax((tangential**2).sum(axis=2), initial=0.0)))
        scale = 1.0 if step == 0 else (step / fastest if fastest > 0 else 0.0)
        self.longest = scale * fastest
        if self.longest > MOST_PIXELS:
            raise InvalidSignal(
                "The field is {most:.6g} texels a frame in places; give at most {bound}, or a step"
                " to which it is scaled.",
                most=self.longest,
                bound=MOST_PIXELS,
            )
        tangential *= scale
        shape = nodes.shape
        down, across = np.zeros(shape, dtype=np.float32), np.zeros(shape, dtype=np.float32)
        self.speeds = np.zeros(shape, dtype=np.float32)
        defined = np.zeros(shape, dtype=np.bool_)
        run(_lay, shape[0], nodes, atlas.sheet.points, face_axes(mesh),
            atlas.metric.inverse_jacobians, tangential, down, across, self.speeds, defined,
            chunk=ROWS)  # fmt: skip
        back = given_flow(atlas, -np.nan_to_num(tangential).mean(axis=1))
        self.beyond = steps_beyond(atlas, back, down, across)
        ghosts = atlas.sheet.ghosts
        copies = nearest_nodes(atlas.sheet, atlas.sources)[ghosts]
        self.ghosts = np.stack([ghosts, copies], axis=1)[copies != NOTHING]
        inside = np.hypot(down, across)
        inside.reshape(-1)[self.beyond.nodes] = 0.0
        self.reach = float(inside.max(initial=0.0))
        far = self.beyond.nodes
        length = np.hypot(down.reshape(-1)[far], across.reshape(-1)[far])
        shorter = np.minimum(1.0, self.reach / np.maximum(length, 1e-30)).astype(np.float32)
        down.reshape(-1)[far] *= shorter
        across.reshape(-1)[far] *= shorter
        self.motion = Motion(across, down, defined)


def _projected(mesh: TriangleMesh, field: Floats) -> Floats:
    # The tangential part of a field, at the corners of faces: (m, 3, 3).
    normals = mesh.normals[:, None]
    flat = field - (field * normals).sum(axis=2, keepdims=True) * normals
    return np.array(np.broadcast_to(flat, (mesh.face_count, 3, 3)))


class _SurfaceNoise(Noise):
    """Noise in the sheet of an atlas that moves across seams."""

    def __init__(self, flow: _SurfaceFlow, settings: NoiseSettings) -> None:
        self._flow = flow
        rows, columns = flow.motion.right.shape
        super().__init__((rows, columns), flow.reach, settings, len(flow.beyond.nodes))

    def find_places(self, motion: Motion) -> None:
        """Find the source of each node; places beyond seams follow those of the sheet."""
        super().find_places(motion)
        nodes = self._flow.beyond.nodes
        self.places.reshape(-1)[nodes] = self.quads.size - len(nodes) + np.arange(len(nodes))

    def make_ready(self, number: int) -> None:
        """Fill ghosts, and gather the values that the next step reads, also beyond seams."""
        cells, beyond = self.cells, self._flow.beyond
        ghosts, nodes = self._flow.ghosts.T
        columns = cells.shape[1]
        cells[np.divmod(ghosts, columns)] = cells[np.divmod(nodes, columns)]
        super().make_ready(number)
        fresh = stream(self._settings.seed, number, BEYOND)
        count = len(beyond.nodes)
        run(_join_beyond, count, beyond, cells, fresh, self.quads[self.quads.size - count :])


class _Texture:
    """Draws the values of a sheet into an image."""

    def __init__(self, atlas: TextureAtlas) -> None:
        self._nodes = nodes_of_texels(atlas, DilateSettings())

    def drawn(self, values: _Singles) -> _Singles:
        image = np.empty(self._nodes.shape, dtype=np.float32)
        run(_draw, len(image), self._nodes, values.reshape(-1), image, chunk=ROWS)
        return image


@kernel
def _draw(start, stop, nodes, values, image):
    for y in range(start, stop):
        for x in range(nodes.shape[1]):
            node = nodes[y, x]
            image[y, x] = values[node] if node != NOTHING else np.float32(0)


@kernel
def _lay(start, stop, nodes, points, axes, inverse_jacobians, field, down, across, speeds, defined):
    for y in range(start, stop):
        for x in range(nodes.shape[1]):
            f = nodes[y, x]
            if f < 0:
                continue
            shares = shares_of_corners(points, f, y, x)
            u = v = 0.0
            for corner in range(3):
                for k in range(3):
                    part = shares[corner] * field[f, corner, k]
                    u += part * axes[f, 0, k]
                    v += part * axes[f, 1, k]
            if u == u and v == v:
                defined[y, x] = True
                down[y, x] = inverse_jacobians[f, 0, 0] * u + inverse_jacobians[f, 0, 1] * v
                across[y, x] = inverse_jacobians[f, 1, 0] * u + inverse_jacobians[f, 1, 1] * v
                speeds[y, x] = np.sqrt(u * u + v * v)


@kernel
def _join_beyond(start, stop, beyond, cells, key, quads):
    columns = cells.shape[1]
    for i in range(start, stop):
        y, x = divmod(beyond.nodes[i], columns)
        bits = random_bits(row_key(key, y), x)
        quad = np.uint8(0)
        for k in range(4):
            source = beyond.sources[i, k]
            bit = np.uint8((bits >> np.uint32(k)) & np.uint32(1))
            if source != NOTHING:
                bit = cells[source // columns, source % columns]
            quad |= bit << k
        quads[i] = quad
