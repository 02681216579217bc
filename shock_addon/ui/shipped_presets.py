# SPDX-License-Identifier: GPL-3.0-or-later
"""The presets that come with the extension: names, reasons and values. Needs no bpy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple


class ShippedPreset(NamedTuple):
    """A named set of a mode's settings.

    Attributes
    ----------
    name : str
        Words on screen.
    reason : str
        What it is for, without the final period (Blender adds it): the tooltip.
    values : mapping
        What differs from the defaults; all other settings of the filter get theirs.
    """

    name: str
    reason: str
    values: Mapping[str, Any]


DEFAULTS = ShippedPreset("Defaults", "Sets everything back to what it is at first", {})
"""A preset of each mode, above the others."""

_PAINTERLY = {"steady_state": True, "smoothing_passes": 4}

SHIPPED = {
    "denoise": (
        ShippedPreset(
            "Light Scan Noise",
            "For noise that is hardly seen: one short round, which keeps the fine relief that the"
            " default flattens",
            {"repeat": 1},
        ),
        ShippedPreset(
            "Strong Scan Noise",
            "For strong noise: twice as many rounds as the default. Slow; fine relief is lost",
            {"repeat": 6},
        ),
        ShippedPreset(
            "Noisy CAD Part",
            "For machine parts: removes the noise, then pulls the creases together, which come out"
            " a little soft otherwise",
            {"then_sharpen": True, "sharpen_time": 1024.0},
        ),
        ShippedPreset(
            "Noisy Vertex Colors",
            "For photographed colors: keeps edges better than the default, averages three times,"
            " and leaves about half the noise",
            {"target": "colors", "color_beta": 6.0, "color_iterations": 3},
        ),
    ),
    "geometry": (
        ShippedPreset(
            "Subtle",
            "For surfaces that are nearly right: creases tighten, and vertices move a third as"
            " far as by default. Gentle curves stay as they are",
            {"time": 16.0, "feature_threshold": 1.3},
        ),
        ShippedPreset(
            "Crisp CAD Edges",
            "For machine parts with rounded or smoothed edges: flows longer, and sharpens gentle"
            " bends, too. Coarse round surfaces get facets",
            {"time": 1024.0, "feature_threshold": 0.8},
        ),
        ShippedPreset(
            "Scan Cleanup",
            "For scans with light noise: smooths the normals first, so that creases are found in"
            " it, then sharpens a little. Faster than Denoise",
            {"time": 64.0, "mollify_passes": 2},
        ),
        ShippedPreset(
            "Carved Facets",
            "For style: everything flows as far as it can, as if the surface were carved with a"
            " knife",
            {
                "steady_state": True,
                "smoothing_passes": 8,
                "feature_threshold": 0.0,
                "sampling": "linear",
            },
        ),
    ),
    "colors": (
        ShippedPreset(
            "Subtle",
            "For colors that are sharp already: only the narrowest blends become steeper",
            {"time": 16.0},
        ),
        ShippedPreset(
            "Crisp Borders",
            "For wide, soft borders between areas that should have one color each: flows longer",
            {"time": 4096.0},
        ),
        ShippedPreset(
            "Painterly Steady State",
            "For style: colors flow until they meet, which leaves flat strokes with crisp borders",
            _PAINTERLY,
        ),
    ),
    "texture": (
        ShippedPreset(
            "Subtle",
            "For textures that are sharp already: a quarter of the default's time",
            {"time": 4.0},
        ),
        ShippedPreset(
            "Blurred Bake",
            "For bakes and scaled-up textures, whose edges are several texels wide",
            {"time": 256.0},
        ),
        ShippedPreset(
            "Normal Map",
            "For tangent-space normals: they are turned where values cross a seam, stay unit"
            " length, and no channel is taken for opacity",
            {"content": "normals", "alpha": "none"},
        ),
        ShippedPreset(
            "Painterly Steady State",
            "For style: colors flow until they meet, which leaves flat strokes with crisp borders",
            _PAINTERLY,
        ),
    ),
    "image": (
        ShippedPreset(
            "Subtle",
            "For photos that are sharp already: a quarter of the default's time",
            {"time": 4.0},
        ),
        ShippedPreset(
            "Blurred Photo",
            "For photos whose edges are two or three pixels wide",
            {"time": 256.0},
        ),
        ShippedPreset(
            "Very Blurred Photo",
            "For scaled-up or badly focused photos, whose edges are wider: flows longer, and"
            " ignores the noise between edges",
            {"time": 4096.0, "smoothing_passes": 3},
        ),
        ShippedPreset(
            "Painterly Steady State",
            "For style: colors flow until they meet, which leaves flat strokes with crisp borders",
            _PAINTERLY,
        ),
    ),
    "denoise_image": (
        ShippedPreset(
            "Light Noise",
            "For noise that is seen only close up: keeps the fine detail that the default flattens",
            {"beta": 15.0, "iterations": 1},
        ),
        ShippedPreset(
            "Strong Noise",
            "For night shots and few render samples: averages across fainter edges, too",
            {"beta": 4.0},
        ),
        ShippedPreset(
            "Flat Colors",
            "For style, and for pictures to be traced: flattens what lies between edges, and"
            " sharpens these",
            {"beta": 5.0, "iterations": 5, "then_sharpen": True, "sharpen_time": 100000.0},
        ),
    ),
}
"""The presets of each mode, in the order of the list that the panel's header opens."""
