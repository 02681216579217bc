# SPDX-License-Identifier: GPL-3.0-or-later
"""Colors on a patch, which previews show, beside those on the whole surface."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import erf
from shapes import grid
from shock_filter import core
from shock_filter.core.base.srgb import decoded, encoded
from shock_filter.core.host.colors import filter_colors, width_of_borders
from shock_filter.core.host.inputs import ColoredSurface
from shock_filter.core.preview.patch import patch_around, whole_surface

NAME = "sharpen_vertex_signal"


def sheets(*widths, edges=(0.5, 1.5), corners=False):
    """Sheets side by side, each with edges of its own and a border of its own width."""
    points, triangles, colors = [], [], []
    for number, (width, edge) in enumerate(zip(widths, edges, strict=True)):
        vertices, faces = grid(40, 40, 0.2)
        triangles.append(faces + len(vertices) * number)
        points.append(edge * vertices + [100.0 * number, 0, 0])
        step = 0.5 + 0.4 * erf(2.5631 * (vertices[:, 0] - 20) * edge / width / 2**0.5)
        colors.append(np.repeat(step[:, None], 3, axis=1))
    faces = np.concatenate(triangles).astype(np.int32)
    values = np.concatenate(colors).astype(np.float32)
    return ColoredSurface(
        positions=np.concatenate(points).astype(np.float32),
        triangles=faces,
        mask=None,
        to_world=np.identity(3),
        colors=values[faces].reshape(-1, 3) if corners else values,
        corners=np.arange(faces.size, dtype=np.int32).reshape(-1, 3) if corners else None,
        free=None,
        levels=0,
    )


@pytest.mark.parametrize("corners", [False, True])
@pytest.mark.parametrize("settings", [{}, {"width": 3.0}, {"what": "photo"}])
def test_a_patch_with_shorter_edges_shows_what_the_whole_gets(corners, settings):
    whole = sheets(4.0, 6.0, corners=corners)
    patch = patch_around(whole, 820, 41 * 41)
    assert patch.lengths == pytest.approx(2.0, rel=0.05)
    settings = core.ShockSettings(**({"what": "drawing"} | settings))
    wanted = filter_colors(whole, NAME, settings, True).colors
    part = filter_colors(patch.surface, NAME, patch.settings(settings), True)
    seen = patch.whole(part).colors
    here = slice(0, 41 * 41 if not corners else 6 * 40 * 40)
    change = np.abs(wanted[here] - whole.colors[here])
    assert change.max() > 0.1
    assert np.abs(seen[here] - wanted[here]).mean() < 0.25 * change.mean()
    assert np.array_equal(seen[here.stop :], whole.colors[here.stop :])


@pytest.mark.parametrize("corners", [False, True])
def test_bytes_become_what_floats_of_the_same_light_become(corners):
    floats = sheets(4.0, 6.0, corners=corners)
    stored = np.rint(255.0 * encoded(floats.colors)) / np.float32(255.0)
    bytes_ = replace(floats, colors=stored, levels=255)
    floats = replace(floats, colors=decoded(stored))
    settings = core.ShockSettings(what="drawing")
    wanted = filter_colors(floats, NAME, settings, True)
    found = filter_colors(bytes_, NAME, settings, True)
    assert np.abs(found.colors - encoded(wanted.colors)).max() < 0.51 / 255.0
    assert found.largest_change > 0.1
    assert width_of_borders(bytes_, "drawing") == width_of_borders(floats, "drawing")
    kept = filter_colors(bytes_, NAME, core.ShockSettings(amount=0.0), True).colors
    assert np.array_equal(kept, stored)


def test_a_patch_takes_the_width_of_the_whole():
    whole = sheets(1e4, 3.0, edges=(1.0, 1.0))  # there is no border in the patch itself
    width = width_of_borders(whole, "drawing")
    assert width == pytest.approx(3.0, rel=0.2)
    patch = patch_around(whole, 820, 41 * 41)
    assert width_of_borders(patch.surface, "drawing") == 0.0
    assert patch.settings(core.ShockSettings(what="drawing")).width == pytest.approx(
        width, rel=0.05
    )
    assert patch.settings(core.ShockSettings(width=2.0)).width == pytest.approx(2.0, rel=0.05)
    assert patch.settings(core.ShockSettings(time=0.0)).width == 0.0
    fine = patch_around(sheets(4.0, 6.0), 820, 41 * 41)  # its edges are half as long
    assert fine.settings(core.ShockSettings(width=64.0)).width == 64.0
    assert whole_surface(whole).settings(core.ShockSettings()) == core.ShockSettings()


def test_where_the_whole_is_sharp_nothing_changes_on_a_patch():
    whole = sheets(0.1, 0.1)
    patch = patch_around(whole, 820, 41 * 41)
    settings = patch.settings(core.ShockSettings(what="drawing"))
    assert settings.is_neutral
    assert filter_colors(patch.surface, NAME, settings, True).changed == 0
