# SPDX-License-Identifier: GPL-3.0-or-later
"""Projects the texels of a simple mesh onto a detailed one, and reports texels without a hit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..base.checks import Floats
from ..base.findings import Length, tell
from ..base.parallel import kernel, run
from ..base.progress import ask
from ..mesh.calculus import mean_normals, unit_vectors
from ..mesh.triangle_mesh import TriangleMesh
from ..rays.boxes import STACK, first_hit
from .tracing import Scene, Sites, read_corners, scaled_to, shading_normals

_Single = npt.NDArray[np.float32]

_CAGE = 0.05
"""Automatic distance of the cage, relative to the diagonal of the box around the simple mesh."""

_FARTHER = 8.0
"""Distance, in cages, up to which texels without a hit search again, to propose a better cage."""

_MOST = 0.98
"""Share of those texels that the proposed cage reaches."""

_SEEN = 1e-4
"""Least share of texels without a hit that is reported; fewer, filled smoothly, are not visible. Of
1024 x 1024 texels this is a patch of 10 x 10."""


class Onto(NamedTuple):
    """The places of texels on a detailed mesh.

    Attributes
    ----------
    sites : Sites
        Places on the detailed mesh, in its units; on the simple one where there is no hit.
    faces : (k,) int32
        Faces of the detailed mesh; -1 where there is no hit.
    shares : (k, 3) float64
        Barycentric coordinates in these faces.
    heights : (k,) float32
        Heights above the simple mesh, in its units; 0 where there is no hit.
    """

    sites: Sites
    faces: npt.NDArray[np.int32]
    shares: Floats
    heights: _Single


def project(
    atlas: TextureAtlas, sites: Sites, scene: Scene, high: TriangleMesh, cage: float
) -> Onto:
    """Find the place on a detailed mesh above or below each texel of a simple one.

    Reports the share of texels without a hit, if it is visible, and a cage that would be large
    enough, if there is one.

    Parameters
    ----------
    atlas : TextureAtlas
        The atlas of the simple mesh.
    sites : Sites
        The `texel_sites` of that atlas.
    scene : Scene
        The scene of the detailed mesh alone.
    high : TriangleMesh
        The detailed mesh.
    cage : float
        Distance of the search above and below, in units of the mesh; 0 takes 5 percent of the size.
    """
    low = atlas.mesh
    smooth = unit_vectors(mean_normals(low))
    along = read_corners(atlas, sites.numbers, smooth[low.faces])
    along = unit_vectors(along.astype(np.float64)).astype(np.float32)
    box = low.box
    middle = box[0] + 0.5 * (box[1] - box[0])
    places = middle + low.mean_edge_length * sites.points.astype(np.float64)
    starts = scaled_to(high, places).astype(np.float32)
    reach = (cage or _CAGE * float(np.linalg.norm(box[1] - box[0]))) / scene.unit
    rows, heights = _met(starts, along, scene, reach)
    met = rows >= 0
    if np.count_nonzero(~met) > _SEEN * len(met):
        _tell_unmet(starts[~met], along[~met], scene, reach, len(starts))
    faces = np.where(met, scene.tree.order[rows], -1).astype(np.int32)
    points = starts + heights[:, None] * along
    corners = high.scaled_vertices[high.faces[faces]]
    shares = _shares(points.astype(np.float64), corners)
    ask()
    normals = np.einsum("kv,kvc->kc", shares, shading_normals(high)[faces])
    normals = unit_vectors(normals).astype(np.float32)
    facing = high.normals[faces].astype(np.float32)
    normals[~met], facing[~met] = sites.normals[~met], sites.facing[~met]
    spacings = sites.spacings * np.float32(low.mean_edge_length / scene.unit)
    points = points.astype(np.float32)
    on_high = Sites(points, normals, facing, sites.numbers, sites.turns, spacings)
    return Onto(on_high, faces, shares, (heights * np.float32(scene.unit)))


def _met(
    starts: _Single, along: _Single, scene: Scene, reach: float
) -> tuple[npt.NDArray[np.int32], _Single]:
    # The rows of the tree that are hit, or -1, and the heights there.
    rows = np.full(len(starts), -1, dtype=np.int32)
    heights = np.zeros(len(starts), dtype=np.float32)
    run(_project, len(starts), starts, along, scene.tree, reach, scene.off, rows, heights,
        chunk=1024)  # fmt: skip
    heights[rows < 0] = 0.0
    return rows, heights


def _tell_unmet(starts: _Single, along: _Single, scene: Scene, reach: float, count: int) -> None:
    percent = 100.0 * len(starts) / count
    rows, heights = _met(starts, along, scene, _FARTHER * reach)
    farther = np.abs(heights[rows >= 0])
    within = Length(float(f"{reach * scene.unit:.2g}"))
    if 2 * len(farther) > len(starts):
        better = 1.05 * float(np.quantile(farther, _MOST)) * scene.unit
        tell(
            "{percent:.3g}% of the texels meet nothing of the detailed mesh within {reach};"
            " raise Cage to about {better}.",
            percent=percent,
            reach=within,
            better=Length(float(f"{better:.2g}")),
        )
    else:
        tell(
            "{percent:.3g}% of the texels meet nothing of the detailed mesh within {reach};"
            " there is nothing beside them.",
            percent=percent,
            reach=within,
        )


def _shares(points: Floats, corners: Floats) -> Floats:
    # Barycentric coordinates of points (k, 3) in triangles (k, 3, 3), within these.
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    to = points - corners[:, 0]
    a, b, c = ((x * y).sum(axis=1) for x, y in ((one, one), (one, two), (two, two)))
    d, e = (to * one).sum(axis=1), (to * two).sum(axis=1)
    det = np.maximum(a * c - b * b, 1e-300)
    second = np.clip((c * d - b * e) / det, 0.0, 1.0)
    third = np.clip((a * e - b * d) / det, 0.0, 1.0)
    shares = np.stack([np.maximum(1.0 - second - third, 0.0), second, third], axis=1)
    return shares / shares.sum(axis=1, keepdims=True)


@kernel
def _project(start, stop, points, along, tree, reach, off, rows, heights):
    # The nearest hit above or below on a face that faces the same way.
    stack = np.empty(STACK, np.int32)
    triangles = tree.triangles
    for i in range(start, stop):
        nearest = reach
        for side in range(2):
            sign = np.float32(1.0 if side == 0 else -1.0)
            back = np.float32(off) * sign
            dx, dy, dz = sign * along[i, 0], sign * along[i, 1], sign * along[i, 2]
            ox = points[i, 0] - back * along[i, 0]
            oy = points[i, 1] - back * along[i, 1]
            oz = points[i, 2] - back * along[i, 2]
            gone = np.float32(0)
            while gone < nearest + off:
                limit = np.float32(nearest + off - gone)
                x, y, z = ox + gone * dx, oy + gone * dy, oz + gone * dz
                far, row = first_hit(tree, x, y, z, dx, dy, dz, limit, False, stack)
                if row < 0:
                    break
                ux, uy, uz = triangles[row, 3], triangles[row, 4], triangles[row, 5]
                vx, vy, vz = triangles[row, 6], triangles[row, 7], triangles[row, 8]
                mx, my, mz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
                gone += np.float32(far)
                if mx * along[i, 0] + my * along[i, 1] + mz * along[i, 2] > 0:
                    nearest = max(gone - off, 0.0)
                    rows[i], heights[i] = row, sign * np.float32(gone - off)
                    break
                gone += np.float32(off)  # on from the back of a face
