# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs for other data and for batch runs on files: other types, masks, gains."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ..atlas.atlas import TextureAtlas
from ..flow.borders import measured
from ..linear.cg import ALONE, solve
from ..linear.system import LinearSystem
from ..mesh.triangle_mesh import TriangleMesh
from ..registry import Filter
from ..repair.filling import fill_texture
from ..repair.quarters import LESS, enlarged, reduced
from ..settings import FillSettings
from ..sparse.matrix import added, applied, from_triples, in_order, product, transposed
from ..texture.gradient_domain import TextureSolver

TYPES = np.uint8, np.uint16, np.float32, np.float64
"""Types of pixels in files."""

Textured = tuple[TriangleMesh, npt.NDArray[np.float64]]
"""A mesh with texture coordinates."""


def runs_on_images(
    rows: list[Filter], settings_of: Callable[[Filter], Iterator[Any]], size: int
) -> Iterator[Callable[[], Any]]:
    """Yield runs of filters on images of all types, gray and in color, with and without masks."""
    for row in rows:
        for settings in settings_of(row):
            given = settings.kernel if row.then else settings
            for dtype in TYPES:
                for shape in ((size, size + 8), (size, size + 8, 3)):
                    yield partial(_filter_image, row, given, dtype, shape)


def runs_on_textures(rows: list[Filter], model: Textured, size: int) -> Iterator[Callable[[], Any]]:
    """Yield runs of filters on textures of all types, and of masks."""
    for row in rows:
        for dtype in TYPES:
            yield partial(_filter_texture, row, model, dtype, size)
    for dtype in TYPES:
        yield partial(_fill, model, dtype, size)
    yield partial(_masks, model, size)
    yield partial(_gains, model, size)


def runs_on_meshes(mesh: TriangleMesh) -> Iterator[Callable[[], Any]]:
    """Yield runs that only few or large meshes need: borders without crests, repeated entries."""
    yield partial(_few_borders, mesh)
    yield _slow_solve
    yield _large_solves
    for dtype in (np.float32, np.float64):
        yield partial(_sparse, dtype)


def picture(dtype: npt.DTypeLike, shape: tuple[int, ...]) -> npt.NDArray:
    """Return a soft edge with some noise: in [0, 1], or over the range of whole numbers."""
    y, x = np.mgrid[: shape[0], : shape[1]] / shape[0]
    values = 0.5 + 0.4 * np.tanh(9.0 * (x - y)) + 0.02 * np.sin(997.0 * x * y)
    values = np.broadcast_to(values.reshape(*values.shape, *[1] * (len(shape) - 2)), shape)
    kind = np.dtype(dtype)
    if kind.kind == "u":
        values = np.rint(np.iinfo(kind).max * values)
    return np.ascontiguousarray(values.astype(kind))


def _filter_image(row: Filter, settings: Any, dtype: npt.DTypeLike, shape: tuple[int, ...]) -> None:
    image = picture(dtype, shape)
    mask = np.linspace(0.0, 1.0, shape[0] * shape[1]).reshape(shape[:2])
    filter_image = row.load()
    for each in (None, mask):
        filter_image(image, settings, mask=each)


def _filter_texture(row: Filter, model: Textured, dtype: npt.DTypeLike, size: int) -> None:
    row.load()(*model, picture(dtype, (size, size, 3)))


def _fill(model: Textured, dtype: npt.DTypeLike, size: int) -> None:
    # Holes, and parts of the surface of which nothing is known.
    image, missing = picture(dtype, (size, size, 3)), np.zeros((size, size))
    missing[size // 8 : size // 4] = 1.0
    fill_texture(*model, image, FillSettings(surface="thin_plate"), missing=missing)
    fill_texture(*model, image, FillSettings(seams="auto", grain=1.0), missing=0.5 * missing)
    mesh, uv = model
    twice = TriangleMesh(np.concatenate([mesh.vertices, mesh.vertices + 9.0]),
                         np.concatenate([mesh.faces, mesh.faces + mesh.vertex_count]))  # fmt: skip
    half = np.concatenate([[0.5, 1.0] * uv, [0.5, 0.0] + [0.5, 1.0] * uv])
    missing[:, size // 2 :] = 1.0
    fill_texture(twice, half, image, missing=missing)
    image[:, size // 2 :] = 0
    fill_texture(twice, half, image)
    # Larger textures begin with smaller ones.
    atlas = TextureAtlas(mesh, uv, size=(LESS * (size // LESS),) * 2)
    known = atlas.inside
    enlarged(reduced(image[: len(known), : len(known)], known)[0], atlas, known)


def _masks(model: Textured, size: int) -> None:
    TextureAtlas(*model, size=(size, size)).masks()


def _gains(model: Textured, size: int) -> None:
    solver = TextureSolver(*model, picture(np.float32, (size, size, 4)))
    solver.filtered(2.0)
    gains = np.ones((size, size))
    for row in (0, size // 2):
        gains[row:] = 2.0
        solver.filtered(gains)


def _few_borders(mesh: TriangleMesh) -> None:
    values = np.zeros((mesh.vertex_count, 3))
    values[0] = 1.0
    measured(mesh, values)


def _slow_solve() -> None:
    # A hub beside a long path.
    n = 1000
    rows = np.concatenate([np.arange(n - 1), np.zeros(n - 2, int)])
    to = np.concatenate([np.arange(1, n), np.arange(2, n)])
    system = _system(rows, to, np.full(n, 1e-3))
    solve(system, np.linspace(-1.0, 1.0, n), 1e-6, multigrid=True)


def _large_solves() -> None:
    # Several threads share the rows of more than `ALONE`.
    n = ALONE + 1
    system = _system(np.arange(n - 1), np.arange(1, n), np.ones(n))
    for columns in (1, 3):
        right = np.linspace(-1.0, 1.0, columns * n).reshape(n, columns)
        for precise in (False, True):
            solve(system, right, 1e-6, precise=precise)


def _system(rows: npt.NDArray, to: npt.NDArray, screen: npt.NDArray) -> LinearSystem:
    # Weights of one between rows, and screening.
    n = len(screen)
    of, to = np.concatenate([rows, to]), np.concatenate([to, rows])
    order = np.lexsort((to, of))
    of, to = of[order], to[order].astype(np.int32)
    start = np.searchsorted(of, np.arange(n + 1)).astype(np.int32)
    weights, diagonal = np.ones(len(to)), screen.copy()
    np.add.at(diagonal, of, weights)
    return LinearSystem(start, to, weights, screen, diagonal)


def _sparse(dtype: npt.DTypeLike) -> None:
    # With repeated entries, and rows out of order.
    places = np.array([1, 0, 1, 2]), np.array([2, 1, 2, 0])
    a = from_triples(*places, np.ones(4, dtype), (3, 3))
    applied(product(a, transposed(added(a, a))), np.ones((3, 2), dtype))
    in_order(a._replace(columns=np.ascontiguousarray(a.columns[::-1])))
