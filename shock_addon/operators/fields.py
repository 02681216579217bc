# SPDX-License-Identifier: GPL-3.0-or-later
"""Which of each mode's properties are settings of the filter, and what these mean."""

from __future__ import annotations

from ...core.settings import (
    BeltramiGeometrySettings,
    BeltramiMeshSettings,
    BeltramiSettings,
    GeometrySettings,
    ImageSettings,
    Setting,
    ShockSettings,
    TextureSettings,
    describe,
)
from .properties import COLOR_PREFIX, NAMES, STEADY_STATE, denoise_names


def _fields(settings: type, prefix: str = "") -> dict[str, Setting]:
    return {prefix + name: about for name, (_, _, about) in describe(settings).items()}


FIELDS = {
    "denoise": _fields(BeltramiGeometrySettings) | _fields(BeltramiMeshSettings, COLOR_PREFIX),
    "denoise_image": _fields(BeltramiSettings),
    "geometry": _fields(GeometrySettings),
    "colors": _fields(ShockSettings),
    "image": _fields(ImageSettings),
    "texture": _fields(TextureSettings),
}
"""The fields of the core's settings, by the names of the properties."""

_OTHERS = {STEADY_STATE, "target", "then_sharpen", "sharpen_time"}


def fields_of(mode: str, target: str) -> dict[str, Setting]:
    """Describe the fields that matter; when denoising, that depends on the target."""
    names = denoise_names(target) if mode == "denoise" else NAMES[mode]
    return {name: about for name, about in FIELDS[mode].items() if name in names}


def filter_names(mode: str) -> list[str]:
    """List the properties that say what is done, and not where it is read and written."""
    return [name for name in NAMES[mode] if name in FIELDS[mode] or name in _OTHERS]
