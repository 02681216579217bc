# SPDX-License-Identifier: GPL-3.0-or-later
"""Normals without bumps of a given width, and normals with rounder or crisper creases.

Not in the papers that this package is made for. Bumps are left out by rolling guidance (Wang et
al., "Rolling guidance normal filter for geometric processing", 2015): normals are averaged over a
disk as wide as the bumps, among faces whose guides are alike. The guide of the first round is a
mean over a smaller disk, that of the next one is what the last one gave, so creases come back.
"""

from __future__ import annotations

from math import floor

import numpy as np

from ..base.progress import ask, phase
from ..mesh.triangle_mesh import Floats, TriangleMesh
from ..mixture.network import Singles
from .smoothings import Faces, field_of

_PASSES, _OF_GUIDE = 1.5, 0.1
"""Averaging passes for bumps one mean edge length wide, which grow with the square of the width;
and those of the first guide."""

_SPREAD = 0.4
"""How far apart guides are that count by exp(-1/2), for bumps one mean edge length wide: normals
turn more slowly the farther they are averaged."""

_MOST_SPREAD = 0.4
"""Of narrow bumps."""

_ROUNDS = 3
"""How often the guide is replaced by what it led to."""

_PASSES_OF_CREASES, _CRISP = 4, 0.15
"""Passes that round creases or make them crisp; and how far apart the most even patches are that
count by exp(-1/2) for crisp ones."""

_MESSAGE = "Denoising"


def without_bumps(mesh: TriangleMesh, width: float) -> Floats:
    """Smooth normals so that bumps up to a width, in mean edge lengths, go and creases stay."""
    passes = _PASSES * width * width
    spread = min(_SPREAD / width, _MOST_SPREAD)
    faces, field = Faces(mesh), field_of(mesh, mesh.scaled_vertices)
    guide = _averaged(faces, field, None, 0.0, _OF_GUIDE * passes)
    for done in range(_ROUNDS):
        with phase(done / _ROUNDS, (done + 1) / _ROUNDS, _MESSAGE):
            guide = _averaged(faces, field, guide, spread, passes)
    return guide[:, :3].astype(np.float64)


def with_creases(mesh: TriangleMesh, normals: Floats, keep: float) -> Floats:
    """Round the creases of normals, for `keep` below 0.5, or make them crisp above it: (m, 3)."""
    faces, field = Faces(mesh), field_of(mesh, mesh.scaled_vertices)
    field[:, :3] = normals
    guide = None if keep < 0.5 else faces.even(field)
    other = _averaged(faces, field, guide, _CRISP, _PASSES_OF_CREASES)
    return _between(field, other, abs(2.0 * keep - 1.0))[:, :3].astype(np.float64)


def _averaged(
    faces: Faces, field: Singles, guide: Singles | None, spread: float, passes: float
) -> Singles:
    # The last pass may be a part of one, so that numbers of passes lead to results without jumps.
    whole = floor(passes)
    for _ in range(whole):
        ask()
        field = faces.mean(field, guide, spread)
    if passes > whole:
        field = _between(field, faces.mean(field, guide, spread), passes - whole)
    return field


def _between(one: Singles, other: Singles, share: float) -> Singles:
    mean = one + np.float32(share) * (other - one)
    length = np.linalg.norm(mean[:, :3], axis=1, keepdims=True)
    mean[:, :3] /= np.maximum(length, np.float32(1e-12))
    return mean
