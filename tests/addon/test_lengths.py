# SPDX-License-Identifier: GPL-3.0-or-later
"""Lengths in reports."""

import bpy
import pytest
from shock_filter.shock_addon.data import lengths


@pytest.mark.parametrize(
    ("system", "length", "written"),
    [
        ("METRIC", 0.0, "0 m"),
        ("METRIC", 3.25e-9, "0.00325 µm"),
        ("METRIC", 9.999e-7, "1 µm"),
        ("METRIC", -4e-7, "-0.4 µm"),
        ("METRIC", 1.3e-5, "13 µm"),
        ("METRIC", 0.045, "4.5 cm"),
        ("IMPERIAL", 1.27e-5, "0.5 thou"),
        ("IMPERIAL", 2.54e-4, "10 thou"),
        ("NONE", 3e-7, "3e-07"),
    ],
)
def test_short_lengths_have_the_smallest_unit(system, length, written):
    bpy.context.scene.unit_settings.system = system
    assert lengths.in_scene(length) == written
