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
from ..base.vectors import TIE_BREAKER, dot
from ..flow.potential import bending, dilation, opening
from ..mesh.adjacency import connected_parts
from ..mesh.calculus import (
    average_to_vertices,
    cosines,
    greatest_to_faces,
    greatest_to_vertices,
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

_ROUNDING = 1e-12
"""Costs that differ by less are the same, and rounding made the difference."""

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

    def among(self, chosen: npt.NDArray[np.bool_]) -> Regions:
        """Return the regions of some faces only."""
        return self._replace(
            use=self.use[chosen], creased=self.creased[chosen], wide=self.wide[chosen]
        )

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
        crest = dilation(mesh, turn, 2)
    count = mesh.vertex_count
    energy, (over, out, weight) = lumped_mass(mesh), (np.empty(count) for _ in range(3))
    with phase(0.5, 0.6, message):
        run(_stand_out, count, turn, level, crest, energy, over, out, weight)
        around = greatest_to_faces(mesh, dilation(mesh, weight, 3)) > 0
        sides = consistent_normals(mesh, mesh.normals, around, 1)
        between = np.empty((mesh.face_count, 1))
        run(_squared_distance, mesh.face_count, sides, mesh.normals, between)
        apart = smooth_vertices(mesh, average_to_vertices(mesh, between), 2)[:, 0]
    width = far / np.maximum(turn, 1e-12)
    jagged = np.sqrt(apart) / np.maximum(turn, 1e-12)

    part, parts = connected_parts(mesh.neighbours)
    on_crest = weight > 0.5
    part_of_crest = part[on_crest]
    typical_bend = np.sqrt(_quantiles(part, bend, parts, 0.5))
    typical_width = _quantiles(part_of_crest, width[on_crest], parts, 0.5)
    faint, strong = (_quantiles(part_of_crest, turn[on_crest], parts, q) for q in (0.1, 0.9))
    typical_jag = _quantiles(part_of_crest, jagged[on_crest], parts, 0.5)
    worse_jag = _quantiles(part_of_crest, jagged[on_crest], parts, _MOST_SHARP)
    share = _ratio(np.bincount(part, energy * out, parts), np.bincount(part, energy, parts))
    finer = typical_bend - _SURE[1] * ramp(share, _SURE[0])
    creased_part = ramp(share, _SHARE) * (1.0 - ramp(finer, _COARSE))
    # Denoising leaves relief with facets, whose edges are of all angles, down to faint ones.
    alike = np.maximum(ramp(_ratio(faint, strong), _ALIKE), ramp(share, _ONLY))
    creased_part *= np.maximum(alike, ramp(np.degrees(faint), _FAINT))
    # Ridges that smoothing takes away are noise; where there is none, D_8 / D_2 is 1 at least.
    creased_part *= ramp(typical_width, _NOISY)
    wide_part = np.where(creased_part > 0, ramp(typical_width, _WIDE_PART), 0.0)
    blunt_part = ramp(worse_jag, _JAGGED_PART)
    # In parts that are sharp for the most, corners are not to be taken for blunt.
    stricter = _STRICTER * (1.0 - ramp(typical_jag, _JAGGED_PART))
    with phase(0.6, 1.0, message):
        # Of the surroundings, only what the parts' measures leave open.
        columns = 5 if wide_part.any() or widest > 0 else 4 if creased_part.any() else 2
        sums = np.empty((count, columns))
        run(_weigh_ridges, count, weight, turn, apart, energy, out, width, sums)
        sums = smooth_vertices(mesh, sums, _PASSES if blunt_part.any() else 0)
    use, creased, wide = (np.empty(count) for _ in range(3))
    run(_decide, count, part, sums, over, turn, creased_part, wide_part, blunt_part, stricter,
        use, creased, wide)  # fmt: skip
    too_wide = False
    if widest > 0:
        most = float(np.interp(widest, *_WIDTHS))
        left = ramp(_ratio(sums[:, 4], sums[:, 0]), (most - 0.03, most + 0.03))
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
    """Report the creases that were found; see `base.findings`."""
    if not regions.closed.any():
        if regions.too_wide:
            tell("The creases are rounded more widely than Widest Fillet, and stay.")
        elif regions.use.any():
            tell(
                "Not made of creases: only what stands out clearly was sharpened. For more, set"
                " Where to Everywhere."
            )
        elif regions.creased.any():
            tell("The creases are sharp already.")
        else:
            tell(
                "No creases to close were found: what is round, flat or coarse stays. For more, set"
                " Where to Everywhere."
            )
    elif regions.radius < 1:
        tell("Closed creases that were blunt by about an edge length; smooth parts stay.")
    else:
        tell(
            "Closed creases that were rounded over a radius of {radius:.1f} edge lengths; smooth"
            " parts stay.",
            radius=regions.radius,
        )
        tell("To keep threads and fillets, set Widest Fillet below that.")


def ramp(values: Floats, ends: tuple[float, float]) -> Floats:
    """Rise smoothly from 0 at the first end to 1 at the second: (n,) -> (n,)."""
    out = np.empty(len(values))
    run(_rise_all, len(values), values, ends, out)
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
    for iteration in range(passes):
        out = np.empty_like(normals)
        with phase(iteration / passes, (iteration + 0.5) / passes, "Aligning creases"):
            run(_patches, mesh.face_count, mesh.faces, *mesh.corners, around, normals, mesh.areas,
                means, uneven)  # fmt: skip
        with phase((iteration + 0.5) / passes, (iteration + 1) / passes, "Aligning creases"):
            run(_choose, mesh.face_count, mesh.faces, *mesh.corners, zone, normals, means, uneven,
                _PULL, out)  # fmt: skip
        normals = out
    return normals


def turned_zone(mesh: TriangleMesh, old: Floats, new: Floats) -> npt.NDArray[np.bool_]:
    """Faces whose normals differ by 3 degrees and more, and those that share a vertex with them."""
    turned = cosines(old, new) < np.cos(np.radians(3.0))
    return _grown(mesh, turned & (mesh.areas > 0))


def mixed_normals(old: Floats, new: Floats, shares: Floats) -> Floats:
    """Mix unit normals by shares (m,) of the new ones; a share of 0 keeps every bit."""
    mixed = np.empty_like(old)
    with aside("Sharpening"):
        run(_mix, len(old), old, new, shares, mixed)
    return mixed


def _grown(mesh: TriangleMesh, zone: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    with aside("Aligning creases"):
        touched = greatest_to_vertices(mesh, zone.view(np.uint8))
        return greatest_to_faces(mesh, touched).view(np.bool_)


@kernel
def _rise(value, ends):
    t = min(max((value - ends[0]) / (ends[1] - ends[0]), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@kernel
def _rise_all(start, stop, values, ends, out):
    for i in range(start, stop):
        out[i] = _rise(values[i], ends)


@kernel
def _stand_out(start, stop, turn, level, highest, energy, over, out, weight):
    # Takes the mass in `energy`. A crest is where the turn is the highest around.
    for v in range(start, stop):
        over[v] = turn[v] / max(level[v], 1e-12)
        out[v] = _rise(over[v], _STANDS_OUT)
        energy[v] *= turn[v] ** 2
        crest = turn[v] >= 0.999 * highest[v]
        weight[v] = out[v] * _rise(np.degrees(turn[v]), _TURNS) if crest else 0.0


@kernel
def _weigh_ridges(start, stop, weight, turn, apart, energy, out, width, sums):
    # For means around the vertices; as many columns as asked for.
    for v in range(start, stop):
        ridge = weight[v] * turn[v] ** 2
        sums[v, 0] = ridge
        sums[v, 1] = weight[v] * apart[v]
        if sums.shape[1] > 2:
            sums[v, 2] = energy[v]
            sums[v, 3] = energy[v] * out[v]
        if sums.shape[1] > 4:
            sums[v, 4] = ridge * width[v]


@kernel
def _quotient(above, below):
    return above / below if below > 0 else 0.0


@kernel
def _decide(
    start,
    stop,
    part,
    sums,
    over,
    turn,
    creased_part,
    wide_part,
    blunt_part,
    stricter,
    use,
    creased,
    wide,
):
    # From the measures of a vertex, its surroundings (see _weigh_ridges) and its part.
    for v in range(start, stop):
        p, ridge = part[v], sums[v, 0]
        jagged = np.sqrt(_quotient(sums[v, 1], ridge)) - stricter[p]
        blunt = blunt_part[p] * _rise(jagged, _JAGGED)
        creased[v], wide[v] = creased_part[p], wide_part[p]
        if creased[v] > 0:
            creased[v] *= _rise(_quotient(sums[v, 3], sums[v, 2]), _SHARE_AROUND)
        if wide[v] > 0:
            wide[v] *= creased[v] * _rise(_quotient(sums[v, 4], ridge), _WIDE)
        clearly = _rise(over[v], _CLEARLY_OUT) * _rise(np.degrees(turn[v]), _CLEARLY_TURNS)
        use[v] = max(creased[v], _RELIEF * clearly) * blunt


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
def _cost(own, means, uneven, pull, f):
    # Of taking the mean normal of the patch around face f.
    return uneven[f] + pull * (1.0 - dot(own, means[f]))


@kernel
def _choose(start, stop, faces, corner_start, corners, zone, normals, means, uneven, pull, out):
    for f in range(start, stop):
        own = normals[f]
        if not zone[f] or (own[0] == 0 and own[1] == 0 and own[2] == 0):
            out[f] = own
            continue
        # Of costs that only rounding tells apart a direction decides, not the order of faces.
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


@kernel
def _mix(start, stop, old, new, shares, mixed):
    for f in range(start, stop):
        mixed[f] = old[f]
        if shares[f] > 0:
            x = old[f, 0] + shares[f] * (new[f, 0] - old[f, 0])
            y = old[f, 1] + shares[f] * (new[f, 1] - old[f, 1])
            z = old[f, 2] + shares[f] * (new[f, 2] - old[f, 2])
            length = np.sqrt(x * x + y * y + z * z)
            if length > 1e-12:
                mixed[f, 0], mixed[f, 1], mixed[f, 2] = x / length, y / length, z / length
