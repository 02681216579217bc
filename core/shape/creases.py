# SPDX-License-Identifier: GPL-3.0-or-later
"""Target normals of the faces along creases: nine candidates, weighed face by face.

Not in the papers. Voxel remeshing, marching cubes and smoothing turn a crease into a strip of
slanted faces, and a fillet, a fold of cloth or noise looks much the same. A small network, trained
on synthetic solids (`tools/training`), weighs the candidates of `candidates`. Faces that hardly
turn stay as they are.
"""

from __future__ import annotations

from functools import cache
from math import ceil
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.findings import EdgeLengths, tell
from ..base.memo import kept
from ..base.parallel import kernel, run
from ..base.progress import phase
from ..base.vectors import dot
from ..flow.potential import dilation
from ..mesh.calculus import (
    average_to_faces,
    cosines,
    greatest_to_faces,
    greatest_to_vertices,
    smooth_vertices,
)
from ..mesh.triangle_mesh import Floats, TriangleMesh
from ..mixture.choice import mixture
from ..mixture.network import Network, Singles, load
from ..settings import GeometrySettings
from .candidates import DEFINITION, TAKES_SIDES, Candidates, find_candidates, flow_key
from .crease_edges import even_share

WEIGHTS = Path(__file__).with_name("creases.npz")

_TURN_RAMP = 2.5, 6.0
"""Ramp in degrees of the turn to the target normal: below the first value a face and those around
it stay, above the second they turn fully."""

_TURNED_COSINE = np.cos(np.radians(_TURN_RAMP[1]))

_RINGS = 3
"""Number of rings around turning faces in which faces turn too."""

WIDTHS = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0), (1.08, 1.10, 1.15, 1.22, 1.30, 1.46, 1.54)
"""Radii of fillets between two planes, in mean edge lengths, and the width measure of each: the
turn of the normals over 8 smoothing passes over that over 2. Measured after a voxel remesh."""

_MARGIN = 0.03
"""Half width of a ramp around Widest Fillet, in the same measure, in which roundings close in
part."""

_NEARLY_ALL = 0.95
"""Share of the crest vertices whose roundings the reported widest fillet would close."""

_ROUNDING_RAMP = 6.0, 10.0
"""Ramp in degrees, for Widest Fillet: where normals turn by less than the first value there is no
rounding, by more than the second there surely is."""

_WIDTH_PASSES = 12
"""Smoothing passes that average the width measure, over about four edges."""


class Creases(NamedTuple):
    """Target normals of the faces of a mesh, and what was found about its creases.

    Attributes
    ----------
    normals : (m, 3) float64
        The target of each face; its own normal, bit for bit, where its share is 0.
    shares : (m,) float64
        Weight from 0 to 1 between the own normal and that of the mixture.
    sided : (m,) float32
        Mixture weight of the candidates that belong to one side of a crease: near 1 along a sure
        crease, near 0 where normals are only smoothed, or do not turn.
    radius : float
        Median radius of the roundings that are closed, in mean edge lengths.
    widest : float
        Widest Fillet that would close nearly all of them, in mean edge lengths.
    too_wide : bool
        Whether some creases stay because their rounding is wider than Widest Fillet.
    """

    normals: Floats
    shares: Floats
    sided: npt.NDArray[np.float32]
    radius: float
    widest: float
    too_wide: bool

    def among(self, chosen: npt.NDArray[np.bool_]) -> Creases:
        """Return the same for some of the faces."""
        return self._replace(
            normals=self.normals[chosen], shares=self.shares[chosen], sided=self.sided[chosen]
        )


def find_targets(mesh: TriangleMesh, settings: GeometrySettings) -> Creases:
    """Find the target normals; used are the settings in `flow_key`, and the widest fillet."""
    key = (*flow_key(settings), settings.widest_fillet)
    return kept(mesh, "creases", key, lambda: _find_targets(mesh, settings))


def tell_creases(
    mesh: TriangleMesh, creases: Creases, chosen: npt.NDArray[np.bool_] | None
) -> None:
    """Report what was found among the chosen faces; see `base.findings`."""
    among = creases if chosen is None else creases.among(chosen)
    if not (among.shares > 0).any():
        if creases.too_wide:
            tell("The creases are rounded more widely than Widest Fillet, and stay.")
        elif even_share(mesh, chosen) > 0.5:
            tell("The creases are sharp already.")
        else:
            tell(
                "No creases to close were found: round, flat and coarse parts stay. For more,"
                " set Where to Everywhere."
            )
    else:
        widest = max(ceil(10.0 * creases.widest), 1) / 10.0  # as reports write it
        tell(
            "Closed creases that were rounded over a radius of up to {widest_fillet}; smooth parts"
            " stay.",
            widest_fillet=EdgeLengths(widest, mesh.mean_edge_length),
        )
        if creases.radius >= 1:
            tell("To keep threads and fillets, set Widest Fillet below that.")


@cache
def networks() -> dict[str, Network]:
    """Load the networks: "mixture" weighs candidates, "gate" chooses the faces that may turn."""
    return load(WEIGHTS, DEFINITION)


def ramp(values: Floats, ends: tuple[float, float]) -> Floats:
    """Rise smoothly from 0 at the first end to 1 at the second: (n,) -> (n,)."""
    out = np.empty(len(values))
    run(_rise_all, len(values), values, ends, out)
    return out


def _find_targets(mesh: TriangleMesh, settings: GeometrySettings) -> Creases:
    message = "Finding creases"
    with phase(0.0, 0.8, message):
        found, scores = weighed(mesh, settings)
    if len(found.rows) == 0:
        none = np.zeros(mesh.face_count)
        return Creases(mesh.normals, none, none.astype(np.float32), 0.0, 0.0, False)
    with phase(0.8, 0.9, message):
        normals, weights = mixture(found.normals, scores)
    sided = weights[:, TAKES_SIDES:].sum(axis=1)
    too_wide = False
    with phase(0.9, 1.0, message):
        crest = _crests(mesh, found)
        if settings.widest_fillet > 0:
            wide, clear = _fillets(mesh, found, crest, settings.widest_fillet)
            closed, _ = mixture(found.normals, scores, TAKES_SIDES)
            turns = cosines(found.normals[:, 0].astype(np.float64), closed) < _TURNED_COSINE
            too_wide = bool((turns & (wide * clear > 0.5)).any())
            narrow = (1.0 - wide) * clear
            _mix_to(normals, closed, narrow)
            _mix_to(normals, found.normals[:, 0].astype(np.float64), wide)
            sided += narrow * (1.0 - sided)
            sided *= 1.0 - wide
        normals, shares = _taken(mesh, found.rows, normals)
    everywhere = np.zeros(mesh.face_count, dtype=np.float32)
    everywhere[found.rows] = sided
    radii = _radii(mesh, found, crest, shares)
    if settings.widest_fillet > 0:  # measured at single vertices, radii may come out larger
        radii = min(radii[0], settings.widest_fillet), min(radii[1], settings.widest_fillet)
    return Creases(normals, shares, everywhere, *radii, too_wide)


def weighed(mesh: TriangleMesh, settings: GeometrySettings) -> tuple[Candidates, Singles]:
    """Find the candidates and their scores, without the features, which are large.

    If Widest Fillet is given, no gate is used, because roundings must close that it would reject.
    """
    gate = networks()["gate"] if settings.widest_fillet == 0 else None
    key = (*flow_key(settings), gate is None)
    return kept(mesh, "weighed", key, lambda: _weighed(mesh, settings, gate))


def _weighed(
    mesh: TriangleMesh, settings: GeometrySettings, gate: Network | None
) -> tuple[Candidates, Singles]:
    with phase(0.0, 0.9, "Finding creases"):
        found = find_candidates(mesh, settings, gate)
    with phase(0.9, 1.0, "Finding creases"):
        scores = networks()["mixture"].scores(found.told)
    return found._replace(told=found.told[:0].copy()), scores


def _taken(
    mesh: TriangleMesh, rows: npt.NDArray[np.intp], normals: Floats
) -> tuple[Floats, Floats]:
    # Takes the mixed normals around faces that turn; others keep their own, bit for bit.
    turned = np.zeros(mesh.face_count)
    run(_measure_turns, len(rows), rows, mesh.normals, normals, _TURN_RAMP, turned)
    seed = greatest_to_vertices(mesh, turned)
    near = smooth_vertices(mesh, dilation(mesh, seed, _RINGS).reshape(-1, 1), 2)
    shares = average_to_faces(mesh, near).reshape(-1)
    taken, mixed = np.zeros(mesh.face_count), mesh.normals.copy()
    run(_take, len(rows), rows, shares, normals, mixed, taken)
    return mixed, taken


def _crests(mesh: TriangleMesh, found: Candidates) -> Floats:
    # The squared turn at vertices where it is largest within two rings, 0 elsewhere: (n,).
    crest = dilation(mesh, found.turn, 2)
    run(_keep_highest, mesh.vertex_count, found.turn, crest)
    return crest


def _fillets(
    mesh: TriangleMesh, found: Candidates, crest: Floats, widest: float
) -> tuple[Floats, Floats]:
    # How surely a face lies at a rounding wider than `widest`, and at a rounding at all.
    sums = np.stack([crest, crest * widths(found)], axis=1)
    sums = smooth_vertices(mesh, sums, _WIDTH_PASSES)
    width = np.divide(sums[:, 1], sums[:, 0], out=np.zeros(len(sums)), where=sums[:, 0] > 0)
    most = float(np.interp(widest, *WIDTHS))
    wide = greatest_to_faces(mesh, ramp(width, (most - _MARGIN, most + _MARGIN)))
    clear = dilation(mesh, ramp(np.degrees(np.sqrt(crest)), _ROUNDING_RAMP), _RINGS)
    wide, clear = wide[found.rows], greatest_to_faces(mesh, clear)[found.rows]
    return wide, clear


def _radii(
    mesh: TriangleMesh, found: Candidates, crest: Floats, shares: Floats
) -> tuple[float, float]:
    # The median radius of the roundings that close, and the widest fillet that closes nearly all.
    at = (crest > 0) & (greatest_to_vertices(mesh, shares) > 0.5)
    if not at.any():
        return 0.0, 0.0
    most, widest = np.quantile(widths(found)[at], (0.5, _NEARLY_ALL))
    radius, reach = np.interp((most, widest + _MARGIN), *WIDTHS[::-1])
    return float(radius), float(reach)


def widths(found: Candidates) -> Floats:
    # The width measure of `WIDTHS`: about 1 at a sharp crease, more at wider roundings.
    return found.wide_turn / np.maximum(found.turn, 1e-12)


def _mix_to(normals: Floats, others: Floats, shares: Floats) -> None:
    run(_mix, len(normals), normals, others, shares)


@kernel
def _rise(value, ends):
    t = min(max((value - ends[0]) / (ends[1] - ends[0]), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@kernel
def _rise_all(start, stop, values, ends, out):
    for i in range(start, stop):
        out[i] = _rise(values[i], ends)


@kernel
def _keep_highest(start, stop, turn, crest):
    for v in range(start, stop):
        crest[v] = turn[v] ** 2 if turn[v] >= 0.999 * crest[v] else 0.0


@kernel
def _measure_turns(start, stop, rows, old, new, ends, turned):
    for r in range(start, stop):
        f = rows[r]
        angle = np.degrees(np.arccos(min(max(dot(old[f], new[r]), -1.0), 1.0)))
        turned[f] = _rise(angle, ends)


@kernel
def _take(start, stop, rows, shares, new, normals, taken):
    # Blends towards new normals, in place; a share near 0 keeps every bit.
    for r in range(start, stop):
        f = rows[r]
        share = shares[f]
        if share < 1e-3:
            continue
        taken[f] = share
        x, y, z = normals[f, 0], normals[f, 1], normals[f, 2]
        x += share * (new[r, 0] - x)
        y += share * (new[r, 1] - y)
        z += share * (new[r, 2] - z)
        length = np.sqrt(x * x + y * y + z * z)
        if length > 1e-12:
            normals[f, 0], normals[f, 1], normals[f, 2] = x / length, y / length, z / length


@kernel
def _mix(start, stop, normals, others, shares):
    for f in range(start, stop):
        x = normals[f, 0] + shares[f] * (others[f, 0] - normals[f, 0])
        y = normals[f, 1] + shares[f] * (others[f, 1] - normals[f, 1])
        z = normals[f, 2] + shares[f] * (others[f, 2] - normals[f, 2])
        length = np.sqrt(x * x + y * y + z * z)
        if length > 1e-12:
            normals[f, 0], normals[f, 1], normals[f, 2] = x / length, y / length, z / length
