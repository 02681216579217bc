# SPDX-License-Identifier: GPL-3.0-or-later
"""Run each filter once on tiny examples: all kernels that hosts call, with all their types.

The extension's library of kernels is made of these, and numba compiles and keeps them on disk
elsewhere. The calling code determines the types for which a kernel is compiled, so that code is
run. Examples have the types that a host reads (`inputs`), with and without masks; settings are the
defaults and each other choice.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from ..base.findings import gathering
from ..base.progress import ProgressCallback
from ..host.advection import FlowPlane, FlowSurface, frames_of
from ..host.colors import filter_colors
from ..host.creases import creases_of
from ..host.denoising import filter_both
from ..host.fields import FieldSurface, generate
from ..host.geometry import filter_shape
from ..host.images import filter_image
from ..host.inputs import (
    ColoredSurface,
    CutSurface,
    Denoising,
    HostImage,
    MirroredSurface,
    PaintedSurface,
    TexturedFaces,
    TexturedSurface,
)
from ..host.low_poly import low_poly_of
from ..host.textures import filter_texture
from ..maps.baking import MAPS, bake_maps
from ..maps.curvature_map import curvature_directions
from ..maps.occlusion import bent_normals
from ..maps.wear import wear
from ..mesh.triangle_mesh import TriangleMesh
from ..preview.flow import flow_of_colors, flow_of_shape
from ..registry import FILTERS, Filter, find
from ..settings import (
    BakeSettings,
    GeometrySettings,
    OcclusionSettings,
    ShockSettings,
    WearSettings,
    describe,
    named,
)
from ..shape.denoising import denoise_geometry
from ..shape.folds import mended
from ..shape.results import tell_lost
from .arrays import runs_on_images, runs_on_meshes, runs_on_textures

_CORE = __package__.rpartition(".")[0]

_CELLS = 12
"""Quads along each edge of the box: enough that its creases are found."""

_SIZE = 48
"""Height of the images."""

_SOLVED = 160
"""Height of textures for solvers, which gives three levels."""

_BORDERS = 4.0
"""Width of borders, where one is given."""

_FRAMES = 4
"""Number of frames."""

_ORDER = ["geometry", "colors", "image", "texture", "field", "flow"]
"""Kinds of data, the most used ones first."""


def rehearse(
    progress: ProgressCallback | None = None, kinds: Collection[str] = tuple(_ORDER)
) -> None:
    """Run all filters once; compiled code is kept on disk.

    Parameters
    ----------
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False ends the rehearsal.
    kinds : collection of str
        Kinds of data to run filters on.
    """
    runs = list(_runs(kinds))
    for number, run in enumerate(runs):
        if progress is not None and not progress(number / len(runs), "Preparing"):
            return
        with gathering():  # as hosts do: reports need measurements of their own
            run()


def imported_kernels() -> set[Any]:
    """Return the kernels of all modules of the core that are imported, which have a `py_func`."""
    modules = [module for name, module in list(sys.modules.items()) if name.startswith(_CORE)]
    values = [value for module in modules for value in vars(module).values()]
    return {value for value in values if hasattr(value, "py_func")}


def _runs(kinds: Collection[str]) -> Iterator[Callable[[], Any]]:
    rows = [row for row in FILTERS if row.kind.name in kinds]
    rows.sort(key=lambda row: (_ORDER.index(row.kind.name), bool(row.then)))
    for row in rows:
        examples = _examples(row.kind.name)
        if row.takes_others:
            examples += [partial(_on_texture, number, with_other=True) for number in range(2)]
        examples += [partial(_generated, **given) for given in _given(row)]
        for settings in _settings(row):
            for function in examples:
                yield partial(function, row.name, settings)
    if "field" in kinds:
        yield _directions
        yield _baked
    if "colors" in kinds:
        yield from _runs_of_surfaces(rows)
        shape = _shape()
        yield from runs_on_meshes(TriangleMesh(shape.positions, shape.triangles))
    images = [row for row in rows if row.kind.name == "image"]
    yield from runs_on_images(images, _settings, _SIZE)
    textures = [row for row in rows if row.kind.name == "texture"]
    if textures:
        faces = _textured(_SOLVED)[0].faces
        model = TriangleMesh(faces.positions, faces.triangles), faces.uv
        yield from runs_on_textures(textures, model, _SOLVED)


def _given(row: Filter) -> Iterator[dict[str, Any]]:
    """List the inputs of generated images besides the faces."""
    if row.takes_starts:
        yield {"image": np.eye(_SOLVED)}
    if row.takes_scale:
        yield {"rates": np.full((_SOLVED, _SOLVED), 0.5)}
    if row.way is not None:
        yield {"along": "bending"}
        yield {"along": "x"}


def _runs_of_surfaces(rows: list[Filter]) -> Iterator[Callable[[], Any]]:
    shape, painted = _shape(), _painted()
    for settings in _settings(next(row for row in rows if row.corners and row.then)):
        for mask in (None, shape.mask):
            both = PaintedSurface(replace(shape, mask=mask), replace(painted, mask=mask))
            yield partial(filter_both, both, "beltrami_vertex_signal", settings, True)
    yield partial(flow_of_shape, shape, GeometrySettings(), True, None)
    quads = replace(shape, edges=_sides_of_quads(shape))
    yield partial(creases_of, quads, GeometrySettings(), True)
    cut = CutSurface(
        shape.positions, shape.triangles, None, shape.to_world, shape.triangles[:9, :2]
    )
    yield partial(low_poly_of, cut, GeometrySettings(), True, 0.25, 8.0)
    yield _mend
    yield _denoise
    for surface in (painted, _at_corners()):
        yield partial(flow_of_colors, surface, ShockSettings(), True, None)


def _settings(row: Filter) -> Iterator[Any]:
    """List the settings to run: defaults, each other choice and number, and what follows."""
    fields = describe(row.settings)
    brief = {name: about.brief for name, (*_, about) in fields.items() if about.brief is not None}
    time = named(row.settings, "time")
    short = {time: 1.0} if time else {}
    changes: list[dict[str, Any]] = [{}]
    for name, (_, default, about) in fields.items():
        changes += [{name: value} for value in about.rehearsed if value != default]
        words = [word for word in about.choices if word != default]
        # Settings with separate code: without a time, with measured or given borders.
        given: list[dict[str, Any]] = [short]
        if name == "what":
            given = [{}, {named(row.settings, "width"): _BORDERS}]
        changes += [{**each, name: word} for word in words for each in given]
    for change in changes:
        settings = row.settings(**{**brief, **change})
        yield Denoising(settings, None) if row.then else settings
    if row.then:
        yield Denoising(row.settings(**brief), 1.0)


def _examples(kind: str) -> list[Callable[[str, Any], Any]]:
    """Return functions of a filter's name and its settings that filter an example."""
    if kind == "geometry":
        return [partial(_on_mesh, filter_shape, surface) for surface in _both_ways(_shape())]
    if kind == "colors":
        ramp = replace(_painted(), mask=None, colors=0.5 + 0.4 * _painted().positions)
        surfaces = [*_both_ways(_painted()), *_both_ways(_at_corners()), ramp]
        return [partial(_on_mesh, filter_colors, surface) for surface in surfaces]
    if kind == "image":
        return [partial(filter_image, _image(opacity)) for opacity in ("STRAIGHT", "NONE")]
    if kind == "field":
        return [_generated]
    if kind == "flow":
        return [partial(_flowing, in_colors) for in_colors in (False, True)]
    return [partial(_on_texture, number) for number in range(2)]


def _generated(name: str, settings: Any, **given: Any) -> Any:
    shape = 2 * (_SOLVED,)
    row = find(name)
    start = {"vertices": [0], "edges": [[1, 2]]} if row.takes_starts else {}
    for at_vertices in [False] + [True] * bool(row.vertices):
        surface = FieldSurface(_textured(_SIZE)[0].faces, shape, start | given, at_vertices)
        found = generate(surface, name, settings)
    return found


def _directions() -> Any:
    faces = _textured(_SIZE)[0].faces
    mesh = TriangleMesh(faces.positions, faces.triangles)
    for size in (_SIZE, _SOLVED):
        bent_normals(mesh, faces.uv, OcclusionSettings(rays=4), size=2 * (size,))
    return curvature_directions(mesh, faces.uv, size=2 * (_SIZE,))


def _baked() -> Any:
    # A box baked onto itself; and wear along given edges only.
    faces = _textured(_SIZE)[0].faces
    mesh = TriangleMesh(faces.positions, faces.triangles)
    given: dict[str, Any] = {"high": mesh, "colors": faces.positions, "occluders": [mesh]}
    for size in (_SIZE, _SOLVED):
        shape = 2 * (size,)
        wear(mesh, faces.uv, WearSettings(rays=4), size=shape, edges=mesh.faces[:, :2])
        bake_maps(mesh, faces.uv, BakeSettings(rays=4), size=shape)
        found = bake_maps(mesh, faces.uv, BakeSettings(rays=4), size=shape, maps=MAPS, **given)
    return found


def _flowing(in_colors: bool, name: str, settings: Any) -> Any:
    shape = 2 * (_SIZE,)
    faces = _textured(_SIZE)[0].faces
    turning = np.linspace(-1.0, 1.0, 2 * _SIZE * _SIZE).reshape(*shape, 2).astype(np.float32)
    flows: list[Any] = [FlowPlane(np.zeros((*shape, 2), np.float32)), FlowPlane(turning)]
    if settings.periodic == "none":
        vectors = np.tile([1.0, 0.5, 0.25], (len(faces.triangles), 1))
        flows.append(FlowSurface(faces, shape, "directions", vectors))
        flows.append(FlowSurface(faces, shape, "shape", GeometrySettings()))
        rising = faces.positions[faces.triangles][..., 2]
        flows.append(FlowSurface(faces, shape, "rising", rising))
        colors = np.repeat(rising[..., None], 3, axis=2), ShockSettings()
        flows.append(FlowSurface(faces, shape, "colors", colors))
    for flow in flows:
        for frame in frames_of(flow, settings, _FRAMES, in_colors):
            found = frame
    return found


def _on_texture(number: int, name: str, settings: Any, with_other: bool = False) -> Any:
    size = _SOLVED if find(name).needs_levels else _SIZE
    surface = _textured(size)[number]
    if with_other:
        surface = replace(surface, others=(_image("STRAIGHT", size),))
    return filter_texture(surface, name, settings)


def _on_mesh(function: Callable[..., Any], surface: Any, name: str, settings: Any) -> Any:
    return function(surface, name, settings, True)


def _both_ways(surface: Any) -> list[Any]:
    """Return a surface without and with its mask."""
    return [replace(surface, mask=None), surface]


def _box() -> tuple[np.ndarray, np.ndarray]:
    """Make an open box with rounded edges, with separate vertices for its five sides."""
    steps = np.linspace(-1.0, 1.0, _CELLS + 1)
    u, v = np.meshgrid(steps, steps, indexing="ij")
    number = np.arange(u.size).reshape(u.shape)
    corners = [number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]]
    cells = np.stack([each.reshape(-1) for each in corners], axis=1)
    one_side = np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
    positions: list[np.ndarray] = []
    triangles: list[np.ndarray] = []
    for axis, sign in ((0, -1), (0, 1), (1, -1), (1, 1), (2, -1)):
        side = np.stack([np.full_like(u, sign), u, sign * v], axis=-1).reshape(-1, 3)
        positions.append(np.roll(side, axis, axis=1))
        triangles.append(one_side + u.size * len(triangles))
    points = np.concatenate(positions)
    points /= np.linalg.norm(points, ord=8, axis=1)[:, None]
    faces = np.concatenate(triangles)
    faces[0] = faces[0, ::-1]  # one that is the wrong way round
    return points.astype(np.float32), faces.astype(np.int32)


def _shape() -> MirroredSurface:
    positions, triangles = _box()
    mask = np.linspace(0.0, 1.0, len(positions))
    return MirroredSurface(
        positions, triangles, mask, np.identity(3), (True, False, False), (), 30.0
    )


def _mend() -> None:
    # Code that refits seldom need: undoing folds, and reports of undone moves.
    mesh = TriangleMesh(*_box())
    moved = np.random.default_rng(0).normal(size=mesh.vertices.shape) * mesh.mean_edge_length
    mended(mesh, mesh.normals, moved, None)
    tell_lost(mesh, np.ones(mesh.vertex_count))


def _denoise() -> None:
    # Noise that no stage takes for the shape, so that all of them run.
    positions, triangles = _box()
    noise = np.random.default_rng(0).normal(size=positions.shape) * 0.02
    denoise_geometry(TriangleMesh(positions + noise, triangles))


def _sides_of_quads(surface: MirroredSurface) -> np.ndarray:
    # The edges of each two triangles that make a square of `_box`.
    return np.concatenate([surface.triangles[:, :2], surface.triangles[:, 1:]])


def _painted() -> ColoredSurface:
    positions, triangles = _box()
    mask = np.linspace(0.0, 1.0, len(positions))
    colors = 0.5 + 0.4 * np.tanh(5.0 * positions)
    return ColoredSurface(positions, triangles, mask, np.identity(3), colors, None, None, 0)


def _at_corners() -> ColoredSurface:
    surface = _painted()
    corners = np.arange(surface.triangles.size, dtype=np.int32).reshape(-1, 3)
    colors = surface.colors[surface.triangles.reshape(-1)]
    return replace(surface, colors=colors, corners=corners, levels=255)


def _image(opacity: str, size: int = _SIZE) -> HostImage:
    y, x = np.mgrid[:size, : size + 8] / size
    pixels = np.ones((*x.shape, 4), dtype=np.float32)
    pixels[..., 0] = 0.5 + 0.4 * np.tanh(9.0 * (x - y))
    pixels[..., 1] = x
    if opacity != "NONE":
        pixels[:4, :4, 3] = 0.5
    return HostImage(pixels, opacity, False, 255)


@lru_cache
def _textured(size: int) -> list[TexturedSurface]:
    """Return the box with textures, a chart for each side, with and without masks and opacity."""
    positions, triangles = _box()
    side, place = np.divmod(triangles, (_CELLS + 1) ** 2)
    inside = np.stack(np.divmod(place, _CELLS + 1), axis=-1) / _CELLS
    uv = (np.stack(np.divmod(side, 3), axis=-1) + 0.1 + 0.8 * inside) / 3.0
    weights = np.linspace(0.0, 1.0, triangles.size).reshape(-1, 3)
    picture = _image("NONE", size)
    mask = np.full(picture.pixels.shape[:2], 0.5)
    mask[: size // 2] = 0.0
    faces = TexturedFaces(positions.astype(np.float64), triangles.astype(np.int64), uv, None)
    masked = replace(faces, weights=weights, grays=weights)
    return [
        TexturedSurface(faces, picture, None),
        TexturedSurface(masked, _image("STRAIGHT", size), mask, grays=mask),
    ]
