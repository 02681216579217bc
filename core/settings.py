# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of all filters, with ranges, units and descriptions.

This module is the one source of parameters: Python defaults, command-line flags and Blender
properties are made from these dataclasses. It imports neither numpy nor numba. Annotations are not
postponed here, so that fields know their types.
"""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple, TypeVar, dataclass_transform

from .errors import InvalidSettings

INF = math.inf

MOST_STEPS = 100_000
"""Most unit steps of the schemes that compute the flow anew."""


class Setting(NamedTuple):
    """The description of one field.

    Attributes
    ----------
    description : str
        One or more sentences without the final period, which Blender adds; it names the neutral
        value.
    unit : str
        Unit in words; empty for counts and choices.
    minimum, maximum : float
        Allowed range, including both ends. By default, numbers are not negative.
    soft_minimum, soft_maximum : float
        Range in which values are useful; sliders end there.
    choices : mapping
        For text fields, the allowed words with their descriptions.
    advanced : bool
        Whether the field belongs into the closed sub-panel.
    length_power : int
        The power of length in the unit of a number.
    counts_in : str
        The unit of that length: mean ``"edges"``, ``"texels"`` or ``"pixels"``. Previews with
        shorter edges or larger texels convert the number. Empty for other lengths.
    label : str
        Label on screen, if the field's name is too long or too technical; at most 14 letters,
        which fit into Blender's sidebar.
    role : str
        The meaning of the value for programs: ``"time"``, ``"width"`` (of the borders to close; 0
        measures it), ``"edges"`` (what keeps edges; less than 0 measures the noise), ``"gain"``,
        ``"opacity"``, ``"content"``, ``"enlargement"`` or ``"repeats"``. See `named` and
        `value_of`.
    of_data : bool
        Whether it describes the data, so that a filter that follows in the same run has the same
        value.
    rehearsed : tuple
        Further values with compiled code of their own, besides the default and all choices.
    brief : number or None
        A value with which the filter is fast and compiles the same code.
    tried_at_most : float
        The largest value in previews, which must be fast.
    auto : float or None
        The value that leaves it to the filter, or does nothing; None if there is none.
    auto_label, auto_description : str
        What that value is called on screen, and what it does.
    usual : float
        Where there is one: a value to start from without it.
    """

    description: str
    unit: str = ""
    minimum: float = 0
    maximum: float = INF
    soft_minimum: float = -INF
    soft_maximum: float = INF
    choices: Mapping[str, str] = {}
    advanced: bool = False
    length_power: int = 0
    counts_in: str = ""
    label: str = ""
    role: str = ""
    of_data: bool = False
    rehearsed: tuple[Any, ...] = ()
    brief: Any = None
    tried_at_most: float = INF
    auto: float | None = None
    auto_label: str = "Auto"
    auto_description: str = "Leave it to the filter"
    usual: float = 0.0


def _setting(default: Any, description: str, **about: Any) -> Any:
    return dataclasses.field(
        default=default, metadata={"setting": Setting(description=description, **about)}
    )


def _changed(settings: type, name: str, default: Any, description: str = "", **about: Any) -> Any:
    """Declare a field of another class again, with another default and the given changes."""
    known = describe(settings)[name][2]
    known = known._replace(description=description or known.description, **about)
    return dataclasses.field(default=default, metadata={"setting": known})


_described: dict[type, dict[str, tuple[Any, Any, Setting]]] = {}


def describe(settings: type) -> dict[str, tuple[Any, Any, Setting]]:
    """List a settings class's fields as ``{name: (type, default, Setting)}``, in order."""
    if settings not in _described:
        _described[settings] = {
            f.name: (f.type, f.default, f.metadata["setting"]) for f in dataclasses.fields(settings)
        }
    return _described[settings]


def named(settings: type, role: str) -> str:
    """Name the field that has a role (see `Setting`); empty if the class has none."""
    return next(
        (name for name, (_, _, about) in describe(settings).items() if about.role == role), ""
    )


def value_of(settings: Any, role: str, default: Any = None) -> Any:
    """Return the value of the field that has a role, or the default if there is none."""
    name = named(type(settings), role)
    return getattr(settings, name) if name else default


_Class = TypeVar("_Class", bound=type)


@dataclass_transform(kw_only_default=True, eq_default=False)
def _fields(settings: _Class) -> _Class:
    # What `dataclass` would make for each class alike stands in `_Settings` once, since making the
    # classes is the longest part of enabling the extension.
    dataclass(kw_only=True, init=False, repr=False, eq=False)(settings)  # changes it in place
    return settings


class _Signature:
    # Tells `help` and editors at run time what `__init__` takes.
    def __get__(self, _: Any, settings: type) -> Any:
        from inspect import Parameter, Signature

        given = [
            Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=kind)
            for name, (kind, default, _) in describe(settings).items()
        ]
        return Signature(given)


class _Settings:
    __signature__ = _Signature()

    def __init__(self, **values: Any) -> None:
        for name, (_, default, _) in describe(type(self)).items():
            setattr(self, name, values.pop(name, default))
        for name in values:
            instead = removed_of(type(self)).get(name)
            if instead:
                raise InvalidSettings(f"{name} is no setting any more: {instead}")
            raise TypeError(f"{type(self).__name__} has no setting {name!r}")

    def changed(self, **values: Any) -> Any:
        """Return a copy with other values."""
        return dataclasses.replace(self, **values)  # type: ignore[type-var]

    @property
    def kernel(self) -> Any:
        """The settings of the filter itself; see `host.inputs.Denoising`."""
        return self

    @property
    def sharpen_time(self) -> float | None:
        """The time of a sharpening that follows in the same run, or None."""
        return None

    @property
    def by_width(self) -> bool:
        """Whether the flow time follows from the width of borders."""
        return False

    @property
    def by_noise(self) -> bool:
        """Whether what keeps edges follows from the noise of an image."""
        return False

    @property
    def reach(self) -> float:
        """Number of pixels read for each pixel, if the time depends on it; otherwise 0."""
        return 0.0

    def __setattr__(self, name: str, value: Any) -> None:
        # Each field is set once, when the object is made.
        fields = describe(type(self))
        if name in vars(self) or name not in fields:
            raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")
        kind, _, about = fields[name]
        checked = _word(name, value, about) if kind is str else _number(name, value, about, kind)
        vars(self)[name] = checked

    def __delattr__(self, name: str) -> None:
        raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={value!r}" for name, value in vars(self).items())
        return f"{type(self).__name__}({values})"

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and vars(self) == vars(other)

    def __hash__(self) -> int:
        return hash((type(self), *vars(self).values()))


_REMOVED: dict[str, dict[str, str]] = {
    "ShockSettings": {
        "scheme": "the flow is that of the input all the time, as 'fixed' said; leave it out.",
    },
    "FitSettings": {
        "fidelity": "give screening_radius, which is the root of the surface's area over the"
        " fidelity, divided by the mean edge length.",
    },
    "BeltramiMeshSettings": {
        "distance": "it runs along the surface of the values, as 'geodesic' said; leave it out.",
        "threshold": "weights below 0.01 of the largest one count as nothing; leave it out.",
    },
    "BeltramiSettings": {
        "measure": "pixels count by their area in space, as 'space' said; leave it out.",
        "window": "the time alone says how far the kernel reaches; lower that, or leave it out.",
    },
    "DyeSettings": {
        "sharpening": "dye is sharpened as 'shock' said; leave it out.",
        "integration": "steps take the velocity halfway, as 'midpoint' said; leave it out.",
    },
}
"""Replacements for settings of earlier versions, by class and name."""


def removed_of(settings: type) -> dict[str, str]:
    """Return the former settings of a class, with their replacements."""
    tables = [_REMOVED.get(kind.__name__, {}) for kind in settings.__mro__]
    return {name: text for table in tables for name, text in table.items()}


_Given = TypeVar("_Given", bound=_Settings)


def given_or_default(settings: _Given | None, kind: type[_Given]) -> _Given:
    """Return the settings, or the defaults of a class for None.

    Raises
    ------
    InvalidSettings
        If they are no settings, or lack some of that class.
    """
    if settings is None:
        return kind()
    if not isinstance(settings, _Settings) or describe(kind).keys() - vars(settings).keys():
        raise InvalidSettings(
            f"settings is of type {type(settings).__name__}; give {kind.__name__}, or leave it out,"
            " and give all else by keyword."
        )
    return settings


def _word(name: str, value: Any, about: Setting) -> str:
    if not isinstance(value, str) or value not in about.choices:
        words = ", ".join(about.choices)
        raise InvalidSettings(f"{name} is {value!r}; choose one of: {words}.")
    return value


def _number(name: str, value: Any, about: Setting, kind: type) -> Any:
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
        least, most = (f"{end:.0f}" if kind is int else f"{end:g}"
                       for end in (about.minimum, about.maximum))  # fmt: skip
        raise InvalidSettings(
            f"{name} is {value!r}; give a value from {least} to"
            f" {most}{' ' + about.unit if about.unit else ''}."
        )
    return kind(value)


@_fields
class _FlowSettings(_Settings):
    """Settings of the flow (paper sections 3 and 4)."""

    time: float = _setting(
        256.0,
        "How long values flow towards the edges. 0 changes nothing; 16 is subtle, 256 closes"
        " narrow edges, 4096 wide ones; infinity is the steady state",
        unit="flow time in mean edge lengths",
        soft_maximum=4096.0,
        length_power=4,  # P falls with the square of the lengths, and the flow is its gradient
        counts_in="edges",
        role="time",
    )
    smoothing_passes: int = _setting(
        1,
        "Smoothing passes on the flow, not on the result. 0 follows every wrinkle; 16 ignores"
        " noise, pulls from farther away and sees only broad edges",
        unit="passes",
        maximum=1000,
        soft_maximum=16,
        label="Smoothing",
    )


BY_WIDTH = -1.0
"""The default time of signals: the flow time at each place follows from the width."""

WIDTH_OF_SIGMA = 2.5631
"""Width, from 10 to 90 percent, of a border that a Gaussian of sigma 1 has blurred."""

_DRAWING = "Flat areas with clean borders, such as masks, cel shading, logos and painted color"
_PHOTO = "Detail and grain count as much as borders: half as strong, and detail is raised, too"
_AUTO = "Measure whether the picture is a drawing or a photo"
_BY_PIXELS = (
    "Decide for each pixel with trained networks; with a guide or normals, measure whether the"
    " picture is a drawing or a photo"
)
_BY_VERTICES = (
    "Decide for each vertex with trained networks: detail and borders become sharper, and noise"
    " is removed"
)


def _what(default: str, *choices: str, auto: str = _AUTO) -> Any:
    about = {"auto": auto, "drawing": _DRAWING, "photo": _PHOTO}
    return _setting(
        default,
        "What kind of picture is sharpened, which determines how strongly",
        choices={word: about[word] for word in choices or about},
    )


def _amount() -> Any:
    return _setting(
        1.0,
        "How much of the change is applied. 0 changes nothing, 1 applies all of it",
        unit="of the change",
        maximum=1.0,
        soft_maximum=1.0,
    )


@_fields
class ShockSettings(_Settings):
    """Settings of the filters of signals: colors on meshes, in images and in textures (section 3).

    What and Width determine the flow time at each place from the local contrast, and Amount is the
    share of the change in the result. A time of 0 or more overrides What and Width; it is the time
    of the paper, which is the same everywhere. Its default, `BY_WIDTH`, is negative.
    """

    what: str = _what("auto", auto=_BY_VERTICES)
    width: float = _setting(
        0.0,
        "The widest borders that are closed, where the width is that from 10 to 90 percent of"
        " the contrast; wider ones stay soft. 0 measures it; 2 is for borders that are nearly"
        " sharp, 10 for very soft ones",
        unit="mean edge lengths",
        maximum=64.0,
        soft_maximum=16.0,
        length_power=1,
        counts_in="edges",
        role="width",
        auto=0.0,
        usual=4.0,
    )
    amount: float = _amount()
    time: float = _changed(
        _FlowSettings,
        "time",
        BY_WIDTH,
        "How long values flow towards the edges, the same everywhere, instead of What and Width."
        " -1 uses these; 0 changes nothing, 16 is subtle, 256 closes narrow edges, 4096 wide"
        " ones; infinity is the steady state",
        minimum=BY_WIDTH,
        advanced=True,
        auto=BY_WIDTH,
        usual=256.0,
    )
    smoothing_passes: int = _changed(_FlowSettings, "smoothing_passes", 1, advanced=True)
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
            "linear": "Interpolate between neighbors: removes fine noise",
            "nearest": "Take the nearest value: keeps noise, and makes edges harder",
        },
        advanced=True,
    )

    @property
    def by_width(self) -> bool:
        """Whether What and Width are used, and not the time."""
        return self.time < 0

    @property
    def is_neutral(self) -> bool:
        """Whether nothing changes."""
        return self.time == 0 or self.amount == 0


def _alpha(sharpened: bool = False) -> Any:
    stays = " Opacity does not change,"
    by_itself = " Opacity is sharpened separately unless a time or a guide is given,"
    return _setting(
        "auto",
        "Whether the last channel is opacity."
        f"{by_itself if sharpened else stays} and colors of transparent pixels do not"
        " affect others",
        choices={
            "auto": "The last of two or four channels is opacity",
            "none": "No channel is opacity: all are filtered equally",
        },
        advanced=True,
        role="opacity",
        of_data=True,
    )


@_fields
class ImageSettings(ShockSettings):
    """Settings of :func:`shock_filter.core.sharpen_image`."""

    time: float = _changed(
        ShockSettings, "time", BY_WIDTH, unit="flow time in pixels", counts_in="pixels"
    )
    what: str = _what("auto", auto=_BY_PIXELS)
    width: float = _changed(ShockSettings, "width", 0.0, unit="pixels", counts_in="pixels")
    enlarge: int = _setting(
        1,
        "How many times higher and wider the result is. 1 keeps the size; with What: Auto, 2, 3,"
        " 4, 6 and 8 use trained networks",
        unit="times",
        minimum=1,
        maximum=8,
        soft_maximum=4,
        role="enlargement",
        rehearsed=(2,),
    )
    alpha: str = _alpha(sharpened=True)


@_fields
class DilateSettings(_Settings):
    """Settings of :func:`shock_filter.core.dilate_texture`."""

    gutter: int = _setting(
        16,
        "How far around the UV islands texels are filled, with colors from across the seam. 0"
        " fills only the one texel that linear sampling reads; 64 is enough for six mipmap"
        " levels",
        unit="texels",
        maximum=1024,
        soft_maximum=64,
        advanced=True,
        of_data=True,
    )
    background: str = _setting(
        "keep",
        "What happens to texels beyond the gutter",
        choices={
            "keep": "They stay as they are",
            "nearest": "They get the value of the nearest filled texel",
        },
        advanced=True,
        of_data=True,
    )
    seams: str = _setting(
        "auto",
        "What texels at a seam find beyond it",
        choices={
            "auto": "Compare both sides all along each seam: continue where they agree, extend"
            " where different materials meet",
            "continue": "The colors across the seam, whatever they are",
            "extend": "A continuation of their own colors: no color crosses a seam",
        },
        advanced=True,
        of_data=True,
    )


def _content() -> Any:
    return _setting(
        "values",
        "What the texture holds",
        choices={
            "values": "Colors or other values that do not depend on the texture's layout",
            "normals": "Tangent-space normals, as colors: they are rotated where they cross to a"
            " UV island of another orientation, and normalized",
        },
        advanced=True,
        role="content",
        of_data=True,
    )


def _content_of_vectors() -> Any:
    return _setting(
        "values",
        "What the texture holds. Normals are filtered as vectors in object space, whatever the"
        " orientation of the UV islands, and normalized",
        choices={
            "values": "Colors or other values that do not depend on the texture's layout",
            "normals": "Tangent-space normals, as colors; green points up, as in Blender",
            "normals_y_down": "Tangent-space normals whose green points down, as in DirectX",
            "object_normals": "Object-space normals, as colors",
        },
        advanced=True,
        role="content",
        of_data=True,
    )


@_fields
class TextureSettings(DilateSettings, ShockSettings):
    """Settings of :func:`shock_filter.core.sharpen_texture`."""

    time: float = _changed(
        ShockSettings,
        "time",
        BY_WIDTH,
        unit="flow time in mean texel sizes on the surface",
        counts_in="texels",
    )
    what: str = _what("auto", auto=_BY_PIXELS)
    width: float = _changed(
        ShockSettings, "width", 0.0, unit="mean texel sizes on the surface", counts_in="texels"
    )
    alpha: str = _alpha(sharpened=True)
    content: str = _content()


@_fields
class FilterSettings(DilateSettings):
    """Settings of :func:`shock_filter.core.filter_texture`."""

    gain: float = _setting(
        2.0,
        "How strong detail becomes. 0 smooths it away, 1 returns the input, 2 doubles it",
        unit="times the gradients",
        maximum=10.0,
        soft_maximum=4.0,
        role="gain",
    )
    radius: float = _setting(
        30.0,
        "Structures up to about this many texels wide count as detail; larger ones do not"
        " change. 2 affects only fine grain, 200 nearly all of a texture",
        unit="mean texel sizes on the surface",
        minimum=0.1,
        maximum=1e5,
        soft_minimum=2.0,
        soft_maximum=200.0,
        length_power=1,
        counts_in="texels",
    )
    alpha: str = _alpha()
    content: str = _content_of_vectors()

    @property
    def is_neutral(self) -> bool:
        """Whether nothing changes, unless gains are painted."""
        return self.gain == 1


@_fields
class StitchSettings(DilateSettings):
    """Settings of :func:`shock_filter.core.stitch_textures`."""

    radius: float = _changed(
        FilterSettings,
        "radius",
        100.0,
        "How far a step between two images is spread out. 10 keeps the values farther away as they"
        " are, 1000 brings whole charts to one brightness",
        soft_minimum=10.0,
        soft_maximum=1000.0,
    )
    where: str = _setting(
        "everywhere",
        "Which texels change",
        choices={
            "everywhere": "All texels, so that steps vanish completely",
            "seams": "Only those at seams: both sides match there, and all others stay",
        },
    )
    even_out: str = _setting(
        "auto",
        "How different charts or pictures are matched",
        choices={
            "auto": "By factors or by differences, whichever explains both sides of the seams"
            " better",
            "brightness": "By factors, as exposure and white balance act: black stays black."
            " Values below 0, and normals, use differences",
            "difference": "By differences, as in the paper",
        },
    )
    seams: str = _changed(
        DilateSettings,
        "seams",
        "auto",
        "Which steps at seams go",
        choices={
            "auto": "Those between sides whose detail matches, or that have none: steps between"
            " different materials stay",
            "continue": "All of them",
            "extend": "None: only pictures are joined",
        },
    )
    alpha: str = _alpha()
    content: str = _content_of_vectors()


@_fields
class FillSettings(DilateSettings):
    """Settings of :func:`shock_filter.core.fill_texture`."""

    find: str = _setting(
        "auto",
        "Which texels are filled",
        choices={
            "auto": "Those of the mask; without one, the transparent ones; without these, the"
            " unseen ones",
            "opacity": "Those that are fully transparent, in the mask if there is one",
            "unseen": "Faces that are completely black, as where no photo saw the surface, in"
            " the mask if there is one",
        },
    )
    surface: str = _setting(
        "membrane",
        "How colors continue into filled texels",
        choices={
            "membrane": "Like a soap film: between the colors around, without new extremes",
            "thin_plate": "Like a bent plate: slopes continue, too, and it takes longer",
        },
    )
    grain: float = _setting(
        0.0,
        "How much fine grain, like that around them, filled texels get. 0 leaves them smooth",
        unit="of that around",
        maximum=2.0,
        soft_maximum=1.0,
    )
    seams: str = _changed(DilateSettings, "seams", "continue")
    alpha: str = _alpha()
    content: str = _content_of_vectors()


@_fields
class EnlargeSettings(DilateSettings):
    """Settings of :func:`shock_filter.core.enlarge_texture`."""

    factor: int = _setting(
        2,
        "How many times higher and wider the texture becomes. 1 only fills the gutter; 2, 3, 4,"
        " 6 and 8 use trained networks",
        unit="times",
        minimum=1,
        maximum=8,
        soft_maximum=4,
        role="enlargement",
    )
    alpha: str = _alpha()
    content: str = _content()


@_fields
class RepairSettings(DilateSettings):
    """Settings of :func:`shock_filter.core.repair_texture`."""

    enlarge: int = _setting(
        1,
        "How many times higher and wider the texture becomes. 1 keeps the size",
        unit="times",
        minimum=1,
        maximum=8,
        soft_maximum=4,
        role="enlargement",
    )
    sharpen: float = _setting(
        1.0,
        "How much blurred borders are sharpened. 0 leaves them",
        unit="of the change",
        maximum=1.0,
        soft_maximum=1.0,
    )
    denoise: float = _setting(
        1.0,
        "How much of the measured noise is removed. 0 leaves it",
        unit="of the change",
        maximum=1.0,
        soft_maximum=1.0,
    )
    blocks: float = _setting(
        1.0,
        "How strongly blocks of JPEG compression are smoothed, as a factor of the rounding that"
        " was found. 0 leaves them",
        unit="times",
        maximum=4.0,
        soft_maximum=2.0,
    )
    fill: str = _setting(
        "auto",
        "Which texels are filled from their surroundings on the surface",
        choices={
            "auto": "Transparent texels; without these, faces that are completely black",
            "opacity": "Transparent texels",
            "unseen": "Faces that are completely black, as where no photo saw the surface",
            "nothing": "Nothing",
        },
    )
    stitch: str = _setting(
        "seams",
        "Which texels change so that both sides of each seam match",
        choices={
            "everywhere": "All texels, so that charts of different brightness or color match",
            "seams": "Those at seams alone",
            "nothing": "None",
        },
    )
    alpha: str = _alpha()
    content: str = _content()


@_fields
class ModelSettings(RepairSettings):
    """Settings of ``shock-filter repair-model``."""

    geometry: str = _setting(
        "keep",
        "What becomes of the shape",
        choices={
            "keep": "It stays",
            "denoise": "Noise goes; creases stay",
            "creases": "Rounded creases become sharp",
            "both": "First one, then the other",
        },
    )


@_fields
class TileSettings(_Settings):
    """Settings of :func:`shock_filter.core.make_tileable`."""

    axes: str = _setting(
        "both",
        "Which sides meet",
        choices={
            "both": "Left and right, top and bottom",
            "x": "Left and right",
            "y": "Top and bottom",
        },
    )
    radius: float = _setting(
        0.25,
        "How far steps between the sides are spread out. 0.05 keeps colors farther inside, 1"
        " spreads them over the whole picture",
        unit="of the shorter side",
        minimum=0.001,
        maximum=100.0,
        soft_minimum=0.02,
        soft_maximum=1.0,
    )
    even_light: float = _setting(
        0.0,
        "How much of the large-scale variation of brightness is removed, since it would show in"
        " each repetition. 0 keeps it, 1 removes all",
        unit="of the light",
        maximum=1.0,
        soft_maximum=1.0,
    )


@_fields
class BlockSettings(_Settings):
    """Settings of :func:`shock_filter.core.remove_blocks`."""

    strength: float = _setting(
        1.0,
        "How strongly blocks are smoothed, as a factor of the rounding that was found. 0 changes"
        " nothing",
        unit="times",
        maximum=4.0,
        soft_maximum=2.0,
    )


@_fields
class DistanceSettings(_Settings):
    """Settings of :func:`shock_filter.core.geodesic_distance`."""

    source: str = _setting(
        "given",
        "From where distance counts",
        choices={
            "given": "The given sources: vertices, points, edges, or painted areas",
            "border": "Where the mesh ends, too",
            "seams": "All borders of the charts: seams and borders of the mesh",
        },
    )
    look: str = _setting(
        "distance",
        "What the values are",
        choices={
            "distance": "The distance itself, in units of the mesh; infinite on parts that are"
            " not connected",
            "gradient": "1 at the source, falling to 0 at the width",
            "lines": "Soft lines of equal distance, each a width farther away",
        },
    )
    width: float = _setting(
        0.0,
        "Where a gradient ends, or the spacing of lines. 0 is automatic: the largest distance"
        " for a gradient, a width that fits the model if it starts at edges, and a tenth of the"
        " largest for lines",
        unit="units of the mesh",
        soft_maximum=10.0,
        length_power=1,
        role="width",
        auto=0.0,
        usual=1.0,
    )
    smoothing: float = _setting(
        0.0,
        "How far the ridges are rounded where paths from two sides meet. 0 keeps them sharp",
        unit="mean texel sizes on the surface",
        maximum=1e4,
        soft_maximum=100.0,
        advanced=True,
        length_power=1,
        counts_in="texels",
    )
    gutter: int = _changed(DilateSettings, "gutter", 16)


@_fields
class CurvatureSettings(_Settings):
    """Settings of :func:`shock_filter.core.curvature_map`."""

    kind: str = _setting(
        "mean",
        "Which curvature",
        choices={
            "mean": "The mean of both principal curvatures: edges and bumps positive, valleys"
            " and dents negative",
            "gaussian": "The product of both principal curvatures: 0 on developable surfaces,"
            " negative on saddles",
            "convex": "Only edges and bumps: the greater curvature, 0 where it is negative",
            "cavity": "Only valleys and dents: minus the lesser curvature, 0 where that is"
            " positive",
        },
    )
    look: str = _setting(
        "curvature",
        "What the values are",
        choices={
            "curvature": "The curvature itself, in 1 / unit of the mesh; convex is positive",
            "gray": "Flat is middle gray, convex light, concave dark; Convex and Cavity go from"
            " black to white",
        },
    )
    white: float = _setting(
        0.0,
        "The curvature that is white. 0 uses the one that 2 percent of the texels exceed",
        unit="1 / unit of the mesh",
        soft_maximum=100.0,
        auto=0.0,
        usual=1.0,
    )
    radius: float = _setting(
        0.0,
        "Radius of the surface fit around each vertex. A larger one smooths noise. 0 uses 2.5"
        " edge lengths",
        unit="units of the mesh",
        soft_maximum=1.0,
        length_power=1,
        auto=0.0,
        usual=0.1,
    )
    gutter: int = _changed(DilateSettings, "gutter", 16)


@_fields
class OcclusionSettings(_Settings):
    """Settings of :func:`shock_filter.core.ambient_occlusion` and `bent_normals`."""

    rays: int = _setting(
        64,
        "Number of rays per texel. 16 is fast, 1024 accurate; powers of 2 are distributed most"
        " evenly",
        unit="rays",
        minimum=2,
        maximum=65536,
        soft_minimum=16,
        soft_maximum=1024,
        brief=8,
        tried_at_most=32,
    )
    distance: float = _setting(
        0.0,
        "Largest distance at which surfaces occlude. 0 sets no limit",
        unit="units of the mesh",
        soft_maximum=10.0,
        length_power=1,
        auto=0.0,
        usual=1.0,
    )
    ground: str = _setting(
        "none",
        "Whether there is a floor",
        choices={
            "none": "No floor",
            "below": "An infinite floor at the lowest point, perpendicular to the Z axis",
        },
    )
    smoothing: float = _setting(
        4.0,
        "Largest distance over which the noise of the rays is smoothed along the surface. 0"
        " leaves it",
        unit="mean texel sizes on the surface",
        maximum=1e3,
        soft_maximum=32.0,
        advanced=True,
        length_power=1,
        counts_in="texels",
    )
    gutter: int = _changed(DilateSettings, "gutter", 16)


@_fields
class ThicknessSettings(_Settings):
    """Settings of :func:`shock_filter.core.thickness`."""

    look: str = _setting(
        "thickness",
        "What the values are",
        choices={
            "thickness": "The thickness itself, in units of the mesh",
            "gray": "Black where it is thin, white where it is thick",
        },
    )
    white: float = _setting(
        0.0,
        "The thickness that is white. 0 uses the largest",
        unit="units of the mesh",
        soft_maximum=10.0,
        length_power=1,
        auto=0.0,
        usual=1.0,
    )
    rays: int = _changed(OcclusionSettings, "rays", 64)
    distance: float = _changed(
        OcclusionSettings,
        "distance",
        0.0,
        "The largest thickness that is measured. 0 has no limit",
    )
    smoothing: float = _changed(OcclusionSettings, "smoothing", 4.0)
    gutter: int = _changed(DilateSettings, "gutter", 16)


@_fields
class WearSettings(_Settings):
    """Settings of :func:`shock_filter.core.wear`."""

    kind: str = _setting(
        "edges",
        "Kind of wear on the surface",
        choices={
            "edges": "Worn convex edges: more where they are sharper and exposed",
            "dirt": "Corners and cavities, where dirt collects",
            "dust": "Surfaces that face up, along the Z axis, below the open sky",
        },
    )
    width: float = _setting(
        0.0,
        "How far from an edge wear reaches, how wide the cavities of dirt are, or up to which"
        " height surfaces shelter from dust. 0 is automatic: 4 or 10 percent of the size, and no"
        " limit for dust",
        unit="units of the mesh",
        soft_maximum=1.0,
        length_power=1,
        role="width",
        auto=0.0,
        usual=0.1,
    )
    amount: float = _setting(
        1.0,
        "Amount of wear, dirt or dust. 0 is black",
        unit="times",
        maximum=100.0,
        soft_maximum=4.0,
    )
    breakup: float = _setting(
        0.6,
        "How much noise breaks it up. 0 leaves it even",
        unit="times the range",
        maximum=1.0,
    )
    grain: float = _setting(
        0.0,
        "Size of the largest spots of the noise. 0 uses 3 percent of the size",
        unit="units of the mesh",
        soft_maximum=1.0,
        length_power=1,
        advanced=True,
        auto=0.0,
        usual=0.1,
    )
    seed: int = _setting(
        0,
        "Another number gives different noise",
        maximum=2**31 - 1,
        advanced=True,
    )
    rays: int = _changed(OcclusionSettings, "rays", 64)
    smoothing: float = _changed(OcclusionSettings, "smoothing", 4.0)
    gutter: int = _changed(DilateSettings, "gutter", 16)


@_fields
class BakeSettings(_Settings):
    """Settings of :func:`shock_filter.core.bake_maps`."""

    look: str = _setting(
        "values",
        "What the values of curvature, thickness and displacement are",
        choices={
            "values": "The values themselves, in units of the mesh",
            "gray": "From black to white; flat, and no displacement, is middle gray",
        },
    )
    cage: float = _setting(
        0.0,
        "How far from the simple mesh the detailed one is looked for. 0 takes 5 percent of the"
        " size",
        unit="units of the mesh",
        soft_maximum=1.0,
        length_power=1,
        auto=0.0,
        usual=0.1,
    )
    rays: int = _changed(OcclusionSettings, "rays", 64)
    distance: float = _changed(OcclusionSettings, "distance", 0.0)
    ground: str = _changed(OcclusionSettings, "ground", "none")
    smoothing: float = _changed(OcclusionSettings, "smoothing", 4.0)
    gutter: int = _changed(DilateSettings, "gutter", 16)


@_fields
class StreakSettings(_Settings):
    """Settings of :func:`shock_filter.core.surface_line_convolution`."""

    length: float = _setting(
        24.0,
        "How long streaks are. 3 gives grains, 100 long hair",
        unit="mean texel sizes on the surface",
        minimum=1.0,
        maximum=1e4,
        soft_maximum=200.0,
        length_power=1,
        counts_in="texels",
    )
    width: float = _setting(
        2.0,
        "How wide streaks are. Streaks as wide as they are long are grains",
        unit="mean texel sizes on the surface",
        maximum=1e4,
        soft_maximum=20.0,
        length_power=1,
        counts_in="texels",
    )
    contrast: float = _setting(
        1.0,
        "How far values deviate from middle gray. 0 is gray everywhere, 1 fills the range, more"
        " clips",
        unit="times the range",
        maximum=100.0,
        soft_maximum=3.0,
    )
    seed: int = _setting(
        0,
        "Another number gives different streaks of the same kind",
        maximum=2**31 - 1,
        soft_maximum=100,
    )
    gutter: int = _changed(DilateSettings, "gutter", 16)


@_fields
class ReactionSettings(_Settings):
    """Settings of :func:`shock_filter.core.reaction_diffusion`."""

    steps: int = _setting(
        1000,
        "How long the pattern grows. 0 returns the initial spots; about 500 cover the surface,"
        " 2000 make the pattern regular",
        unit="steps",
        maximum=MOST_STEPS,
        soft_maximum=10_000,
        brief=4,
        tried_at_most=500,  # that covers the surface
    )
    feed: float = _setting(
        0.037,
        "How fast the first substance is fed in. 0 feeds none, and all patterns fade",
        unit="a step",
        maximum=0.2,
        soft_maximum=0.1,
    )
    kill: float = _setting(
        0.06,
        "How fast the second substance is removed. More turns stripes into spots, then removes"
        " them",
        unit="a step",
        maximum=0.2,
        soft_minimum=0.03,
        soft_maximum=0.07,
    )
    scale: float = _setting(
        12.0,
        "Distance from one stripe or spot to the next",
        unit="mean texel sizes on the surface",
        minimum=6.0,
        maximum=1e4,
        soft_maximum=100.0,
        length_power=1,
        counts_in="texels",
        rehearsed=(60.0,),
    )
    stretch: float = _setting(
        2.0,
        "How much longer the pattern is along the given directions than across. 1 ignores the"
        " directions",
        unit="times",
        minimum=1.0,
        maximum=8.0,
    )
    seed: int = _changed(
        StreakSettings, "seed", 0, "Another number gives a different pattern of the same kind"
    )
    gutter: int = _changed(DilateSettings, "gutter", 16)


def _step() -> Any:
    return _setting(
        2.0,
        "How far the fastest places move per frame; all others move in proportion. 0 uses"
        " velocities as they are, in pixels per frame",
        unit="pixels",
        maximum=1000.0,
        soft_maximum=10.0,
        label="Speed",
    )


def _periodic() -> Any:
    return _setting(
        "none",
        "Which sides of the image are joined: what flows out on one comes in on the other",
        choices={
            "none": "No sides",
            "x": "Left and right",
            "y": "Top and bottom",
            "both": "Left and right, top and bottom",
        },
        advanced=True,
    )


def _loop(advanced: bool = False) -> Any:
    return _setting(
        0,
        "Over how many frames the end blends into the start, so that the frames repeat without a"
        " jump. 0 does not repeat",
        unit="frames",
        maximum=10_000,
        soft_maximum=100,
        advanced=advanced,
        rehearsed=(2,),
    )


@_fields
class NoiseSettings(_Settings):
    """Settings of :func:`shock_filter.core.advect_noise`."""

    draws: ClassVar[Literal["noise"]] = "noise"

    step: float = _step()
    blending: float = _setting(
        0.1,
        "How much of each frame is new; the rest comes from the frames before. 0.05 draws long"
        " streaks, 0.2 short ones; 1 shows the plain noise",
        unit="of a frame",
        minimum=0.005,
        maximum=1.0,
        soft_minimum=0.03,
        soft_maximum=0.5,
    )
    convolution: int = _setting(
        0,
        "How far each frame is smoothed along the flow, which removes jagged edges of fast"
        " streaks. 0 does not smooth; about the Speed is enough",
        unit="pixels",
        maximum=100,
        soft_maximum=20,
        advanced=True,
        rehearsed=(4,),
    )
    contrast: float = _changed(StreakSettings, "contrast", 1.0, advanced=True)
    speed_mask: float = _setting(
        0.0,
        "How much fast places stand out: the background shows through slow ones. 0 shows all"
        " equally; 1 makes the opacity equal to the speed, 3 hides only the slowest",
        unit="exponent",
        maximum=100.0,
        soft_maximum=6.0,
        advanced=True,
    )
    noise_mask: float = _setting(
        0.0,
        "How much bright streaks stand out: the background shows through dark ones. 0 shows all"
        " equally; 1 makes the opacity equal to the brightness, 3 hides only the darkest",
        unit="exponent",
        maximum=100.0,
        soft_maximum=6.0,
        advanced=True,
    )
    injection: float = _setting(
        0.025,
        "How many cells change at random in each frame, so that the noise stays fine. 0 changes"
        " none, and the grains grow; more than 0.05 makes it flicker",
        unit="of the cells",
        maximum=0.5,
        soft_maximum=0.1,
        advanced=True,
    )
    divergence: float = _setting(
        1.0,
        "How many more cells change where the flow diverges, which stretches grains. 0 adds"
        " none, 1 as many as are missing there",
        unit="times those missing",
        maximum=100.0,
        soft_maximum=3.0,
        advanced=True,
    )
    periodic: str = _periodic()
    loop: int = _loop(advanced=True)
    seed: int = _changed(
        StreakSettings, "seed", 0, "Another number gives different noise", advanced=True
    )


@_fields
class DyeSettings(_Settings):
    """Settings of :func:`shock_filter.core.advect_dye`."""

    draws: ClassVar[Literal["dye"]] = "dye"

    step: float = _step()
    sharpness: float = _setting(
        0.2,
        "How sharp the dye stays. 0 leaves it as it blurs, like smoke; 1 makes its borders hard,"
        " and jagged",
        unit="of a full step",
        maximum=1.0,
        soft_maximum=1.0,
    )
    periodic: str = _periodic()
    loop: int = _loop()


@_fields
class ConvolutionSettings(_Settings):
    """Settings of :func:`shock_filter.core.line_integral_convolution`."""

    draws: ClassVar[Literal["lines"]] = "lines"

    length: float = _setting(
        20.0,
        "How long streaks are. 0 returns the noise",
        unit="pixels",
        maximum=1000.0,
        soft_maximum=200.0,
    )
    contrast: float = _changed(
        StreakSettings,
        "contrast",
        1.0,
        "How far values deviate from their mean. 0 leaves averages as they are, 1 fills the"
        " range, more clips",
    )
    periodic: str = _periodic()
    seed: int = _changed(StreakSettings, "seed", 0, "Another number gives different noise")


@_fields
class MaskSettings(_Settings):
    """Settings of the command ``texture-mask``."""

    kind: str = _setting(
        "active",
        "What is drawn",
        choices={
            "active": "Texels that linear sampling of some face reads",
            "boundary": "Active texels that charts cover only in part",
            "face": "The face in which the texel's center lies",
            "chart": "The chart of that face",
            "count": "How many charts read the texel",
        },
    )


@_fields
class FitSettings(_Settings):
    """Settings of the screened Poisson refit of positions to normals (paper 4.1)."""

    screening_radius: float = _setting(
        5.0,
        "How far the refit may move the surface as a whole. 0.5 keeps positions and turns faces"
        " less; 30 lets the surface drift, and above 10 there is little to gain",
        unit="mean edge lengths",
        minimum=1e-3,
        maximum=1e6,
        soft_minimum=0.5,
        soft_maximum=30.0,
        advanced=True,
        length_power=1,
        counts_in="edges",
        label="Fit Radius",
        rehearsed=(30.0,),
    )


OF_PAPER = {"where": "everywhere", "align_passes": 0, "fit_steps": 1, "crease_freedom": 0.0}
"""The neutral values of settings beyond the paper, which has the flow and a one-step refit."""


@_fields
class GeometrySettings(FitSettings, _FlowSettings):
    """Settings of :func:`shock_filter.core.sharpen_geometry` (paper 4.1).

    Where, Align Creases, Fit Steps and Crease Freedom go beyond the paper; `of_paper` leaves them
    out.
    """

    where: str = _setting(
        "creases",
        "Which parts are sharpened",
        choices={
            "everywhere": "Everything that bends more than the threshold",
            "creases": "Creases: a small network finds rounded creases, which are closed;"
            " fillets, relief and sharp edges stay",
        },
    )
    widest_fillet: float = _setting(
        0.0,
        "With Where: Creases, the radius up to which roundings are closed; wider ones stay. 0"
        " decides for each place; 1 keeps fillets of a radius of 2; 4 also closes roundings that"
        " 0 would keep",
        unit="mean edge lengths",
        maximum=4.0,
        soft_maximum=4.0,
        length_power=1,
        counts_in="edges",
        label="Widest Fillet",
        auto=0.0,
        usual=2.0,
        rehearsed=(4.0,),
    )
    amount: float = _amount()
    time: float = _changed(_FlowSettings, "time", 256.0, advanced=True)
    smoothing_passes: int = _changed(_FlowSettings, "smoothing_passes", 1, advanced=True)
    mollify_passes: int = _setting(
        0,
        "Smoothing passes on the normals before anything else, for noisy scans. 0 keeps the"
        " normals as they are; 2 cleans light noise, 16 rounds fine relief away, too",
        unit="passes",
        maximum=1000,
        soft_maximum=16,
        advanced=True,
        label="Pre-Smoothing",
        rehearsed=(1,),
    )
    feature_threshold: float = _setting(
        1.1,
        "How many times more the surface must bend than its surroundings to be sharpened. 0"
        " sharpens everything, and gently curved regions get facets; 2 keeps all but the"
        " sharpest creases",
        unit="times the surroundings",
        maximum=100.0,
        soft_maximum=2.0,
        advanced=True,
        label="Threshold",
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
        "How many times the whole filter runs, each time on the last result. 1 is once; 10 takes"
        " ten times as long",
        unit="times",
        minimum=1,
        maximum=100,
        soft_maximum=10,
        advanced=True,
    )
    max_displacement: float = _setting(
        0.0,
        "No vertex moves farther than this. 0 sets no limit; 0.1 keeps every vertex near its"
        " place, 5 stops only spikes",
        unit="mean edge lengths",
        maximum=1e6,
        soft_maximum=5.0,
        advanced=True,
        length_power=1,
        counts_in="edges",
        label="Move Limit",
    )
    align_passes: int = _setting(
        2,
        "Passes in which slanted faces along a crease, as a remesh leaves them, take the normal"
        " of one side. 0 lets each face follow its own flow line; 2 straightens saw teeth",
        unit="passes",
        maximum=100,
        soft_maximum=4,
        advanced=True,
        label="Align Creases",
    )
    fit_steps: int = _setting(
        13,
        "Steps towards the best fit of the positions. 1 turns faces part of the way; 13 lets"
        " vertices slide along flat sides onto the creases, and takes longer",
        unit="steps",
        minimum=1,
        maximum=1000,
        soft_maximum=20,
        advanced=True,
    )
    crease_freedom: float = _setting(
        0.95,
        "How much more freely vertices move where faces turn. 0 holds all equally; 0.95 holds"
        " those at creases up to twenty times less",
        unit="share of the hold",
        maximum=0.999,
        soft_maximum=0.95,
        advanced=True,
        label="Crease Freedom",
    )

    @property
    def is_neutral(self) -> bool:
        """Whether nothing changes."""
        return (self.time == 0 and self.mollify_passes == 0) or self.amount == 0

    @classmethod
    def of_paper(cls, **settings: Any) -> "GeometrySettings":
        """Return settings for the filter of the paper, with changes.

        Examples
        --------
        >>> from shock_filter import core
        >>> core.GeometrySettings.of_paper(time=64.0).fit_steps
        1
        """
        return cls(**{**OF_PAPER, **settings})


CUTOFF = 0.01
"""Weights of the kernel below this fraction of the largest one are left out."""


def _kernel_time(lengths: str, maximum: float, counts_in: str = "edges") -> Any:
    return _setting(
        1.0,
        "Size of the kernel. 0 changes nothing; where values are constant it is a Gaussian of"
        f" variance 2 * time; 10 averages over 14 {lengths} around, slowly",
        unit=f"squared {lengths}",
        maximum=maximum,
        soft_maximum=10.0,
        length_power=2,
        counts_in=counts_in,
        role="time",
    )


BY_NOISE = -1.0
"""The default beta of images and textures: it follows from the noise that is measured."""

BETA_UNKNOWN = 7.0
"""Beta where no noise can be measured, such as on a line of pixels."""


def _kernel_beta_by_noise(lengths: str) -> Any:
    return _setting(
        BY_NOISE,
        "How much differences of values count compared with distances: a step from 0 to 1 counts"
        f" as this many {lengths}. -1 measures the noise, and counts it as about one of these; 0"
        " blurs across edges; 30 keeps even faint ones, and noise with them",
        unit=f"{lengths} a unit of value",
        minimum=BY_NOISE,
        maximum=1e6,
        soft_maximum=30.0,
        length_power=1,
        counts_in=lengths,
        label="Keep Edges",
        role="edges",
        auto=BY_NOISE,
        usual=BETA_UNKNOWN,
    )


def _kernel_beta(default: float, lengths: str) -> Any:
    return _setting(
        default,
        "How much differences of values count compared with distances: a step from 0 to 1 counts"
        f" as this many {lengths}. 0 blurs across edges; 30 keeps even faint ones, and noise with"
        " them",
        unit=f"{lengths} a unit of value",
        maximum=1e6,
        soft_maximum=30.0,
        length_power=1,
        counts_in="edges",
        label="Keep Edges",
    )


@_fields
class BeltramiMeshSettings(_Settings):
    """Settings of `beltrami_vertex_signal`, `beltrami_corner_signal` and `beltrami_joint`.

    Those of the short-time Beltrami kernel (paper C).
    """

    time: float = _kernel_time("mean edge lengths", 1e6)
    beta: float = _kernel_beta(3.0, "mean edge lengths")
    iterations: int = _setting(
        1,
        "How often the kernel is applied, each time with distances measured on the last result."
        " Several short times keep edges better than one long time; 10 flattens what lies"
        " between edges",
        unit="times",
        minimum=1,
        maximum=1000,
        soft_maximum=10,
        role="repeats",
    )

    @property
    def limit(self) -> float:
        """Squared distance beyond which weights are below `CUTOFF`."""
        return -4.0 * self.time * math.log(CUTOFF)


@_fields
class BeltramiSettings(BeltramiMeshSettings):
    """Settings of :func:`shock_filter.core.beltrami_image` and `beltrami_manifold`."""

    time: float = _kernel_time("pixels", 100.0, counts_in="pixels")
    beta: float = _kernel_beta_by_noise("pixels")
    iterations: int = _changed(BeltramiMeshSettings, "iterations", 2)
    alpha: str = _alpha()

    @property
    def by_noise(self) -> bool:
        """Whether `beta` follows from the noise that is measured."""
        return self.beta < 0 and self.time > 0

    @property
    def reach(self) -> float:
        """About the number of pixels in the mean of one iteration."""
        return max(math.pi * self.limit, 1.0)


@_fields
class BeltramiTextureSettings(DilateSettings, BeltramiSettings):
    """Settings of :func:`shock_filter.core.beltrami_texture`."""

    time: float = _kernel_time("texels", 100.0, counts_in="texels")
    beta: float = _kernel_beta_by_noise("texels")
    alpha: str = _alpha()
    content: str = _content()


@_fields
class BeltramiGeometrySettings(FitSettings, BeltramiMeshSettings):
    """Settings of :func:`shock_filter.core.denoise_geometry`.

    Bump Size and Keep Creases count for the learned mixture only, all below them for the Beltrami
    kernel only.
    """

    method: str = _setting(
        "automatic",
        "How noise is distinguished from the shape",
        choices={
            "automatic": "A small network that was trained to recognize noise mixes many"
            " smoothings of the face normals, separately for each face",
            "beltrami": "One kernel for all faces, as in the paper, with the settings below",
        },
    )
    strength: float = _setting(
        1.0,
        "How much of the change is applied. 0 changes nothing, 1 applies all of it; 2 goes twice"
        " as far, beyond the smooth surface",
        unit="of the change",
        maximum=2.0,
        soft_maximum=1.0,
    )
    bump_size: float = _setting(
        0.0,
        "Width of bumps to remove, as photogrammetry leaves them, together with all relief that"
        " is not wider. 0 removes only noise, and no bumps; 3 to 5 are usual",
        unit="mean edge lengths",
        maximum=20.0,
        soft_maximum=8.0,
        auto=0.0,
        auto_label="None",
        auto_description="Remove only noise, and no bumps",
        usual=4.0,
    )
    keep_creases: float = _setting(
        0.5,
        "How crisp creases come out of the noise. 0 rounds them; 0.5 leaves them as they were"
        " found; 1 makes them crisp, and smooth shapes faceted",
        unit="of the way from round to crisp",
        maximum=1.0,
        soft_maximum=1.0,
    )
    time: float = _changed(
        BeltramiMeshSettings,
        "time",
        0.5,
        "Size of the kernel. 0 changes nothing; on a plane it is a Gaussian of variance 2 *"
        " time. 10 removes coarse noise, and fine relief with it",
        advanced=True,
    )
    beta: float = _changed(
        BeltramiMeshSettings,
        "beta",
        0.9,
        "How much differences of face normals count compared with distances. At 1, a difference"
        " as large as the noise counts as one mean edge length, and a crease as many. 0 blurs"
        " across creases; 5 keeps even faint ones, and noise with them",
        unit="mean edge lengths for the noise",
        soft_maximum=5.0,
        advanced=True,
    )
    iterations: int = _changed(
        BeltramiMeshSettings,
        "iterations",
        3,
        "How often the kernel is applied, each time with distances measured on the last result."
        " 1 is for light noise; 10 is for strong noise, and flattens fine relief",
        advanced=True,
    )
    filtered: str = _setting(
        "normals",
        "What is filtered",
        choices={
            "normals": "The face normals, to which the surface is fitted: keeps creases",
            "positions": "The positions of the vertices, as in the paper: rounds creases and"
            " shrinks the surface a little. Only Strength, Time and Iterations matter then",
        },
        advanced=True,
        label="Filter",
    )
    mollify_passes: int = _changed(
        GeometrySettings,
        "mollify_passes",
        1,
        "Smoothing passes on the normals from which distances are measured, but not on those"
        " that are averaged. 0 is for clean surfaces, 1 for noisy ones; 4 blurs fine creases",
        soft_maximum=4,
    )
    repeat: int = _changed(GeometrySettings, "repeat", 3)

    @property
    def is_neutral(self) -> bool:
        """Whether nothing changes."""
        return self.strength == 0 or (self.method == "beltrami" and self.time == 0)
