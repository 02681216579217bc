# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoising on a patch, which previews show, beside that of the whole mesh."""

from dataclasses import replace

import numpy as np
import pytest
from shapes import grid
from shock_filter import core
from shock_filter.core.host.geometry import filter_shape
from shock_filter.core.host.inputs import Denoising, MirroredSurface
from shock_filter.core.mesh.calculus import smooth_vertices
from shock_filter.core.preview.patch import patch_around, whole_surface

NAME, CELLS = "denoise_geometry", 40


def sheets(passes):
    """Two noisy sheets, the first with shorter edges; passes of smoothing widen the bumps."""
    points, triangles = [], []
    for number, edge in enumerate((1.0, 2.0)):
        vertices, faces = grid(CELLS, CELLS, 0.2)
        bumps = np.random.default_rng(number).normal(size=(len(vertices), 1))
        bumps = smooth_vertices(core.TriangleMesh(vertices, faces), bumps, passes)
        vertices[:, 2] = 0.15 * bumps[:, 0] / bumps.std()
        triangles.append(faces + len(vertices) * number)
        points.append(edge * vertices + [100.0 * number, 0, 0])
    return MirroredSurface(
        positions=np.concatenate(points).astype(np.float32),
        triangles=np.concatenate(triangles).astype(np.int32),
        mask=None,
        to_world=np.identity(3),
        mirror=(False, False, False),
        planes=(),
    )


def first_sheet(whole):
    size = (CELLS + 1) ** 2
    return patch_around(whole, size // 2, size), size


@pytest.mark.parametrize("passes", [0, 1])
def test_a_patch_with_shorter_edges_shows_what_the_whole_gets(passes):
    whole = sheets(passes)
    patch, size = first_sheet(whole)
    assert patch.lengths == pytest.approx(1.5, rel=0.05)
    settings = Denoising(core.BeltramiGeometrySettings(time=0.8), None)
    wanted = filter_shape(whole, NAME, settings, True).positions
    seen = patch.whole(filter_shape(patch.surface, NAME, patch.settings(settings), True)).positions
    change = np.abs(wanted - whole.positions)[:size].mean()
    assert np.abs(seen - wanted)[:size].mean() < 0.4 * change
    assert np.array_equal(seen[size:], whole.positions[size:])


def test_edges_in_a_patch_are_those_of_its_vertices():
    whole = sheets(0)
    ends = whole.triangles[:, [0, 1]]
    whole = replace(whole, edges=ends, sharp_angle=30.0)
    patch = patch_around(whole, (CELLS + 1) * CELLS // 2, 400)
    assert patch.surface.sharp_angle == 30.0
    chosen = np.flatnonzero(np.isin(whole.positions, patch.surface.positions).all(axis=1))
    wanted = ends[np.isin(ends, chosen).all(axis=1)]
    assert 0 < len(wanted) < len(ends)
    assert np.array_equal(chosen[patch.surface.edges], wanted)
    assert patch_around(sheets(0), 0, 400).surface.edges is None


def test_lengths_of_the_kernel_are_those_of_the_whole():
    settings = core.BeltramiGeometrySettings(time=0.8)
    for patch in (first_sheet(sheets(0))[0], first_sheet(sheets(1))[0]):
        assert patch.settings(settings).time == pytest.approx(0.8 * patch.lengths**2)
        assert patch.settings(settings).beta == pytest.approx(0.9 * patch.lengths)
    assert whole_surface(sheets(1)).settings(settings) == settings


def test_the_border_of_a_patch_stays():
    whole = sheets(0)
    patch = patch_around(whole, (CELLS + 1) * CELLS // 2, 400)
    settings = Denoising(core.BeltramiGeometrySettings(), None)
    moved = patch.whole(filter_shape(patch.surface, NAME, settings, True)).positions
    changed = (moved != whole.positions).any(axis=1)
    chosen = np.isin(whole.positions, patch.surface.positions).all(axis=1)
    outside = ~chosen[whole.triangles].all(axis=1)
    beside = np.zeros(len(changed), dtype=bool)
    beside[whole.triangles[outside]] = True
    assert changed.sum() > 200
    assert not changed[beside].any()
