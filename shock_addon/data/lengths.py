# SPDX-License-Identifier: GPL-3.0-or-later
"""Lengths as people read them: in the units of the scene, and in edge lengths."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt

_SMALLEST = {"METRIC": (1e-6, "µm"), "IMPERIAL": (2.54e-5, "thou")}
"""The smallest unit of each system; Blender writes what is shorter in meters or feet, as 0."""


def in_scene(length: float) -> str:
    """Write a length in the units of the scene, such as "4.5 cm"."""
    units = bpy.context.scene.unit_settings
    if units.system == "NONE":
        return f"{length:.3g}"
    long = float(f"{length * units.scale_length:.3g}")
    unit, name = _SMALLEST[units.system]
    if 0.0 < abs(long) < unit:
        return f"{long / unit:.3g} {name}"
    return bpy.utils.units.to_string(units.system, "LENGTH", long, precision=5)


def in_both(edges: float, edge: float) -> str:
    """Write a length in the units of the scene, and in edge lengths.

    Parameters
    ----------
    edges : float
        In mean edge lengths.
    edge : float
        The mean edge length in the scene; 0 where it is not known.
    """
    number = f"{float(edges):.2g}"
    text = pgettext_rpt("{number} edge length" if number == "1" else "{number} edge lengths")
    text = text.format(number=number)
    return f"{in_scene(edges * edge)} ({text})" if edge > 0 else text
