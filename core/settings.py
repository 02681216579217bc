# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of all filters, with ranges, units and descriptions.

This module is the one source of parameters: Python defaults, command-line flags and Blender
properties are made from these dataclasses. It imports neither numpy nor numba.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, get_type_hints

from .errors import InvalidSettings

INF = math.inf

MOST_STEPS = 100_000
"""Most unit steps of the schemes that compute the flow anew."""


@dataclass(frozen=True)
class Setting:
    """What a person needs to know about one field.

    Attributes
    ----------
    description : str
        One or more full sentences without the final period (Blender adds it); says what the
        neutral value is.
    unit : str
        Unit in words; empty for counts and choices.
    minimum, maximum : float
        Allowed range, both ends included.
    soft_minimum, soft_maximum : float
        Range in which values are useful; sliders end there.
    choices : dict
        For text fields: the allowed words, each with its description.
    advanced : bool
        True for fields that belong into a closed sub-panel.
    """

    description: str
    unit: str = ""
    minimum: float = -INF
    maximum: float = INF
    soft_minimum: float = -INF
    soft_maximum: float = INF
    choices: dict[str, str] = dataclasses.field(default_factory=dict)
    advanced: bool = False


def _setting(default: Any, description: str, **about: Any) -> Any:
    return dataclasses.field(
        default=default, metadata={"setting": Setting(description=description, **about)}
    )


def describe(settings: type) -> dict[str, tuple[type, Any, Setting]]:
    """List a settings class's fields as ``{name: (type, default, Setting)}``, in order."""
    types = get_type_hints(settings)
    return {
        f.name: (types[f.name], f.default, f.metadata["setting"])
        for f in dataclasses.fields(settings)
    }


@dataclass(frozen=True, kw_only=True)
class _Settings:
    def __post_init__(self) -> None:
        for name, (kind, _, about) in describe(type(self)).items():
            value = getattr(self, name)
            if kind is str:
                if not isinstance(value, str) or value not in about.choices:
                    words = ", ".join(about.choices)
                    raise InvalidSettings(f"{name} is {value!r}; choose one of: {words}.")
            else:
                object.__setattr__(self, name, _checked_number(name, value, kind, about))


def _checked_number(name: str, value: Any, kind: type, about: Setting) -> Any:
    if hasattr(value, "item") and getattr(value, "ndim", 1) == 0:
        value = value.item()  # a numpy scalar
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InvalidSettings(f"{name} is {value!r}; give a number.")
    try:
        float(value)
    except OverflowError:
        value = math.inf if value > 0 else -math.inf
    if kind is int and value != value // 1:
        raise InvalidSettings(f"{name} is {value!r}; give a whole number.")
    if not about.minimum <= value <= about.maximum:
        raise InvalidSettings(
            f"{name} is {value!r}; give a value from {about.minimum:g} to"
            f" {about.maximum:g}{' ' + about.unit if about.unit else ''}."
        )
    return kind(value)


@dataclass(frozen=True, kw_only=True)
class _FlowSettings(_Settings):
    """Settings of the flow: shared by signals and geometry (paper sections 3 and 4)."""

    time: float = _setting(
        256.0,
        "How long values flow towards the edges. 0 changes nothing; 16 is subtle, 256 pulls"
        " narrow edges together, 4096 wide ones; infinity is the steady state",
        unit="flow time in mean edge lengths",
        minimum=0.0,
        maximum=INF,
        soft_minimum=0.0,
        soft_maximum=4096.0,
    )
    smoothing_passes: int = _setting(
        1,
        "Smoothing passes on the flow, not on the result. 0 follows every wrinkle; more passes"
        " ignore noise and pull from farther away",
        unit="passes",
        minimum=0,
        maximum=1000,
        soft_maximum=16,
    )


@dataclass(frozen=True, kw_only=True)
class _SignalSettings(_FlowSettings):
    """Settings of the filters of signals: colors on meshes, in images and in textures."""

    channels: str = _setting(
        "coupled",
        "Which flow moves which channel",
        choices={
            "coupled": "All channels follow one flow, so that colors stay together",
            "independent": "Each channel follows its own flow, which can leave color fringes",
            "luminance": "All channels follow the flow of the brightness",
        },
        advanced=True,
    )
    sampling: str = _setting(
        "linear",
        "How values are read at the end of a flow-line",
        choices={
            "linear": "Interpolate between neighbours: removes fine noise",
            "nearest": "Take the nearest value: keeps noise, and edges harder",
        },
        advanced=True,
    )


@dataclass(frozen=True, kw_only=True)
class ShockSettings(_SignalSettings):
    """Settings of the filters of signals: vertex colors, corner colors, images (section 3)."""

    scheme: str = _setting(
        "fixed",
        "Whether the flow is computed anew while values move",
        choices={
            "fixed": "The flow of the input all the time: fast, and hardly to be told from"
            " composed",
            "composed": "Anew after each unit of time; flow-lines are joined, the input is read"
            " once. The time needed grows with the flow time",
            "naive": "Anew after each unit of time, each step reads the last result: slow, and"
            " blurs detail; for comparison",
        },
        advanced=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.scheme != "fixed" and self.time > MOST_STEPS:
            raise InvalidSettings(
                f"time is {self.time!r}, which the scheme {self.scheme!r} walks in steps of 1;"
                f" give at most {MOST_STEPS}, or use the scheme 'fixed'."
            )


def _alpha() -> Any:
    return _setting(
        "auto",
        "Whether the last channel is opacity. Opacity stays as it is, and transparent pixels"
        " lend no color to others",
        choices={
            "auto": "The last of two or four channels is opacity",
            "none": "No channel is opacity: all are filtered alike",
        },
        advanced=True,
    )


@dataclass(frozen=True, kw_only=True)
class ImageSettings(ShockSettings):
    """Settings of :func:`shock_filter.core.sharpen_image`."""

    time: float = _setting(
        16.0,
        "How long values flow towards the edges. 0 changes nothing; 16 is for photos that are"
        " sharp already, 256 and more for blurred ones; infinity is the steady state",
        unit="flow time in pixels",
        minimum=0.0,
        maximum=INF,
        soft_minimum=0.0,
        soft_maximum=4096.0,
    )
    alpha: str = _alpha()


@dataclass(frozen=True, kw_only=True)
class DilateSettings(_Settings):
    """Settings of :func:`shock_filter.core.dilate_texture`."""

    gutter: int = _setting(
        16,
        "How far around the charts texels are filled, with what lies across the seam. 0 fills"
        " only what linear sampling reads, one texel; smaller sizes of the texture read more",
        unit="texels",
        minimum=0,
        maximum=1024,
        soft_maximum=64,
    )
    background: str = _setting(
        "keep",
        "What happens to texels beyond the gutter",
        choices={
            "keep": "They stay as they are",
            "nearest": "They get the value of the nearest filled texel",
        },
        advanced=True,
    )


@dataclass(frozen=True, kw_only=True)
class TextureSettings(DilateSettings, _SignalSettings):
    """Settings of :func:`shock_filter.core.sharpen_texture`."""

    time: float = _setting(
        16.0,
        "How long values flow towards the edges. 0 changes nothing; 16 is for textures that are"
        " sharp already, 256 and more for blurred ones; infinity is the steady state",
        unit="flow time in mean texel sizes on the surface",
        minimum=0.0,
        maximum=INF,
        soft_minimum=0.0,
        soft_maximum=4096.0,
    )
    alpha: str = _alpha()
    content: str = _setting(
        "values",
        "What the texture holds",
        choices={
            "values": "Colors or other values that do not depend on the texture's layout",
            "normals": "Tangent-space normals, as colors: they are turned where values cross to"
            " a chart that lies turned, and made unit length again",
        },
        advanced=True,
    )


@dataclass(frozen=True, kw_only=True)
class FitSettings(_Settings):
    """Settings of the screened Poisson refit of positions to normals (paper 4.1)."""

    screening_radius: float = _setting(
        5.0,
        "How far the refit may move the surface as a whole. Small values keep positions and"
        " turn faces less; above 10 there is little to gain",
        unit="mean edge lengths",
        minimum=1e-3,
        maximum=1e6,
        soft_minimum=0.5,
        soft_maximum=30.0,
        advanced=True,
    )
    fidelity: float = _setting(
        0.0,
        "The paper's epsilon: weight of the old positions on the surface scaled to unit area."
        " 0 uses the screening radius instead",
        unit="per unit area",
        minimum=0.0,
        maximum=1e12,
        soft_maximum=1e6,
        advanced=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        default = describe(FitSettings)["screening_radius"][1]
        if self.fidelity > 0 and self.screening_radius != default:
            raise InvalidSettings(
                "fidelity and screening_radius are two ways to say the same: give only one."
            )


@dataclass(frozen=True, kw_only=True)
class GeometrySettings(FitSettings, _FlowSettings):
    """Settings of :func:`shock_filter.core.sharpen_geometry` (paper 4.1)."""

    mollify_passes: int = _setting(
        0,
        "Smoothing passes on the normals before anything else, for noisy scans. 0 keeps the"
        " normals as they are; 2 cleans light noise",
        unit="passes",
        minimum=0,
        maximum=1000,
        soft_maximum=16,
    )
    feature_threshold: float = _setting(
        1.1,
        "How many times more the surface must bend than around it to be sharpened there. 0"
        " sharpens everything, gently curved regions get facets; 1.5 and more keeps all but"
        " the sharpest creases",
        unit="times the surroundings",
        minimum=0.0,
        maximum=100.0,
        soft_maximum=2.0,
    )
    sampling: str = _setting(
        "detail",
        "How normals are read at the end of a flow-line",
        choices={
            "detail": "Add the change of the smoothed normal to each face's own normal: keeps"
            " fine relief; a short time changes little",
            "linear": "Take the smoothed normal there, as in the paper: removes fine noise and"
            " fine relief",
            "nearest": "Take the normal of the face there: keeps noise",
        },
        advanced=True,
    )
    repeat: int = _setting(
        1,
        "Apply the whole filter again on its own result. 1 is once",
        unit="times",
        minimum=1,
        maximum=100,
        soft_maximum=10,
        advanced=True,
    )
    max_displacement: float = _setting(
        0.0,
        "No vertex moves farther than this. 0 sets no limit",
        unit="mean edge lengths",
        minimum=0.0,
        maximum=1e6,
        soft_maximum=5.0,
        advanced=True,
    )
