# SPDX-License-Identifier: GPL-3.0-or-later
"""Assigns the slanted faces along a crease to one of its sides. Not in the papers.

Voxel remeshing, marching cubes and smoothing turn a crease into a strip of slanted faces.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.progress import aside, phase
from ..base.vectors import TIE_BREAKER, dot
from ..mesh.calculus import corners_of, cosines, faces_touching, make_unit
from ..mesh.triangle_mesh import Floats, TriangleMesh

_PULL = 0.3
"""Weight of the distance to a face's own normal in the cost of a patch, in `consistent_normals`."""

_ROUNDING = 1e-12
"""Costs that differ by less are equal up to rounding."""

_MOST_FAN = 32
"""Most faces around a vertex that are used; of more, an evenly spread sample."""


def consistent_normals(
    mesh: TriangleMesh,
    normals: Floats,
    zone: npt.NDArray[np.bool_],
    passes: int,
) -> Floats:
    """Give each face of a zone the mean normal of the most uniform patch of faces around it.

    This is Kuwahara's filter for images, applied to normals as in Zhang et al. (2015). A patch is a
    face and all that share a vertex with it. Its cost is 1 - |sum A n| / sum A, with the areas A
    and normals n of its faces, plus 0.3 times 1 - (its mean normal . the face's own). So each face
    of a slanted strip takes the normal of one side.
    """
    inside, around = np.flatnonzero(zone), np.flatnonzero(grown(mesh, zone))
    means, uneven = np.empty_like(normals), np.empty(len(normals))
    for iteration in range(passes):
        out = normals.copy()
        with phase(iteration / passes, (iteration + 0.5) / passes, "Aligning creases"):
            run(_patches, len(around), around, mesh.faces, *mesh.corners, normals, mesh.areas,
                means, uneven)  # fmt: skip
        with phase((iteration + 0.5) / passes, (iteration + 1) / passes, "Aligning creases"):
            run(_choose, len(inside), inside, mesh.faces, *mesh.corners, normals, means, uneven,
                _PULL, out)  # fmt: skip
        normals = out
    return normals


def turned_zone(mesh: TriangleMesh, old: Floats, new: Floats) -> npt.NDArray[np.bool_]:
    """Return the faces whose normals differ by over 3 degrees, and their neighbours."""
    turned = cosines(old, new) < np.cos(np.radians(3.0))
    return grown(mesh, turned & (mesh.areas > 0))


def grown(mesh: TriangleMesh, zone: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Add the faces that share a vertex with those of a zone: (m,) -> (m,)."""
    with aside("Aligning creases"):
        return faces_touching(mesh, corners_of(mesh, zone))


@kernel
def _contains(faces, f, v):
    return faces[f, 0] == v or faces[f, 1] == v or faces[f, 2] == v


@kernel
def _patches(start, stop, around, faces, corner_start, corners, normals, areas, means, uneven):
    for row in range(start, stop):
        f = around[row]
        x = y = z = total = 0.0
        for k in range(3):
            v = faces[f, k]
            first, last = corner_start[v], corner_start[v + 1]
            stride = 1 + (last - first - 1) // _MOST_FAN
            for i in range(first, last, stride):
                g = corners[i] // 3
                # Counts each face once: not again if it shares an earlier corner.
                if k > 0 and _contains(faces, g, faces[f, 0]):
                    continue
                if k > 1 and _contains(faces, g, faces[f, 1]):
                    continue
                a = areas[g]
                x += a * normals[g, 0]
                y += a * normals[g, 1]
                z += a * normals[g, 2]
                total += a
        length = np.sqrt(x * x + y * y + z * z)
        if length > 1e-12 * total:
            means[f, 0], means[f, 1], means[f, 2] = x / length, y / length, z / length
        else:
            means[f] = normals[f]
        uneven[f] = 1.0 - length / total if total > 0 else 1.0


@kernel
def _cost(own, means, uneven, pull, f):
    # The cost of taking the mean normal of the patch around face f.
    return uneven[f] + pull * (1.0 - dot(own, means[f]))


@kernel
def _choose(start, stop, inside, faces, corner_start, corners, normals, means, uneven, pull, out):
    for row in range(start, stop):
        f = inside[row]
        own = normals[f]
        if own[0] == 0 and own[1] == 0 and own[2] == 0:
            continue
        # Among costs that are equal up to rounding, a direction decides, not the order of faces.
        cost = least = _cost(own, means, uneven, pull, f)
        for k in range(3):
            v = faces[f, k]
            first, last = corner_start[v], corner_start[v + 1]
            stride = 1 + (last - first - 1) // _MOST_FAN
            for i in range(first, last, stride):
                least = min(least, _cost(own, means, uneven, pull, corners[i] // 3))
        choice, most = f, -2.0
        if cost <= least + _ROUNDING:
            most = dot(TIE_BREAKER, means[f])
        for k in range(3):
            v = faces[f, k]
            first, last = corner_start[v], corner_start[v + 1]
            stride = 1 + (last - first - 1) // _MOST_FAN
            for i in range(first, last, stride):
                g = corners[i] // 3
                if _cost(own, means, uneven, pull, g) <= least + _ROUNDING:
                    side = dot(TIE_BREAKER, means[g])
                    if side > most:
                        most, choice = side, g
        out[f] = means[choice]
        make_unit(out[f])
