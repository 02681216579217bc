# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a mesh is made of creases, and normals that agree along them. Not in the papers.

Voxel remeshing, marching cubes and smoothing turn a crease into a strip of slanted faces. To which
side each of them belongs is decided here, and where a surface has no creases it is left alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.findings import tell
from ..base.memo import kept
from ..base.parallel import kernel, run
from ..base.progress import aside, phase
from ..base.vectors import dot
from ..flow.potential import bending, dilation, opening
from ..mesh.adjacency import connected_parts
from ..mesh.calculus import (
    average_to_vertices,
    greatest_to_faces,
    lumped_mass,
    make_unit,
    smooth_vertices,
)
from ..mesh.order import in_good_order
from ..mesh.triangle_mesh import Floats, TriangleMesh
from ..settings import GeometrySettings

_PULL = 0.3
"""How much a face's own normal counts against the evenness of a patch, in `consistent_normals`."""

LONGER = 4.0
"""How many times longer wide roundings flow."""

# Where a measure of a crease begins to count, and where it counts in full: chosen on a few softened
# machine parts, statues and remeshed shapes.
_STANDS_OUT = 1.8, 2.2  # D_2 over that of the surroundings: a ridge
_TURNS = 6.0, 10.0  # D_2 in degrees: a ridge
_SHARE_AROUND = 0.5, 0.65  # share of the bending that lies in ridges, around a vertex
_SHARE = 0.6, 0.7  # the same in a connected part
_COARSE = 0.25, 0.36  # median bending of a part in radians an edge: creases cannot be told
_SURE = (0.94, 0.98), 0.15  # such a share makes sure, and lets a part be so much coarser
_CLEARLY_OUT, _CLEARLY_TURNS = (1.3, 3.5), (4.0, 16.0)  # a crease where parts are not of creases
_WIDE, _WIDE_PART = (1.18, 1.26), (1.19, 1.24)  # D_8 / D_2 around a vertex, median of a part
_NOISY = 0.95, 1.0  # D_8 / D_2, median of a part
_FAINT, _ALIKE = (13.3, 15.3), (0.5, 0.6)  # D_2 of faint creases, in degrees; over that of strong
_ONLY = 0.87, 0.92  # share of the bending in ridges that leaves nothing for relief
_WIDTHS = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0), (1.08, 1.10, 1.15, 1.22, 1.30, 1.46, 1.54)
"""Radii of fillets between two planes, in edges, and D_8 / D_2 there, after a remesh."""

_JAGGED, _JAGGED_PART = (0.13, 0.19), (0.06, 0.12)  # how far normals are from taking sides
_MOST_SHARP = 0.85
"""Share of a part's creases that are sharp, from which all of it stays."""

_STRICTER = 0.14
"""How much farther, in a part most of whose creases are sharp."""

_RELIEF = 0.5
"""How far what clearly stands out is sharpened where a part is not made of creases."""

_RINGS = 5
"""How far around a vertex its surroundings reach, in edges."""

_PASSES = 12
"""Smoothing passes that add up the bending around a vertex: over about four edges."""

_MOST_FAN = 32
"""Most faces around a vertex that are looked at; of more, evenly spread ones."""


class Regions(NamedTuple):
    """How a mesh's faces are to be treated; all from 0 to 1.

    Attributes
    ----------
    use : (m,) float64
        How far normals are to turn at all.
    creased : (m,) float64
        Whether the part is made of creases and smooth faces between them, as machine parts are.
    wide : (m,) float64
        Whether roundings are wider than an edge or two.
    radius : float
        Of the rounding of most creases that are closed, in mean edge lengths.
    too_wide : bool
        Whether some are left as they are, as their rounding is wider than asked for.
    """

    use: Floats
    creased: Floats
    wide: Floats
    radius: float
    too_wide: bool

    @property
    def closed(self) -> npt.NDArray[np.bool_]:
        """The faces along creases that are closed: (m,)."""
        return (self.use > 0) & (self.creased > 0)


def find_regions(mesh: TriangleMesh, widest: float = 0.0) -> Regions:
    """Tell from the turning of normals where there are creases, and how they are rounded.

    With D_p the RMS turn of the normals around a vertex over p smoothing passes: a ridge is where
    D_2 stands out from its surroundings. Where most of the bending lies in ridges, a part is one of
    creases, as machine parts are; elsewhere, as on a statue, only what stands out by far is a
    crease, and is sharpened half. D_8 / D_2 is 1 at a sharp crease and grows with the width of a
    rounding; what is wider than fillets of the radius `widest`, in mean edge lengths, stays, if
    that is not 0. Where the normals have taken sides already, it is sharp and stays.
    """
    return kept(mesh, "regions", (widest,), lambda: _find_regions(mesh, widest))


def _find_regions(mesh: TriangleMesh, widest: float) -> Regions:
    message = "Finding creases"
    with phase(0.0, 0.1, message):
        signal, bend = bending(mesh, 1)
    with phase(0.1, 0.3, message):
        near = smooth_vertices(mesh, signal, 2)
        turn, far = _turn(near), _turn(smooth_vertices(mesh, near, 6))
    with phase(0.3, 0.5, message):
        level = smooth_vertices(mesh, opening(mesh, turn, _RINGS).reshape(-1, 1), 2).reshape(-1)
        crest = turn >= 0.999 * dilation(mesh, turn, 2)
    over = turn / np.maximum(level, 1e-12)
    out = ramp(over, _STANDS_OUT)
    energy = lumped_mass(mesh) * turn**2
    weight = crest * out * ramp(np.degrees(turn), _TURNS)
    with phase(0.5, 0.6, message):
        around = greatest_to_faces(mesh, dilation(mesh, weight, 3)) > 0
        sides = consistent_normals(mesh, mesh.normals, around, 1)
        between = np.empty((mesh.face_count, 1))
        run(_squared_distance, mesh.face_count, sides, mesh.normals, between)
        apart = smooth_vertices(mesh, average_to_vertices(mesh, between), 2)[:, 0]
    ridge = weight * turn**2
    width = far / np.maximum(turn, 1e-12)
    jagged = np.sqrt(apart) / np.maximum(turn, 1e-12)

    part, count = connected_parts(mesh.neighbours)
    on_crest = weight > 0.5
    typical_bend = np.sqrt(_quantiles(part, bend, count, 0.5))
    typical_width = _quantiles(part[on_crest], width[on_crest], count, 0.5)
    faint, strong = (_quantiles(part[on_crest], turn[on_crest], count, q) for q in (0.1, 0.9))
    typical_jag = _quantiles(part[on_crest], jagged[on_crest], count, 0.5)
    worse_jag = _quantiles(part[on_crest], jagged[on_crest], count, _MOST_SHARP)
    share = _ratio(np.bincount(part, energy * out, count), np.bincount(part, energy, count))
    finer = typical_bend - _SURE[1] * ramp(share, _SURE[0])
    blunt = ramp(worse_jag, _JAGGED_PART)[part]
    creased = (ramp(share, _SHARE) * (1.0 - ramp(finer, _COARSE)))[part]
    # Denoising leaves relief with facets, whose edges are of all angles, down to faint ones.
    alike = np.maximum(ramp(_ratio(faint, strong), _ALIKE), ramp(share, _ONLY))
    creased *= np.maximum(alike, ramp(np.degrees(faint), _FAINT))[part]
    # Ridges that smoothing takes away are noise; where there is none, D_8 / D_2 is 1 at least.
    creased *= ramp(typical_width, _NOISY)[part]
    wide = np.where(creased > 0, ramp(typical_width, _WIDE_PART)[part], 0.0)
    with phase(0.6, 1.0, message):
        # Of the surroundings, only what a part's measures leave open.
        columns = [ridge, weight * apart]
        if creased.any():
            columns += energy, energy * out
        if wide.any() or widest > 0:
            columns.append(ridge * width)
        sums = smooth_vertices(mesh, np.stack(columns, axis=1), _PASSES if blunt.any() else 0).T
    # In parts that are sharp for the most, corners are not to be taken for blunt.
    stricter = _STRICTER * (1.0 - ramp(typical_jag, _JAGGED_PART))[part]
    blunt *= ramp(np.sqrt(_ratio(sums[1], sums[0])) - stricter, _JAGGED)
    if creased.any():
        creased *= ramp(_ratio(sums[3], sums[2]), _SHARE_AROUND)
    if wide.any():
        wide = creased * wide * ramp(_ratio(sums[-1], sums[0]), _WIDE)
    clearly = ramp(over, _CLEARLY_OUT) * ramp(np.degrees(turn), _CLEARLY_TURNS)
    use = np.maximum(creased, _RELIEF * clearly) * blunt
    too_wide = False
    if widest > 0:
        most = float(np.interp(widest, *_WIDTHS))
        left = ramp(_ratio(sums[-1], sums[0]), (most - 0.03, most + 0.03))
        too_wide = bool(((use > 0.5) & (left > 0.5)).any())
        use *= 1.0 - left
    typical = on_crest & (creased > 0) & (use > 0)
    radius = np.interp(np.median(width[typical]), *_WIDTHS[::-1]) if typical.any() else 0.0
    use, creased, wide = (greatest_to_faces(mesh, values) for values in (use, creased, wide))
    return Regions(use, creased, wide, float(radius), too_wide)


def vertices_at_creases(mesh: TriangleMesh, settings: GeometrySettings) -> npt.NDArray[np.bool_]:
    """Tell which vertices lie where the filter closes creases: (n,)."""

    def closed(current: TriangleMesh, _: Floats | None) -> Floats:
        regions = find_regions(current, settings.widest_fillet)
        found = np.zeros((current.vertex_count, 1))
        found[current.faces[regions.closed]] = 1.0
        return found

    return in_good_order(mesh, closed, None)[:, 0] > 0


def tell_creases(regions: Regions) -> None:
    """Say, for reports, what was found; see `base.findings`."""
    if not regions.closed.any():
        if regions.too_wide:
            tell("The creases are rounded more widely than Widest Fillet, and stay.")
        elif regions.use.any():
            tell("Not made of creases: only what stands out clearly was sharpened, by half.")
        elif regions.creased.any():
            tell("The creases are sharp already.")
    elif regions.radius < 1:
        tell("Closed creases that were blunt by about an edge length; smooth parts stay.")
    else:
        tell(
            "Closed creases that were rounded over a radius of {radius:.1f} edge lengths; smooth"
            " parts stay.",
            radius=regions.radius,
        )


def ramp(values: Floats, ends: tuple[float, float]) -> Floats:
    """Rise smoothly from 0 at the first end to 1 at the second: (n,) -> (n,)."""
    out = np.empty(len(values))
    run(_rise, len(values), values, *ends, out)
    return out


def _turn(means: Floats) -> Floats:
    # The means of unit normals are the shorter the more these differ.
    out = np.empty(len(means))
    run(_shortness, len(means), means, out)
    return out


def _ratio(above: npt.NDArray, below: npt.NDArray) -> Floats:
    # 0 where there is nothing.
    return np.divide(above, below, out=np.zeros(len(above)), where=below > 0)


def _quantiles(part: npt.NDArray[np.int32], values: Floats, count: int, share: float) -> Floats:
    # Of each part, the value that this share of its values does not exceed; 0 without values.
    counts = np.bincount(part, minlength=count)
    found = np.zeros(count)
    some = counts > 0
    place = (share * (counts - 1)).astype(np.int64)
    if count == 1 and some[0]:
        found[0] = np.partition(values, place[0])[place[0]]  # many times faster than sorting
        return found
    at = np.cumsum(counts) - counts + place
    found[some] = values[np.lexsort((values, part))[at[some]]]
    return found


def consistent_normals(
    mesh: TriangleMesh,
    normals: Floats,
    zone: npt.NDArray[np.bool_],
    passes: int,
) -> Floats:
    """Give each face of a zone the mean normal of the most even patch of faces around it.

    Kuwahara's idea for images, as guidance of normals by Zhang et al. (2015): a patch is a face and
    all that share a vertex with it. Its cost is 1 - |sum A n| / sum A, plus 0.3 times
    1 - (its mean normal . the face's own). A strip of slanted faces takes a side, face by face.
    """
    around = _grown(mesh, zone)
    means, uneven = np.empty_like(normals), np.empty(len(normals))
    for turn in range(passes):
        out = normals.copy()
        with phase(turn / passes, (turn + 0.5) / passes, "Aligning creases"):
            run(_patches, mesh.face_count, mesh.faces, *mesh.corners, around, normals, mesh.areas,
                means, uneven)  # fmt: skip
        with phase((turn + 0.5) / passes, (turn + 1) / passes, "Aligning creases"):
            run(_choose, mesh.face_count, mesh.faces, *mesh.corners, zone, normals, means, uneven,
                _PULL, out)  # fmt: skip
        normals = out
    return normals


def turned_zone(mesh: TriangleMesh, old: Floats, new: Floats) -> npt.NDArray[np.bool_]:
    """Faces whose normals differ by 3 degrees and more, and those that share a vertex with them."""
    turned = np.einsum("ij,ij->i", old, new) < np.cos(np.radians(3.0))
    return _grown(mesh, turned & (mesh.areas > 0))


def mixed_normals(old: Floats, new: Floats, shares: Floats) -> Floats:
    """Mix unit normals by shares (m,) of the new ones; a share of 0 keeps every bit."""
    mixed = old.copy()
    with aside("Sharpening"):
        run(_mix, len(old), new, shares, mixed)
    return mixed


def _grown(mesh: TriangleMesh, zone: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    touched = np.zeros(mesh.vertex_count, dtype=np.uint8)
    touched[mesh.faces[zone]] = 1
    with aside("Aligning creases"):
        return greatest_to_faces(mesh, touched).view(np.bool_)


@kernel
def _rise(start, stop, values, low, high, out):
    for i in range(start, stop):
        t = min(max((values[i] - low) / (high - low), 0.0), 1.0)
        out[i] = t * t * (3.0 - 2.0 * t)


@kernel
def _shortness(start, stop, means, out):
    for v in range(start, stop):
        out[v] = np.sqrt(max(2.0 * (1.0 - np.sqrt(dot(means[v], means[v]))), 0.0))


@kernel
def _squared_distance(start, stop, one, other, out):
    # Of unit normals; faces without area, whose normals are 0, are not apart.
    for f in range(start, stop):
        n = other[f]
        flat = n[0] == 0 and n[1] == 0 and n[2] == 0
        out[f, 0] = 0.0 if flat else max(2.0 * (1.0 - dot(one[f], n)), 0.0)


@kernel
def _contains(faces, f, v):
    return faces[f, 0] == v or faces[f, 1] == v or faces[f, 2] == v


@kernel
def _patches(start, stop, faces, corner_start, corners, around, normals, areas, means, uneven):
    for f in range(start, stop):
        if not around[f]:
            continue
        x = y = z = total = 0.0
        for k in range(3):
            v = faces[f, k]
            first, last = corner_start[v], corner_start[v + 1]
            stride = 1 + (last - first - 1) // _MOST_FAN
            for i in range(first, last, stride):
                g = corners[i] // 3
                # Each face once: where it shares an earlier corner it has been counted.
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
def _choose(start, stop, faces, corner_start, corners, zone, normals, means, uneven, pull, out):
    for f in range(start, stop):
        if not zone[f]:
            continue
        own = normals[f]
        if own[0] == 0 and own[1] == 0 and own[2] == 0:
            continue
        best, choice = uneven[f] + pull * (1.0 - dot(own, means[f])), f
        for k in range(3):
            v = faces[f, k]
            first, last = corner_start[v], corner_start[v + 1]
            stride = 1 + (last - first - 1) // _MOST_FAN
            for i in range(first, last, stride):
                g = corners[i] // 3
                cost = uneven[g] + pull * (1.0 - dot(own, means[g]))
                if cost < best:
                    best, choice = cost, g
        out[f] = means[choice]
        make_unit(out[f])


@kernel
def _mix(start, stop, new, shares, mixed):
    for f in range(start, stop):
        if shares[f] > 0:
            x = mixed[f, 0] + shares[f] * (new[f, 0] - mixed[f, 0])
            y = mixed[f, 1] + shares[f] * (new[f, 1] - mixed[f, 1])
            z = mixed[f, 2] + shares[f] * (new[f, 2] - mixed[f, 2])
            length = np.sqrt(x * x + y * y + z * z)
            if length > 1e-12:
                mixed[f, 0], mixed[f, 1], mixed[f, 2] = x / length, y / length, z / length
